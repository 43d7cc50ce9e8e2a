"""Print what everything around a network adds to `session.run` alone, and how its masks agree with precomputed ones."""

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from benchmarks.networks import bench_agreement, bench_chosen, bench_network, bench_turned

from simaps_viz import open_sequence
from simaps_viz.evaluation.evaluate import PRECOMPUTED
from simaps_viz.evaluation.run import open_for_evaluation

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
    chosen: bool = False
    """Only compare maps of all masks with those of the frames that --segment-every chooses: the shared house and the
    embedded café, exact and with simulated errors of three seeds, and the sequences with their own masks."""
    turned: bool = False
    """Only count what is found when the camera was held turned by 90, 180 and 270 degrees: in the sequences, and in the
    embedded café."""


def main(config: BenchNetworks) -> None:
    """Measure, and print each line as soon as it is known."""
    if config.chosen:
        house, cafe = open_sequence(DATA / "aws-small-house" / "rgbd"), open_for_evaluation("demo", None)
        cases = [(place, errors) for place in (house, cafe) for errors in ("none", "light", "medium")]
        cases += [(open_sequence(path), PRECOMPUTED) for path in config.sequences]
        for sequence, errors in cases:
            seeds = range(3 if errors in ("light", "medium") else 1)
            sys.stdout.write(bench_chosen(sequence, errors, seeds) + "\n")
            sys.stdout.flush()
        return
    if config.turned:
        for sequence in (*map(open_sequence, config.sequences), open_for_evaluation("demo", None)):
            sys.stdout.write(bench_turned(sequence, config.network, frames=config.frames) + "\n")
            sys.stdout.flush()
        return
    for path in config.sequences:
        sequence = open_sequence(path)
        for line in bench_network(sequence, config.network, frames=config.frames, runs=config.runs):
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
        sys.stdout.write(bench_agreement(sequence, config.network, frames=config.frames) + "\n")


if __name__ == "__main__":
    main(tyro.cli(BenchNetworks))
