"""Same or different: how often frames saw two cells of one class in one segment, and how often in two.

Every frame is one witness of a pair of cells. Pairs are taken at several ranges, not only between neighbours: objects
hold together over their full extent, the patches of a lattice do not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.mapping.communities import find_communities_together
from simaps_viz.mapping.method import Gathered, Method, Slider
from simaps_viz.mapping.observations import AllReadings
from simaps_viz.mapping.pooling import PoolSettings, affinity, partition_evidence
from simaps_viz.structures import CellGraph, Grid, GridSpec, MergeLog

if TYPE_CHECKING:
    from simaps_viz.mapping.config import BuildConfig

_MAX_16 = np.iinfo(np.uint16).max
HIDES_FROM_M = 0.05
"""A cell this much higher than the lower end of a pair can hide that the two ends are one object."""


@dataclass(frozen=True)
class EvidenceSettings:
    """Which pairs of cells are looked at."""

    ranges: tuple[int, ...] = (1, 2, 4, 8, 16)
    """Distances of the cells of a pair, in cells, along rows, columns and both diagonals."""
    different: bool = True
    """Also count the frames that saw two segments; False: only those that saw one."""
    gap_cells: int = 5
    """A pair is dropped when more than this many cells between its ends are open: lower, or floor and wall. Masks join
    what lies apart more often than objects have holes. -1 = keep all."""


def pair_graphs(grid: Grid, readings: AllReadings, settings: EvidenceSettings) -> tuple[CellGraph, ...]:
    """Gather the evidence of all pairs of cells, class by class.

    Args:
        grid: the map with its final labels.
        readings: of all frames on it.
        settings: which pairs.

    Returns:
        One graph for each thing class that has cells: ``counts`` = frames that saw the pair in one segment of the
        class, ``different`` = frames that saw it in two.
    """
    things = np.array(grid.is_thing) & (np.arange(len(grid.labels)) > 0)
    label = grid.label.reshape(-1)
    # One row of the table for each cell of a thing, one column for each step from it to a later cell.
    thing_cells = np.flatnonzero(things[label])
    number = np.full(label.size, -1, dtype=np.int32)
    number[thing_cells] = np.arange(len(thing_cells), dtype=np.int32)
    steps = pair_steps(settings.ranges)
    # A pair is not seen more often than its cells: 16 bits are enough for nearly every map, and half of the memory.
    most = int(grid.observations.reshape(-1)[thing_cells].max(initial=0))
    same = np.zeros((len(thing_cells), len(steps)), dtype=np.uint16 if most <= _MAX_16 else np.int32)
    different = np.zeros_like(same)
    last = np.full(len(thing_cells), -1, dtype=np.int32), np.zeros(len(thing_cells), dtype=np.int32)
    for part in readings.batches():
        kept = (part.segment > 0) & (part.label == label[part.cell]) & (number[part.cell] >= 0)
        count_pairs(
            part.cell[kept], part.frame[kept], part.segment[kept], label, number,
            grid.spec.rows, grid.spec.cols, steps, *last, same, different,
        )  # fmt: skip
    if settings.gap_cells >= 0:
        opaque = things.copy()
        opaque[0] = True  # what nobody named may be the same object, missed
        _drop_open_pairs(
            thing_cells, label, grid.height_m.reshape(-1), opaque, grid.spec.cols, steps, settings.gap_cells,
            same, different,
        )  # fmt: skip
    if not settings.different:
        different[:] = 0
    return _graphs(grid, label, thing_cells, number, steps, same, different)


def pair_steps(ranges: tuple[int, ...]) -> NDArray:
    """Return the (rows, cols) from a pair's first cell to its second, int32 [4 r, 2]; the second is the later one."""
    return np.array([s for r in ranges for s in ((0, r), (r, 0), (r, r), (r, -r))], dtype=np.int32).reshape(-1, 2)


@njit(cache=True, nogil=True)
def count_pairs(
    cell: NDArray,  # int32 [v], readings of things whose class the cell carries
    frame: NDArray,  # int32 [v], ascending
    segment: NDArray,  # int32 [v]
    label: NDArray,  # int16 [cells]
    number: NDArray,  # int32 [cells], row of same and different
    rows: int,
    cols: int,
    steps: NDArray,  # int32 [s, 2]
    seen: NDArray,  # in/out int32 [n], frame that saw the cell last, -1 = none
    seen_as: NDArray,  # in/out int32 [n], and in which segment
    same: NDArray,  # in/out uint16 or int32 [n, s]
    different: NDArray,  # in/out uint16 or int32 [n, s]
) -> None:
    """Count, frame by frame, the pairs of cells of one class seen in one segment and in two."""
    begin = 0
    while begin < len(cell):
        # Note what one frame saw of every cell.
        end = begin
        while end < len(cell) and frame[end] == frame[begin]:
            seen[number[cell[end]]] = frame[end]
            seen_as[number[cell[end]]] = segment[end]
            end += 1
        # Then look from every cell along the steps, each of which leads to a later cell: every pair is met once.
        for i in range(begin, end):
            c = cell[i]
            mine = number[c]
            row = c // cols
            col = c - row * cols
            for s in range(len(steps)):
                other_row, other_col = row + steps[s, 0], col + steps[s, 1]
                if other_row >= rows or other_col < 0 or other_col >= cols:
                    continue
                other = other_row * cols + other_col
                its = number[other]
                if its < 0 or seen[its] != frame[i] or label[other] != label[c]:
                    continue
                if seen_as[its] == segment[i]:
                    same[mine, s] += 1
                else:
                    different[mine, s] += 1
        begin = end


@njit(cache=True, nogil=True, inline="always")
def _top(height_m):  # float32
    """Return the height of a cell's top; infinite where nobody saw it, as anything may be there."""
    return np.float32(np.inf) if np.isnan(height_m) else height_m


@njit(cache=True, nogil=True)
def _drop_open_pairs(
    thing_cells: NDArray,  # int64 [n], flat, ascending
    label: NDArray,  # int16 [cells]
    height_m: NDArray,  # float32 [cells], NaN = never seen
    opaque: NDArray,  # bool [labels], classes that can hide an object
    cols: int,
    steps: NDArray,  # int32 [s, 2]
    gap_cells: int,
    same: NDArray,  # in/out uint16 or int32 [n, s]
    different: NDArray,  # in/out uint16 or int32 [n, s]
) -> None:
    """Forget the pairs between whose ends more than ``gap_cells`` cells are open."""
    for i in range(len(thing_cells)):
        c = thing_cells[i]
        for s in range(len(steps)):
            length = max(steps[s, 0], abs(steps[s, 1]))
            if length - 1 <= gap_cells or (same[i, s] == 0 and different[i, s] == 0):
                continue
            # Walk from one end to the other, and count the cells in which the object cannot be.
            one = steps[s, 0] // length * cols + steps[s, 1] // length
            base = min(_top(height_m[c]), _top(height_m[c + length * one]))
            is_open = 0
            for k in range(1, length):
                between = c + k * one
                top = _top(height_m[between])
                if label[between] == label[c] or top > base + HIDES_FROM_M:
                    continue
                if opaque[label[between]] and top > base - HIDES_FROM_M:
                    continue
                is_open += 1
            if is_open > gap_cells:
                same[i, s] = 0
                different[i, s] = 0


def _graphs(
    grid: Grid, label: NDArray, thing_cells: NDArray, number: NDArray, steps: NDArray, same: NDArray, different: NDArray
) -> tuple[CellGraph, ...]:
    """Turn the table of pairs into one graph for each class, class by class: the graphs are most of a map's memory."""
    order = np.argsort(steps[:, 0] * grid.spec.cols + steps[:, 1], kind="stable")  # edges come out sorted
    ahead = (steps[:, 0] * grid.spec.cols + steps[:, 1]).astype(np.int64)
    cell_label = label[thing_cells]
    by_class = np.argsort(cell_label, kind="stable").astype(np.int32)  # cells stay in their order within a class
    found = np.unique(cell_label)
    cuts = np.searchsorted(cell_label[by_class], [*found, len(grid.labels)])
    position = np.zeros(len(thing_cells), dtype=np.int32)  # of a cell in its class
    position[by_class] = np.arange(len(thing_cells)) - np.repeat(cuts[:-1], np.diff(cuts))
    graphs = []
    for i, index in enumerate(found.tolist()):
        members = by_class[cuts[i] : cuts[i + 1]]
        edges, counts, against = _edges(members, thing_cells, number, position, order, ahead, same, different)
        graphs.append(CellGraph(index, thing_cells[members], edges, counts, against, None))
    return tuple(graphs)


@njit(cache=True, nogil=True)
def _edges(
    members: NDArray,  # int32 [k], rows of `same` of the cells of one class, ascending
    thing_cells: NDArray,  # int64 [n]
    number: NDArray,  # int32 [cells], row of `same`
    position: NDArray,  # int32 [n], of a cell in its class
    order: NDArray,  # int64 [s], steps in the order of the cells they lead to
    ahead: NDArray,  # int64 [s], how far in flat cells a step leads
    same: NDArray,  # uint16 or int32 [n, s]
    different: NDArray,  # uint16 or int32 [n, s]
) -> tuple[NDArray, NDArray, NDArray]:
    """Return the edges of one class: positions int32 [m, 2], and same and different int32 [m]."""
    size = 0
    for i in members:
        for s in order:
            size += same[i, s] + different[i, s] > 0
    edges = np.zeros((size, 2), dtype=np.int32)
    counts, against = np.zeros(size, dtype=np.int32), np.zeros(size, dtype=np.int32)
    n = 0
    for i in members:
        for s in order:
            if same[i, s] + different[i, s] > 0:
                edges[n, 0], edges[n, 1] = position[i], position[number[thing_cells[i] + ahead[s]]]
                counts[n], against[n] = same[i, s], different[i, s]
                n += 1
    return edges, counts, against


AFFINITY = Slider(
    parameter="affinity", full=1.0, name="affinity", unit="a share", setting="affinity {:g}", title="Evidence (%)",
    word="evidence",
    hint="The higher, the more and smaller objects: two parts merge while more than this share says they are one.",
    reason="{:.0f} % of the evidence says they are one",
    number="evidence that both are one",
)  # fmt: skip


class Evidence(Method):
    """Our method: votes name the cells, and pooled evidence of pairs of cells joins the finest communities."""

    slider = AFFINITY
    layered = True

    def parameters(self, config: "BuildConfig") -> dict[str, Any]:
        """Return the affinity and the settings of Louvain, votes, pairs and pooling."""
        pairs = {**asdict(config.evidence), "ranges": list(config.evidence.ranges)}  # a list, as in JSON
        return super().parameters(config) | {"evidence": pairs, "pooling": asdict(config.pooling)}

    def graphs(self, grid: Grid, seen: Gathered, config: "BuildConfig") -> tuple[CellGraph, ...]:
        """Gather the evidence of all pairs of cells."""
        return pair_graphs(grid, seen.readings, config.evidence)

    def communities(
        self, grid: Grid, graphs: Sequence[CellGraph], parameters: Mapping[str, Any]
    ) -> tuple[NDArray, MergeLog]:
        """Find the finest communities and log how pooled evidence joins them."""
        return partition_evidence(
            grid, graphs, resolution=parameters["resolution"], seed=int(parameters.get("seed", 0)),
            settings=PoolSettings(**parameters.get("pooling", {})),
        )  # fmt: skip

    def level(
        self, graphs: Sequence[CellGraph], spec: GridSpec, parameters: Mapping[str, Any], levels: int
    ) -> list[NDArray]:
        """Run Louvain on all classes together."""
        resolution, seed = float(parameters.get("resolution", 1.0)), int(parameters.get("seed", 0))
        return find_communities_together(graphs, spec, resolution=resolution, seed=seed, levels=levels)

    def score(self, parameters: Mapping[str, Any], same: int, different: int, *, touching: bool, share: float) -> float:
        """Return the affinity; see `pooling.affinity`."""
        del share
        settings = PoolSettings(**parameters.get("pooling", {}))
        return affinity(same, different, touching, settings.imagined_pairs, settings.touching_same)


EVIDENCE = Evidence("evidence")
