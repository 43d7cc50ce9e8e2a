"""Editing a map that people look at: opening it with its edits, at any threshold, by several people."""

import numpy as np
import pytest
from edited_toys import TOY, WHEN, shifted_toy
from hypothesis import HealthCheck, settings
from mended_maps import assert_same, check_map
from toy_maps import toy_map

from simaps_viz.errors import InputError
from simaps_viz.mapping import edits
from simaps_viz.mapping.edits import apply_edits
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.mending import (
    EditLog,
    Entry,
    Mending,
    apply_log,
    edits_path,
    load_mended,
    open_mending,
)
from simaps_viz.mapping.simap import repartition

QUICK = settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
)


@pytest.fixture
def toy_file(tmp_path):
    save_map(TOY, tmp_path / "toy.npz")
    return tmp_path / "toy.npz"


# --- opening a map with its edits


def test_opening_replays_and_the_map_file_stays_unmended(toy_file):
    before = toy_file.read_bytes()
    mending = open_mending(toy_file)
    assert not mending.saved and not edits_path(toy_file).exists()
    shown = mending.do(mending.simap(), "merge", 3, 4, who="Ann")
    shown = mending.do(shown, "split", 8, (3.6, 0.0), (3.6, 1.0), who="Bo")
    check_map(shown)
    assert_same(load_mended(toy_file), shown)
    assert toy_file.read_bytes() == before and mending.saved
    again = open_mending(toy_file)
    assert_same(again.undo(again.simap()), replay_log(mending, 1))


def test_a_mended_map_can_be_saved_as_a_map_of_its_own(toy_file, tmp_path):
    mending = open_mending(toy_file)
    shown = mending.do(mending.simap(), "relabel", 5, "sofa bed", who="Ann")
    save_map(shown, tmp_path / "mended.npz")
    again = load_mended(tmp_path / "mended.npz")
    assert again.counts()["sofa bed"] == 1 and again.provenance["edits"][0]["who"] == "Ann"
    more = open_mending(tmp_path / "mended.npz")
    twice = more.do(more.simap(), "delete", 9, who="Bo")
    assert [edit["who"] for edit in twice.provenance["edits"]] == ["Ann", "Bo"]
    assert_same(load_map(tmp_path / "mended.npz"), again)


def test_edits_made_at_another_k_are_undone_at_that_k(toy_file):
    mending = open_mending(toy_file)
    high = repartition(mending.simap(), k_percent=30.0)
    shown = mending.do(high, "merge", 6, 8, who="Ann")
    assert shown.parameters["k_percent"] == 30.0 and len(shown.of_class("dining table")) == 2
    low = repartition(shown, k_percent=0.0)
    back = mending.undo(low)
    assert_same(back, repartition(load_map(toy_file), k_percent=0.0))
    assert_same(mending.refresh(mending.redo(back)), repartition(shown, k_percent=0.0))


def test_another_resolution_keeps_the_edits(toy_file):
    mending = open_mending(toy_file)
    mending.do(mending.simap(), "delete", 3, who="Ann")
    finer = mending.recommunity(mending.simap(), resolution=4.0, k_percent=5.0)
    check_map(finer)
    assert not finer.instance[20:28, 12:20].any() and finer.parameters["resolution"] == 4.0
    shown = mending.do(finer, "merge", *(one.id for one in finer.instances[:2]), who="Ann")
    assert shown.parameters["resolution"] == 4.0
    check_map(shown)
    assert_same(mending.undo(shown), finer)
    assert_same(mending.recommunity(finer, resolution=1.0, k_percent=5.0), mending.simap())


def test_two_people_see_one_another_and_undo_takes_back_the_last_edit(toy_file):
    mending = open_mending(toy_file)
    hers = mending.do(mending.simap(), "merge", 3, 4, who="Ann")
    both = mending.do(mending.refresh(mending.simap()), "delete", 9, who="Bo")
    assert [entry.who for entry in mending.log.entries] == ["Ann", "Bo"]
    assert_same(mending.undo(hers), replay_log(mending, 1))
    assert len(both.instances) == len(TOY.instances) - 2


def replay_log(mending, entries):
    return apply_log(mending.original, EditLog(mending.log.entries[:entries])).simap


def test_edits_of_a_stale_page_that_no_longer_make_sense_are_refused(toy_file):
    mending = open_mending(toy_file)
    stale = mending.simap()
    mending.do(stale, "delete", 3, who="Ann")
    with pytest.raises(InputError, match="no longer makes sense"):
        mending.do(stale, "relabel", 3, "stool", who="Bo")
    assert len(mending.log.entries) == 1 and open_mending(toy_file).log == mending.log


def test_what_cannot_be_saved_is_not_done(toy_file):
    mending = open_mending(toy_file)
    mending.do(mending.simap(), "delete", 9, who="Ann")
    kept = mending.log
    edits_path(toy_file).write_text("another program was here")
    with pytest.raises(InputError, match="expected the edits as they were read"):
        mending.do(mending.simap(), "delete", 3, who="Ann")
    assert mending.log == kept and edits_path(toy_file).read_text() == "another program was here"
    edits_path(toy_file).unlink()
    with pytest.raises(InputError, match="expected the edits as they were read"):
        mending.undo(mending.simap())


def test_another_map_is_refused(toy_file):
    mending = open_mending(toy_file)
    other = toy_map()
    assert mending.covers(repartition(mending.simap(), k_percent=1.0)) and not mending.covers(other)
    with pytest.raises(InputError, match="found another"):
        mending.do(other, "delete", 3, who="Ann")


# --- a map that was built anew


def test_a_map_built_anew_refuses_the_edits_in_words_and_takes_them_over_when_asked(toy_file):
    mending = open_mending(toy_file)
    shown = mending.do(mending.simap(), "delete", 3, who="Ann")
    shown = mending.do(shown, "split", 8, (3.6, 0.0), (3.6, 1.0), who="Ann")
    mending.do(shown, "relabel", 9, "fern", who="Bo")
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


def test_mending_without_a_file_starts_empty(tmp_path):
    mending = Mending(TOY, EditLog(), tmp_path / "toy.edits.json")
    assert mending.simap() is TOY and mending.refused() == () and apply_edits(TOY, []).simap is TOY
    assert np.array_equal(mending.refresh(TOY).instance, TOY.instance)
    assert Entry(edits.delete(TOY, 9), "Ann", WHEN).to_json()["what"] == "took away potted plant #9"
