"""Same or different: the pairs of cells against their plain twin, and what they decide on small drawings."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_readings import (
    IS_THING,
    LABELS,
    MemorySource,
    drawn_grid,
    drawn_readings,
    evidence_map,
    grid_of,
    random_readings,
    readings_of,
)
from evidence_twins import blocks, evidence_of, plain_gap, plain_pairs
from random_frames import random_frames

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.mapping.evidence import EvidenceSettings, pair_graphs, pair_steps
from simaps_viz.structures import CellGraph, Segment, Segmentation, SIMap

CLASSES = {"1": "chair", "2": "chair", "3": "chair", "t": "table", "_": "floor"}
ALL = EvidenceSettings(gap_cells=-1)


@pytest.mark.parametrize(
    "settings",
    [
        EvidenceSettings(),
        ALL,
        EvidenceSettings(gap_cells=0),
        EvidenceSettings(ranges=(1, 3, 5, 7), gap_cells=2),
        EvidenceSettings(ranges=(2,), different=False),
        EvidenceSettings(ranges=(30,)),
    ],
)
@pytest.mark.parametrize("seed", range(5))
def test_pairs_are_the_twins(seed, settings):
    grid, readings = random_readings(seed, shape=(20, 23) if seed % 2 else (13, 9))
    graphs = pair_graphs(grid, readings, settings)
    wanted = plain_pairs(grid, readings, settings)
    assert evidence_of(graphs) == wanted
    assert (len(wanted) > 30) == (settings.ranges != (30,))
    assert sum(len(graph.edges) for graph in graphs) == len(wanted), "no pair twice"
    for graph in graphs:
        assert np.array_equal(graph.cells, np.flatnonzero(grid.label.reshape(-1) == graph.label))
        edges = graph.edges.tolist()
        assert all(a < b for a, b in edges) and edges == sorted(edges)
        assert np.array_equal(graph.weights, graph.counts / (graph.counts + graph.different + 1.0))
    things = [i for i in np.unique(grid.label).tolist() if grid.is_thing[i]]
    assert [graph.label for graph in graphs] == things


@pytest.mark.parametrize("shape", [(1, 1), (1, 12), (12, 1), (2, 9), (9, 2), (3, 3)])
def test_narrow_grids_do_not_wrap_around(shape):
    for seed in range(8):
        grid, readings = random_readings(seed, shape=shape)
        for settings in (EvidenceSettings(gap_cells=0), ALL):
            assert evidence_of(pair_graphs(grid, readings, settings)) == plain_pairs(grid, readings, settings)


def test_steps_run_along_rows_columns_and_diagonals_and_only_forward():
    assert pair_steps((1, 4)).tolist() == [[0, 1], [1, 0], [1, 1], [1, -1], [0, 4], [4, 0], [4, 4], [4, -4]]
    assert pair_steps(()).shape == (0, 2)


def test_without_readings_every_cell_of_a_thing_is_still_in_its_graph():
    grid = drawn_grid("c_c\ntt_")
    graphs = pair_graphs(grid, readings_of(np.zeros((0, 6))), EvidenceSettings())
    assert [(g.label, g.cells.tolist(), g.edges.shape) for g in graphs] == [(1, [0, 2], (0, 2)), (3, [3, 4], (0, 2))]
    assert pair_graphs(drawn_grid("__\n.?"), readings_of(np.zeros((0, 6))), EvidenceSettings()) == ()


def test_one_frame_is_one_witness_whatever_it_calls_its_segments():
    grid = drawn_grid("ccct")
    readings = drawn_readings(grid, ["112t", "221t", "11tt", "_1.t", "1?3?"], CLASSES)
    found = evidence_of(pair_graphs(grid, readings, EvidenceSettings()))
    # Cells 0, 1: same, same, same. Cells 1, 2: different twice; once it was a table, once nothing.
    assert found == {(1, 0, 1): (3, 0), (1, 1, 2): (0, 2), (1, 0, 2): (0, 3)}


def test_affinity_of_a_pair_is_same_of_all_and_one_more():
    graph = CellGraph(1, np.arange(3), np.array([[0, 1], [1, 2]], np.int32), np.array([3, 0]), np.array([4, 2]), None)
    assert graph.weights.tolist() == [3 / 8, 0.0] and graph.different.tolist() == [4, 2]


@pytest.mark.parametrize(
    ("between", "gap"),
    [("______", 6), ("cc____", 4), ("__....", 6), ("tttttt", 0), ("??????", 0), ("_t_t__", 4), ("rrrrrr", 6)],
)
def test_open_cells_are_counted(between, gap):
    grid = drawn_grid(f"c{between}c", {".": 0.30})
    assert plain_gap(grid, 0, 7) == gap
    readings = drawn_readings(grid, ["1??????1"], CLASSES)
    for kept, allowed in ((True, gap), (False, gap - 1)):
        settings = EvidenceSettings(ranges=(7,), gap_cells=allowed)
        if allowed >= 0:
            assert bool(evidence_of(pair_graphs(grid, readings, settings))) == kept


def test_what_nobody_named_closes_a_gap_only_at_the_height_of_the_object():
    for height, gap in ((0.30, 6), (0.41, 0), (0.45, 0), (0.60, 0)):
        assert plain_gap(drawn_grid("c......c", {".": height}), 0, 7) == gap


def instances(simap: SIMap) -> list[str]:
    """The cells of every instance as text, by row and column, for reading."""
    return sorted("".join("x" if c == i.id else "." for c in simap.instance.reshape(-1)) for i in simap.instances)


def rows(line: str, count: int = 4) -> str:
    return "\n".join([line] * count)


def test_two_that_touch_stay_apart_when_frames_tell_them_apart():
    grid = drawn_grid(rows("cccccccc"))
    apart = drawn_readings(grid, [rows("11112222"), rows("22221111")] * 3, CLASSES)
    assert blocks(evidence_map(grid, apart).instance) == blocks(np.array([[1, 1, 1, 1, 2, 2, 2, 2]] * 4))
    # Who only counts what was seen as one has nothing against touching objects.
    blind = evidence_map(grid, apart, settings=EvidenceSettings(different=False))
    assert len(blind.instances) == 1
    whole = evidence_map(grid, drawn_readings(grid, [rows("11111111")] * 6, CLASSES))
    assert len(whole.instances) == 1 and whole.instances[0].cells == 32


def test_one_frame_in_ten_that_glues_two_is_outvoted_and_nine_are_believed():
    grid = drawn_grid(rows("cccccccc"))
    for glued, count in ((1, 2), (9, 1)):
        looks = [rows("11111111")] * glued + [rows("11112222")] * (10 - glued)
        assert len(evidence_map(grid, drawn_readings(grid, looks, CLASSES)).instances) == count


def test_one_that_a_higher_thing_cuts_is_joined_at_long_range():
    grid = drawn_grid(rows("cccttttttccc"))
    readings = drawn_readings(grid, [rows("111tttttt111")] * 3, CLASSES)
    assert evidence_map(grid, readings).counts() == {"chair": 1, "table": 1}
    near_only = evidence_map(grid, readings, settings=EvidenceSettings(ranges=(1, 2, 4)))
    assert near_only.counts() == {"chair": 2, "table": 1}
    told_apart = drawn_readings(grid, [rows("111tttttt222")] * 3, CLASSES)
    assert evidence_map(grid, told_apart).counts() == {"chair": 2, "table": 1}


def test_two_with_open_floor_between_are_not_joined_by_masks_that_span_both():
    grid = drawn_grid(rows("ccccc______ccccc"))
    readings = drawn_readings(grid, [rows("1111111111111111")] * 8, CLASSES)
    assert evidence_map(grid, readings).counts() == {"chair": 2}
    assert evidence_map(grid, readings, settings=EvidenceSettings(gap_cells=6)).counts() == {"chair": 1}
    assert evidence_map(grid, readings, settings=ALL).counts() == {"chair": 1}
    hole = drawn_grid(rows("ccccc_____cccccc"))  # five cells of floor: as wide as holes are
    readings = drawn_readings(hole, [rows("1111111111111111")] * 8, CLASSES)
    assert evidence_map(hole, readings).counts() == {"chair": 1}


def test_what_was_never_seen_together_and_does_not_touch_stays_apart():
    grid = drawn_grid(rows("ccc_ccc"))
    readings = drawn_readings(grid, [rows("111_???"), rows("???_111")] * 3, CLASSES)
    assert evidence_map(grid, readings).counts() == {"chair": 2}
    touching = drawn_grid(rows("cccccc"))  # touching is believed to be one
    readings = drawn_readings(touching, [rows("111???"), rows("???111")] * 3, CLASSES)
    assert evidence_map(touching, readings).counts() == {"chair": 1}


def partition_of(simap: SIMap) -> tuple:
    """All that must not hang on names of segments or indices of classes."""
    facts = {(i.label, i.cells, i.centroid_m, i.aabb_m, i.frames, i.score) for i in simap.instances}
    names = np.array(simap.grid.labels)[simap.grid.label].tolist()
    return names, blocks(simap.instance), blocks(simap.community), facts


def renumbered(parts, seed: int):
    rng = np.random.default_rng(seed)
    for frame, segmentation, T in parts:
        new = np.concatenate([[0], 1 + rng.permutation(200)]).astype(np.int32)
        known = tuple(replace(s, id=int(new[s.id])) for s in segmentation.segments)
        yield frame, Segmentation(new[segmentation.ids], known[::-1]), T


def steady_frames(seed: int):
    """Random frames whose segments keep their classes, at one place, so that cells are seen again and again."""
    names = ("chair", "chair", "floor", "table")
    first = random_frames(seed, frames=5)
    for frame, segmentation, _ in first:
        named = [(s.id, names[s.id - 1], s.score) for s in segmentation.segments]
        known = tuple(Segment(number, name, score, name != "floor") for number, name, score in named)
        yield frame, Segmentation(segmentation.ids, known), first[0][2]


FRAME_LABELS, FRAME_THINGS = ("none", "chair", "floor", "table"), (False, True, False, True)


@pytest.mark.parametrize("seed", range(4))
def test_renumbering_the_segments_of_any_frame_changes_nothing(seed):
    parts = list(steady_frames(seed))
    config = BuildConfig(min_cells=1)
    one, other = (
        build_map(MemorySource(p, FRAME_LABELS, FRAME_THINGS), config) for p in (parts, list(renumbered(parts, seed)))
    )
    assert len(one.instances) > 5 and len(one.merges) > 5
    assert partition_of(one) == partition_of(other)
    assert np.array_equal(one.community, other.community) and one.instances == other.instances
    for a, b in zip(one.graphs, other.graphs, strict=True):
        assert np.array_equal(a.counts, b.counts) and np.array_equal(a.different, b.different)
    assert any(len(graph.different) and graph.different.any() for graph in one.graphs)


@pytest.mark.parametrize("seed", range(4))
def test_other_indices_of_the_classes_only_rename(seed):
    parts = list(steady_frames(seed))
    one = build_map(MemorySource(parts, FRAME_LABELS, FRAME_THINGS), BuildConfig(min_cells=1))
    order = [0, 3, 2, 1]
    labels, things = tuple(FRAME_LABELS[i] for i in order), tuple(FRAME_THINGS[i] for i in order)
    other = build_map(MemorySource(parts, labels, things), BuildConfig(min_cells=1))
    assert one.counts().keys() == {"chair", "table"}
    assert partition_of(one) == partition_of(other)
    assert not np.array_equal(one.grid.label, other.grid.label)


def test_classes_are_partitioned_each_for_itself():
    grid, readings = random_readings(11, shape=(20, 20), frames=8)
    whole = evidence_map(grid, readings)
    for index, name in enumerate(LABELS):
        if not IS_THING[index]:
            continue
        alone = grid_of(np.where(grid.label == index, index, 2).astype(np.int16), grid.height_m)
        mine = readings.where(readings.label == index)
        settings = EvidenceSettings(gap_cells=-1)
        found = evidence_map(alone, mine, settings=settings)
        wanted = evidence_map(grid, readings, settings=settings)
        own = np.where(grid.label == index, wanted.instance, 0)
        assert blocks(found.instance) == blocks(own) and name in whole.counts()
