"""Finding up and the floor: in rooms of known pose, and in real sequences from whose manifest both were removed."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sequences import write_tiny_sequence

from simaps_viz.datasets import gravity
from simaps_viz.datasets.gravity import estimate_gravity, find_gravity
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.geometry import back_project
from simaps_viz.structures import Frame, Intrinsics

pytestmark = pytest.mark.slow

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
CAMERA = Intrinsics(128, 96, 100.0, 100.0, 63.5, 47.5)
ROOM_M = np.array([[-3.0, -2.0, 0.0], [3.0, 2.0, 2.5]])
TABLE_M = np.array([[-1.5, -1.0, 0.75], [1.5, 1.0, 0.75]])
EYE_M = np.array([0.0, -1.6, 1.5])


def look(yaw_deg: float, pitch_deg: float) -> NDArray:
    """Return T_room_camera [4, 4] of a camera at EYE_M; positive pitch looks down."""
    yaw, pitch = np.deg2rad(yaw_deg), np.deg2rad(pitch_deg)
    forward = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    T_room_camera = np.eye(4)
    T_room_camera[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T_room_camera[:3, 3] = EYE_M
    return T_room_camera


def room_frame(T_room_camera: NDArray, T_world_room: NDArray) -> Frame:
    """Cast the rays of one picture: the walls, floor and ceiling of a box, and a large table top."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    rays = rays @ T_room_camera[:3, :3].T
    eye = T_room_camera[:3, 3]
    with np.errstate(divide="ignore"):
        depth = np.maximum(*((bound - eye) / rays for bound in ROOM_M)).min(axis=-1)
        table_depth = (TABLE_M[0, 2] - eye[2]) / rays[..., 2]
    hit = eye + rays * np.where(np.isfinite(table_depth), table_depth, 0)[..., None]
    on_table = (table_depth > 0) & (np.abs(hit[..., :2]) < TABLE_M[1, :2]).all(axis=-1)
    depth = np.where(on_table, table_depth, depth)
    return Frame(0, "room", depth.astype(np.float32), T_world_room @ T_room_camera, CAMERA)


def rigid(quaternion: tuple[float, float, float, float], shift: tuple[float, float, float]) -> NDArray:
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = shift
    return T


def angle_deg(a: NDArray, b: NDArray) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


numbers = st.floats(-1, 1)
worlds = st.builds(
    rigid,
    st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-9, 9)),
)


@settings(max_examples=8)
@given(T_world_room=worlds, pitch_deg=st.sampled_from([5.0, 25.0, 60.0]))
def test_a_room_in_any_world(T_world_room: NDArray, pitch_deg: float) -> None:
    """Walls fill most of every picture and the table top is larger than the floor seen around it."""
    frames = [room_frame(look(yaw, pitch_deg), T_world_room) for yaw in (20, 70, 110, 160, 250, 300)]
    up, floor_height_m = estimate_gravity(frames)
    true_up = T_world_room[:3, 2]
    assert np.linalg.norm(up) == pytest.approx(1)
    assert angle_deg(up, true_up) < 0.2
    assert floor_height_m == pytest.approx(true_up @ T_world_room[:3, 3], abs=0.02)


@settings(max_examples=8)
@given(T_world_room=worlds)
def test_known_up_of_any_length_only_needs_the_floor(T_world_room: NDArray) -> None:
    frames = [room_frame(look(yaw, 25.0), T_world_room) for yaw in (20, 160, 250)]
    up, floor_height_m = estimate_gravity(frames, up=T_world_room[:3, 2] * 3)
    np.testing.assert_allclose(up, T_world_room[:3, 2], atol=1e-12)
    assert floor_height_m == pytest.approx(up @ T_world_room[:3, 3], abs=0.01)


@pytest.mark.parametrize(
    ("off_deg", "said"), [(0.0, ""), (3.0, ""), (11.0, "surfaces say up is 11° from the one stated")]
)
def test_a_stated_up_is_kept_and_surfaces_that_contradict_it_are_said(off_deg: float, said: str) -> None:
    world = rigid((0.3, -0.5, 0.2, 0.8), (1.0, 2.0, -3.0))
    frames = [room_frame(look(yaw, 25.0), world) for yaw in (20, 70, 110, 160, 250, 300)]
    off = np.deg2rad(off_deg)
    stated = world[:3, :3] @ np.array([np.sin(off), 0.0, np.cos(off)])
    found = find_gravity(frames, up=stated)
    np.testing.assert_allclose(found.up, stated, atol=1e-12)
    assert found.up_note.partition(";")[0] == said


def test_a_camera_that_only_looks_straight_down(tmp_path: Path) -> None:
    """Its own up axis lies in the floor, so only the surfaces can tell."""
    sequence = open_sequence(write_tiny_sequence(tmp_path, manifest={"up": None, "floor_height_m": None}))
    assert sequence.gravity_estimated
    np.testing.assert_allclose(sequence.T_map_world, np.eye(4), atol=1e-3)


@pytest.mark.parametrize(
    ("changes", "floor_m"),
    [({"up": None}, 0.0), ({"floor_height_m": None}, 0.0), ({"up": None, "floor_height_m": 0.5}, 0.5)],
)
def test_what_the_manifest_says_is_kept(tmp_path: Path, changes: dict, floor_m: float) -> None:
    sequence = open_sequence(write_tiny_sequence(tmp_path, manifest=changes))
    assert sequence.T_map_world[2, 3] == pytest.approx(-floor_m, abs=1e-3)
    np.testing.assert_allclose(sequence.T_map_world[:3, :3], np.eye(3), atol=1e-3)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("yaws", [(20, 70, 110, 160, 250, 300), (20, 90, 170)])
def test_a_camera_held_on_its_side(side: float, yaws: tuple[int, ...]) -> None:
    """As a phone is: then the pictures' upper side says nothing about up."""
    roll = np.array([[0, side, 0, 0], [-side, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    world = rigid((0.3, -0.5, 0.2, 0.8), (1.0, 2.0, -3.0))
    up, floor_height_m = estimate_gravity([room_frame(look(yaw, 20.0) @ roll, world) for yaw in yaws])
    assert angle_deg(up, world[:3, 2]) < 0.2
    assert floor_height_m == pytest.approx(up @ world[:3, 3], abs=0.02)


def test_noise_of_one_percent() -> None:
    rng = np.random.default_rng(1)
    clean = [room_frame(look(yaw, 25.0), np.eye(4)) for yaw in (20, 70, 110, 160, 250, 300)]
    noisy = [replace(f, depth_m=f.depth_m * rng.normal(1, 0.01, f.depth_m.shape).astype(np.float32)) for f in clean]
    up, floor_height_m = estimate_gravity(noisy)
    assert angle_deg(up, np.array([0, 0, 1.0])) < 1.0
    assert floor_height_m == pytest.approx(0, abs=0.03)


def test_same_frames_same_answer() -> None:
    frames = [room_frame(look(yaw, 25.0), np.eye(4)) for yaw in (20, 160, 250)]
    first, second = estimate_gravity(frames), estimate_gravity(frames)
    np.testing.assert_array_equal(first[0], second[0])
    assert first[1] == second[1]


def test_nothing_to_see() -> None:
    blind = Frame(0, "dark", np.zeros((96, 128), np.float32), np.eye(4), CAMERA)
    with pytest.raises(InputError, match="expected surfaces to estimate up and the floor from, found 0 points"):
        estimate_gravity([blind])


def walls(yaws: tuple[float, ...], world: NDArray) -> list[Frame]:
    """Look level into a room whose floor, ceiling and table are out of view."""
    frames = [room_frame(look(yaw, 0.0), world) for yaw in yaws]
    band = slice(CAMERA.height // 2 - 18, CAMERA.height // 2 + 6)
    for frame in frames:
        kept = frame.depth_m[band].copy()
        frame.depth_m[:] = 0
        frame.depth_m[band] = kept
    return frames


def test_walls_alone_tell_up_and_the_floor_is_the_lowest_surface_seen() -> None:
    """A wall must not be taken for the floor, though most of what is seen faces its way."""
    world = rigid((0.3, -0.5, 0.2, 0.8), (1.0, 2.0, -3.0))
    frames = walls((20, 70, 110, 160, 250, 300), world)
    with pytest.raises(InputError, match="expected a floor"):
        estimate_gravity(frames)
    found = find_gravity(frames)
    assert angle_deg(found.up, world[:3, 2]) < 0.5
    points = np.concatenate([_points(frame) for frame in frames]) @ world[:3, 2]
    assert points.min() - 0.01 <= found.floor_height_m <= np.quantile(points, 0.05)
    assert "the direction that the walls stand along" in found.up_note and "--up" in found.up_note
    assert "the lowest surface seen" in found.floor_note and "--floor-height" in found.floor_note


@pytest.mark.parametrize("yaws", [(30, 40, 50), (200, 215, 230)])
def test_a_shelf_seen_from_one_side_has_its_walls_upright(yaws: tuple[float, ...]) -> None:
    """A camera that hardly turns keeps its right side as steady as its upper one; a side wall is no floor."""
    found = find_gravity(walls(yaws, np.eye(4)))
    assert angle_deg(found.up, np.array([0.0, 0.0, 1.0])) < 5
    assert "up is a guess" in found.up_note and "--up X,Y,Z" in found.up_note


def _points(frame: Frame) -> NDArray:
    k, T = frame.intrinsics, frame.T_world_camera
    seen = back_project(frame.depth_m, k.fx, k.fy, k.cx, k.cy)[frame.depth_m > 0]
    return seen @ T[:3, :3].T + T[:3, 3]


def test_stated_up_and_nothing_below_the_cameras(tmp_path: Path) -> None:
    """Up is the manifest's, and nothing is below it: the lowest surface is taken, and said."""
    sequence = open_sequence(write_tiny_sequence(tmp_path, manifest={"up": [0, 0, -1], "floor_height_m": None}))
    np.testing.assert_allclose(sequence.T_map_world[2, :3], [0, 0, -1], atol=1e-12)
    assert [note.partition(":")[0] for note in sequence.notes] == ["no floor is in view"]
    stated = open_sequence(sequence.path, up=[0, 0, 2], floor_height_m=0.25)
    np.testing.assert_allclose(stated.T_map_world[2], [0, 0, 1, -0.25], atol=1e-12)
    assert stated.notes == ()
    np.testing.assert_allclose(open_sequence(sequence.path, up=[0, 0, 1]).T_map_world[2, 3], 0.0, atol=1e-3)


def test_nothing_at_all_to_see_still_has_an_up() -> None:
    blind = Frame(0, "dark", np.zeros((96, 128), np.float32), look(30, 0), CAMERA)
    found = find_gravity([blind])
    assert angle_deg(found.up, np.array([0.0, 0.0, 1.0])) < 0.1
    assert found.floor_height_m == pytest.approx(0.0) and "1.5 m below the cameras" in found.floor_note


@pytest.mark.skipif(not SHARED.is_dir(), reason="the sequences in ../shared/data are not here")
@pytest.mark.parametrize("folder", ["hololens-breakroom", "aws-small-house/rgbd"])
def test_real_sequences_without_gravity(tmp_path: Path, folder: str) -> None:
    keys = json.loads((SHARED / folder / "sequence.json").read_text())
    up, floor_height_m = np.array(keys["up"], float), keys["floor_height_m"]
    for key in ("color", "depth", "intrinsics", "poses"):
        keys[key] = os.path.relpath(SHARED / folder / keys[key], tmp_path)
    del keys["segmentation"]
    for key in ("up", "floor_height_m"):
        del keys[key]
    (tmp_path / "sequence.json").write_text(json.dumps(keys))
    T_map_world = open_sequence(tmp_path).T_map_world
    assert angle_deg(T_map_world[2, :3], up) < 1.0
    assert -T_map_world[2, 3] == pytest.approx(floor_height_m, abs=0.03)


def test_points_far_beyond_any_room_are_no_floor():
    """Fuzzing has met them: their squares are no numbers any more."""
    points = np.array([[1e200, 0.0, 0.0], [0.0, 1e200, 0.0], [-1e200, 0.0, 0.0]])
    up = np.array([0.0, 0.0, 1.0])
    far = gravity.Surface(points, np.tile(up, (3, 1)), np.ones(3))
    with pytest.raises(InputError, match="expected a floor to estimate up from, found 3 points"):
        gravity._fit_plane(far, up, 0.0)
    with pytest.raises(InputError, match="found 0 points"):
        gravity._fit_plane(far, up, 5.0)
