"""Takes shots from a source until it ends, and puts them on a map that grows: with masks where they come in time.

The map does not know how many frames or classes will come, and its frames can be placed again. A frame is projected by
itself, and what it saw is then replayed onto the map, as a build log is. So the map of a sequence played to its end is
that of its build, bit for bit, as long as no place was seen too often (`PLACE_SIZE`). Frames whose poses may be
corrected are put aside in a scratch file. (Moving what they saw cell by cell needs no pictures, but blurs every border
by half a cell: on a rendered house panoptic quality fell from .97 to .70, and here it stays at .97.)
"""

import sys
import threading
import time
from collections import Counter, defaultdict, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import zstandard
from numpy.typing import NDArray

from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.build.seen_colors import with_colors
from simaps_viz.datasets.gravity import estimate_gravity
from simaps_viz.errors import InputError
from simaps_viz.events import (
    BuildFinished,
    BuildStarted,
    CommunitiesFound,
    FrameProjected,
    MergesFound,
    Observer,
    notify,
)
from simaps_viz.geometry import invert_pose, map_from_world, upright_turns
from simaps_viz.live.forgetting import Forgetting
from simaps_viz.live.relocalise import Placement, as_steps, find_placement
from simaps_viz.live.source import Correction, Shot, Source, Traffic
from simaps_viz.mapping import finalize
from simaps_viz.mapping.accumulator import UNSEGMENTED_ABOVE_M, MapAccumulator
from simaps_viz.mapping.changes import Change, as_json, cells_of, changes_in, find_changes, leftovers
from simaps_viz.mapping.file import check_writable, save_map
from simaps_viz.mapping.finalize import SequenceFacts
from simaps_viz.mapping.floor_plan import with_rooms
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.mapping.steps import FrameStep, OnDisk, pack_step, unnamed_file, unpack_step
from simaps_viz.segmentation.geometry_stuff import add_stuff
from simaps_viz.segmentation.protocol import Network
from simaps_viz.segmentation.sequences import needs_stuff
from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation, SIMap

PLACE_SIZE = (0.25, 0.25, 0.25, np.deg2rad(30.0), np.deg2rad(30.0))
"""Frames are taken from the same place when their cameras share a cube of so many metres, and a sector of headings."""
SHARE = 0.25
"""Of the time, on another processor than frames, may be spent on making maps to be looked at."""
BEHIND = 60
"""Frames that may wait to be put aside."""
BLOCK = 1 << 13
"""What is put aside takes a whole number of blocks of so many bytes, so that others fit where it was."""
FRAMES_A_PLACE = 10
"""Frames with masks that are kept of one place: what comes later adds geometry only, until something was forgotten or a
frame shows something new. From then on as many of the newest are kept beside the first ones, which know what was there
before. So the map of a robot that drives in circles, or stands, grows with the area and not with time."""
NEWS_CELLS = 9
"""In so many cells a frame has to show something new."""
LOOK_AT = 30
"""Frames from which the place on an earlier map is looked for; without success again at twice as many."""
MAX_PASSES = 3
"""A map is made again at most so often without what was left of objects that have gone."""
PATIENCE = 15
"""So many frames in a row that contradict the map are left out; then they are right, and the map was not."""
FLOOR_M = 0.05
"""A floor found so close to the world's height 0 is at 0, where robots' maps have it."""
FLOOR_FRAMES = (5, 15, 30, 60)
"""The floor is looked for once so many frames are there; without success the world's own height 0 is taken."""


@dataclass(eq=False)
class _Kept:
    """What placing a frame again needs, besides what the map keeps of it."""

    shot: tuple[int, int]
    """Epoch, and time in ns."""
    T_odom_camera: NDArray | None
    intrinsics: Intrinsics
    stored: "Future[tuple[_Stored, _Stored, _Stored]]"
    """Where its step, its depth and its ids lie in the scratch file."""


_Stored = tuple[int, int]
"""Offset and length in bytes."""


class _Scratch:
    """An unnamed file, written by one thread and read by another; what is freed there is written over."""

    def __init__(self) -> None:
        self._file = OnDisk(unnamed_file())
        self._free: defaultdict[int, list[int]] = defaultdict(list)

    def add(self, data: bytes) -> _Stored:
        blocks = -(-len(data) // BLOCK)
        try:
            offset = self._free[blocks].pop()
        except IndexError:
            return self._file.add(data + bytes(blocks * BLOCK - len(data))), len(data)
        self._file.add(data, offset)
        return offset, len(data)

    def read(self, stored: _Stored) -> bytes:
        return self._file.read(*stored)

    def free(self, *stored: _Stored) -> None:
        for offset, length in stored:
            self._free[-(-length // BLOCK)].append(offset)


class GrowingMap:
    """Puts shots on the map, one by one, from one thread."""

    def __init__(self, source: Source, config: BuildConfig, earlier: SIMap | None = None) -> None:
        """Begin with nothing; the method must not count links, which could not be placed again.

        Args:
            source: of shots.
            config: how the map is made.
            earlier: a map of the same place to go on with, once it is known where on it the shots are; from then on
                its frame is this map's.
        """
        self.source, self.config, self.earlier = source, config, earlier
        self.placement: Placement | None = None
        """The best one so far on the earlier map."""
        self._earlier: list[FrameStep] = []
        self._finding: Future[Placement | None] | None = None
        self._look_at = LOOK_AT
        self.T_map_world = source.T_map_world
        """None until the floor is found."""
        self.notes: list[str] = []
        self._waiting: list[Shot] = []
        self._map = finalize.empty_accumulator(source, config)
        self._one = finalize.empty_accumulator(source, config, steps=True)
        self._kept: dict[int, _Kept] = {}
        """By the frame's index."""
        self._scratch, self._storing = _Scratch(), ThreadPoolExecutor(1, "live-frames")
        self._maker = ThreadPoolExecutor(1, "live-map")
        self._making: Future[tuple[SIMap, float]] | None = None
        self._newest: SIMap | None = None
        self._make_s = 0.0
        self._far_m = config.projection.far_m
        self._depth_unit_m = self._far_m / 65535
        self._next = 0
        """Index of the next frame."""
        self._places: defaultdict[tuple[int, ...], deque[int]] = defaultdict(deque)
        """The indices of the frames kept of each place, oldest first,"""
        self._taken: Counter[tuple[int, ...]] = Counter()
        """and how many were taken since something was forgotten, or new."""
        self._forgetting, self._astray = Forgetting(), 0
        self.contradicting = 0
        """Frames that were left out, for the map says otherwise."""

    @property
    def frames(self) -> int:
        """Frames of the map: those with masks, as far as they are kept."""
        return len(self._map.frames)

    def add(self, shot: Shot) -> list[FrameProjected]:
        """Put a shot on the map; return its event, and those of shots that waited for a floor, while it is so."""
        if self.T_map_world is not None:
            events = self._put_on_map(shot)
            self._look_for_place()
            return events
        self._waiting.append(shot)
        return self._find_floor() if len(self._waiting) in FLOOR_FRAMES else []

    def finish_waiting(self) -> list[FrameProjected]:
        """Place the shots that still wait for a floor, when no more will come."""
        events = self._find_floor(last=True) if self._waiting else []
        self._look_for_place(wait=True)
        return events

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
        events = []
        for shot in waiting:
            try:
                events += self._put_on_map(shot)
            except InputError:  # one pose that is far off costs one frame
                self.contradicting += 1
        return events

    @property
    def is_placed(self) -> bool:
        """Whether it goes on with an earlier map."""
        return bool(self._earlier)

    def _look_for_place(self, *, wait: bool = False) -> None:
        """Look for the place on the earlier map now and then, in another thread; ``wait``: for what is found."""
        if self.earlier is None or self._earlier or not self._kept:
            return
        if self._finding is None and (wait or self.frames >= self._look_at):
            self._finding = self._maker.submit(find_placement, self.earlier.grid, self._map.snapshot())
            self._look_at = 2 * self.frames
        if self._finding is not None and (wait or self._finding.done()):
            found, self._finding = self._finding.result(), None
            self.placement = found or self.placement
            if found is not None and found.is_sure:
                self._go_on_with(self.earlier, found.T_old_new)

    def _go_on_with(self, earlier: SIMap, T_earlier_map: NDArray) -> None:
        """Make the earlier map the beginning of this one, and place all frames on it."""
        T_map_world, poses = np.asarray(self.T_map_world), self._map.frames.poses
        self.T_map_world = T_earlier_map @ T_map_world
        name = str(earlier.provenance.get("name") or "earlier map")
        self._earlier = as_steps(earlier, name, T_earlier_map @ poses[0])
        for label, is_thing in zip(earlier.grid.labels, earlier.grid.is_thing, strict=True):
            for accumulator in (self._one, self._map):
                accumulator.learn(label, is_thing=is_thing)
        fresh, self._forgetting = self._begun(), Forgetting()
        self._kept = dict(enumerate(self._kept.values(), len(self._earlier)))
        self._places.clear()
        self._next = len(self._earlier) + len(self._kept)
        for pose, (index, one) in zip(poses, self._kept.items(), strict=True):
            stored = one.stored.result()
            step = unpack_step(self._scratch.read(stored[0]))
            frame, moved = self._project_again(step, one, stored, invert_pose(T_map_world) @ pose, index=index)
            sight = self._forgetting.see(fresh, frame, moved.seen.T_map_camera)
            self._forgetting.take(fresh, sight, frame.index)
            fresh.replay(moved)
            self._places[_place_of(moved.seen.T_map_camera)].append(index)
        self._map, self._taken = fresh, Counter({place: len(here) for place, here in self._places.items()})

    def _begun(self) -> MapAccumulator:
        """Return an accumulator with the earlier map, if there is one, and nothing else."""
        fresh = finalize.empty_accumulator(self._map, self.config)
        for step in self._earlier:
            fresh.replay(step)
        return fresh

    def _put_on_map(self, shot: Shot) -> list[FrameProjected]:
        T_map_camera = np.asarray(self.T_map_world @ shot.frame.T_world_camera)
        masks = shot.segmentation
        sight = self._forgetting.see(self._map, shot.frame, T_map_camera)
        self._astray = self._astray + 1 if self._forgetting.contradicts(sight) else 0
        if 0 < self._astray <= PATIENCE:
            self.contradicting += 1
            return []
        if self._forgetting.take(self._map, sight, self._next):
            self._taken.clear()  # what was moved has to be named elsewhere
        place, kept = _place_of(T_map_camera), masks is not None
        if masks is None:
            masks = Segmentation(np.zeros(shot.frame.depth_m.shape, np.int32), ())
        for segment in masks.segments:
            for accumulator in (self._one, self._map):
                accumulator.learn(segment.label, is_thing=segment.is_thing)
        # What the frame saw by itself, and then on top of all others.
        frame = replace(shot.frame, index=self._next)
        self._one.clear()
        seen = self._one.add_frame(frame, masks, T_map_camera)
        step = self._one.step
        assert step is not None
        if kept and self._taken[place] >= FRAMES_A_PLACE:
            if self._shows_news(step):
                self._taken.clear()  # what was brought has to be named
            kept = not self._taken[place]
        self._map.replay(step, geometry_only=not kept)
        if kept:
            self._taken[place] += 1
            self._keep(shot, step, frame, masks, self._places[place])
        else:
            frame = replace(frame, index=max(self._next - 1, 0))
        nothing = np.zeros((0, 4), np.int32)
        return [
            FrameProjected(
                frame=frame, segmentation=masks, T_map_camera=T_map_camera,
                cells=(seen - np.array(self._map.origin_cell, np.int32)).astype(np.int32),
                new_edges=nothing, new_edge_labels=np.zeros(0, np.int16),
                snapshot=self._map.snapshot, map_so_far=self.newest_map, kept=kept,
            )
        ]  # fmt: skip

    def _shows_news(self, step: FrameStep) -> bool:
        """Whether a frame sees what no frame with masks has seen, or something on top of it."""
        readings, tiles = step.seen.readings, self._map.tiles
        top_m = tiles.top[tiles.locate(readings.rows, readings.cols)]
        return int(np.count_nonzero(readings.height_m > top_m + UNSEGMENTED_ABOVE_M)) >= NEWS_CELLS

    def _keep(self, shot: Shot, step: FrameStep, frame: Frame, masks: Segmentation, here: deque[int]) -> None:
        """Keep a frame of the map; of too many from its place one that is neither old nor new goes."""
        self._next += 1
        if shot.T_odom_camera is not None or self.earlier is not None:
            if (late := self._kept.get(frame.index - BEHIND)) is not None:
                late.stored.result()  # the disk is slower than the camera
            stored = self._storing.submit(self._store, step, frame, masks)
            self._kept[frame.index] = _Kept((shot.epoch, shot.stamp_ns), shot.T_odom_camera, frame.intrinsics, stored)
        here.append(frame.index)
        if len(here) > 2 * FRAMES_A_PLACE:
            dropped = here[FRAMES_A_PLACE]
            del here[FRAMES_A_PLACE]
            self._map.frames.drop(dropped)
            if (one := self._kept.pop(dropped, None)) is not None:
                self._scratch.free(*one.stored.result())

    def _store(self, step: FrameStep, frame: Frame, masks: Segmentation) -> tuple[_Stored, _Stored, _Stored]:
        """Put aside what placing a frame again needs, in the storing thread."""
        steps = np.rint(np.where(frame.depth_m <= self._far_m, frame.depth_m, 0.0) / self._depth_unit_m)
        # Steps from pixel to pixel are small: as good as PNG, in a fifth of its time.
        across = np.diff(steps.astype(np.uint16), axis=1, prepend=np.uint16(0))
        add, squeeze = self._scratch.add, lambda pixels: zstandard.compress(pixels.tobytes(), 1)
        return add(pack_step(step)), add(squeeze(across)), add(squeeze(masks.ids))

    def place_again(self, correction: Correction) -> int:
        """Project the frames that a correction concerns again, from where they were; return how many.

        What frames without masks saw is not kept, and comes again when they do.
        """
        since = correction.epoch, correction.since_ns
        moving = {
            index: one.T_odom_camera for index, one in self._kept.items()
            if one.shot >= since and one.shot[0] == correction.epoch and one.T_odom_camera is not None
        }  # fmt: skip
        if not moving or self.T_map_world is None or len(self._kept) + len(self._earlier) != self.frames:
            return 0
        T_world_odom = correction.T_world_odom(np.array([self._kept[index].shot[1] for index in moving], np.int64))
        poses = {index: T @ moving[index] for index, T in zip(moving, T_world_odom, strict=True)}
        fresh = self._begun()
        for index, one in self._kept.items():
            stored = one.stored.result()
            step = unpack_step(self._scratch.read(stored[0]))
            if index in poses:
                step = self._project_again(step, one, stored, poses[index], index=index)[1]
            fresh.replay(step)
        self._map, self._forgetting = fresh, Forgetting()
        return len(moving)

    def _project_again(
        self,
        step: FrameStep,
        one: _Kept,
        stored: tuple[_Stored, _Stored, _Stored],
        T_world_camera: NDArray,
        *,
        index: int,
    ) -> tuple[Frame, FrameStep]:
        """Return a frame from another pose, and its step, which is kept in place of the old one."""
        k, read = one.intrinsics, self._scratch.read
        across, ids = (
            np.frombuffer(zstandard.decompress(read(place)), kind).reshape(k.height, k.width)
            for place, kind in zip(stored[1:], (np.uint16, np.int32), strict=True)
        )
        depth_m = np.cumsum(across, axis=1, dtype=np.uint16).astype(np.float32) * np.float32(self._depth_unit_m)
        frame = Frame(index, step.seen.name, depth_m, T_world_camera, k)
        self._one.clear()
        self._one.add_frame(frame, Segmentation(ids, step.seen.segments), np.asarray(self.T_map_world) @ T_world_camera)
        moved = self._one.step
        assert moved is not None
        self._scratch.free(stored[0])
        one.stored = Future()
        one.stored.set_result((self._scratch.add(pack_step(moved)), *stored[1:]))
        return frame, moved

    def changes(self) -> tuple[Change, ...]:
        """Return what has moved, gone or come on the newest map that is made."""
        return () if self._newest is None else changes_in(self._newest)

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
        return _made(self._map.copy(), self._forgetting, self.facts(), self.config, len(self._earlier))[0]

    def newest_map(self) -> SIMap | None:
        """Return the newest map that is made, None before the first, and have the next one made by another thread.

        Frames do not wait for it. Making maps takes at most `SHARE` of the time.
        """
        making, now_s = self._making, time.monotonic()
        if making is not None and making.done():
            (self._newest, took_s), self._making = making.result(), None
            self._make_s = now_s + took_s * (1.0 / SHARE - 1.0)
        if self._making is None and now_s >= self._make_s:
            self._making = self._maker.submit(
                _made, self._map.copy(), self._forgetting.copy(), self.facts(), self.config, len(self._earlier)
            )
        return self._newest

    def finished(self, observers: Sequence[Observer]) -> SIMap:
        """Return the finished map, and notify observers of how it comes about; nothing is placed afterwards."""
        self._storing.shutdown(wait=False)
        self._maker.shutdown()
        found, simap = _believed(self._map, self._forgetting, self.facts(), self.config, len(self._earlier))
        threshold = joining_threshold(self.config.method, self.config.parameters())
        applied = applied_steps(found.log, threshold)
        for event in (
            CommunitiesFound(found.grid, found.community, self._next - 1, final=True),
            MergesFound(found.grid, found.community, found.log, applied),
            BuildFinished(simap),
        ):
            notify(observers, event)
        self._newest = simap
        return simap


def _place_of(T_map_camera: NDArray) -> tuple[int, ...]:
    """Return the place that a frame is taken from: its cube and sectors, see `PLACE_SIZE`."""
    forward = T_map_camera[:3, 2]
    angles = np.arctan2(forward[1], forward[0]), np.arcsin(np.clip(forward[2], -1, 1))
    return tuple(int(at // size) for at, size in zip((*T_map_camera[:3, 3], *angles), PLACE_SIZE, strict=True))


def _made(
    accumulator: MapAccumulator, forgetting: Forgetting, facts: SequenceFacts, config: BuildConfig, old: int
) -> tuple[SIMap, float]:
    """Return a map, and how long it took to make, seconds."""
    began_s = time.monotonic()
    return _believed(accumulator, forgetting, facts, config, old)[1], time.monotonic() - began_s


def _believed(
    accumulator: MapAccumulator, forgetting: Forgetting, facts: SequenceFacts, config: BuildConfig, old: int
) -> tuple[finalize.Found, SIMap]:
    """Return what is found in what is believed, and its map, which knows what has changed; the accumulator forgets.

    The first ``old`` frames are an earlier map.
    """
    whole = accumulator.frames
    for _ in range(MAX_PASSES):
        gone = None
        if forgetting or old:
            accumulator.frames, gone = forgetting.split(whole)
        found = finalize.apply_method(finalize.gathered(accumulator), config)
        simap = finalize.map_of(found, accumulator.frames, facts, config)
        if gone is None:
            return found, simap
        past = finalize.empty_accumulator(accumulator, config)
        for seen in gone:
            past.replay(FrameStep(seen, np.zeros(len(seen.readings.rows), np.bool_), np.zeros(0, np.float32)))
        ghosts = finalize.map_so_far(past, facts, config)
        changes = find_changes(simap, ghosts, gone, accumulator.frames, old=old)
        simap = replace(simap, provenance={**simap.provenance, "changes": as_json(changes)})
        # What was left of an object that has gone goes, too: its edges were hidden, or next to something else.
        rest = leftovers(simap, ghosts)
        for one, ghost in rest:
            forgetting.forget_with(accumulator, cells_of(simap, one), cells_of(ghosts, ghost))
        if not rest:
            break
    return found, simap


class _Rehearsal(Source):
    """Small pictures from above: two chairs; half of one called a cup, then under a cup; the other is taken away."""

    name, labels, is_thing, simulated = "", ("none", "chair", "cup"), (False, True, True), True
    T_map_world = np.eye(4)

    def shots(self) -> Iterator[Shot]:
        k = Intrinsics(32, 24, 40.0, 40.0, 15.5, 11.5)
        T_map_camera = np.diag([1.0, -1.0, -1.0, 1.0])
        T_map_camera[2, 3] = 2.0
        both = np.zeros((k.height, k.width), np.int32)
        both[2:22, 4:12] = both[2:22, 20:28] = 1
        half, one = both.copy(), both.copy()
        half[2:22, 4:9], one[2:22, 20:28] = 2, 0
        segments = (Segment(1, "chair"), Segment(2, "cup"))
        # Often enough for the votes to be counted, which they are not where masks agree.
        for ids, cup_m in ((both, 1.2), *[(half, 1.2)] * 3, (both, 1.2), (half, 0.9), (one, 1.2)):
            depth_m = np.choose(ids, (2.0, 1.2, cup_m)).astype(np.float32)
            yield Shot(Frame(0, "", depth_m, T_map_camera, k), Segmentation(ids, segments), 0)


def warm_up(config: BuildConfig) -> SIMap:
    """Return a small map, made so that all is compiled before the first frame comes; slow once, when installed."""
    rehearsal = _Rehearsal()
    growing = GrowingMap(rehearsal, config)
    for shot in rehearsal.shots():
        growing.add(shot)
    return with_rooms(growing.finished(()))


@contextmanager
def _prompt_threads() -> Iterator[None]:
    """Let threads of Python take turns sooner, within a block.

    A frame lets go of the interpreter dozens of times, in kernels and for messages. While another thread makes a map or
    its messages it gets it back after the switch interval, each time: 5 ms by default, so a tenth of a second a frame.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


SWITCH_S = 0.0005
TAKE_S = 0.1
"""Every so often it is looked whether to stop."""
CORRECT_S = 2.0
"""Frames are placed again at most so often."""


@dataclass(frozen=True, eq=False)
class LiveRequest:
    """What a live map is made of, and into which file."""

    source: Source
    config: BuildConfig
    output: Path
    idle_stop_s: float | None = None
    """End when nothing has come for so long; None = wait for as long as it takes."""
    network: Network | None = None
    """Makes the masks of the newest picture whenever it is free."""
    every_frame: bool = False
    """Wait for the network at each frame, for sources that can wait."""
    observers: tuple[Observer, ...] = ()
    """Notified of every event, in addition to those of the run."""
    earlier: SIMap | None = None
    """A map of the same place, to go on with."""
    traffic: Traffic = field(default_factory=Traffic)
    """Counts what comes and what is left out."""


class LiveRun:
    """One run; `words` may be asked from any thread."""

    def __init__(self, request: LiveRequest) -> None:
        self.request, self.traffic = request, request.traffic
        self.moved = 0
        """Frames that were placed again."""
        self.growing = GrowingMap(request.source, request.config, request.earlier)
        self._last_s = self._corrected_s = time.monotonic()

    def words(self) -> str:
        """Describe the connection and what comes, in one line."""
        again = f"{self.moved} placed again" if self.moved else ""
        kinds = Counter(one.kind for one in self.growing.changes())
        changes = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        parts = self.request.source.words(), self.traffic.words(), again, self.place_words(), changes
        return " · ".join(filter(None, parts))

    def place_words(self) -> str:
        """Describe whether the map goes on with the earlier one; "" where there is none."""
        best, growing = self.growing.placement, self.growing
        if growing.earlier is None:
            return ""
        score = "" if best is None else f" (agreement {best.score:.2f}, elsewhere {best.second:.2f})"
        return f"on the earlier map{score}" if growing.is_placed else f"not found on the earlier map{score}"

    def started(self) -> BuildStarted:
        """Return the event that the run begins with; it names no frames, as none is known."""
        source = self.request.source
        return BuildStarted(source.name, (), np.eye(4), source.segmentation_source, source.simulated)

    def run(self, observers: Sequence[Observer], cancel: threading.Event) -> SIMap:
        """Take shots until the source ends, falls silent, or ``cancel`` is set; return the map, which is saved.

        Raises:
            InputError: nothing came, or the map cannot be written.
        """
        request, growing = self.request, self.growing
        observers = (*observers, *request.observers)
        check_writable(request.output)
        source = request.source
        notify(observers, self.started())
        warm_up(request.config)
        self._last_s = time.monotonic()
        with _prompt_threads(), ThreadPoolExecutor(1, "live-masks") as pool:
            masks = _Masks(request.network, pool) if request.network is not None else None
            while not (cancel.is_set() or source.ended or self._silent()):
                shot = source.take(TAKE_S)
                self._correct()
                for one in [shot] if masks is None else masks.through(shot, growing, wait=request.every_frame):
                    self._put(one, observers)
                if shot is not None:
                    self._last_s = time.monotonic()  # what comes while a shot takes long is no silence
            self._correct(wait=False)
            for one in masks.rest(growing) if masks is not None else ():
                self._put(one, observers)
        for event in growing.finish_waiting():
            notify(observers, event)
        return self._save(observers)

    def _put(self, shot: Shot | None, observers: Sequence[Observer]) -> None:
        if shot is None:
            return
        left_out = self.growing.contradicting
        try:
            events = self.growing.add(shot)
        except InputError:  # it would become larger than a map may be
            self.traffic.drop("too far away")
            return
        if self.growing.contradicting > left_out:
            self.traffic.drop("contradicts the map")
        else:
            self.traffic.place(shot)
        for event in events:
            notify(observers, event)

    def _silent(self) -> bool:
        limit_s = self.request.idle_stop_s
        return limit_s is not None and time.monotonic() - self._last_s > limit_s

    def _correct(self, *, wait: bool = True) -> None:
        due = not wait or time.monotonic() - self._corrected_s >= CORRECT_S
        if due and (correction := self.request.source.correction()) is not None:
            self.moved += self.growing.place_again(correction)
            self._corrected_s = time.monotonic()

    def _save(self, observers: Sequence[Observer]) -> SIMap:
        request, growing = self.request, self.growing
        if not self.traffic.placed:
            found = request.source.words()
            raise InputError(f"{request.source.name}: expected frames, found none{f' ({found})' if found else ''}")
        dropped = dict(self.traffic.dropped)  # what comes while the map is finished was not too much for it
        simap = growing.finished(observers)
        live = {"shots": self.traffic.placed, "dropped": dropped, "moved": self.moved}
        if growing.earlier is not None:
            live["earlier"] = {
                "name": growing.earlier.provenance.get("name"), "found": growing.is_placed,
                "agreement": None if growing.placement is None else round(growing.placement.score, 3),
            }  # fmt: skip
        simap = replace(simap, provenance={**simap.provenance, "live": live})
        sequence = getattr(request.source, "sequence", None)
        simap = with_rooms(simap if sequence is None else with_colors(simap, sequence))
        save_map(simap, request.output)
        return simap


class _Masks:
    """A network in a thread of its own: it looks at the newest picture whenever it is free; others go on without."""

    def __init__(self, network: Network, pool: ThreadPoolExecutor) -> None:
        self._network, self._pool, self._by_geometry = network, pool, needs_stuff(network)
        self._busy: Future[Shot] | None = None

    def through(self, shot: Shot | None, growing: GrowingMap, *, wait: bool) -> list[Shot]:
        """Return the shots that are ready to be placed, after one more has come."""
        ready = []
        if self._busy is not None and (self._busy.done() or (wait and shot is not None)):
            ready, self._busy = [self._busy.result()], None
        if shot is not None and self._busy is None and shot.frame.color is not None:
            self._busy = self._pool.submit(self._segment, shot, growing)
        elif shot is not None:
            ready.append(shot)
        return ready

    def rest(self, growing: GrowingMap) -> list[Shot]:
        """Return the shot that the network is busy with, once it is done."""
        busy, self._busy = self._busy, None
        return [] if busy is None else [busy.result()]

    def _segment(self, shot: Shot, growing: GrowingMap) -> Shot:
        T_map_world, network = growing.T_map_world, self._network
        turns = 0 if T_map_world is None else upright_turns(T_map_world @ shot.frame.T_world_camera)
        upright = shot.frame.turned(turns)
        assert upright.color is not None
        found = network.decode(network.infer(network.prepare(upright.color)), *upright.color.shape[:2])
        if self._by_geometry and T_map_world is not None:
            found = add_stuff(upright, found, T_map_world @ upright.T_world_camera)
        return replace(shot, segmentation=found.turned(-turns))
