"""Seeded Louvain communities of one class's cell graph."""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from sknetwork.clustering import Louvain

from simaps_viz.structures import CellGraph


def find_communities(graph: CellGraph, *, resolution: float = 1.0, seed: int = 0) -> NDArray:
    """Partition the cells of a class by Louvain's modularity optimisation (Blondel et al., 2008).

    Cells without an edge become communities of their own.

    Args:
        graph: the class's graph.
        resolution: higher gives more and smaller communities.
        seed: of Louvain's random order.

    Returns:
        int32 [n], aligned with ``graph.cells``; communities are numbered from 0 by their smallest cell.
    """
    n = len(graph.cells)
    if len(graph.edges) == 0:
        return np.arange(n, dtype=np.int32)
    a, b = graph.edges[:, 0], graph.edges[:, 1]
    half = sparse.coo_matrix((graph.weights, (a, b)), shape=(n, n))
    adjacency = (half + half.T).tocsr()
    found = Louvain(resolution=resolution, random_state=seed, shuffle_nodes=False).fit_predict(adjacency)
    return renumber(np.asarray(found))


def renumber(community: NDArray) -> NDArray:
    """Number communities from 0 in the order in which they first appear; int32 [n]."""
    _, first, inverse = np.unique(community, return_index=True, return_inverse=True)
    rank = np.zeros_like(first)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse].astype(np.int32)
