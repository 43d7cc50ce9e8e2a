"""Free space split into rooms: plans whose rooms are known, and what must hold of every plan."""

import cv2
import numpy as np
import pytest
from scipy import ndimage

from simaps_viz.errors import InputError
from simaps_viz.mapping.floor_plan import segment_rooms, without_clutter

CELL_M = 0.05


def plan(*, door_m: float = 0.9, rows_m: tuple[float, ...] = (4.0, 5.0), cols_m: tuple[float, ...] = (4.0, 6.0)):
    """Draw rooms in rows and columns with walls of 0.1 m, and a door in the middle of every wall between two of them.

    Returns:
        The free cells, bool, and the room of each, int32, 0 = wall or doorway.
    """
    truth = np.zeros([round((sum(sizes) + 0.1 * len(sizes) + 0.1) / CELL_M) for sizes in (rows_m, cols_m)], np.int32)
    spans = [_spans(sizes) for sizes in (rows_m, cols_m)]
    for i, rows in enumerate(spans[0]):
        for j, cols in enumerate(spans[1]):
            truth[rows, cols] = 1 + i * len(cols_m) + j
    free, half = truth > 0, round(door_m / CELL_M / 2)
    for turned, (along, across) in ((free, spans), (free.T, spans[::-1])):
        for rows in along:
            middle = (rows.start + rows.stop) // 2
            for cols in across[1:]:
                turned[middle - half : middle + half, cols.start - 2 : cols.start] = True
    return free, truth


def _spans(sizes_m):
    spans, at = [], 2
    for size in sizes_m:
        spans.append(slice(at, at + round(size / CELL_M)))
        at = spans[-1].stop + 2
    return spans


def same_rooms(found, truth) -> bool:
    """Whether every true room is almost all of one found room, and there are no others."""
    pairs = [(i, *np.unique(found[truth == i], return_counts=True)) for i in range(1, truth.max() + 1)]
    most = [rooms[counts.argmax()] for _, rooms, counts in pairs]
    whole = all(counts.max() > 0.97 * (truth == i).sum() for i, _, counts in pairs)
    return whole and len(set(most)) == len(most) == found.max() and 0 not in most


def scattered(free, seed: int):
    """Put boxes as large as chairs and small tables on the floor, away from the walls and from each other."""
    random, room = np.random.default_rng(seed), ndimage.binary_erosion(free, iterations=6)
    free = free.copy()
    for row, col in random.permutation(np.argwhere(room))[:400]:
        height, width = random.integers(6, 17, 2)
        box = slice(row, row + height), slice(col, col + width)
        if room[box].all():
            free[box] = False
            room[max(row - 5, 0) : row + height + 5, max(col - 5, 0) : col + width + 5] = False
    return free


@pytest.mark.parametrize("cols_m", [(4.0, 6.0), (3.0, 2.4, 5.0, 4.2)])
@pytest.mark.parametrize("door_m", [0.7, 0.9, 1.2])
def test_rooms_with_doors_between_them_are_found_and_furniture_bounds_none(door_m, cols_m):
    free, truth = plan(door_m=door_m, cols_m=cols_m)
    assert same_rooms(segment_rooms(free, CELL_M), truth)
    full = scattered(free, seed=3)
    assert (~full & free).sum() > 1000
    assert same_rooms(np.where(free & ~full, 0, segment_rooms(full, CELL_M)), np.where(full, truth, 0))


def test_a_wide_opening_separates_nothing_and_a_corridor_is_one_room():
    free, _ = plan(door_m=3.0, rows_m=(5.0,), cols_m=(5.0, 6.0))
    assert segment_rooms(free, CELL_M).max() == 1
    free, truth = plan(rows_m=(4.0, 1.6, 4.0), cols_m=(4.0, 5.0, 3.0))
    corridor = (truth > 3) & (truth < 7)
    free[ndimage.binary_closing(corridor, np.ones((1, 5)))] = True  # pyright: ignore
    truth = np.where(corridor, 4, np.where(truth > 6, truth - 2, truth))
    assert same_rooms(segment_rooms(free, CELL_M), truth)


def test_a_wall_that_touches_no_other_bounds_a_room_and_a_table_does_not():
    free = np.ones((84, 164), np.bool_)
    free[:2] = free[-2:] = free[:, :2] = free[:, -2:] = False
    free[18:-18, 90:93] = False  # 0.8 m from the walls beside it
    assert segment_rooms(free, CELL_M)[40, [20, 140]].tolist() == [1, 2]
    table = np.ones((80, 80), np.bool_)
    table[30:48, 30:48] = False
    assert segment_rooms(table, CELL_M).max() == 1


@pytest.mark.parametrize(
    ("free", "rooms"),
    [
        (np.zeros((0, 0), np.bool_), 0), (np.zeros((0, 7), np.bool_), 0), (np.zeros((9, 9), np.bool_), 0),
        (np.ones((1, 1), np.bool_), 1), (np.ones((300, 500), np.bool_), 1), (np.ones((1, 900), np.bool_), 1),
        (np.ones((900, 2), np.bool_), 1), (np.eye(40, dtype=np.bool_), 1), (np.ones((3, 3), np.uint8), 1),
        (np.arange(64).reshape(8, 8) == 27, 1),
    ],
)  # fmt: skip
def test_plans_of_nothing_of_open_space_and_of_strips(free, rooms):
    found = segment_rooms(free, CELL_M)
    assert found.dtype == np.int32 and found.shape == free.shape
    assert found.max(initial=0) == rooms and np.array_equal(found > 0, free > 0)


@pytest.mark.parametrize("seed", range(4))
def test_rooms_cover_free_space_are_connected_and_numbered_by_size(seed):
    drawn = ndimage.gaussian_filter(np.random.default_rng(seed).random((150, 230)), 4) > 0.497
    free = without_clutter(drawn, CELL_M)
    found, among_clutter = segment_rooms(free, CELL_M), segment_rooms(drawn, CELL_M)
    assert np.array_equal(found[drawn], among_clutter[drawn]) and not among_clutter[~drawn].any()
    # only closed spaces that are too small for a room are none
    closed = cv2.connectedComponents(free.astype(np.uint8))[1].astype(np.int64)
    sizes_m2 = np.bincount(closed.ravel()) * CELL_M**2
    assert not found[~free].any() and (sizes_m2[np.unique(closed[free & (found == 0)])] < 1.5).all()
    areas_m2 = np.bincount(found.ravel())[1:] * CELL_M**2
    assert len(areas_m2) > 5 and (np.diff(areas_m2) <= 0).all() and (areas_m2 >= 1.5).all()
    assert all(cv2.connectedComponents((found == i).astype(np.uint8))[0] == 2 for i in range(1, found.max() + 1))


def test_a_turned_mirrored_or_finer_plan_has_the_same_rooms():
    free, truth = plan(rows_m=(3.0, 5.0), cols_m=(4.0, 2.6, 6.0))
    free = scattered(free, seed=1)
    assert same_rooms(segment_rooms(free, CELL_M), np.where(free, truth, 0))
    for move in (np.rot90, lambda a: np.rot90(a, 2), lambda a: a[:, ::-1], lambda a: a.T):
        assert same_rooms(segment_rooms(move(free), CELL_M), move(np.where(free, truth, 0)))
    finer = [np.kron(a, np.ones((2, 2), a.dtype)) for a in (free, np.where(free, truth, 0))]
    assert same_rooms(segment_rooms(finer[0], CELL_M / 2), finer[1])


def test_what_is_no_plan_is_refused():
    for free in (np.ones(5, np.bool_), np.ones((2, 2, 2), np.bool_), np.ones((4, 4))):
        with pytest.raises(InputError, match=r"free: expected bool \[rows, cols\]"):
            segment_rooms(free, CELL_M)
    for size in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="cell_size_m"):
            segment_rooms(np.ones((4, 4), np.bool_), size)
