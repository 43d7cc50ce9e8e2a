"""The bench runs on a tiny sequence and says what it should: its counts are checked, its clocks are not."""

import math
import re
from dataclasses import replace

import measure_masks
import numpy as np
import pytest
from benchmarks import mapping, points, report
from benchmarks.graphs import by_networkx, by_python_louvain, by_scikit_network
from benchmarks.graphs import to_networkx as plain_graph
from benchmarks.planner import bench_planner
from benchmarks.timing import Cost, measure, times
from sequences import write_tiny_sequence

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.scenes.simulated_errors import LEVELS, PLACES, KnownInstance, simulate_errors
from simaps_viz.structures import Pose2, Segment, Segmentation, SIMap

RATIO = re.compile(r"^ +([\d,.]+) x ")


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> PosedFrames:
    return open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("bench"), frames=4))


@pytest.fixture(scope="module")
def maps(tiny) -> dict[str, SIMap]:
    return {method: build_map(tiny, BuildConfig(method=method)) for method in mapping.METHODS}


def ratio(line: str) -> float:
    found = RATIO.match(line)
    assert found, line
    return float(found[1].replace(",", ""))


def test_costs_are_medians_of_the_runs_that_count_in_turn():
    order: list[str] = []
    costs = measure({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, runs=3)
    assert order == ["a", "b"] * 4 and len(costs["a"].wall_s) == len(costs["b"].cpu_s) == 3
    measure({"a": lambda: order.append("a")}, runs=2, warm=False)
    assert len(order) == 10
    cost = Cost((3.0, 1.0, 9.0), (2.0, 8.0, 4.0))
    assert (cost.wall, cost.cpu) == (3.0, 4.0)


@pytest.mark.parametrize(
    ("value", "words"), [(0.504, "0.50 x"), (2.0, "2.00 x"), (13.04, "13.0 x"), (341.33, "341 x"), (1158.2, "1,158 x")]
)
def test_ratios_keep_the_digits_that_mean_something(value, words):
    assert times(value) == words


def test_ours_and_the_loop_count_the_same_points(tiny):
    lines = list(points.bench_points(tiny, frames=2, looped=2, runs=1))
    assert "required: 500 x" in lines[1] and "ours, evidence" in lines[1] and "ours, paper" in lines[2]
    assert "own re-implementation" in lines[4] and ratio(lines[4]) == 1.0
    ours, loop = (int(re.findall(r"([\d,]+) points", lines[i])[0].replace(",", "")) for i in (1, 4))
    assert ours == loop > 0
    T_map_camera = tiny.T_map_world @ tiny.poses
    posed = [(tiny.read(i), tiny.segmentation(i), T_map_camera[i]) for i in (0, 3)]
    gathered = points.vlmaps_point_loop(
        [(f, points.SimulatedLSeg(tiny.labels).pixels(f, s), T) for f, s, T in posed],
        ProjectionSettings(), stride=1,
    )  # fmt: skip
    assert gathered.points == ours


def test_three_louvains_partition_every_graph(maps):
    graphs = [graph for graph in maps["paper"].graphs if len(graph.edges)]
    plain = [plain_graph(graph) for graph in graphs]
    for found in (by_scikit_network(graphs, 0), by_networkx(plain, 0), by_python_louvain(plain, 0)):
        for graph, parts in zip(graphs, found, strict=True):
            assert sorted(cell for part in parts for cell in part) == list(range(len(graph.cells)))
    for graph, theirs in zip(graphs, plain, strict=True):
        assert theirs.number_of_edges() == len(graph.edges)
        assert theirs.size(weight="weight") == pytest.approx(graph.weights.sum())


def test_the_complete_bench_has_its_seven_sections_and_counts_right(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "bench_planner", lambda: bench_planner(side_cells=260, pairs=1, compared=1))
    painted: list[float] = []
    lines = list(
        report.bench_lines(
            [tiny],
            paint=lambda simap: painted.append(simap.parameters.get("k_percent", -1.0)),
            start=lambda m: Pose2(0.0, 0.0, 0.0),
            scratch=tmp_path,
            runs=1,
        )
    )
    assert [line[1] for line in lines if re.match(r"\n\d\. ", line)] == list("1234567")
    said = [line for line in lines if re.match(r" +[\d.]+ ms  (ok|refused|failed)", line)]
    assert len(said) == len(report.COMMANDS) and not any("{" in line for line in said)
    assert re.fullmatch(r"\nThe whole bench took \d+ s; load at the end [\d.]+\.", lines[-1])
    # What is counted, whatever the clocks say.
    (cells,) = (line for line in lines if "6 bytes a cell, 6.0 MB" in line)
    assert [ratio(line) for line in lines[lines.index(cells) + 1 :][:2]] == [2.67, 341]
    values = [float(found) for line in lines for found in re.findall(r"modularity (\S+)", line)]
    assert len(values) == 3 and max(values) - min(values) < 0.1 and min(values) > 0.0
    assert {0.0, 100.0} <= set(painted)  # sliders move over their complete range
    kept = [(int(m[1]), int(m[2])) for line in lines if (m := re.match(r" +(\d+) of (\d+) +cut as", line))]
    assert kept and all(same == of for same, of in kept[: len(kept) // 2])  # a chair among others is the same chair


def test_errors_of_masks_are_counted_one_by_one():
    """Five chairs and a lamp: found, misnamed, split in halves too small to count, two merged, missed."""
    exact, found = np.zeros((40, 512), np.int32), np.zeros((40, 512), np.int32)
    for number, left in enumerate((0, 40, 80, 120, 131, 170), 1):
        exact[10:20, left : left + 10] = number
    found[10:20, 1:11] = 1  # one pixel to the right
    found[10:20, 40:50] = 2
    found[10:20, 80:85], found[10:20, 85:90] = 3, 4
    found[10:20, 120:141] = 5
    found[30:38, 100:110] = 6
    labels = {1: "chair", 2: "couch", 3: "chair", 4: "chair", 5: "chair", 6: "chair"}
    truth = Segmentation(exact, tuple(Segment(i, "lamp" if i == 6 else "chair") for i in range(1, 7)))
    errors = measure_masks.MaskErrors(frozenset({"chair", "couch", "lamp"}))
    for distance_m in (1.0, 4.0):
        depth_m = np.full(exact.shape, distance_m, np.float32)
        segments = tuple(Segment(i, label, 0.3 if label == "couch" else 0.9) for i, label in labels.items())
        errors.add(truth, Segmentation(found, segments), depth_m)
    assert errors.by_class == {"chair": [10, 0], "lamp": [2, 2]}
    assert errors.by_band == {0: [6, 1], 2: [6, 1]} and errors.by_size == {0: [12, 2]}
    assert errors.after == {"found": [5, 0], "missed": [1, 1]}
    assert (errors.renamed, errors.split, errors.merged, errors.invented) == ([10, 2], [10, 2], [2, 2], [8, 2])
    assert len(errors.border_px) == 2 and 0.0 < errors.border_px[0] < 1.0
    assert "renamed: 0.200 of 10" in list(errors.lines())
    assert errors.unnamed == [0, 0]
    level = errors.level()
    assert level.by_class is not None and set(level.by_class) == {"chair"}  # lamps were never found
    chair = level.by_class["chair"]
    assert (chair.miss_by_size, chair.names) == ((0.0,), {"chair": 0.8, "couch": 0.2})
    assert chair.scores == ((0.3,) * 2, (0.9,) * 8)
    assert (level.split, level.merge) == (0.2, 1.0)
    errors.later = [[8, 2], [1, 9]]  # odds of 36
    assert errors.lasting() == pytest.approx(math.cos(math.pi / 7))


def test_things_that_a_network_has_no_name_for_are_counted_apart():
    exact, found = np.zeros((40, 512), np.int32), np.zeros((40, 512), np.int32)
    exact[10:20, :10], exact[10:20, 40:50], exact[10:20, 80:90] = 1, 2, 3
    found[10:20, :10], found[10:20, 80:82] = 1, 2
    errors = measure_masks.MaskErrors(frozenset({"chair"}))
    things = Segmentation(exact, (Segment(1, "lamp"), Segment(2, "lamp"), Segment(3, "lamp")))
    errors.add(
        things, Segmentation(found, (Segment(1, "chair"), Segment(2, "chair"))), np.ones(exact.shape, np.float32)
    )
    assert errors.unnamed == [3, 1] and errors.by_class == {}
    # A third of the lamps is shown; four cases of that rate are added to those of a size.
    by_class = errors.level().by_class
    assert by_class is not None and by_class["lamp"].miss_by_size == pytest.approx(((2 + 4 * 2 / 3) / (3 + 4),))


def test_what_segments_cover_of_a_thing_and_beside_it_is_measured_by_place_and_simulated(monkeypatch):
    """Its segment lacks the right half of a box, and covers as much floor on its left."""
    exact, found = np.zeros((40, 80), np.int32), np.zeros((40, 80), np.int32)
    exact[10:26, 32:48], found[10:26, 24:40] = 1, 1
    errors = measure_masks.MaskErrors(frozenset({"box"}))
    errors.add(
        Segmentation(exact, (Segment(1, "box"),)), Segmentation(found, (Segment(1, "box"),)), np.ones(exact.shape)
    )
    level = errors.level()
    assert level.by_class is not None and level.by_class["box"].extent is not None
    beside, own = np.round(level.by_class["box"].extent).reshape(2, PLACES, PLACES)
    assert not own[2:6, 4:6].any() and own[2:6, 2:4].all()
    assert beside[2:6, :2].all() and not beside[:, 4:].any() and not beside[[0, 1, 6, 7]].any()
    monkeypatch.setitem(LEVELS, "custom", replace(level, border_px=0.0))
    box = {1: KnownInstance("box", True, (0.0, 0.0))}
    simulated = [simulate_errors(exact, box, level="custom", seed=0, frame=str(i))[0] for i in range(21)]
    assert (np.median(simulated, axis=0) == found).all()
