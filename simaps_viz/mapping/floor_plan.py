"""The rooms of a map: what bounds them, what stands in them, and what they are called.

Only what belongs to the building bounds rooms: walls, columns, windows, doors, whatever was never seen, and tall things
without a class. Furniture is known by its class and bounds none. Where an opening is too wide to tell, what stands on
both sides decides: a stove here and a bed there are two rooms.

Free space is split where passages between walls are narrow. Cells are taken by falling distance d to the nearest
obstacle. A cell without a neighbour among those before it starts a basin; others join the basin next to them. Where two
basins meet, at a saddle, they are two rooms if the passage is narrow: not much wider than a double door, and clearly
narrower than the smaller of the two basins (Bormann et al., "Room segmentation: survey, implementation, and analysis",
ICRA 2016, compare such methods; the local rule is ours).
"""

import heapq
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any, Final

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.colors.array_cache import ArrayCache
from simaps_viz.colors.classes import STRUCTURE, cells_of_classes
from simaps_viz.errors import InputError
from simaps_viz.structures import Door, Grid, GridSpec, Point, Room, SIMap

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


KINDS: Final[Mapping[str, Any]] = json.loads(
    resources.files("simaps_viz.mapping").joinpath("room_kinds.json").read_text(encoding="utf-8")
)
"""{kind: its other words, kinds it may share an open space with, {class: how much a thing of it speaks for it}}."""
TALL_M: Final = 1.5
"""What has no class and is at least this high is a wall; one passes under what hangs at least this high."""
MAX_HOLE_M2: Final = 4.0
"""Cells that were never seen are part of a room if they are fewer, and mostly floor or furniture is around them."""
REACH_M: Final = 0.5
"""What is in no room counts as in the nearest one within this distance."""
MIN_DOOR_M: Final = 0.4
MIN_SCORE: Final = 2.0
"""A kind of room is sure if the things in it speak for it so much, and clearly more than for any other kind."""
CLEARLY: Final = 1.3
SURELY: Final = 2.0
"""Two rooms share a wide opening if the best kind of each has so many times `MIN_SCORE` and the score it has in the
other."""
_MIN_CELLS_M2: Final = 0.02
_MAX_CELLS: Final = 1 << 24  # finer grids are coarsened
_found = ArrayCache()


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """The rooms of a map and the cells of each."""

    cells: NDArray
    """int32 [rows, cols], the id of the room of each cell, 0 = none. Furniture is in rooms, walls are not."""
    rooms: tuple[Room, ...]
    """By id."""


def floor_plan(simap: SIMap) -> FloorPlan:
    """Return the rooms of a map: those it was saved or edited with, else those found now."""
    cells = room_layer(simap)
    inside = cells_by_room(cells)
    objects = objects_by_room(simap, cells)
    kinds = {room: simap.room_names.get(room) or kind_of(simap, objects.get(room, ())) for room in inside}
    names, doors = _names(simap, kinds), _doors(cells, simap.spec)
    return FloorPlan(
        cells,
        tuple(
            Room(
                id=room,
                name=names[room],
                kind=_kind(kinds[room]),
                words=tuple(KINDS[_kind(kinds[room])]["words"]) if _kind(kinds[room]) else (),
                area_m2=round(float(np.count_nonzero(mask)) * simap.spec.cell_size_m**2, 3),
                polygon_m=_outline(simap.spec, mask, corner),
                centre_m=_centre(simap.spec, mask, corner),
                objects=objects.get(room, ()),
                doors=tuple(doors.get(room, ())),
            )
            for room, (corner, mask) in inside.items()
        ),
    )


def room_layer(simap: SIMap) -> NDArray:
    """Return the room of each cell, int32 [rows, cols], 0 = none; found once for all partitions of a grid."""
    if simap.room is not None:
        return simap.room
    grid = simap.grid
    return _found.get((grid.label, grid.height_m), "rooms", lambda: find_rooms(grid))


def with_rooms(simap: SIMap) -> SIMap:
    """Return the map with its rooms found, to be saved; a map of more than 16 million cells finds them when asked."""
    return simap if simap.instance.size > _MAX_CELLS else replace(simap, room=room_layer(simap))


def find_rooms(grid: Grid) -> NDArray:
    """Find the rooms on a grid, int32 [rows, cols], 1 = the largest, 0 = none."""
    free, closed = bounds(grid)
    factor = int(np.ceil(np.sqrt(max(free.size / _MAX_CELLS, 1.0))))
    label, s = grid.label, grid.spec.cell_size_m
    if factor > 1:
        free, closed, label, s = _coarse(free, closed, label, factor), None, label[::factor, ::factor], s * factor
    if closed is not None:
        open_now = without_clutter(free & ~closed, s)
        closed &= ~open_now
        basins = find_basins(open_now | closed, s, closed, depth_m=s)
    else:
        basins = find_basins(without_clutter(free, s), s, depth_m=s)
    kinds = _Evidence(basins, label, grid.labels, s)
    layer = join_basins(basins, kinds.differ)[basins.label]
    if factor > 1:
        rows, cols = grid.spec.shape
        layer = np.repeat(np.repeat(layer, factor, axis=0), factor, axis=1)[:rows, :cols]
    return layer


def bounds(grid: Grid) -> tuple[NDArray, NDArray]:
    """Return where rooms can be, and where they end.

    Returns:
        bool [rows, cols]: cells that no wall covers, furniture included; and those among them that close a passage one
        may take, such as the leaf of a door, a curtain or what is over a doorway.
    """
    seen = ~np.isnan(grid.height_m)
    with np.errstate(invalid="ignore"):
        hangs = grid.lowest_m >= TALL_M
        tall = (grid.height_m >= TALL_M) & (grid.label == 0) & ~hangs
    building = cells_of_classes(grid, *STRUCTURE)
    closed = (building & hangs) | cells_of_classes(grid, "door", "curtain")
    wall = (building & ~closed) | tall
    free = seen & ~wall
    return free | _holes(seen, wall, grid.spec.cell_size_m), closed


def _holes(seen: NDArray, wall: NDArray, cell_size_m: float) -> NDArray:
    """Return the cells never seen that have mostly floor or furniture around them, bool [rows, cols]."""
    count, hole, stats, _ = cv2.connectedComponentsWithStats((~seen).astype(np.uint8), connectivity=4)
    walls, others = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for here, there in (
        (np.s_[:, 1:], np.s_[:, :-1]), (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[1:], np.s_[:-1]), (np.s_[:-1], np.s_[1:]),
    ):  # fmt: skip
        beside = (hole[here] > 0) & seen[there]
        walls += np.bincount(hole[here][beside & wall[there]], minlength=count)
        others += np.bincount(hole[here][beside & ~wall[there]], minlength=count)
    filled = (others > walls) & (stats[:, cv2.CC_STAT_AREA] * cell_size_m**2 < MAX_HOLE_M2)
    filled[0] = False
    edge = np.concatenate([hole[0], hole[-1], hole[:, 0], hole[:, -1]]) if hole.size else np.zeros(0, np.int64)
    filled[np.unique(edge).astype(np.int64)] = False
    return filled[hole.astype(np.int64)]


def _coarse(free: NDArray, closed: NDArray, label: NDArray, factor: int) -> NDArray:
    """Return free space in cells ``factor`` times as large, free where most of their cells are and none is closed."""
    rows, cols = (-(-n // factor) * factor for n in label.shape)
    share = np.zeros((rows // factor, cols // factor), np.int16)
    for i in range(factor):
        for j in range(factor):
            part = (free & ~closed)[i::factor, j::factor]
            share[: part.shape[0], : part.shape[1]] += part
    return share * 2 > factor**2


class _Evidence:
    """What the classes on the cells of basins say about the kinds of rooms they are."""

    def __init__(self, basins: Basins, label: NDArray, labels: tuple[str, ...], cell_size_m: float) -> None:
        n = len(basins.peak_m)
        code = basins.label.reshape(-1).astype(np.int64) * len(labels) + label.reshape(-1)
        self._cells = np.bincount(code, minlength=n * len(labels)).reshape(n, len(labels))
        self._labels, self._least = labels, _MIN_CELLS_M2 / cell_size_m**2

    def differ(self, first: list[int], second: list[int]) -> bool:
        """Return whether two groups of basins are surely rooms of kinds that share no open space."""
        scores = [kind_scores(self._classes(group)) for group in (first, second)]
        one, other = (max(found, key=lambda kind: found[kind]) for found in scores)
        if one == other or other in KINDS[one]["beside"]:
            return False
        sure = min(scores[0][one], scores[1][other]) >= SURELY * MIN_SCORE
        return sure and all(
            SURELY * min(found[kind] for found in scores) < max(found[kind] for found in scores)
            for kind in (one, other)
        )

    def _classes(self, group: list[int]) -> dict[str, int]:
        there = np.flatnonzero(self._cells[group].sum(axis=0) >= self._least)
        return {self._labels[i]: 1 for i in there.tolist()}


def likely_kind(counts: Mapping[str, int]) -> str:
    """Return the kind of a room by how many things of each class stand there; "" where that is not sure."""
    scores = kind_scores(counts)
    best, *others = sorted(scores, key=lambda kind: -scores[kind])
    rivals = [scores[kind] for kind in others if kind not in KINDS[best]["beside"]]
    sure = scores[best] >= MIN_SCORE and scores[best] >= CLEARLY * max(rivals)
    return best if sure else ""


def kind_scores(counts: Mapping[str, int]) -> dict[str, float]:
    """Return how much things, so many of each class, speak for each kind of room."""
    # many of a class say more than one, but each further one says less
    return {
        kind: sum(facts["things"].get(label, 0.0) * np.sqrt(n) for label, n in counts.items())
        for kind, facts in KINDS.items()
    }


def kind_of(simap: SIMap, objects: tuple[int, ...]) -> str:
    """Return the kind of room that objects make, by their ids."""
    counts: dict[str, int] = {}
    there = set(objects)
    for one in simap.instances:
        if one.id in there:
            counts[one.label] = counts.get(one.label, 0) + 1
    return likely_kind(counts)


def objects_by_room(simap: SIMap, cells: NDArray) -> dict[int, tuple[int, ...]]:
    """Return the ids of the objects in each room: where most of their cells are, else the nearest room within 0.5 m."""
    at, ids = _cells_of_objects(simap)
    room_of: dict[int, int] = {}
    pairs, counts = np.unique(ids << 32 | cells.reshape(-1)[at], return_counts=True)
    for pair, _ in sorted(zip(pairs.tolist(), counts.tolist(), strict=True), key=lambda one: one[1]):
        if pair & 0xFFFFFFFF:
            room_of[pair >> 32] = pair & 0xFFFFFFFF  # the last, the most cells, stays
    reach = int(np.ceil(REACH_M / simap.spec.cell_size_m))
    found: dict[int, list[int]] = {}
    for one in (*simap.instances, *simap.hidden):
        room = room_of.get(one.id) or _room_beside(cells, at[ids == one.id], reach)
        if room:
            found.setdefault(room, []).append(one.id)
    return {room: tuple(sorted(ids)) for room, ids in found.items()}


def _cells_of_objects(simap: SIMap) -> tuple[NDArray, NDArray]:
    """Return the flat numbers of cells of objects, and the ids of these, int64 [n]; of hidden ones, too."""
    at = np.flatnonzero(simap.instance)
    ids = simap.instance.reshape(-1)[at].astype(np.int64)
    if simap.surface is None or not simap.hidden:
        return at, ids
    below = np.isin(simap.surface.owner, [one.id for one in simap.hidden])
    return np.append(at, simap.surface.cell[below]), np.append(ids, simap.surface.owner[below])


def _room_beside(cells: NDArray, at: NDArray, reach: int) -> int:
    """Return the room nearest to cells of an object that hangs on a wall or stands in one, 0 = none within reach."""
    if not len(at):
        return 0
    rows, cols = np.unravel_index(at, cells.shape)
    row, col = max(int(rows.min()) - reach, 0), max(int(cols.min()) - reach, 0)
    part = cells[row : int(rows.max()) + reach + 1, col : int(cols.max()) + reach + 1]
    here = np.zeros(part.shape, np.uint8)
    here[rows - row, cols - col] = 1
    for _ in range(reach):
        here = cv2.dilate(here, np.ones((3, 3), np.uint8))
        near = np.bincount(part[here > 0])
        if near[1:].any():
            return 1 + int(near[1:].argmax())
    return 0


def cells_by_room(cells: NDArray) -> dict[int, tuple[tuple[int, int], NDArray]]:
    """Return for each room the row and column where its bounding box starts, and its cells in it, bool."""
    ids = np.unique(cells)
    found = {}
    for room in ids[ids > 0].tolist():
        mask = cells == room
        rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        row, col = int(rows[0]), int(cols[0])
        found[room] = (row, col), mask[row : rows[-1] + 1, col : cols[-1] + 1]
    return found


def _names(simap: SIMap, kinds: Mapping[int, str]) -> dict[int, str]:
    """Return the name of each room: what a person called it, or its kind, with a number where there are several."""
    names = {}
    for room, kind in kinds.items():
        of_kind = [other for other in kinds if kinds[other] == kind]
        if not kind:
            names[room] = f"room {room}"
        elif len(of_kind) == 1 or room in simap.room_names:
            names[room] = kind
        else:
            names[room] = f"{kind} {1 + of_kind.index(room)}"
    return names


def _kind(name: str) -> str:
    """Return the kind of room that a name says, "" for none."""
    return next((kind for kind, facts in KINDS.items() if name.casefold() in (kind, *facts["words"])), "")


def _outline(spec: GridSpec, mask: NDArray, corner: tuple[int, int]) -> tuple[Point, ...]:
    """Return the outline of a room's largest part, counter-clockwise, to about a cell; not closed."""
    fine = np.repeat(np.repeat(mask.astype(np.uint8), 2, axis=0), 2, axis=1)
    rings, _ = cv2.findContours(fine, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    ring = max(rings, key=cv2.contourArea)
    rough = cv2.approxPolyDP(ring, 1.5, closed=True)
    ring = (rough if len(rough) > 2 else ring).reshape(-1, 2)
    area = float(cv2.contourArea(ring, oriented=True))
    points = (ring[:: 1 if area > 0 else -1] + 0.5) / 2 - 0.5
    return tuple(_metres(spec, row + corner[0], col + corner[1]) for col, row in points.tolist())


def _centre(spec: GridSpec, mask: NDArray, corner: tuple[int, int]) -> Point:
    distance = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    row, col = np.unravel_index(int(distance.argmax()), distance.shape)
    return _metres(spec, int(row) - 1 + corner[0], int(col) - 1 + corner[1])


def _metres(spec: GridSpec, row: float, col: float) -> Point:
    x, y = spec.centre_of(row, col)
    return round(x, 3), round(y, 3)


def _doors(cells: NDArray, spec: GridSpec) -> dict[int, list[Door]]:
    """Return the openings between rooms, for each room: where its cells touch those of another one."""
    border: dict[tuple[int, int], list[NDArray]] = {}
    for here, there in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        one, other = cells[here], cells[there]
        row, col = np.nonzero((one != other) & (one > 0) & (other > 0))
        low, high = np.minimum(one, other)[row, col], np.maximum(one, other)[row, col]
        for a, b in sorted(set(zip(low.tolist(), high.tolist(), strict=True))):
            at = (low == a) & (high == b)
            border.setdefault((a, b), []).append(np.stack([row[at], col[at]], axis=1))
    doors: dict[int, list[Door]] = {}
    for (a, b), parts in border.items():
        for opening in _pieces(np.unique(np.concatenate(parts), axis=0)):
            width_m = (float(np.hypot(*np.ptp(opening, axis=0))) + 1.0) * spec.cell_size_m
            if width_m < MIN_DOOR_M:
                continue
            middle = opening[np.linalg.norm(opening - opening.mean(axis=0), axis=1).argmin()]
            point = _metres(spec, *middle.tolist())
            doors.setdefault(a, []).append(Door(b, point, round(width_m, 3)))
            doors.setdefault(b, []).append(Door(a, point, round(width_m, 3)))
    return doors


def _pieces(cells: NDArray) -> list[NDArray]:
    """Split cells, int64 [n, 2], into groups that touch or almost do."""
    corner = cells.min(axis=0) - 1
    mask = np.zeros(cells.max(axis=0) - corner + 2, np.uint8)
    mask[tuple((cells - corner).T)] = 1
    piece = cv2.connectedComponents(cv2.dilate(mask, np.ones((3, 3), np.uint8)))[1]
    of_cell = piece[tuple((cells - corner).T)]
    return [cells[of_cell == i] for i in np.unique(of_cell)]
