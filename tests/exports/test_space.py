"""Surface voxels as PLY and objects as JSON, read back by the letter of their contracts."""

import json

import numpy as np
import pytest
from toy_maps import toy_map

from simaps_viz import export_map
from simaps_viz.cli.main import main
from simaps_viz.exports.scene import _faces
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.in_space import space_points

PROPERTIES = ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue", "int class", "int instance"]
VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3), ("class", "<i4"), ("instance", "<i4")])


def test_the_ply_has_a_vertex_for_each_voxel(tmp_path):
    simap = toy_map()
    (path,) = export_map(simap, tmp_path / "toy.ply", "instances")
    head, body = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode().splitlines()
    points = space_points(simap)
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert [line.removeprefix("property ") for line in lines if line.startswith("property")] == PROPERTIES
    assert f"element vertex {len(points.positions)}" in lines and len(body) == len(points.positions) * VERTEX.itemsize
    names = dict(line.split(" ", 3)[2:] for line in lines if line.startswith("comment class"))
    assert names == {str(i): label for i, label in enumerate(simap.grid.labels) if i}
    assert "comment filled columns: the map has no voxels" in lines
    vertices = np.frombuffer(body, VERTEX)
    for name, column in (("xyz", points.positions), ("rgb", points.colors), ("instance", points.instances)):
        assert (vertices[name] == column).all()
    for one in simap.instances:
        (label,) = {names[str(i)] for i in vertices["class"][vertices["instance"] == one.id].tolist()}
        assert label == one.label


def test_the_objects_are_those_of_the_map(tmp_path, capsys):
    simap = toy_map()
    (path,) = export_map(simap, tmp_path / "toy.json", "objects")
    written = json.loads(path.read_text())
    assert written["boxes_from"] == "columns" and len(written["objects"]) == len(simap.instances)
    for one, found in zip(simap.instances, written["objects"], strict=True):
        room = simap.room_of(one.id)
        assert one.box is not None and (found["id"], found["label"]) == (one.id, one.label)
        assert found["center_m"] == pytest.approx(one.box.center_m, abs=1e-4)
        assert found["size_m"] == pytest.approx(one.box.size_m, abs=1e-4)
        assert found["yaw_rad"] == pytest.approx(one.box.yaw_rad, abs=1e-5)
        assert found["on"] is None and found["under"] == [] and found["room"] == (room.id if room else None)
    save_map(simap, tmp_path / "toy.npz")
    assert main(["info", str(tmp_path / "toy.npz"), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    for found, said in zip(written["objects"], info["instances"], strict=True):
        assert {key: said[key] for key in ("size_m", "on", "under", "shares")} == {
            key: found[key] for key in ("size_m", "on", "under", "shares")
        }


def test_the_faces_of_voxels_close_round_them():
    rng = np.random.default_rng(3)
    voxel = np.unique(rng.integers(0, 6, (90, 3)), axis=0)
    rgb = np.full((len(voxel), 3), (10, 200, 90), np.uint8)
    corners, colors, faces = _faces(voxel, rgb)
    a, b, c = (corners[faces[:, i]].astype(float) for i in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(len(voxel))  # by the divergence theorem
    neighbours = {tuple(v) for v in voxel.tolist()}
    bare = sum(
        tuple(np.add(v, step)) not in neighbours
        for v in voxel.tolist()
        for step in np.r_[np.eye(3), -np.eye(3)].astype(int)
    )
    assert (
        len(faces) == 2 * bare and (colors == (10, 200, 90)).all() and len(np.unique(corners, axis=0)) == len(corners)
    )
