"""Rooms are renamed, joined and cut by hand; the edits are kept beside the map and hold for any partition."""

import json

import numpy as np
import pytest
from toy_maps import toy_map

from simaps_viz.cli.mend import do
from simaps_viz.errors import InputError
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.floor_plan import with_rooms
from simaps_viz.mapping.mending import open_mending
from simaps_viz.mapping.simap import repartition


@pytest.fixture
def mending(tmp_path):
    save_map(with_rooms(toy_map()), tmp_path / "toy.npz")
    return open_mending(tmp_path / "toy.npz")


def test_rooms_are_renamed_joined_and_cut_and_every_change_is_undone(mending, tmp_path):
    built = mending.simap()
    first, second = built.rooms
    named = do(mending, built, "rename-room 2 the quiet corner", "Ada")
    assert [room.name for room in named.rooms] == [first.name, "the quiet corner"]
    joined = do(mending, named, "join-rooms 1 2", "Ada")
    assert [room.id for room in joined.rooms] == [1] and joined.rooms[0].area_m2 == first.area_m2 + second.area_m2
    cut = do(mending, joined, "cut-room 1 0 2 6 2", "Ada")
    y = np.nonzero(cut.room_cells == 2)[0]
    assert len(cut.rooms) == 2 and cut.rooms[0].area_m2 >= cut.rooms[1].area_m2
    assert y.max() < 40 or y.min() >= 40
    assert np.array_equal(cut.room_cells > 0, built.room_cells > 0)
    assert cut.instances == built.instances and np.array_equal(cut.instance, built.instance)
    assert [edit["what"] for edit in cut.provenance["edits"]][1:] == [
        f"joined the {first.name} and the quiet corner", f"cut the {joined.rooms[0].name} in two",
    ]  # fmt: skip
    assert all(edit["instances"] == [] for edit in cut.provenance["edits"])
    # on disk, and for another partition
    again = open_mending(tmp_path / "toy.npz")
    assert np.array_equal(again.simap().room_cells, cut.room_cells)
    moved = again.refresh(repartition(again.original, k_percent=25.0))
    assert np.array_equal(moved.room_cells, cut.room_cells) and len(moved.instances) > len(cut.instances)
    save_map(again.simap(), tmp_path / "mended.npz")
    assert np.array_equal(load_map(tmp_path / "mended.npz").room_cells, cut.room_cells)
    back = do(again, do(again, again.simap(), "undo", "Ada"), "undo", "Ada")
    assert [room.name for room in back.rooms] == [first.name, "the quiet corner"]
    assert np.array_equal(back.room_cells, built.room_cells)
    assert len(json.loads((tmp_path / "toy.edits.json").read_text())["undone"]) == 2


def test_rooms_and_objects_are_edited_together(mending):
    simap = do(mending, mending.simap(), "rename-room 1 studio", "Ada")
    with pytest.raises(InputError, match="a name that no room has"):
        do(mending, simap, "rename-room 2 Studio", "Ada")
    simap = do(mending, simap, f"delete {simap.of_class('chair')[0].id}", "Ada")
    assert simap.rooms[0].name == "studio" and len(simap.of_class("chair")) == 2
    assert all(one.id in {i for room in simap.rooms for i in room.objects} for one in simap.of_class("chair"))


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        ("rename-room 9 den", "room 9: not on this map"), ("rename-room 1", "edit: expected"),
        ("rename-room 1 " + "x" * 41, "1 to 40 characters"),
        ("join-rooms 1 1", "two rooms"), ("join-rooms 1", "edit: expected"), ("join-rooms 1 7", "room 7"),
        ("cut-room 1 0 0 0 0", "two different points"), ("cut-room 1 0 90 9 90", "on one side"),
        ("cut-room 1 0 0 nan 9", "points in metres"),
    ],
)  # fmt: skip
def test_edits_of_rooms_that_make_no_sense_are_refused_and_change_nothing(mending, edit, why):
    with pytest.raises(InputError, match=why):
        do(mending, mending.simap(), edit, "Ada")
    assert not mending.saved and mending.log.entries == ()
