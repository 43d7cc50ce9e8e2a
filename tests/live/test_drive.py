"""What is sent to a robot: maps always; goals only where they are allowed twice, rehearsed, near and stopped."""

import time
from typing import Any

import numpy as np
import pytest
from driving import COMMAND, SIMAP, START
from waiting import until

from simaps_viz.events import BuildFinished
from simaps_viz.live import drive
from simaps_viz.live.drive import GOAL, LEASH_M, OUT, PATH, Driver, MapPublisher, Messages, resampled
from simaps_viz.live.links import message_types


class Robot:
    """A robot's source and link in one, which stands at a pose and goes at once to each goal it is sent."""

    def __init__(self, x=0.0, y=0.0, *, obeys=True):
        self.T, self.age_s, self.state, self.obeys = np.eye(4), 0.0, "", obeys
        self.T[:2, 3] = x, y
        self.sent, self.advertised, self.goals = [], [], []
        self.link = self

    def robot(self):
        return "map", self.T.copy(), self.age_s

    services = ()

    def listen(self, topic, take):
        pass

    def advertise(self, topic, kind):
        self.advertised.append(topic)

    def publish(self, topic, data):
        assert topic in self.advertised, f"{topic} was never announced"
        if self.state:
            return False
        self.sent.append((topic, data))
        if topic == GOAL:
            at = message_types().deserialize_cdr(data, "geometry_msgs/msg/PoseStamped").pose.position
            self.goals.append((np.linalg.norm([at.x - self.T[0, 3], at.y - self.T[1, 3]]), at.x, at.y))
            if self.obeys:
                self.T[:2, 3] = at.x, at.y
        return True

    @property
    def topics(self):
        return {topic for topic, _ in self.sent}


def driver(robot, *, allowed=True, watched=lambda: True):
    source: Any = robot
    return Driver(source, lambda: SIMAP, watched, allowed=allowed)


def test_without_the_option_nothing_but_the_map_is_ever_sent():
    robot = Robot(*START[:2])
    one = driver(robot, allowed=False)
    one.switch(True)
    one.go(COMMAND)
    one.stop()
    one.close()
    assert robot.sent == [] and robot.advertised == [] and "--drive" in one.words()
    source: Any = robot
    MapPublisher(source).on_event(BuildFinished(SIMAP))
    assert robot.topics <= set(OUT) and len(robot.sent) == 2 and set(robot.advertised) == set(OUT)


@pytest.mark.parametrize("fault", ["switch", "stale", "page", "connection", "command"])
def test_what_is_amiss_moves_nothing(fault):
    robot = Robot(*START[:2])
    one = driver(robot, watched=lambda: fault != "page")
    one.switch(fault != "switch")
    robot.age_s, robot.state = 0.6 if fault == "stale" else 0.0, "lost" if fault == "connection" else ""
    one.go("go to the elephant" if fault == "command" else COMMAND)
    robot.state = ""
    time.sleep(3 * drive.TICK_S)
    assert GOAL not in robot.topics and one.words()
    one.close()


def test_the_robot_is_led_along_the_rehearsed_path_to_its_end():
    x, y, rehearsed = START
    robot = Robot(x, y)
    one = driver(robot)
    one.switch(True)
    one.go(COMMAND)
    until(lambda: one.words() == "Arrived.")
    assert robot.topics == {PATH, GOAL} and len(robot.goals) > 2
    assert all(far <= LEASH_M + 1e-6 for far, _, _ in robot.goals)
    end = rehearsed.final_pose
    assert robot.goals[-1][1:] == pytest.approx((end.x_m, end.y_m), abs=1e-6)
    path = resampled(rehearsed.path_m)
    for _, gx, gy in robot.goals:
        assert np.linalg.norm(path - (gx, gy), axis=1).min() < drive.SAMPLE_M
    one.close()


def test_stop_makes_its_own_place_the_goal_and_nothing_follows():
    robot = Robot(*START[:2], obeys=False)
    one = driver(robot)
    one.switch(True)
    one.go(COMMAND)
    assert len(robot.goals) == 1
    one.stop()
    assert robot.goals[-1][0] == pytest.approx(0.0, abs=1e-9) and one.words() == "Stopped."
    robot.obeys = True
    time.sleep(3 * drive.TICK_S)
    assert len(robot.goals) == 2
    one.close()


@pytest.mark.parametrize("lost", ["page", "pose", "connection"])
def test_who_loses_the_page_the_pose_or_the_connection_is_stopped_and_does_not_go_on(lost, monkeypatch):
    monkeypatch.setattr(drive, "LOST_S", 0.2)
    there = [True]
    robot = Robot(*START[:2], obeys=False)
    one = driver(robot, watched=lambda: there[0])
    one.switch(True)
    one.go(COMMAND)
    if lost == "page":
        there[0] = False
    elif lost == "pose":
        robot.age_s = 1.0
    else:
        robot.state = "connection lost"
    until(lambda: one.words().startswith("Stopped:"))
    there[0], robot.age_s, robot.state, robot.obeys = True, 0.0, "", True
    count = len(robot.goals)
    assert count == (2 if lost == "page" else 1)
    time.sleep(3 * drive.TICK_S)
    assert len(robot.goals) == count
    one.close()


def test_a_robot_that_leaves_its_path_is_stopped():
    robot = Robot(*START[:2], obeys=False)
    one = driver(robot)
    one.switch(True)
    one.go(COMMAND)
    robot.T[:2, 3] += 50.0
    until(lambda: "left its path" in one.words())
    one.close()


def test_the_grid_and_the_objects_lie_where_the_map_has_them():
    T_world_map = np.eye(4)
    T_world_map[:3, 3] = 10.0, -4.0, 0.5
    make, types = Messages("map", T_world_map), message_types()
    grid = types.deserialize_cdr(make.grid(SIMAP), OUT["/si_map"])
    spec, origin = SIMAP.spec, grid.info.origin.position
    assert (grid.info.height, grid.info.width) == spec.shape and grid.header.frame_id == "map"
    assert (origin.x, origin.y, origin.z) == pytest.approx((spec.x0_m + 10.0, spec.y0_m - 4.0, 0.5))
    seen = ~np.isnan(SIMAP.grid.height_m)
    cells = grid.data.reshape(spec.shape)
    assert set(np.unique(cells).tolist()) <= {-1, 0, 100} and np.array_equal(cells == -1, ~seen & (cells != 100))
    markers = types.deserialize_cdr(make.objects(SIMAP), OUT["/si_map/objects"]).markers
    assert len(markers) == 1 + 2 * len(SIMAP.instances) and markers[0].action == 3
    one = SIMAP.instances[0]
    text = next(m for m in markers if m.text == f"{one.label} {one.id}")
    assert (text.pose.position.x, text.pose.position.y) == pytest.approx(
        (one.centroid_m[0] + 10, one.centroid_m[1] - 4)
    )
