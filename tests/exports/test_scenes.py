"""GLB and PLY, opened with trimesh: names, metres, axes, volumes, colours."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from sequences import CAMERA_HEIGHT_M, COLORS, FLOOR_ID, SEAT_HEIGHT_M, SEATS_M, write_tiny_sequence
from toy_maps import toy_map
from trimesh.visual import ColorVisuals

from simaps_viz import ExportOptions, build_map, export_map, open_sequence
from simaps_viz.colors.classes import instance_color

X_TO_GLTF = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Rows: glTF x, y (up) and z of the map's x, y, z (up)."""


def box_of(simap, one):
    """Corners of what stands on an instance's cells, map frame: from the floor to its top."""
    (x_low, y_low, _), (x_high, y_high, z_high) = one.aabb_m
    return np.array([[x_low, y_low, 0.0], [x_high, y_high, z_high]])


@pytest.fixture(scope="module")
def simap():
    return toy_map()


@pytest.fixture(scope="module")
def scene(simap, tmp_path_factory):
    (path,) = export_map(simap, tmp_path_factory.mktemp("glb") / "toy.glb")
    return trimesh.load_scene(path)


def in_world(scene, name):
    matrix, geometry = scene.graph[name]
    return scene.geometry[geometry], trimesh.transform_points(scene.geometry[geometry].vertices, matrix)


def test_glb_has_a_named_node_for_every_instance_and_class(simap, scene):
    names = {f"{one.label}-{one.id}" for one in simap.instances}
    assert set(scene.graph.nodes_geometry) == names | {"floor", "wall"}
    assert "chair-3" in names and scene.units == "meters"


def test_glb_lies_y_up_in_metres_and_its_geometry_in_the_map_frame(simap, scene):
    for one in simap.instances:
        mesh, world = in_world(scene, f"{one.label}-{one.id}")
        expected = box_of(simap, one)
        np.testing.assert_allclose(mesh.bounds, expected, atol=1e-5)
        np.testing.assert_allclose(world, mesh.vertices @ X_TO_GLTF.T, atol=1e-6)
        np.testing.assert_allclose([world[:, 1].min(), world[:, 1].max()], expected[:, 2], atol=1e-5)
    x_low, y_low, x_high, y_high = simap.spec.extent_m
    np.testing.assert_allclose(scene.bounds, [[x_low, 0, -y_high], [x_high, 2, -y_low]], atol=1e-5)


def test_a_columns_volume_is_that_of_its_cells_and_its_faces_look_outwards(simap, scene):
    cell = simap.spec.cell_size_m**2
    for one in simap.instances:
        mesh, _ = in_world(scene, f"{one.label}-{one.id}")
        heights = simap.grid.height_m[simap.instance == one.id]
        assert mesh.volume == pytest.approx(float(heights.sum()) * cell, rel=1e-5)


def test_columns_of_uneven_height_and_below_the_floor(tmp_path):
    simap = toy_map()
    chair = simap.instance == 3
    generator = np.random.default_rng(5)
    simap.grid.height_m[chair] = generator.uniform(-0.2, 1.0, chair.sum()).astype(np.float32)
    scene = trimesh.load_scene(export_map(simap, tmp_path / "u.glb")[0])
    mesh, _ = in_world(scene, "chair-3")
    heights = simap.grid.height_m[chair].astype(float)
    assert mesh.volume == pytest.approx((heights - heights.min()).sum() * 0.05**2, rel=1e-4)
    assert mesh.bounds[:, 2] == pytest.approx([heights.min(), heights.max()], abs=1e-5)


def test_glb_materials_carry_the_pages_colours_in_linear_light(simap, scene):
    for one in simap.instances:
        mesh, _ = in_world(scene, f"{one.label}-{one.id}")
        linear = np.array(mesh.visual.material.baseColorFactor[:3]) / 255
        srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        np.testing.assert_allclose(srgb * 255, instance_color(one.id), atol=8)


def test_glb_nodes_know_their_instance(simap, scene):
    for one in simap.instances:
        mesh, _ = in_world(scene, f"{one.label}-{one.id}")
        assert (mesh.metadata["id"], mesh.metadata["label"], mesh.metadata["cells"]) == (one.id, one.label, one.cells)


def test_ply_is_z_up_with_an_instance_for_each_vertex_and_names_in_comments(simap, tmp_path):
    (path,) = export_map(simap, tmp_path / "toy.ply")
    mesh = trimesh.load_mesh(path, process=False)
    x_low, y_low, x_high, y_high = simap.spec.extent_m
    np.testing.assert_allclose(mesh.bounds, [[x_low, y_low, 0], [x_high, y_high, 2]], atol=1e-5)
    of_vertex = mesh.metadata["_ply_raw"]["vertex"]["data"]["instance"]
    of_vertex = np.asarray(of_vertex).reshape(-1)
    header = path.read_bytes().split(b"end_header")[0].decode().splitlines()
    for one in simap.instances:
        mine = of_vertex == one.id
        vertices = mesh.vertices[mine]
        np.testing.assert_allclose([vertices.min(axis=0), vertices.max(axis=0)], box_of(simap, one), atol=1e-5)
        assert isinstance(mesh.visual, ColorVisuals)
        assert (np.asarray(mesh.visual.vertex_colors)[mine][:, :3] == instance_color(one.id)).all()
        assert f"comment instance {one.id} {one.label}-{one.id}" in header


def test_a_name_of_two_lines_does_not_break_the_header(simap, tmp_path):
    instances = (replace(simap.instances[0], label="two\nelement vertex 7"), *simap.instances[1:])
    (path,) = export_map(replace(simap, instances=instances), tmp_path / "toy.ply")
    header = path.read_bytes().split(b"end_header")[0].decode().splitlines()
    assert "element vertex 7-1" not in header and "comment instance 1 two element vertex 7-1" in header


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    write_tiny_sequence(tmp_path_factory.mktemp("seq"))
    sequence = open_sequence(tmp_path_factory.getbasetemp() / "seq0")
    return build_map(sequence), sequence


def test_points_of_the_recording_in_their_own_colours(recorded, tmp_path):
    simap, sequence = recorded
    assert simap.counts() == {"chair": 2}
    options = ExportOptions(points_of=sequence)
    cloud = trimesh.load_scene(export_map(simap, tmp_path / "p.ply", options=options)[0]).to_geometry()
    assert isinstance(cloud, trimesh.PointCloud)
    heights = np.unique(np.round(cloud.vertices[:, 2], 3))
    assert heights.tolist() == [0.0, SEAT_HEIGHT_M] and CAMERA_HEIGHT_M not in heights
    scene = trimesh.load_scene(export_map(simap, tmp_path / "p.glb", options=options)[0])
    for one in simap.instances:
        points = scene.geometry[f"chair-{one.id}"]
        which = 1 if one.centroid_m[0] < 0 else 2
        x_low, y_low, x_high, y_high = SEATS_M[which]
        assert (points.vertices[:, 2] == SEAT_HEIGHT_M).all() and len(points.vertices) >= 4
        assert (points.vertices[:, :2] > (x_low, y_low)).all() and (points.vertices[:, :2] < (x_high, y_high)).all()
        np.testing.assert_allclose(np.asarray(points.colors)[:, :3].mean(axis=0), COLORS[which], atol=40)
    floor = scene.geometry["unlabelled"]
    assert (floor.vertices[:, 2] == 0.0).all()
    np.testing.assert_allclose(np.asarray(floor.colors)[:, :3].mean(axis=0), COLORS[FLOOR_ID], atol=40)
