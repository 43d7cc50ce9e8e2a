"""Frames added up: sparse tiles of the endless grid, the links between cells, and what each frame saw.

A frame is projected (`projection.project_pixels`), reduced to what it saw of every cell (`projection.see_cells`), and
put on the map (`tiles.raise_tiles`); see `MapAccumulator.add_frame`. Frames can also be replayed from a log, or
gathered apart and merged: all of it is maxima, minima, sums and lists by frame, so the result is the same bit for bit.
Memory follows what was seen, not how often or how far apart.
"""

from collections.abc import Sequence
from copy import copy, deepcopy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_LINKED_CELL, MAX_SEGMENT_ID, check_camera, check_cells
from simaps_viz.mapping.links import LinkTable
from simaps_viz.mapping.observations import (
    AllReadings,
    FrameReadings,
    FrameRuns,
    StreamedReadings,
    gather_readings,
    no_readings,
)
from simaps_viz.mapping.projection import first_step, project_pixels, runs_of_columns, see_cells
from simaps_viz.mapping.steps import FrameList, FrameSeen, FrameStep, step_upon
from simaps_viz.mapping.tiles import SIDE, TileStore, raise_tiles
from simaps_viz.structures import Frame, Grid, GridSpec, Intrinsics, Segment, Segmentation

_MAX_RAY = 4.0  # a pixel's ray is taken to be at most so many times as long as its depth: 150 degrees of view

UNSEGMENTED_ABOVE_M = 0.03
"""What is this much higher than all that segmented frames saw may be another surface."""

Extent = tuple[int, int, int, int]
"""A rectangle of cells, counted from the map's origin: first row, first column, last row + 1, last column + 1."""


@dataclass(frozen=True)
class ProjectionSettings:
    """Which pixels count, and how fine the grid is."""

    cell_size_m: float = 0.05
    """Side of a cell."""
    near_m: float = 0.1
    """Depth at or below this is not believed."""
    far_m: float = 6.0
    """Depth at or above this is not believed."""
    cut_height_m: float = 2.0
    """Pixels at or above this height over the floor (lamps, the ceiling) are left out."""
    below_floor_m: float = 0.3
    """Pixels more than this below the floor are left out."""
    obstacle_height_m: float = 0.1
    """What lies lower than this does not stop a robot."""


class MapAccumulator:
    """Takes frames one by one, in order; `snapshot` returns the map they make."""

    def __init__(
        self,
        labels: tuple[str, ...],
        is_thing: tuple[bool, ...],
        settings: ProjectionSettings,
        *,
        reach_cells: int = 2,
        links: bool = True,
        steps: bool = False,
    ) -> None:
        """Make an empty map.

        Args:
            labels: class names, index 0 is "none".
            is_thing: aligned with ``labels``; only things get links.
            settings: which pixels count.
            reach_cells: link cells at most this far apart; -1 = any distance.
            links: count links; only method paper needs them.
            steps: keep in `step` what each frame added.
        """
        self.labels, self.is_thing, self.settings, self.reach_cells = labels, is_thing, settings, reach_cells
        self._links_wanted, self._steps_wanted = links, steps
        self.links = LinkTable() if links else LinkTable(room=2, frame_room=2)
        self.frames = FrameList()
        """Ascending by index."""
        self.step: FrameStep | None = None
        """What the last frame has added, where steps are wanted."""
        self.tiles = TileStore()
        """What frames saw that were segmented."""
        self._unsegmented = TileStore()
        """What the others saw."""
        self._index_of = {name: i for i, name in enumerate(labels)}
        self._seen: Extent | None = None
        self._window: _Window | None = None

    @property
    def readings(self) -> Sequence[FrameReadings]:
        """What each frame saw, frame by frame; all of it in memory."""
        return [frame.readings for frame in self.frames]

    def readings_on(self, grid: Grid) -> AllReadings:
        """Return the readings of all frames on the map as it is now; those on disk are read as they are used."""
        if not self.frames.all_held:
            return StreamedReadings(self.frames, self.origin_cell, grid.labels, grid.spec.cols)
        frames = list(self.frames)
        readings, segments = [f.readings for f in frames], [f.segments for f in frames]
        return gather_readings(readings, segments, self.origin_cell, grid.labels, grid.spec.cols)

    def add_frame(self, frame: Frame, segmentation: Segmentation, T_map_camera: NDArray) -> NDArray:
        """Put a frame on the grid and count its links; frames come in the order of their indices.

        A frame that was not segmented adds free space, obstacles and heights, and votes for nothing.

        Returns:
            int32 [n, 2]: (row, col), counted from the map's origin, of the cells it saw.
        """
        # 1. Every pixel finds its cell in a window around the camera.
        s, k = self.settings, frame.intrinsics
        window = self._window_around(T_map_camera[:2, 3], k)
        cells = np.full(frame.depth_m.shape, -1, dtype=np.int32)
        heights = np.zeros(frame.depth_m.shape, dtype=np.float32)
        project_pixels(
            frame.depth_m, k.fx, k.fy, k.cx, k.cy, np.ascontiguousarray(T_map_camera, dtype=np.float64),
            s.near_m, s.far_m, -s.below_floor_m, s.cut_height_m, s.cell_size_m,
            window.row0, window.col0, window.side, window.side, cells, heights,
        )  # fmt: skip
        # 2. Of every cell, the highest pixel and the lowest obstacle go on the map; at which heights each segment has
        # surface is kept.
        label_of_id, graph_label_of_id = self._tables(segmentation.segments)
        tiles = self.tiles if segmentation.segmented else self._unsegmented
        readings, lowered, runs = self._raise(tiles, window, cells, heights, segmentation.ids, label_of_id)
        # 3. Neighbouring pixels of one segment link their cells.
        if self._links_wanted:
            self.links.add_frame(
                cells, segmentation.ids, graph_label_of_id,
                row0=window.row0, col0=window.col0, cols=window.side, reach=self.reach_cells,
            )  # fmt: skip
        # 4. What the frame saw is kept for votes, evidence and views, and what it changed for the log.
        seen = FrameSeen(
            frame.index, frame.name, T_map_camera, readings, segmentation.segments, runs=runs,
            segmented=segmentation.segmented,
        )  # fmt: skip
        if self._steps_wanted:
            links = self.links.last_frame() if self._links_wanted else None
            self.step = FrameStep(seen, lowered, window.lowest[: len(lowered)][lowered], links)
        self.frames.append(seen.witness)
        return np.stack([readings.rows, readings.cols], axis=1)

    def skip_frame(self, index: int, name: str, T_map_camera: NDArray, reason: str) -> None:
        """Add a frame that could not be read; it keeps its index and pose (float64 [4, 4]) but saw nothing."""
        seen = FrameSeen(index, name, T_map_camera, no_readings(), (), reason)
        self.step = FrameStep(seen, np.zeros(0, bool), np.zeros(0, np.float32))
        self.frames.append(seen)

    def learn(self, label: str, *, is_thing: bool) -> None:
        """Add a class that was not known when the map was begun; does nothing where it is."""
        if label not in self._index_of:
            self._index_of[label] = len(self.labels)
            self.labels, self.is_thing = (*self.labels, label), (*self.is_thing, is_thing)

    def clear(self) -> None:
        """Forget all frames; classes and buffers stay."""
        self.frames, self.tiles, self._unsegmented, self._seen = FrameList(), TileStore(), TileStore(), None

    def replay(self, step: FrameStep, *, geometry_only: bool = False) -> None:
        """Add what a frame added to another accumulator or a log, without its pixels; frames come in order.

        Args:
            step: what it added.
            geometry_only: the frame has no masks: it raises and lowers cells, but names none and is no frame of the
                map.

        Raises:
            InputError: the map would become larger than a map may be.
            ValueError: the step names a segment or a class that is not there.
        """
        seen, readings = step.seen, step.seen.readings
        label_of_id = self._tables(seen.segments)[0]
        if len(readings.rows):
            if not 0 <= int(readings.segments.min()) <= int(readings.segments.max()) < len(label_of_id):
                raise ValueError("a reading of an unknown segment")
            if int(seen.runs.segments.max(initial=0)) >= len(label_of_id):
                raise ValueError("a run of an unknown segment")
            rows, cols = readings.rows, readings.cols
            self._extend((int(rows.min()), int(cols.min()), int(rows.max()) + 1, int(cols.max()) + 1))
        tiles = self._unsegmented if geometry_only or not seen.segmented else self.tiles
        at = tiles.locate(readings.rows, readings.cols)
        tiles.observations[at] += 1
        higher = readings.height_m > tiles.top[at]
        tiles.top[at[higher]] = readings.height_m[higher]
        lowered = at[step.lowered]
        if self._steps_wanted:
            self.step = step_upon(step, tiles.lowest[lowered])
        tiles.lowest[lowered] = np.minimum(tiles.lowest[lowered], step.lowest_m)
        if geometry_only:
            return
        tiles.label[at[higher]] = label_of_id[readings.segments[higher]]
        if step.links is not None and self._links_wanted:
            self.links.add(step.links)
        self.frames.append(seen.witness)

    def empty(self, rows: NDArray, cols: NDArray) -> NDArray:
        """Forget what was seen in some cells, int32 [n] each, but for readings; return where they lie in the tiles."""
        if len(self._unsegmented):
            self._unsegmented.empty(self._unsegmented.locate(rows, cols))
        at = self.tiles.locate(rows, cols)
        self.tiles.empty(at)
        return at

    def merge(self, other: "MapAccumulator") -> None:
        """Add what was gathered of other frames of the same sequence, with the same settings, in any order.

        Raises:
            InputError: settings or classes differ, or a frame is in both, or the map would become too large.
        """
        self._check_alike(other)
        if other._seen is not None:
            self._extend(other._seen)
            one = np.ones((1, 1), bool)
            slots = [int(self.tiles.slots(place, one)[0, 0]) for place in other.tiles.slot_of]  # ours of their tiles
            firsts = self._first_at_ties(other, slots)
            for theirs, mine in enumerate(slots):
                _merge_tile(self.tiles, mine, other.tiles, theirs, firsts)
            for theirs, place in enumerate(other._unsegmented.slot_of):
                mine = int(self._unsegmented.slots(place, one)[0, 0])
                _merge_tile(self._unsegmented, mine, other._unsegmented, theirs, None)
        self.links.merge(other.links)
        self.frames.merge(other.frames)

    def _check_alike(self, other: "MapAccumulator") -> None:
        for what in ("labels", "is_thing", "settings", "reach_cells", "_links_wanted"):
            if getattr(self, what) != getattr(other, what):
                raise InputError(f"merge: expected parts of one build, found them to differ in {what.strip('_')}")
        both = set(self.frames.indices) & set(other.frames.indices)
        if both:
            raise InputError(f"merge: expected different frames in each part, found frame {min(both)} in both")

    def _first_at_ties(self, other: "MapAccumulator", slots: list[int]) -> tuple[NDArray, NDArray] | None:
        """Find, for each cell whose top is as high in both parts, the first frame of each part that saw it so high.

        Returns:
            Ours and theirs, int64 like the flat layers of the other's tiles; None when there is no such cell.
        """
        tied = np.full(len(other.tiles) * SIDE * SIDE, np.nan, dtype=np.float32)
        for theirs, mine in enumerate(slots):
            top = other.tiles.tile("top", theirs)
            same = (self.tiles.tile("top", mine) == top) & ~np.isinf(top)
            tied[theirs * SIDE * SIDE : (theirs + 1) * SIDE * SIDE].reshape(SIDE, SIDE)[same] = top[same]
        if np.isnan(tied).all():
            return None
        return _first_at(self.frames, other.tiles, tied), _first_at(other.frames, other.tiles, tied)

    def snapshot(self) -> Grid:
        """Copy the map as it is now, cut to what has been seen."""
        row0, col0, row1, col1 = self._seen or (0, 0, 1, 1)
        shape, size = (row1 - row0, col1 - col0), self.settings.cell_size_m
        top, lowest, observations = self._layers(self.tiles, row0, col0, shape)
        label = self.tiles.cut("label", row0, col0, shape, 0)
        if len(self._unsegmented):
            their_top, their_lowest, their_observations = self._layers(self._unsegmented, row0, col0, shape)
            lowest, unsegmented = np.fmin(lowest, their_lowest), self._higher(top, their_top)
            top, label = np.where(unsegmented, their_top, top), np.where(unsegmented, np.int16(0), label)
            observations = observations + their_observations
        return Grid(
            spec=GridSpec(*shape, cell_size_m=size, x0_m=round(col0 * size, 9), y0_m=round(row0 * size, 9)),
            labels=self.labels,
            is_thing=self.is_thing,
            label=label,
            height_m=top,
            lowest_m=lowest,
            observations=observations,
        )

    def unsegmented_cells(self) -> NDArray | None:
        """Return the cells of `snapshot` whose top only unsegmented frames saw, bool [rows, cols]; None: none."""
        if not len(self._unsegmented):
            return None
        row0, col0, row1, col1 = self._seen or (0, 0, 1, 1)
        both = self.tiles, self._unsegmented
        return self._higher(*(self._layers(one, row0, col0, (row1 - row0, col1 - col0))[0] for one in both))

    @staticmethod
    def _higher(top: NDArray, their_top: NDArray) -> NDArray:
        """Return where only frames that were not segmented saw the surface on top."""
        return ~np.isnan(their_top) & ~(their_top <= top + UNSEGMENTED_ABOVE_M)

    @staticmethod
    def _layers(tiles: TileStore, row0: int, col0: int, shape: tuple[int, int]) -> tuple[NDArray, NDArray, NDArray]:
        """Return top, lowest (NaN = never seen) and observations of a rectangle of cells."""
        top, lowest = (tiles.cut(name, row0, col0, shape, np.nan) for name in ("top", "lowest"))
        for layer in (top, lowest):
            layer[np.isinf(layer)] = np.nan
        return top, lowest, tiles.cut("observations", row0, col0, shape, 0)

    def copy(self) -> "MapAccumulator":
        """Return a deep copy; it shares what the frames saw, which never changes."""
        twin = copy(self)
        twin.tiles, twin._unsegmented, twin._window = self.tiles.copy(), self._unsegmented.copy(), None
        twin.frames, twin.links = self.frames.copy(), deepcopy(self.links)
        return twin

    @property
    def nbytes(self) -> int:
        """Bytes of memory that a copy costs, about; it shares what the frames saw (`frames.held_bytes`)."""
        return self.tiles.nbytes + self._unsegmented.nbytes + self.links.nbytes + self.frames.nbytes

    @property
    def is_empty(self) -> bool:
        """No cell has been seen."""
        return self._seen is None

    @property
    def origin_cell(self) -> tuple[int, int]:
        """(row, col), counted from the map's origin, of cell (0, 0) of `snapshot`'s grid."""
        return (self._seen[0], self._seen[1]) if self._seen else (0, 0)

    def _tables(self, segments: tuple[Segment, ...]) -> tuple[NDArray, NDArray]:
        """Return int16 tables from segment id to class index: of all segments, and of things only (0 elsewhere)."""
        highest = max((s.id for s in segments), default=0)
        if highest > MAX_SEGMENT_ID or min((s.id for s in segments), default=1) < 1:
            raise ValueError(f"segment ids from 1 to {MAX_SEGMENT_ID} expected")
        label_of_id = np.zeros(highest + 1, dtype=np.int16)
        graph_label_of_id = np.zeros(highest + 1, dtype=np.int16)
        for segment in segments:
            index = self._index_of[segment.label]
            label_of_id[segment.id] = index
            if self.is_thing[index]:
                graph_label_of_id[segment.id] = index
        return label_of_id, graph_label_of_id

    def _raise(
        self,
        tiles: TileStore,
        window: "_Window",
        cells: NDArray,
        heights: NDArray,
        ids: NDArray,
        label_of_id: NDArray,
    ) -> tuple[FrameReadings, NDArray, FrameRuns]:
        """Put pixels on tiles; return their readings, which cells were lowered, bool [n], and the runs of heights."""
        first, across = (window.row0 // SIDE, window.col0 // SIDE), window.side // SIDE
        window.wanted.fill(False)
        lowest_step, columns = first_step(self.settings.below_floor_m), window.columns(cells.size)
        n, *extent = see_cells(
            cells, heights, ids, window.side, self.settings.obstacle_height_m, lowest_step,
            tiles.known(first, across), tiles.lowest, window.wanted, window.place,
            window.seen, window.rows, window.cols, window.top, window.lowest, window.segment, window.head, *columns,
        )  # fmt: skip
        rows, cols, top_m, segments = (of[:n].copy() for of in (window.rows, window.cols, window.top, window.segment))
        lowered = np.zeros(n, dtype=np.bool_)
        if n:
            low_row, low_col, high_row, high_col = extent
            row0, col0 = window.row0, window.col0
            self._extend((low_row + row0, low_col + col0, high_row + row0, high_col + col0))
            raise_tiles(
                rows, cols, tiles.slots(first, window.wanted), top_m, window.lowest, segments, label_of_id,
                tiles.label, tiles.top, tiles.lowest, tiles.observations, lowered,
            )  # fmt: skip
        rows += np.int32(window.row0)
        cols += np.int32(window.col0)
        runs = FrameRuns(*runs_of_columns(lowest_step, window.head[:n], *columns))
        return FrameReadings(rows, cols, segments, top_m), lowered, runs

    def _extend(self, extent: Extent) -> None:
        """Extend the map to these cells; raises InputError, and changes nothing, if it would be too large."""
        seen = self._seen or extent
        low, high = np.minimum(seen[:2], extent[:2]).tolist(), np.maximum(seen[2:], extent[2:]).tolist()
        check_cells("map", high[0] - low[0], high[1] - low[1])
        self._seen = (*low, *high)

    def _window_around(self, camera_xy_m: NDArray, k: Intrinsics) -> "_Window":
        """Return a window that holds everything a camera at that position can see."""
        size, far = self.settings.cell_size_m, self.settings.far_m * _ray_length(k)
        check_camera(camera_xy_m, far, size)
        side = (int(2.0 * far / size) // SIDE + 3) * SIDE
        if self._window is None or self._window.side != side:
            check_cells("what a camera can reach", side, side)
            self._window = _Window(side)
        col, row = np.floor((camera_xy_m - far) / size).astype(int).tolist()
        self._window.row0, self._window.col0 = row // SIDE * SIDE, col // SIDE * SIDE
        if self._links_wanted and max(abs(row), abs(col)) + side > MAX_LINKED_CELL:
            most, found = f"{MAX_LINKED_CELL * size:g} m", camera_xy_m.tolist()
            raise InputError(f"map: expected cells within {most} of its origin to be linked, found {found}")
        return self._window


class _Window:
    """Buffers for what one frame saw around its camera; the window's corners are corners of tiles."""

    def __init__(self, side: int) -> None:
        self.side, self.row0, self.col0 = side, 0, 0
        self.wanted = np.zeros((side // SIDE, side // SIDE), np.bool_)
        self.place = np.full(side * side, -1, np.int32)
        self.seen, self.rows, self.cols, self.segment, self.head = (np.zeros(side * side, np.int32) for _ in range(5))
        self.top, self.lowest = np.zeros(side * side, np.float32), np.zeros(side * side, np.float32)
        self._columns = np.zeros(0, np.int32), np.zeros(0, np.uint64), np.zeros(0, np.int32)

    def columns(self, pixels: int) -> tuple[NDArray, NDArray, NDArray]:
        """Return buffers for `see_cells`: segment, steps and following, with room for so many columns."""
        if len(self._columns[0]) < pixels:
            self._columns = np.zeros(pixels, np.int32), np.zeros(pixels, np.uint64), np.zeros(pixels, np.int32)
        return self._columns


def _merge_tile(
    ours: TileStore, mine: int, others: TileStore, theirs: int, firsts: tuple[NDArray, NDArray] | None
) -> None:
    """Put another part's tile on ours; ``firsts``: the frames that saw cells first which are as high in both."""
    top, other_top = ours.tile("top", mine), others.tile("top", theirs)
    taken = other_top > top
    if firsts is not None:
        of_tile = slice(theirs * SIDE * SIDE, (theirs + 1) * SIDE * SIDE)
        first, other_first = (first[of_tile].reshape(SIDE, SIDE) for first in firsts)
        taken |= other_first < first
    top[taken] = other_top[taken]
    ours.tile("label", mine)[taken] = others.tile("label", theirs)[taken]
    lowest = ours.tile("lowest", mine)
    np.minimum(lowest, others.tile("lowest", theirs), out=lowest)
    ours.tile("observations", mine)[:] += others.tile("observations", theirs)


def _ray_length(k: Intrinsics) -> float:
    """Return how many times longer than its depth the ray to a pixel can be."""
    a = max(k.cx, k.width - 1 - k.cx) / k.fx
    b = max(k.cy, k.height - 1 - k.cy) / k.fy
    length = float(np.sqrt(1.0 + a * a + b * b))
    return length if length < _MAX_RAY else _MAX_RAY


def _first_at(frames: FrameList, tiles: TileStore, top: NDArray) -> NDArray:
    """Return the first frame that saw each cell of some tiles as high as ``top`` (NaN = do not ask), int64 like it."""
    first = np.full(len(top), np.iinfo(np.int64).max)
    for frame in frames:
        at = tiles.find(frame.readings.rows, frame.readings.cols)
        height = frame.readings.height_m[at >= 0]
        at = at[at >= 0]
        hit = at[height == top[at]]
        first[hit] = np.minimum(first[hit], frame.index)
    return first
