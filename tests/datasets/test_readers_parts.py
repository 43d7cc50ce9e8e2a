"""What the readers share: association by time, interpolation of poses, one camera's picture seen by another."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scans import camera, look, map_pose
from scipy.spatial.transform import Rotation

from simaps_viz.datasets.association import associate, interpolate_poses, nearest
from simaps_viz.datasets.calibration import Lens, from_quaternion, rigid, see_through
from simaps_viz.errors import InputError
from simaps_viz.structures import Intrinsics

TIMES = st.lists(st.integers(0, 200), min_size=1, max_size=20, unique=True).map(lambda x: np.sort(x) / 10.0)


@given(TIMES, TIMES)
def test_nearest_is_the_nearest(times, wanted):
    by_hand = np.abs(times[None] - wanted[:, None]).argmin(axis=1)
    np.testing.assert_array_equal(np.abs(times[nearest(times, wanted)] - wanted), np.abs(times[by_hand] - wanted))


@given(TIMES, TIMES, st.floats(0.01, 3))
def test_pairs_are_close_ascending_and_used_once(a, b, tolerance_s):
    pairs = associate(a, b, tolerance_s=tolerance_s)
    assert (np.abs(a[pairs[:, 0]] - b[pairs[:, 1]]) <= tolerance_s).all()
    assert (np.diff(pairs, axis=0) > 0).all()
    for i, time in enumerate(a):  # whoever is left out has no neighbour, or lost it to a closer one
        if i not in pairs[:, 0]:
            j = nearest(b, a[i : i + 1])[0]
            winner = pairs[pairs[:, 1] == j, 0]
            assert abs(b[j] - time) > tolerance_s or abs(a[winner[0]] - b[j]) <= abs(time - b[j])


def test_nothing_to_pair():
    assert associate(np.array([]), np.array([1.0]), tolerance_s=1).shape == (0, 2)


def poses_at(times) -> np.ndarray:
    """Half a turn a second about one axis, a metre a second along another."""
    T = np.tile(np.eye(4), (len(times), 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(np.outer(times, [0, 0.3, 0.2])).as_matrix()
    T[:, 0, 3] = times
    return T


@given(st.lists(st.floats(0, 9), min_size=1, max_size=9))
@settings(deadline=None)
def test_steady_motion_is_interpolated_exactly(at):
    times = np.arange(10.0)
    found, known = interpolate_poses(times, poses_at(times), np.array(at), max_gap_s=1.0)
    assert known.all()
    np.testing.assert_allclose(found, poses_at(np.array(at)), atol=1e-5)


def test_no_pose_is_made_up_in_a_gap_or_outside():
    times = np.array([0.0, 1.0, 5.0, 6.0])
    at = np.array([-0.2, -0.05, 0.5, 1.0, 3.0, 5.0, 6.05, 6.2])
    found, known = interpolate_poses(times, poses_at(times), at, max_gap_s=1.5, beyond_s=0.1)
    assert known.tolist() == [False, True, True, True, False, True, True, False]
    np.testing.assert_array_equal(found[3], poses_at(times)[1], "recorded poses are not touched")
    one, known = interpolate_poses(times[:1], poses_at(times[:1]), np.array([0.0, 1.0]), max_gap_s=9, beyond_s=0.1)
    assert known.tolist() == [True, False] and one.shape == (2, 4, 4)


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_quaternions_agree_with_scipy(q):
    xyzw = np.array(q) / np.linalg.norm(q)
    T = from_quaternion("here", [1, 2, 3], xyzw * 1.004)
    np.testing.assert_allclose(T[:3, :3], Rotation.from_quat(xyzw).as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(T[:3, 3], [1, 2, 3])


def test_few_digits_are_squared_up_and_stretching_is_refused():
    T = map_pose(1)
    squared = rigid("here", np.round(T, 4))
    np.testing.assert_allclose(squared[:3, :3] @ squared[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(squared, T, atol=1e-4)
    np.testing.assert_array_equal(rigid("here", np.eye(4)), np.eye(4))
    for wrong in (T * [2, 1, 1, 1], T * [-1, 1, 1, 1], np.full((4, 4), np.nan), np.eye(3)):
        with pytest.raises(InputError, match="here: expected"):
            rigid("here", wrong)


def test_another_focal_length_shows_what_that_camera_sees():
    wide, near = camera(focal=50.0), camera(focal=70.0)
    depth_m, ids = look(wide, map_pose(0))
    expected_m, expected_ids = look(near, map_pose(0))
    seen = see_through(ids, Lens(wide), near, exact=True)
    assert seen.dtype == np.int32 and (seen == expected_ids).mean() > 0.95
    seen_m = see_through(depth_m.astype(np.float32), Lens(wide), near, exact=True)
    assert np.median(np.abs(seen_m - expected_m)[(expected_m > 0) & (seen == expected_ids)]) < 0.03
    assert set(np.unique(seen_m)) <= set(np.unique(depth_m.astype(np.float32))) | {0.0}, "depth is never mixed"


def test_distortion_is_undone():
    k = Intrinsics(160, 120, 130.0, 131.0, 80.0, 61.0)
    bent = Lens(k, (0.2624, -0.9531, -0.0054, 0.0026, 1.1633))
    straight = np.array([[20.0, 30.0], [80.0, 61.0], [140.0, 100.0], [100.0, 20.0]])
    picture = np.zeros((120, 160), np.uint8)
    rays = np.c_[(straight - [k.cx, k.cy]) / [k.fx, k.fy], np.ones(4)]
    where = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), k.matrix(), np.array(bent.distortion))[0][:, 0]
    for i, (u, v) in enumerate(where):
        cv2.circle(picture, (round(u), round(v)), 2, i + 1, -1)
    undone = see_through(picture, bent, k, exact=True)
    for i, point in enumerate(straight):
        assert np.abs(np.argwhere(undone == i + 1).mean(axis=0)[::-1] - point).max() < 0.7


def test_an_equal_camera_changes_nothing():
    image = np.arange(12.0).reshape(3, 4)
    k = Intrinsics(4, 3, 4.0, 4.0, 1.5, 1.0)
    assert see_through(image, Lens(k), k, exact=True) is image


@given(st.integers(1, 5))
def test_resized_cameras_see_the_same_directions(factor):
    k = camera()
    big = Lens(k).scaled(k.width * factor, k.height * factor).intrinsics
    corner, big_corner = (-0.5 - k.cx) / k.fx, (-0.5 - big.cx) / big.fx
    assert corner == pytest.approx(big_corner) and big.width == k.width * factor
    assert Lens(big).scaled(k.width, k.height).intrinsics.cx == pytest.approx(k.cx)
