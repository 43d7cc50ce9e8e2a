"""Print how fast the page answers, against what is promised: `python apps/bench_page.py`. Needs the extra "dev"."""

import os
import sys
from dataclasses import dataclass

import tyro
from benchmarks import page as page_bench
from benchmarks.large_maps import large_map, surfaced

from simaps_viz import BuildConfig, open_sequence
from simaps_viz.app import workbench
from simaps_viz.console.progress import stage_progress
from simaps_viz.scenes.demo import ensure_demo


@dataclass(frozen=True)
class BenchPage:
    """What to measure."""

    runs: int = 5
    """Measured runs of each, after one to warm up."""
    million: int = 1000
    """Rows and columns of the map of a million cells."""
    huge: int = 4000
    """Rows and columns of a map with ten thousand objects; 0 leaves it out."""
    room: int = 800
    """Rows and columns of a map of two million points in the 3-D view; 0 leaves it out."""


def main(config: BenchPage) -> None:
    """Measure, and print each line as soon as it is known."""
    with stage_progress() as progress:
        sequence = open_sequence(ensure_demo(cache_dir=workbench.cache_folder(), progress=progress))
        cafe, recording = workbench.cached_build(sequence, "evidence", BuildConfig(), progress)
    million, runs = large_map(config.million, config.million, 2500), config.runs
    sys.stdout.write(f"{os.cpu_count()} processors, {os.getloadavg()[0]:.1f} busy before the start\n")
    with page_bench.browser() as browser:
        say(page_bench.first_page(browser, cafe, recording, runs=runs))
        say(page_bench.first_page(browser, million, None, runs=runs))
        say(page_bench.slider(browser, million, runs=runs))
        say(page_bench.click(browser, cafe, recording, runs=runs))
        say(page_bench.click(browser, million, None, runs=runs))
        say(*page_bench.frames_in_step(browser, cafe, recording, runs=runs))
        sys.stdout.write(f"{page_bench.at_rest(browser, million)}\n")
        if config.room:
            few, many = (surfaced(large_map(side, side, side * side // 400)) for side in (100, config.room))
            for line in page_bench.room(browser, few, many):
                sys.stdout.write(f"{line}\n")
                sys.stdout.flush()
        if config.huge:
            huge = large_map(config.huge, config.huge, 10_500, edges=False)
            say(page_bench.first_page(browser, huge, None, runs=min(runs, 2)))
            say(page_bench.slider(browser, huge, runs=min(runs, 3), target_s=2.0))


def say(*timings: page_bench.Timing) -> None:
    """Write lines."""
    for timing in timings:
        sys.stdout.write(f"{timing}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(tyro.cli(BenchPage))
