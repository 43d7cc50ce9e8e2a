"""The whole bench, section by section, in the order it is printed."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from benchmarks.graphs import bench_louvain
from benchmarks.growth import bench_area, bench_frames
from benchmarks.mapping import METHODS, bench_build, bench_surface
from benchmarks.objects import bench_objects
from benchmarks.planner import bench_commands, bench_planner
from benchmarks.points import bench_memory, bench_points
from benchmarks.sliders import bench_sliders

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.structures import Pose2, SIMap

COMMANDS = (
    "go to the {a}",
    "go to the {a} nearest the {b}",
    "move between the {a} and the {b}",
    "go to the {b}, then to the second closest {a}",
    "turn left and face the {a}",
)


def bench_lines(
    sequences: Sequence[PosedFrames],
    *,
    paint: Callable[[SIMap], object],
    start: Callable[[SIMap], Pose2],
    scratch: Path,
    runs: int = 3,
) -> Iterator[str]:
    """Run every bench.

    Args:
        sequences: what building is measured on; the second (or the only one) is looked at more closely.
        paint: makes the picture of a map as the page shows it, encoded.
        start: says where commands are given.
        scratch: a folder for map files.
        runs: measured runs of each piece of work.
    """
    began = time.perf_counter()
    yield (
        f"SI Maps bench on {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}. A ratio compares two things measured "
        "in turn in this very run; with a load beyond the cores, trust CPU times and ratios, not wall clocks."
    )
    yield from _section("1. Building, against decoding the same images")
    for sequence in sequences:
        yield from bench_build(sequence, runs=runs)
        yield from bench_surface(sequence, runs=runs)
    chosen = sequences[min(1, len(sequences) - 1)]
    maps = [build_map(chosen, BuildConfig(method=method)) for method in METHODS]
    evidence, paper = maps
    yield from _section("2. Points, against a loop over single points")
    yield from bench_points(chosen, runs=runs)
    yield from _section("3. Memory")
    yield from bench_memory(evidence, scratch=scratch)
    yield from _section("4. Louvain")
    yield from bench_louvain(paper.graphs, name=f"{chosen.name}, paper", runs=runs)
    yield from _section("5. Planning, and whole answers to commands")
    yield from bench_planner()
    yield from bench_commands(evidence, commands_for(evidence), start(evidence), name=f"{chosen.name}, evidence")
    yield from _section("6. Sliders")
    for simap in maps:
        yield from bench_sliders(simap, paint=paint, runs=runs)
    yield from _section("7. Growth")
    yield from bench_frames(chosen, runs=runs)
    yield from bench_area(chosen, runs=runs)
    yield from bench_objects(runs=runs)
    yield f"\nThe whole bench took {time.perf_counter() - began:.0f} s; load at the end {os.getloadavg()[0]:.1f}."


def commands_for(simap: SIMap) -> list[str]:
    """Fill in the two classes with most objects, of those with names of one word."""
    names = [name for name in simap.counts() if " " not in name]
    a, b = names[0], names[1 % len(names)]
    return [command.format(a=a, b=b) for command in COMMANDS]


def _section(title: str) -> Iterator[str]:
    yield f"\n{title}"
