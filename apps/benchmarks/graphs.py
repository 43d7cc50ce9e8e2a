"""How long Louvain takes on real cell graphs: scikit-network, which builds use, networkx, and python-louvain."""

import time
from collections.abc import Callable, Iterator, Sequence

import community as python_louvain
import networkx as nx
import numpy as np
from benchmarks.timing import Cost, measure, times
from numpy.typing import NDArray

from simaps_viz.mapping.communities import find_communities
from simaps_viz.structures import CellGraph

Partition = list[set[int]]


def to_networkx(graph: CellGraph) -> nx.Graph:
    """Return a cell graph to networkx: nodes 0 to n - 1, ``weight`` on the edges, everything in the order it stands."""
    result = nx.Graph()
    result.add_nodes_from(range(len(graph.cells)))
    first, second = graph.edges.T.tolist() if len(graph.edges) else ([], [])
    result.add_weighted_edges_from(zip(first, second, graph.weights.tolist(), strict=True))
    return result


def by_networkx(graphs: Sequence[nx.Graph], seed: int) -> list[Partition]:
    """Run networkx's Louvain on every graph."""
    return [list(nx.community.louvain_communities(graph, weight="weight", seed=seed)) for graph in graphs]


def by_python_louvain(graphs: Sequence[nx.Graph], seed: int) -> list[Partition]:
    """Run python-louvain on every graph."""
    found = [python_louvain.best_partition(graph, weight="weight", random_state=seed) for graph in graphs]
    return [_sets(np.fromiter((of[node] for node in range(len(of))), np.int64, len(of))) for of in found]


def by_scikit_network(graphs: Sequence[CellGraph], seed: int) -> list[Partition]:
    """Run what a build runs on every graph, making the sparse matrix included."""
    return [_sets(find_communities(graph, seed=seed)) for graph in graphs]


def bench_louvain(graphs: Sequence[CellGraph], *, name: str, runs: int = 3, seed: int = 0) -> Iterator[str]:
    """Compare three implementations on the same graphs at resolution 1: time, and the modularity they reach.

    Args:
        graphs: the cell graphs of all classes of a map of method paper.
        name: of the map.
        runs: of each.
        seed: of their random order.
    """
    linked = [graph for graph in graphs if len(graph.edges)]
    start = time.perf_counter()
    theirs = [to_networkx(graph) for graph in linked]
    made_s = time.perf_counter() - start
    found: dict[str, list[Partition]] = {}

    def keep(name: str, partitions: list[Partition]) -> None:
        found[name] = partitions

    works: dict[str, Callable[[], object]] = {
        "scikit-network": lambda: keep("scikit-network", by_scikit_network(linked, seed)),
        "networkx": lambda: keep("networkx", by_networkx(theirs, seed)),
        "python-louvain": lambda: keep("python-louvain", by_python_louvain(theirs, seed)),
    }
    costs = measure(works, runs=runs, warm=False)
    cells, edges = sum(len(graph.cells) for graph in linked), sum(len(graph.edges) for graph in linked)
    yield (
        f"Louvain, {name}: {len(linked)} classes, {cells:,} cells, {edges:,} edges, resolution 1; "
        f"medians of {runs} runs in turn"
    )
    ours = costs["scikit-network"]
    for library in works:
        yield _line(library, costs[library], ours, _modularity(theirs, found[library]))
    yield f"  the other two are given ready graphs; making those took {made_s:.2f} s more"


def _line(library: str, cost: Cost, ours: Cost, modularity: float) -> str:
    who = "scikit-network, as builds call it" if cost is ours else library
    return f"  {times(cost.wall / ours.wall):>8}  {who}: {1000 * cost.wall:,.0f} ms, mean modularity {modularity:.3f}"


def _modularity(graphs: Sequence[nx.Graph], partitions: Sequence[Partition]) -> float:
    """Mean over the graphs, weighted by their edges."""
    values = [nx.community.modularity(g, p, weight="weight") for g, p in zip(graphs, partitions, strict=True)]
    return float(np.average(values, weights=[graph.number_of_edges() for graph in graphs]))


def _sets(community: NDArray) -> Partition:
    order = np.argsort(community, kind="stable")
    cuts = np.flatnonzero(np.diff(community[order])) + 1
    return [set(part.tolist()) for part in np.split(order, cuts)]
