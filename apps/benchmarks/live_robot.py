"""How good and how fresh a live map is, and how soon goals come: a simulated robot plays a sequence, and drives."""

import os
import resource
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from fake_robot import DEPTH, TOPICS, Faults, FoxgloveServer, Played, Server, Wheels, ZenohServer, play

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.floors import SomeFrames
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.evaluation.quality import score
from simaps_viz.evaluation.truth import find_truth, truth_of
from simaps_viz.live.drive import Driver, MapPublisher
from simaps_viz.live.links import FoxgloveLink, RobotLink, ZenohLink
from simaps_viz.live.robot import RobotSource
from simaps_viz.live.run import GrowingMap, LiveRequest, LiveRun
from simaps_viz.live.source import PlayedSequence, Shot, Traffic
from simaps_viz.live.topics import TopicNames
from simaps_viz.structures import Frame, Intrinsics, Segmentation, SIMap

PATIENCE_S = 600.0
"""A machine with other work takes its time."""
AWAY_S = 1.0
SILENT_S = 4.0
"""A robot that is silent for so long has played all it had."""


@dataclass(frozen=True)
class Outcome:
    """One run."""

    simap: SIMap
    shots: int
    named: int
    moved: int
    dropped: dict[str, int]


class _Timed(Traffic):
    def __init__(self) -> None:
        super().__init__()
        self.delays_ms: list[float] = []

    def place(self, shot: Shot) -> None:
        super().place(shot)
        self.delays_ms.append((time.time_ns() - shot.sent_ns) / 1e6)


class _NoLink(RobotLink):
    """A link over which nothing goes."""

    def open(self, on_topics: Any, on_message: Any) -> None:
        """Connect to nobody."""

    def _subscribe(self) -> None: ...
    def _hang_up(self) -> None: ...


class _Handed(RobotSource):
    """A robot whose messages are handed over as they would have come, by its own clock: no machine is too slow."""

    def __init__(self, played: Played, traffic: Traffic) -> None:
        self._now_s = 0.0
        super().__init__(_NoLink("robot"), TopicNames(), color=False, traffic=traffic, clock=lambda: self._now_s)
        self._link_is_away = lambda s: bool((every := played.faults.restart_s) and every < s and (s % every) < AWAY_S)
        self._messages = played.messages(time.time_ns())
        self._on_topics(dict(TOPICS))
        self._offered_s = -np.inf

    def take(self, timeout_s: float) -> Shot | None:
        """Return the next shot; the source ends with the last."""
        while (shot := super().take(0.0)) is None:
            message = next(self._messages, None)
            if message is None:
                self.ended = True
                break
            self._now_s, topic, data = message
            if not self._link_is_away(self._now_s):
                self._on_message(topic, data, 0)
        return shot


def live_map(sequence: PosedFrames, faults: Faults, *, rate_hz: float = 30.0) -> Outcome:
    """Let a map grow from what a simulated robot sends, as it comes by the robot's own clock."""
    traffic = Traffic()
    with tempfile.TemporaryDirectory() as folder:
        source = _Handed(Played(sequence, faults, rate_hz=rate_hz), traffic)
        run = LiveRun(LiveRequest(source, BuildConfig(), Path(folder) / "m.npz", traffic=traffic))
        simap = run.run((), threading.Event())
    return Outcome(simap, traffic.placed, traffic.named, run.moved, traffic.dropped)


@dataclass(frozen=True)
class Delays:
    """How long pictures took."""

    shots: int
    delays_ms: np.ndarray
    """From the depth picture's publishing to its cells on the map; it waits for its masks, which are late by some."""
    busy_ms: float
    """Processor time for each picture, with that of the simulated robot."""


def delays(sequence: PosedFrames, *, rate_hz: float, size: tuple[int, int]) -> Delays:
    """Let a map grow over the network; pictures are read beforehand, so that playing costs only sending."""
    played, traffic = Played(sequence, Faults(), rate_hz=rate_hz, size=size), _Timed()
    played.prepare()
    with _growing(FoxgloveServer(), traffic) as (_, server, _):
        busy_s = time.process_time()
        play(played, server)
        busy_ms = (time.process_time() - busy_s) * 1000 / len(sequence)
    return Delays(traffic.placed, np.array(traffic.delays_ms), busy_ms)


@contextmanager
def _growing(server: Server, traffic: Traffic) -> Iterator[tuple[LiveRun, Server, list[SIMap]]]:
    """Let a map grow from what a server sends until the block ends, and wait for the map."""
    source, found = _source(server, traffic), []
    with tempfile.TemporaryDirectory() as folder:
        observers = (MapPublisher(source),)
        request = LiveRequest(
            source, BuildConfig(), Path(folder) / "m.npz", SILENT_S, observers=observers, traffic=traffic
        )
        run = LiveRun(request)
        thread = threading.Thread(target=lambda: found.append(run.run((), threading.Event())))
        thread.start()
        end_s = time.monotonic() + PATIENCE_S
        while source.chosen is None and time.monotonic() < end_s:
            time.sleep(0.05)
        if isinstance(server, FoxgloveServer):
            _wait(lambda: server.is_heard(DEPTH))
        else:
            time.sleep(1.0)
        yield run, server, found
        thread.join(PATIENCE_S + SILENT_S)
        source.close()
        server.close()
    if not found:
        raise InputError("the live map: expected one, found that its run had failed")


def _source(server: Server, traffic: Traffic) -> RobotSource:
    link: RobotLink = (ZenohLink if isinstance(server, ZenohServer) else FoxgloveLink)(server.address)
    return RobotSource(link, TopicNames(), color=False, traffic=traffic)


@dataclass(frozen=True)
class Growth:
    """What a map has grown to after so many frames."""

    frames: int
    memory_mb: float
    disk_mb: float
    kept: int
    area_m2: float


LOOK_EVERY = 300
"""Frames between two looks at the map: ten seconds at 30 Hz."""


def long_play(sequence: PosedFrames, frames: int, every: int, width: int) -> Iterator[Growth]:
    """Play a sequence over and over onto a map as fast as it takes it; return its growth now and then.

    No network is between them. Pictures are ``width`` pixels wide, and are put aside as those of a robot.
    """
    shots = [_small_shot(sequence, i, width) for i in range(len(sequence))]
    growing = GrowingMap(PlayedSequence(sequence), BuildConfig())
    for i in range(1, frames + 1):
        shot = replace(shots[i % len(shots)], stamp_ns=i * 10**9 // 30)
        growing.add(shot)
        if i % LOOK_EVERY == 0:
            growing.newest_map()
        if i % every == 0:
            simap = growing.newest_map() or growing.map_so_far()
            grid = simap.grid
            area_m2 = float(np.isfinite(grid.height_m).sum()) * grid.spec.cell_size_m**2
            yield Growth(i, *_memory_and_disk_mb(), growing.frames, area_m2)


def _small_shot(sequence: PosedFrames, index: int, width: int) -> Shot:
    """Return a frame as a shot, of every n-th pixel."""
    frame, masks = sequence.read(index), sequence.segmentation(index)
    k, n = frame.intrinsics, max(frame.depth_m.shape[1] // width, 1)
    fewer = lambda pixels: np.ascontiguousarray(pixels[n // 2 :: n, n // 2 :: n])  # noqa: E731
    depth_m, half = fewer(frame.depth_m), n // 2
    height, wide = depth_m.shape
    small = Intrinsics(wide, height, k.fx / n, k.fy / n, (k.cx - half) / n, (k.cy - half) / n)
    T_world_camera = frame.T_world_camera
    frame = Frame(0, frame.name, depth_m, T_world_camera, small)
    return Shot(frame, Segmentation(fewer(masks.ids), masks.segments), 0, T_odom_camera=T_world_camera)


def fixed_work() -> float:
    """Return the seconds that work takes, as long as this thread needs for one second of processor time."""
    began_s, busy_s = time.perf_counter(), time.thread_time()
    while time.thread_time() - busy_s < 1.0:
        pass
    return time.perf_counter() - began_s


def _memory_and_disk_mb() -> tuple[float, float]:
    """Return what this process holds in memory, and in files that have no name."""
    pages, disk = int(Path("/proc/self/statm").read_text().split()[1]), 0
    for one in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # closed by now
            disk += os.stat(one).st_blocks * 512 if "(deleted)" in os.readlink(one) else 0
    return pages * resource.getpagesize() / 2**20, disk / 2**20


@dataclass(frozen=True)
class Rides:
    """Times of rides by one protocol."""

    arrived: int
    first_ms: list[float]
    """From the command to its first goal at the robot, with the rehearsal."""
    goals_ms: list[float]
    """From each goal's being made to the robot."""


def rides(sequence: PosedFrames, simap: SIMap, server: Server, commands: Sequence[str]) -> Rides:
    """Let a simulated robot drive where commands lead, one after the other, on the map of its sequence."""
    played, stop, traffic = Played(sequence, Faults()), threading.Event(), Traffic()
    wheels, source = Wheels(played, server), _source(server, traffic)
    driver = Driver(source, lambda: simap, lambda: True, allowed=True)
    mover = threading.Thread(target=wheels.drive, args=(0.0, stop), kwargs={"mps": 2.0})
    mover.start()
    arrived, first_ms = 0, []
    try:
        driver.switch(True)
        _wait(lambda: (source.take(0.0), source.robot())[1] is not None)
        for command in commands:
            before, began_ns = len(wheels.times_ns), time.time_ns()
            driver.go(command)
            if not driver.words().startswith("Driving"):
                raise InputError(f"{command}: expected a drive, found: {driver.words()}")
            _wait(lambda before=before: len(wheels.times_ns) > before)
            first_ms.append((wheels.times_ns[before][1] - began_ns) / 1e6)
            _wait(lambda: not driver.words().startswith(("Driving", "Waiting")))
            arrived += driver.words() == "Arrived."
    finally:
        driver.close()
        stop.set()
        mover.join()
        source.close()
        server.close()
    return Rides(arrived, first_ms, [(came - made) / 1e6 for made, came in wheels.times_ns])


def _wait(until: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not until():
        if time.monotonic() > end_s:
            raise InputError("the simulated robot: expected an answer, found none")
        time.sleep(0.002)


def scenarios(seconds: float) -> dict[str, Faults]:
    """Return what is tried, for a sequence of this length."""
    return {
        "as it is": Faults(),
        "10 % of messages lost": Faults(drop=0.1),
        "server away for 1 s": Faults(restart_s=seconds * 0.6),
        "drift of 0.3 m, corrected": Faults(drift_m=0.3, correct_s=seconds / 4),
        "transforms 0.3 s late": Faults(tf_late_s=0.3),
        "no map to odom for 3 s": Faults(drift_m=0.3, correct_s=seconds / 4, map_stops_s=seconds / 2 - 1.5),
        "no transforms for 3 s": Faults(tf_stops_s=seconds / 2),
    }


def qualities(sequence: PosedFrames, maps: dict[str, SIMap], rate_hz: float) -> dict[str, tuple[float, float]]:
    """Return the panoptic quality of maps of a sequence, and that of builds of the frames that are on each.

    Under "" is the build of all frames, twice. All are judged by the same truth. A robot's map lies in the world of its
    poses, which is the sequence's map frame.
    """
    built = build_map(sequence)
    truth = truth_of(built, find_truth(sequence))
    quality = lambda one: score(replace(one, T_map_world=built.T_map_world), truth).overall.pq or 0.0  # noqa: E731
    found = {"": (quality(built), quality(built))}
    for name, one in maps.items():
        times = np.array([float(at) for at in one.frame_names])
        at = np.rint((times - times[-1]) * rate_hz).astype(int) + len(sequence) - 1  # the last frame is on each map
        found[name] = quality(one), quality(build_map(SomeFrames(sequence, at.clip(0).tolist())))
    return found
