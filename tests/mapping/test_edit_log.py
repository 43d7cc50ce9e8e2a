"""The log of edits: undo and redo, who did what, and the file beside the map."""

import dataclasses
import json

import pytest
from edited_toys import TOY, WHEN, a_log, shifted_toy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mended_maps import assert_same, random_edit
from toy_maps import toy_map

from simaps_viz.errors import InputError
from simaps_viz.mapping import edits
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.mending import (
    EditLog,
    EditsFile,
    apply_log,
    edits_of,
    edits_path,
    fingerprint,
    load_mended,
    moved_to,
    open_mending,
    people_in_words,
    read_edits,
    save_edits,
)

QUICK = settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
)


@pytest.fixture
def toy_file(tmp_path):
    save_map(TOY, tmp_path / "toy.npz")
    return tmp_path / "toy.npz"


# --- the log


@QUICK
@given(st.data())
def test_undo_takes_back_any_sequence_and_redo_brings_it_again(data):
    log, simap, seen = EditLog(), TOY, [TOY]
    for _ in range(data.draw(st.integers(1, 5))):
        edit = data.draw(random_edit(simap))
        if edit is not None:
            log = log.add(edit, who="Ann")
            simap = apply_log(TOY, log).simap
            seen.append(simap)
    full = log
    for before in reversed(seen[:-1]):
        log = log.undo()
        assert_same(apply_log(TOY, log).simap, before)
    assert apply_log(TOY, log).simap is TOY
    for after in seen[1:]:
        log = log.redo()
        assert_same(apply_log(TOY, log).simap, after)
    assert log == full


def test_a_new_edit_forgets_what_was_undone():
    log = a_log()
    assert len(log.entries) == 3 and len(log.undone) == 1
    assert log.add(edits.delete(TOY, 9), who="Bo").undone == ()
    assert [entry.who for entry in log.entries] == ["Ann", "Bo", "Ann"]


def test_nothing_to_undo_or_redo_is_said():
    with pytest.raises(InputError, match="undo: expected an edit"):
        EditLog().undo()
    with pytest.raises(InputError, match="redo: expected an edit"):
        EditLog().redo()


@pytest.mark.parametrize("who", ["", "  ", "x" * 81, "a\nb\x07"])
def test_an_edit_is_signed(who):
    with pytest.raises(InputError, match="name: expected who"):
        EditLog().add(edits.delete(TOY, 9), who=who)


def test_the_map_says_who_did_what():
    done = apply_log(TOY, a_log()).simap
    assert done.provenance["edits"] == [
        {"who": "Ann", "when": WHEN, "what": "joined chair #3 and chair #4", "instances": [3]},
        {"who": "Bo", "when": WHEN, "what": "cut dining table #8 in two", "instances": [8, 10]},
        {"who": "Ann", "when": WHEN, "what": "couch #5 is called día bed", "instances": [5]},
    ]
    assert [edit["who"] for edit in edits_of(done, 10)] == ["Bo"] and edits_of(done, 1) == edits_of(TOY, 3) == []
    assert people_in_words(done.provenance["edits"]) == "3 edits: 2 by Ann, 1 by Bo"
    assert people_in_words([]) == "" and people_in_words([{"who": "Bo"}]) == "1 edit: 1 by Bo"
    assert "edits" not in TOY.provenance


# --- the file


@QUICK
@given(data=st.data())
def test_what_is_read_back_is_what_was_written(data, tmp_path_factory):
    log, simap = EditLog(), TOY
    for _ in range(3):
        edit = data.draw(random_edit(simap))
        if edit is not None:
            log = log.add(edit, who=data.draw(st.sampled_from(["Ann", "Jörg Ö."])))
            simap = apply_log(TOY, log).simap
    log = log.undo() if log.entries and data.draw(st.booleans()) else log
    path = tmp_path_factory.mktemp("edits") / "toy.edits.json"
    written = save_edits(path, EditsFile(fingerprint(TOY), TOY.spec, log), "toy.npz")
    contents, read = read_edits(path)
    assert contents.log == log and contents.spec == TOY.spec and read == written
    assert_same(apply_log(TOY, contents.log).simap, apply_log(TOY, log).simap)


def test_the_file_can_be_read_by_a_person(toy_file):
    mending = open_mending(toy_file)
    mending.do(mending.simap(), "merge", 3, 4, who="Ann")
    record = json.loads(edits_path(toy_file).read_text())
    assert edits_path(toy_file).name == "toy.edits.json"
    assert record["format"] == "simap-edits/1" and record["map"]["file"] == "toy.npz"
    (entry,) = record["edits"]
    assert entry["who"] == "Ann" and entry["do"] == "merge" and entry["objects"] == [3, 4]
    assert sum(length for _, length in entry["cells"]) == 128


DAMAGED = {
    "cut off": lambda text: text[: len(text) // 2],
    "empty": lambda text: "",
    "a list": lambda text: "[]",
    "another format": lambda text: text.replace("simap-edits/1", "simap-edits/9"),
    "no edits": lambda text: text.replace('"edits"', '"other"'),
    "unknown kind": lambda text: text.replace('"merge"', '"explode"'),
    "not a date": lambda text: text.replace(WHEN, "yesterday"),
    "nobody": lambda text: text.replace('"Ann"', '""'),
    "cells beyond the grid": lambda text: text.replace('"rows": 100', '"rows": 10'),
    "no class": lambda text: text.replace('"día bed"', "7"),
    "no line": lambda text: text.replace('"line_m"', '"lime"'),
    "grid of nothing": lambda text: text.replace('"cell_size_m": 0.05', '"cell_size_m": 0'),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_file_is_one_line_and_stays_as_it_is(toy_file, damage):
    path = edits_path(toy_file)
    save_edits(path, EditsFile(fingerprint(TOY), TOY.spec, a_log()), "toy.npz")
    whole = path.read_text()
    assert open_mending(toy_file).log == a_log()
    path.write_text(DAMAGED[damage](whole))
    assert path.read_text() != whole
    found = path.read_bytes()
    with pytest.raises(InputError) as caught:
        load_mended(toy_file)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value) and "--no-edits" in str(caught.value)
    assert path.read_bytes() == found


def test_edits_lie_on_the_same_ground_after_moving_and_cells_of_another_size_are_refused():
    contents = EditsFile(fingerprint(TOY), TOY.spec, a_log())
    there = moved_to(contents, shifted_toy())
    back = moved_to(there, TOY)
    assert back.log == contents.log and there.log != contents.log
    coarse = dataclasses.replace(TOY.spec, cell_size_m=0.1)
    with pytest.raises(InputError, match=r"expected a map with cells of 0\.1 m, found one with 0\.05 m"):
        moved_to(dataclasses.replace(contents, spec=coarse), TOY)


def test_the_fingerprint_speaks_of_the_grid_and_not_of_the_partition():
    assert fingerprint(TOY) == fingerprint(toy_map(k_percent=30.0))
    label = TOY.grid.label.copy()
    label[50, 50] = 0
    other = dataclasses.replace(TOY, grid=dataclasses.replace(TOY.grid, label=label))
    assert fingerprint(other) != fingerprint(TOY)
