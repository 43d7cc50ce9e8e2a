"""Seeded Louvain, checked on graphs whose communities are known."""

import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sknetwork.clustering import Louvain

from simaps_viz.mapping import communities
from simaps_viz.mapping.communities import find_communities, renumber
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


@pytest.mark.parametrize("seed", range(5))
def test_cliques_are_communities(seed):
    found = find_communities(cliques([5, 6, 4]), seed=seed)
    assert found.tolist() == [0] * 5 + [1] * 6 + [2] * 4


def test_cells_without_edges_stand_alone_and_numbers_go_by_the_smallest_cell():
    assert find_communities(graph_of(4, [(1, 3)])).tolist() == [0, 1, 2, 1]
    assert find_communities(graph_of(3, [])).tolist() == [0, 1, 2]


def test_higher_resolution_gives_more_communities():
    lattice = nx.convert_node_labels_to_integers(nx.grid_2d_graph(12, 12))
    graph = graph_of(144, list(lattice.edges))
    counts = [int(find_communities(graph, resolution=r).max()) + 1 for r in (0.2, 1.0, 4.0)]
    assert counts == sorted(counts) and counts[0] < counts[1] < counts[2]


def test_modularity_is_no_worse_than_networkx():
    lattice = nx.convert_node_labels_to_integers(nx.grid_2d_graph(10, 10))
    found = find_communities(graph_of(100, list(lattice.edges)))
    ours = [set(np.flatnonzero(found == c).tolist()) for c in range(found.max() + 1)]
    theirs = nx.community.louvain_communities(lattice, seed=0)
    modularity = nx.community.modularity
    assert modularity(lattice, ours) > 0.95 * modularity(lattice, theirs)


@given(st.lists(st.integers(0, 9), min_size=1, max_size=60))
def test_renumber_keeps_the_partition_and_orders_it(numbers):
    found = renumber(np.array(numbers))
    assert [found[i] == found[j] for i in range(len(numbers)) for j in range(i)] == [
        numbers[i] == numbers[j] for i in range(len(numbers)) for j in range(i)
    ]
    firsts = [found.tolist().index(c) for c in range(found.max() + 1)]
    assert firsts == sorted(firsts)


@pytest.mark.parametrize("seed", range(4))
def test_louvain_without_the_copies_is_the_librarys_louvain(seed):
    rng = np.random.default_rng(seed)
    for n, edges in ((40, 90), (300, 1500)):
        pairs = np.unique(np.sort(rng.integers(0, n, (edges, 2)), axis=1), axis=0).astype(np.int32)
        pairs = pairs[pairs[:, 0] < pairs[:, 1]]
        adjacency = communities._adjacency(rng.random(len(pairs)), pairs[:, 0], pairs[:, 1], n)
        plain = Louvain(resolution=1.3, random_state=seed, shuffle_nodes=False).fit_predict(adjacency.copy())
        lean = communities._louvain(adjacency, resolution=1.3, seed=seed, levels=-1)
        assert np.array_equal(lean, plain) and lean.max() > 2
    assert communities.find_communities(cliques([5, 6, 4])).tolist() == [0] * 5 + [1] * 6 + [2] * 4
