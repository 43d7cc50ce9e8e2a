"""Average precision on a benchmark's mesh: by hand, against a slow plain twin, and through files of both formats."""

import json
from dataclasses import replace

import numpy as np
import pytest
from toy_surfaces import toy_with_surface

from simaps_viz import save_map
from simaps_viz.cli import main
from simaps_viz.errors import InputError
from simaps_viz.evaluation.average_precision import CLASSES, average_precision, read_truth
from simaps_viz.geometry import invert_pose, transform_points
from simaps_viz.mapping.in_space import all_instances, space_points

pytestmark = pytest.mark.slow  # surfaces of whole maps are scored


def spread_over(*runs):
    """Return an array of so many of each number, (number, count) by (number, count)."""
    return np.concatenate([np.full(count, number) for number, count in runs])


def chairs(objects, found, scores, labels=(1, 2, 3)):
    """Return the score of a class whose objects and instances are all chairs."""
    named = {number: "chair" for number in labels}
    return average_precision(objects, named, found, dict.fromkeys(scores, "chair"), scores)["chair"]


def test_a_perfect_map_and_an_empty_one():
    objects = spread_over((1, 150), (2, 200), (0, 50))
    assert chairs(objects, objects, {1: 0.2, 2: 0.9}).ap == 1.0
    one = chairs(objects, np.zeros_like(objects), {})
    assert (one.ap, one.ap50, one.ap25, one.true, one.found) == (0.0, 0.0, 0.0, 2, 0)


def test_half_of_the_objects_found_is_half():
    objects = spread_over((1, 150), (2, 150))
    assert chairs(objects, spread_over((7, 150), (0, 150)), {7: 0.9}).ap == 0.5  # steps of recall .25 and .25 at 1


def test_a_false_one_that_is_surer_than_the_right_one_leaves_a_quarter():
    objects = spread_over((1, 150), (9, 150))  # 9 is annotated as a scored class, so what lies on it is false
    labels, found = {1: "chair", 9: "table"}, spread_over((7, 150), (8, 150))
    scored = average_precision(objects, labels, found, {7: "chair", 8: "chair"}, {7: 0.5, 8: 0.9})
    assert scored["chair"].ap == 0.25 and scored["table"].ap == 0.0  # .5 over half of one step of 1; 0 over the other


def test_an_overlap_has_to_be_more_than_the_threshold():
    one = chairs(spread_over((1, 200)), spread_over((7, 100), (0, 100)), {7: 1.0})
    assert (one.ap50, one.ap25) == (0.0, 1.0)
    one = chairs(spread_over((1, 200)), spread_over((7, 161), (0, 39)), {7: 1.0})  # .805: right from .5 to .8
    assert one.ap == pytest.approx(7 / 9)


def test_what_nobody_annotated_and_what_is_small_is_not_held_against_a_map():
    objects = spread_over((1, 150), (0, 300), (2, 99))
    found = spread_over((7, 150), (8, 300), (9, 99))
    assert chairs(objects, found, {7: 0.1, 8: 0.9, 9: 0.9}).ap == 1.0
    assert chairs(objects, found, {7: 0.1, 8: 0.9, 9: 0.9}).found == 2
    all_labels = {1: "chair", 2: "chair", 3: "table"}
    on_tables = average_precision(np.where(objects == 0, 3, objects), all_labels, found,
                                  dict.fromkeys((7, 8, 9), "chair"), {7: 0.1, 8: 0.9, 9: 0.9})  # fmt: skip
    assert on_tables["chair"].ap == 0.25


def plain_precision(objects, labels, found, found_labels, scores, label, overlap):
    """Return the same from the masks themselves, as slowly as the published definition reads."""
    masks = {f: [bool(v == f) for v in found] for f in found_labels if found_labels[f] == label}
    masks = {f: mask for f, mask in sorted(masks.items()) if sum(mask) >= 100}
    truth = {o: [bool(v == o) for v in objects] for o in sorted(labels) if labels[o] == label}
    truth = {o: mask for o, mask in truth.items() if sum(mask) > 0}
    large = {o: mask for o, mask in truth.items() if sum(mask) >= 100}
    if not large:
        return None

    def iou(a, b):
        return sum(x and y for x, y in zip(a, b, strict=True)) / sum(x or y for x, y in zip(a, b, strict=True))

    used, results, misses = [], [], 0
    for mask in large.values():
        best = None
        for f, other in masks.items():
            if f in used or not iou(mask, other) > overlap:
                continue
            if best is None:
                best = scores[f]
                used.append(f)
            else:
                results.append((0, min(best, scores[f])))
                best = max(best, scores[f])
        if best is None:
            misses += 1
        else:
            results.append((1, best))
    for f, other in masks.items():
        if any(iou(mask, other) > overlap for mask in truth.values()):
            continue
        excused = sum(x and v not in labels for x, v in zip(other, objects, strict=True))
        for o, mask in truth.items():
            if o not in large:
                excused += sum(x and y for x, y in zip(mask, other, strict=True))
        if excused / sum(other) <= overlap:
            results.append((0, scores[f]))
    if not results:
        return 0.0
    points = []
    for least in sorted({score for _, score in results}):
        kept = [right for right, score in results if score >= least]
        points.append((sum(kept) / len(kept), sum(kept) / (sum(right for right, _ in results) + misses)))
    points.append((1.0, 0.0))
    area = 0.0
    for at, (precision, recall) in enumerate(points):
        before = points[at - 1][1] if at else recall
        after = points[at + 1][1] if at + 1 < len(points) else 0.0
        area += precision * (before - after) / 2
    return area


@pytest.mark.parametrize("seed", range(30))
def test_the_scores_are_those_of_the_plain_twin(seed):
    rng = np.random.default_rng(seed)
    lengths = rng.integers(40, 260, 12)
    objects = np.repeat(rng.integers(0, 8, 12), lengths)
    found = np.repeat(rng.integers(0, 9, 12), lengths)
    found = np.where(rng.random(len(found)) < 0.15, rng.integers(0, 9, len(found)), found)
    found = np.roll(np.where(objects > 0, np.where(rng.random(len(found)) < 0.4, objects, found), found), seed * 3)
    labels = {number: "chair" if number < 5 else "table" for number in range(1, 7)}  # 7 is of no scored class
    found_labels = {number: "chair" if number < 6 else "table" for number in range(1, 9)}
    scores = {number: float(rng.integers(1, 5)) / 4 for number in range(1, 9)}  # with equals
    scored = average_precision(objects, labels, found, found_labels, scores)
    for label in ("chair", "table"):
        plain = [
            plain_precision(objects, labels, found, found_labels, scores, label, t)
            for t in (*np.arange(0.5, 0.95, 0.05), 0.25)
        ]
        known = [value for value in plain if value is not None]
        if not known:
            assert label not in scored or scored[label].ap is None
        else:
            one = scored[label]
            assert one.ap == pytest.approx(np.mean(known[:-1]), abs=1e-12)
            assert (one.ap50, one.ap25) == (pytest.approx(known[0], abs=1e-12), pytest.approx(known[-1], abs=1e-12))


# A map, and its own voxels as the mesh of a scan, each four vertices 1 cm apart.

TURNED = np.array([[0.0, -1, 0, 3], [1, 0, 0, -2], [0, 0, 1, 0.25], [0, 0, 0, 1]])
TSV = "id\traw_category\tcategory\tcount\tnyu40id\n"


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """Return the folder, the map, and vertices [n, 3] with the map's instance of each [n]."""
    folder = tmp_path_factory.mktemp("scan")
    simap = replace(toy_with_surface(), T_map_world=TURNED)
    save_map(simap, folder / "m.npz")
    points = space_points(simap)
    around = np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]])
    at = transform_points(invert_pose(TURNED), (points.positions[:, None] + around).reshape(-1, 3))
    return folder, simap, at, points.instances.repeat(4).astype(np.int64)


def write_ply(path, vertices, faces=None, owners=None):
    """Write a mesh as both datasets do: binary, faces as lists; Replica's are quads with an object_id."""
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    table = np.zeros(len(vertices), kinds)
    for name, column in zip("xyz", vertices.T, strict=True):
        table[name] = column
    faces = np.zeros((1, 3), np.int32) if faces is None else faces
    rows = np.zeros(
        len(faces), [("n", "u1"), ("v", "<i4", faces.shape[1])] + ([("o", "<i4")] if owners is not None else [])
    )
    rows["n"], rows["v"] = faces.shape[1], faces
    object_id = ""
    if owners is not None:
        rows["o"], object_id = owners, "property int object_id\n"
    header = "".join(f"property {'float' if kind == '<f4' else 'uchar'} {name}\n" for name, kind in kinds)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{header}element face {len(faces)}\n"
        f"property list uchar int vertex_indices\n{object_id}end_header\n".encode()
        + table.tobytes()
        + rows.tobytes()
    )


def write_scannet(folder, simap, vertices, owner):
    """Write a ScanNet scan: two segments an object, objectId from 0, raw category names, the table of labels above."""
    name = folder / "scene0000_00" / "scene0000_00"
    write_ply(name.with_name(f"{name.name}_vh_clean_2.ply"), vertices)
    segments = owner * 2 + np.arange(len(owner)) % 2
    name.with_name(f"{name.name}_vh_clean_2.0.010000.segs.json").write_text(
        json.dumps({"sceneId": "x", "segIndices": segments.tolist()})
    )
    groups = [
        {"id": at, "objectId": at, "segments": [2 * one.id, 2 * one.id + 1], "label": one.label}
        for at, one in enumerate(all_instances(simap))
    ]
    name.with_name(f"{name.name}.aggregation.json").write_text(json.dumps({"segGroups": groups}))
    name.with_name(f"{name.name}_vh_clean.aggregation.json").write_text("{}")  # of another mesh: not to be read
    nyu40 = {"chair": 5, "dining table": 7, "potted plant": 40, "couch": 6}
    ids = CLASSES["ScanNet200"]
    text = "".join(f"{ids[label]}\t{label}\t{label}\t9\t{number}\n" for label, number in nyu40.items())
    (folder / "scannetv2-labels.combined.tsv").write_text(TSV + text)
    return name.parent


def write_replica(folder, simap, vertices, owner):
    """Write a Replica scene: a quad for each four vertices, the object's id with each face, 0 an object like others."""
    habitat = folder / "room0" / "habitat"
    faces = np.arange(len(vertices)).reshape(-1, 4)
    write_ply(habitat / "mesh_semantic.ply", vertices, faces, owner[::4] - 1)
    called = {"dining table": "table", "potted plant": "indoor-plant", "couch": "sofa"}
    objects = [
        {"id": one.id - 1, "class_id": 0, "class_name": called.get(one.label, one.label)}
        for one in all_instances(simap)
    ]
    (habitat / "info_semantic.json").write_text(json.dumps({"classes": [], "objects": objects}))
    return habitat.parent


def evaluate(capsys, folder, truth, *words):
    line = ["evaluate", str(folder / "m.npz"), "--task", "ap", "--truth", str(truth), *words]
    capsys.readouterr()
    status = main.main(line)
    return status, capsys.readouterr()


def rows_of(capsys, folder, truth, *words):
    status, said = evaluate(capsys, folder, truth, "--json", *words)
    assert status == 0
    return {row["benchmark"]: row for row in json.loads(said.out)["rows"]}


@pytest.mark.parametrize("write", [write_scannet, write_replica])
def test_a_map_scored_on_its_own_surface_is_perfect(scan, tmp_path, capsys, write):
    folder, simap, vertices, owner = scan
    rows = rows_of(capsys, folder, write(tmp_path, simap, vertices, owner))
    assert set(rows) == ({"ScanNet", "ScanNet200"} if write is write_scannet else {"Replica"})
    for row in rows.values():
        assert len(row["classes"]) >= 3 and row["mean"]["ap"] == pytest.approx(1.0)
        assert all(one["true"] == one["found"] for one in row["classes"].values())
        assert row["classes"]["chair"]["true"] == row["classes"]["chair"]["found"] == len(simap.of_class("chair"))
    if write is write_scannet:
        assert rows["ScanNet"]["read_as"]["dining table"] == "table"
        assert rows["ScanNet"]["read_as"]["potted plant"] is None  # 40 is no class of the 18
        assert rows["ScanNet200"]["read_as"]["potted plant"] == "potted plant"
    status, said = evaluate(capsys, folder, tmp_path / ("room0" if write is write_replica else "scene0000_00"))
    assert status == 0 and "mean of classes  1.000  1.000  1.000" in said.err + said.out


def test_two_objects_that_the_map_joined_are_found_once(scan, tmp_path, capsys):
    folder, simap, vertices, owner = scan
    one = max(simap.of_class("chair"), key=lambda chair: (owner == chair.id).sum())
    mine = np.flatnonzero(owner == one.id)
    other = max(i.id for i in all_instances(simap)) + 1
    split = owner.copy()
    split[mine[len(mine) // 3 :]] = other  # two thirds are another chair in truth
    with_it = replace(simap, hidden=(*simap.hidden, replace(one, id=other)))
    truth = write_scannet(tmp_path, with_it, vertices, split)
    row = rows_of(capsys, folder, truth)["ScanNet"]["classes"]["chair"]
    chairs_there = len(simap.of_class("chair"))
    assert row["true"] == chairs_there + (len(mine) // 3 >= 100) and row["found"] == chairs_there
    assert row["ap50"] == (1.0 if len(mine) // 3 < 100 else pytest.approx(chairs_there / (chairs_there + 1)))
    assert 0 < row["ap"] < row["ap50"]


def test_the_files_written_for_others_hold_what_was_scored(scan, tmp_path, capsys):
    folder, simap, vertices, owner = scan
    truth = write_scannet(tmp_path, simap, vertices, owner)
    rows_of(capsys, folder, truth, "--predictions", str(tmp_path / "sent"))
    for benchmark in ("ScanNet", "ScanNet200"):
        lines = (tmp_path / "sent" / benchmark / "scene0000_00.txt").read_text().splitlines()
        found = []
        for line in lines:
            mask, number, score = line.split(" ")
            values = (tmp_path / "sent" / benchmark / mask).read_text().splitlines()
            assert len(values) == len(vertices) and set(values) == {"0", "1"} and 0 < float(score) <= 1
            one = int(owner[values.index("1")])
            assert np.array_equal(np.array(values) == "1", owner == one)
            found.append((one, int(number)))
        labels = {i.id: i.label for i in all_instances(simap)}
        assert [number for one, number in found if labels[one] == "chair"] == [CLASSES[benchmark]["chair"]] * len(
            simap.of_class("chair")
        )


def test_what_is_wrong_is_named(scan, tmp_path, capsys):
    folder, simap, vertices, owner = scan
    truth = write_scannet(tmp_path, simap, vertices, owner)
    status, said = evaluate(capsys, folder, tmp_path)
    assert status == 2 and "expected a ScanNet scan (SCENE.aggregation.json) or a Replica scene" in said.err
    status, said = evaluate(capsys, folder, truth, "--methods", "paper")
    assert status == 2 and "--task ap: expected only a map" in said.err
    assert main.main(["evaluate", str(folder / "m.npz"), "--task", "ap"]) == 2
    assert "folder of a ScanNet or Replica scan with --truth" in capsys.readouterr().err
    segments = truth / "scene0000_00_vh_clean_2.0.010000.segs.json"
    segments.write_text(json.dumps({"segIndices": [1, 2, 3]}))
    with pytest.raises(InputError, match=r"segs.json: expected segIndices, a number for each of \d+ vertices"):
        read_truth(truth)
    (truth / "scene0000_00_vh_clean_2.ply").write_bytes(b"ply\n")
    with pytest.raises(InputError, match=r"_vh_clean_2.ply: expected a mesh"):
        read_truth(truth)
    room = write_replica(tmp_path, simap, vertices, owner)
    write_ply(room / "habitat/mesh_semantic.ply", vertices)
    with pytest.raises(InputError, match=r"mesh_semantic.ply: expected faces of vertex_indices with an object_id each"):
        read_truth(room)
    (tmp_path / "scannetv2-labels.combined.tsv").unlink()
    write_scannet(tmp_path / "again", simap, vertices, owner)
    (tmp_path / "again/scannetv2-labels.combined.tsv").write_text("a\tb\n1\t2\n")
    with pytest.raises(InputError, match=r"combined.tsv: expected columns raw_category, id and nyu40id"):
        read_truth(tmp_path / "again/scene0000_00")
