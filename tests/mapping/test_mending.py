"""The log of edits: undo and redo, the file beside the map, and opening a map with its edits."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mended_maps import assert_same, check_map, random_edit
from toy_maps import TOY_SPEC, TOY_THINGS, TOY_WALLS, map_of_boxes, toy_map

from simaps_viz.errors import InputError
from simaps_viz.mapping import edits
from simaps_viz.mapping.edit_log import (
    EditLog,
    EditsFile,
    Entry,
    apply_log,
    edits_of,
    edits_path,
    fingerprint,
    moved_to,
    people_in_words,
    read_edits,
    save_edits,
)
from simaps_viz.mapping.edits import apply_edits
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.mending import Mending, load_mended, open_mending
from simaps_viz.mapping.simap import repartition

TOY = toy_map()
QUICK = settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
)
WHEN = "2026-11-21T19:30:00Z"


@pytest.fixture
def toy_file(tmp_path):
    save_map(TOY, tmp_path / "toy.npz")
    return tmp_path / "toy.npz"


def a_log():
    log = EditLog().add(edits.merge(TOY, 3, 4), who="Ann", when=WHEN)
    log = log.add(edits.split(TOY, 8, (3.6, 0.0), (3.6, 1.0)), who="Bo", when=WHEN)
    log = log.add(edits.relabel(TOY, 5, "día bed"), who="Ann", when=WHEN)
    return log.add(edits.delete(TOY, 9), who="Ann", when=WHEN).undo()


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
    mending.merge(mending.simap(), 3, 4, who="Ann")
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


# --- opening a map with its edits


def test_opening_replays_and_the_map_file_stays_unmended(toy_file):
    before = toy_file.read_bytes()
    mending = open_mending(toy_file)
    assert not mending.saved and not edits_path(toy_file).exists()
    shown = mending.merge(mending.simap(), 3, 4, who="Ann")
    shown = mending.split(shown, 8, (3.6, 0.0), (3.6, 1.0), who="Bo")
    check_map(shown)
    assert_same(load_mended(toy_file), shown)
    assert toy_file.read_bytes() == before and mending.saved
    again = open_mending(toy_file)
    assert_same(again.undo(again.simap()), replay_log(mending, 1))


def test_a_mended_map_can_be_saved_as_a_map_of_its_own(toy_file, tmp_path):
    mending = open_mending(toy_file)
    shown = mending.relabel(mending.simap(), 5, "sofa bed", who="Ann")
    save_map(shown, tmp_path / "mended.npz")
    again = load_mended(tmp_path / "mended.npz")
    assert again.counts()["sofa bed"] == 1 and again.provenance["edits"][0]["who"] == "Ann"
    more = open_mending(tmp_path / "mended.npz")
    twice = more.delete(more.simap(), 9, who="Bo")
    assert [edit["who"] for edit in twice.provenance["edits"]] == ["Ann", "Bo"]
    assert_same(load_map(tmp_path / "mended.npz"), again)


def test_edits_made_at_another_k_are_undone_at_that_k(toy_file):
    mending = open_mending(toy_file)
    high = repartition(mending.simap(), k_percent=30.0)
    shown = mending.merge(high, 6, 8, who="Ann")
    assert shown.parameters["k_percent"] == 30.0 and len(shown.of_class("dining table")) == 2
    low = repartition(shown, k_percent=0.0)
    back = mending.undo(low)
    assert_same(back, repartition(load_map(toy_file), k_percent=0.0))
    assert_same(mending.refresh(mending.redo(back)), repartition(shown, k_percent=0.0))


def test_another_resolution_keeps_the_edits(toy_file):
    mending = open_mending(toy_file)
    mending.delete(mending.simap(), 3, who="Ann")
    finer = mending.recommunity(mending.simap(), resolution=4.0, k_percent=5.0)
    check_map(finer)
    assert not finer.instance[20:28, 12:20].any() and finer.parameters["resolution"] == 4.0
    shown = mending.merge(finer, *(one.id for one in finer.instances[:2]), who="Ann")
    assert shown.parameters["resolution"] == 4.0
    check_map(shown)
    assert_same(mending.undo(shown), finer)
    assert_same(mending.recommunity(finer, resolution=1.0, k_percent=5.0), mending.simap())


def test_two_people_see_one_another_and_undo_takes_back_the_last_edit(toy_file):
    mending = open_mending(toy_file)
    hers = mending.merge(mending.simap(), 3, 4, who="Ann")
    both = mending.delete(mending.refresh(mending.simap()), 9, who="Bo")
    assert [entry.who for entry in mending.log.entries] == ["Ann", "Bo"]
    assert_same(mending.undo(hers), replay_log(mending, 1))
    assert len(both.instances) == len(TOY.instances) - 2


def replay_log(mending, entries):
    return apply_log(mending.original, EditLog(mending.log.entries[:entries])).simap


def test_edits_of_a_stale_page_that_no_longer_make_sense_are_refused(toy_file):
    mending = open_mending(toy_file)
    stale = mending.simap()
    mending.delete(stale, 3, who="Ann")
    with pytest.raises(InputError, match="no longer makes sense"):
        mending.relabel(stale, 3, "stool", who="Bo")
    assert len(mending.log.entries) == 1 and open_mending(toy_file).log == mending.log


def test_what_cannot_be_saved_is_not_done(toy_file):
    mending = open_mending(toy_file)
    mending.delete(mending.simap(), 9, who="Ann")
    kept = mending.log
    edits_path(toy_file).write_text("another program was here")
    with pytest.raises(InputError, match="expected the edits as they were read"):
        mending.delete(mending.simap(), 3, who="Ann")
    assert mending.log == kept and edits_path(toy_file).read_text() == "another program was here"
    edits_path(toy_file).unlink()
    with pytest.raises(InputError, match="expected the edits as they were read"):
        mending.undo(mending.simap())


def test_another_map_is_refused(toy_file):
    mending = open_mending(toy_file)
    other = toy_map()
    assert mending.covers(repartition(mending.simap(), k_percent=1.0)) and not mending.covers(other)
    with pytest.raises(InputError, match="found another"):
        mending.delete(other, 3, who="Ann")


# --- a map that was built anew


def shifted_toy():
    """The same room, on a grid that grew by 3 cells to the west and lost chair 3."""
    spec = dataclasses.replace(TOY_SPEC, cols=TOY_SPEC.cols + 3, x0_m=TOY_SPEC.x0_m - 3 * 0.05)
    move = [dataclasses.replace(box, col=box.col + 3) for box in (*TOY_THINGS, *TOY_WALLS)]
    things, walls = move[: len(TOY_THINGS)], move[len(TOY_THINGS) :]
    return map_of_boxes(spec, [*things[:1], *things[2:]], walls)


def test_a_map_built_anew_refuses_the_edits_in_words_and_takes_them_over_when_asked(toy_file):
    mending = open_mending(toy_file)
    shown = mending.delete(mending.simap(), 3, who="Ann")
    shown = mending.split(shown, 8, (3.6, 0.0), (3.6, 1.0), who="Ann")
    mending.relabel(shown, 9, "fern", who="Bo")
    kept = edits_path(toy_file).read_bytes()
    save_map(shifted_toy(), toy_file)
    with pytest.raises(InputError, match=r"expected edits of toy\.npz as it is, found edits of another build"):
        load_mended(toy_file)
    adopted = open_mending(toy_file, adopt=True)
    (why,) = adopted.refused()
    assert "took away chair #3: no longer makes sense: 0 of its 64 cells" in why
    now = adopted.simap()
    check_map(now)
    assert now.counts()["fern"] == 1 and sorted(i.cells for i in now.of_class("dining table")) == [48, 144, 216]
    assert edits_path(toy_file).read_bytes() == kept  # until something is changed
    adopted.undo(now)
    assert len(open_mending(toy_file).log.entries) == 2 and len(open_mending(toy_file).refused()) == 1


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


def test_mending_without_a_file_starts_empty(tmp_path):
    mending = Mending(TOY, EditLog(), tmp_path / "toy.edits.json")
    assert mending.simap() is TOY and mending.refused() == () and apply_edits(TOY, []).simap is TOY
    assert np.array_equal(mending.refresh(TOY).instance, TOY.instance)
    assert Entry(edits.delete(TOY, 9), "Ann", WHEN).to_json()["what"] == "took away potted plant #9"
