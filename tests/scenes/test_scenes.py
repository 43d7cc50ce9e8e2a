"""The embedded scene: what stands in it, how it is walked through, and what its camera sees."""

import itertools
from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from simaps_viz.colors.classes import COCO_THINGS, is_thing
from simaps_viz.scenes import furniture
from simaps_viz.scenes import materials as m
from simaps_viz.scenes.places import PLACES
from simaps_viz.scenes.render import DepthSensor, Renderer, embree_scene, sense
from simaps_viz.scenes.scene import Scene, SceneObject, assemble, place
from simaps_viz.scenes.shapes import box, corner_normals, disc
from simaps_viz.scenes.walk import camera_pose
from simaps_viz.structures import Intrinsics

SMALL = Intrinsics(width=160, height=120, fx=110.0, fy=110.0, cx=79.5, cy=59.5)
ROBOT_RADIUS_M = 0.25
pytestmark = pytest.mark.slow


@cache
def scene() -> Scene:
    """The café, made when a test asks for it: a worker that runs none of these only collects them."""
    return PLACES["cafe"].scene()


@cache
def renderer() -> Renderer:
    return Renderer(scene(), SMALL)


def found(name: str) -> tuple[int, SceneObject]:
    """Instance id and object of that name."""
    return next((i, o) for i, o in enumerate(scene().objects, start=1) if o.name == name)


def joined(one: SceneObject) -> trimesh.Trimesh:
    """The parts of an object as one mesh."""
    mesh = trimesh.util.concatenate([part.mesh for part in one.parts])
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def surface_points(name: str, spacing_m: float = 0.008) -> np.ndarray:
    """Points no farther than about ``spacing_m`` apart on everything of one object."""
    mesh = joined(found(name)[1])
    count = int(mesh.area / spacing_m**2 * 2)
    return np.concatenate([mesh.vertices, trimesh.sample.sample_surface(mesh, count, seed=0)[0]])


def gap_m(a: str, b: str) -> float:
    """Shortest horizontal distance between two objects, seen from above, as sampled (never too small)."""
    return float(KDTree(surface_points(a)[:, :2]).query(surface_points(b)[:, :2])[0].min())


def low_obstacles() -> np.ndarray:
    """Points on all that stands between 5 cm and 1.6 m over the floor, [n, 2]."""
    inside = [o for o in scene().objects if o.label not in ("floor", "ceiling", "lamp", "rug-merged")]
    points = []
    for o in [*inside, found("floor lamp")[1]]:
        mesh = joined(o)
        points.append(trimesh.sample.sample_surface(mesh, int(mesh.area * 1500) + 200, seed=0)[0])
    every = np.concatenate(points)
    return every[(every[:, 2] > 0.05) & (every[:, 2] < 1.6), :2]


def test_it_is_furnished():
    things = [o for o in scene().objects if o.is_thing]
    labels = {o.label for o in things}
    assert len(things) >= 40
    assert len(labels & set(COCO_THINGS)) >= 10
    assert {"chair", "dining table", "couch", "potted plant", "tv", "laptop", "cup", "refrigerator"} <= labels
    assert {o.label for o in scene().objects if not o.is_thing} == {
        "wall", "floor", "ceiling", "window-other", "rug-merged"
    }  # fmt: skip


def test_everything_lies_inside_the_outer_walls():
    for o in scene().objects:
        low, high = o.bounds_m
        assert (low >= [-0.2, -0.2, -0.06]).all(), o.name
        assert (high <= [12.2, 9.2, 2.8]).all(), o.name


@pytest.mark.parametrize(("group", "count"), [("west", 5), ("middle", 6), ("corner", 4)])
def test_chairs_round_a_table_are_5_to_20_cm_apart(group, count):
    for i in range(count):
        gap = gap_m(f"{group} chair {i + 1}", f"{group} chair {(i + 1) % count + 1}")
        assert 0.05 <= gap <= 0.20, (group, i, gap)


@pytest.mark.parametrize(("row", "count"), [("row chair", 4), ("stool", 5), ("armchair", 2)])
def test_chairs_in_a_row_are_5_to_20_cm_apart(row, count):
    for i in range(1, count):
        gap = gap_m(f"{row} {i}", f"{row} {i + 1}")
        assert 0.05 <= gap <= 0.20, (row, i, gap)


def test_no_two_pieces_of_furniture_stand_in_each_other():
    """Boxes of upright pieces that overlap by more than a finger belong to round things: check those by points."""
    solid = [o for o in scene().objects if o.is_thing and o.bounds_m[0, 2] < 0.02]
    for a, b in itertools.combinations(solid, 2):
        overlap = np.minimum(a.bounds_m[1], b.bounds_m[1]) - np.maximum(a.bounds_m[0], b.bounds_m[0])
        if (overlap > 0.01).all():
            hulls = [joined(o).convex_hull for o in (a, b)]
            under_table = {a.label, b.label} & {"dining table", "desk"}
            assert under_table or not hulls[0].contains(hulls[1].sample(400, seed=0)).any(), (a.name, b.name)


@pytest.mark.parametrize("label", ["cup", "bottle", "laptop", "keyboard", "bowl", "vase", "microwave", "teddy bear"])
def test_small_things_stand_on_something(label):
    mine = [i for i, o in enumerate(scene().objects, start=1) if o.label == label]
    tree = embree_scene(scene().triangles_m[~np.isin(scene().instance, mine)])
    down = np.array([[0, 0, -1]], dtype=np.float32)
    for i in mine:
        low, high = scene().objects[i - 1].bounds_m
        start = np.array([[*(low + high)[:2] / 2, low[2] + 0.02]], dtype=np.float32)
        below = float(tree.run(start, down, query="DISTANCE")[0]) - 0.02
        assert abs(below) < 0.015, (scene().objects[i - 1].name, below)


def test_names_ids_and_table_agree():
    table = scene().table()["instances"]
    assert [row["id"] for row in table] == list(range(1, len(scene().objects) + 1))
    for row in table:
        mine = scene().triangles_m[scene().instance == row["id"]].reshape(-1, 3)
        np.testing.assert_allclose(mine.min(axis=0), row["aabb_min"], atol=2e-4)
        np.testing.assert_allclose(mine.max(axis=0), row["aabb_max"], atol=2e-4)
        assert row["isthing"] == is_thing(row["label"])


def test_chairs_of_one_set_differ_a_little_in_colour():
    colors = {found(f"west chair {i}")[1].parts[0].material.color for i in range(1, 6)}
    assert len(colors) == 5
    assert np.ptp(np.array(list(colors)), axis=0).max() < 0.2


def test_a_pose_turns_and_moves_a_model():
    chair = place("a", "chair", furniture.cafe_chair(m.OAK, m.SAGE), 2.0, 1.0, yaw_deg=90)
    points = np.concatenate([part.mesh.vertices for part in chair.parts])
    back = points[points[:, 2] > 0.7]
    assert back[:, 1].max() < 1.0  # it looks north, so its back is south
    np.testing.assert_allclose(chair.bounds_m.mean(axis=0)[:2], [2.0, 1.0], atol=0.03)


def test_a_scene_needs_different_names():
    cup = place("cup", "cup", furniture.cup(m.CERAMIC), 0, 0)
    with pytest.raises(ValueError, match="name of its own"):
        assemble([cup, cup])


def test_shading_normals_are_smooth_on_round_sides_and_sharp_at_edges():
    np.testing.assert_allclose(
        corner_normals(box((1, 1, 1), (0, 0, 0), m.WHITE).mesh),
        np.repeat(box((1, 1, 1), (0, 0, 0), m.WHITE).mesh.face_normals[:, None], 3, axis=1),
        atol=1e-6,
    )
    mesh = disc(1.0, 0.0, 1.0, m.WHITE, sections=32).mesh
    normals = corner_normals(mesh)
    side = np.abs(mesh.face_normals[:, 2]) < 0.5
    radial = mesh.triangles[side][:, :, :2]
    np.testing.assert_allclose(normals[side][:, :, :2], radial, atol=0.06)
    assert (np.abs(normals[~side][:, :, 2]) > 0.999).all()


def test_walk_keeps_clear_of_everything_and_visits_all_rooms():
    walk = PLACES["cafe"].walk(400)
    positions = walk.T_world_camera[:, :3, 3]
    clear = KDTree(low_obstacles()).query(positions[:, :2])[0]
    assert clear.min() > 0.28, positions[clear.argmin()]
    assert ((positions[:, 2] > 1.4) & (positions[:, 2] < 1.5)).all()
    x, y = positions[:, 0], positions[:, 1]
    assert (x < 7).sum() > 50 and ((x > 7.4) & (y > 4.8)).sum() > 30 and ((x > 7.4) & (y < 4.6)).sum() > 50


def test_walk_is_smooth_and_looks_slightly_down():
    T = PLACES["cafe"].walk(200).T_world_camera
    rotations = T[:, :3, :3]
    np.testing.assert_allclose(rotations @ rotations.swapaxes(1, 2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-12)
    steps = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1)
    cosines = np.einsum("ni,ni->n", rotations[1:, :, 2], rotations[:-1, :, 2])
    assert steps.max() < 0.4
    assert np.rad2deg(np.arccos(cosines)).max() < 30
    down = -rotations[:, 2, 2]
    assert ((down > 0.2) & (down < 0.45)).all()
    np.testing.assert_allclose(rotations[:, 2, 0], 0, atol=1e-12)  # level


def test_doorways_let_the_robot_through():
    tree = KDTree(low_obstacles())
    for start, end in [((6.6, 2.5), (7.7, 2.5)), ((6.6, 6.8), (7.8, 6.8)), ((9.64, 5.2), (9.64, 4.2))]:
        way = np.linspace(start, end, 30)
        assert tree.query(way)[0].min() > ROBOT_RADIUS_M


def test_depth_of_floor_and_ceiling_is_that_of_the_planes():
    pixels = {"floor": 0, "ceiling": 0}
    upwards = camera_pose(np.array([4.0, 3.0, 1.4]), 0.7, -0.5)
    for T in [*PLACES["cafe"].walk(12).T_world_camera, upwards]:
        surfaces = renderer().cast(T)
        rays = surfaces.rays.astype(np.float64)
        for label, height in (("floor", 0.0), ("ceiling", 2.7)):
            ids = [i + 1 for i, o in enumerate(scene().objects) if o.label == label]
            shown = np.isin(surfaces.instance, ids)
            expected = (height - T[2, 3]) / rays[..., 2][shown]
            np.testing.assert_allclose(surfaces.depth_m[shown], expected, rtol=2e-4)
            pixels[label] += int(shown.sum())
    assert pixels["floor"] > 20_000 and pixels["ceiling"] > 5_000


def test_back_projected_pixels_lie_in_their_instance_s_box():
    boxes = np.stack([np.zeros((2, 3)), *[o.bounds_m for o in scene().objects]])
    for T in PLACES["cafe"].walk(8).T_world_camera:
        frame = renderer().render(T)
        v, u = np.nonzero(frame.depth_m)
        z = frame.depth_m[v, u].astype(np.float64)
        camera = np.stack([(u - SMALL.cx) / SMALL.fx * z, (v - SMALL.cy) / SMALL.fy * z, z], -1)
        world = camera @ T[:3, :3].T + T[:3, 3]
        low, high = boxes[frame.instance[v, u]].swapaxes(0, 1)
        assert (world > low - 2e-3).all() and (world < high + 2e-3).all()


def test_windows_have_an_instance_but_no_depth():
    pose = camera_pose(np.array([1.5, 3.7, 1.45]), np.pi, 0.0)  # in the café, towards the west window
    frame = renderer().render(pose)
    window = found("window cafe west 1")[0]
    assert frame.instance[60, 80] == window
    share = (frame.depth_m[frame.instance == window] == 0).mean()
    assert share > 0.8
    assert (frame.depth_m[frame.instance != window] > 0).all()


def test_pictures_are_neither_dark_nor_burnt_out():
    for T in PLACES["cafe"].walk(6).T_world_camera:
        color = renderer().render(T).color
        assert color.dtype == np.uint8 and color.shape == (120, 160, 3)
        assert 70 < color.mean() < 230
        assert (color.max(axis=-1) == 255).mean() < 0.05


def measured(depth, incidence, sensor, rng):
    return sense(depth, incidence, np.ones(depth.shape, np.uint8), sensor, rng)[0]


def test_noise_follows_its_formula():
    sensor = DepthSensor(lateral_sigma_px=0.0)
    rng = np.random.default_rng(0)
    for z in (1.0, 2.5, 4.5):
        depth = np.full((200, 200), z, dtype=np.float32)
        seen = measured(depth, np.ones_like(depth), sensor, rng) / 1000.0
        assert (seen > 0).all()
        assert seen.mean() == pytest.approx(z, abs=6e-4)
        assert seen.std() == pytest.approx(0.0012 + 0.0019 * (z - 0.4) ** 2, rel=0.05)


def test_depth_is_lost_beyond_the_range_at_edges_and_at_grazing_angles():
    sensor, rng = DepthSensor(), np.random.default_rng(0)
    depth = np.full((120, 120), 2.0, dtype=np.float32)
    flat = np.full_like(depth, 0.01)
    assert (measured(depth, flat, sensor, rng) == 0).mean() > 0.75
    for outside in (0.1, 7.0, 0.0):
        assert (measured(np.full_like(depth, outside), np.ones_like(depth), sensor, rng) == 0).all()
    depth[:, 60:] = 4.0
    lost = measured(depth, np.ones_like(depth), sensor, rng) == 0
    assert 0.3 < lost[:, 59:61].mean() < 0.5
    assert not lost[:, :50].any() and not lost[:, 70:].any()


def test_exact_depth_when_the_sensor_is_ideal():
    depth = np.array([[0.2, 1.2344, 5.9, 6.1]], dtype=np.float32)
    seen = measured(depth, np.zeros_like(depth), DepthSensor(enabled=False), np.random.default_rng(0))
    assert seen.tolist() == [[0, 1234, 5900, 0]]


def test_an_id_wanders_with_its_depth():
    depth = np.full((200, 200), 2.0, dtype=np.float32)
    depth[:, 100:] = 4.0
    ids = np.where(depth < 3.0, 7, 9).astype(np.uint8)
    sensor = DepthSensor(lateral_sigma_px=5.0, sigma_growth_per_m=0.0)
    seen, moved = sense(depth, np.ones_like(depth), ids, sensor, np.random.default_rng(0))
    assert (moved != ids).sum() > 100  # the edge is ragged
    assert ((moved == 7) == (seen < 3000))[seen > 0].all()
