"""The rooms of a map: what bounds them, their names, and what asks for them."""

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_maps import furnished_map, toy_map

from simaps_viz.errors import InputError
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.floor_plan import find_rooms, floor_plan, likely_kind, with_rooms
from simaps_viz.mapping.simap import repartition

ROOT = Path(__file__).parents[2]
OUTER = [[0, 0, 9.2, 0.1], [0, 5.1, 9.2, 5.2], [0, 0, 0.1, 5.2], [9.1, 0, 9.2, 5.2]]
KITCHEN = [["stove", 0.2, 0.2, 0.8, 0.8, 0.9], ["refrigerator", 1.0, 0.2, 1.7, 0.9, 1.8]]
BEDROOM = [["bed", 6.0, 3.0, 8.0, 4.8, 0.6], ["nightstand", 8.2, 4.4, 8.6, 4.8, 0.5]]


def flat(*, opening=(2.0, 2.9), walls=(), things=(), bed=True):
    """Make a flat of 9 m x 5 m with an opening in the wall at x = 4.5 m, a kitchen west, and a bedroom east of it."""
    low, high = opening
    between = [[4.5, 0, 4.6, low], [4.5, high, 4.6, 5.2]]
    standing = [*KITCHEN, *(BEDROOM if bed else ()), *things]
    return furnished_map({"size_m": [9.2, 5.2], "walls": [*OUTER, *between, *walls], "things": standing})


def test_rooms_are_named_by_what_stands_there_and_know_their_doors_and_objects():
    simap = flat(things=[["picture", 4.6, 4.0, 4.7, 4.4, 1.9], ["chair", 3.0, 3.0, 3.5, 3.5, 0.9]])
    kitchen, bedroom = sorted(simap.rooms, key=lambda room: room.centre_m[0])
    assert (kitchen.name, kitchen.kind, bedroom.name) == ("kitchen", "kitchen", "bedroom")
    assert "toilet" not in kitchen.words and "kitchenette" in kitchen.words
    assert kitchen.area_m2 == pytest.approx(4.4 * 5.0, abs=0.1) and bedroom.area_m2 == pytest.approx(4.5 * 5.0, abs=0.1)
    labels = {one.id: one.label for one in simap.instances}
    assert sorted(labels[i] for i in kitchen.objects) == ["chair", "refrigerator", "stove"]
    assert sorted(labels[i] for i in bedroom.objects) == ["bed", "nightstand", "picture"]
    (door,) = kitchen.doors
    assert door.room == bedroom.id and bedroom.doors[0].room == kitchen.id
    assert door.point_m == pytest.approx((4.55, 2.45), abs=0.15) and door.width_m == pytest.approx(0.9, abs=0.15)
    x, y = np.array(kitchen.polygon_m).T
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((0.1, 4.55, 0.1, 5.1), abs=0.1)
    assert np.dot(x, np.roll(y, -1)) > np.dot(y, np.roll(x, -1))  # counter-clockwise
    assert simap.room_at(*kitchen.centre_m) is kitchen and kitchen.centre_m == pytest.approx((2.3, 2.6), abs=0.6)


def test_what_no_cell_shows_is_in_the_room_that_it_stands_in():
    simap = load_map(ROOT / "recordings/cafe-evidence.npz")
    boxed = [one for one in simap.hidden if one.box is not None]  # not those few that are slivers
    assert len(boxed) > 10
    for one in boxed:
        assert one.box is not None and not (simap.instance == one.id).any()
        assert simap.room_of(one.id) is simap.room_at(*one.box.center_m[:2]), one.name


def test_rooms_are_asked_for_by_place_name_kind_and_synonym():
    simap = flat()
    (kitchen,), (bedroom,) = simap.rooms_named("kitchen"), simap.rooms_named("the bedrooms")
    assert simap.rooms_named("Guest Room") == (bedroom,) and simap.rooms_named(f"room {kitchen.id}") == (kitchen,)
    assert simap.rooms_named("rooms") == simap.rooms and simap.rooms_named("attic") == simap.rooms_named("") == ()
    stove, bed = simap.of_class("stove")[0], simap.of_class("bed")[0]
    assert simap.room_of(stove.id) is kitchen and simap.room_of(bed.id) is bedroom and simap.room_of(10**6) is None
    assert simap.room_at(4.5, 0.5) in simap.rooms  # in the wall between the two
    assert simap.room_at(30.0, -7.0) is None and simap.room_at(-0.3, 1.0) is kitchen
    assert not simap.room_cells[:, :2].any()  # walls are in no room


def test_rooms_of_one_kind_are_numbered_and_unsure_ones_have_a_number_alone():
    same = flat(bed=False, things=[["oven", 8.0, 0.2, 8.6, 0.8, 0.9], ["dishwasher", 7.2, 0.2, 7.8, 0.8, 0.9]])
    assert {room.name for room in same.rooms} == {"kitchen 1", "kitchen 2"}
    assert same.rooms_named("kitchen") == same.rooms and len(same.rooms_named("kitchen 2")) == 1
    bare = flat(bed=False, things=[["chair", 8.0, 0.2, 8.5, 0.7, 0.9]])
    unsure = bare.room_at(8.0, 4.0)
    assert unsure is not None and {room.name for room in bare.rooms} == {"kitchen", f"room {unsure.id}"}
    assert likely_kind({"toilet": 1, "sink": 1}) == "bathroom" and likely_kind({"chair": 3}) == likely_kind({}) == ""
    assert likely_kind({"bed": 1, "nightstand": 1, "stove": 1, "refrigerator": 1}) == ""


def test_in_a_wide_opening_things_decide():
    assert len(flat(opening=(1.0, 4.2)).rooms) == 2
    assert len(flat(opening=(1.0, 4.2), bed=False).rooms) == 1


def test_tall_furniture_bounds_no_room_and_the_leaf_of_a_door_does():
    shelves = [["wardrobe", 6.5, 0.1, 6.8, 2.2, 2.0], ["shelf", 6.5, 2.9, 6.8, 5.1, 2.0]]
    assert len(flat(things=shelves).rooms) == 2
    closed = flat(opening=(1.4, 3.4), things=[["door", 4.5, 1.4, 4.6, 3.4, 2.0]])
    assert len(closed.rooms) == 2 and closed.rooms[0].doors[0].width_m == pytest.approx(2.0, abs=0.3)
    assert closed.room_of(closed.of_class("door")[0].id) is not None


def test_unseen_floor_under_furniture_is_in_a_room_and_the_rest_of_the_world_is_not():
    simap = flat()
    height = simap.grid.height_m.copy()
    height[40:50, 20:34] = np.nan
    height[:, 140:] = np.nan
    shadowed = replace(simap, grid=replace(simap.grid, height_m=height))
    cells = floor_plan(shadowed).cells
    assert (cells[40:50, 20:34] > 0).all() and not cells[:, 140:].any()


def test_a_map_file_keeps_its_rooms_and_one_without_still_opens(tmp_path):
    simap, path = flat(), tmp_path / "flat.npz"
    save_map(replace(with_rooms(simap), room_names={1: "Ada's den"}), path)
    back = load_map(path)
    assert np.array_equal(back.room_cells, simap.room_cells) and back.rooms[0].name == "Ada's den"
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(tmp_path / "old.npz", "w") as old:
        for name in archive.namelist():
            if not name.startswith("room"):
                old.writestr(name, archive.read(name))
    old = load_map(tmp_path / "old.npz")
    assert [room.name for room in old.rooms] == [room.name for room in simap.rooms]


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("rooms", np.full((104, 184), -1, np.int32)), ("rooms", np.ones((104, 183), np.int32)),
        ("rooms", np.ones((104, 184), np.int64)), ("room_names", np.array(json.dumps(["den"]))),
        ("room_names", np.array(json.dumps({"1": "a\nb"}))), ("room_names", np.array(json.dumps({"one": "den"}))),
        ("room_names", np.array("{")),
    ],
)  # fmt: skip
def test_rooms_that_no_map_can_have_are_refused(tmp_path, name, array):
    save_map(with_rooms(flat()), tmp_path / "flat.npz")
    with zipfile.ZipFile(tmp_path / "flat.npz") as archive, zipfile.ZipFile(tmp_path / "bad.npz", "w") as bad:
        for member in archive.namelist():
            data = archive.read(member)
            if member == f"{name}.npy":
                np.save(buffer := io.BytesIO(), array)
                data = buffer.getvalue()
            bad.writestr(member, data)
    with pytest.raises(InputError, match=r"bad\.npz"):
        load_map(tmp_path / "bad.npz")


def test_partitions_of_one_grid_share_its_rooms_and_a_map_without_floor_has_none():
    simap = toy_map()
    assert [round(room.area_m2) for room in simap.rooms] == [14, 13]
    assert repartition(simap, k_percent=25.0).room_cells is simap.room_cells
    nothing = np.full(simap.spec.shape, np.nan, np.float32)
    empty = replace(simap, grid=replace(simap.grid, height_m=nothing, lowest_m=nothing))
    assert empty.rooms == () and not empty.room_cells.any() and empty.room_at(1.0, 1.0) is None


def test_a_very_large_grid_is_split_in_coarser_cells(monkeypatch):
    fine = flat()
    monkeypatch.setattr("simaps_viz.mapping.floor_plan._MAX_CELLS", 104 * 184 // 3)
    coarse = find_rooms(fine.grid)
    assert coarse.shape == fine.spec.shape and coarse.max() == 2
    assert (coarse[fine.room_cells > 0] == fine.room_cells[fine.room_cells > 0]).mean() > 0.95
    assert with_rooms(fine).room is None
