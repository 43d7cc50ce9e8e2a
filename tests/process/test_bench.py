"""The bench runs on a tiny sequence and says what it should: its counts are checked, its clocks are not."""

import math
import re
from dataclasses import replace
from pathlib import Path

import measure_masks
import numpy as np
import pytest
from benchmarks import growth, mapping, objects, points, report
from benchmarks.graphs import bench_louvain, by_networkx, by_python_louvain, by_scikit_network
from benchmarks.graphs import to_networkx as plain_graph
from benchmarks.planner import bench_planner
from benchmarks.sliders import bench_sliders
from benchmarks.timing import Cost, measure, slowest, times
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


def test_the_slowest_is_found():
    order: list[float] = []
    cost = slowest({value: (lambda v=value: order.append(v)) for value in (1.0, 2.0)}, runs=3)
    assert order == [1.0, 2.0] * 3 and cost.wall > 0.0 and cost.cpu >= 0.0


@pytest.mark.parametrize(
    ("value", "words"), [(0.504, "0.50 x"), (2.0, "2.00 x"), (13.04, "13.0 x"), (341.33, "341 x"), (1158.2, "1,158 x")]
)
def test_ratios_keep_the_digits_that_mean_something(value, words):
    assert times(value) == words


def test_decoding_reads_the_images_that_a_build_reads(tiny):
    files = mapping.image_files(tiny)
    assert len(files) == 2 * len(tiny) and all(file.is_file() for file in files)
    assert {file.parent.name for file in files} == {"depth", "ids"}
    assert {file.parent.name for file in mapping.image_files(tiny, color=True)} == {"depth", "ids", "color"}
    mapping.decode_only(files)
    with pytest.raises(OSError, match="readable"):
        mapping.decode_only([Path(__file__)])


@pytest.mark.parametrize("method", mapping.METHODS)
def test_gathering_ends_with_the_graphs_that_the_build_partitions(tiny, maps, method):
    graphs = mapping.gather(tiny, BuildConfig(method=method))
    assert len(graphs) == len(maps[method].graphs) > 0
    for mine, theirs in zip(graphs, maps[method].graphs, strict=True):
        for name in ("cells", "edges", "counts", "weights", "different"):
            assert np.array_equal(getattr(mine, name), getattr(theirs, name))


def test_building_is_compared_with_decoding_for_both_methods(tiny):
    lines = list(mapping.bench_build(tiny, runs=1))
    assert "at most 2 x" in lines[0] and "4 frames" in lines[0]
    words = [line.partition("x CPU   ")[2] for line in lines[2:]]
    assert [word.split(":")[0] for word in words[1:5]] == ["evidence", "evidence", "paper", "paper"]
    assert "the whole map" in words[2] and "the whole map" in words[4]
    assert "all three images decoded" in words[5] and "against all three decoded" in words[5]
    assert all(ratio(line) > 0 and "x wall" in line and "x CPU" in line for line in lines[2:])


def test_all_heights_are_compared_with_tops_alone(tiny):
    cost, file = mapping.bench_surface(tiny, runs=1)
    assert "ms of processor time more" in cost and float(re.findall(r"([\d.]+) x as", file)[0]) > 1.0
    assert build_map(tiny).surface is not None  # nothing is left out afterwards


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


def test_memory_is_six_bytes_a_cell(maps, tmp_path):
    lines = list(points.bench_memory(maps["evidence"], scratch=tmp_path))
    assert "6 bytes a cell, 6.0 MB" in lines[1]
    assert ratio(lines[2]) == 2.67 and "16.0 MB" in lines[2]
    assert ratio(lines[3]) == 341 and "2,048 MB" in lines[3]
    size = (tmp_path / "bench.npz").stat().st_size
    assert f"file {size / 1e6:.2f} MB" in lines[4]


def test_held_bytes_are_those_of_every_array(maps):
    views = maps["paper"].views
    one = sum(getattr(views, name).nbytes for name in ("community", "frame", "segment", "cells", "score"))
    assert points.held_bytes(views) == one
    assert points.held_bytes((views, [views], "words", 7)) == 2 * one


def test_three_louvains_partition_every_graph(maps):
    graphs = [graph for graph in maps["paper"].graphs if len(graph.edges)]
    plain = [plain_graph(graph) for graph in graphs]
    for found in (by_scikit_network(graphs, 0), by_networkx(plain, 0), by_python_louvain(plain, 0)):
        for graph, parts in zip(graphs, found, strict=True):
            assert sorted(cell for part in parts for cell in part) == list(range(len(graph.cells)))
    for graph, theirs in zip(graphs, plain, strict=True):
        assert theirs.number_of_edges() == len(graph.edges)
        assert theirs.size(weight="weight") == pytest.approx(graph.weights.sum())


def test_louvain_is_compared_by_time_and_modularity(maps):
    lines = list(bench_louvain(maps["paper"].graphs, name="tiny", runs=1))
    assert [ratio(lines[1])] == [1.0] and "scikit-network" in lines[1]
    assert "networkx" in lines[2] and "python-louvain" in lines[3]
    values = [float(re.findall(r"modularity (\S+)", line)[0]) for line in lines[1:4]]
    assert max(values) - min(values) < 0.1 and min(values) > 0.0


def test_sliders_move_over_their_whole_range(maps):
    painted: dict[str, list[float]] = {"evidence": [], "paper": []}
    for method, name in (("evidence", "affinity"), ("paper", "k_percent")):
        lines = list(
            bench_sliders(
                maps[method], paint=lambda m, n=name, s=painted[method]: s.append(m.parameters[n]), values=5, runs=1
            )
        )
        top = 100.0 if method == "paper" else 1.0
        assert painted[method][1:] == [top * share for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
        assert "picture included (required: 30 ms)" in lines[1] and "required: 50 ms" in lines[3]
        assert all(re.match(r" +\d+\.\d ms wall +\d+\.\d ms CPU   any ", line) for line in lines[1:])


def test_repeated_frames_make_the_same_map_seen_more_often(tiny):
    base = growth.decoded(tiny, 4)
    once, thrice = (build_map(growth.repeated(base, n), BuildConfig(method="paper")) for n in (1, 3))
    assert np.array_equal(once.grid.label, thrice.grid.label)
    assert np.array_equal(3 * once.grid.observations, thrice.grid.observations)
    assert len(thrice.frame_names) == 12
    assert np.array_equal(once.instance > 0, thrice.instance > 0)


def test_copies_of_a_scene_lie_apart_and_alike(tiny):
    base = growth.decoded(tiny, 4)
    alone = build_map(base)
    together = build_map(growth.tiled(base, alone, 2))
    rows, cols = alone.spec.shape
    assert np.count_nonzero(together.grid.observations) == 4 * np.count_nonzero(alone.grid.observations)
    for row in (slice(0, rows), slice(-rows, None)):
        for col in (slice(0, cols), slice(-cols, None)):
            assert np.array_equal(together.grid.label[row, col], alone.grid.label)
    assert len(together.instances) == 4 * len(alone.instances) > 0


def test_growth_is_told_for_both_methods(tiny):
    lines = [*growth.bench_frames(tiny, frames=4, factors=(1, 2), runs=1)]
    assert ratio(lines[1]) == 1.0 and "frames x 2" in lines[2] and "each further frame" in lines[3]
    assert sum("paper" in line for line in lines[1:]) == 3
    lines = [*growth.bench_area(tiny, frames=4, side=2, runs=1)]
    assert ratio(lines[1]) == 4.0 and "m2" in lines[1] and "memory" in lines[3] and "instances" in lines[4]
    assert ratio(lines[4]) == 4.0


def test_a_chair_is_the_same_chair_among_others_with_evidence_and_not_with_the_paper():
    alone, row = objects.chairs_in_a_row(1), objects.chairs_in_a_row(10)
    assert np.array_equal(alone.grid.label, row.grid.label[:, : alone.grid.spec.cols])
    one, many = objects.cut_evidence(alone), objects.cut_evidence(row)
    assert len(np.unique(one.community)) > 4
    assert all(objects.same_partition(one.community[0], other) for other in many.community)
    parts = [np.unique(chair[chair > 0]).tolist() for chair in many.instance]
    assert all(len(found) == 1 for found in parts) and len({found[0] for found in parts}) == 10
    one, many = objects.cut_paper(alone), objects.cut_paper(row)
    assert not any(objects.same_partition(one.community[0], other) for other in many.community)


def test_partitions_are_compared_whatever_the_numbers():
    a = np.array([[1, 1, 2], [2, 2, 3]])
    assert objects.same_partition(a, np.array([[7, 7, 1], [1, 1, 4]]))
    assert not objects.same_partition(a, np.array([[7, 7, 1], [1, 7, 4]]))
    assert not objects.same_partition(a, np.ones_like(a)) and not objects.same_partition(np.ones_like(a), a)


def test_objects_are_counted_for_both_methods():
    lines = list(objects.bench_objects(copies=(3,), runs=1))
    kept = [(int(m[1]), int(m[2])) for line in lines if (m := re.match(r" +(\d+) of (\d+) +cut as", line))]
    assert kept[:2] == [(3, 3), (3, 3)] and len(kept) == 4


def test_the_whole_bench_has_its_seven_sections(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "bench_planner", lambda: bench_planner(side_cells=260, pairs=1, compared=1))
    lines = list(
        report.bench_lines([tiny], paint=lambda m: None, start=lambda m: Pose2(0.0, 0.0, 0.0), scratch=tmp_path, runs=1)
    )
    assert [line[1] for line in lines if re.match(r"\n\d\. ", line)] == list("1234567")
    said = [line for line in lines if re.match(r" +[\d.]+ ms  (ok|refused|failed)", line)]
    assert len(said) == len(report.COMMANDS) and not any("{" in line for line in said)
    assert re.fullmatch(r"\nThe whole bench took \d+ s; load at the end [\d.]+\.", lines[-1])


def test_commands_name_what_there_is_most_of(maps):
    commands = report.commands_for(maps["evidence"])
    assert len(commands) == len(report.COMMANDS) and commands[0] == "go to the chair"


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
        errors.add(truth, Segmentation(found, tuple(Segment(i, label) for i, label in labels.items())), depth_m)
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
