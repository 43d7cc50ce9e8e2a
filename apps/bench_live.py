"""Print what it costs to watch a map while it is built: `python apps/bench_live.py`. Needs Chromium.

What follows needs no browser; its robot is simulated.

    python apps/bench_live.py --robot         # how good its map is, with faults
    python apps/bench_live.py --delays 5      # how fresh it is
    python apps/bench_live.py --goals         # how soon goals reach it, and whether it arrives
    python apps/bench_live.py --minutes 60    # memory, while a sequence is played over and over, as fast as it goes
    python apps/bench_live.py --changes 20    # what is reported when one chair was moved since an earlier map
"""

import statistics
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from benchmarks import live_changes, live_robot
from benchmarks.live import plain_build, watched_build
from fake_robot import Faults, FoxgloveServer, ZenohServer

from simaps_viz import open_sequence
from simaps_viz.app import workbench
from simaps_viz.build.pipeline import build_map
from simaps_viz.console.progress import stage_progress
from simaps_viz.console.terminal import console
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import JoinedFrames
from simaps_viz.scenes.demo import ensure_demo

TARGET = 1.30
DELAY_MS = 100, 250
"""Median and 95th percentile."""
GOAL_MS = 200
GROWTH = 0.05
"""Of memory in the second half, at most, beyond that of the map's area."""
COMMANDS = ("go to the farthest chair",) * 6


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
    only: str = ""
    """Of the faults, only those that have this in their names."""
    delays: int = 0
    """Measure how long its pictures take to the map, so many times."""
    goals: bool = False
    """Measure goals on their way to a simulated robot, by both protocols."""
    minutes: int = 0
    """Measure the memory of a live map of so many minutes, which are played as fast as the map takes them."""
    width: int = 80
    """Pixels across the pictures of that map."""
    changes: int = 0
    """Count what is reported of a moved chair, in so many pairs of drives with unsteady poses."""


def main(config: BenchLive) -> None:
    """Build by turns with nobody looking and with a page open; from the start to the saved map."""
    console.quiet = True
    measures = ((config.robot, robot), (config.delays, delays), (config.goals, goals), (config.minutes, loop))
    for asked, measure in measures:
        if asked:
            with stage_progress(quiet=True) as progress:
                path = config.sequence or ensure_demo(cache_dir=workbench.cache_folder(), progress=progress)
            measure(config, open_sequence(path))
            return
    if config.changes:
        changes(config)
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


def robot(config: BenchLive, sequence: PosedFrames) -> None:
    """Let maps grow from a simulated robot, with faults, and compare them with builds of all and of the same frames."""
    along_m = float(np.linalg.norm(np.diff(sequence.poses[:, :3, 3], axis=0), axis=1).sum())
    seconds = len(sequence) / config.rate_hz
    sys.stdout.write(f"{len(sequence)} frames in {seconds:.0f} s, at {along_m / seconds:.1f} m/s on average\n")
    maps = {}
    for name, faults in live_robot.scenarios(len(sequence) / config.rate_hz).items():
        if config.only not in name:
            continue
        found = live_robot.live_map(sequence, faults, rate_hz=config.rate_hz)
        maps[name] = found.simap
        counts = f"{found.shots} of {len(sequence)} frames, {found.named} with masks, {found.moved} placed again"
        sys.stdout.write(f"{name}: {counts}, dropped {found.dropped}\n")
        sys.stdout.flush()
    quality = live_robot.qualities(sequence, maps, config.rate_hz)
    whole, _ = quality.pop("")
    sys.stdout.write(f"PQ {whole:.3f}  the build\n")
    for name, (pq, same) in quality.items():
        target = 0.02 if name == "as it is" else 0.05
        verdict = f"{pq - whole:+.3f}, at worst -{target}  {'ok' if whole - pq <= target else 'OVER'}"
        sys.stdout.write(f"PQ {pq:.3f}  {name}  {verdict}; the build of the same frames {same:.3f}\n")


def delays(config: BenchLive, sequence: PosedFrames) -> None:
    """Measure how long pictures take to the map; of several runs the best shows what the program needs by itself."""
    best = [np.inf, np.inf]
    for run in range(config.delays):
        fixed_s = live_robot.fixed_work()
        found = live_robot.delays(sequence, rate_hz=config.rate_hz, size=(640, 480))
        spread = [float(np.percentile(found.delays_ms, q)) for q in (50, 95)]
        best = min(best, spread, key=lambda one: one[1])
        sys.stdout.write(
            f"run {run + 1}: from publishing to the map {spread[0]:.0f} ms median, {spread[1]:.0f} ms p95, "
            f"{found.busy_ms:.0f} ms of processor time a picture with the simulated robot's; {found.shots} of "
            f"{len(sequence)} frames; work that takes 1.0 s alone took {fixed_s:.1f} s just before\n"
        )
        sys.stdout.flush()
    verdict = "ok" if best[0] <= DELAY_MS[0] and best[1] <= DELAY_MS[1] else "OVER"
    sys.stdout.write(
        f"640x480, best of {config.delays}: {best[0]:.0f} ms median, {best[1]:.0f} ms p95, of which "
        f"{Faults().masks_late_s * 1000:.0f} ms are the masks'; targets {DELAY_MS[0]} and {DELAY_MS[1]}  {verdict}\n"
    )


def goals(config: BenchLive, sequence: PosedFrames) -> None:
    """Let a simulated robot drive on the map of a build."""
    del config
    simap = build_map(sequence)
    for server in (FoxgloveServer(), ZenohServer(nav2=True)):
        found = live_robot.rides(sequence, simap, server, COMMANDS)
        ok = max(found.goals_ms) <= GOAL_MS and found.arrived == len(COMMANDS)
        sys.stdout.write(
            f"{server.address.partition(':')[0]}: {len(found.goals_ms)} goals came to the robot in "
            f"{_spread(found.goals_ms)}, target {GOAL_MS}; {found.arrived} of {len(COMMANDS)} drives arrived  "
            f"{'ok' if ok else 'OVER'}\n"
            f"  from the command to its first goal there, with the rehearsal: {_spread(found.first_ms)}\n"
        )
        sys.stdout.flush()


def _spread(times_ms: list[float]) -> str:
    return f"{statistics.median(times_ms):.0f} ms (median; {max(times_ms):.0f} at most)"


def loop(config: BenchLive, sequence: PosedFrames) -> None:
    """Play a sequence over and over, and look at memory; it must be flat once the whole place was seen often."""
    seen, began_s = [], time.monotonic()
    frames = config.minutes * 60 * 30
    for one in live_robot.long_play(sequence, frames, max(frames // 36, 1), config.width):
        seen.append(one)
        sys.stdout.write(
            f"frame {one.frames} after {time.monotonic() - began_s:.0f} s: {one.memory_mb:.0f} MB, on disk "
            f"{one.disk_mb:.0f} MB, {one.kept} frames kept, {one.area_m2:.1f} m2\n"
        )
        sys.stdout.flush()
    before, after = seen[len(seen) // 2 - (len(seen) > 1)], seen[-1]
    growth = after.memory_mb / before.memory_mb - max(after.area_m2 / before.area_m2, 1.0)
    sys.stdout.write(
        f"{frames} frames, {config.minutes} minutes at 30 Hz: memory grew by {growth:+.3f} more than the area in the "
        f"second half, target {GROWTH}  {'ok' if growth <= GROWTH else 'OVER'}\n"
    )


def changes(config: BenchLive) -> None:
    """Go on with an earlier map after a chair was moved, with steady poses once, and with unsteady ones."""
    for off_m, off_deg, times in ((0.0, 0.0, 1), (0.02, 1.0, config.changes)):
        right, wrong = 0, Counter[str]()
        for seed in range(times):
            found, others = live_changes.drives(off_m, off_deg, seed)
            right, wrong = right + found, wrong + others
        sys.stdout.write(
            f"poses off by {off_m * 100:.0f} cm and {off_deg:.0f} deg: the chair is reported moved in {right} of "
            f"{times} pairs of drives; reported and wrong: {dict(wrong) or 'nothing'}\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main(tyro.cli(BenchLive))
