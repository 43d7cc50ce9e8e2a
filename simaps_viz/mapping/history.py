"""The history of a map: the map as it was after each frame of its build, made again from the steps the build kept."""

import struct
import threading
from array import array
from bisect import bisect_right
from collections import OrderedDict
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_HISTORY_BYTES, check_cells
from simaps_viz.mapping.accumulator import MapAccumulator
from simaps_viz.mapping.config import BuildConfig, config_from_json
from simaps_viz.mapping.finalize import SequenceFacts, empty_accumulator, facts_from_json, map_so_far
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.observations import AllReadings, Readings, StreamedReadings, gather_readings
from simaps_viz.mapping.partition import empty_log, empty_views
from simaps_viz.mapping.simap import assemble, origin_of
from simaps_viz.mapping.steps import FrameList, FrameSeen, FrameStep, LazySequence, StepReader, decode_step
from simaps_viz.mapping.votes import spread_labels, vote_labels
from simaps_viz.structures import Grid, SIMap

HELD_BYTES = 128 << 20
"""Memory for steps; those of ordinary builds all fit into it, others are read from the file when they are needed."""
KEPT_BYTES = 64 << 20
"""Memory for states of the grid to replay from; the readings of all frames come on top."""
MAPS_KEPT = 4
"""Number of complete maps that are kept once made."""
_ALWAYS_CELLS = 1 << 24
"""A grid of so many cells is always accepted: 205 m x 205 m with cells of 0.05 m."""
_CELLS_A_READING = 1000
"""A larger grid is accepted up to so many cells for each reading; a damaged file may claim any size."""


class KeptSteps(LazySequence[FrameStep]):
    """The steps of one build, one for each frame, in order. Several threads may share them."""

    def __init__(self, path: Path) -> None:
        """Read and check all steps of a history's file.

        Raises:
            InputError: it is missing or something else.
            ValueError, KeyError, TypeError, struct.error: it does not hold the steps of one build of at least one
                frame, in order, or its map would be too large.
        """
        self._reader = StepReader(path)
        self.facts: dict[str, Any] = self._reader.facts
        """What was built."""
        self.names: list[str] = []
        """Names of the frames."""
        self.readings = array("q")
        """Number of readings of each frame that vote."""
        self._poses, self._held = array("d"), list[FrameStep]()
        self._check_steps()

    def __len__(self) -> int:
        return len(self.names)

    def at(self, at: int) -> FrameStep:
        """Return the step of a frame."""
        return self._held[at] if at < len(self._held) else decode_step(self._reader.read(at))

    @property
    def poses(self) -> NDArray:
        """float64 [n, 4, 4], T_map_camera; a copy."""
        return np.array(self._poses, dtype=np.float64).reshape(-1, 4, 4)

    @property
    def all_held(self) -> bool:
        """Whether all steps are in memory."""
        return len(self._held) == len(self)

    def _check_steps(self) -> None:
        """Check every step: this bounds the memory that a damaged or hostile file can take."""
        size, cells_seen, held = 0, 0, True
        extent = np.array([[1 << 62, -(1 << 62)]] * 2, dtype=np.int64)  # lowest and highest row, and column
        for number in range(len(self._reader)):
            step = decode_step(self._reader.read(number))
            seen = step.seen
            if seen.index != number:
                raise ValueError("frames are missing")
            size += _bytes_of(step)
            if size > MAX_HISTORY_BYTES:
                raise ValueError(f"more than {MAX_HISTORY_BYTES} bytes of readings")
            held = held and size <= HELD_BYTES
            if held:
                self._held.append(step)
            for low_high, cells in zip(extent, (seen.readings.rows, seen.readings.cols), strict=True):
                if len(cells):
                    low_high[:] = min(low_high[0], cells.min()), max(low_high[1], cells.max())
            self.names.append(seen.name)
            self._poses.extend(seen.T_map_camera.reshape(-1).tolist())
            cells_seen += len(seen.readings.rows)
            self.readings.append(len(seen.witness.readings.rows))
        if not self.names:
            raise ValueError("frames are missing")
        self._check_extent(extent, cells_seen)

    def _check_extent(self, extent: NDArray, readings: int) -> None:
        rows, cols = (extent[:, 1] - extent[:, 0] + 1).tolist() if readings else (1, 1)
        check_cells("history", rows, cols)
        if rows * cols > max(_ALWAYS_CELLS, _CELLS_A_READING * readings):
            raise ValueError("a map larger than its readings make")


class KeptFrames(FrameList):
    """The first frames of a history, which holds what they saw itself."""

    def __init__(self, steps: KeptSteps) -> None:
        """Start empty."""
        super().__init__()
        self._steps = steps

    def at(self, at: int) -> FrameSeen:
        """Return a frame, by its position in the list."""
        return self._steps.at(at).seen.witness

    @property
    def all_held(self) -> bool:
        """Whether all frames are in memory."""
        return self._steps.all_held

    def _empty(self) -> "KeptFrames":
        return KeptFrames(self._steps)

    def _hold(self, frame: FrameSeen) -> None:
        """Do nothing: the history holds what a frame saw."""


def _bytes_of(step: FrameStep) -> int:
    readings, runs = step.seen.readings, step.seen.runs
    parts = (readings.rows, readings.cols, readings.segments, readings.height_m)
    return sum(part.nbytes for part in (*parts, runs.reading, runs.segments, runs.low, runs.high))


class MapHistory:
    """The map after each frame of a finished build. Several threads may share it."""

    def __init__(self, facts: SequenceFacts, config: BuildConfig, steps: KeptSteps) -> None:
        """Prepare the history of a build from its steps; `open` reads them from a file."""
        self.facts, self.config = facts, config
        self._steps, self._lock = steps, threading.Lock()
        self._states: list[tuple[int, MapAccumulator]] = [(0, self._empty())]
        self._maps: OrderedDict[int, SIMap] = OrderedDict()
        self._keep_states()
        self._all: Readings | None = None

    @classmethod
    def open(cls, path: Path) -> "MapHistory":
        """Open the history of a map.

        Args:
            path: the ``.steps`` file.

        Raises:
            InputError: the file is missing, damaged, or something else.
        """
        try:
            steps = KeptSteps(Path(path))
            facts, config = facts_from_json(steps.facts["sequence"]), config_from_json(steps.facts["config"])
            return cls(facts, config, steps)
        except (InputError, KeyError, TypeError, ValueError, IndexError, OverflowError, struct.error) as error:
            raise InputError(f"{path}: expected the steps of a build, found other contents ({error!r})") from error

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._steps)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of the frames, in order."""
        return tuple(self._steps.names)

    def is_of(self, simap: SIMap) -> bool:
        """Return whether this is the history of a map: same frames and poses, method, cell size and segmentation."""
        here = (self.config.method, self.config.projection.cell_size_m, self.facts.segmentation_source)
        there = (simap.method, simap.spec.cell_size_m, simap.provenance.get("segmentation"))
        same = here == there and self.frame_names == simap.frame_names
        return same and np.array_equal(self._steps.poses, simap.T_map_camera)

    def map_at(self, frame: int) -> SIMap:
        """Return the map as it was after a frame, exactly as a build of the frames up to it makes it.

        Takes as long as finding instances does, about 0.1 s for a flat. The last few maps are kept.

        Raises:
            InputError: there is no such frame.
        """
        self._check(frame)
        with self._lock:
            if frame not in self._maps:
                self._maps[frame] = map_so_far(self._state_after(frame), self.facts, self.config)
                while len(self._maps) > MAPS_KEPT:
                    self._maps.popitem(last=False)
            self._maps.move_to_end(frame)
            return self._maps[frame]

    def look_at(self, frame: int) -> SIMap:
        """Return what the map looked like after a frame, fast enough for a slider.

        Heights and classes are those of that time; cells that already had their final class have the instances of the
        finished map, so that colours do not jump. It has no graphs, merge log or views; `map_at` has.

        Raises:
            InputError: there is no such frame.
        """
        self._check(frame)
        finished = self._finished
        with self._lock:
            state = self._state_after(frame)
            grid = _on(finished.grid, state)
            if method_of(self.config.method).votes:
                label, _ = vote_labels(grid, self._readings_until(frame, state, finished.grid), self.config.votes)
                unsegmented = state.unsegmented_cells()
                if unsegmented is not None:
                    label = spread_labels(label, grid.height_m, _laid_on(finished.grid, state, unsegmented, False))
                grid = replace(grid, label=label)
        # instances of the finished map where the cell already has its final class
        thing = np.array(grid.is_thing)[grid.label] & (grid.label == finished.grid.label)
        instance = np.where(thing, finished.instance, 0).astype(np.int32)
        origin = replace(
            origin_of(finished),
            frame_names=finished.frame_names[: frame + 1],
            T_map_camera=finished.T_map_camera[: frame + 1],
            provenance={**finished.provenance, "frames": frame + 1},
            surface=None,  # it is that of all frames
            hidden=(),
        )
        return assemble(grid, (), instance, empty_log(), empty_views(), origin)

    def _check(self, frame: int) -> None:
        if not 0 <= frame < len(self._steps):
            raise InputError(f"history: expected a frame from 0 to {len(self._steps) - 1}, found {frame}")

    def _empty(self) -> MapAccumulator:
        empty = empty_accumulator(self.facts, self.config)
        empty.frames = KeptFrames(self._steps)
        return empty

    @cached_property
    def _finished(self) -> SIMap:
        return self.map_at(len(self._steps) - 1)

    def _keep_states(self) -> None:
        """Replay all frames and keep states at even distances, twice as far apart whenever memory runs out."""
        state, apart = self._empty(), 1
        for done, step in enumerate(self._steps, 1):
            state.replay(step)
            if done % apart == 0:
                self._states.append((done, state.copy()))
                if sum(kept.nbytes for _, kept in self._states) > KEPT_BYTES:
                    apart *= 2
                    self._states = [kept for kept in self._states if kept[0] % apart == 0]

    def _state_after(self, frame: int) -> MapAccumulator:
        """Return the accumulator after a frame: a copy, as the kept ones must not change."""
        at = bisect_right([done for done, _ in self._states], frame + 1) - 1
        done, kept = self._states[at]
        state = kept.copy()
        for step in self._steps[done : frame + 1]:
            state.replay(step)
        return state

    def _readings_until(self, frame: int, state: MapAccumulator, grid: Grid) -> AllReadings:
        """Return the readings of the frames up to one, whose state is given, on the finished grid."""
        if not self._steps.all_held:
            return StreamedReadings(state.frames, grid.spec.origin_cell, grid.labels, grid.spec.cols)
        if self._all is None:
            seen = [step.seen.witness for step in self._steps]
            parts = [one.readings for one in seen], [one.segments for one in seen]
            self._all = gather_readings(*parts, grid.spec.origin_cell, grid.labels, grid.spec.cols)
        return _first(self._all, sum(self._steps.readings[: frame + 1]))


def _first(readings: Readings, count: int) -> Readings:
    return Readings(
        readings.cell[:count], readings.frame[:count], readings.segment[:count], readings.label[:count],
        readings.score[:count], readings.height_m[:count],
    )  # fmt: skip


def _on(finished: Grid, state: MapAccumulator) -> Grid:
    """Return a state of the grid at the size of the finished one."""
    part = state.snapshot()
    layers = {
        name: _laid_on(finished, state, getattr(part, name), empty)
        for name, empty in (("label", 0), ("height_m", np.nan), ("lowest_m", np.nan), ("observations", 0))
    }
    return Grid(spec=finished.spec, labels=finished.labels, is_thing=finished.is_thing, **layers)


def _laid_on(finished: Grid, state: MapAccumulator, layer: NDArray, empty: float) -> NDArray:
    """Return a layer of a state of the grid at the size of the finished one."""
    whole, spec = np.full(finished.spec.shape, empty, dtype=layer.dtype), finished.spec
    row0, col0 = state.origin_cell
    row = col = 0
    if len(state.frames) and not state.is_empty:
        row, col = row0 - spec.origin_cell[0], col0 - spec.origin_cell[1]
    shape = (min(layer.shape[0], spec.rows), min(layer.shape[1], spec.cols))
    whole[row : row + shape[0], col : col + shape[1]] = layer[: shape[0], : shape[1]]
    return whole


def cut_as(look: SIMap, simap: SIMap) -> SIMap:
    """Return what the map looked like (`MapHistory.look_at`) with the instances of another map of the same build.

    That is the finished map for another threshold, edited or not. The result shares its communities, so that objects
    have the same colours, and its instances keep the facts of the finished map.
    """
    known = (look.instance > 0) & (simap.instance > 0)
    label = np.where(known, simap.grid.label, look.grid.label)
    instance = np.where(known, simap.instance, 0).astype(np.int32)
    there = set(np.unique(instance).tolist())
    return replace(
        simap,
        grid=replace(look.grid, label=label, labels=simap.grid.labels, is_thing=simap.grid.is_thing),
        instance=instance,
        instances=tuple(one for one in simap.instances if one.id in there),
        frame_names=look.frame_names,
        T_map_camera=look.T_map_camera,
        surface=None,
        hidden=(),
    )
