"""Print what it costs to watch a map while it is built: `python apps/bench_live.py`. Needs Chromium."""

import statistics
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro
from benchmarks.live import plain_build, watched_build

from simaps_viz import open_sequence
from simaps_viz.app import workbench
from simaps_viz.console.progress import stage_progress
from simaps_viz.console.terminal import console
from simaps_viz.datasets.joined import JoinedFrames
from simaps_viz.scenes.demo import ensure_demo

TARGET = 1.30


@dataclass(frozen=True)
class BenchLive:
    """What to build."""

    sequence: Path | None = None
    """By default the embedded café."""
    times: int = 1
    """The sequence so many times over, for a longer build."""
    runs: int = 3
    """Pairs of a plain build and one that is watched."""


def main(config: BenchLive) -> None:
    """Build by turns with nobody looking and with a page open; from the start to the saved map."""
    console.quiet = True
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


if __name__ == "__main__":
    main(tyro.cli(BenchLive))
