"""From evidence to communities and their log: exact partitions, prefixes of the log, independence, recommunity."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_readings import evidence_map, grid_of, random_readings, readings_of
from evidence_twins import blocks, plain_follow, plain_pool, plain_touching
from sequences import write_tiny_sequence

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.mapping.communities import find_communities_together
from simaps_viz.mapping.evidence import EvidenceSettings, pair_graphs
from simaps_viz.mapping.methods import METHODS
from simaps_viz.mapping.observations import Readings
from simaps_viz.mapping.pooling import PoolSettings, partition_evidence, touching_pairs
from simaps_viz.mapping.simap import joining_at, joining_percent, recommunity, repartition
from simaps_viz.structures import CellGraph, Grid, GridSpec, SIMap


@pytest.fixture(scope="module", params=range(3))
def case(request) -> tuple[Grid, Readings, SIMap]:
    grid, readings = random_readings(request.param, shape=(30, 33), frames=8)
    return grid, readings, evidence_map(grid, readings)


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (6, 1), (2, 2), (7, 5)])
def test_touching_pairs_are_the_twins(shape):
    rng = np.random.default_rng(0)
    for share in (0.0, 0.3, 0.7, 1.0):
        cells = np.flatnonzero(rng.random(shape[0] * shape[1]) < share)
        found = touching_pairs(cells, GridSpec(shape[0], shape[1], 0.05, 0.0, 0.0))
        assert found.dtype == np.int32 and found.shape == (len(found), 2)
        rows = [tuple(sorted(pair)) for pair in found.tolist()]
        assert len(rows) == len(set(rows)) and set(rows) == plain_touching(cells, shape[1])


def test_communities_partition_the_cells_of_things_exactly(case):
    grid, _, simap = case
    thing = np.array(grid.is_thing)[grid.label]
    assert np.array_equal(simap.community > 0, thing) and np.array_equal(simap.instance > 0, thing)
    numbers = np.unique(simap.community[thing])
    assert np.array_equal(numbers, np.arange(1, len(numbers) + 1))
    class_of = {int(n): set(grid.label[simap.community == n].tolist()) for n in numbers}
    assert all(len(classes) == 1 for classes in class_of.values())
    log = simap.merges
    assert (log.label.dtype, log.source.dtype, log.target.dtype, log.score.dtype) == (
        np.int16, np.int32, np.int32, np.float32,
    )  # fmt: skip
    for label, source, target in zip(log.label, log.source, log.target, strict=True):
        assert class_of[int(source)] == class_of[int(target)] == {int(label)}
    assert (np.diff(log.label) >= 0).all() and len(log) > 50


@pytest.mark.parametrize("belief", [None, PoolSettings(10.0, 0.3), PoolSettings(1.0, 0.0)])
def test_the_log_is_the_twins_class_by_class(case, belief):
    grid, readings, _ = case
    graphs = pair_graphs(grid, readings, EvidenceSettings())
    community, log = partition_evidence(grid, graphs, resolution=1.0, seed=0, settings=belief)
    found = []
    for graph in graphs:
        mine = community.reshape(-1)[graph.cells]
        touching = np.array(sorted(plain_touching(graph.cells, grid.spec.cols))).reshape(-1, 2)
        steps = plain_pool(mine, graph.edges, graph.counts, graph.different, touching, belief or PoolSettings())
        found += [(graph.label, s, t, float(np.float32(a))) for s, t, a in steps]
    assert found == list(zip(*(a.tolist() for a in (log.label, log.source, log.target, log.score)), strict=True))


def test_every_affinity_of_the_log_is_following_the_log_by_hand(case):
    _, _, simap = case
    scores = np.unique(simap.merges.score)
    wanted = [0.0, *scores[:: max(1, len(scores) // 25)].tolist(), *np.nextafter(scores[::40], 0.0).tolist(), 0.6, 1.0]
    for affinity in wanted:
        found = repartition(simap, affinity=affinity)
        assert blocks(found.instance) == blocks(plain_follow(simap.merges, simap.community, affinity))
        assert found.parameters["affinity"] == affinity and found.community is simap.community
        assert {i.id for i in found.instances} == set(np.unique(found.instance[found.instance > 0]).tolist())


def test_affinity_one_gives_the_finest_communities_and_finer_affinities_only_split(case):
    _, _, simap = case
    assert np.array_equal(repartition(simap, affinity=1.0).instance, simap.community)
    coarser = None
    for affinity in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        finer = blocks(repartition(simap, affinity=affinity).instance)
        assert coarser is None or all(any(part <= whole for whole in coarser) for part in finer)
        coarser = finer


def test_affinity_zero_joins_all_that_touches_or_was_ever_seen_as_one(case):
    _, _, simap = case
    root = {int(cell): int(cell) for cell in np.flatnonzero(simap.community)}

    def find(cell: int) -> int:
        while root[cell] != cell:
            cell = root[cell]
        return cell

    for members in blocks(simap.community):
        for cell in members:
            root[find(cell)] = find(min(members))
    for graph in simap.graphs:
        seen = graph.edges[graph.counts > 0].tolist()
        for a, b in [*seen, *plain_touching(graph.cells, simap.spec.cols)]:
            root[find(int(graph.cells[a]))] = find(int(graph.cells[b]))
    joined = np.zeros(simap.community.size, int)
    for cell in root:
        joined[cell] = find(cell) + 1
    assert blocks(repartition(simap, affinity=0.0).instance) == blocks(joined)


def test_nothing_and_one_cell():
    nothing = grid_of(np.full((2, 2), 2, np.int16), np.zeros((2, 2), np.float32))
    empty = evidence_map(nothing, readings_of(np.zeros((0, 6))))
    assert not empty.community.any() and len(empty.merges) == 0 and empty.graphs == () and empty.instances == ()
    one = grid_of(np.array([[1]], np.int16), np.array([[0.5]], np.float32))
    for table in (np.zeros((0, 6)), np.array([[0, 0, 1, 1, 1.0, 0.5]])):
        alone = evidence_map(one, readings_of(table))
        assert alone.community.tolist() == alone.instance.tolist() == [[1]] and len(alone.merges) == 0


def beside(tiles, gap: int = 20) -> tuple[Grid, Readings, list[slice]]:
    """Lay maps side by side, with more floor between than the longest range."""
    height = max(grid.spec.rows for grid, _ in tiles)
    width = sum(grid.spec.cols + gap for grid, _ in tiles)
    label, top = np.full((height, width), 2, np.int16), np.zeros((height, width), np.float32)
    parts, places, col = [], [], 0
    for grid, r in tiles:
        at = slice(col, col + grid.spec.cols)
        label[: grid.spec.rows, at], top[: grid.spec.rows, at] = grid.label, grid.height_m
        row, column = np.divmod(r.cell, grid.spec.cols)
        parts.append(np.stack([row * width + column + col, r.frame, r.segment, r.label, r.score, r.height_m], axis=1))
        places.append(at)
        col = at.stop + gap
    table = np.concatenate(parts)
    return grid_of(label, top), readings_of(table[np.argsort(table[:, 1], kind="stable")]), places


@pytest.mark.parametrize("copies", [2, 3, 7, 40])
def test_what_else_is_on_the_map_far_away_changes_no_object(copies):
    tile = random_readings(5, shape=(16, 18))
    alone = evidence_map(*tile)
    others = [random_readings(20 + i, shape=(9 + i, 14)) for i in range(3)]
    for tiles in ([tile] * copies, [tile, *others], [*others, tile]):
        grid, readings, places = beside(tiles)
        found = evidence_map(grid, readings)
        for (mine, _), place in zip(tiles, places, strict=True):
            if mine is tile[0]:
                rows = slice(0, mine.spec.rows)
                assert blocks(found.community[rows, place]) == blocks(alone.community)
                assert blocks(found.instance[rows, place]) == blocks(alone.instance)
    assert len(blocks(alone.community)) > 20 and len(alone.instances) < len(blocks(alone.community))


def test_a_higher_resolution_gives_smaller_communities(case):
    _, _, simap = case
    counts = [int(recommunity(simap, resolution=r).community.max()) for r in (0.04, 4.0, 12.0, 80.0)]
    assert counts[0] <= counts[1] < counts[2] < counts[3]


def test_recommunity_at_the_same_resolution_gives_back_the_same_map(case):
    _, _, simap = case
    again = recommunity(recommunity(simap, resolution=4.0), resolution=1.0)
    assert np.array_equal(again.community, simap.community) and np.array_equal(again.instance, simap.instance)
    same_log(again, simap)
    direct = recommunity(simap, resolution=1.0, affinity=0.8)
    assert direct.instances == repartition(simap, affinity=0.8).instances
    assert direct.parameters == {**simap.parameters, "affinity": 0.8}


def same_log(one: SIMap, other: SIMap) -> None:
    for name in ("label", "source", "target", "score"):
        assert np.array_equal(getattr(one.merges, name), getattr(other.merges, name))


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("tiny"), frames=4))


def test_recommunity_keeps_to_the_beliefs_the_map_was_built_with(tiny):
    """Resolution 80 leaves every cell a community of its own, so that the log shows what was believed of them."""
    settings = BuildConfig(pooling=PoolSettings(imagined_pairs=20.0, touching_same=0.2), resolution=80.0)
    simap = build_map(tiny, settings)
    again = recommunity(simap, resolution=80.0)
    assert len(simap.merges) >= 20 and np.array_equal(again.community, simap.community)
    same_log(again, simap)
    usual = build_map(tiny, replace(settings, pooling=PoolSettings()))
    assert not np.array_equal(usual.merges.score, simap.merges.score)


@pytest.mark.parametrize(
    ("method", "call", "message"),
    [
        ("evidence", lambda m: repartition(m, k_percent=5), "method evidence: expected a map that has k_percent"),
        ("evidence", lambda m: repartition(m, k_percent=5, affinity=0.5), "expected a map that has k_percent"),
        ("evidence", lambda m: recommunity(m, resolution=1, k_percent=5), "found affinity only"),
        ("paper", lambda m: repartition(m, affinity=0.5), "method paper: expected a map that has affinity"),
        ("paper", lambda m: recommunity(m, resolution=1, affinity=0.5), "found k_percent only"),
        ("components", lambda m: repartition(m, k_percent=5), "method components: expected a map that has k_percent"),
        ("components", lambda m: repartition(m, affinity=0.5), "method components: expected a map that has affinity"),
        ("components", lambda m: recommunity(m, resolution=2), "method components: expected a map that has"),
        ("evidence", lambda m: repartition(m, affinity=1.01), "affinity: expected a share from 0 to 1, found 1.01"),
        ("evidence", lambda m: repartition(m, affinity=-0.5), "affinity: expected a share from 0 to 1, found -0.5"),
        ("evidence", lambda m: repartition(m, affinity=float("nan")), "affinity: expected a share from 0 to 1"),
        ("evidence", lambda m: recommunity(m, resolution=0), "resolution: expected a number above 0, found 0"),
        ("evidence", lambda m: recommunity(m, resolution=float("nan")), "resolution: expected a number above 0"),
    ],
)  # fmt: skip
def test_what_a_method_does_not_have_is_refused(tiny, method, call, message):
    simap = build_map(tiny, BuildConfig(method=method))
    with pytest.raises(InputError) as caught:
        call(simap)
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_where_the_slider_stands_is_what_it_sets(tiny):
    maps = {name: build_map(tiny, BuildConfig(method=name, affinity=0.55, k_percent=7.5)) for name in METHODS}
    assert {name: joining_percent(m) for name, m in maps.items()} == {"evidence": 55.0, "paper": 7.5, "components": 0.0}
    assert joining_at(maps["evidence"], 30.0) == {"affinity": 0.3}
    assert joining_at(maps["paper"], 30.0) == {"k_percent": 30.0}
    for name, parameter in (("paper", "k_percent"), ("evidence", "affinity")):
        set_by_hand = joining_at(maps[name], 12.5)
        moved = repartition(maps[name], **set_by_hand)
        assert joining_percent(moved) == 12.5 and moved.parameters[parameter] == set_by_hand[parameter]


def test_components_have_communities_and_nothing_to_join(tiny):
    simap = build_map(tiny, BuildConfig(method="components"))
    assert simap.counts() == {"chair": 2} and len(simap.merges) == 0 and simap.graphs == ()
    assert np.array_equal(simap.instance, simap.community)
    assert not {"affinity", "k_percent", "resolution"} & set(simap.parameters)


@pytest.mark.parametrize(("same", "different", "communities"), [(4, 5, 2), (5, 6, 1), (2, 2, 2), (1, 0, 1), (0, 9, 2)])
def test_only_sure_neighbours_hold_a_finest_community_together(same, different, communities):
    """Affinity same / (same + different + 1) of exactly 0.4 is not sure."""
    for cells, sure in (
        ([0, 1], communities),
        ([0, 8], communities),
        ([0, 9], communities),
        ([1, 8], communities),
        ([0, 2], 2),
    ):
        graph = CellGraph(
            1, np.array(cells), np.array([[0, 1]], np.int32), np.array([same]), np.array([different]), None
        )
        found = find_communities_together([graph], GridSpec(4, 8, 0.05, 0.0, 0.0))
        assert found[0].tolist() == ([0, 0] if sure == 1 else [0, 1])


def test_finest_communities_of_no_classes_and_of_classes_without_pairs():
    spec = GridSpec(4, 8, 0.05, 0.0, 0.0)
    none = np.zeros(0, np.int64)
    bare = [CellGraph(n, np.arange(n), none.reshape(-1, 2).astype(np.int32), none, none, None) for n in (1, 3)]
    assert find_communities_together([], spec) == []
    assert [own.tolist() for own in find_communities_together(bare, spec)] == [[0], [0, 1, 2]]
