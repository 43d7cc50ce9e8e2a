"""Seeded Louvain communities of cell graphs."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from sknetwork.clustering import Louvain
from sknetwork.utils.check import get_probs

from simaps_viz.structures import CellGraph, GridSpec

MIN_PAIR_AFFINITY = 0.4
"""Method evidence: neighbouring cells whose affinity is not above this do not hold a finest community together, before
any merge. The threshold of merges is ``BuildConfig.affinity``."""
COMMUNITY_WEIGHT = 200.0
"""Total weight of the edges between neighbouring cells of a community that resolution 1 does not split, roughly: fifty
cells."""


def find_communities(graph: CellGraph, *, resolution: float = 1.0, seed: int = 0, levels: int = -1) -> NDArray:
    """Partition the cells of a class by Louvain's modularity optimisation (Blondel et al., 2008).

    Cells without an edge become communities of their own.

    Args:
        graph: the class's graph.
        resolution: higher gives more and smaller communities.
        seed: of Louvain's random order.
        levels: stop after so many of Louvain's levels, each of which joins the communities of the one before; -1 =
            continue until nothing gets better.

    Returns:
        int32 [n], aligned with ``graph.cells``; communities are numbered from 0 by their smallest cell.
    """
    n = len(graph.cells)
    if len(graph.edges) == 0:
        return np.arange(n, dtype=np.int32)
    a, b = graph.edges[:, 0], graph.edges[:, 1]
    adjacency = _adjacency(graph.weights, a, b, n)
    return renumber(_louvain(adjacency, resolution=resolution, seed=seed, levels=levels))


def _adjacency(weights: NDArray, first: NDArray, second: NDArray, n: int) -> sparse.csr_matrix:
    """Return the symmetric matrix of edges that each come once."""
    half = sparse.coo_matrix((weights, (first, second)), shape=(n, n)).tocsr()
    return (half + half.T).tocsr()


class _LeanLouvain(Louvain):
    """Louvain of a symmetric matrix, which it scales in place: the library's own makes three copies of it on the way.

    It adds the matrix to its transpose and divides by the sum; doubling is exact, so this is the same bit for bit.
    """

    def _pre_processing(
        self, input_matrix: sparse.csr_matrix, force_bipartite: bool
    ) -> tuple[sparse.csr_matrix, NDArray, NDArray, sparse.csr_matrix, NDArray]:
        del force_bipartite  # never asked for
        self._init_vars()
        self.bipartite = False
        n = len(input_matrix.indptr) - 1
        out_weights = get_probs("degree", input_matrix)
        input_matrix.data *= 1.0 / input_matrix.data.sum()
        alone = sparse.csr_matrix(sparse.identity(n, format="csr"))
        return input_matrix, out_weights, out_weights.copy(), alone, np.arange(n)


def _louvain(adjacency: sparse.csr_matrix, *, resolution: float, seed: int, levels: int) -> NDArray:
    """Return the community of each node; the matrix, symmetric, is changed."""
    louvain = _LeanLouvain(
        resolution=resolution, random_state=seed, shuffle_nodes=False, n_aggregations=levels,
        return_probs=False, return_aggregate=False,
    )  # fmt: skip
    return np.asarray(louvain.fit_predict(adjacency))


def renumber(community: NDArray) -> NDArray:
    """Number communities from 0 in the order in which they first appear; int32 [n]."""
    _, first, inverse = np.unique(community, return_index=True, return_inverse=True)
    rank = np.zeros_like(first)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse].astype(np.int32)


def find_communities_together(
    graphs: Sequence[CellGraph], spec: GridSpec, *, resolution: float = 1.0, seed: int = 0, levels: int = -1
) -> list[NDArray]:
    """Partition the cells of all classes into the finest communities by the evidence between neighbouring cells.

    Louvain's modularity splits an object according to how much else is in its graph. Here the resolution grows with
    the total weight, so that one object's fate does not depend on how many others there are: what is left of
    modularity compares a community's weight with a constant, ``COMMUNITY_WEIGHT / resolution`` (the constant Potts
    model of Traag, Van Dooren and Nesterov, 2011, with degrees in place of sizes).

    Args:
        graphs: of method evidence, all classes.
        spec: the grid.
        resolution: higher gives smaller communities.
        seed: of Louvain's random order.
        levels: as for `find_communities`.

    Returns:
        int32 [n] for each graph, aligned with its cells, each numbered from 0 by the smallest cell.
    """
    # Take the edges of all classes that are strong and join neighbouring cells.
    sizes = [len(graph.cells) for graph in graphs]
    first = np.cumsum([0, *sizes])
    rows, cols, weights = [], [], []
    for start, graph in zip(first, graphs, strict=False):
        affinity = graph.weights
        strong = np.flatnonzero(affinity > MIN_PAIR_AFFINITY)
        near = strong[_are_near(graph.cells, graph.edges[strong], spec.cols)]
        a, b = graph.edges[near, 0], graph.edges[near, 1]
        rows.append(a + np.int32(start))
        cols.append(b + np.int32(start))
        weights.append(affinity[near])
    weight = np.concatenate([np.zeros(0), *weights])
    n = int(first[-1])
    if len(weight) == 0:
        return [np.arange(size, dtype=np.int32) for size in sizes]
    # Run Louvain on all classes in one graph, and number the communities of each class.
    absolute = resolution * float(weight.sum()) / COMMUNITY_WEIGHT
    adjacency = _adjacency(weight, np.concatenate(rows), np.concatenate(cols), n)
    del weight, weights, rows, cols
    found = _louvain(adjacency, resolution=absolute, seed=seed, levels=levels)
    return [renumber(found[a:b]) for a, b in pairwise(first)]


def communities_of_pairs(
    weights: NDArray, first: NDArray, second: NDArray, n: int, *, resolution: float = 1.0, seed: int = 0
) -> NDArray:
    """Partition n nodes, whatever they are, like the cells of `find_communities_together`.

    Args:
        weights: float64 [m], of pairs of neighbouring nodes, each pair once.
        first: int [m], a node of each pair.
        second: int [m], the other one.
        n: number of nodes.
        resolution: higher gives smaller communities.
        seed: of Louvain's random order.

    Returns:
        int32 [n], numbered from 0 by the smallest node; a node without a pair is alone.
    """
    if len(weights) == 0:
        return np.arange(n, dtype=np.int32)
    absolute = resolution * float(weights.sum()) / COMMUNITY_WEIGHT
    return renumber(_louvain(_adjacency(weights, first, second, n), resolution=absolute, seed=seed, levels=-1))


def _are_near(cells: NDArray, edges: NDArray, cols: int) -> NDArray:
    """Return which edges join 8-neighbours, bool [m]."""
    apart = cells[edges[:, 1]] - cells[edges[:, 0]]  # at least 1
    close = np.flatnonzero(apart <= cols + 1)
    first_col, second_col = (cells[edges[close, end]] % cols for end in (0, 1))
    right = second_col - first_col
    near = np.zeros(len(edges), dtype=bool)
    near[close] = (np.abs(right) <= 1) & (apart[close] - right <= cols)  # that is one row at most
    return near
