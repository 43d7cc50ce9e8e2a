"""Build a simulated building of any size, frame by frame, and print what it costs and what comes out."""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro
from benchmarks.building import bench_building
from benchmarks.large_building import SimulatedBuilding


@dataclass(frozen=True)
class Bench:
    """Nothing of the building lies on disk; its log and map do, in a scratch folder that is removed in the end."""

    side: float = 100.0
    """Of the building, metres; 10 m a room."""
    frames: int | None = None
    """How many; by default 80 for each room."""
    seed: int = 0
    """Of the furniture."""
    scratch: Path | None = None
    """Where the scratch folder goes; 25 kB a frame are needed."""


def main(config: Bench) -> None:
    """Measure, and print each line as soon as it is known."""
    building = SimulatedBuilding(config.side, config.frames, seed=config.seed)
    with tempfile.TemporaryDirectory(dir=config.scratch) as scratch:
        for line in bench_building(building, scratch=Path(scratch)):
            sys.stdout.write(line + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(tyro.cli(Bench))
