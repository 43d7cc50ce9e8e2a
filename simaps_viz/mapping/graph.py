"""The weighted cell graph of each class, normalised by how often its cells were seen."""

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.structures import CellGraph, Grid, SIMap


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
        graphs.append(weighted(grid, int(index), cells, edges.astype(np.int32), counts[span]))
    return tuple(graphs)


def weighted(grid: Grid, label: int, cells: NDArray, edges: NDArray, counts: NDArray) -> CellGraph:
    """Make one class's graph from its counts; see `class_graphs` for the weight.

    Args:
        grid: the map.
        label: the class.
        cells: int [n], row * cols + col, ascending.
        edges: int32 [m, 2], places in ``cells``.
        counts: int [m], how often the two cells were seen as one.
    """
    return CellGraph(
        label=label,
        cells=cells.astype(np.int64, copy=False),
        edges=edges,
        counts=counts,
        different=np.zeros(len(counts), dtype=np.int32),
        seen=grid.observations.reshape(-1)[cells],
    )


def affine(label: int, cells: NDArray, edges: NDArray, same: NDArray, different: NDArray) -> CellGraph:
    """Make one class's graph from its evidence.

    Args:
        label: the class.
        cells: int [n], row * cols + col, ascending.
        edges: int32 [m, 2], places in ``cells``.
        same: int [m], how often the two cells were seen in one segment.
        different: int [m], in two segments.
    """
    return CellGraph(
        label=label,
        cells=cells.astype(np.int64, copy=False),
        edges=edges,
        counts=same,
        different=different,
        seen=None,
    )


def to_networkx(simap: SIMap, label: str) -> nx.Graph:
    """Return the graph of a class to hold.

    Nodes are (row, col) with ``height_m`` and ``instance``; edges have ``weight``, ``count`` and ``different``.

    Raises:
        InputError: the map has no cells of that class.
    """
    for graph in simap.graphs:
        if simap.grid.labels[graph.label] == label:
            break
    else:
        known = ", ".join(simap.grid.labels[g.label] for g in simap.graphs)
        raise InputError(f"class {label!r}: expected one with a graph on this map ({known})")
    cols = simap.spec.cols
    result = nx.Graph()
    nodes = [divmod(int(c), cols) for c in graph.cells]
    for node in nodes:
        result.add_node(node, height_m=float(simap.grid.height_m[node]), instance=int(simap.instance[node]))
    evidence = zip(graph.edges, graph.counts, graph.different, graph.weights, strict=True)
    for (a, b), count, different, weight in evidence:
        result.add_edge(nodes[a], nodes[b], count=int(count), different=int(different), weight=float(weight))
    return result
