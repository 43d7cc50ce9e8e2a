"""Properties of poses, back-projection and the map frame."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.geometry import (
    back_project,
    check_rotation,
    heading_to_yaw,
    invert_pose,
    map_from_world,
    project,
    shared_cells,
    transform_points,
    turned,
    turned_pose,
    upright_turns,
    wrap_angle,
    yaw_to_heading,
)
from simaps_viz.scenes.walk import camera_pose
from simaps_viz.structures import Frame, Intrinsics

coordinates = st.floats(-20, 20)
points = arrays(np.float64, (7, 3), elements=coordinates)
directions = arrays(np.float64, 3, elements=coordinates).filter(lambda d: np.linalg.norm(d) > 1e-3)


def rotation_about(axis: NDArray, angle_rad: float) -> NDArray:
    """Rodrigues' formula, written out by columns: an independent way to make rotations."""
    k = axis / np.linalg.norm(axis)
    columns = [
        e * np.cos(angle_rad) + np.cross(k, e) * np.sin(angle_rad) + k * (k @ e) * (1 - np.cos(angle_rad))
        for e in np.eye(3)
    ]
    return np.stack(columns, axis=1)


def rigid(axis: NDArray, angle_rad: float, shift: NDArray) -> NDArray:
    T = np.eye(4)
    T[:3, :3] = rotation_about(axis, angle_rad)
    T[:3, 3] = shift
    return T


poses = st.builds(rigid, directions, st.floats(-np.pi, np.pi), arrays(np.float64, 3, elements=coordinates))


@given(
    depth_m=arrays(np.float32, (5, 8), elements=st.floats(0.125, 50, width=32)),
    fx=st.floats(5, 2000),
    fy=st.floats(5, 2000),
    cx=st.floats(-2, 9),
    cy=st.floats(-2, 9),
)
def test_projecting_back_projected_pixels_returns_them(
    depth_m: NDArray, fx: float, fy: float, cx: float, cy: float
) -> None:
    v, u = np.mgrid[:5, :8]
    camera_points = back_project(depth_m, fx, fy, cx, cy)
    assert camera_points.shape == (5, 8, 3)
    np.testing.assert_allclose(project(camera_points, fx, fy, cx, cy), np.stack([u, v], axis=-1), atol=1e-8)
    np.testing.assert_array_equal(camera_points[..., 2], depth_m)


def test_back_projection_follows_the_opencv_axes() -> None:
    """Right of the principal point is +x, below it +y, ahead +z; invalid depth gives the origin."""
    depth_m = np.array([[2.0, 2.0], [0.0, 4.0]], np.float32)
    found = back_project(depth_m, 2.0, 4.0, 0.0, 0.0)
    np.testing.assert_array_equal(found, [[[0, 0, 2], [1, 0, 2]], [[0, 0, 0], [2, 1, 4]]])


@given(T_a_b=poses, points_b=points)
def test_inverse_pose_undoes_the_pose(T_a_b: NDArray, points_b: NDArray) -> None:
    np.testing.assert_allclose(
        transform_points(invert_pose(T_a_b), transform_points(T_a_b, points_b)), points_b, atol=1e-9
    )
    np.testing.assert_allclose(invert_pose(T_a_b), np.linalg.inv(T_a_b), atol=1e-9)


@given(T_a_b=poses, T_b_c=poses, points_c=points)
def test_poses_chain(T_a_b: NDArray, T_b_c: NDArray, points_c: NDArray) -> None:
    chained = transform_points(T_a_b, transform_points(T_b_c, points_c))
    np.testing.assert_allclose(transform_points(T_a_b @ T_b_c, points_c), chained, atol=1e-9)
    np.testing.assert_allclose(transform_points(T_a_b, np.zeros(3)), T_a_b[:3, 3])  # the frame's own origin
    np.testing.assert_allclose(transform_points(T_a_b @ T_b_c, points_c.reshape(1, 7, 3))[0], chained, atol=1e-9)


@given(up=directions, floor_height_m=coordinates, points_world=points)
@example(up=np.array([2.0**-14, 2.0**-14, -2.0]), floor_height_m=0.0, points_world=np.zeros((7, 3)))  # upside down
@example(up=np.array([0.0, -1e-90, -1.0]), floor_height_m=0.0, points_world=np.ones((7, 3)))
@example(up=np.array([1e-200, 0.0, -1.0]), floor_height_m=0.0, points_world=np.ones((7, 3)))
def test_map_frame_stands_on_the_floor(up: NDArray, floor_height_m: float, points_world: NDArray) -> None:
    T_map_world = map_from_world(up, floor_height_m)
    unit_up = up / np.linalg.norm(up)
    rotation = T_map_world[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(rotation @ unit_up, (0, 0, 1), atol=1e-14)
    np.testing.assert_array_equal(T_map_world[3], (0, 0, 0, 1))
    on_floor = points_world + np.outer(floor_height_m - points_world @ unit_up, unit_up)
    np.testing.assert_allclose(transform_points(T_map_world, on_floor)[:, 2], 0, atol=1e-5)
    heights = transform_points(T_map_world, points_world)[:, 2]
    np.testing.assert_allclose(heights, points_world @ unit_up - floor_height_m, atol=1e-5)


@given(length=st.floats(0.01, 100), floor_height_m=coordinates)
def test_a_world_with_z_up_keeps_x_and_y(length: float, floor_height_m: float) -> None:
    expected = np.eye(4)
    expected[2, 3] = -floor_height_m
    np.testing.assert_array_equal(map_from_world((0, 0, length), floor_height_m), expected)


@given(up=directions)
def test_the_map_frame_is_the_shortest_turn(up: NDArray) -> None:
    """The turning angle is that between up and +z: no needless turn about the vertical."""
    rotation = map_from_world(up, 0.0)[:3, :3]
    cosine = up[2] / np.linalg.norm(up)
    assume(abs(cosine) < 1 - 1e-6)
    assert (np.trace(rotation) - 1) / 2 == pytest.approx(cosine, abs=1e-6)


def test_a_world_upside_down() -> None:
    np.testing.assert_allclose(map_from_world((0, 0, -1), 2.0) @ (1, 2, -2, 1), (1, -2, 0, 1))


@pytest.mark.parametrize("up", [(0, 0, 0), (0, 1), (float("nan"), 0, 1), (float("inf"), 0, 1)])
def test_bad_up(up: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="up: expected three finite numbers that are not all zero, found"):
        map_from_world(up, 0.0)


@pytest.mark.parametrize(("heading_deg", "yaw_deg"), [(0, 90), (90, 0), (180, -90), (270, 180), (45, 45), (-90, 180)])
def test_headings_run_clockwise_from_north(heading_deg: float, yaw_deg: float) -> None:
    assert np.rad2deg(heading_to_yaw(heading_deg)) == pytest.approx(yaw_deg)


@given(heading_deg=st.floats(-1000, 1000))
def test_heading_to_yaw_and_back(heading_deg: float) -> None:
    again = yaw_to_heading(heading_to_yaw(heading_deg))
    assert 0 <= again <= 360
    assert wrap_angle(np.deg2rad(again - heading_deg)) == pytest.approx(0, abs=1e-9)


@given(angle_rad=st.floats(-100, 100))
def test_wrapped_angles_point_the_same_way(angle_rad: float) -> None:
    wrapped = wrap_angle(angle_rad)
    assert -np.pi <= wrapped <= np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle_rad), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle_rad), abs=1e-9)


def test_half_turns_wrap_to_plus_pi() -> None:
    assert wrap_angle(np.pi) == wrap_angle(-np.pi) == np.pi


@given(axis=directions, angle_rad=st.floats(-np.pi, np.pi))
def test_rotations_pass(axis: NDArray, angle_rad: float) -> None:
    check_rotation(rotation_about(axis, angle_rad), "here")


@given(axis=directions, angle_rad=st.floats(-np.pi, np.pi), scale=st.floats(1.02, 3))
def test_what_is_no_rotation_fails(axis: NDArray, angle_rad: float, scale: float) -> None:
    rotation = rotation_about(axis, angle_rad)
    with pytest.raises(InputError, match=r"^here: expected an orthonormal rotation, found one off by"):
        check_rotation(rotation * scale, "here")
    with pytest.raises(InputError, match=r"^here: expected a right-handed rotation .* found a mirrored one"):
        check_rotation(rotation * (1, 1, -1), "here")
    rotation[1, 2] = np.nan
    with pytest.raises(InputError, match=r"^here: expected a finite rotation, found NaN"):
        check_rotation(rotation, "here")


@given(axis=directions, angle_rad=st.floats(-np.pi, np.pi), turns=st.integers(-3, 6))
def test_a_turned_camera_sees_the_same_points(axis: NDArray, angle_rad: float, turns: int) -> None:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation_about(axis, angle_rad), (1, -2, 3)
    depth_m = np.random.default_rng(3).uniform(1, 4, (5, 7)).astype(np.float32)
    frame = Frame(0, "0", depth_m, pose, Intrinsics(7, 5, 6.0, 5.0, 2.5, 2.25), np.zeros((5, 7, 3), np.uint8))

    def points(frame: Frame) -> NDArray:
        k = frame.intrinsics
        return transform_points(frame.T_world_camera, back_project(frame.depth_m, k.fx, k.fy, k.cx, k.cy))

    found = frame.turned(turns)
    np.testing.assert_allclose(points(found), turned(points(frame), turns), atol=1e-6)
    np.testing.assert_allclose(found.turned(-turns).T_world_camera, pose)
    assert found.turned(-turns).intrinsics == frame.intrinsics


@given(ids=arrays(np.int32, (2, 4, 9), elements=st.integers(0, 3)))
def test_cells_that_two_layers_share_are_counted(ids: NDArray) -> None:
    twin = Counter(pair for pair in zip(*ids.reshape(2, -1).tolist(), strict=True) if min(pair) > 0)
    assert list(zip(*(counts.tolist() for counts in shared_cells(*ids)), strict=True)) == sorted(
        (*pair, cells) for pair, cells in twin.items()
    )
    assert [len(counts) for counts in shared_cells(*ids[:, :0])] == [0, 0, 0]


@given(
    yaw_rad=st.floats(-np.pi, np.pi),
    pitch_rad=st.floats(-1.3, 1.3),
    roll_rad=st.floats(-0.75, 0.75),
    turns=st.integers(0, 3),
)
def test_pictures_are_turned_until_they_stand_upright(
    yaw_rad: float, pitch_rad: float, roll_rad: float, turns: int
) -> None:
    pose = camera_pose(np.zeros(3), yaw_rad, pitch_rad)
    pose[:3, :3] = pose[:3, :3] @ rotation_about(np.array([0.0, 0.0, 1.0]), roll_rad)
    assert upright_turns(turned_pose(pose, turns)) == -turns % 4
    assert upright_turns(turned_pose(camera_pose(np.zeros(3), yaw_rad, np.pi / 2), turns)) == 0  # straight down
