"""The ride, the worker, the two scrubbers, the cameras. No browser."""

import threading
import time
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_maps import TOY_POSE, TOY_SPEC, toy_map
from viser import _messages
from waiting import until

from simaps_viz.language.grounding import Grounding
from simaps_viz.navigation.robot import Goal
from simaps_viz.navigation.trajectory import MOTION, TrajectoryPlayer, poses_along, trajectory
from simaps_viz.structures import Pose2
from simaps_viz.viewer.page.page import Worker
from simaps_viz.viewer.page.recording import ECHO_S, SETTLE_S, FrameLink
from simaps_viz.viewer.panels.command import (
    candidate_labels,
    examples,
    goal_labels,
    message_html,
    open_floor,
    program_html,
)
from simaps_viz.viewer.scene.camera import INSIST_S, PANEL_WIDTH_PX, RIM_PX, SEES_M, Viewpoints, slanted_view, top_view

coordinate = st.floats(-20.0, 20.0)
pose_rows = st.lists(st.tuples(coordinate, coordinate, st.floats(-3.1, 3.1)), min_size=1, max_size=12)


@given(pose_rows, st.floats(0.0, 1.0))
def test_a_ride_passes_every_pose_and_never_hurries(rows, share):
    ride = trajectory(rows)
    for row, at in zip(ride.poses, ride.times_s, strict=True):
        pose = ride.at(at + 1e-9)
        assert (pose.x_m, pose.y_m) == pytest.approx(tuple(row[:2]), abs=1e-6)
    a, b = ride.at(share * ride.duration_s), ride.at(share * ride.duration_s + 0.01)
    assert np.hypot(b.x_m - a.x_m, b.y_m - a.y_m) <= MOTION.speed_mps * 0.01 + 1e-6
    turn = abs((b.yaw_rad - a.yaw_rad + np.pi) % (2 * np.pi) - np.pi)
    assert turn <= MOTION.turn_rate_rps * 0.01 + 1e-6


def test_a_path_is_driven_forwards_and_ends_as_it_should():
    poses = poses_along(Pose2(0, 0, 0), [[0, 0], [0, 2], [3, 2]], Pose2(3, 2, 1.0))
    moving = np.hypot(*np.diff(poses[:, :2], axis=0).T) > 0
    direction = np.arctan2(*np.diff(poses[:, :2], axis=0).T[::-1])
    assert poses[1:, 2][moving] == pytest.approx(direction[moving])
    assert tuple(poses[-1]) == (3.0, 2.0, 1.0)
    assert trajectory(poses).duration_s == pytest.approx(
        5.0 / MOTION.speed_mps + (np.pi / 2 + np.pi / 2 + 1.0) / MOTION.turn_rate_rps, rel=1e-6
    )


def test_drive_plays_pauses_and_arrives():
    seen, arrived = [], threading.Event()
    drive = TrajectoryPlayer(lambda pose, share, leg: seen.append(pose.x_m), arrived.set)
    drive.start(trajectory([[0, 0, 0], [600.0 * MOTION.speed_mps, 0, 0]]))
    drive.pause(True)
    until(lambda: seen)
    held = len(seen)
    time.sleep(0.15)
    assert drive.paused and len(seen) == held
    drive.pause(False)
    until(lambda: len(seen) > held)
    drive.speed = 1e6
    assert arrived.wait(60.0) and not drive.active
    assert seen[-1] == pytest.approx(600.0 * MOTION.speed_mps) and seen == sorted(seen)


def test_a_stopped_drive_does_not_arrive():
    arrived = threading.Event()
    drive = TrajectoryPlayer(lambda pose, share, leg: None, arrived.set)
    drive.start(trajectory([[0, 0, 0], [0.1 * MOTION.speed_mps, 0, 0]]))
    assert arrived.wait(60.0)  # left alone, it does
    arrived.clear()
    others = set(threading.enumerate())
    drive.start(trajectory([[0, 0, 0], [600.0 * MOTION.speed_mps, 0, 0]]))
    (plays,) = (one for one in set(threading.enumerate()) - others if one.name == "workbench-drive")
    drive.stop()
    plays.join(60.0)
    assert not plays.is_alive() and not drive.active and not arrived.is_set()


def test_worker_runs_only_the_latest_of_a_name_and_survives_errors():
    errors, done = [], []
    worker = Worker(errors.append)
    began, gate = threading.Event(), threading.Event()

    def wait_at_gate() -> None:
        began.set()
        gate.wait(60.0)

    worker.submit("block", wait_at_gate)
    assert began.wait(60.0)
    for k in range(20):
        worker.submit("k", lambda k=k: done.append(k))
    worker.submit("bad", lambda: done.append(1 // 0))
    worker.submit("after", lambda: done.append("after"))
    gate.set()
    assert worker.wait_idle()
    assert done == [19, "after"] and [type(e) for e in errors] == [ZeroDivisionError]
    worker.stop()


def test_scrubbers_do_not_chase_one_another():
    now = [0.0]
    sent: list[int] = []
    link = FrameLink(sent.append, clock=lambda: now[0])
    link.push(7)
    assert not link.accept(7, current=9)  # an echo that comes late
    assert link.accept(3, current=9)
    assert not link.accept(9, current=9)
    now[0] += ECHO_S + 0.1
    assert link.accept(7, current=9)
    assert sent == [7]


def test_an_opened_recording_is_brought_to_the_page():
    now = [0.0]
    sent: list[int] = []
    link = FrameLink(sent.append, clock=lambda: now[0])
    link.opened(4)
    assert not link.accept(0, current=4)  # the recording's own choice
    assert sent == [4, 4]
    now[0] += SETTLE_S + 0.1
    assert link.accept(0, current=4)
    link.opened(4)
    assert link.accept(2, current=4)  # a person's choice, who may then go to the first frame too
    assert link.accept(0, current=2)
    assert sent == [4, 4, 4]


@given(st.floats(0.5, 600.0), st.floats(0.5, 600.0), st.floats(0.3, 3.0))
def test_every_corner_of_the_floor_is_within_the_cameras_sight(width, height, aspect):
    for view in (top_view((0.0, 0.0, width, height), aspect), slanted_view((0.0, 0.0, width, height), aspect)):
        corners = np.array([(x, y, 0.0) for x in (0.0, width) for y in (0.0, height)])
        forward = np.subtract(view.look_at, view.position)
        depth = (corners - view.position) @ (forward / np.linalg.norm(forward))
        assert (depth < view.far_m).all()
        assert view.far_m >= SEES_M  # a page that zooms out keeps seeing what viser's own camera sees


@given(st.floats(0.5, 600.0), st.floats(0.5, 600.0), st.floats(0.3, 3.0))
def test_top_view_just_fits_the_extent(width, height, aspect):
    extent = (-1.0, 2.0, -1.0 + width, 2.0 + height)
    view = top_view(extent, aspect)
    half = np.tan(view.fov_rad / 2.0) * view.position[2]
    assert half >= height / 2 - 1e-9 and half * aspect >= width / 2 - 1e-9
    assert min(half - height / 2, half * aspect - width / 2) == pytest.approx(0.0, abs=1e-6)
    assert view.look_at[:2] == pytest.approx((-1.0 + width / 2, 2.0 + height / 2))
    slant = slanted_view(extent, aspect)
    assert slant.position[1] < slant.look_at[1] and slant.position[2] > 0


def test_the_robot_starts_on_open_floor():
    simap = toy_map()
    pose = open_floor(simap)
    row, col = TOY_SPEC.cell_of(pose.x_m, pose.y_m)
    block = np.s_[row - 10 : row + 11, col - 10 : col + 11]
    assert (simap.instance[block] == 0).all() and (simap.grid.height_m[block] < 0.1).all()


def test_goals_are_numbered_on_their_objects():
    simap = toy_map()
    goals = [Goal("move_to", None, number, (0.0, 0.0)) for number in (3, None, 1, 3)]
    first, second = goal_labels(simap, goals)
    assert (first.text, second.text) == ("1, 4 · chair 3", "3 · chair 1")
    assert (first.x, first.y) == pytest.approx(simap.by_id(3).centroid_m[:2])
    assert (second.x, second.y) == pytest.approx(simap.by_id(1).centroid_m[:2])


def test_candidates_are_numbered_with_the_chosen_one_marked():
    simap = toy_map()
    candidates = Grounding(simap, TOY_POSE).candidates("chair")

    def numbers(chosen: set[int], most: int = 5) -> list[str]:
        return [label.text.split(" · ")[0] for label in candidate_labels(candidates, chosen, most)]

    assert numbers({4}) == ["▶ 3", "1", "2"]
    assert numbers({4}, most=1) == ["▶ 3", "1"]
    assert numbers({candidates[0].instance.id}) == ["▶ 1"], "those farther than the goal are of no use"
    assert numbers(set()) == ["1", "2", "3"]
    chosen, first, _ = candidate_labels(candidates, {4})
    assert chosen.text == "▶ 3 · chair 4 · 3.3 m away" and first.text == "1 · chair 3"
    assert candidate_labels(candidates, {4}, away="from the couch")[0].text == "▶ 3 · chair 4 · 3.3 m from the couch"
    box = simap.by_id(4).aabb_m
    assert (chosen.x - chosen.reach_x, chosen.y + chosen.reach_y) == pytest.approx((box[0][0], box[1][1]))


def test_examples_speak_of_this_map_and_html_is_escaped():
    assert examples(toy_map()) == [
        "go to the third chair from here",
        "go to the dining table",
        "go to the chair nearest the dining table",
    ]
    unsure = [replace(one, score=0.3) if one.label == "dining table" else one for one in toy_map().instances]
    assert not any("dining table" in one for one in examples(replace(toy_map(), instances=tuple(unsure)), 5))
    assert examples(toy_map(), 5)[3:] == ["move in between the dining table and the couch", "face the potted plant"]
    assert "<script>" not in message_html("a", "<script>", "bad")
    html = program_html("a = 1\nb = '<'\n", line=2)
    assert "&lt;" in html and html.count("background:light-dark(#fff1b8") == 1


class ForgetfulCamera:
    """A page's camera, which reports what it is given, or what it was given before."""

    def __init__(self):
        self.position, self.look_at, self.up_direction, self.wxyz = (
            (0.0, 0.0, 1.0),
            (0.0,) * 3,
            (0.0, 0.0, 1.0),
            (1.0, 0, 0, 0),
        )
        self.fov, self.far, self.aspect = 0.5, 1000.0, 1.6
        self.image_width, self.image_height = 1600 + PANEL_WIDTH_PX + RIM_PX, 1000  # of the page, before it is laid out
        self.told = lambda _: None

    def on_update(self, told):
        self.told = told


def test_what_is_out_of_sight_brings_the_whole_map_back():
    camera = ForgetfulCamera()
    link = SimpleNamespace(queue_message=lambda message: None)
    client = SimpleNamespace(camera=camera, atomic=nullcontext, _websock_connection=link)
    viewpoints = Viewpoints(client, (0.0, 0.0, 20.0, 10.0))  # type: ignore[arg-type]
    whole = camera.position
    viewpoints.look_at((2.0, 2.0, 4.0, 4.0))
    near = camera.position
    viewpoints.bring_in((2.5, 2.5, 3.5, 3.5))
    assert camera.position == near != whole
    viewpoints.bring_in((2.5, 2.5, 15.0, 3.5))
    assert np.allclose(camera.position[:2], whole[:2], atol=0.5) and camera.position[2] > near[2]


def test_a_page_that_forgot_how_wide_its_camera_opens_is_told_again():
    camera = ForgetfulCamera()
    sent = []
    client = SimpleNamespace(
        camera=camera, atomic=nullcontext, _websock_connection=SimpleNamespace(queue_message=sent.append)
    )
    extent = (0.0, 0.0, 450.0, 25.0)  # the camera stands as far away as it may: only its angle tells views apart
    Viewpoints(client, extent)  # type: ignore[arg-type]
    wide = camera.fov
    camera.aspect = 1.17
    camera.told(None)
    wider = camera.fov
    assert wider > wide * 1.2
    assert all(message.initial for message in sent), "a page begins there, too, when it is set up anew"
    assert [m.fov for m in sent if isinstance(m, _messages.SetCameraFovMessage)] == [wide, wider]
    camera.fov = wide
    camera.told(None)
    assert camera.fov == wider


def test_while_the_panels_are_being_docked_the_map_is_not_fitted_anew():
    camera = ForgetfulCamera()
    link = SimpleNamespace(queue_message=lambda message: None)
    client = SimpleNamespace(camera=camera, atomic=nullcontext, _websock_connection=link)
    viewpoints = Viewpoints(client, (0.0, 0.0, 20.0, 10.0))  # type: ignore[arg-type]
    docked = camera.position
    for camera.aspect in (2.044, 1.9, 1.62, 1.6):  # the canvas gets narrower
        camera.told(None)
        assert camera.position == docked
    viewpoints._begun_s -= INSIST_S
    camera.aspect = 1.62  # later on a panel is made narrower by hand
    camera.told(None)
    assert camera.position != docked


def test_a_page_that_begins_docked_is_fitted_to_once_its_size_is_known():
    camera = ForgetfulCamera()
    link = SimpleNamespace(queue_message=lambda message: None)
    client = SimpleNamespace(camera=camera, atomic=nullcontext, _websock_connection=link)
    page_px = camera.image_width, camera.image_height
    Viewpoints(client, (0.0, 0.0, 20.0, 10.0))  # type: ignore[arg-type]
    docked = camera.position
    camera.image_width -= PANEL_WIDTH_PX + RIM_PX  # a slow page says where its camera is after it is laid out
    viewpoints = Viewpoints(client, (0.0, 0.0, 20.0, 10.0))  # type: ignore[arg-type]
    assert camera.position[2] > 1.2 * docked[2], "it was taken for a whole page"
    viewpoints.settle(*page_px)
    assert camera.position == docked
    viewpoints.look_at((2.0, 2.0, 4.0, 4.0))
    near = camera.position
    viewpoints.settle(900, 900)
    assert camera.position == near, "what a person looks at is left alone"
