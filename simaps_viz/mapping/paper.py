"""Method paper: the graph of cells seen in one segment, Louvain communities, and merging by the K % rule.

"Instance-Level Semantic Maps for Vision Language Navigation" (Nanwani et al., 2023). Community C1 merges into C2 while
more than K % of C1's cells neighbour C2. One run of the rule, down to K = 0, answers every K.
"""

import heapq
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.mapping.communities import find_communities
from simaps_viz.mapping.method import Gathered, Method, Slider, percent_text
from simaps_viz.structures import CellGraph, Grid, GridSpec, MergeLog

if TYPE_CHECKING:
    from simaps_viz.mapping.config import BuildConfig

K_PERCENT = Slider(
    parameter="k_percent", full=100.0, name="K", unit="a percentage", setting="K = {:g} %", title="K (%)", word="K",
    hint="A community joins another while more than K % of its cells neighbour it.",
    reason="{:.0f} % of the cells of the first neighbour the second",
    number="share of cells that neighbour the other",
)  # fmt: skip


class Paper(Method):
    """The paper's method."""

    slider = K_PERCENT
    votes = False
    counts_links = True
    weights_per_frame = True

    def parameters(self, config: "BuildConfig") -> dict[str, Any]:
        """Return K, Louvain's settings, and whether the literal reading is meant."""
        return super().parameters(config) | {"literal": config.literal}

    def graphs(self, grid: Grid, seen: Gathered, config: "BuildConfig") -> tuple[CellGraph, ...]:
        """Make the graphs from the links between cells, whose classes are those of the highest pixels."""
        del config
        edges, labels, counts = seen.links.entries()
        return class_graphs(grid, edges - np.tile(np.array(seen.origin_cell), 2), labels, counts)

    def communities(
        self, grid: Grid, graphs: Sequence[CellGraph], parameters: Mapping[str, Any]
    ) -> tuple[NDArray, MergeLog]:
        """Run Louvain and the K % rule on every class."""
        return partition_grid(
            grid, graphs, resolution=parameters["resolution"], seed=int(parameters.get("seed", 0))
        )  # fmt: skip

    def level(
        self, graphs: Sequence[CellGraph], spec: GridSpec, parameters: Mapping[str, Any], levels: int
    ) -> list[NDArray]:
        """Run Louvain on every class."""
        del spec
        resolution, seed = float(parameters.get("resolution", 1.0)), int(parameters.get("seed", 0))
        return [find_communities(graph, resolution=resolution, seed=seed, levels=levels) for graph in graphs]

    def score(self, parameters: Mapping[str, Any], same: int, different: int, *, touching: bool, share: float) -> float:
        """Return the share of neighbouring cells."""
        del parameters, same, different, touching
        return share

    def score_text(self, score: float, beside: float | None = None) -> str:
        """Write a score as a percentage of cells."""
        return percent_text(score, 1, beside)

    def needed_text(self, threshold: float) -> str:
        """Write the threshold as K."""
        return f"K = {100.0 * threshold:g} %"


PAPER = Paper("paper")


def partition_grid(
    grid: Grid, graphs: Sequence[CellGraph], *, resolution: float, seed: int
) -> tuple[NDArray, MergeLog]:
    """Run Louvain and the K % rule on every class.

    Returns:
        community int32 [rows, cols], numbered from 1 over the whole map, 0 = none; and the log down to K = 0.
    """
    community = np.zeros(grid.spec.rows * grid.spec.cols, dtype=np.int32)
    steps: list[tuple[int, int, int, float]] = []
    first = 1
    for graph in graphs:
        found = find_communities(graph, resolution=resolution, seed=seed)
        community[graph.cells] = found + first
        steps += [(graph.label, s + first, t + first, share) for s, t, share in merge_steps(found, graph.edges)]
        first += int(found.max()) + 1 if len(found) else 0
    log = MergeLog(
        label=np.array([s[0] for s in steps], dtype=np.int16),
        source=np.array([s[1] for s in steps], dtype=np.int32),
        target=np.array([s[2] for s in steps], dtype=np.int32),
        score=np.array([s[3] for s in steps], dtype=np.float32),
    )
    return community.reshape(grid.spec.shape), log


Step = tuple[int, int, float]
"""(source, target, share): the source ends and its cells belong to the target."""


def merge_steps(community: NDArray, edges: NDArray) -> list[Step]:
    """Merge C1 into C2 while any of C1's cells neighbours C2, always the largest share first.

    The share is the part of C1's cells that have an edge to a cell of C2. Stopping before the first step whose share
    is not above K / 100 gives the partition for K, so every K is a prefix of this log. Ties go to the lower source,
    then the lower target.

    Args:
        community: int [n], numbered from 0.
        edges: int [m, 2], positions in ``community``.

    Returns:
        The steps down to K = 0, in order.
    """
    return _Merger(community, edges).run()


class _Merger:
    """Keeps, for every two communities, how many cells of the first touch the second."""

    def __init__(self, community: NDArray, edges: NDArray) -> None:
        sizes = np.bincount(community) if len(community) else np.zeros(0, int)
        self.size = {c: int(n) for c, n in enumerate(sizes)}
        self.home: dict[int, int] = {}  # border cell -> its community
        self.touches: dict[int, set[int]] = defaultdict(set)  # border cell -> communities it has an edge to
        self.members: dict[int, set[int]] = defaultdict(set)  # community -> its border cells
        self.touched_by: dict[int, set[int]] = defaultdict(set)  # community -> border cells that touch it
        self.count: dict[int, dict[int, int]] = defaultdict(lambda: defaultdict(int))
        self.heap: list[tuple[float, int, int]] = []
        a, b = edges[:, 0], edges[:, 1]
        crosses = community[a] != community[b]
        both = np.concatenate([edges[crosses], edges[crosses][:, ::-1]])
        pairs = np.unique(np.stack([both[:, 0], community[both[:, 1]]], axis=1), axis=0) if len(both) else both
        for cell, other in pairs.tolist():
            self.home[cell] = home = int(community[cell])
            self.members[home].add(cell)
            self.touches[cell].add(other)
            self.touched_by[other].add(cell)
            self.count[home][other] += 1
        for source in self.count:
            self._offer_row(source)

    def _offer(self, source: int, target: int) -> None:
        touching = self.count[source].get(target, 0)
        if touching:
            heapq.heappush(self.heap, (-touching / self.size[source], source, target))

    def _offer_row(self, source: int) -> None:
        for target in self.count[source]:
            self._offer(source, target)

    def run(self) -> list[Step]:
        steps: list[Step] = []
        while self.heap:
            negative, source, target = heapq.heappop(self.heap)
            if source not in self.size or target not in self.size:
                continue
            touching = self.count[source].get(target, 0)
            if touching == 0 or touching / self.size[source] != -negative:
                continue  # an offer that a later merge has overtaken
            steps.append((source, target, -negative))
            self._join(source, target)
        return steps

    def _join(self, source: int, target: int) -> None:
        for cell in self.touched_by.pop(source, set()):
            self._redirect(cell, source, target)
        for cell in self.members.pop(source, set()):
            self._move(cell, target)
        row = self.count.pop(source, {})
        for other, touching in row.items():
            if other != target and touching:
                self.count[target][other] += touching
        self.count[target].pop(target, None)
        self.size[target] += self.size.pop(source)
        self._offer_row(target)

    def _redirect(self, cell: int, source: int, target: int) -> None:
        """A cell that touched the source touches the target now, unless it already did or lies in it."""
        home = self.home[cell]
        self.touches[cell].discard(source)
        self.count[home].pop(source, None)
        if home == target or target in self.touches[cell]:
            return
        self.touches[cell].add(target)
        self.touched_by[target].add(cell)
        self.count[home][target] += 1
        self._offer(home, target)

    def _move(self, cell: int, target: int) -> None:
        """A border cell of the source belongs to the target now, and no longer touches it from outside."""
        self.home[cell] = target
        self.members[target].add(cell)
        if target in self.touches[cell]:
            self.touches[cell].discard(target)
            self.touched_by[target].discard(cell)


def class_graphs(grid: Grid, links: NDArray, link_labels: NDArray, counts: NDArray) -> tuple[CellGraph, ...]:
    """Make the graph of each thing class that has cells.

    A link counts when both of its cells carry its class on the finished map. Weight = count / mean number of frames
    that saw the two cells ("Instance-Level Semantic Maps for Vision Language Navigation", 2023).

    Args:
        grid: the finished map.
        links: int [m, 4], (row_a, col_a, row_b, col_b) on ``grid``.
        link_labels: int16 [m].
        counts: int64 [m].
    """
    rows, cols = grid.spec.shape
    inside = ((links >= 0) & (links < np.array([rows, cols, rows, cols]))).all(axis=1)
    flat_a = links[:, 0].astype(np.int64) * cols + links[:, 1]
    flat_b = links[:, 2].astype(np.int64) * cols + links[:, 3]
    label = grid.label.reshape(-1)
    kept = np.flatnonzero(inside)
    kept = kept[(label[flat_a[kept]] == link_labels[kept]) & (label[flat_b[kept]] == link_labels[kept])]
    flat_a, flat_b, link_labels, counts = flat_a[kept], flat_b[kept], link_labels[kept], counts[kept]
    first, second = np.minimum(flat_a, flat_b), np.maximum(flat_a, flat_b)
    order = np.lexsort((second, first, link_labels))
    first, second, link_labels, counts = first[order], second[order], link_labels[order], counts[order]

    graphs = []
    for index in np.unique(label):
        if index == 0 or not grid.is_thing[index]:
            continue
        span = slice(*np.searchsorted(link_labels, [index, index + 1]))
        cells = np.flatnonzero(label == index)
        edges = np.stack([np.searchsorted(cells, first[span]), np.searchsorted(cells, second[span])], axis=1)
        found, seen = counts[span], grid.observations.reshape(-1)[cells]
        graphs.append(CellGraph(int(index), cells, edges.astype(np.int32), found, np.zeros(len(found), np.int32), seen))
    return tuple(graphs)
