"""Cells that are seen through lose their votes, so that what was moved disappears from a map that grows.

A cell is seen through when a camera sees what lies behind its top, over all of the cell. Where `FRAMES` frames in a row
did, with none between that saw the top, and over a patch of three by three cells, earlier frames are forgotten there:
single cells are seen through wherever depth is noisy, or a pose is off by a cell.

A frame that sees through much of what stands before it contradicts the map: more likely than a room that is emptied
between two frames is a pose that is wrong for a moment.
"""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.geometry import invert_pose
from simaps_viz.io.limits import check_camera
from simaps_viz.mapping.accumulator import MapAccumulator
from simaps_viz.mapping.observations import FrameReadings, FrameRuns
from simaps_viz.mapping.projection import STEPS_PER_M
from simaps_viz.mapping.steps import FrameList, FrameSeen
from simaps_viz.mapping.tiles import AREA, SIDE
from simaps_viz.structures import Frame

FRAMES = 8
"""Frames in a row that have to see through a cell."""
REACH_M = 4.0
"""Farther away depth is not asked."""
SLACK_M, SLACK_SHARE = 0.1, 0.03
"""What is seen lies behind a cell when it is farther by more than the first, and than this share of its depth."""
EVERY = 10
"""Frames between two times of forgetting."""
BELOW_M = 0.15
"""The cell has to be clear so far below its top, too: the top is that of the frame with the worst pose."""
SAMPLES = 6
"""A cell's picture is looked at in so many rows and columns at most, if it is larger than that."""
UNKNOWN, THERE, CLEAR = 0, 1, 2
CONTRADICTS, TIMES = 0.4, 4.0
"""Of the cells whose top would be seen, a frame sees through more than this share, and more than so many times what
three of four of the last frames see through: with noisy depth or drifting poses that is a lot."""
MIN_CELLS = 50
"""With fewer cells in view nothing is contradicted."""

Cells = tuple[NDArray, NDArray]
"""Rows and columns counted from the map's origin, int32 [n] each."""
_ROWS = np.int64(1) << 32


@dataclass(frozen=True, eq=False)
class Sight:
    """What one frame sees of the obstacles around its camera."""

    low: tuple[int, int]
    """Row and column of the first tile."""
    slots: NDArray
    """int32 [tile rows, tile columns], -1 = no tile."""
    found: NDArray
    """uint8 [tiles, AREA]: ``UNKNOWN``, ``THERE`` or ``CLEAR``."""
    there: int
    """Cells whose top is seen,"""
    clear: int
    """and those that are seen through."""


class Forgetting:
    """How often the cells of a growing map were seen through, and since when they are believed."""

    def __init__(self) -> None:
        """Begin with nothing forgotten."""
        self._count = np.zeros(0, np.uint8)
        self._due = False
        self._looked = 0
        self._since: dict[int, int] = {}
        self._shares: deque[float] = deque(maxlen=120)

    def __bool__(self) -> bool:
        """Whether something was forgotten."""
        return bool(self._since)

    def copy(self) -> "Forgetting":
        """Return what was forgotten so far, for another thread."""
        twin = Forgetting()
        twin._since = dict(self._since)
        return twin

    def see(self, simap: MapAccumulator, frame: Frame, T_map_camera: NDArray) -> Sight:
        """Look through the cells of a map, which does not know the frame.

        Args:
            simap: the map.
            frame: what the camera sees now.
            T_map_camera: float64 [4, 4].

        Raises:
            InputError: the camera is farther away than a map may reach.
        """
        tiles, settings = simap.tiles, simap.settings
        check_camera(T_map_camera[:2, 3], REACH_M, settings.cell_size_m)
        side_m = SIDE * settings.cell_size_m
        low = np.floor((T_map_camera[1::-1, 3] - REACH_M) / side_m).astype(int).tolist()
        slots = tiles.known((low[0], low[1]), int(2 * REACH_M / side_m) + 2)
        found, k = np.zeros((slots.size, AREA), np.uint8), frame.intrinsics
        there, clear = see_through(
            frame.depth_m, k.fx, k.fy, k.cx, k.cy, invert_pose(T_map_camera), settings.near_m, settings.far_m,
            settings.cell_size_m, settings.obstacle_height_m, low[0] * SIDE, low[1] * SIDE, slots, tiles.top, found,
        )  # fmt: skip
        return Sight((low[0], low[1]), slots, found, there, clear)

    def contradicts(self, sight: Sight) -> bool:
        """Return whether a frame and the map cannot both be right; to be asked once a frame."""
        asked = sight.there + sight.clear
        if asked < MIN_CELLS:
            return False
        self._shares.append(sight.clear / asked)
        return self._shares[-1] > max(CONTRADICTS, TIMES * float(np.percentile(self._shares, 75)))

    def take(self, simap: MapAccumulator, sight: Sight, index: int) -> int:
        """Count what a frame has seen through, and forget some of it now and then; return how many cells.

        Args:
            simap: the map, as it was when the frame looked.
            sight: from ``see``.
            index: frames of the map before this one are forgotten.
        """
        tiles = simap.tiles
        if len(self._count) < len(tiles) * AREA:
            self._count = np.concatenate([self._count, np.zeros(len(tiles) * AREA - len(self._count), np.uint8)])
        self._due |= count_clear(sight.slots, sight.found, self._count)
        self._looked += 1
        if not self._due or self._looked % EVERY:
            return 0
        self._due = False
        return self._forget(simap, sight.low, sight.slots, index)

    def _forget(self, simap: MapAccumulator, low: tuple[int, int], slots: NDArray, index: int) -> int:
        """Forget what was seen through around the camera."""
        tiles, across = simap.tiles, len(slots)
        count, top = np.zeros((2, across * SIDE, across * SIDE), np.float32)
        for r, c in np.argwhere(slots >= 0).tolist():
            here = np.s_[r * SIDE : (r + 1) * SIDE, c * SIDE : (c + 1) * SIDE]
            slot = int(slots[r, c])
            top[here] = tiles.tile("top", slot)
            count[here] = self._count[slot * AREA : (slot + 1) * AREA].reshape(SIDE, SIDE)
        # Patches of three by three, and what borders on them and was not seen since. Cells that were forgotten
        # before count as seen through, so that the rest of an object follows.
        patch = cv2.morphologyEx((count >= FRAMES).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        near = cv2.dilate(patch, np.ones((5, 5), np.uint8)) > 0
        rows, cols = np.nonzero(near & (count > 0) & (top >= simap.settings.obstacle_height_m))
        rows, cols = (rows + low[0] * SIDE).astype(np.int32), (cols + low[1] * SIDE).astype(np.int32)
        at = simap.empty(rows, cols)
        self._count[at] = 255
        self._since |= dict.fromkeys(_code(rows, cols).tolist(), index)
        return len(at)

    def forget_with(self, simap: MapAccumulator, cells: Cells, others: Cells) -> None:
        """Forget some cells since when others are forgotten; their heights are what frames have seen there since."""
        codes, tiles = _code(*cells), simap.tiles
        since = max(self._since.get(code, 0) for code in _code(*others).tolist())
        self._since |= {code: max(self._since.get(code, 0), since) for code in codes.tolist()}
        at, order = simap.empty(*cells), np.argsort(codes)
        for frame in simap.frames:
            readings, runs = frame.readings, frame.runs
            place = np.minimum(
                np.searchsorted(codes[order], found := _code(readings.rows, readings.cols)), len(codes) - 1
            )
            here = (codes[order][place] == found) & (frame.index >= since)
            to = at[order[place]]
            np.maximum.at(tiles.top, to[here], readings.height_m[here])
            np.add.at(tiles.observations, to[here], 1)
            low_m = runs.low / np.float32(STEPS_PER_M)
            solid = here[runs.reading] & (low_m >= simap.settings.obstacle_height_m)
            np.minimum.at(tiles.lowest, to[runs.reading[solid]], low_m[solid])

    def split(self, frames: FrameList) -> tuple[FrameList, FrameList]:
        """Return what frames saw that is believed, and what is forgotten: each with all frames."""
        kept, gone = FrameList(), FrameList()
        codes = np.array([*sorted(self._since), np.iinfo(np.int64).max], np.int64)
        since = np.array([self._since.get(code, 0) for code in codes.tolist()], np.int64)
        for frame in frames:
            found = _code(frame.readings.rows, frame.readings.cols)
            place = np.searchsorted(codes, found)
            old = (codes[place] == found) & (frame.index < since[place])
            kept.append(_part(frame, ~old) if old.any() else frame)
            gone.append(_part(frame, old))
        return kept, gone


def _code(rows: NDArray, cols: NDArray) -> NDArray:
    return rows.astype(np.int64) * _ROWS + cols


def _part(frame: FrameSeen, kept: NDArray) -> FrameSeen:
    """Return what a frame saw in some of its cells, bool [readings]."""
    one, runs, place = frame.readings, frame.runs, np.cumsum(kept, dtype=np.int32) - 1
    readings = FrameReadings(one.rows[kept], one.cols[kept], one.segments[kept], one.height_m[kept])
    of = kept[runs.reading]
    fewer = FrameRuns(place[runs.reading[of]].astype(np.int32), runs.segments[of], runs.low[of], runs.high[of])
    return FrameSeen(frame.index, frame.name, frame.T_map_camera, readings, frame.segments, frame.skipped, runs=fewer)


@njit(cache=True, nogil=True)
def see_through(
    depth_m: NDArray,  # float32 [H, W]
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    T_camera_map: NDArray,  # float64 [4, 4]
    near_m: float,
    far_m: float,
    cell_size_m: float,
    obstacle_m: float,
    row0: int,  # of the first tile, counted from the map's origin
    col0: int,
    slots: NDArray,  # int32 [tile rows, tile columns], -1 = no tile
    top: NDArray,  # float32 [tiles * AREA]
    found: NDArray,  # out uint8 [slots, AREA], UNKNOWN, THERE or CLEAR
) -> tuple[int, int]:
    """Look at the top of each obstacle; return how many of them are there, and how many are seen through.

    Unknown are those that are hidden, out of the picture or without depth.
    """
    there, clear = 0, 0
    for i in range(slots.shape[0] * slots.shape[1]):
        slot = np.int64(slots[i // slots.shape[1], i % slots.shape[1]])
        if slot < 0:
            continue
        for j in range(AREA):
            h = np.float64(top[slot * AREA + j])
            if not h >= obstacle_m:
                continue
            x = (col0 + (i % slots.shape[1]) * SIDE + j % SIDE + 0.5) * cell_size_m
            y = (row0 + (i // slots.shape[1]) * SIDE + j // SIDE + 0.5) * cell_size_m
            one = _look_at(depth_m, fx, fy, cx, cy, T_camera_map, near_m, far_m, cell_size_m, x, y, h)
            if one == CLEAR:
                h = max(h - BELOW_M, obstacle_m)
                one = _look_at(depth_m, fx, fy, cx, cy, T_camera_map, near_m, far_m, cell_size_m, x, y, h)
            found[i, j] = one
            there += one == THERE
            clear += one == CLEAR
    return there, clear


@njit(cache=True, nogil=True)
def count_clear(
    slots: NDArray,  # int32 [tile rows, tile columns]
    found: NDArray,  # uint8 [slots, AREA], see `see_through`
    count: NDArray,  # in/out uint8 [tiles * AREA], frames that saw through the cell since its top was seen
) -> bool:
    """Count the frames that see through each cell; return whether one was seen through often enough.

    A cell whose top is seen starts anew; one that is not known keeps its count.
    """
    enough = False
    for i in range(len(found)):
        slot = np.int64(slots[i // slots.shape[1], i % slots.shape[1]])
        for j in range(AREA):
            if found[i, j] == THERE:
                count[slot * AREA + j] = 0
            elif found[i, j] == CLEAR:
                count[slot * AREA + j] = min(count[slot * AREA + j] + 1, 255)
                enough |= count[slot * AREA + j] >= FRAMES
    return enough


@njit(cache=True, nogil=True)
def _look_at(  # noqa: PLR0911 - one answer a line
    depth_m: NDArray,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    T: NDArray,
    near_m: float,
    far_m: float,
    cell_size_m: float,
    x: float,
    y: float,
    h: float,
) -> int:
    """Return whether there is surface at a place of the map (x, y, h), as `THERE`, `CLEAR` or `UNKNOWN`."""
    height, width = depth_m.shape
    z = T[2, 0] * x + T[2, 1] * y + T[2, 2] * h + T[2, 3]
    if not near_m < z < REACH_M:
        return UNKNOWN
    u = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * h + T[0, 3]) / z + cx
    v = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * h + T[1, 3]) / z + cy
    if not (0.0 <= u < width - 0.5 and 0.0 <= v < height - 0.5):
        return UNKNOWN
    slack = max(SLACK_M, SLACK_SHARE * z)
    seen = np.float64(depth_m[int(v + 0.5), int(u + 0.5)])
    if not near_m < seen < far_m or seen < z - slack:
        return UNKNOWN
    if seen <= z + slack:
        return THERE
    # Something behind it: but is that so over all of the cell, and one pixel around?
    half, tilt = 0.5 * cell_size_m / z, abs(T[2, 0]) + abs(T[2, 1])
    du = half * (fx * (abs(T[0, 0]) + abs(T[0, 1])) + abs(u - cx) * tilt) + 1.0
    dv = half * (fy * (abs(T[1, 0]) + abs(T[1, 1])) + abs(v - cy) * tilt) + 1.0
    if u - du < 0.0 or v - dv < 0.0 or u + du + 1.0 >= width or v + dv + 1.0 >= height:
        return UNKNOWN
    u0, u1, v0, v1 = int(u - du), int(u + du + 1.0), int(v - dv), int(v + dv + 1.0)
    across, down = max((u1 - u0) // SAMPLES, 1), max((v1 - v0) // SAMPLES, 1)
    known, asked = 0, 0
    for b in range(v0, v1 + 1, down):
        for a in range(u0, u1 + 1, across):
            seen = np.float64(depth_m[b, a])
            asked += 1
            if near_m < seen < far_m:
                known += 1
                if seen <= z + slack:
                    return UNKNOWN
    return CLEAR if 2 * known >= asked else UNKNOWN
