"""The steps in which a map's objects came about: classes, Louvain's levels, merges."""

import numpy as np
import pytest
from sequences import write_tiny_sequence
from toy_maps import toy_map

from simaps_viz import build_map, open_sequence
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.mapping import timeline as timeline_module
from simaps_viz.mapping.communities import find_communities, find_communities_together
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import joining_threshold, repartition
from simaps_viz.mapping.timeline import CLASSES, Timeline


@pytest.fixture(scope="module", params=["evidence", "paper"])
def simap(request, tmp_path_factory):
    sequence = open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("tiny"), frames=6))
    return build_map(sequence, BuildConfig(method=request.param))


def same_parts(one, other):
    """Two pictures of ids mean the same parts, however they are called."""
    pairs = np.unique(np.stack([one.ravel(), other.ravel()]), axis=1)
    return len(np.unique(pairs[0])) == len(np.unique(pairs[1])) == pairs.shape[1]


def test_the_last_level_of_louvain_is_the_maps_communities(simap):
    timeline = Timeline(simap)
    at_last = timeline.map_at(timeline.levels)
    assert np.array_equal(at_last.instance, simap.community)
    counts = [len(np.unique(timeline.map_at(level).instance)) for level in range(1, timeline.levels + 1)]
    assert counts == sorted(counts, reverse=True) and len(set(counts)) == len(counts)


def test_a_level_joins_whole_communities_of_the_one_before(simap):
    timeline = Timeline(simap)
    for level in range(1, timeline.levels):
        finer, coarser = timeline.map_at(level).instance, timeline.map_at(level + 1).instance
        pairs = np.unique(np.stack([finer.ravel(), coarser.ravel()]), axis=1)
        assert len(np.unique(pairs[0])) == pairs.shape[1]


def test_levels_end_where_louvain_ends(simap):
    if simap.method == "evidence":
        parts = find_communities_together(simap.graphs, simap.spec, resolution=1.0, seed=0)
    else:
        parts = [find_communities(graph, resolution=1.0, seed=0) for graph in simap.graphs]
    assert sum(int(p.max()) + 1 for p in parts) == len(np.unique(simap.community)) - 1


def test_before_all_steps_nothing_is_told_apart_and_after_those_taken_it_is_the_map(simap):
    timeline = Timeline(simap)
    assert not timeline.map_at(CLASSES).instance.any()
    assert timeline.map_at(timeline.finished) is simap
    assert timeline.taken == applied_steps(simap.merges, joining_threshold(simap.method, simap.parameters)).sum()


def test_every_merge_makes_one_part_less():
    simap = toy_map(k_percent=100.0)
    timeline = Timeline(simap)
    parts = [len(np.unique(timeline.map_at(p).instance)) for p in range(timeline.levels, timeline.last + 1)]
    assert timeline.taken == 0 and np.all(np.diff(parts[1:]) == -1)
    lax = repartition(simap, k_percent=0.0)
    assert same_parts(timeline.map_at(timeline.last).instance, lax.instance)


def test_each_step_is_said_in_words():
    simap = toy_map()
    timeline = Timeline(simap)
    assert timeline.words(CLASSES).startswith("Classes only")
    assert "parts, before any is joined" in timeline.words(timeline.levels)
    first = timeline.words(timeline.levels + 1)
    at = int(np.flatnonzero(applied_steps(simap.merges, 0.05))[0])
    name = simap.grid.labels[int(simap.merges.label[at])]
    assert first.startswith(f"Step 1 of {len(simap.merges)}: {name}, parts ") and "% of the cells" in first
    assert f"{timeline.taken} steps applied" in timeline.words(timeline.finished)
    assert "which the map does not apply" in timeline.words(timeline.last)
    everywhere = range(timeline.last + 1)  # what the page's badge says is what the words beside the slider begin with
    assert all(timeline.words(p).lower().startswith(timeline.name(p).lower()) for p in everywhere)
    assert timeline.name(timeline.last) == f"step {len(simap.merges)} of {len(simap.merges)}"


def test_positions_and_times_of_a_recording_are_one_another():
    timeline = Timeline(toy_map())
    for position in range(CLASSES, timeline.last + 1):
        assert timeline.position_of(*timeline.recorded(position)) == position
    assert timeline.recorded(timeline.levels) == ("louvain", timeline.levels) and timeline.levels > 2
    assert timeline.recorded(1) == ("louvain", 1)
    assert timeline.recorded(timeline.levels + 2) == ("merge", 2) and timeline.recorded(CLASSES) == ("louvain", 0)
    assert timeline.position_of("louvain", 0) == CLASSES and timeline.position_of("merge", 10**6) == timeline.last


def test_another_cut_of_the_same_communities_has_the_same_levels_without_a_second_search(simap, monkeypatch):
    first = Timeline(simap)
    levels = first.levels
    monkeypatch.setattr(timeline_module, "_levels_of", lambda simap: pytest.fail("searched again"))
    other = repartition(simap, **({"affinity": 0.99} if simap.method == "evidence" else {"k_percent": 99.0}))
    cut = Timeline(other, like=first)
    assert cut.levels == levels and cut.simap is other
    with pytest.raises(pytest.fail.Exception, match="searched again"):
        assert Timeline(other).levels
