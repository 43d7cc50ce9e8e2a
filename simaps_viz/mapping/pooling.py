"""Merging communities on pooled evidence: all pairs of cells between two communities testify together.

The affinity of two communities (`affinity`) is ``(S + m p) / (S + D + m)``: S and D are the sums of *same* and
*different* over all pairs of cells between them, and m pairs are imagined beforehand, a share p of them *same*.
Communities that touch are taken for one object until evidence speaks against it; those that do not, for two until it
speaks for it. The best pair is joined first, down to affinity 0, so that one log answers every threshold.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.mapping.communities import find_communities_together
from simaps_viz.mapping.partition import empty_log
from simaps_viz.structures import CellGraph, Grid, GridSpec, MergeLog


@dataclass(frozen=True)
class PoolSettings:
    """What is believed before any evidence."""

    imagined_pairs: float = 3.0
    """m; the more, the more evidence it takes to change the belief."""
    touching_same: float = 0.7
    """p of communities with neighbouring cells; p is 0 for all others."""


def affinity(same: float, different: float, touches: bool, m: float, p: float) -> float:
    """Compute the affinity of two communities.

    Args:
        same: sum of *same* over all pairs of cells between them.
        different: sum of *different*.
        touches: whether some of their cells are neighbours.
        m: `PoolSettings.imagined_pairs`.
        p: `PoolSettings.touching_same`.

    Returns:
        0 to 1; 0 where no pair was seen and none is imagined.
    """
    pairs = same + different + m
    return (same + (m * p if touches else 0.0)) / pairs if pairs > 0.0 else 0.0


_affinity: Callable[..., float] = njit(cache=True, nogil=True, inline="always")(affinity)


@dataclass(frozen=True, eq=False)
class PairSums:
    """The evidence on every two communities that have any, or touch. All arrays aligned."""

    communities: int
    """How many there are, numbered from 0."""
    low: NDArray
    """int32, ascending."""
    high: NDArray
    """int32, above ``low``."""
    same: NDArray
    """float64, whole numbers."""
    different: NDArray
    """float64, whole numbers."""
    touching: NDArray
    """bool."""


def sum_pairs(community: NDArray, edges: NDArray, same: NDArray, different: NDArray, touching: NDArray) -> PairSums:
    """Sum up the evidence on every two communities.

    Args:
        community: int32 [n], of each cell, numbered from 0.
        edges: int32 [m, 2], pairs of cells with evidence.
        same: int32 or int64 [m].
        different: int32 or int64 [m].
        touching: int32 [t, 2], pairs of neighbouring cells.
    """
    n = int(community.max(initial=-1)) + 1
    summed = _sum_up(n, community, edges, same, different, touching)
    return PairSums(n, *(part.copy() for part in summed))  # copied, as they are views of larger arrays


def join(parts: Sequence[PairSums], settings: PoolSettings) -> tuple[NDArray, NDArray, NDArray]:
    """Join communities, best affinity first.

    Args:
        parts: the evidence of each class, whose communities never join those of another class. In the result they are
            numbered on from part to part.
        settings: what is believed before any evidence.

    Returns:
        source int32 [steps], target int32 [steps], affinity float32 [steps], in the order of joining; the smaller
        number of the two lives on. Ties go to the smaller numbers.
    """
    # Number the communities of all parts through.
    starts = np.cumsum([0, *(part.communities for part in parts)])
    shifted = zip(parts, starts.astype(np.int32), strict=False)
    ends = [np.stack([part.low, part.high]) + start for part, start in shifted]
    low, high = np.concatenate([np.zeros((2, 0), np.int32), *ends], axis=1)
    same, different = (
        np.concatenate([np.zeros(0), *(getattr(part, name) for part in parts)]) for name in ("same", "different")
    )
    touching = np.concatenate([np.zeros(0, np.bool_), *(part.touching for part in parts)])
    # Join them.
    return join_parts(int(starts[-1]), low, high, same, different, touching, settings)


def join_parts(
    n: int, low: NDArray, high: NDArray, same: NDArray, different: NDArray, touching: NDArray, settings: PoolSettings,
    *, kept: int = 0, above: float = 0.0,
) -> tuple[NDArray, NDArray, NDArray]:  # fmt: skip
    """Join communities, whatever they consist of, like `join`.

    Args:
        n: how many there are, numbered from 0.
        low: int32 [m], the first of each two that have evidence, or touch; may be changed, as all that follow.
        high: int32 [m], the second, above ``low``.
        same: float64 [m].
        different: float64 [m].
        touching: bool [m].
        settings: what is believed before any evidence.
        kept: the first so many are never joined to each other.
        above: no further step is made once the best affinity is not above this.
    """
    m, p = settings.imagined_pairs, settings.touching_same
    return _join(n, low, high, same, different, touching, m, p, kept, np.float32(above))


@njit(cache=True, nogil=True)
def _sum_up(
    n: int,
    community: NDArray,  # int32 [cells]
    edges: NDArray,  # int32 [m, 2]
    same: NDArray,  # int32 or int64 [m]
    different: NDArray,  # int32 or int64 [m]
    touching: NDArray,  # int32 [t, 2]
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Add up the evidence between every two communities.

    This is C^T A C, but scipy.sparse takes 160 ms for the 170,000 pairs of a house, np.unique 95 ms, this 3 ms: it only
    buckets the pairs by their lower community, and the resolution slider waits for it.
    """
    # Bucket the pairs of different communities by the lower of the two.
    pairs, touches_from = len(edges) + len(touching), len(edges)
    lower = np.full(pairs, -1, dtype=np.int32)
    upper = np.zeros(pairs, dtype=np.int32)
    start = np.zeros(n + 1, dtype=np.int32)
    for i in range(pairs):
        pair = edges[i] if i < touches_from else touching[i - touches_from]
        one, other = community[pair[0]], community[pair[1]]
        if one != other:
            lower[i], upper[i] = min(one, other), max(one, other)
            start[lower[i] + 1] += 1
    for c in range(n):
        start[c + 1] += start[c]
    at = start[:-1].copy()
    sorted_pairs = np.zeros(start[n], dtype=np.int32)
    for i in range(pairs):
        if lower[i] >= 0:
            sorted_pairs[at[lower[i]]] = i
            at[lower[i]] += 1
    # Within a bucket, the first pair with a higher community opens an entry; later ones add to it.
    low = np.zeros(start[n], dtype=np.int32)
    high = np.zeros(start[n], dtype=np.int32)
    pooled_same = np.zeros(start[n], dtype=np.float64)
    pooled_different = np.zeros(start[n], dtype=np.float64)
    touches = np.zeros(start[n], dtype=np.bool_)
    entry_of = np.full(n, -1, dtype=np.int32)
    size = 0
    for c in range(n):
        first = size
        for k in range(start[c], start[c + 1]):
            i = sorted_pairs[k]
            entry = entry_of[upper[i]]
            if entry < first:
                entry = size
                low[entry], high[entry], entry_of[upper[i]] = c, upper[i], entry
                size += 1
            if i < touches_from:
                pooled_same[entry] += same[i]
                pooled_different[entry] += different[i]
            else:
                touches[entry] = True
    return low[:size], high[:size], pooled_same[:size], pooled_different[:size], touches[:size]


@njit(cache=True, nogil=True)
def _edge_lists(
    n: int,
    low: NDArray,  # int32 [edges]
    high: NDArray,  # int32 [edges]
) -> tuple[NDArray, NDArray]:
    """Return a linked list of the edges of each community.

    Returns:
        head int32 [n], first slot of each community, and following int32 [2 edges], the slot after each; -1 = none.
        Slot 2 e is edge e in the list of its low end, slot 2 e + 1 in that of its high end.
    """
    edges = len(low)
    head = np.full(n, -1, dtype=np.int32)
    following = np.full(2 * edges, -1, dtype=np.int32)
    for e in range(edges):
        following[2 * e] = head[low[e]]
        head[low[e]] = 2 * e
        following[2 * e + 1] = head[high[e]]
        head[high[e]] = 2 * e + 1
    return head, following


@njit(cache=True, nogil=True)
def _best_first(
    low: NDArray,  # int32 [edges]
    high: NDArray,  # int32 [edges]
    same: NDArray,  # float64 [edges]
    different: NDArray,  # float64 [edges]
    touches: NDArray,  # bool [edges]
    m: float,
    p: float,
) -> tuple[NDArray, NDArray, NDArray, NDArray, int]:
    """Make a heap of the edges with an affinity above 0: highest affinity first, then smallest communities.

    heapq would push an edge anew each time its affinity changes; here an edge moves within the heap, which holds each
    at most once.

    Returns:
        edge int32, affinity float64 and ends int64 of each entry; position in the heap of each edge, int32, -1 = not in
        it; and the number of entries.
    """
    edges = len(low)
    heap = np.zeros(edges, dtype=np.int32)
    score = np.zeros(edges, dtype=np.float64)
    ends = np.zeros(edges, dtype=np.int64)
    position = np.full(edges, -1, dtype=np.int32)
    # Append the edges in any order ...
    size = 0
    for e in range(edges):
        affine = _affinity(same[e], different[e], touches[e], m, p)
        if affine > 0.0:
            heap[size], score[size], ends[size], position[e] = e, affine, _ends(low[e], high[e]), size
            size += 1
    # ... then let each entry that has others below it sink to where it belongs, from the last to the first.
    for at in range(size // 2 - 1, -1, -1):
        _sink(heap, score, ends, position, size, at, heap[at], score[at], ends[at])
    return heap, score, ends, position, size


@njit(cache=True, nogil=True)
def _mark_neighbours(
    a,  # int32
    low: NDArray,  # int32 [edges]
    high: NDArray,  # int32 [edges]
    head: NDArray,  # in/out int32 [n]
    following: NDArray,  # in/out int32 [2 edges]
    alive: NDArray,  # bool [edges]
    edge_to: NDArray,  # out int32 [n]
    marked: NDArray,  # out int32 [n]
    mark: int,
) -> None:
    """Note the edge to each neighbour of a community; edges that have ended leave its list."""
    before, slot = -1, head[a]
    while slot >= 0:
        e, after = slot >> 1, following[slot]
        if alive[e]:
            other = high[e] if low[e] == a else low[e]
            edge_to[other], marked[other] = e, mark
            before = slot
        elif before < 0:
            head[a] = after
        else:
            following[before] = after
        slot = after


@njit(cache=True, nogil=True)
def _join(  # noqa: PLR0915 - one loop over shared arrays
    n: int,
    low: NDArray,  # in/out int32 [edges]
    high: NDArray,  # in/out int32 [edges]
    same: NDArray,  # in/out float64 [edges]
    different: NDArray,  # in/out float64 [edges]
    touches: NDArray,  # in/out bool [edges]
    m: float,
    p: float,
    kept: int,
    above: np.float32,
) -> tuple[NDArray, NDArray, NDArray]:
    """Join the two communities of the best edge until none is left; see `join_parts`."""
    head, following = _edge_lists(n, low, high)
    alive = np.ones(len(low), dtype=np.bool_)
    heap, score, ends, position, size = _best_first(low, high, same, different, touches, m, p)
    edge_to = np.full(n, -1, dtype=np.int32)  # the edge between `known_to` and another community ...
    marked = np.full(n, -1, dtype=np.int32)  # ... where this is `mark`
    known_to, mark = -1, -1
    source = np.zeros(n, dtype=np.int32)
    target = np.zeros(n, dtype=np.int32)
    affinity = np.zeros(n, dtype=np.float32)
    steps = 0
    while size > 0 and np.float32(score[0]) > above:
        # The best edge is the next step: b becomes part of a.
        best = heap[0]
        a, b = low[best], high[best]
        if b < kept:  # its evidence still counts, should it be handed on
            size = _take_out(heap, score, ends, position, size, best)
            continue
        alive[best] = False
        source[steps], target[steps], affinity[steps] = b, a, score[0]
        steps += 1
        size = _take_out(heap, score, ends, position, size, best)
        # Know the edge from a to each of its neighbours; often a is the same as in the step before.
        if known_to != a:
            known_to, mark = a, mark + 1
            _mark_neighbours(a, low, high, head, following, alive, edge_to, marked, mark)
        # Hand every edge of b over to a.
        marked[b] = -1
        slot = head[b]
        while slot >= 0:
            e, after = slot >> 1, following[slot]
            if alive[e]:
                other = high[e] if low[e] == b else low[e]
                if marked[other] == mark:  # a has an edge to it already: sum up
                    if position[e] >= 0:
                        size = _take_out(heap, score, ends, position, size, e)
                    alive[e] = False
                    known = edge_to[other]
                    same[known] += same[e]
                    different[known] += different[e]
                    touches[known] = touches[known] or touches[e]
                    affine = _affinity(same[known], different[known], touches[known], m, p)
                    if affine > 0.0:
                        at = position[known]
                        if at < 0:
                            at = size
                            size += 1
                        _put(heap, score, ends, position, size, at, known, affine, _ends(low[known], high[known]))
                else:  # the edge moves over to a: its affinity stays, its ends come earlier
                    low[e], high[e] = min(a, other), max(a, other)
                    following[slot] = head[a]
                    head[a] = slot
                    edge_to[other], marked[other] = e, mark
                    at = position[e]
                    if at >= 0:
                        _rise(heap, score, ends, position, at, e, score[at], _ends(low[e], high[e]))
            slot = after
        head[b] = -1
    return source[:steps], target[:steps], affinity[:steps]


@njit(cache=True, nogil=True, inline="always")
def _ends(low, high):
    return np.int64(low) << 32 | np.int64(high)


@njit(cache=True, nogil=True)
def _rise(heap, score, ends, position, at, edge, its_score, its_ends):
    """Put an edge at a free place of the heap, or above it."""
    while at > 0:
        above = (at - 1) >> 1
        if score[above] > its_score or (score[above] == its_score and ends[above] <= its_ends):
            break
        heap[at], score[at], ends[at], position[heap[above]] = heap[above], score[above], ends[above], at
        at = above
    heap[at], score[at], ends[at], position[edge] = edge, its_score, its_ends, at


@njit(cache=True, nogil=True)
def _sink(heap, score, ends, position, size, at, edge, its_score, its_ends):
    """Put an edge at a free place of the heap, or below it."""
    while True:
        below = 2 * at + 1
        if below >= size:
            break
        right = below + 1
        if right < size and (
            score[right] > score[below] or (score[right] == score[below] and ends[right] < ends[below])
        ):
            below = right
        if its_score > score[below] or (its_score == score[below] and its_ends <= ends[below]):
            break
        heap[at], score[at], ends[at], position[heap[below]] = heap[below], score[below], ends[below], at
        at = below
    heap[at], score[at], ends[at], position[edge] = edge, its_score, its_ends, at


@njit(cache=True, nogil=True)
def _put(heap, score, ends, position, size, at, edge, its_score, its_ends):
    """Put an edge at a free place of the heap, or where it belongs from there."""
    above = (at - 1) >> 1
    if at > 0 and (score[above] < its_score or (score[above] == its_score and ends[above] > its_ends)):
        _rise(heap, score, ends, position, at, edge, its_score, its_ends)
    else:
        _sink(heap, score, ends, position, size, at, edge, its_score, its_ends)


@njit(cache=True, nogil=True)
def _take_out(heap, score, ends, position, size, edge):
    """Take an edge out of the heap; return the new size."""
    at, last = position[edge], size - 1
    position[edge] = -1
    if at != last:
        _put(heap, score, ends, position, last, at, heap[last], score[last], ends[last])
    return last


def partition_evidence(
    grid: Grid, graphs: Sequence[CellGraph], *, resolution: float, seed: int, settings: PoolSettings | None = None
) -> tuple[NDArray, MergeLog]:
    """Find the finest communities and log how pooled evidence joins them, down to affinity 0.

    Args:
        grid: the map.
        graphs: of method evidence.
        resolution: higher makes the finest communities smaller.
        seed: of Louvain's random order.
        settings: what is believed before any evidence.

    Returns:
        community int32 [rows, cols], numbered from 1 over all classes, 0 = none; and the log, class by class.
    """
    if not graphs:
        return np.zeros(grid.spec.shape, dtype=np.int32), empty_log()
    # Find the finest communities of each class, and join them.
    finest = find_communities_together(graphs, grid.spec, resolution=resolution, seed=seed)
    sizes = [int(community.max(initial=-1)) + 1 for community in finest]
    sums = [sum_pairs(own, *_across(graph, own, grid.spec)) for graph, own in zip(graphs, finest, strict=True)]
    source, target, score = join(sums, settings or PoolSettings())
    # Number them through on the grid.
    community = np.zeros(grid.spec.rows * grid.spec.cols, dtype=np.int32)
    for graph, own, start in zip(graphs, finest, np.cumsum([0, *sizes]), strict=False):
        community[graph.cells] = own + start + 1
    # Sort the log by class, each in the order of joining.
    label_of = np.repeat(np.array([graph.label for graph in graphs], dtype=np.int16), sizes)
    order = np.argsort(label_of[source], kind="stable")
    log = MergeLog(label_of[source[order]], source[order] + 1, target[order] + 1, score[order])
    return community.reshape(grid.spec.shape), log


def _across(graph: CellGraph, community: NDArray, spec: GridSpec) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return the pairs of cells of different communities: those with evidence, their counts, and those that touch."""
    edges, touching = graph.edges, touching_pairs(graph.cells, spec)
    kept = community[edges[:, 0]] != community[edges[:, 1]]
    touching = touching[community[touching[:, 0]] != community[touching[:, 1]]]
    return edges[kept], graph.counts[kept], graph.different[kept], touching


def touching_pairs(cells: NDArray, spec: GridSpec) -> NDArray:
    """Return the pairs of 8-neighbouring cells of one class, int32 [t, 2], positions in ``cells`` (flat, ascending)."""
    return _touching(cells, spec.cols)


@njit(cache=True, nogil=True)
def _touching(
    cells: NDArray,  # int64 [n], flat, ascending
    cols: int,
) -> NDArray:
    """Walk along the cells with one finger on each of the four neighbours that come later in the grid."""
    steps = np.array([1, cols - 1, cols, cols + 1])
    d_col = np.array([1, -1, 0, 1])
    finger = np.zeros(4, dtype=np.int64)
    pairs = np.zeros((4 * len(cells), 2), dtype=np.int32)
    n = 0
    for i in range(len(cells)):
        col = cells[i] % cols
        for s in range(4):
            while finger[s] < len(cells) and cells[finger[s]] < cells[i] + steps[s]:
                finger[s] += 1
            if finger[s] == len(cells) or not 0 <= col + d_col[s] < cols:
                continue
            if cells[finger[s]] == cells[i] + steps[s]:
                pairs[n] = i, finger[s]
                n += 1
    return pairs[:n]
