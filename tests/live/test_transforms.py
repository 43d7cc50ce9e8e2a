"""Poses from transforms as they come: interpolated, waited for, corrected, and never made up over a gap."""

import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simaps_viz.live.robot import LiveTransforms

S = 10**9


def pose(x=0.0, y=0.0, yaw=0.0):
    T = np.eye(4)
    T[:2, 3], T[:3, :3] = (x, y), Rotation.from_euler("z", yaw).as_matrix()
    return T


def robot(*, steps=((0.0, 0.0),), seconds=10, speed=0.4):
    """A robot that drives along x by its odometry, with a camera 1 m ahead; steps of map to odom: (when, x)."""
    one = LiveTransforms()
    one.add("base", "camera", 0, pose(1.0), fixed=True)
    for at, x in steps:
        one.add("map", "odom", int(at * S), pose(x), fixed=False)
    for i in range(10 * seconds + 1):
        one.add("/odom", "base", i * S // 10, pose(speed * i / 10), fixed=False)
    return one


def x_of(one, at_s):
    found = one.pose("camera", int(at_s * S))
    return None if found is None else float(found.T_world_camera[0, 3])


def test_poses_are_interpolated_and_those_to_come_are_waited_for():
    one = robot()
    assert x_of(one, 0.25) == pytest.approx(1.1) and x_of(one, 10.0) == pytest.approx(5.0)
    assert x_of(one, 10.05) is None
    one.add("odom", "base", 103 * S // 10, pose(4.4), fixed=False)
    assert x_of(one, 10.15) == pytest.approx(5.2)


def test_nothing_is_made_up_over_a_gap_before_the_beginning_or_in_a_circle():
    one = robot()
    for at in (110, 113):
        one.add("odom", "base", at * S // 10, pose(5.4), fixed=False)
    for at_s, words in ((10.5, "silent for more than 0.5 s"), (-1.0, "before the first")):
        with pytest.raises(LookupError, match=words):
            x_of(one, at_s)
    one.add("base", "map", 0, pose(), fixed=True)
    with pytest.raises(LookupError, match="circle"):
        x_of(one, 1.0)


def test_map_to_odom_holds_until_it_steps_and_drift_is_spread_over_the_time_between():
    one = robot(steps=((0.0, 0.0),))
    before = [x_of(one, at) for at in (2.0, 4.0)]
    assert before == pytest.approx([1.8, 2.6])
    assert one.correction() is None
    one.add("map", "odom", 8 * S, pose(0.8), fixed=False)
    found = one.correction()
    assert found is not None and found.since_ns == 0 and one.correction() is None
    at = found.T_world_odom(np.array([2, 4, 9]) * S)[:, 0, 3]
    assert at == pytest.approx([0.2, 0.4, 0.8])
    # A picture that is late is placed as those that were placed again.
    assert x_of(one, 4.0) == pytest.approx(2.6 + 0.4) and x_of(one, 9.0) == pytest.approx(4.6 + 0.8)


def test_a_step_that_is_taken_back_was_a_mistake_and_not_drift():
    one = robot(steps=((0.0, 0.0), (4.0, 3.0), (6.0, 0.02)))
    found = one.correction()
    assert found is not None and found.since_ns == 0
    assert np.abs(found.T_world_odom(np.array([1, 3, 5, 7]) * S)[:, 0, 3]).max() <= 0.02


def test_small_steps_are_no_corrections():
    one = robot(steps=[(at, 0.01 * at) for at in range(9)])
    assert one.correction() is None


def test_odometry_that_begins_anew_leaves_earlier_frames_where_they_are():
    one = robot(steps=((0.0, 0.0),))
    assert one.pose("camera", 5 * S) is not None and one.epoch == 0
    one.add("odom", "base", 101 * S // 10, pose(-20.0), fixed=False)
    one.add("map", "odom", 11 * S, pose(0.0), fixed=False)
    one.add("map", "odom", 12 * S, pose(24.0), fixed=False)
    found = one.correction()
    assert one.epoch == 1 and found is not None and found.epoch == 1
    assert found.T_world_odom(np.array([105 * S // 10]))[0, 0, 3] == pytest.approx(24.0)


def test_the_robot_is_what_odom_carries_and_its_pose_ages(monkeypatch):
    one = robot(steps=((0.0, 2.0),))
    found = one.robot()
    assert found is not None and found[0] == "map" and found[1][0, 3] == pytest.approx(6.0) and found[2] < 60.0
    later_s = time.monotonic() + 9.0
    monkeypatch.setattr("simaps_viz.live.robot.time.monotonic", lambda: later_s)
    assert (again := one.robot()) is not None and again[2] >= 9.0


def arc(at_s, *, until_s=99.0):
    """Where a robot is that drives an arc of 0.4 m/s and 0.3 rad/s, up to a time."""
    turned = 0.3 * min(at_s, until_s)
    return pose(0.4 / 0.3 * np.sin(turned), 0.4 / 0.3 * (1 - np.cos(turned)), turned)


@pytest.mark.parametrize("until_s", [99.0, 1.0])
def test_a_silence_is_bridged_where_the_robot_has_kept_its_speed_or_has_stood(until_s):
    one = LiveTransforms()
    one.add("base", "camera", 0, pose(), fixed=True)
    one.add("map", "odom", 0, pose(), fixed=False)
    at_s = [i / 10 for i in (*range(21), *range(50, 54))]
    for at in at_s[:-1]:
        one.add("odom", "base", int(at * S), arc(at, until_s=until_s), fixed=False)
    assert one.pose("camera", 3 * S) is None  # how it goes on tells
    one.add("odom", "base", int(at_s[-1] * S), arc(at_s[-1], until_s=until_s), fixed=False)
    for at in (2.5, 3.0, 4.5):
        found = one.pose("camera", int(at * S))
        assert found is not None and np.allclose(found.T_world_camera, arc(at, until_s=until_s), atol=1e-6)


def test_a_silence_in_which_the_robot_has_turned_otherwise_or_that_is_long_is_not_bridged():
    for ways, silent_s in (((arc, lambda at: arc(at, until_s=3.0)), 3), ((arc, arc), 5)):
        one = LiveTransforms()
        one.add("base", "camera", 0, pose(), fixed=True)
        for way, begins in zip(ways, (0, 20 + 10 * silent_s), strict=True):
            for i in range(begins, begins + 21):
                one.add("odom", "base", i * S // 10, way(i / 10), fixed=False)
        with pytest.raises(LookupError, match="silent for more than"):
            one.pose("camera", 3 * S)


def test_map_to_odom_holds_while_it_is_silent_and_odometry_goes_on():
    one = robot(steps=((0.0, 2.0),), seconds=120)
    assert x_of(one, 119.0) == pytest.approx(2.0 + 1.0 + 0.4 * 119)


def test_steps_of_a_long_drive_are_not_kept_for_ever():
    one = robot(steps=[(at / 10, 0.2 * at) for at in range(2000)], seconds=1)
    assert len(one._steps) < 300 and one.correction() is not None
