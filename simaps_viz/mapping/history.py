"""The history of a map: what it was after each frame of its build, from the log the build has kept."""

import struct
import threading
from bisect import bisect_right
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.errors import InputError
from simaps_viz.mapping.accumulator import MapAccumulator
from simaps_viz.mapping.config import BuildConfig, config_from_json
from simaps_viz.mapping.kept_steps import KeptFrames, KeptSteps
from simaps_viz.mapping.partition import empty_log
from simaps_viz.mapping.readings import AllReadings, Readings, StreamedReadings, gather_readings
from simaps_viz.mapping.simap import assemble, origin_of
from simaps_viz.mapping.so_far import SequenceFacts, empty_accumulator_of, facts_from_json, map_so_far
from simaps_viz.mapping.votes import vote_labels
from simaps_viz.structures import Grid, SIMap, Views

KEPT_BYTES = 64 << 20
"""Memory for the states of the grid that are kept to start from; the readings of all frames come on top."""
MAPS_KEPT = 4
"""Whole maps that are kept once made."""


class MapHistory:
    """A finished build that can be looked at after each of its frames. Several threads may ask at once."""

    def __init__(
        self, facts: SequenceFacts, config: BuildConfig, steps: KeptSteps, finished: SIMap | None = None
    ) -> None:
        """Take the steps of a build; `open` finds them in a file."""
        self.facts, self.config = facts, config
        self._steps, self._lock = steps, threading.Lock()
        self._states: list[tuple[int, MapAccumulator]] = [(0, self._empty())]
        self._maps: OrderedDict[int, SIMap] = OrderedDict()
        self._finished = finished
        self._keep_states()
        self._all: Readings | None = None

    @classmethod
    def open(cls, path: Path, *, finished: SIMap | None = None) -> "MapHistory":
        """Open the history kept beside a map.

        Args:
            path: the ``.steps`` file.
            finished: the map of all frames, if it is at hand; otherwise it is made when it is needed.

        Raises:
            InputError: the file is missing, damaged, or something else.
        """
        try:
            steps = KeptSteps(Path(path))
            facts, config = facts_from_json(steps.known["sequence"]), config_from_json(steps.known["config"])
            return cls(facts, config, steps, finished)
        except (InputError, KeyError, TypeError, ValueError, IndexError, OverflowError, struct.error) as error:
            raise InputError(f"{path}: expected the steps of a build, found other contents ({error!r})") from error

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._steps)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """In order."""
        return tuple(self._steps.names)

    def is_of(self, simap: SIMap) -> bool:
        """Tell whether this is the history of a map: the same frames of the same sequence, seen the same way."""
        here = (self.config.method, self.config.projection.cell_size_m, self.facts.segmentation_source)
        there = (simap.method, simap.spec.cell_size_m, simap.provenance.get("segmentation"))
        same = here == there and self.frame_names == simap.frame_names
        return same and np.array_equal(self._steps.poses, simap.T_map_camera)

    def map_at(self, frame: int) -> SIMap:
        """Make the map as it was after a frame, exactly as a build of the frames up to it makes it.

        Costs what finding instances costs: some 0.1 s for a flat. The last few are kept.

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
        """Make what the map looked like after a frame, fast enough to scrub through.

        Heights and classes are what they were then; things have the instances of the finished map where they were of
        its class already, so that colours do not jump. It has no graph, merge log or views: ask `map_at` why.

        Raises:
            InputError: there is no such frame.
        """
        self._check(frame)
        finished = self._finished_map()
        with self._lock:
            state = self._state_after(frame)
            grid = _on(finished.grid, state)
            if self.config.method != "paper":
                label, _ = vote_labels(grid, self._readings_until(frame, state, finished.grid), self.config.votes)
                grid = replace(grid, label=label)
        thing = np.array(grid.is_thing)[grid.label] & (grid.label == finished.grid.label)
        instance = np.where(thing, finished.instance, 0).astype(np.int32)
        nothing = np.zeros(0, np.int32)
        origin = replace(
            origin_of(finished),
            frame_names=finished.frame_names[: frame + 1],
            T_map_camera=finished.T_map_camera[: frame + 1],
            provenance={**finished.provenance, "frames": frame + 1},
        )
        views = Views(nothing, nothing, nothing, nothing, np.zeros(0, np.float32))
        return assemble(grid, (), instance, empty_log(), views, origin)

    def _check(self, frame: int) -> None:
        if not 0 <= frame < len(self._steps):
            raise InputError(f"history: expected a frame from 0 to {len(self._steps) - 1}, found {frame}")

    def _empty(self) -> MapAccumulator:
        empty = empty_accumulator_of(self.facts.labels, self.facts.is_thing, self.config, links=False)
        empty.frames = KeptFrames(self._steps)
        return empty

    def _finished_map(self) -> SIMap:
        if self._finished is None:
            self._finished = self.map_at(len(self._steps) - 1)
        return self._finished

    def _keep_states(self) -> None:
        """Go through all frames and keep states at even distances, twice as far apart whenever memory runs out."""
        state, apart = self._empty(), 1
        for done, step in enumerate(self._steps, 1):
            state.replay(step)
            if done % apart == 0:
                self._states.append((done, state.copy()))
                if sum(kept.nbytes for _, kept in self._states) > KEPT_BYTES:
                    apart *= 2
                    self._states = [kept for kept in self._states if kept[0] % apart == 0]

    def _state_after(self, frame: int) -> MapAccumulator:
        """Give the accumulator after a frame; never one of those that are kept, which must not change."""
        at = bisect_right([done for done, _ in self._states], frame + 1) - 1
        done, kept = self._states[at]
        state = kept.copy()
        for step in self._steps[done : frame + 1]:
            state.replay(step)
        return state

    def _readings_until(self, frame: int, state: MapAccumulator, grid: Grid) -> AllReadings:
        """Give the readings of the frames up to one, whose state it is, on the finished grid."""
        if not self._steps.all_held:
            return StreamedReadings(state.frames, self._origin(grid), grid)
        if self._all is None:
            seen = [step.seen for step in self._steps]
            parts = [one.readings for one in seen], [one.segments for one in seen]
            self._all = gather_readings(*parts, self._origin(grid), grid)
        return _first(self._all, sum(self._steps.readings[: frame + 1]))

    def _origin(self, grid: Grid) -> tuple[int, int]:
        """Give (row, col), counted from the map's origin, of the finished grid's cell (0, 0)."""
        spec = grid.spec
        return round(spec.y0_m / spec.cell_size_m), round(spec.x0_m / spec.cell_size_m)


def _first(readings: Readings, count: int) -> Readings:
    return Readings(
        readings.cell[:count], readings.frame[:count], readings.segment[:count], readings.label[:count],
        readings.score[:count], readings.height_m[:count],
    )  # fmt: skip


def _on(whole: Grid, state: MapAccumulator) -> Grid:
    """Give a state of the grid at the size of the whole one."""
    part, spec = state.snapshot(), whole.spec
    row = round((part.spec.y0_m - spec.y0_m) / spec.cell_size_m)
    col = round((part.spec.x0_m - spec.x0_m) / spec.cell_size_m)
    if not len(state.frames) or state.is_empty:
        row = col = 0
    shape = (min(part.spec.rows, spec.rows), min(part.spec.cols, spec.cols))
    layers: dict[str, Any] = {}
    for name, empty in (("label", 0), ("height_m", np.nan), ("lowest_m", np.nan), ("observations", 0)):
        layer = getattr(part, name)
        layers[name] = np.full(spec.shape, empty, dtype=layer.dtype)
        layers[name][row : row + shape[0], col : col + shape[1]] = layer[: shape[0], : shape[1]]
    return Grid(spec=spec, labels=whole.labels, is_thing=whole.is_thing, **layers)


def cut_as(look: SIMap, simap: SIMap) -> SIMap:
    """Give a look back (`MapHistory.look_at`) the instances of another cut of the finished map, mended or not.

    It shares the cut's communities, so that its objects have the same colours; instances keep the facts they end with.
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
    )
