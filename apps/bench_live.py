"""Print what it costs to watch a map while it is built: `python apps/bench_live.py`. Needs the extra "dev"."""

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import tyro

from simaps_viz import BuildConfig, open_sequence, page_bench, wiring
from simaps_viz.building import build_to_file
from simaps_viz.live_view import LiveSettings, live_workbench
from simaps_viz.progress import stage_progress
from simaps_viz.scenes.demo import ensure_demo

TARGET = 1.30


@dataclass(frozen=True)
class BenchLive:
    """What to build."""

    sequence: Path | None = None
    """By default the embedded café."""
    runs: int = 3
    """Pairs of a plain build and one that is watched."""


def main(config: BenchLive) -> None:
    """Build by turns with nobody looking and with a page open; from the first frame to the saved map."""
    with stage_progress(quiet=True) as progress, tempfile.TemporaryDirectory() as folder, page_bench.browser() as tabs:
        path = config.sequence or ensure_demo(cache_dir=wiring.cache_folder(), progress=progress)
        sequence, output = open_sequence(path), Path(folder) / "map.npz"
        ratios = []
        for run in range(config.runs + 1):  # the first one warms up
            start, busy = time.perf_counter(), time.process_time()
            build_to_file(sequence, "evidence", BuildConfig(), output, record=None, progress=progress, history=True)
            plain = time.perf_counter() - start, time.process_time() - busy
            settings = LiveSettings("evidence", BuildConfig(), output, port=0)
            with live_workbench(sequence, settings, progress) as (page, build):
                tab = tabs.new_page(viewport={"width": 1280, "height": 800})
                tab.goto(f"{page.url}/?fixedDpr=1")
                tab.wait_for_timeout(6000)
                build.start()
                while build.saved_s is None:
                    tab.wait_for_timeout(20)
                live = build.saved_s, build.busy_s
                tab.close()
            if run:
                ratios.append([a / b for a, b in zip(live, plain, strict=True)])
                sys.stdout.write(f"plain {plain[0]:.2f} s ({plain[1]:.2f} s busy), watched {live[0]:.2f} s "
                                 f"({live[1]:.2f} s busy)\n")  # fmt: skip
        wall, busy = (sorted(one)[len(one) // 2] for one in zip(*ratios, strict=True))
        sys.stdout.write(f"watched / plain: {wall:.2f} of the time, {busy:.2f} of the work, target {TARGET:.2f}\n")


if __name__ == "__main__":
    main(tyro.cli(BenchLive))
