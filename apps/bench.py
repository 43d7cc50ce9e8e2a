"""Print every claim about speed and memory, as ratios within one run. `make bench`."""

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import tyro
from benchmarks.report import bench_lines

from simaps_viz import open_sequence
from simaps_viz.app.workbench import cache_folder, start_pose
from simaps_viz.console.progress import stage_progress
from simaps_viz.drawing.texture import map_image, pixels_per_cell
from simaps_viz.scenes.demo import ensure_demo
from simaps_viz.structures import SIMap

SHARED = Path(__file__).parents[1].parent / "shared" / "data"
SCANS = ("aws-small-house/rgbd", "hololens-breakroom")


@dataclass(frozen=True)
class Bench:
    """What to measure; without sequences: the embedded café, and the shared scans where they are at hand."""

    sequences: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Sequence folders or manifests; the second, or the only one, is looked at more closely."""
    runs: int = 3
    """Measured runs of each piece of work, after one to warm up."""


def paint(simap: SIMap) -> object:
    """Make the picture that the page shows."""
    return cv2.imencode(".png", map_image(simap, scale=pixels_per_cell(simap)))


def sequence_paths(config: Bench) -> Iterator[Path]:
    """Return the sequences to measure; makes the embedded scene when it is not there yet."""
    yield from config.sequences
    if not config.sequences:
        with stage_progress() as progress:
            yield ensure_demo(cache_dir=cache_folder(), progress=progress)
        yield from (SHARED / name for name in SCANS if (SHARED / name).is_dir())


def main(config: Bench) -> None:
    """Measure, and print each line as soon as it is known."""
    sequences = [open_sequence(path) for path in sequence_paths(config)]
    with tempfile.TemporaryDirectory() as scratch:
        for line in bench_lines(sequences, paint=paint, start=start_pose, scratch=Path(scratch), runs=config.runs):
            sys.stdout.write(line + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(tyro.cli(Bench))
