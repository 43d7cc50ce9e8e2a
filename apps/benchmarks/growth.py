"""What grows with what: more frames, more floor, more objects of one class."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from benchmarks.points import held_bytes
from benchmarks.timing import measure, times
from numpy.typing import NDArray

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.source import FrameSource
from simaps_viz.structures import Frame, Segmentation, SIMap

METHODS: tuple[str, ...] = ("evidence", "paper")
APART_M = 1.0
"""Between the copies of a scene's map: farther than any pair of cells whose evidence is gathered."""


@dataclass(frozen=True, eq=False)
class Posed:
    """Decoded frames as a sequence, so that nobody's clock counts decoding."""

    name: str
    path: Path
    frames: tuple[Frame, ...]
    segmentations: tuple[Segmentation, ...]
    poses: NDArray
    """float64 [n, 4, 4], T_world_camera; those of ``frames`` do not count."""
    T_map_world: NDArray
    labels: tuple[str, ...]
    is_thing: tuple[bool, ...]
    segmentation_source: str
    simulated: bool

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Numbers."""
        return tuple(f"{index:06d}" for index in range(len(self)))

    def described(self) -> bytes:
        """Return the camera; what else the images mean is in them."""
        return repr(self.frames[0].intrinsics).encode()

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Return a frame under its new number; there is no colour."""
        frame = self.frames[index % len(self.frames)]
        return replace(frame, index=index, name=self.frame_names[index], T_world_camera=self.poses[index], color=None)

    def segmentation(self, index: int) -> Segmentation:
        """Return a frame's segmentation."""
        return self.segmentations[index % len(self.frames)]


def decoded(sequence: FrameSource, frames: int) -> Posed:
    """Decode some frames of a sequence, spread evenly over it."""
    chosen = np.linspace(0, len(sequence) - 1, min(frames, len(sequence))).astype(int).tolist()
    return Posed(
        sequence.name, sequence.path,
        tuple(sequence.read(i) for i in chosen), tuple(sequence.segmentation(i) for i in chosen),
        sequence.poses[chosen], sequence.T_map_world, sequence.labels, sequence.is_thing,
        sequence.segmentation_source, sequence.simulated,
    )  # fmt: skip


def repeated(sequence: Posed, times_over: int) -> Posed:
    """Return all frames again and again, from the same poses."""
    return replace(sequence, poses=np.tile(sequence.poses, (times_over, 1, 1)))


def tiled(sequence: Posed, simap: SIMap, side: int) -> Posed:
    """Return side x side copies of a scene, apart on one floor.

    Args:
        sequence: the scene.
        simap: its map, for the scene's extent.
        side: copies along x, and along y.
    """
    size = simap.spec.cell_size_m
    step = [int(np.ceil(cells + APART_M / size)) * size for cells in (simap.spec.cols, simap.spec.rows)]
    T_map_camera = sequence.T_map_world @ sequence.poses
    moved = []
    for row in range(side):
        for col in range(side):
            copy = T_map_camera.copy()
            copy[:, :2, 3] += (col * step[0], row * step[1])
            moved.append(copy)
    return replace(sequence, poses=np.linalg.inv(sequence.T_map_world) @ np.concatenate(moved))


def bench_frames(
    sequence: FrameSource, *, frames: int = 40, factors: Sequence[int] = (1, 4, 16), runs: int = 3
) -> Iterator[str]:
    """Build from the same frames several times over: what a frame costs, and what each further frame costs."""
    base = decoded(sequence, frames)
    n = len(base)
    yield f"Frames, {sequence.name}: {n} decoded frames, again and again; whole maps, medians of {runs} runs in turn"
    for method in METHODS:
        works = {factor: _building(repeated(base, factor), method) for factor in factors}
        wall = {factor: cost.wall for factor, cost in measure(works, runs=runs).items()}
        first = 1000 * wall[factors[0]] / (n * factors[0])
        for factor in factors:
            each = 1000 * wall[factor] / (n * factor)
            yield (
                f"  {times(each / first):>8}  time a frame, {method}, frames x {factor}: {each:.2f} ms "
                f"({1000 * wall[factor]:,.0f} ms for {n * factor})"
            )
        more = [1000 * (wall[b] - wall[a]) / (n * (b - a)) for a, b in pairwise(factors)]
        yield (
            f"  {times(more[-1] / more[0]):>8}  time of each further frame, {method}: "
            + ", ".join(f"{ms:.2f} ms from x {a} to x {b}" for ms, (a, b) in zip(more, pairwise(factors), strict=True))
        )


def bench_area(sequence: FrameSource, *, frames: int = 24, side: int = 4, runs: int = 3) -> Iterator[str]:
    """Build one scene, and copies of it: time and memory against area, and what becomes of the instances."""
    base, copies = decoded(sequence, frames), side * side
    yield (
        f"Area, {sequence.name}: {len(base)} decoded frames of one scene, and of {copies} copies {APART_M:g} m apart; "
        f"medians of {runs} runs in turn"
    )
    for method in METHODS:
        alone = build_map(base, BuildConfig(method=method))
        large = tiled(base, alone, side)
        costs = measure({1: _building(base, method), copies: _building(large, method)}, runs=runs, warm=False)
        together = build_map(large, BuildConfig(method=method))
        yield from _compared(alone, together, costs[1].wall, costs[copies].wall, copies)


def _building(sequence: Posed, method: str) -> Callable[[], object]:
    return lambda: build_map(sequence, BuildConfig(method=method))


def _compared(alone: SIMap, together: SIMap, alone_s: float, together_s: float, copies: int) -> Iterator[str]:
    """Describe how the map of the copies compares with the map of the scene."""
    square_m = [np.count_nonzero(m.grid.observations) * m.spec.cell_size_m**2 for m in (alone, together)]
    held_mb = [held_bytes(replace(m, T_map_camera=np.zeros(0))) / 1e6 for m in (alone, together)]
    found = len(alone.instances), len(together.instances)
    yield (
        f"  {times(square_m[1] / square_m[0]):>8}  area seen, {alone.method}: "
        f"{square_m[0]:,.0f} and {square_m[1]:,.0f} m2, grids of {alone.spec.rows} x {alone.spec.cols} and "
        f"{together.spec.rows} x {together.spec.cols} cells"
    )
    yield (
        f"  {times(together_s / alone_s):>8}  time of the whole map, {alone.method}: "
        f"{1000 * alone_s:,.0f} and {1000 * together_s:,.0f} ms"
    )
    yield (
        f"  {times(held_mb[1] / held_mb[0]):>8}  memory of the whole map, {alone.method}: "
        f"{held_mb[0]:.2f} and {held_mb[1]:.2f} MB"
    )
    yield (
        f"  {times(found[1] / max(found[0], 1)):>8}  instances, {alone.method}: {found[0]} and {found[1]}; "
        f"{copies} x {found[0]} = {copies * found[0]} if the copies did not touch each other's partition"
    )
