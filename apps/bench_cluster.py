"""Print what several workers gain, what moves between them, and what saturates first. See docs/RELIABILITY.md."""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro
from benchmarks.cluster import bench_cluster

from simaps_viz import open_sequence
from simaps_viz.app.workbench import cache_folder
from simaps_viz.console.progress import stage_progress
from simaps_viz.scenes.demo import ensure_demo


@dataclass(frozen=True)
class BenchCluster:
    """What to build with how many workers."""

    sequence: tyro.conf.Positional[Path | None] = None
    """Sequence folder or manifest; by default the embedded café."""
    workers: tuple[int, ...] = (1, 2, 4)
    """Processes on this machine; the first is what the others are compared with."""
    copies: int = 4
    """Read the sequence so many times over."""


def main(config: BenchCluster) -> None:
    """Measure, and print each line as soon as it is known."""
    with stage_progress() as progress:
        path = config.sequence or ensure_demo(cache_dir=cache_folder(), progress=progress)
    with tempfile.TemporaryDirectory() as scratch:
        lines = bench_cluster(open_sequence(path), Path(scratch), workers=config.workers, copies=config.copies)
        for line in lines:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(tyro.cli(BenchCluster))
