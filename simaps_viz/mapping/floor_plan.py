"""The rooms of a map: what bounds them, what stands in them, and what they are called.

Only what belongs to the building bounds rooms: walls, columns, windows, doors, whatever was never seen, and tall things
without a class. Furniture is known by its class and bounds none. Where an opening is too wide to tell, what stands on
both sides decides: a stove here and a bed there are two rooms.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.array_cache import ArrayCache
from simaps_viz.colors.classes import STRUCTURE, cells_of_classes
from simaps_viz.mapping.rooms import Basins, find_basins, join_basins, without_clutter
from simaps_viz.structures import Door, Grid, GridSpec, Point, Room, SIMap

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
