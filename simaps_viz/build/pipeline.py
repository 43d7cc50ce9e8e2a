"""The stages of a build, in order: frames in, a SIMap out, observers notified of everything on the way."""

import hashlib
import json
import os
import re
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from simaps_viz.build.build_log import BuildLog
from simaps_viz.datasets.recording import MAX_TRIED
from simaps_viz.datasets.source import FrameSource, Unreadable, read_each
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.events import (
    BuildFinished,
    BuildStarted,
    CommunitiesFound,
    FrameGathered,
    FrameProjected,
    FrameSkipped,
    MergesFound,
    Observer,
    notify,
    wants_color,
)  # fmt: skip
from simaps_viz.mapping import finalize
from simaps_viz.mapping.accumulator import MapAccumulator
from simaps_viz.mapping.config import BuildConfig
from simaps_viz.mapping.finalize import SequenceFacts
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.mapping.steps import FrameStep
from simaps_viz.structures import Frame, Segmentation, SIMap

__all__ = [
    "CONTENT",
    "BuildCancelled",
    "BuildConfig",
    "BuildControl",
    "RemoteGatherer",
    "build_map",
    "content_of",
    "facts_of",
    "fingerprint",
    "gather_frames",
    "run_build",
    "started",
]

RemoteGatherer = Callable[[FrameSource, BuildConfig, NDArray, Sequence[int]], Generator[FrameStep | None, None, None]]
"""Has frames gathered by other processes. Takes the sequence, the settings, T_map_camera of all frames (float64
[n, 4, 4]) and indices, ascending; returns the steps of these frames, in order, and None every so often while it
waits."""

CONTENT = "names, poses, cameras and tables"
"""Under this name the log of a build keeps the hash of its sequence."""


class BuildCancelled(SIMapsError):  # noqa: N818 - not a fault
    """A build was asked to stop; it has written nothing but its log, from which it can resume."""


@dataclass(frozen=True, eq=False)
class BuildControl:
    """How a build is run: everything that does not change its map. `build_map` describes each field."""

    strict: bool = False
    log: Path | BuildLog | None = None
    resume: bool = False
    cancel: threading.Event | None = None
    gatherer: RemoteGatherer | None = None
    communities_every: int = 0


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
    gatherer: RemoteGatherer | None = None,
) -> SIMap:
    """Build a Semantic Instance Map.

    A build that resumes, or has its frames gathered by other processes, makes the same map bit for bit.

    Args:
        sequence: posed RGB-D frames with their segmentation.
        config: how the map is built.
        observers: notified of every event, in order; colour is decoded only if one wants it.
        communities_every: notify observers of the communities after every so many frames; 0 = only at the end.
        strict: a frame that cannot be read is an error; otherwise it is skipped and counted in the provenance.
        log: keep a build log in this file; the finished log stays there. Or an open log, made with this build's
            `fingerprint`: it stays open, and the build resumes from what is in it.
        resume: resume from the log that is there. Observers are notified of the remaining frames only; if one wants
            colour, of all frames, which are read again for it.
        cancel: checked between frames; set it, from any thread, to stop the build.
        gatherer: gathers the frames in place of this process; no observer may want colour.

    Raises:
        InputError: a frame is missing or damaged (named) and ``strict``, or more than half of them are, or the
            configuration makes no sense, or the log is of another build or cannot be written.
        BuildCancelled: ``cancel`` was set.
    """
    control = BuildControl(strict, log, resume, cancel, gatherer, communities_every)
    return run_build(sequence, config or BuildConfig(), observers, control)


def run_build(
    sequence: FrameSource, config: BuildConfig, observers: Sequence[Observer], control: BuildControl
) -> SIMap:
    """Build a map; see `build_map`. All stages of a build are here, in order."""
    notify(observers, started(sequence))

    # 1. Every frame is projected into cells (projection.py), which raise the map's tiles, or is replayed from the log.
    building = _Building(sequence, config, len(sequence), observers, control)
    if control.log is None:
        building.gather(range(len(sequence)))
    elif isinstance(control.log, BuildLog):
        building.gather_logged(control.log)
    else:
        with BuildLog(control.log, fingerprint(sequence, config), resume=control.resume) as steps:
            building.gather_logged(steps)
    facts, seen = building.facts, finalize.gathered(building.accumulator)
    del building  # with its tiles, whose memory the graphs can use

    # 2. The method names the cells, makes their graphs, and finds communities and how they merge.
    found, frames = finalize.apply_method(seen, config), seen.frames
    del seen  # with the layers that the method has replaced
    notify(observers, CommunitiesFound(found.grid, found.community, len(sequence) - 1, final=True))
    threshold = joining_threshold(config.method, config.parameters())
    notify(observers, MergesFound(found.grid, found.community, found.log, applied_steps(found.log, threshold)))

    # 3. Merged communities are instances; the frames that saw them are counted.
    simap = finalize.map_of(found, frames, facts, config)
    notify(observers, BuildFinished(simap))
    return simap


def gather_frames(
    sequence: FrameSource, config: BuildConfig, indices: Sequence[int], *, strict: bool = False
) -> MapAccumulator:
    """Gather some frames of a sequence, ascending; parts gathered anywhere are joined by `MapAccumulator.merge`.

    `finalize.map_so_far(accumulator, facts_of(sequence), config)` makes their map.

    Raises:
        InputError: a frame is missing or damaged and ``strict``, or more than half of these are.
    """
    building = _Building(sequence, config, len(indices), (), BuildControl(strict=strict))
    building.gather(indices)
    return building.accumulator


@dataclass
class _Building:
    """The first stage of a build: frames into an accumulator."""

    sequence: FrameSource
    config: BuildConfig
    wanted: int
    """Number of frames to be read in all."""
    observers: Sequence[Observer]
    control: BuildControl

    def __post_init__(self) -> None:
        self.facts = facts_of(self.sequence)
        self.watched = wants_color(self.observers)
        if self.watched and self.control.gatherer is not None:
            raise InputError("gatherer: expected no observer that wants colour, found one")
        self.accumulator = finalize.empty_accumulator(
            self.sequence, self.config, links=self.watched, steps=self.control.log is not None
        )
        self.T_map_camera = self.sequence.T_map_world @ self.sequence.poses
        self.links_reported = 0

    def gather_logged(self, log: BuildLog) -> None:
        """Gather all frames: replay those in the log unless an observer wants to see them, read and log the others."""
        self.accumulator.frames.read_from(log.path, log.records)
        if not self.watched:
            for step in log.replay():
                if step.seen.skipped:
                    again = next(read_each(self.sequence, [step.seen.index], color=False))
                    if not isinstance(again, Unreadable):  # it has been repaired since
                        log.cut(step.seen.index)
                        break
                self._check_skipped(step.seen.skipped)
                try:
                    self.accumulator.replay(step)
                except (ValueError, KeyError, IndexError):  # undamaged, but not ours: read the frames again from here
                    log.cut(step.seen.index)
                    break
        first = len(self.accumulator.frames)
        self.gather(range(first, len(self.sequence)), log)

    def gather(self, indices: Sequence[int], log: BuildLog | None = None) -> None:
        """Read frames, or have them read, and put them on the grid."""
        if self.control.gatherer is not None:
            self._gather_remotely(self.control.gatherer, indices, log)
            return
        with closing(read_each(self.sequence, indices, color=self.watched)) as reads:
            for read in reads:
                self._check_cancelled()
                if isinstance(read, Unreadable):
                    self._skip(read)
                else:
                    self._add(*read)
                self._log(log)

    def _gather_remotely(self, gatherer: RemoteGatherer, indices: Sequence[int], log: BuildLog | None) -> None:
        with closing(gatherer(self.sequence, self.config, self.T_map_camera, indices)) as steps:
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
                    notify(self.observers, FrameGathered(seen.index, seen.name))

    def _log(self, log: BuildLog | None) -> None:
        step = self.accumulator.step
        if log is not None and step is not None and step.seen.index >= len(log):
            log.append(step if method_of(self.config.method).counts_links else replace(step, links=None))

    def _check_cancelled(self) -> None:
        if self.control.cancel is not None and self.control.cancel.is_set():
            done = len(self.accumulator.frames)
            raise BuildCancelled(f"{self.sequence.name}: cancelled after {done} of {self.wanted} frames")

    def _add(self, frame: Frame, segmentation: Segmentation) -> None:
        T_map_camera = self.T_map_camera[frame.index]
        seen = self.accumulator.add_frame(frame, segmentation, T_map_camera)
        if not self.observers:
            return
        notify(self.observers, self._projected(frame, segmentation, seen))
        self.links_reported = self.accumulator.links.size
        every = self.control.communities_every
        if every and (frame.index + 1) % every == 0:
            found = finalize.apply_method(finalize.gathered(self.accumulator), self.config)
            objects = finalize.objects_of(found, self.config)
            notify(
                self.observers,
                CommunitiesFound(found.grid, found.community, frame.index, final=False, instance=objects),
            )

    def _skip(self, read: Unreadable) -> None:
        self._check_skipped(str(read.error))
        name = self.sequence.frame_names[read.index]
        self.accumulator.skip_frame(read.index, name, self.T_map_camera[read.index], str(read.error))
        skipped = finalize.skipped_frames(self.accumulator.frames)
        none_yet = len(skipped) == len(self.accumulator.frames) == min(self.wanted, MAX_TRIED)
        if none_yet or 2 * len(skipped) > self.wanted:
            more = f", and {len(skipped) - 1} more of {self.wanted} frames" if len(skipped) > 1 else ""
            raise InputError(f"{next(iter(skipped.values()))}{more}")
        notify(self.observers, FrameSkipped(read.index, name, str(read.error)))

    def _check_skipped(self, reason: str) -> None:
        if reason and self.control.strict:
            raise InputError(reason)

    def _projected(self, frame: Frame, segmentation: Segmentation, seen: NDArray) -> FrameProjected:
        accumulator = self.accumulator
        origin = np.array(accumulator.origin_cell, dtype=np.int32)
        edges, labels, _ = accumulator.links.entries(self.links_reported)
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

    The images are not hashed: if they change before a build resumes, its map is made of both.
    """
    content = hashlib.sha256("\n".join(sequence.frame_names).encode())
    content.update(np.ascontiguousarray(sequence.poses, dtype=np.float64).tobytes())
    content.update(sequence.described())
    if sequence.path.is_file() and sequence.path.suffix == ".json":
        content.update(sequence.path.read_bytes())
    return content.hexdigest()


def started(sequence: FrameSource) -> BuildStarted:
    """Return the event that a build begins with."""
    return BuildStarted(
        name=sequence.name,
        frame_names=sequence.frame_names,
        T_map_world=sequence.T_map_world,
        segmentation_source=sequence.segmentation_source,
        simulated=sequence.simulated,
    )


_MAX_NAME = 100
"""Characters of a sequence's name in a file name, which may have 255 bytes."""


def cache_folder() -> Path:
    """Return the cache folder: ``SIMAPS_CACHE``, or the user's cache directory."""
    chosen = os.environ.get("SIMAPS_CACHE")
    return Path(chosen) if chosen else user_cache_path("simaps")


def made_folder(folder: Path) -> Path:
    """Create a folder of the cache unless it exists; raise InputError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder for cached files (SIMAPS_CACHE), found {error.strerror or error}"
        ) from error
    return folder


def cache_key(sequence: FrameSource, *what: Any) -> str:
    """Compute a key for a file made from a sequence: it changes with the content, masks, version and ``what``.

    As for builds that resume, the images are not hashed (`pipeline.content_of`).

    Args:
        sequence: the sequence the file is made from.
        what: everything else it depends on, JSON-able.
    """
    path = str(Path(sequence.path).resolve())
    parts = [path, sequence.segmentation_source, content_of(sequence), *what, version("simaps-viz")]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def map_in_cache(folder: Path, sequence: FrameSource, method: str, config: BuildConfig) -> Path:
    """Return the path in the cache of a method's map of a sequence; its recording is beside it.

    Raises:
        InputError: the cache cannot be written.
    """
    name = re.sub("[^a-z0-9]+", "-", sequence.name.lower()).strip("-")[:_MAX_NAME]
    return made_folder(folder / "maps") / f"{name}-{cache_key(sequence, method, asdict(config))}.npz"
