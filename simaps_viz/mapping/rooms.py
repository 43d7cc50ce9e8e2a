"""Split free space into rooms, where passages between walls are narrow.

Cells are taken by falling distance d to the nearest obstacle. A cell without a neighbour among those before it starts
a basin; others join the basin next to them. Where two basins meet, at a saddle, they are two rooms if the passage is
narrow: not much wider than a double door, and clearly narrower than the smaller of the two basins (Bormann et al.,
"Room segmentation: survey, implementation, and analysis", ICRA 2016, compare such methods; the local rule is ours).
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.errors import InputError

WIDE_M: Final = 2.4
"""A passage at least this wide separates nothing."""
MAX_RATIO: Final = 0.75
"""A passage wider than this share of the smaller of two basins separates nothing."""
MIN_DEPTH_M: Final = 0.15
"""A basin has to rise this much above a saddle: less is noise of the walls."""
MIN_ROOM_M2: Final = 1.5
"""A smaller room becomes part of the neighbour with the longest common border."""
CLUTTER_M2: Final = 1.0
"""An obstacle that touches no other and covers less than this bounds no room, unless it is a piece of a wall."""
WALL_THICKNESS_M: Final = 0.6
WALL_LENGTH_M: Final = 1.0
"""A free-standing piece of wall is at most so thick and at least so long."""
_BUCKETS = 16
"""Cells are sorted by distance to this part of a cell."""


@dataclass(frozen=True, eq=False)
class Basins:
    """The finest parts of free space, and where they meet."""

    label: NDArray
    """int32 [rows, cols], 1 to the number of basins, 0 = not free."""
    peak_m: NDArray
    """float64 [basins + 1], the largest distance to an obstacle in each; entry 0 is unused."""
    area_m2: NDArray
    """float64 [basins + 1]."""
    meeting: NDArray
    """int64 [meetings, 2], the two basins, the smaller number first; sorted by falling saddle."""
    saddle_m: NDArray
    """float64 [meetings], half the width of the widest passage between the two."""
    saddle_cell: NDArray
    """int64 [meetings, 2], row and column of the middle of that passage."""
    border_cells: NDArray
    """int64 [meetings], length of their common border in cells."""


def segment_rooms(free: NDArray, cell_size_m: float) -> NDArray:
    """Split the free space of a floor plan into rooms.

    Small obstacles that stand free are furniture and bound no room. What lies outside the plan is an obstacle.

    Args:
        free: bool [rows, cols], where nothing stands.
        cell_size_m: side of a cell, metres.

    Returns:
        int32 [rows, cols], the number of the room of each free cell, from 1, the largest first (with its furniture);
        0 = none: not free, or a closed space of less than 1.5 m² on a plan that has larger ones.

    Raises:
        InputError: ``free`` has not two axes, or the cell size is no positive number.
    """
    free = np.asarray(free)
    if free.ndim != 2 or free.dtype.kind not in "bui":
        raise InputError(f"free: expected bool [rows, cols], found {free.dtype} {list(free.shape)}")
    if not (np.isfinite(cell_size_m) and cell_size_m > 0.0):
        raise InputError(f"cell_size_m: expected metres above 0, found {cell_size_m}")
    free = free.astype(np.bool_)
    found = find_basins(without_clutter(free, cell_size_m), cell_size_m)
    return np.where(free, join_basins(found)[found.label], np.int32(0))


def without_clutter(free: NDArray, cell_size_m: float) -> NDArray:
    """Return free space including the small obstacles that stand in it, bool [rows, cols]; pieces of walls stay."""
    blocked = np.pad(~free, 1, constant_values=True).astype(np.uint8)  # what touches the edge is no island
    count, island, stats, _ = cv2.connectedComponentsWithStats(blocked, connectivity=8)
    small = stats[:, cv2.CC_STAT_AREA] * cell_size_m**2 < CLUTTER_M2
    small[[0, int(island[0, 0])]] = False
    # what is long and thin, whichever way it runs, is a piece of a wall
    extent = np.hypot(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * cell_size_m
    for i in np.flatnonzero(small & (extent >= WALL_LENGTH_M)).tolist():
        x, y, width, height = stats[i, :4].tolist()
        piece = np.pad(island[y : y + height, x : x + width] == i, 1).astype(np.uint8)
        thickness = 2.0 * cell_size_m * cv2.distanceTransform(piece, cv2.DIST_L2, cv2.DIST_MASK_PRECISE).max()
        small[i] = thickness > WALL_THICKNESS_M
    return free | small[island[1:-1, 1:-1].astype(np.int64)] if count > 1 else free


def find_basins(
    free: NDArray, cell_size_m: float, closed: NDArray | None = None, *, depth_m: float = MIN_DEPTH_M
) -> Basins:
    """Find the basins of free space.

    Args:
        free: bool [rows, cols].
        cell_size_m: side of a cell, metres.
        closed: bool [rows, cols], cells in which rooms end although one may pass: a lintel, the leaf of a door. They
            count as obstacles, and in the end become part of the basin next to them.
        depth_m: what rises less above a saddle is no basin.
    """
    rows, cols = free.shape
    open_now = np.pad(free if closed is None else free & ~closed, 1).astype(np.uint8)
    distance = cv2.distanceTransform(open_now, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    if closed is not None:
        distance[1:-1, 1:-1][closed] = 0.5 / _BUCKETS
    key = (distance * _BUCKETS).astype(np.int32)
    label, peak, first, second, cell = _sweep(distance.reshape(-1), key.reshape(-1), cols + 2, depth_m / cell_size_m)
    label = np.ascontiguousarray(label.reshape(rows + 2, cols + 2)[1:-1, 1:-1])
    area = np.bincount(label.reshape(-1), minlength=len(peak)) * cell_size_m**2
    # one meeting for each pair of basins; the cells of a border come by falling distance, so the first is its saddle
    code, at, border = np.unique(
        np.minimum(first, second) * np.int64(len(peak)) + np.maximum(first, second),
        return_index=True,
        return_counts=True,
    )
    order = np.argsort(at)
    code, at, border = code[order], at[order], border[order]
    return Basins(
        label=label,
        peak_m=peak.astype(np.float64) * cell_size_m,
        area_m2=area,
        meeting=np.stack(np.divmod(code, len(peak)), axis=1),
        saddle_m=distance.reshape(-1)[cell[at]].astype(np.float64) * cell_size_m,
        saddle_cell=np.stack(np.divmod(cell[at], cols + 2), axis=1) - 1,
        border_cells=border,
    )


def is_passage(saddle_m: float, peak_m: float) -> bool:
    """Whether a saddle separates two rooms; ``peak_m`` is that of the smaller one."""
    return 2.0 * saddle_m < WIDE_M and saddle_m <= MAX_RATIO * peak_m and peak_m - saddle_m >= MIN_DEPTH_M


def join_basins(basins: Basins, separate: Callable[[list[int], list[int]], bool] | None = None) -> NDArray:
    """Join basins to rooms.

    Args:
        basins: from `find_basins`.
        separate: whether two groups of basins that meet in a wide opening are two rooms all the same.

    Returns:
        int32 [basins + 1], the room of each basin, 1 = the largest; 0 = none.
    """
    n = len(basins.peak_m)
    room, group, peak, area = list(range(n)), [[i] for i in range(n)], basins.peak_m.tolist(), basins.area_m2.tolist()

    def join(into: int, other: int) -> None:
        for basin in group[other]:
            room[basin] = into
        group[into] += group[other]
        group[other] = []
        peak[into], area[into] = max(peak[into], peak[other]), area[into] + area[other]

    # the widest saddles first, as water that falls would uncover them
    for (a, b), saddle in zip(basins.meeting.tolist(), basins.saddle_m.tolist(), strict=True):
        low, high = sorted((room[a], room[b]), key=lambda i: (peak[i], -i))
        if low == high or is_passage(saddle, peak[low]):
            continue
        if separate is None or not separate(group[low], group[high]):
            join(high, low)
    _absorb_small(basins, room, area, join)
    # a closed space too small for a room is none, unless there is no other
    large = [i for i in range(1, n) if group[i] and area[i] >= MIN_ROOM_M2]
    kept = large or [i for i in range(1, n) if group[i]]
    number = {one: k for k, one in enumerate(sorted(kept, key=lambda i: (-area[i], i)), start=1)}
    return np.array([0, *(number.get(room[i], 0) for i in range(1, n))], np.int32)


def _absorb_small(basins: Basins, room: list[int], area: list[float], join: Callable[[int, int], None]) -> None:
    """Join every room below `MIN_ROOM_M2`, the smallest first, to the neighbour with the longest common border."""
    beside: dict[int, dict[int, int]] = {i: {} for i in room}
    for (a, b), cells in zip(basins.meeting.tolist(), basins.border_cells.tolist(), strict=True):
        one, other = room[a], room[b]
        if one != other:
            beside[one][other] = beside[other][one] = beside[one].get(other, 0) + cells
    waiting = [(area[i], i) for i in set(room) - {0} if area[i] < MIN_ROOM_M2]
    heapq.heapify(waiting)
    while waiting:
        was, small = heapq.heappop(waiting)
        if small not in beside or was != area[small] or not beside[small]:
            continue
        into = max(beside[small], key=lambda i: (beside[small][i], area[i], -i))
        for other, cells in beside.pop(small).items():
            del beside[other][small]
            if other != into:
                beside[other][into] = beside[into][other] = beside[into].get(other, 0) + cells
        join(into, small)
        if area[into] < MIN_ROOM_M2:
            heapq.heappush(waiting, (area[into], into))


@njit(cache=True, nogil=True)
def _sweep(
    distance: NDArray,  # float32 [cells], cells to the nearest obstacle, 0 = obstacle; a rim of obstacles
    key: NDArray,  # int32 [cells], the distance in buckets
    stride: int,  # cells of a row
    depth: float,  # cells that a basin has to rise above a saddle
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Grow basins by falling distance.

    Returns:
        The basin of each cell int32 [cells], the peak of each basin float32 [basins + 1], and for each cell where two
        basins meet, by falling distance: the two, int32, and the cell, int32.
    """
    order = _by_falling_distance(distance, key)
    around = np.array([-stride, -1, 1, stride, -stride - 1, -stride + 1, stride - 1, stride + 1])
    label = np.zeros(len(key), np.int32)
    room = len(key) // 4 + 2 * stride + 2  # no two basins start next to each other
    parent = np.zeros(room, np.int32)
    peak = np.zeros(room, np.float32)
    met = np.zeros((1024, 3), np.int32)
    basins = meetings = 0
    near = np.zeros(8, np.int32)
    for i in range(len(order)):
        cell = order[i]
        # most cells are beside one basin only
        alone = _only_basin(label, cell, around)
        if alone > 0:
            label[cell] = alone
            continue
        if alone == 0:
            basins += 1
            label[cell] = parent[basins] = basins
            peak[basins] = distance[cell]
            continue
        # others join the basin up the steepest slope, and here it meets the others
        n = _basins_around(label, parent, cell, around, near, distance)
        top = near[0]
        label[cell] = top
        for j in range(1, n):
            basin = near[j]
            low, high = (basin, top) if peak[basin] < peak[top] else (top, basin)
            if peak[low] - distance[cell] < depth:  # too shallow to be a basin of its own
                parent[low] = high
                top = high
                continue
            if meetings == len(met):
                met = np.concatenate((met, np.zeros_like(met)))
            met[meetings] = basin, top, cell
            meetings += 1
    number = _number_of_roots(parent, peak, basins)
    for i in order:
        label[i] = number[label[i]]
    met = met[:meetings]
    first, second = number[met[:, 0]], number[met[:, 1]]
    apart = first != second
    return label, peak[: number.max() + 1], first[apart], second[apart], met[apart, 2]


@njit(cache=True, nogil=True)
def _by_falling_distance(
    distance: NDArray,  # float32 [cells]
    key: NDArray,  # int32 [cells]
) -> NDArray:
    """Return the cells with a distance above 0, by falling key, then by number, int32."""
    highest = 0
    for k in key:
        highest = max(highest, k)
    start = np.zeros(highest + 2, np.int64)
    for i in range(len(key)):
        if distance[i] > 0.0:
            start[highest - key[i] + 1] += 1
    for k in range(highest + 1):
        start[k + 1] += start[k]
    order = np.zeros(start[highest + 1], np.int32)
    for i in range(len(key)):
        if distance[i] > 0.0:
            k = highest - key[i]
            order[start[k]] = i
            start[k] += 1
    return order


@njit(cache=True, nogil=True)
def _only_basin(label: NDArray, cell: int, around: NDArray) -> int:
    """Return the label that all cells around one have that have any; 0 where none has, -1 where there are several."""
    found = 0
    for k in range(8):
        basin = int(label[cell + around[k]])
        if basin > 0:
            if found > 0 and found != basin:
                return -1
            found = basin
    return found


@njit(cache=True, nogil=True)
def _basins_around(
    label: NDArray,  # int32 [cells]
    parent: NDArray,  # int32 [basins + 1], paths to the roots become shorter
    cell: int,
    around: NDArray,  # int64 [8], steps to the cells around one, the four straight ones first
    near: NDArray,  # int32 [8], out: the roots
    distance: NDArray,  # float32 [cells]
) -> int:
    """Find the basins beside a cell, the one up the steepest slope first; return how many there are."""
    n = 0
    steepest = np.float32(-np.inf)
    for k in range(8):
        basin = label[cell + around[k]]
        if basin == 0:
            continue
        while parent[basin] != basin:
            parent[basin] = parent[parent[basin]]
            basin = parent[basin]
        at = n
        for j in range(n):
            if near[j] == basin:
                at = j
        near[at] = basin
        n = max(n, at + 1)
        slope = (distance[cell + around[k]] - distance[cell]) * (1.0 if k < 4 else 0.5**0.5)
        if slope > steepest:
            steepest = slope
            near[0], near[at] = near[at], near[0]
    return n


@njit(cache=True, nogil=True)
def _number_of_roots(
    parent: NDArray,  # int32 [basins + 1]
    peak: NDArray,  # float32 [basins + 1], those of the roots move to their numbers
    basins: int,
) -> NDArray:
    """Number the basins that were not joined to another, without gaps; return the number of each root, int32."""
    number = np.zeros(basins + 1, np.int32)
    left = 0
    for basin in range(1, basins + 1):
        if parent[basin] == basin:
            left += 1
            number[basin] = left
            peak[left] = peak[basin]
    for basin in range(1, basins + 1):
        root = basin
        while parent[root] != root:
            root = parent[root]
        number[basin] = number[root]
    return number
