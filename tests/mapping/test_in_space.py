"""Boxes and relations of voxels made by hand, and of a small map's columns."""

import copy
import gc
import pickle
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_maps import toy_map

import simaps_viz
from simaps_viz import InputError
from simaps_viz.mapping.in_space import (
    VOXEL_M,
    box_of,
    column_points,
    least_sizes,
    majority,
    relations,
    voxel_centres,
    voxel_indices,
    voxel_keys,
    whole_objects,
    without_strays,
)

ORIGIN = (-1.0, 0.35)


def block(x, y, z):
    """Keys of the voxels in ranges of whole voxels."""
    cells = np.stack(np.meshgrid(*(np.arange(*one) for one in (x, y, z)), indexing="ij"), axis=-1).reshape(-1, 3)
    return np.sort(voxel_keys((cells + 0.5) * VOXEL_M + (*ORIGIN, 0.0), ORIGIN))


def joined(*parts):
    return np.unique(np.concatenate(parts))


LEGS = [block((x, x + 1), (y, y + 1), (0, 15)) for x in (0, 23) for y in (0, 15)]
TABLE = joined(block((0, 24), (0, 16), (15, 16)), *LEGS)
CHAIR = joined(block((4, 12), (4, 12), (8, 9)), block((4, 5), (4, 12), (8, 13)))
CUP = block((10, 12), (5, 7), (16, 18))
SHELF = joined(*(block((40, 60), (0, 6), (z, z + 1)) for z in (2, 10, 18)), block((40, 60), (0, 1), (2, 19)))
BOOK = block((45, 49), (1, 5), (11, 15))
LAMP = block((70, 74), (0, 4), (0, 30))
NAMES = {"table": TABLE, "chair": CHAIR, "cup": CUP, "shelf": SHELF, "book": BOOK, "lamp": LAMP}


def test_a_table_with_a_chair_under_it_a_cup_on_it_and_a_book_in_a_shelf():
    found = relations(dict(enumerate(NAMES.values())))
    table, chair, cup, shelf, book, lamp = (found[n] for n in range(6))
    assert cup.on == {0: 1.0} and not cup.under and not cup.inside
    assert chair.under[0] == 1.0 and not chair.on and not chair.inside
    assert book.on == {3: 1.0} and book.under == {3: 1.0} and book.inside == {3: 1.0}
    assert not (table.on or table.under or table.inside or shelf.under or lamp.on or lamp.under)


def test_nothing_stands_on_legs_or_far_above():
    high = {1: TABLE, 2: CUP + 4, 3: block((0, 1), (0, 1), (16, 17))}
    assert not relations(high)[2].on and relations(high)[3].on == {1: 1.0}
    only_legs = {1: joined(*LEGS), 2: block((0, 24), (0, 16), (4, 6))}
    assert not relations(only_legs)[2].on


def test_what_is_hidden_of_a_surface_counts_as_surface():
    """A box on a table hides the middle of its top, which no camera then sees."""
    seen = np.setdiff1d(TABLE, block((4, 20), (4, 12), (15, 16)))
    assert relations({1: seen, 2: block((4, 20), (4, 12), (16, 20))})[2].on == {1: 1.0}


@given(st.floats(-3, 3), st.integers(3, 40), st.integers(3, 40))
def test_a_turned_box_is_found(yaw, length, width):
    along, across = np.meshgrid(np.arange(-length, length + 1, 0.4), np.arange(-width, width + 1, 0.4))
    x, y = along * np.cos(yaw) - across * np.sin(yaw), along * np.sin(yaw) + across * np.cos(yaw)
    points = np.stack([x * VOXEL_M + 2.0, y * VOXEL_M + 3.0, np.full(x.shape, 0.5)], axis=-1).reshape(-1, 3)
    box = box_of(np.unique(voxel_keys(points, ORIGIN)), ORIGIN)
    assert box.center_m[:2] == pytest.approx((2.0, 3.0), abs=VOXEL_M)
    assert box.size_m[:2] == pytest.approx(
        (2 * max(length, width) * VOXEL_M, 2 * min(length, width) * VOXEL_M), abs=0.15
    )
    assert -np.pi / 2 <= box.yaw_rad < np.pi / 2 and box.size_m[2] == pytest.approx(VOXEL_M)
    corners = box.corners_m
    assert np.linalg.norm(corners[1] - corners[0]) == pytest.approx(box.size_m[0])
    assert corners.mean(axis=0) == pytest.approx(box.center_m)


@given(st.lists(st.tuples(st.integers(-9000, 9000), st.integers(-9000, 9000), st.integers(-60, 190)), min_size=1))
def test_keys_name_voxels_in_order(cells):
    cells = np.array(cells)
    keys = voxel_keys((cells + 0.5) * VOXEL_M + (*ORIGIN, 0.0), ORIGIN)
    assert (voxel_indices(keys) == cells).all()
    assert (voxel_keys(voxel_centres(keys, ORIGIN), ORIGIN) == keys).all()
    assert (cells[np.argsort(keys, kind="stable")] == np.array(sorted(cells.tolist()))).all()


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 3), st.integers(1, 9))))
def test_the_heaviest_value_wins_and_of_equals_the_lower(rows):
    weights = {}
    for key, value, weight in rows:
        weights.setdefault(key, {}).setdefault(value, 0)
        weights[key][value] += weight
    expected = [(k, min(v, key=lambda value: (-v[value], value)), sum(v.values())) for k, v in sorted(weights.items())]
    found = majority(*np.array(rows, np.int64).reshape(-1, 3).T)
    assert list(zip(*(part.tolist() for part in found), strict=True)) == expected


def test_strays_are_the_small_patches_apart():
    body = block((0, 10), (0, 10), (3, 4))
    corner = block((9, 10), (9, 11), (4, 5))  # touches the body's corner
    beside, far = block((13, 17), (0, 3), (3, 4)), block((20, 24), (0, 3), (3, 4))  # 12 voxels, 4 and 11 cells away
    over, tenth = block((2, 6), (2, 5), (20, 21)), block((0, 9), (14, 15), (3, 4))  # 9 of 102 are less than a tenth
    half = block((40, 50), (0, 6), (0, 1))
    keys = joined(body, corner, beside, far, over, tenth, half)
    assert (without_strays(keys) == joined(body, corner, beside, over, half)).all()
    assert len(without_strays(keys[:0])) == 0 and (without_strays(keys[:1]) == keys[:1]).all()


def test_few_voxels_beside_a_small_thing_are_strays():
    thing = block((0, 2), (0, 2), (0, 2))
    assert (without_strays(joined(thing, block((3, 4), (0, 1), (0, 1)))) == thing).all()
    half = block((3, 4), (0, 2), (0, 2))
    assert (without_strays(joined(thing, half)) == joined(thing, half)).all()


def test_what_hangs_on_by_a_corner_is_a_stray_and_a_leg_is_none():
    top, leg = block((0, 12), (0, 12), (10, 11)), block((6, 7), (6, 7), (0, 10))
    hanging = [block((x, x + 1), (y, y + 1), (11, 12)) for x, y in ((12, 12), (-1, -1), (12, -1), (-1, 12))]
    assert (without_strays(joined(top, leg, *hanging)) == joined(top, leg)).all()


def test_slivers_are_small_for_their_class():
    sizes = np.array([1000, 29, 1200, 35, 4, 3, 900])
    classes = np.array([2, 2, 2, 2, 5, 5, 2])  # the middle voxel of class 2 lies in the object of 1000
    assert least_sizes(sizes, classes).tolist() == pytest.approx([30.0, 30.0, 30.0, 30.0, 0.12, 0.12, 30.0])
    assert least_sizes(sizes[:0], classes[:0]).shape == (0,)
    table, chair = block((0, 40), (0, 30), (14, 15)), block((10, 20), (10, 20), (9, 10))
    speck, sliver = block((60, 65), (0, 2), (3, 4)), block((60, 65), (0, 7), (3, 4))
    voxels = {1: table, 2: chair, 3: speck, 4: sliver}
    assert list(whole_objects(voxels, {1: "table", 2: "chair", 3: "chair", 4: "table"})) == [1, 2, 3]
    assert whole_objects({}, {}) == {}


def test_what_lies_scattered_is_a_sliver_however_much_there_is():
    table = block((0, 40), (0, 30), (14, 15))
    scattered = joined(*(block((60, 65), (y, y + 1), (3, 4)) for y in range(0, 40, 4)))  # 50 voxels in ten rows
    assert list(whole_objects({1: table, 2: scattered}, {1: "table", 2: "table"})) == [1]


def test_instances_know_their_map():
    simap = toy_map()
    (couch,) = simap.of_class("couch")
    assert couch.box is not None and couch.box.size_m == pytest.approx((1.15, 0.45, 0.70), abs=0.03)
    assert couch.box.center_m == pytest.approx((3.6, 2.45, 0.375), abs=0.03)
    assert couch.on == {} and couch.in_space is simap.in_space[couch.id]
    alone = [pickle.loads(pickle.dumps(couch)), copy.deepcopy(couch)]
    assert alone == [couch, couch] and all(one.box is None for one in alone)
    del simap
    gc.collect()
    with pytest.raises(InputError, match=f"couch {couch.id}: expected its map to be in use"):
        _ = couch.box


def test_threads_wait_for_the_same_map_only(monkeypatch):
    slow, quick = toy_map(), toy_map()
    begun, free, asked = threading.Event(), threading.Event(), []

    def find(simap):
        asked.append(simap)
        if simap is slow:
            begun.set()
            assert free.wait(30.0)
        return {1: len(asked)}

    monkeypatch.setattr(simaps_viz, "objects_in_space", find)
    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(lambda: slow.in_space) for _ in range(2)]
        try:
            assert begun.wait(30.0)
            assert quick.in_space == {1: 2}  # while the other map's is computed
        finally:
            free.set()
        assert waiting[0].result(30.0) is waiting[1].result(30.0)
    assert asked == [slow, quick]


def test_columns_reach_from_the_floor_to_the_top():
    simap = toy_map()
    points = column_points(simap)
    table = simap.of_class("dining table")[0]
    mine = points.positions[points.instances == table.id]
    layers, counts = np.unique(np.floor(mine[:, 2] / VOXEL_M).astype(int), return_counts=True)
    assert layers.tolist() == list(range(16)) and set(counts) == {table.cells}
    assert (simap.spec.x0_m < points.positions[:, 0]).all() and points.positions.dtype == np.float32
    floor = points.classes == simap.grid.labels.index("floor")
    assert (points.positions[floor, 2] < VOXEL_M).all() and not points.instances[floor].any()
    assert len(column_points(simap, things=True).positions) == np.count_nonzero(points.instances)
