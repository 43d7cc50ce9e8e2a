"""The order of the stages: frames in, a SIMap out, everything told to those who watch."""

import hashlib
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource, Unreadable, read_each
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.events import (
    BuildFinished,
    BuildStarted,
    CommunitiesFound,
    Event,
    FrameGathered,
    FrameProjected,
    FrameSkipped,
    MergesFound,
    Observer,
    wants_color,
)  # fmt: skip
from simaps_viz.mapping import finalize
from simaps_viz.mapping.accumulator import MapAccumulator
from simaps_viz.build.build_log import BuildLog
from simaps_viz.mapping.config import BuildConfig, Method
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.mapping.finalize import SequenceFacts
from simaps_viz.mapping.steps import FrameStep
from simaps_viz.structures import CellGraph, Frame, Grid, Segmentation, SIMap

__all__ = [
    "CONTENT",
    "BuildCancelled",
    "BuildConfig",
    "Elsewhere",
    "Method",
    "build_map",
    "content_of",
    "empty_accumulator",
    "facts_of",
    "fingerprint",
    "gather_frames",
    "graphs_so_far",
    "started",
]

Elsewhere = Callable[[FrameSource, BuildConfig, NDArray, Sequence[int]], Generator[FrameStep | None, None, None]]
"""Has frames gathered by other processes. Takes the sequence, the settings, T_map_camera of all frames (float64
[n, 4, 4]) and indices, ascending; returns the steps of these frames, in order, and None every so often while it waits."""

CONTENT = "names, poses, cameras and tables"
"""Under this name a build's log keeps the hash of its sequence."""

NONE_OF_FIRST = 20
"""When none of so many first frames can be read, the sequence is at fault, not a frame."""


class BuildCancelled(SIMapsError):  # noqa: N818 - not a fault
    """Somebody asked a build to stop; nothing was written but its log, from which it can go on."""


def build_map(
    sequence: FrameSource,
    config: BuildConfig | None = None,
    observers: Sequence[Observer] = (),
    *,
    communities_every: int = 0,
    strict: bool = False,
    log: Path | BuildLog | None = None,
    resume: bool = False,
    cancel: threading.Event | None = None,
    elsewhere: Elsewhere | None = None,
) -> SIMap:
    """Build a Semantic Instance Map.

    Args:
        sequence: posed RGB-D frames with their segmentation.
        config: how.
        observers: told everything, in order; colour is decoded only if one wants it.
        communities_every: tell observers the communities after every so many frames; 0 = only at the end.
        strict: a frame that cannot be read is an error; otherwise it is skipped and counted in the provenance.
        log: keep a build log in this file while building; the finished log stays there. Or a log that is open, of
            this build's `fingerprint`; it stays open, and is gone on with if there is something in it.
        resume: go on with the log that is there. The map comes out the same bit for bit. Observers are told of the
            frames that are left; if one wants colour, of all frames, which are read again for it.
        cancel: checked between frames; set it, from any thread, to stop the build.
        elsewhere: who gathers the frames in place of this process. The map comes out the same bit for bit, the log
            too; no observer may want colour.

    Raises:
        InputError: a frame is missing or damaged (named) and ``strict``, or more than half of them are, or the
            configuration makes no sense, or the log is of another build or cannot be written.
        BuildCancelled: ``cancel`` was set.
    """
    config = config or BuildConfig()
    building = _Building(
        sequence, config, len(sequence), observers, communities_every, strict=strict, cancel=cancel,
        logged=log is not None, elsewhere=elsewhere,
    )  # fmt: skip
    building.tell(started(sequence))
    if log is None:
        building.gather(range(len(sequence)))
    elif isinstance(log, BuildLog):
        building.gather_logged(log)
    else:
        with BuildLog(log, fingerprint(sequence, config), resume=resume) as steps:
            building.gather_logged(steps)
    facts, tell = building.facts, partial(_tell, observers)
    seen = finalize.gathered(building.accumulator)
    del building  # with the tiles, whose room the graphs can use

    found = finalize.partition(seen, config)
    tell(CommunitiesFound(found.grid, found.community, len(sequence) - 1, final=True))
    threshold = joining_threshold(config.method, config.parameters())
    tell(MergesFound(found.grid, found.community, found.log, applied_steps(found.log, threshold)))
    simap = finalize.map_of(found, seen.frames, facts, config)
    tell(BuildFinished(simap))
    return simap


def gather_frames(
    sequence: FrameSource, config: BuildConfig, indices: Sequence[int], *, strict: bool = False
) -> MapAccumulator:
    """Gather some frames of a sequence, ascending; parts gathered anywhere are joined by `MapAccumulator.merge`.

    `mapping.so_far.map_so_far(accumulator, facts_of(sequence), config)` makes their map.

    Raises:
        InputError: a frame is missing or damaged and ``strict``, or more than half of these are.
    """
    building = _Building(sequence, config, len(indices), strict=strict)
    building.gather(indices)
    return building.accumulator


@dataclass
class _Building:
    """One build under way."""

    sequence: FrameSource
    config: BuildConfig
    wanted: int
    """Number of frames to be read in all."""
    observers: Sequence[Observer] = ()
    communities_every: int = 0
    strict: bool = False
    cancel: threading.Event | None = None
    logged: bool = False
    elsewhere: Elsewhere | None = None

    def __post_init__(self) -> None:
        self.facts = facts_of(self.sequence)
        self.watched = wants_color(self.observers)
        if self.watched and self.elsewhere is not None:
            raise InputError("frames gathered elsewhere: expected no observer that wants their pictures, found one")
        self.accumulator = empty_accumulator(self.sequence, self.config, watched=self.watched, steps=self.logged)
        self.T_map_camera = self.sequence.T_map_world @ self.sequence.poses
        self.links_told = 0

    def tell(self, event: Event) -> None:
        _tell(self.observers, event)

    def gather_logged(self, log: BuildLog) -> None:
        """Gather all frames, those in the log from there where nobody has to see them; log the others."""
        self.accumulator.frames.read_from(log.path, log.records)
        if not self.watched:
            for step in log.replay():
                if step.seen.skipped and self._can_be_read(step.seen.index):  # it was put right since
                    log.cut(step.seen.index)
                    break
                self._check_skipped(step.seen.skipped)
                try:
                    self.accumulator.replay(step)
                except (ValueError, KeyError, IndexError):  # whole, but not ours: read the frames again from here
                    log.cut(step.seen.index)
                    break
        first = len(self.accumulator.frames)
        self.gather(range(first, len(self.sequence)), log)

    def _can_be_read(self, index: int) -> bool:
        return not isinstance(next(read_each(self.sequence, [index], color=False)), Unreadable)

    def gather(self, indices: Sequence[int], log: BuildLog | None = None) -> None:
        """Read frames, or have them read, and put them on the grid."""
        if self.elsewhere is not None:
            self._gather_elsewhere(self.elsewhere, indices, log)
            return
        with closing(read_each(self.sequence, indices, color=self.watched)) as reads:
            for read in reads:
                self._check_cancelled()
                if isinstance(read, Unreadable):
                    self._skip(read)
                else:
                    self._add(*read)
                self._log(log)

    def _gather_elsewhere(self, elsewhere: Elsewhere, indices: Sequence[int], log: BuildLog | None) -> None:
        with closing(elsewhere(self.sequence, self.config, self.T_map_camera, indices)) as steps:
            for step in steps:
                self._check_cancelled()
                if step is None:
                    continue
                seen = step.seen
                if seen.skipped:
                    self._skip(Unreadable(seen.index, InputError(seen.skipped)))
                    self._log(log)
                else:
                    self.accumulator.replay(step)
                    self._log(log)
                    self.tell(FrameGathered(seen.index, seen.name))

    def _log(self, log: BuildLog | None) -> None:
        step = self.accumulator.step
        if log is not None and step is not None and step.seen.index >= len(log):
            log.append(step if self.config.method == "paper" else replace(step, links=None))

    def _check_cancelled(self) -> None:
        if self.cancel is not None and self.cancel.is_set():
            done = len(self.accumulator.frames)
            raise BuildCancelled(f"{self.sequence.name}: cancelled after {done} of {self.wanted} frames")

    def _add(self, frame: Frame, segmentation: Segmentation) -> None:
        T_map_camera = self.T_map_camera[frame.index]
        seen = self.accumulator.add_frame(frame, segmentation, T_map_camera)
        if not self.observers:
            return
        self.tell(self._projected(frame, segmentation, seen))
        self.links_told = self.accumulator.links.size
        if self.communities_every and (frame.index + 1) % self.communities_every == 0:
            found = finalize.partition(finalize.gathered(self.accumulator), self.config)
            objects = finalize.objects_of(found, self.config)
            self.tell(CommunitiesFound(found.grid, found.community, frame.index, final=False, instance=objects))

    def _skip(self, read: Unreadable) -> None:
        self._check_skipped(str(read.error))
        name = self.sequence.frame_names[read.index]
        self.accumulator.skip_frame(read.index, name, self.T_map_camera[read.index], str(read.error))
        skipped = finalize.skipped_frames(self.accumulator.frames)
        none_yet = len(skipped) == len(self.accumulator.frames) == min(self.wanted, NONE_OF_FIRST)
        if none_yet or 2 * len(skipped) > self.wanted:
            more = f", and {len(skipped) - 1} more of {self.wanted} frames" if len(skipped) > 1 else ""
            raise InputError(f"{next(iter(skipped.values()))}{more}")
        self.tell(FrameSkipped(read.index, name, str(read.error)))

    def _check_skipped(self, reason: str) -> None:
        if reason and self.strict:
            raise InputError(reason)

    def _projected(self, frame: Frame, segmentation: Segmentation, seen: NDArray) -> FrameProjected:
        accumulator = self.accumulator
        origin = np.array(accumulator.origin_cell, dtype=np.int32)
        edges, labels, _ = accumulator.links.entries(self.links_told)
        return FrameProjected(
            frame=frame,
            segmentation=segmentation,
            T_map_camera=self.T_map_camera[frame.index],
            cells=(seen - origin).astype(np.int32),
            new_edges=edges - np.tile(origin, 2),
            new_edge_labels=labels,
            snapshot=accumulator.snapshot,
            map_so_far=lambda: finalize.map_so_far(accumulator, self.facts, self.config),
        )


def _tell(observers: Sequence[Observer], event: Event) -> None:
    for observer in observers:
        observer.on_event(event)


def facts_of(sequence: FrameSource) -> SequenceFacts:
    """Return what a map keeps of a sequence, besides its frames."""
    return SequenceFacts(
        name=sequence.name,
        path=str(sequence.path),
        labels=sequence.labels,
        is_thing=sequence.is_thing,
        segmentation_source=sequence.segmentation_source,
        simulated=sequence.simulated,
        T_map_world=sequence.T_map_world,
    )


def fingerprint(sequence: FrameSource, config: BuildConfig) -> dict[str, Any]:
    """Return what a build depends on, JSON-able: settings, the sequence's facts and content, the version."""
    return {
        "version": version("simaps-viz"),
        "config": config.to_json(),
        "sequence": facts_of(sequence).to_json(),
        "frames": len(sequence),
        CONTENT: content_of(sequence),
    }


def content_of(sequence: FrameSource) -> str:
    """Hash a sequence: names, poses, cameras, segment tables, and what its manifest says.

    The images are not looked at: whoever changes them between a build and its resumption gets a map of both.
    """
    content = hashlib.sha256("\n".join(sequence.frame_names).encode())
    content.update(np.ascontiguousarray(sequence.poses, dtype=np.float64).tobytes())
    content.update(sequence.described())
    if sequence.path.is_file() and sequence.path.suffix == ".json":
        content.update(sequence.path.read_bytes())
    return content.hexdigest()


def empty_accumulator(
    sequence: FrameSource, config: BuildConfig, *, watched: bool = False, steps: bool = False
) -> MapAccumulator:
    """Return what a build gathers its frames in; links are counted where the method or an observer wants them."""
    return finalize.empty_accumulator_of(sequence.labels, sequence.is_thing, config, links=watched, steps=steps)


def started(sequence: FrameSource) -> BuildStarted:
    """Return the event that a build begins with."""
    return BuildStarted(
        name=sequence.name,
        frame_names=sequence.frame_names,
        T_map_world=sequence.T_map_world,
        segmentation_source=sequence.segmentation_source,
        simulated=sequence.simulated,
    )


def graphs_so_far(accumulator: MapAccumulator) -> tuple[Grid, tuple[CellGraph, ...]]:
    """Return the map as it is now, and the cell graph of each of its thing classes."""
    grid = accumulator.snapshot()
    return grid, finalize.graphs_so_far(grid, accumulator.links, accumulator.origin_cell)
