"""Shared by the tests of mapping and others."""

import numpy as np

from simaps_viz.structures import CellGraph


def graph_of(n, edges, weights=None) -> CellGraph:
    edges = np.array(edges, dtype=np.int32).reshape(-1, 2)
    weights = np.ones(len(edges)) if weights is None else np.array(weights, dtype=np.float64)
    seen_once = np.ones(n, np.int32)  # then the counts are the weights
    return CellGraph(1, np.arange(n, dtype=np.int64), edges, weights, np.zeros(len(edges), np.int64), seen_once)


def cliques(sizes, bridge=True) -> CellGraph:
    edges, start = [], 0
    for size in sizes:
        edges += [(start + i, start + j) for i in range(size) for j in range(i + 1, size)]
        if bridge and start:
            edges.append((start - 1, start))
        start += size
    return graph_of(start, edges)
