"""Merging communities on pooled evidence: all pairs of cells between two communities testify together.

The affinity of two communities is ``(S + m p) / (S + D + m)``: S and D are the sums of *same* and *different* over all
pairs of cells between them, and m pairs are imagined beforehand, a share p of them *same*. Communities that touch are
taken for one object until evidence speaks against it; those that do not, for two until it speaks for it. The best pair
is joined first, down to affinity 0, so that one log answers every threshold.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray


@dataclass(frozen=True)
class PoolSettings:
    """What is believed before any evidence."""

    imagined_pairs: float = 3.0
    """m; the more, the more evidence it takes to change the belief."""
    touching_same: float = 0.7
    """p of communities with neighbouring cells; p is 0 for all others."""


def pool(
    community: NDArray, edges: NDArray, same: NDArray, different: NDArray, touching: NDArray, settings: PoolSettings
) -> tuple[NDArray, NDArray, NDArray]:
    """Join communities, best affinity first.

    Args:
        community: int32 [n], of each cell, numbered from 0.
        edges: int32 [m, 2], pairs of cells with evidence.
        same: int64 [m].
        different: int64 [m].
        touching: int32 [t, 2], pairs of neighbouring cells.
        settings: the beliefs.

    Returns:
        source int32 [steps], target int32 [steps], affinity float32 [steps], in the order of joining; the smaller
        number of the two lives on. Ties go to the smaller numbers.
    """
    low, high, pooled_same, pooled_different, touches = _between(community, edges, same, different, touching)
    m, p = settings.imagined_pairs, settings.touching_same
    return _join(int(community.max(initial=-1)) + 1, low, high, pooled_same, pooled_different, touches, m, p)


def _between(
    community: NDArray, edges: NDArray, same: NDArray, different: NDArray, touching: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Sum up the evidence between every two communities; float64 sums are exact for whole numbers."""
    pairs = np.concatenate([edges, touching]).astype(np.int64)
    zeros = np.zeros(len(touching))
    ends = community[pairs]
    crossing = ends[:, 0] != ends[:, 1]
    key = (ends.min(axis=1).astype(np.int64) << 32) | ends.max(axis=1)
    unique, inverse = np.unique(key[crossing], return_inverse=True)

    def total(of_edge: NDArray, of_touch: NDArray) -> NDArray:
        weights = np.concatenate([of_edge, of_touch])[crossing]
        return np.bincount(inverse, weights=weights, minlength=len(unique))

    touches = total(np.zeros(len(edges)), zeros + 1.0) > 0
    low, high = (unique >> 32).astype(np.int32), (unique & 0xFFFFFFFF).astype(np.int32)
    return low, high, total(same, zeros), total(different, zeros), touches


@njit(cache=True, nogil=True, inline="always")
def _affinity(same, different, touches, m, p):
    pairs = same + different + m
    return (same + (m * p if touches else 0.0)) / pairs if pairs > 0.0 else 0.0  # nothing seen, nothing imagined


@njit(cache=True, nogil=True, inline="always")
def _before(heap_score, heap_ends, a, b):
    """Tell whether heap entry a comes before b: higher affinity, then smaller communities."""
    if heap_score[a] != heap_score[b]:
        return heap_score[a] > heap_score[b]
    return heap_ends[a] < heap_ends[b]


@njit(cache=True, nogil=True, inline="always")
def _ends(low, high):
    return np.int64(low) << 32 | np.int64(high)


@njit(cache=True, nogil=True)
def _join(n, low, high, same, different, touches, m, p):  # noqa: C901, PLR0912, PLR0915 - one loop over shared arrays
    edges = len(low)
    # Every community lists its edges: slot 2 e is edge e in the list of its low end, 2 e + 1 in that of its high one.
    head = np.full(n, -1, dtype=np.int32)
    following = np.full(2 * edges, -1, dtype=np.int32)
    for e in range(edges):
        following[2 * e] = head[low[e]]
        head[low[e]] = 2 * e
        following[2 * e + 1] = head[high[e]]
        head[high[e]] = 2 * e + 1
    alive = np.ones(edges, dtype=np.bool_)
    score = np.zeros(edges, dtype=np.float64)
    room = 2 * edges + 16
    heap_score = np.zeros(room, dtype=np.float64)
    heap_edge = np.zeros(room, dtype=np.int32)
    heap_ends = np.zeros(room, dtype=np.int64)  # both communities at the time: what has changed since does not count
    size = 0
    for e in range(edges):
        score[e] = _affinity(same[e], different[e], touches[e], m, p)
        heap_score[size], heap_edge[size], heap_ends[size] = score[e], e, _ends(low[e], high[e])
        size += 1
        _rise(heap_score, heap_edge, heap_ends, size - 1)
    edge_to = np.full(n, -1, dtype=np.int32)
    source = np.zeros(n, dtype=np.int32)
    target = np.zeros(n, dtype=np.int32)
    affinity = np.zeros(n, dtype=np.float32)
    steps = 0
    while size > 0:
        best, at_score, at_ends = heap_edge[0], heap_score[0], heap_ends[0]
        size -= 1
        heap_score[0], heap_edge[0], heap_ends[0] = heap_score[size], heap_edge[size], heap_ends[size]
        _sink(heap_score, heap_edge, heap_ends, size)
        if not alive[best] or at_score != score[best] or at_ends != _ends(low[best], high[best]):
            continue  # overtaken by a later sum
        if at_score <= 0.0:
            break
        a, b = low[best], high[best]
        alive[best] = False
        source[steps], target[steps], affinity[steps] = b, a, at_score
        steps += 1
        slot = head[a]
        last = -1
        while slot >= 0:
            e = slot >> 1
            if alive[e]:
                edge_to[high[e] if low[e] == a else low[e]] = e
            last = slot
            slot = following[slot]
        slot = head[b]
        while slot >= 0:
            e, after = slot >> 1, following[slot]
            if alive[e]:
                other = high[e] if low[e] == b else low[e]
                known = edge_to[other]
                before_score, before_ends = -1.0, np.int64(-1)
                if known >= 0:  # a has an edge to it already: sum up
                    same[known] += same[e]
                    different[known] += different[e]
                    touches[known] = touches[known] or touches[e]
                    alive[e] = False
                    e = known
                    before_score, before_ends = score[e], _ends(low[e], high[e])
                else:  # the edge moves over to a
                    low[e], high[e] = min(a, other), max(a, other)
                    if last < 0:
                        head[a] = slot
                    else:
                        following[last] = slot
                    following[slot] = -1
                    last = slot
                    edge_to[other] = e
                score[e] = _affinity(same[e], different[e], touches[e], m, p)
                if score[e] != before_score or _ends(low[e], high[e]) != before_ends:
                    if size == len(heap_edge):
                        size = _sweep(heap_score, heap_edge, heap_ends, low, high, alive, score, size)
                    heap_score[size], heap_edge[size], heap_ends[size] = score[e], e, _ends(low[e], high[e])
                    size += 1
                    _rise(heap_score, heap_edge, heap_ends, size - 1)
            slot = after
        head[b] = -1
        slot = head[a]
        while slot >= 0:
            e = slot >> 1
            if low[e] == a:
                edge_to[high[e]] = -1
            if high[e] == a:
                edge_to[low[e]] = -1
            slot = following[slot]
    return source[:steps], target[:steps], affinity[:steps]


@njit(cache=True, nogil=True)
def _rise(heap_score, heap_edge, heap_ends, at):
    while at > 0:
        above = (at - 1) >> 1
        if not _before(heap_score, heap_ends, at, above):
            return
        heap_score[at], heap_score[above] = heap_score[above], heap_score[at]
        heap_edge[at], heap_edge[above] = heap_edge[above], heap_edge[at]
        heap_ends[at], heap_ends[above] = heap_ends[above], heap_ends[at]
        at = above


@njit(cache=True, nogil=True)
def _sink(heap_score, heap_edge, heap_ends, size):
    at = 0
    while True:
        below = 2 * at + 1
        if below >= size:
            return
        if below + 1 < size and _before(heap_score, heap_ends, below + 1, below):
            below += 1
        if not _before(heap_score, heap_ends, below, at):
            return
        heap_score[at], heap_score[below] = heap_score[below], heap_score[at]
        heap_edge[at], heap_edge[below] = heap_edge[below], heap_edge[at]
        heap_ends[at], heap_ends[below] = heap_ends[below], heap_ends[at]
        at = below


@njit(cache=True, nogil=True)
def _sweep(heap_score, heap_edge, heap_ends, low, high, alive, score, size):
    """Drop overtaken entries; an edge has one entry that counts, so half of the heap becomes free."""
    kept = 0
    for i in range(size):
        e = heap_edge[i]
        if alive[e] and heap_score[i] == score[e] and heap_ends[i] == _ends(low[e], high[e]):
            heap_score[kept], heap_edge[kept], heap_ends[kept] = heap_score[i], e, heap_ends[i]
            kept += 1
            _rise(heap_score, heap_edge, heap_ends, kept - 1)
    return kept
