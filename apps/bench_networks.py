"""Print what everything around a network adds to `session.run` alone, and how its masks agree with precomputed ones."""

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from benchmarks.networks import bench_agreement, bench_network

from simaps_viz import open_sequence

DATA = Path(__file__).parents[1].parent / "shared" / "data"


@dataclass(frozen=True)
class BenchNetworks:
    """Which network on which frames; without arguments: the shared detector on the shared scans."""

    network: tyro.conf.Positional[Path] = DATA / "yolo11n-seg-int8" / "yolo11n-seg_int8.onnx"
    """Network (.onnx)."""
    sequences: tyro.conf.Positional[tuple[Path, ...]] = (
        DATA / "hololens-breakroom",
        DATA / "aws-small-house" / "rgbd" / "sequence-pred.json",
    )
    """Sequences with masks of their own to compare with."""
    frames: int = 40
    """Of each sequence, evenly spread."""
    runs: int = 5
    """Measured runs of each piece of work, in turn, after one to warm up."""


def main(config: BenchNetworks) -> None:
    """Measure, and print each line as soon as it is known."""
    for path in config.sequences:
        sequence = open_sequence(path)
        for line in bench_network(sequence, config.network, frames=config.frames, runs=config.runs):
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
        sys.stdout.write(bench_agreement(sequence, config.network, frames=config.frames) + "\n")


if __name__ == "__main__":
    main(tyro.cli(BenchNetworks))
