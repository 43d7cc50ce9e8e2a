"""A map that grows without knowing how many frames or classes will come, and whose frames can be placed again.

A frame is projected by itself, and what it saw is then replayed onto the map, as a build log is. So the map of a
sequence played to its end is that of its build, bit for bit, as long as no place was seen too often (`PLACES`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.datasets.gravity import estimate_gravity
from simaps_viz.errors import InputError
from simaps_viz.events import BuildFinished, CommunitiesFound, FrameProjected, MergesFound, Observer
from simaps_viz.geometry import invert_pose, map_from_world, transform_points
from simaps_viz.live.source import Correction, Shot, Source
from simaps_viz.mapping import finalize
from simaps_viz.mapping.finalize import SequenceFacts
from simaps_viz.mapping.observations import FrameReadings, FrameRuns
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.projection import STEPS, STEPS_PER_M
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.mapping.steps import FrameSeen, FrameStep
from simaps_viz.structures import Segmentation, SIMap

PLACES = (0.5, np.deg2rad(30.0))
"""Frames are taken from the same place when their cameras share a cube of so many metres, and a sector of headings."""
FRAMES_A_PLACE = 60
"""Frames with masks that are kept of one place: what comes later adds geometry only. So the map of a robot that drives
in circles, or stands, grows with the area and not with time."""
FLOOR_M = 0.05
"""A floor found so close to the world's height 0 is at 0, where robots' maps have it."""
FLOOR_FRAMES = (15, 30, 60)
"""The floor is looked for once so many frames are there; without success the world's own height 0 is taken."""


@dataclass(eq=False)
class _Kept:
    """What placing a frame again needs, besides what the map keeps of it."""

    shot: tuple[int, int]
    """Epoch, and time in ns."""
    T_odom_camera: NDArray | None
    lowest_m: NDArray
    """float16 [readings], lowest obstacle pixel of each cell it saw, +inf = none."""


class GrowingMap:
    """Puts shots on the map, one by one, from one thread."""

    def __init__(self, source: Source, config: BuildConfig) -> None:
        """Begin with nothing; the method must not count links, which could not be placed again."""
        self.source, self.config = source, config
        self.T_map_world = source.T_map_world
        """None until the floor is found."""
        self.notes: list[str] = []
        self._waiting: list[Shot] = []
        self._map = finalize.empty_accumulator(source, config)
        self._one = finalize.empty_accumulator(source, config, steps=True)
        self._kept: list[_Kept] = []
        self._places: dict[tuple[float, ...], int] = {}

    @property
    def frames(self) -> int:
        """Frames of the map: those with masks, as far as they are kept."""
        return len(self._map.frames)

    def add(self, shot: Shot) -> list[FrameProjected]:
        """Put a shot on the map; return the events of the frames that the map has taken, while it is so."""
        if self.T_map_world is not None:
            return self._place(shot)
        self._waiting.append(shot)
        return self._find_floor() if len(self._waiting) in FLOOR_FRAMES else []

    def finish_waiting(self) -> list[FrameProjected]:
        """Place the shots that still wait for a floor, when no more will come."""
        return self._find_floor(last=True) if self._waiting else []

    def _find_floor(self, *, last: bool = False) -> list[FrameProjected]:
        up, height_m = np.array([0.0, 0.0, 1.0]), 0.0
        try:
            _, found_m = estimate_gravity([shot.frame for shot in self._waiting], up=up)
            height_m = found_m if abs(found_m) > FLOOR_M else 0.0
        except InputError as error:
            if not last and len(self._waiting) < FLOOR_FRAMES[-1]:
                return []
            self.notes.append(f"no floor was found, so the world's height 0 is taken for it ({error})")
        self.T_map_world = map_from_world((0.0, 0.0, 1.0), height_m)
        waiting, self._waiting = self._waiting, []
        return [event for shot in waiting for event in self._place(shot)]

    def _place(self, shot: Shot) -> list[FrameProjected]:
        T_map_camera = np.asarray(self.T_map_world @ shot.frame.T_world_camera)
        masks = shot.segmentation
        kept = masks is not None and self._keeps(T_map_camera)
        if masks is None or not kept:
            masks = Segmentation(np.zeros(shot.frame.depth_m.shape, np.int32), ())
        for segment in masks.segments:
            for accumulator in (self._one, self._map):
                accumulator.learn(segment.label, is_thing=segment.is_thing)
        # What the frame saw by itself, and then on top of all others.
        frame = replace(shot.frame, index=self.frames)
        self._one.clear()
        seen = self._one.add_frame(frame, masks, T_map_camera)
        step = self._one.step
        assert step is not None
        self._map.replay(step, geometry_only=not kept)
        if not kept:
            return []
        lowest_m = np.full(len(seen), np.inf, np.float16)
        lowest_m[step.lowered] = step.lowest_m
        self._kept.append(_Kept((shot.epoch, shot.stamp_ns), shot.T_odom_camera, lowest_m))
        nothing = np.zeros((0, 4), np.int32)
        return [
            FrameProjected(
                frame=frame, segmentation=masks, T_map_camera=T_map_camera,
                cells=(seen - np.array(self._map.origin_cell, np.int32)).astype(np.int32),
                new_edges=nothing, new_edge_labels=np.zeros(0, np.int16),
                snapshot=self._map.snapshot, map_so_far=self.map_so_far,
            )
        ]  # fmt: skip

    def _keeps(self, T_map_camera: NDArray) -> bool:
        """Whether the map still takes frames from here."""
        forward = T_map_camera[:3, 2]
        sector = (
            int(np.arctan2(forward[1], forward[0]) // PLACES[1]),
            int(np.arcsin(np.clip(forward[2], -1, 1)) // PLACES[1]),
        )
        place = (*np.floor(T_map_camera[:3, 3] / PLACES[0]).astype(int).tolist(), *sector)
        self._places[place] = count = self._places.get(place, 0) + 1
        return count <= FRAMES_A_PLACE

    def place_again(self, correction: Correction) -> int:
        """Move the frames that a correction concerns; return how many.

        What a frame saw is moved cell by cell, so that pictures need not be kept. What frames without masks saw is
        not kept, and comes again when they do.
        """
        frames, at = self._map.frames, [
            i for i, kept in enumerate(self._kept)
            if kept.shot >= (correction.epoch, correction.since_ns) and kept.T_odom_camera is not None
        ]  # fmt: skip
        if not at or self.T_map_world is None:
            return 0
        T_world_odom = correction.T_world_odom(np.array([self._kept[i].shot[1] for i in at], np.int64))
        moved = {
            i: self.T_map_world @ T @ self._kept[i].T_odom_camera for i, T in zip(at, T_world_odom, strict=True)
        }  # fmt: skip
        size_m, fresh = self.config.projection.cell_size_m, finalize.empty_accumulator(self._map, self.config)
        for i in range(len(frames)):
            seen, kept = frames[i], self._kept[i]
            step = _step_of(seen, kept.lowest_m)
            if i in moved:
                step, kept.lowest_m = moved_step(seen, kept.lowest_m, moved[i], size_m)
            fresh.replay(step)
        self._map = fresh
        return len(at)

    def facts(self) -> SequenceFacts:
        """Return what the map keeps of its source."""
        source, T = self.source, self.T_map_world
        return SequenceFacts(
            name=source.name, path=str(getattr(getattr(source, "sequence", None), "path", source.name)),
            labels=self._map.labels, is_thing=self._map.is_thing,
            segmentation_source=source.segmentation_source, simulated=source.simulated,
            T_map_world=np.eye(4) if T is None else T,
        )  # fmt: skip

    def map_so_far(self) -> SIMap:
        """Return the map of all frames so far."""
        return finalize.map_so_far(self._map, self.facts(), self.config)

    def finished(self, observers: Sequence[Observer]) -> SIMap:
        """Return the finished map, and notify observers of how it comes about."""
        found = finalize.apply_method(finalize.gathered(self._map), self.config)
        threshold = joining_threshold(self.config.method, self.config.parameters())
        applied = applied_steps(found.log, threshold)
        simap = finalize.map_of(found, self._map.frames, self.facts(), self.config)
        for event in (
            CommunitiesFound(found.grid, found.community, self.frames - 1, final=True),
            MergesFound(found.grid, found.community, found.log, applied),
            BuildFinished(simap),
        ):
            for observer in observers:
                observer.on_event(event)
        return simap


def _step_of(seen: FrameSeen, lowest_m: NDArray) -> FrameStep:
    lowered = np.isfinite(lowest_m)
    return FrameStep(seen, lowered, lowest_m[lowered].astype(np.float32))


def moved_step(seen: FrameSeen, lowest_m: NDArray, T_map_camera: NDArray, size_m: float) -> tuple[FrameStep, NDArray]:
    """Move what a frame saw to where it would see it from another pose.

    Each cell is moved as the point at its centre; of those that fall into one cell the highest stays, and the lowest
    obstacle.

    Args:
        seen: the frame where it was placed.
        lowest_m: float16 [readings], the lowest obstacle of each of its cells, +inf = none.
        T_map_camera: float64 [4, 4], where it is to be placed.
        size_m: side of a cell.

    Returns:
        Its step at the new pose, and its lowest obstacles, float16 like ``lowest_m``.
    """
    readings, T_new_old = seen.readings, T_map_camera @ invert_pose(seen.T_map_camera)
    x, y = (readings.cols + 0.5) * size_m, (readings.rows + 0.5) * size_m
    tops = transform_points(T_new_old, np.stack([x, y, readings.height_m.astype(np.float64)], axis=1))
    rise_m = tops[:, 2] - readings.height_m
    rows, cols = (np.floor(tops[:, axis] / size_m).astype(np.int32) for axis in (1, 0))
    lowest = (lowest_m + rise_m).astype(np.float16)
    # Order by cell, the highest first; cells stay in the order of rows and columns.
    order = np.lexsort((-tops[:, 2], cols, rows))
    rows, cols, top_m, lowest = rows[order], cols[order], tops[order, 2].astype(np.float32), lowest[order]
    new = np.ones(len(rows), bool)
    new[1:] = (np.diff(rows) != 0) | (np.diff(cols) != 0)
    first = np.flatnonzero(new)
    lowest = np.minimum.reduceat(lowest, first) if len(first) else lowest
    moved = FrameReadings(rows[first], cols[first], readings.segments[order][first], top_m[first])
    cell_of = np.zeros(len(order), np.int32)
    cell_of[order] = np.cumsum(new) - 1
    runs = _moved_runs(seen.runs, cell_of, np.rint(rise_m * STEPS_PER_M).astype(np.int64))
    return _step_of(replace(seen, T_map_camera=T_map_camera, readings=moved, runs=runs), lowest), lowest


def _moved_runs(runs: FrameRuns, cell_of: NDArray, risen: NDArray) -> FrameRuns:
    """Return runs in other cells, int32 [readings], and higher by so many steps, int64 [readings]; none twice."""
    low, high = (
        np.clip(steps.astype(np.int64) + risen[runs.reading], -STEPS, STEPS - 1).astype(np.int8)
        for steps in (runs.low, runs.high)
    )
    table = np.stack([cell_of[runs.reading], runs.segments, low, high], axis=1)
    _, kept = np.unique(table, axis=0, return_index=True)
    kept = np.sort(kept)
    kept = kept[np.argsort(table[kept, 0], kind="stable")]
    return FrameRuns(table[kept, 0], runs.segments[kept], low[kept], high[kept])
