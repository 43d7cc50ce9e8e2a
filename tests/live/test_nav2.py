"""Goals as Nav2's action, over Zenoh: each sent once, cancelled once where nobody wants it, and none without leave."""

import struct
import threading
from typing import Any

import numpy as np
import pytest
from driving import COMMAND, SIMAP, START
from fake_robot import HASHES, FakeNav2, ZenohServer
from rihs import Definitions
from waiting import until

from simaps_viz.live import drive
from simaps_viz.live.drive import GOAL, GOAL_TYPE, LEASH_M, Driver, Nav2, error_of
from simaps_viz.live.links import ZenohLink, message_types, service_of
from simaps_viz.navigation.agent import answer
from simaps_viz.structures import Pose2

pytestmark = pytest.mark.slow  # each drive waits for a network of its own


class Robot:
    """A robot behind Zenoh that stands at a pose, and is at once at each goal that its Nav2 accepts, if it obeys."""

    def __init__(self, x, y, *, humble=False, action=True):
        self.server = ZenohServer(humble=humble, nav2=action)
        self.link = ZenohLink(self.server.address)
        self.T, self.age_s, self.obeys, self.page = np.eye(4), 0.0, True, True
        self.T[:2, 3] = x, y
        self._goal, self._types, self._over = None, message_types(), threading.Event()
        if action:
            self.nav2.on_goal = self._take
        self.link.open(lambda topics: None, lambda topic, data, sent_ns: None)
        until(lambda: not self.link.state)
        until(lambda: not action or {drive.SEND, drive.CANCEL, drive.RESULT} <= set(self.link.services))
        threading.Thread(target=self._move, daemon=True).start()

    @property
    def nav2(self) -> FakeNav2:
        assert self.server.nav2 is not None
        return self.server.nav2

    def robot(self):
        return "map", self.T.copy(), self.age_s

    def close(self):
        self._over.set()
        self.link.close()
        self.server.close()
        if self.server.nav2 is not None:
            assert self.nav2.faults == []

    def _take(self, pose):
        self._goal = self._types.deserialize_cdr(pose, GOAL_TYPE).pose.position

    def _move(self):
        while not self._over.wait(0.01):
            if self.obeys and self._goal is not None and self.nav2.going:
                self.T[:2, 3] = self._goal.x, self._goal.y
                self.nav2.end(drive.SUCCEEDED)


@pytest.fixture
def made(monkeypatch):
    """Make robots and their drivers, and close them."""
    pytest.importorskip("zenoh")
    monkeypatch.setattr(drive, "LOST_S", 0.2)
    monkeypatch.setattr(drive, "SETTLE_S", 60.0)
    found = []

    def make(x=START[0], y=START[1], *, allowed=True, obeys=True, **how):
        robot: Any = Robot(x, y, **how)
        robot.obeys = obeys
        one = Driver(robot, lambda: SIMAP, lambda: robot.page, allowed=allowed)
        one.switch(True)
        found.append((robot, one))
        return robot, one

    yield make
    for robot, one in found:
        one.close()
        robot.close()


def near_start():
    """A place from where the chair can be reached by one goal."""
    for point in START[2].path_m[::-1]:
        found = answer(SIMAP, COMMAND, Pose2(float(point[0]), float(point[1]), 0.0))
        if found.status == "ok" and 0.5 < found.path_length_m < LEASH_M:
            return float(point[0]), float(point[1])
    raise AssertionError("no place on the path is near the chair")


@pytest.mark.parametrize("humble", [False, True])
def test_a_ride_within_the_leash_is_one_goal_and_its_success_the_arrival(made, humble):
    robot, one = made(*near_start(), humble=humble)
    one.go(COMMAND)
    until(lambda: one.words() == "Arrived.")
    assert len(robot.nav2.asked) == 1 and robot.nav2.cancels == []
    assert GOAL not in {topic for topic, _ in robot.server.received}


def test_on_a_longer_ride_each_goal_is_sent_once_and_none_is_cancelled(made):
    robot, one = made()
    one.go(COMMAND)
    until(lambda: one.words() == "Arrived.")
    assert 1 < len(robot.nav2.asked) == len(set(robot.nav2.asked)) and robot.nav2.cancels == []
    end = START[2].final_pose
    assert np.linalg.norm(robot.T[:2, 3] - (end.x_m, end.y_m)) < 1e-6


def test_stop_cancels_our_goal_once_by_its_id(made):
    robot, one = made(obeys=False)
    one.go(COMMAND)
    until(lambda: robot.nav2.going)
    one.stop()
    one.stop()
    until(lambda: one.words() == "Stopped.")
    assert robot.nav2.cancels == robot.nav2.asked and len(robot.nav2.asked) == 1 and not robot.nav2.going
    one.stop()
    assert one._nav2.settle(0.0) and len(robot.nav2.cancels) == 1


def test_stop_leaves_the_goals_of_others_alone(made):
    robot, one = made(obeys=False)
    robot.nav2.states[b"somebody elses g"] = drive.EXECUTING
    robot.nav2.tell()
    one.stop()
    assert robot.nav2.cancels == [] and robot.nav2.going


@pytest.mark.parametrize("by", ["stop", "replaced", "closed"])
def test_a_goal_that_is_accepted_when_nobody_wants_it_is_cancelled_at_once(made, by):
    robot, one = made(obeys=False)
    robot.nav2.answers.clear()
    one.go(COMMAND)
    until(lambda: len(robot.nav2.asked) == 1)
    if by == "replaced":
        one.go(COMMAND)
    elif by == "stop":
        one.stop()
        assert "not confirmed" in one.words()
    else:
        threading.Timer(0.1, robot.nav2.answers.set).start()
        one.close()
        assert robot.nav2.cancels == robot.nav2.asked  # the connection is closed next
    robot.nav2.answers.set()
    until(lambda: robot.nav2.cancels)
    until(lambda: one._nav2.settle(0.0))
    assert robot.nav2.cancels == robot.nav2.asked[:1]
    until(lambda: len(robot.nav2.asked) == 1 + (by == "replaced") and len(robot.nav2.going) == (by == "replaced"))


@pytest.mark.parametrize("lost", ["page", "switch", "path"])
def test_who_loses_the_robot_cancels_once(made, lost):
    robot, one = made(obeys=False)
    one.go(COMMAND)
    until(lambda: robot.nav2.going)
    if lost == "switch":
        one.switch(False)
    elif lost == "path":
        robot.T[:2, 3] += 50.0
    else:
        robot.page = False
    until(lambda: robot.nav2.cancels)
    robot.page, robot.obeys = True, True
    until(lambda: one.words().startswith("Stopped") and one._nav2.settle(0.0))
    assert robot.nav2.cancels == robot.nav2.asked and len(robot.nav2.asked) == 1


def test_a_goal_that_could_not_be_cancelled_without_a_connection_is_when_it_is_back(made, monkeypatch):
    robot, one = made(obeys=False)
    one.go(COMMAND)
    until(lambda: robot.nav2.going)
    call, there = ZenohLink.call, [False]
    monkeypatch.setattr(ZenohLink, "call", lambda *args: there[0] and call(*args))
    one.stop()
    assert robot.nav2.cancels == [] and "not confirmed" in one.words()
    there[0] = True
    until(lambda: one.words() == "Stopped.")
    assert robot.nav2.cancels == robot.nav2.asked and len(robot.nav2.asked) == 1


@pytest.mark.parametrize("fault", ["option", "stale"])  # the others: tests/live/test_drive.py
def test_what_is_amiss_sends_no_goal_by_either_way(made, fault):
    robot, one = made(allowed=fault != "option")
    robot.age_s = 0.6 if fault == "stale" else 0.0
    one.go(COMMAND)
    threading.Event().wait(3 * drive.TICK_S)
    robot.nav2.end(drive.ABORTED)  # comes back over the same connection, after what was sent before
    assert robot.nav2.asked == robot.nav2.cancels == [] and one.words()
    assert GOAL not in {topic for topic, _ in robot.server.received}


def test_refused_given_up_and_unanswered_goals_end_the_ride_in_words(made, monkeypatch):
    robot, one = made(obeys=False)
    robot.nav2.accepts = False
    one.go(COMMAND)
    until(lambda: one.words() == "Stopped: Nav2 refuses the goal.")
    robot.nav2.accepts = True
    one.go(COMMAND)
    until(lambda: robot.nav2.going)
    robot.nav2.end(drive.ABORTED)
    until(lambda: one.words() == "Stopped: Nav2 has given up (error 9000: no way there).")
    assert robot.nav2.cancels == []
    monkeypatch.setattr(drive, "ANSWER_S", 0.1)
    robot.nav2.answers.clear()
    one.go(COMMAND)
    until(lambda: one.words().startswith("Stopped: Nav2 does not answer."))
    robot.nav2.answers.set()
    until(lambda: robot.nav2.cancels == robot.nav2.asked[2:])


def test_a_robot_that_refuses_to_cancel_is_named(made):
    robot, one = made(obeys=False)
    robot.nav2.cancelable = False
    one.go(COMMAND)
    until(lambda: robot.nav2.going)
    one.stop()
    until(lambda: "refuses to cancel" in one.words())
    assert len(robot.nav2.cancels) == 1


@pytest.mark.parametrize("form", ["none", "other"])
def test_a_robot_without_the_action_as_it_is_known_gets_poses(made, form, monkeypatch):
    if form == "other":
        monkeypatch.setitem(HASHES, drive.SEND, (drive.SEND_TYPE, "RIHS01_" + "0" * 64))
    robot, one = made(action=form == "other")
    one.go(COMMAND)
    until(lambda: GOAL in {topic for topic, _ in robot.server.received})
    assert form == "none" or robot.nav2.asked == []


def test_feedback_tells_of_recoveries(made):
    robot, one = made(obeys=False)
    one.go(COMMAND)
    until(lambda: robot.nav2.going)
    for frame in ("map", "odom", "a/longer/name"):
        robot.nav2.feed_back(frame, len(frame))
        until(lambda frame=frame: f"free itself {len(frame)} times" in one.words())


CANCEL = ("action_msgs/srv/CancelGoal", "action_msgs/GoalInfo goal_info",
          "int8 return_code\naction_msgs/GoalInfo[] goals_canceling")  # fmt: skip
ADD = "example_interfaces/srv/AddTwoInts", "int64 a\nint64 b", "int64 sum"
FIBONACCI = "example_interfaces/action/Fibonacci", "int32 order", "int32[] sequence", "int32[] sequence"
GOAL_TEXT = "geometry_msgs/PoseStamped pose\nstring behavior_tree"
FEEDBACK_TEXT = (
    "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
    "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\nfloat32 distance_remaining"
)
RESULT_TEXT = "uint16 error_code\nstring error_msg"


def test_hashes_are_those_of_the_definitions():
    types, hashes = Definitions(), {name: hashed for name, (_, hashed) in HASHES.items()}
    assert types.service(*ADD).startswith("RIHS01_e118de6b")  # as ROS publishes them
    assert [one[7:15] for one in types.action(*FIBONACCI)] == ["d1a57fb2", "1b0de0d5", "c1de71af"]
    assert types.service(*CANCEL) == hashes[drive.CANCEL]
    assert message_types().hash_rihs01(drive.STATUS_TYPE) == hashes[drive.STATUS]
    found = types.action("nav2_msgs/action/NavigateToPose", GOAL_TEXT, RESULT_TEXT, FEEDBACK_TEXT)
    assert found == tuple(hashes[one] for one in (drive.SEND, drive.RESULT, drive.FEEDBACK))
    older = types.action("nav2_msgs/action/NavigateToPose", GOAL_TEXT, "std_msgs/Empty result", FEEDBACK_TEXT)
    assert older[0] == found[0] and older[1] != found[1]


def test_services_are_told_by_their_tokens():
    token = (
        "@ros2_lv/0/a1/1/40/SS/%/%/bt_navigator/%navigate_to_pose%_action%send_goal/"
        "nav2_msgs::action::dds_::NavigateToPose_SendGoal_/RIHS01_a4/::,10:,:,:,,"
    )
    assert service_of(token) == (drive.SEND, drive.SEND_TYPE, "RIHS01_a4")
    assert service_of(token.replace("/SS/", "/SC/")) is None and service_of("@ros2_lv/0/a1/0/0/NN/%/%/x") is None


@pytest.mark.parametrize(
    "body,words",
    [
        (struct.pack("<bB", 6, 0), ""),
        (struct.pack("<bxH", 6, 9001), " (error 9001)"),
        (struct.pack("<bxHI", 6, 9002, 8) + b"no pose\0", " (error 9002: no pose)"),
        (struct.pack("<bxHI", 6, 9002, 2**31) + b"no\n\x1b\xff", " (error 9002: no\ufffd)"),
        (b"", ""),
    ],
)  # fmt: skip
def test_results_of_every_version_are_read(body, words):
    assert error_of(b"\0\1\0\0" + body if body else b"") == words


def test_messages_that_cannot_be_read_change_nothing():
    class Link:
        services: dict[str, tuple[str, str]] = {}  # noqa: RUF012 - of this test alone
        takes: list[Any] = []  # noqa: RUF012 - as above

        def listen(self, topic, take):
            self.takes.append(take)

    link: Any = Link()
    one = Nav2(link)
    random = np.random.default_rng(0)
    for _ in range(300):
        data = random.integers(0, 256, int(random.integers(0, 120)), np.uint8).tobytes()
        for take in link.takes:
            take(data)
            take(b"\0\1\0\0" + data)
    assert one.ended() is None and one.recoveries == 0 and one.trouble == "" and not one.is_there
