"""The cell graph's weights and what a user holds."""

import numpy as np
import pytest
from random_frames import IS_THING, LABELS, random_frames
from sequences import write_tiny_sequence

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.exports.graphs import to_networkx
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.paper import class_graphs
from simaps_viz.structures import Frame


def graphs_of(frames):
    accumulator = MapAccumulator(LABELS, IS_THING, ProjectionSettings())
    for part in frames:
        accumulator.add_frame(*part)
    grid = accumulator.snapshot()
    edges, labels, counts = accumulator.links.entries()
    return grid, class_graphs(grid, edges - np.tile(np.array(accumulator.origin_cell), 2), labels, counts)


def test_weight_is_count_over_mean_observations():
    grid, graphs = graphs_of(random_frames(3))
    assert [LABELS[g.label] for g in graphs] == ["chair", "table"]
    seen = grid.observations.reshape(-1)
    for graph in graphs:
        assert (grid.label.reshape(-1)[graph.cells] == graph.label).all()
        assert (graph.edges[:, 0] < graph.edges[:, 1]).all()
        for (a, b), count, weight in zip(graph.edges, graph.counts, graph.weights, strict=True):
            assert weight == count / ((seen[graph.cells[a]] + seen[graph.cells[b]]) / 2)


def test_showing_every_frame_twice_leaves_the_weights_unchanged():
    frames = random_frames(3)
    again = [(Frame(f.index + 3, f.name, f.depth_m, T, f.intrinsics), s, T) for f, s, T in frames]
    _, once = graphs_of(frames)
    _, twice = graphs_of(frames + again)
    for a, b in zip(once, twice, strict=True):
        assert np.array_equal(a.edges, b.edges)
        assert np.array_equal(2 * a.counts, b.counts)
        assert np.allclose(a.weights, b.weights, rtol=1e-12)


def test_networkx_graph_is_the_maps(tmp_path):
    simap = build_map(open_sequence(write_tiny_sequence(tmp_path)), BuildConfig())
    graph = to_networkx(simap, "chair")
    chairs = np.argwhere(simap.grid.label == simap.grid.labels.index("chair"))
    assert set(graph.nodes) == {tuple(map(int, cell)) for cell in chairs} and len(graph) == 32
    assert sum(weight for *_, weight in graph.edges(data="weight")) == pytest.approx(simap.graphs[0].weights.sum())
    assert {graph.nodes[n]["instance"] for n in graph} == {i.id for i in simap.instances}
    with pytest.raises(InputError, match=r"class 'sofa'.*chair"):
        to_networkx(simap, "sofa")
