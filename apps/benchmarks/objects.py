"""What becomes of one chair when there are ten of them: a synthetic set of readings, and copies of it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from benchmarks.timing import measure, times
from numpy.typing import NDArray

from simaps_viz.mapping.evidence import EvidenceSettings, pair_graphs
from simaps_viz.mapping.observations import Readings
from simaps_viz.mapping.paper import class_graphs, partition_grid
from simaps_viz.mapping.partition import applied_steps, instance_of_community
from simaps_viz.mapping.pooling import partition_evidence
from simaps_viz.structures import CellGraph, Grid, GridSpec, MergeLog

CHAIR_CELLS, GAP_CELLS, FRAMES = 10, 3, 24
"""A chair of 10 x 10 cells of 5 cm, 3 cells from the next, seen by 24 frames."""
K_PERCENT, AFFINITY = 5.0, 0.6
"""What both methods join by when nobody moves a slider."""


@dataclass(frozen=True, eq=False)
class Chairs:
    """Copies of one chair in a row, and what each method makes of the frames."""

    grid: Grid
    copies: int
    evidence: tuple[CellGraph, ...]
    paper: tuple[CellGraph, ...]


@dataclass(frozen=True, eq=False)
class Cut:
    """One method's answer."""

    community: NDArray
    """int32 [copies, chair, chair], finest communities."""
    instance: NDArray
    """int32 [copies, chair, chair], after joining."""


def chairs_in_a_row(copies: int, *, seed: int = 0) -> Chairs:
    """Make the readings of some copies of one chair, and the graphs of both methods.

    Every frame sees a window of the chair, and one frame in four takes it for two segments. All copies are seen in the
    same way, so whatever tells one from another is the method's doing.
    """
    step = CHAIR_CELLS + GAP_CELLS
    spec = GridSpec(CHAIR_CELLS, copies * step, 0.05, 0.0, 0.0)
    segments = [_seen_as(np.random.default_rng((seed, frame))) for frame in range(FRAMES)]
    label = np.zeros(spec.shape, np.int16)
    observations = np.zeros(spec.shape, np.int32)
    cell, frame_of, segment_of = [], [], []
    for frame, seen in enumerate(segments):
        row, col = np.nonzero(seen)
        for copy in range(copies):
            cell.append(row * spec.cols + col + copy * step)
            frame_of.append(np.full(len(row), frame))
            segment_of.append(seen[row, col] + 2 * copy)
            observations[row, col + copy * step] += 1
            label[row, col + copy * step] = 1
    cells, frames, of = (np.concatenate(part).astype(np.int32) for part in (cell, frame_of, segment_of))
    height = np.where(label > 0, 0.45, np.nan).astype(np.float32)
    grid = Grid(spec, ("none", "chair"), (False, True), label, height, height, observations)
    ones = np.ones(len(cells), np.float32)
    readings = Readings(cells, frames, of, ones.astype(np.int16), ones, 0.45 * ones)
    return Chairs(grid, copies, pair_graphs(grid, readings, EvidenceSettings()), _paper_graphs(grid, readings))


def _seen_as(random: np.random.Generator) -> NDArray:
    """Return a frame's segment of every cell of the chair, int [chair, chair], 0 = not seen."""
    n = CHAIR_CELLS
    rows, cols = np.sort(random.integers(0, n + 1, (2, 2)), axis=1)
    seen = np.zeros((n, n), int)
    low, high = np.minimum((rows[0], cols[0]), n // 2), np.maximum((rows[1], cols[1]), n // 2 + 2)
    seen[low[0] : high[0], low[1] : high[1]] = 1
    if random.random() < 0.25:
        seen[:, n // 2 :][seen[:, n // 2 :] > 0] = 2
    return seen


def _paper_graphs(grid: Grid, readings: Readings) -> tuple[CellGraph, ...]:
    """Count the neighbouring cells of one segment, as a frame with one pixel a cell would."""
    segment = np.zeros((int(readings.frame.max()) + 1, *grid.spec.shape), np.int32)
    segment.reshape(len(segment), -1)[readings.frame, readings.cell] = readings.segment
    right = ((segment[:, :, :-1] == segment[:, :, 1:]) & (segment[:, :, 1:] > 0)).sum(axis=0)
    down = ((segment[:, :-1] == segment[:, 1:]) & (segment[:, 1:] > 0)).sum(axis=0)
    links, counts = [], []
    for found, (d_row, d_col) in ((right, (0, 1)), (down, (1, 0))):
        row, col = np.nonzero(found)
        links.append(np.stack([row, col, row + d_row, col + d_col], axis=1))
        counts.append(found[row, col])
    joined = np.concatenate(links)
    return class_graphs(grid, joined, np.ones(len(joined), np.int16), np.concatenate(counts))


def cut_evidence(chairs: Chairs) -> Cut:
    """Partition as method evidence does."""
    found = partition_evidence(chairs.grid, chairs.evidence, resolution=1.0, seed=0)
    return _joined(chairs, *found, threshold=AFFINITY)


def cut_paper(chairs: Chairs) -> Cut:
    """Partition as method paper does."""
    found = partition_grid(chairs.grid, chairs.paper, resolution=1.0, seed=0)
    return _joined(chairs, *found, threshold=K_PERCENT / 100.0)


def _joined(chairs: Chairs, community: NDArray, log: MergeLog, *, threshold: float) -> Cut:
    instance_of = instance_of_community(log, applied_steps(log, threshold), int(community.max()))
    starts = range(0, chairs.grid.spec.cols, CHAIR_CELLS + GAP_CELLS)
    chair = np.stack([community[:, start : start + CHAIR_CELLS] for start in starts])
    return Cut(chair, instance_of[chair])


def same_partition(a: NDArray, b: NDArray) -> bool:
    """Return whether two arrays of one shape, any int, number the same parts, whatever the numbers."""
    pairs = len(np.unique(np.stack([a.ravel(), b.ravel()]), axis=1).T)
    return pairs == len(np.unique(a)) == len(np.unique(b))


def bench_objects(*, copies: Sequence[int] = (10, 100), runs: int = 5, seed: int = 0) -> Iterator[str]:
    """Cut one chair alone and in rows: time for each, and how many of the copies are cut as the chair alone is."""
    alone = chairs_in_a_row(1, seed=seed)
    rows = {number: chairs_in_a_row(number, seed=seed) for number in copies}
    yield (
        f"Objects of one class: a synthetic chair of {CHAIR_CELLS} x {CHAIR_CELLS} cells alone, and exact copies of it "
        f"{GAP_CELLS * 5} cm apart; partition only, medians of {runs} runs in turn"
    )
    methods: dict[str, Callable[[Chairs], Cut]] = {"evidence": cut_evidence, "paper": cut_paper}
    for method, cut in methods.items():
        works = {number: partial(cut, chairs) for number, chairs in {1: alone, **rows}.items()}
        costs = measure(works, runs=runs)
        for number, chairs in rows.items():
            each = costs[number].wall / number
            yield (
                f"  {times(each / costs[1].wall):>8}  time a chair, {method}, {number} chairs: {1000 * each:.2f} ms "
                f"({1000 * costs[1].wall:.2f} ms alone)"
            )
            yield from _kept(method, cut(alone), cut(chairs))


def _kept(method: str, alone: Cut, row: Cut) -> Iterator[str]:
    """Describe how many chairs of a row are cut as the chair alone is."""
    for words, first, others in (
        ("before joining", alone.community[0], row.community),
        ("after joining", alone.instance[0], row.instance),
    ):
        kept = sum(same_partition(first, other) for other in others)
        parts = sorted({_parts(other) for other in others})
        yield (
            f"  {kept:>3} of {len(others):<3}  cut as the chair alone is, {method}, {words}: "
            f"number of parts {_parts(first)} alone, {' or '.join(map(str, parts))} in the row"
        )


def _parts(numbered: NDArray) -> int:
    return len(np.unique(numbered[numbered > 0]))
