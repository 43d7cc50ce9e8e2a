"""Print what it costs to watch a map while it is built: `python apps/bench_live.py`. Needs Chromium.

python apps/bench_live.py --robot     # how good and how fresh the map of a simulated robot is; needs no browser
"""

import statistics
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from benchmarks import live_robot
from benchmarks.live import plain_build, watched_build
from fake_robot import Faults

from simaps_viz import open_sequence
from simaps_viz.app import workbench
from simaps_viz.console.progress import stage_progress
from simaps_viz.console.terminal import console
from simaps_viz.datasets.source import JoinedFrames
from simaps_viz.scenes.demo import ensure_demo

TARGET = 1.30
DELAY_MS = 100, 250
"""Median and 95th percentile."""


@dataclass(frozen=True)
class BenchLive:
    """What to build."""

    sequence: Path | None = None
    """By default the embedded café."""
    times: int = 1
    """The sequence so many times over, for a longer build."""
    runs: int = 3
    """Pairs of a plain build and one that is watched."""
    robot: bool = False
    """Measure live maps of a simulated robot instead."""
    rate_hz: float = 30.0
    """Frames a second of that robot."""


def main(config: BenchLive) -> None:
    """Build by turns with nobody looking and with a page open; from the start to the saved map."""
    console.quiet = True
    if config.robot:
        robot(config)
        return
    with stage_progress(quiet=True) as progress, tempfile.TemporaryDirectory() as name:
        path = config.sequence or ensure_demo(cache_dir=workbench.cache_folder(), progress=progress)
        sequence, folder = JoinedFrames([open_sequence(path) for _ in range(config.times)]), Path(name)
        plain_build(sequence, folder, progress)  # warms up
        wall, busy = [], []
        for _ in range(max(config.runs, 3)):
            plain, watched = plain_build(sequence, folder, progress), watched_build(sequence, folder, progress)
            wall.append(watched.seconds / plain.seconds)
            busy.append(watched.busy_s / plain.busy_s)
            sys.stdout.write(
                f"plain {plain}; watched {watched} and the browser {watched.browser_s:.2f} s\n"
                f"  the watcher got {watched.sketches} sketches, {watched.maps} maps and {watched.frames} frames of "
                f"{len(sequence)} (recording: {watched.told} events) before the "
                f"{'whole map' if watched.complete else 'end, but NOT THE WHOLE MAP'}\n"
            )
            sys.stdout.flush()
    wall_ratio, busy_ratio = statistics.median(wall), statistics.median(busy)
    verdict = "ok" if max(wall_ratio, busy_ratio) <= TARGET else "OVER"
    sys.stdout.write(f"watched / plain, median of {len(wall)}: {wall_ratio:.2f} of the time, {busy_ratio:.2f} of the "
                     f"work, target {TARGET:.2f}  {verdict}\n")  # fmt: skip


def robot(config: BenchLive) -> None:
    """Let maps grow from a simulated robot, with faults, and compare them with the build of the same frames."""
    with stage_progress(quiet=True) as progress:
        path = config.sequence or ensure_demo(cache_dir=workbench.cache_folder(), progress=progress)
    sequence = open_sequence(path)
    maps = {}
    for name, faults in live_robot.scenarios(len(sequence) / config.rate_hz).items():
        found = live_robot.live_map(sequence, faults, rate_hz=config.rate_hz)
        maps[name] = found.simap
        counts = f"{found.shots} of {len(sequence)} frames, {found.named} with masks, {found.moved} placed again"
        sys.stdout.write(f"{name}: {counts}, dropped {found.dropped}\n")
        sys.stdout.flush()
    quality = live_robot.qualities(sequence, maps)
    for name, pq in quality.items():
        target = 0.02 if name == "as it is" else 0.05
        verdict = f"  {pq - quality['']:+.3f}, at worst -{target}  {'ok' if quality[''] - pq <= target else 'OVER'}"
        sys.stdout.write(f"PQ {pq:.3f}  {name}{verdict}\n" if name else f"PQ {pq:.3f}  the build\n")
    delays = live_robot.live_map(sequence, Faults(), rate_hz=config.rate_hz, size=(640, 480)).delays_ms
    median, p95 = (float(np.percentile(delays, q)) for q in (50, 95))
    verdict = "ok" if median <= DELAY_MS[0] and p95 <= DELAY_MS[1] else "OVER"
    sys.stdout.write(
        f"640x480: from publishing to the map {median:.0f} ms median, {p95:.0f} ms p95, of which "
        f"{Faults().masks_late_s * 1000:.0f} ms are the masks'; targets {DELAY_MS[0]} and {DELAY_MS[1]}  {verdict}\n"
    )


if __name__ == "__main__":
    main(tyro.cli(BenchLive))
