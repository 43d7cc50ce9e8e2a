"""`simaps mend`, and that the other commands show the mended map."""

import json

import pytest
from mended_maps import check_map
from toy_maps import toy_map

from simaps_viz.app.workbench import login, mending_panels
from simaps_viz.cli.main import main
from simaps_viz.cli.mend import do
from simaps_viz.errors import InputError
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.mending import edits_path, load_mended, open_mending


@pytest.fixture
def toy_file(tmp_path):
    save_map(toy_map(), tmp_path / "toy.npz")
    return tmp_path / "toy.npz"


def spoken(capsys, *arguments):
    status = main([str(argument) for argument in arguments])
    printed = capsys.readouterr()
    return status, printed.out, " ".join(printed.err.split())


def counts(capsys, *arguments):
    status, out, _ = spoken(capsys, "info", *arguments, "--json")
    assert status == 0
    return json.loads(out)["counts"]


def test_edits_are_done_listed_and_taken_back(toy_file, capsys):
    status, out, _ = spoken(capsys, "mend", toy_file, "merge 3 4", "relabel 5  sofa  bed", "delete 9", "--who", "Ann")
    assert status == 0
    lines = out.splitlines()
    assert lines[0].startswith("1. 20") and lines[0].endswith("Z  Ann  joined chair #3 and chair #4")
    assert lines[1].endswith("couch #5 is called sofa bed") and lines[2].endswith("took away potted plant #9")
    assert lines[3] == f"{edits_path(toy_file)}: 3 edits"
    assert counts(capsys, toy_file) == {"chair": 2, "dining table": 2, "sofa bed": 1}
    assert counts(capsys, toy_file, "--no-edits") == toy_map().counts()
    status, out, _ = spoken(capsys, "mend", toy_file, "undo", "undo", "--json")
    record = json.loads(out)
    assert [edit["who"] for edit in record["edits"]] == ["Ann"] and record["undone"] == 2
    assert record["counts"]["couch"] == 1 and record["not_done"] == []
    status, out, _ = spoken(capsys, "mend", toy_file, "redo")
    assert "1 taken back" in out and counts(capsys, toy_file)["sofa bed"] == 1


def test_a_cut_by_numbers(toy_file, capsys):
    assert spoken(capsys, "mend", toy_file, "split 8 3.6 0 3.6 1")[0] == 0
    assert sorted(one.cells for one in load_mended(toy_file).of_class("dining table")) == [48, 144, 216]


@pytest.mark.parametrize(
    "edit", ["explode 3", "merge 3", "merge 3 x", "split 8 1 2 3", "relabel 5", "delete", "undo 3", "", "delete 1 2"]
)
def test_what_is_not_understood_is_said_and_nothing_is_done(toy_file, capsys, edit):
    status, _, err = spoken(capsys, "mend", toy_file, "delete 9", edit)
    assert status == 2 and "expected merge ID ID, split ID X Y X Y" in err
    assert not edits_path(toy_file).exists()


def test_all_edits_or_none(toy_file, capsys):
    status, _, err = spoken(capsys, "mend", toy_file, "delete 9", "delete 77")
    assert status == 2 and "instance 77: not on this map" in err and not edits_path(toy_file).exists()
    mending = open_mending(toy_file)
    with pytest.raises(InputError), mending.batch():
        do(mending, mending.simap(), "delete 9", "Ann")
        do(mending, mending.simap(), "delete 77", "Ann")
    assert mending.log.entries == () and not mending.saved


def test_the_mended_map_as_a_map_of_its_own(toy_file, tmp_path, capsys):
    before = toy_file.read_bytes()
    out = tmp_path / "mended.npz"
    assert spoken(capsys, "mend", toy_file, "merge 3 4", "-o", out, "--who", "Ann")[0] == 0
    check_map(load_map(out))
    assert counts(capsys, out)["chair"] == 2 and toy_file.read_bytes() == before
    _, said, _ = spoken(capsys, "info", out)
    assert "1 edit: 1 by Ann" in said
    _, said, _ = spoken(capsys, "info", toy_file, "--no-edits")
    assert "edit" not in said
    status, _, err = spoken(capsys, "mend", toy_file, "delete 9", "-o", toy_file)
    assert status == 2 and "expected another file than the map" in err
    assert len(open_mending(toy_file).log.entries) == 1


def test_exports_and_queries_have_the_mended_objects(toy_file, tmp_path, capsys):
    spoken(capsys, "mend", toy_file, "relabel 5 piano")
    assert spoken(capsys, "export", toy_file, "-o", tmp_path / "toy.geojson")[0] == 0
    assert '"piano"' in (tmp_path / "toy.geojson").read_text()
    spoken(capsys, "export", toy_file, "-o", tmp_path / "built.geojson", "--no-edits")
    assert '"piano"' not in (tmp_path / "built.geojson").read_text()
    pose = ("--pose", "0.5", "0.5", "90", "--json")
    assert spoken(capsys, "query", toy_file, "go to the piano", *pose)[0] == 0
    assert spoken(capsys, "query", toy_file, "go to the piano", "--no-edits", *pose)[0] == 1


def test_damaged_edits_stop_nobody_who_leaves_them_out(toy_file, capsys):
    edits_path(toy_file).write_text("{")
    status, _, err = spoken(capsys, "info", toy_file)
    assert status == 2 and "toy.edits.json" in err and "--no-edits leaves them out" in err
    assert counts(capsys, toy_file, "--no-edits") == toy_map().counts()
    assert edits_path(toy_file).read_text() == "{"


def test_what_cannot_be_saved_was_not_done(toy_file, tmp_path, monkeypatch, capsys):
    def refuse(simap, path):
        raise InputError(f"{path}: could not write the map: No space left on device")

    monkeypatch.setattr("simaps_viz.mapping.file.save_map", refuse)
    status, _, err = spoken(capsys, "mend", toy_file, "merge 3 4", "-o", tmp_path / "mended.npz")
    assert status == 2 and "No space left" in err
    assert not edits_path(toy_file).exists()
    monkeypatch.undo()
    assert spoken(capsys, "mend", toy_file, "merge 3 4", "-o", tmp_path / "mended.npz")[0] == 0
    assert counts(capsys, tmp_path / "mended.npz") == counts(capsys, toy_file)


def test_edits_of_another_build_are_adopted(toy_file, capsys):
    spoken(capsys, "mend", toy_file, "delete 9", "merge 3 4")
    other = toy_map()
    other.grid.height_m[50, 50] = 0.01
    save_map(other, toy_file)
    status, _, err = spoken(capsys, "info", toy_file)
    assert status == 2 and "--adopt" in err
    status, out, _ = spoken(capsys, "mend", toy_file, "--adopt")
    assert status == 0 and "2 edits" in out
    assert "potted plant" not in counts(capsys, toy_file)


def test_the_page_gets_what_it_needs(toy_file):
    mending = open_mending(toy_file)
    simap = mending.do(mending.do(mending.simap(), "merge", 3, 4, who="Ann"), "delete", 9, who="Bo")
    simap = mending.do(
        mending.do(simap, "split", 8, (3.6, 0.0), (3.6, 1.0), who="Ann"), "relabel", 5, "piano", who="Bo"
    )
    assert [entry.who for entry in mending.log.entries] == ["Ann", "Bo", "Ann", "Bo"]
    assert mending.log.undone == () and mending.saved and mending.covers(simap) and mending.refused() == ()
    assert mending.redo(mending.undo(simap)).instances == simap.instances
    assert mending.path == edits_path(toy_file) and login() != ""
    assert mending_panels(None) == () and [spec.title for spec in mending_panels(mending)] == ["Mend"]
