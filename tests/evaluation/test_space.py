"""Scores in space: by hand, against a plain twin, and against two programs that share no code with ours."""

import json
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import pytest
from checked_sequences import thinned
from sequences import write_tiny_sequence
from worlds import PLATES, write_room

from simaps_viz import export_map, open_sequence, save_map
from simaps_viz.build.methods import build
from simaps_viz.cli.main import main
from simaps_viz.evaluation.space import (
    MIN_TRUE,
    SpaceTruth,
    box_iou,
    evaluate_space,
    score_space,
    space_truth,
)
from simaps_viz.evaluation.truth import settings_of
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.in_space import VOXEL_M, space_points, voxel_centres, voxel_keys
from simaps_viz.structures import Box, Points

SHARED = Path(__file__).parents[2].parent / "shared"
HOUSE = SHARED / "data" / "aws-small-house" / "rgbd"
LABELS = ("none", "book", "shelf", "wall")
ORIGIN = (0.2, -0.1)


def block(x, y, z):
    cells = np.stack(np.meshgrid(*(np.arange(*one) for one in (x, y, z)), indexing="ij"), axis=-1).reshape(-1, 3)
    return np.sort(voxel_keys((cells + 0.5) * VOXEL_M + (*ORIGIN, 0.0), ORIGIN))


BOARDS = np.unique(np.concatenate([block((0, 20), (0, 6), (z, z + 1)) for z in (2, 10, 18)]))
THINGS = {
    1: ("shelf", BOARDS),
    2: ("book", block((2, 6), (1, 5), (11, 15))),
    3: ("book", block((12, 16), (1, 5), (19, 23))),
}
TINY = block((30, 32), (0, 2), (0, 2))
"""A fourth thing, too small to be asked for."""


def truth_by_hand():
    voxels = {**{n: keys for n, (_, keys) in THINGS.items()}, 4: TINY}
    labels = {**{n: name for n, (name, _) in THINGS.items()}, 4: "book"}
    shown = {1: 0.86, 2: 0.0, 3: 1.0, 4: 1.0}
    below = {1: np.setdiff1d(BOARDS, block((0, 20), (0, 6), (18, 19))), 2: voxels[2], 3: voxels[3][:0], 4: TINY[:0]}
    nothing = np.zeros(0, np.int64)
    return SpaceTruth(
        ORIGIN, 2.0, 0.3, labels, {"book": True, "shelf": True, "wall": False}, nothing, voxels, below, shown
    )


def cloud(voxels, label_of):
    keys = np.concatenate([np.zeros(0, np.int64), *voxels.values()])
    ids = np.repeat(list(voxels), [len(part) for part in voxels.values()]).astype(np.int32)
    classes = np.array([LABELS.index(label_of[number]) for number in ids.tolist()], np.int16)
    positions = voxel_centres(keys, ORIGIN).astype(np.float32)
    return Points(positions, np.zeros((len(keys), 3), np.uint8), classes, ids)


def exact_cloud():
    truth = truth_by_hand()
    return cloud(truth.voxels, truth.labels)


def test_the_truth_scores_one_everywhere():
    scores = score_space(exact_cloud(), LABELS, truth_by_hand())
    assert scores.overall.pq == scores.strict.pq == scores.hidden.pq == scores.volume_ratio == 1.0
    assert (scores.overall.true, scores.overall.found, scores.hidden.true) == (3, 3, 1)
    assert scores.below_recall == scores.covered == 1.0
    assert scores.boxes.best_iou == pytest.approx(1.0, abs=0.03) and scores.boxes.f1_50 == 1.0
    assert (scores.boxes.on.f1, scores.boxes.on.right) == (1.0, 2)
    assert (scores.boxes.under.f1, scores.boxes.under.right) == (1.0, 1)  # the book between two boards


def test_a_voxel_too_high_costs_nothing_but_strictly_nearly_all():
    points = exact_cloud()
    points.positions[:, 2] += VOXEL_M
    scores = score_space(points, LABELS, truth_by_hand())
    assert scores.overall.pq == 1.0
    assert scores.strict.matched == 2 and scores.by_class["shelf"].matched == 1  # books are four layers high
    points.positions[:, 2] += VOXEL_M
    assert (score_space(points, LABELS, truth_by_hand()).overall.pq or 0.0) < 0.7


def test_two_books_as_one_and_a_third_that_is_not_there():
    truth = truth_by_hand()
    both = np.sort(np.concatenate([truth.voxels[2], truth.voxels[3]]))
    invented = block((60, 64), (0, 4), (0, 4))
    scores = score_space(cloud({1: BOARDS, 7: both, 9: invented}, {1: "shelf", 7: "book", 9: "book"}), LABELS, truth)
    books = scores.by_class["book"]
    # Half of what was found lies on either book: P = 1/2, R = 1, so F = 2/3 and the overlap 1/2, which is not above.
    assert (books.true, books.found, books.matched) == (2, 2, 0) and books.f1_25 == 0.5 and books.f1_50 == 0.0
    assert scores.overall.pq == pytest.approx(2 * 1 / (3 + 3))
    assert scores.hidden.matched == 0


def test_of_a_class_of_stuff_nothing_is_held_against_a_map_and_of_an_unknown_one_it_is():
    wall = block((60, 80), (0, 1), (0, 30))
    truth, exact = truth_by_hand(), dict(truth_by_hand().voxels)
    for label, found in (("wall", 3), ("none", 4)):
        points = cloud({**exact, 9: wall}, {**truth.labels, 9: label})
        assert score_space(points, LABELS, truth).overall.found == found


def test_a_book_a_voxel_too_thick_is_weighed():
    truth = truth_by_hand()
    thick = block((11, 17), (0, 6), (18, 24))
    scores = score_space(cloud({1: np.setdiff1d(BOARDS, thick), 3: thick}, truth.labels), LABELS, truth)
    assert scores.overall.matched == 2 and scores.hidden.matched == 0
    assert scores.volume_ratio == pytest.approx((len(BOARDS) - 36 + 6**3) / (len(BOARDS) + 4**3))
    assert scores.boxes.on.missed == 1 and scores.below_recall == pytest.approx(240 / (240 + 64))


@pytest.mark.parametrize("yaw", [0.0, 0.4, -1.2])
def test_overlap_of_boxes(yaw):
    box = Box((1.0, 2.0, 0.5), (2.0, 1.0, 1.0), yaw)
    turned = Box((1.0, 2.0, 0.5), (1.0, 2.0, 1.0), yaw + np.pi / 2)
    assert box_iou(box, box) == pytest.approx(1.0) and box_iou(box, turned) == pytest.approx(1.0)
    along = np.array([np.cos(yaw), np.sin(yaw)])
    x, y = np.array(box.center_m[:2]) + along
    assert box_iou(box, Box((x, y, 0.5), (2.0, 1.0, 1.0), yaw)) == pytest.approx(1 / 3)
    assert box_iou(box, Box((1.0, 2.0, 1.0), (2.0, 1.0, 1.0), yaw)) == pytest.approx(1 / 3)
    assert box_iou(box, Box((1.0, 2.0, 1.6), (2.0, 1.0, 1.0), yaw)) == 0.0
    cross = Box((1.0, 2.0, 0.5), (2.0, 1.0, 1.0), yaw + np.pi / 2)
    assert box_iou(box, cross) == pytest.approx(1 / 3)


def plain_voxels(sequence, T_map_world, origin_m, settings):
    """The twin: pixel by pixel, in Python."""
    votes, tops = defaultdict(Counter), {}
    K = sequence.intrinsics
    for index in range(len(sequence)):
        depth, ids = sequence.read(index).depth_m, sequence.segmentation(index).ids
        T = T_map_world @ sequence.poses[index]
        for v, u in np.argwhere((depth > settings.near_m) & (depth < settings.far_m)):
            z = float(depth[v, u])
            x, y, h = (T @ [(u - K.cx) / K.fx * z, (v - K.cy) / K.fy * z, z, 1.0])[:3]
            if -settings.below_floor_m < h < settings.cut_height_m:
                at = tuple(np.floor(np.array([x - origin_m[0], y - origin_m[1], h]) / VOXEL_M + 1e-4).astype(int))
                votes[at][int(ids[v, u])] += 1
                tops[at[:2]] = max(tops.get(at[:2], (-9, 0)), (int(h * 1e4), int(ids[v, u])))
    owner = {at: min(c, key=lambda i: (-c[i], i)) for at, c in votes.items() if sum(c.values()) >= 3}
    return owner, {at: top for at, (_, top) in tops.items()}


def test_the_truth_is_that_of_a_plain_twin(tmp_path):
    exact = open_sequence(write_tiny_sequence(tmp_path / "exact", truth="instances", frames=2))
    settings = ProjectionSettings()
    truth = space_truth(exact, exact.T_map_world, ORIGIN, settings)
    owner, tops = plain_voxels(exact, exact.T_map_world, ORIGIN, settings)
    for number, keys in truth.voxels.items():
        cells = ((voxel_centres(keys, ORIGIN) - (*ORIGIN, 0)) / VOXEL_M - 0.5).round().astype(int)
        mine = {tuple(cell) for cell in cells.tolist()}
        assert mine == {tuple(int(v) for v in at) for at, i in owner.items() if i == number} and mine
        columns = {at[:2] for at in mine}
        assert truth.shown[number] == pytest.approx(np.mean([tops[at] == number for at in columns]))
    assert set(truth.voxels) == {1, 2} == set(truth.labels)


def test_plates_that_hover_are_found_where_they_are(tmp_path):
    exact = open_sequence(write_room(tmp_path / "room"))
    truth = space_truth(exact, exact.T_map_world, (0.0, 0.0), ProjectionSettings())
    assert set(truth.counted) == set(PLATES) and not truth.hidden
    for number, (label, x, y, width, depth) in PLATES.items():
        centres = voxel_centres(truth.voxels[number], (0.0, 0.0))
        assert truth.labels[number] == label and len(centres) >= MIN_TRUE
        assert centres[:, 2] == pytest.approx(0.8, abs=VOXEL_M)
        low, high = centres[:, :2].min(0), centres[:, :2].max(0)
        assert low == pytest.approx((x, y), abs=VOXEL_M) and high == pytest.approx((x + width, y + depth), abs=VOXEL_M)
    report = evaluate_space(exact, ("components",), errors=("none",), build=build)
    run, theirs = report.runs
    assert "re-implemented" in theirs.method and theirs.scores.overall.pq == 1.0  # plates far from one another
    assert run.method == "components, columns" and run.scores.covered == 1.0
    assert run.scores.overall.matched == 0  # plates without legs, filled to the floor
    assert run.scores.overall.found == len(PLATES) and "components, columns" in report.table().text()


def test_the_command_prints_a_table_and_writes_everything(tmp_path, capsys):
    manifest = write_room(tmp_path / "room")
    out = tmp_path / "space.json"
    words = ["evaluate", str(manifest), "--task", "3d", "--methods", "components", "--errors", "none"]
    assert main([*words, "--output", str(out)]) == 0
    assert "objects in space" in capsys.readouterr().out
    record = json.loads(out.read_text())
    assert record["task"] == "3d" and record["rows"][0]["overall"]["true"] == len(PLATES)


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason=f"{SHARED} is not on this machine")
def test_two_other_programs_agree(tmp_path):
    """On every twelfth frame, as one of them reads them all for a minute: things are seen in part, scores are mixed."""
    folder = thinned(HOUSE, tmp_path, 12)
    house = open_sequence(folder)
    simap = build(house, "evidence")
    save_map(simap, tmp_path / "house.npz")
    (cloud_file,) = export_map(simap, tmp_path / "house.ply", "instances")
    (objects,) = export_map(simap, tmp_path / "house.json", "objects")
    theirs = {}
    for tool, made in (("score_3d", cloud_file), ("score_boxes", objects)):
        command = [sys.executable, str(SHARED / "tools" / f"{tool}.py"), made, tmp_path / "house.npz", folder]
        theirs[tool] = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    truth = space_truth(house, simap.T_map_world, (simap.spec.x0_m, simap.spec.y0_m), settings_of(simap))
    ours = score_space(space_points(simap), simap.grid.labels, truth)
    first, second = theirs["score_3d"], theirs["score_boxes"]
    for score, other in ((ours.overall, first), (ours.strict, first["strict"]), (ours.hidden, first["hidden"])):
        for name in ("pq", "f1_25", "f1_50", "matched"):
            assert getattr(score, name) == pytest.approx(other[name], abs=0.02), name
    assert ours.below_recall == pytest.approx(first["below"]["recall"], abs=0.02)
    assert ours.volume_ratio == pytest.approx(first["volume_ratio"], abs=0.02)
    for name in ("best_iou", "f1_25", "f1_50", "share_50"):
        assert getattr(ours.boxes, name) == pytest.approx(second[name], abs=0.02), name
    assert ours.boxes.on.f1 == pytest.approx(second["on"]["f1"], abs=0.02)
    assert ours.boxes.under.f1 == pytest.approx(second["under"]["f1"], abs=0.02)
