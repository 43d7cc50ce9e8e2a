"""From evidence to communities and the log that joins them: chunks of sure neighbours, then pooled evidence."""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.mapping.communities import find_chunks
from simaps_viz.mapping.partition import empty_log
from simaps_viz.mapping.pooling import PoolSettings, between, join
from simaps_viz.structures import CellGraph, Grid, GridSpec, MergeLog


def partition_evidence(
    grid: Grid, graphs: Sequence[CellGraph], *, resolution: float, seed: int, settings: PoolSettings | None = None
) -> tuple[NDArray, MergeLog]:
    """Find chunks and log how pooled evidence joins them, down to affinity 0.

    Args:
        grid: the map.
        graphs: of method evidence.
        resolution: of the chunks; higher makes them smaller.
        seed: of Louvain's random order.
        settings: what is believed before evidence.

    Returns:
        community int32 [rows, cols], numbered from 1 over the whole map, 0 = none; and the log, class by class.
    """
    if not graphs:
        return np.zeros(grid.spec.shape, dtype=np.int32), empty_log()
    chunks = find_chunks(graphs, grid.spec, resolution=resolution, seed=seed)
    sizes = [int(chunk.max(initial=-1)) + 1 for chunk in chunks]
    first = np.cumsum([0, *sizes])
    parts = [between(chunk, *_across(graph, chunk, grid.spec)) for graph, chunk in zip(graphs, chunks, strict=True)]
    source, target, affinity = join(parts, settings or PoolSettings())
    community = np.zeros(grid.spec.rows * grid.spec.cols, dtype=np.int32)
    for graph, chunk, start in zip(graphs, chunks, first, strict=False):
        community[graph.cells] = chunk + start + 1
    label_of = np.repeat(np.array([graph.label for graph in graphs], dtype=np.int16), sizes)
    order = np.argsort(label_of[source], kind="stable")
    log = MergeLog(label_of[source[order]], source[order] + 1, target[order] + 1, affinity[order])
    return community.reshape(grid.spec.shape), log


def _across(graph: CellGraph, chunk: NDArray, spec: GridSpec) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Give the edges between chunks with their evidence, and the touching pairs; only these have a say in pooling."""
    edges, touching = graph.edges, touching_pairs(graph.cells, spec)
    kept = chunk[edges[:, 0]] != chunk[edges[:, 1]]
    touching = touching[chunk[touching[:, 0]] != chunk[touching[:, 1]]]
    return edges[kept], graph.counts[kept], graph.different[kept], touching


def touching_pairs(cells: NDArray, spec: GridSpec) -> NDArray:
    """Give the pairs of 8-neighbouring cells of one class, int32 [t, 2], positions in ``cells`` (flat, ascending)."""
    return _touching(cells, spec.cols)


@njit(cache=True, nogil=True)
def _touching(cells: NDArray, cols: int) -> NDArray:
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
