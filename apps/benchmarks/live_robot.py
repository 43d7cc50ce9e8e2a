"""How good and how fresh a live map is: a simulated robot plays a sequence, as it is and with faults."""

import tempfile
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from fake_robot import Faults, FoxgloveServer, Played, play

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.evaluation.quality import score
from simaps_viz.evaluation.truth import find_truth, truth_of
from simaps_viz.live.foxglove import FoxgloveLink
from simaps_viz.live.out import MapPublisher
from simaps_viz.live.robot import RobotSource
from simaps_viz.live.run import LiveRequest, LiveRun
from simaps_viz.live.source import Shot, Traffic
from simaps_viz.live.topics import TopicNames
from simaps_viz.structures import SIMap

PATIENCE_S = 60.0
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
    delays_ms: np.ndarray
    """From the depth picture's publishing to its cells on the map; it waits for its masks, which are late by some."""


class _Timed(Traffic):
    def __init__(self) -> None:
        super().__init__()
        self.delays_ms: list[float] = []

    def place(self, shot: Shot) -> None:
        super().place(shot)
        self.delays_ms.append((time.time_ns() - shot.sent_ns) / 1e6)


def live_map(
    sequence: PosedFrames, faults: Faults, *, rate_hz: float = 30.0, size: tuple[int, int] | None = None
) -> Outcome:
    """Let a map grow from a simulated robot; pictures are read beforehand, so that playing costs only sending."""
    played = Played(sequence, faults, rate_hz=rate_hz, size=size)
    played.prepare()
    server, traffic = FoxgloveServer(), _Timed()
    source = RobotSource(FoxgloveLink(server.address), TopicNames(), color=False, traffic=traffic)
    found: list[SIMap] = []
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
        time.sleep(1.0)
        play(played, server)
        thread.join(PATIENCE_S + SILENT_S)
        source.close()
        server.close()
    if not found:
        raise InputError("the live map: expected one, found that its run had failed")
    return Outcome(found[0], traffic.placed, traffic.named, run.moved, traffic.dropped, np.array(traffic.delays_ms))


def scenarios(seconds: float) -> dict[str, Faults]:
    """Return what is tried, for a sequence of this length."""
    return {
        "as it is": Faults(),
        "10 % of messages lost": Faults(drop=0.1),
        "server away for 1 s": Faults(restart_s=seconds * 0.6),
        "drift of 0.3 m, corrected": Faults(drift_m=0.3, correct_s=seconds / 4),
        "transforms 0.3 s late": Faults(tf_late_s=0.3),
        "no transforms for 3 s": Faults(tf_stops_s=seconds / 2),
    }


def qualities(sequence: PosedFrames, maps: dict[str, SIMap]) -> dict[str, float]:
    """Return the panoptic quality of maps of a sequence, and under "" that of its build, all by the same truth.

    A robot's map lies in the world of its poses, which is the sequence's map frame.
    """
    built = build_map(sequence)
    truth = truth_of(built, find_truth(sequence))
    placed = {name: replace(one, T_map_world=built.T_map_world) for name, one in maps.items()}
    return {name: score(one, truth).overall.pq or 0.0 for name, one in {"": built, **placed}.items()}
