"""Print how building compares with decoding the same images, and what the sliders cost. `make bench`."""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import tyro

from simaps_viz import build_map, open_sequence
from simaps_viz.evaluation.bench import bench_build, bench_sliders
from simaps_viz.progress import stage_progress
from simaps_viz.scenes.demo import ensure_demo
from simaps_viz.structures import SIMap
from simaps_viz.viewer.texture import map_image, pixels_per_cell
from simaps_viz.wiring import cache_folder

SHARED = Path(__file__).parents[1].parent / "shared" / "data"


@dataclass(frozen=True)
class Bench:
    """Which sequences to measure; without any: the embedded scene, and the shared scans where they are at hand."""

    sequences: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Sequence folders or manifests."""
    runs: int = 5
    """Measured runs of each piece of work."""


def paint(simap: SIMap) -> object:
    """Make the picture that the page shows."""
    return cv2.imencode(".png", map_image(simap, scale=pixels_per_cell(simap)))


def main(config: Bench) -> None:
    """Measure every sequence and print ratios."""
    paths = list(config.sequences)
    if not paths:
        with stage_progress() as progress:
            paths = [ensure_demo(cache_dir=cache_folder(), progress=progress)]
        found = (SHARED / name for name in ("aws-small-house/rgbd", "hololens-breakroom"))
        paths += [path for path in found if path.is_dir()]
    with tempfile.TemporaryDirectory() as scratch:
        for path in paths:
            sequence = open_sequence(path)
            for line in bench_build(sequence, runs=config.runs):
                sys.stdout.write(line + "\n")
            for line in bench_sliders(build_map(sequence), paint=paint, scratch=Path(scratch)):
                sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main(tyro.cli(Bench))
