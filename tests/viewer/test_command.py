"""The command panel without a browser: words, steps, labels, and a robot that is told things on a served page."""

import math
import re
import threading
import time
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from browser import free_port, mine, toy_answer, toy_services, toy_workbench
from chat_server import hangs, serving, writes
from fake_page import FakePage, fake_page, gone
from hypothesis import given
from hypothesis import strategies as st
from services import real_services
from toy_maps import TOY_POSE, furnished_map, toy_map
from waiting import until

from simaps_viz.app import workbench
from simaps_viz.language.commands import Reading
from simaps_viz.language.grounding import Grounding
from simaps_viz.language.llm_settings import Exchange, Message
from simaps_viz.navigation.agent import StepEvent, answer, outcome_text
from simaps_viz.navigation.robot import Goal
from simaps_viz.navigation.trajectory import (
    LOOK_S,
    MOTION,
    TICK_S,
    Trajectory,
    TrajectoryPlayer,
    trajectory,
    trajectory_of_steps,
)
from simaps_viz.structures import Pose2
from simaps_viz.viewer.panels.command import (
    MEANS,
    NEAREST,
    PAST,
    READING,
    WORKS,
    CommandPanel,
    anchors_text,
    beyond_text,
    by_other_anchors,
    each_why,
    entered,
    exchanges_html,
    in_asked_order,
    name_text,
    named_in,
    pose_of_sides,
    program_html,
    sides_text,
    stop_text,
    why_text,
)
from simaps_viz.viewer.panels.help import HelpPanel
from simaps_viz.viewer.panels.map import MapPanel
from simaps_viz.viewer.scene.camera import AHEAD_M, BEHIND_M, Follower, above, behind
from simaps_viz.viewer.scene.map_scene import Style
from simaps_viz.viewer.workbench import Workbench

# --- words


def why(command):
    simap = toy_map()
    said = answer(simap, command, TOY_POSE)
    assert said.status == "ok"
    return why_text(said, in_asked_order(said, Grounding(simap, TOY_POSE).candidates(str(said.goals[0].label))))


def test_why_this_one_is_said_with_the_distances_of_the_others():
    # From (0.5, 0.5) to the nearest cells' centres: chair 1 at (1.075, 1.725), chair 3 at (-0.025, -0.625),
    # chair 4 at (3.625, -0.425).
    one, two, three = np.hypot(0.575, 1.225), np.hypot(0.525, 1.125), np.hypot(3.125, 0.925)
    assert why("go to the third chair") == (
        f"Chair 4 is the farthest of 3 from where the command was given: {three:.2f} m in a straight line to its edge, "
        f"before which the path ends; chairs 3 and 1 are at {min(one, two):.2f} and {max(one, two):.2f} m."
    )
    assert why("go to the second chair") == (
        f"Chair 1 is the second closest to where the command was given: {max(one, two):.2f} m in a straight line to "
        f"its edge, before which the path ends; chair 3 is at {min(one, two):.2f} m."
    )
    assert why("go to the chair") == (
        f"Chair 3 is the closest to where the command was given: {min(one, two):.2f} m in a straight line to its edge, "
        f"before which the path ends; the next, chair 1, is at {max(one, two):.2f} m."
    )
    round_about = replace(answer(toy_map(), "go to the chair", TOY_POSE), path_length_m=9.0)
    assert "in a straight line to its edge; the next" in why_text(
        round_about, Grounding(toy_map(), TOY_POSE).candidates("chair")
    )
    assert why("go to the couch").startswith("Couch 5 is the only couch on this map, ")
    by_hand = why("robot.move_to_object(first(order(things('chair'), 'left')))")
    assert re.fullmatch(
        r"Chair 1 is the leftmost chair, of 3 chairs; it is [\d.]+ m from where the .* given\.", by_hand
    )
    assert why("robot.face(nearest(side(things('chair'), 'left')))") == (
        f"Chair 1 is the only chair on your left, {max(one, two):.2f} m from where the command was given."
    )
    assert why("go to the second chair from the south") == (
        f"Chair 4 is the second of 3 chairs, the southernmost first, {three:.2f} m from where the command was given."
    )
    cells = {one.name: np.argwhere(toy_map().instance == one.id) for one in toy_map().instances}
    apart = [np.hypot(*(cells[f"chair {i}"][:, None] - cells["couch 5"]).T).min() for i in (1, 4)]
    near, far = (toy_map().spec.cell_size_m * one for one in apart)  # what decides is not where the robot is
    assert why("go to the chair nearest the couch") == (
        f"Chair 1 is the chair nearest to the couch: {near:.2f} m from it; the next, chair 4, is at {far:.2f} m."
    )
    assert why("go to the second chair nearest the couch") == (
        f"Chair 4 is the second of 3 chairs nearest to the couch: {far:.2f} m from it; chair 1 is at {near:.2f} m."
    )
    assert (
        why("go to the chair south of the couch")
        == f"Chair 4 is the only chair south of the couch, {far:.2f} m from it."
    )
    assert why("go to the leftmost chair").startswith("Chair 1 is the leftmost chair, of 3 chairs; it is ")
    assert why("go to the second chair from the west near the dining table") == (
        f"Chair 4 is the second of 2 chairs next to the dining tables, the westernmost first, {three:.2f} m "
        "from where the command was given."
    )
    assert why("visit all chairs") == "All 3 chairs on this map are meant."
    assert why("visit all dining tables") == "Both dining tables on this map are meant."


def test_whose_left_is_meant_is_said_once():
    assert sides_text("To the second chair.", TOY_POSE) == ""
    of_it = sides_text("There are 8 chairs to the left of the refrigerator.", TOY_POSE)
    assert of_it == "Left: as seen from the robot, if it faced that thing."
    assert sides_text("There is a chair to the left of it, ahead on your left.", TOY_POSE) == (
        "Left, ahead: as seen from the robot, which looks east."
    )
    text = outcome_text(answer(toy_map(), "go to the left of the couch", TOY_POSE))
    assert text.count("as seen from the robot") == 1 and sides_text(text, TOY_POSE) == ""
    text = outcome_text(answer(toy_map(), "go to the chair left of the couch", TOY_POSE))
    assert text.startswith("There is no chair") and sides_text(text, TOY_POSE).startswith("Left: as seen")


def test_the_sides_are_those_after_the_turn_that_comes_before():
    for command, looks in (
        ("turn right 90 degrees then move forward 30 metres", "looks south by then"),
        ("move forward 30 metres", "looks east"),
        ("turn right 90 degrees then go to the leftmost chair", "looks south by then"),
        ("go to the leftmost chair then turn right 90 degrees", "looks east"),
    ):
        said = answer(toy_map(), command, TOY_POSE)
        text = sides_text(outcome_text(said), TOY_POSE, pose_of_sides(said))
        assert text.endswith(f"{looks}."), (command, said.reason, text)


def test_the_one_thing_that_an_answer_speaks_of_is_named():
    simap = toy_map()
    largest = answer(simap, "which chair is the biggest?", TOY_POSE)
    (one,) = (largest.answer or {})["instances"]
    assert name_text(simap, largest) == f"On the map it is {simap.by_id(one).name}."
    assert name_text(simap, answer(simap, "where are the chairs?", TOY_POSE)) == ""
    assert name_text(simap, answer(simap, "go to the couch", TOY_POSE)) == ""


def test_a_command_that_fails_after_its_first_line_says_that_nothing_was_done():
    with Workbench(toy_map(), services=real_services(), port=free_port(), start=TOY_POSE) as bench, fake_page(bench):
        panel = mine(bench).panels[CommandPanel]
        panel.ask("turn right 90 degrees then move forward 30 metres")
        until(lambda: "Failed" in shown(bench))
        assert "Nothing was done" in shown(bench) and "looks south by then" in shown(bench)
        panel.ask("move forward 30 metres")
        until(lambda: "looks east" in shown(bench))
        assert "Nothing was done" not in shown(bench)


def test_a_thing_that_is_meant_and_may_be_wrong_is_called_so():
    simap = toy_map()
    unsure = [replace(one, score=0.1, cells=3) if one.label == "couch" else one for one in simap.instances]
    simap = replace(simap, instances=tuple(unsure))
    with Workbench(simap, services=real_services(), port=free_port(), start=TOY_POSE) as bench, fake_page(bench):
        panel = mine(bench).panels[CommandPanel]
        panel._drive.speed = 8.0
        for command, doubtful in (("go to the couch", True), ("go to the plant", False)):
            panel.ask(command)
            until(lambda: "Done" in shown(bench))
            assert ("Couch 5 may be wrong: class unsure, 10 %." in shown(bench)) == doubtful


def test_two_things_of_one_class_are_called_by_their_names():
    tables = [one.name for one in toy_map().of_class("dining table")]
    assert len(tables) == 2
    said = outcome_text(answer(toy_map(), "move in between the dining table and the dining table", TOY_POSE))
    assert said.startswith("Between ") and all(name in said for name in tables)
    asked = answer(toy_map(), "what is between the dining table and the dining table?", TOY_POSE)
    assert all(name in outcome_text(asked) for name in tables)


def test_of_several_stops_those_far_from_what_they_are_about_are_said():
    simap = toy_map()
    couch, chair = simap.of_class("couch")[0], simap.of_class("chair")[0]
    said = answer(simap, "visit the couch, then the chair", TOY_POSE)
    assert len(said.goals) == 2 and beyond_text(simap, said) == ""
    x, y, _ = couch.centroid_m
    off = replace(said.goals[0], instance=couch.id, point_m=(x + 5.0, y))
    text = beyond_text(simap, replace(said, goals=(off, said.goals[1])))
    assert re.fullmatch(rf"It stops 4\.\d m from {couch.name}: nowhere nearer is there room for it\.", text)
    assert chair.name not in text


def test_a_stop_on_the_far_side_has_its_reason():
    things: list = [("counter", 1.5, 3.0, 4.5, 3.6, 1.0)]
    start = Pose2.from_heading(3.0, 1.0, 0.0)
    around = [("bench", 1.0, 2.5, 5.0, 2.95, 0.5), *(("cabinet", x, 2.95, x + 0.45, 3.6, 1.0) for x in (1.0, 4.55))]
    for more, beyond in (([], False), (around, True)):
        simap = furnished_map({"size_m": (6.0, 6.0), "walls": [], "things": things + more})
        said = answer(simap, "go to the counter", start)
        assert said.status == "ok" and (said.final_pose.y_m > 3.6) == beyond
        name = simap.of_class("counter")[0].name
        assert (
            beyond_text(simap, said).startswith(f"It stops on the far side of {name}, as seen from the start: nowhere")
            == beyond
        )
        assert beyond_text(simap, answer(simap, "go to the north side of the counter", start)) == ""  # as it was asked
    # From the west that stop is at its side, and from the north-east it is on the near one.
    for x_m, y_m, beyond in ((0.6, 3.2, False), (0.6, 1.0, True), (5.5, 5.0, False)):
        said = answer(simap, "go to the counter", Pose2(x_m, y_m, 0.0))
        assert said.final_pose.y_m > 3.6 and bool(beyond_text(simap, said)) == beyond, (x_m, y_m)
    said = answer(simap, "go to the counter", start)
    stray, stop = simap.instance.copy(), said.final_pose
    stray[simap.spec.cell_of(stop.x_m, stop.y_m + 0.6)] = said.goals[0].instance  # passed from the north, too
    north = replace(said, path_m=np.array([[stop.x_m, stop.y_m + 1.2], [stop.x_m, stop.y_m]]))
    assert beyond_text(replace(simap, instance=stray), north) == ""  # it stops on the side that it comes from


def test_a_stop_far_from_the_thing_has_its_reason():
    ring = [("cabinet", x, y, x + w, y + d, 1.0) for x, y, w, d in RING]
    for more, far in (([], False), (ring, True)):
        simap = furnished_map(
            {"size_m": (8.0, 8.0), "walls": [], "things": [("plant", 3.7, 3.7, 4.3, 4.3, 1.0), *more]}
        )
        said = answer(simap, "go to the plant", Pose2.from_heading(4.0, 1.0, 0.0))
        name = simap.of_class("plant")[0].name
        away_m = 3.7 - said.final_pose.y_m
        text = beyond_text(simap, said)
        assert said.status == "ok" and (away_m > 1.0) == far
        assert (abs(float(text.split()[2]) - away_m) < 0.1 and text.endswith("there room for it.")) if far else not text
        assert not far or name in text


RING = [(2.7, 2.7, 2.6, 0.4), (2.7, 4.9, 2.6, 0.4), (2.7, 3.1, 0.4, 1.8), (4.9, 3.1, 0.4, 1.8)]
"""West, south, width and depth of cabinets all around a plant."""


def test_it_is_said_how_far_from_the_thing_the_path_ends_and_where_the_robot_has_it_then():
    simap = furnished_map({"size_m": (6.0, 6.0), "walls": [], "things": [("couch", 2.6, 2.5, 3.4, 3.5, 0.7)]})
    couch, turn = simap.instances[0].name, 'then: add "and face it" to have it turn.'
    for x_m, heading, where in ((2.4, 90.0, ""), (2.4, 180.0, "on its left"), (2.4, 270.0, "behind it")):
        there = answer(simap, f"robot.move_to([{x_m}, 3.2])\nrobot.turn_absolute({heading})", Pose2(0.5, 3.0, 0.0))
        said = answer(simap, "go to the couch", Pose2(0.5, 3.0, 0.0))
        said = replace(said, final_pose=replace(said.final_pose, yaw_rad=there.final_pose.yaw_rad))
        text = stop_text(simap, said)
        assert re.match(rf"The path ends 0\.\d\d m from the edge of {couch}", text), text
        assert text.endswith(f", and the robot has that {where} {turn}" if where else f"{couch}."), text
    for command in (
        "go to the couch and face it",
        "face the couch",
        "go to the couch, then go back",
        "is there a couch?",
    ):
        assert stop_text(simap, answer(simap, command, Pose2(0.5, 3.0, 0.0))) == "", command


def test_other_things_are_offered_for_the_one_that_others_were_looked_for_by():
    simap = toy_map()
    find = lambda label, pose: Grounding(simap, pose).candidates(label)  # noqa: E731
    near, far = (one.instance for one in find("dining table", TOY_POSE))
    said = answer(simap, 'robot.move_to_object(nearest(things("chair"), 1, the(things("dining table"))))', TOY_POSE)
    others = by_other_anchors(said, find, TOY_POSE)
    assert said.anchors == (near.id,)
    assert others == [f'robot.move_to_object(nearest(things("chair"), 1, called(things("dining table"), {far.id})))']
    assert answer(simap, others[0], TOY_POSE).goals[0].instance != said.goals[0].instance
    for command in ("go to the chair", "go to the chair nearest the couch"):  # no other, or none to choose of
        assert by_other_anchors(answer(simap, command, TOY_POSE), find, TOY_POSE) == []


def test_a_doubtful_thing_gives_way_to_a_certain_one_and_is_offered():
    simap = toy_map()
    first, second = sorted(simap.of_class("chair"), key=Grounding(simap, TOY_POSE).distance_m)[:2]
    ones = [replace(one, frames=1 if one.id == first.id else 9) for one in simap.instances]
    known = replace(simap, instances=tuple(ones), frame_names=tuple(f"{i}" for i in range(200)))
    with Workbench(known, services=real_services(), port=free_port(), start=TOY_POSE) as bench, fake_page(bench):
        panel = mine(bench).panels[CommandPanel]
        panel._drive.speed = 8.0
        panel.ask("go to the chair")
        until(lambda: "Done" in shown(bench))
        assert f"{first.name.capitalize()} is nearer, but doubtful, seen in 1 frame of 200" in shown(bench)
        assert f"{second.name} is taken" in shown(bench) and NEAREST in shown(bench)
        assert shown(bench).count(MEANS) == 1
        until(lambda: [one.label for one in panel._suggested if one.visible] == [f"go to {first.name}"])
        panel._try_instead(0)
        until(lambda: "Done" in shown(bench) and NEAREST not in shown(bench))
        assert panel._answer is not None and panel._answer.goals[0].instance == first.id
        assert f"{first.name.capitalize()} is doubtful, seen in 1 frame of 200." in shown(bench)


def test_what_another_class_was_looked_up_by_is_not_taken_for_the_reason():
    program = 'robot.move_to_object("chair", robot.closest_to("chair", robot.closest_to("tv", "couch")))'
    said = toy_answer(program=program, goals=(Goal("move_to_object", "chair", 1, (0.0, 0.0)),))
    text = why_text(said, Grounding(toy_map(), TOY_POSE).candidates("chair"))
    assert "couch" not in text and "robot." not in text and text.endswith("It was chosen by the program below.")
    look_up = 'robot.closest_to("chair", "couch")'
    by_hand = f'robot.turn(90)\none = {look_up}\nrobot.face(one)\nrobot.move_to(pose("start"))\nrobot.face({look_up})'
    assert why(by_hand).endswith(" It was chosen by line 2 of the program below.")
    for by_name in (
        "go to the second chair and come back",
        'at = pose("start")\nrobot.face("chair")\nrobot.move_to(at)',
    ):
        assert why(by_name).endswith(" m.")


def test_outcome_text_names_both_things_it_goes_between():
    said = answer(toy_map(), "go between the dining table and the chair", TOY_POSE)
    assert said.status == "ok"
    assert outcome_text(said).startswith("Between the dining table and the chair, a path of ")
    refused = answer(toy_map(), "go to the piano", TOY_POSE)
    assert outcome_text(refused) == "There is no piano on this map."


def test_a_stop_beside_two_things_that_touch_has_its_reason():
    for gap_m, aside in ((0.0, True), (1.5, False)):
        left, right = ("counter", 1.0, 2.5, 2.5, 3.5, 1.0), ("cabinet", 2.5 + gap_m, 2.5, 4.0 + gap_m, 3.5, 1.0)
        simap = furnished_map({"size_m": (6.0, 6.0), "walls": [], "things": [left, right]})
        said = answer(simap, "go between the counter and the cabinet", Pose2.from_heading(3.0, 1.0, 0.0))
        assert said.status == "ok" and said.goals[0].primitive == "move_in_between"
        text = beyond_text(simap, said)
        assert text.endswith(": between them is no room for it.") if aside else text == ""


def test_what_a_reason_names_is_found():
    simap = toy_map()
    chair = simap.of_class("chair")[0]
    assert named_in(simap, f"the robot cannot get to {chair.name}: the nearest it can stand is 2 m off") == [chair.id]
    assert named_in(simap, f"{chair.name}0 and the chair") == []


def test_each_of_several_things_says_why_it_is_meant():
    simap = toy_map()

    def each(command, **most):
        said = answer(simap, command, TOY_POSE)
        return each_why(said, lambda label, pose: Grounding(simap, pose).candidates(label), TOY_POSE, **most), said

    (first,), _ = each("go between the couch and the chair")
    assert first.startswith("Chair 3 is the closest to where the command was given:") and "couch" not in first.lower()
    assert each("go between couch 5 and chair 1")[0] == []  # named, not chosen
    (first, then), said = each("go to the plant, then face the third chair, then face the chair")
    here = Pose2(*said.goals[0].point_m, 0.0)
    ranked = [one.instance.name for one in Grounding(simap, here).candidates("chair")]
    assert first.startswith(f"{ranked[2].capitalize()} is the farthest of 3 from where the robot is then:")
    assert then.startswith(f"{ranked[0].capitalize()} is the closest to where the robot is then:")
    assert each("go to the plant, then face the chair", most=1)[0] == []
    (both,), said = each("go between the two chairs")
    a, b = said.goals[0].instance, said.goals[0].other_instance
    assert both == f"This map has 3 chairs: {a} and {b}, the two closest to where the command was given, are meant."


def test_html_marks_one_line_and_escapes_what_models_write():
    html = program_html("a = 1\nb = 2\nc = 3\n", line=2)
    assert html.count("aria-current") == 1 and html.index("b = 2") > html.index("aria-current") > html.index("a = 1")
    assert "✖" in program_html("a = 1\n", line=1, stuck=True)
    exchange = Exchange((Message("user", "<script>"),), "<b>", 1.5, "no <answer>")
    html = exchanges_html([exchange])
    assert "<script>" not in html and "<b>" not in html and "<answer>" not in html and "1.5 s" in html


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ("go to the chair", None),
        ("go to the chair\n", "go to the chair"),
        ("go to\n the chair", "go to the chair"),  # Enter in the middle of the line
        ("\n", ""),
        ("robot.turn(90)\nrobot.turn(45)", None),
        ("for a in [1]:\n    robot.turn(45)\n", "for a in [1]:\n    robot.turn(45)"),
    ],
)
def test_enter_ends_a_command(text, command):
    assert entered(text) == command


# --- steps


def event(line, done, poses=()):
    return StepEvent(line, "", np.reshape(poses, (-1, 3)).astype(float), Pose2(0.0, 0.0, 0.0), None, done)


def test_every_statement_gets_its_line_and_look_ups_take_a_moment():
    drive = np.array([[0.0, 0.0, 0.0], [0.9, 0.0, 0.0]])
    further = np.array([[0.9, 0.0, 0.0], [1.8, 0.0, 0.0]])
    events = [
        event(1, False), event(1, True),
        event(2, False), event(3, False), event(3, True, drive), event(3, False), event(3, True, further),
        event(2, True),
    ]  # fmt: skip
    ride = trajectory_of_steps(events, Pose2(0.0, 0.0, 0.0))
    leg = 0.9 / MOTION.speed_mps
    assert ride.steps_s == pytest.approx([0.0, LOOK_S, 2 * LOOK_S, 2 * LOOK_S + leg])
    assert ride.duration_s == pytest.approx(2 * LOOK_S + 2 * leg)
    lines = [ride.lines[ride.segment_at(t)] for t in (0.0, LOOK_S + 0.01, 2 * LOOK_S + 0.01, 2 * LOOK_S + leg + 0.01)]
    assert lines == [1, 2, 3, 3]
    assert ride.at(ride.duration_s).x_m == 1.8
    assert ride.next_step(0.0) == pytest.approx(LOOK_S) and ride.next_step(ride.duration_s - 0.1) is None


def test_a_statement_that_fails_is_the_last_line_of_the_ride():
    events = [event(1, False), event(1, True, np.array([[0, 0, 0], [1.0, 0, 0]])), event(2, False)]
    ride = trajectory_of_steps(events, Pose2(0.0, 0.0, 0.0))
    assert ride.lines[-1] == 2 and ride.at(ride.duration_s).x_m == 1.0


@given(st.lists(st.tuples(st.integers(1, 9), st.integers(0, 3)), max_size=8))
def test_rides_of_real_programs_never_go_back_in_time(statements):
    events, x = [], 0.0
    for line, metres in statements:
        events += [event(line, False), event(line, True, np.array([[x, 0, 0], [x + metres, 0, 0]]))]
        x += metres
    ride = trajectory_of_steps(events, Pose2(0.0, 0.0, 0.0))
    assert (np.diff(ride.times_s) >= 0).all() and len(ride.steps_s) == len(statements)
    assert len(ride.lines) == len(ride.poses) == len(ride.times_s)
    assert ride.at(ride.duration_s).x_m == pytest.approx(x)


def test_steps_hold_exactly_where_statements_begin():
    seen, holds, ended = [], threading.Event(), threading.Event()
    drive = TrajectoryPlayer(lambda pose, share, leg: seen.append(pose.x_m), ended.set, holds.set)
    drive.speed = 8.0
    base = trajectory([[0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    drive.start(Trajectory(base.poses, base.times_s, base.times_s[:2]), paused=True)
    until(lambda: seen)
    time.sleep(0.2)
    assert drive.paused and set(seen) == {0.0}
    drive.step()
    assert holds.wait(60.0) and drive.paused and seen[-1] == pytest.approx(1.0) and max(seen) == pytest.approx(1.0)
    drive.step()
    assert ended.wait(60.0) and seen[-1] == 2.0 and not drive.active


def test_nothing_is_told_after_stop():
    """Not even what was being told when it was asked to stop: `stop` waits for that."""
    told, second = [], threading.Event()

    def slowly(pose: Pose2, share: float, leg: int) -> None:
        if told:
            second.set()
            time.sleep(TICK_S)
        told.append(share)

    drive = TrajectoryPlayer(slowly, lambda: told.append(-1.0))
    drive.start(trajectory([[0, 0, 0], [5.0, 0, 0]]))
    assert second.wait(60.0)
    drive.stop()
    count = len(told)
    assert count >= 2 and not drive.active
    time.sleep(4 * TICK_S)
    assert len(told) == count


# --- cameras


def test_cameras_look_at_the_robot():
    pose = Pose2(2.0, 3.0, np.pi / 2)
    assert above(pose).look_at == (2.0, 3.0, 0.0) and above(pose).position[2] > 10.0
    view = behind(pose, pose.yaw_rad)
    assert view.position[:2] == pytest.approx((2.0, 3.0 - BEHIND_M))
    assert view.look_at[:2] == pytest.approx((2.0, 3.0 + AHEAD_M))


def test_the_follower_lets_go_once():
    let_go = []

    client = SimpleNamespace(camera=SimpleNamespace(), atomic=nullcontext)
    follower = Follower(client, behind=lambda: False, let_go=lambda: let_go.append(1))  # pyright: ignore
    follower.switch(False, TOY_POSE)
    follower.switch(True, TOY_POSE)
    follower.see(TOY_POSE, rests=True)
    follower.switch(False, TOY_POSE)
    assert let_go == [1] and client.camera.look_at == (TOY_POSE.x_m, TOY_POSE.y_m, 0.0)


# --- a served page, nobody looking


def shown(bench):
    return mine(bench).panels[CommandPanel]._result.content


def test_a_program_that_gets_stuck_marks_the_line():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        mine(bench).panels[CommandPanel]._drive.speed = 8.0
        mine(bench).panels[CommandPanel].ask("robot.turn(90)\nrobot.move_forward(50)\n")
        until(lambda: "Failed" in shown(bench))
        assert re.search(r"<div>Line 2: ", shown(bench))  # a sentence begins with a capital letter
        assert "✖" in mine(bench).panels[CommandPanel]._program.content and "is free for" in shown(bench)
        assert mine(bench).pose == TOY_POSE, "what cannot be done is said before the first turn"
        until(lambda: [past.status for past in mine(bench).panels[CommandPanel]._past] == ["failed"])


def test_the_reason_stays_where_the_robot_comes_back_afterwards():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        mine(bench).panels[CommandPanel]._drive.speed = 8.0
        mine(bench).panels[CommandPanel].ask("go to the second chair and then back to the start")
        until(lambda: "Done" in shown(bench))
        assert "is the second closest to where the command was given" in shown(bench)


def test_the_doubtful_among_the_candidates_are_counted_apart_as_on_the_map():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        session, panel = mine(bench), mine(bench).panels[CommandPanel]
        panel._drive.speed = 8.0
        for least, said in ((0.0, False), (0.66, True)):
            session.panels[MapPanel]._least_score.value = least
            faint = len([one for one in bench.simap.of_class("chair") if one.score < least])
            panel.ask("go to the leftmost chair")
            until(lambda: "Done" in shown(bench))
            assert bench.wait_idle() and bool(faint) == said
            assert (f"Of these 3 chairs, {faint} " in shown(bench)) == said


def test_what_is_typed_while_an_earlier_map_is_shown_says_which_map_it_is_for():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        session, panel = mine(bench), mine(bench).panels[CommandPanel]
        session.show_frame(1)
        until(lambda: panel._hidden)
        panel._text.value = "go to the couch"
        panel._preview()
        assert PAST in shown(bench) and not panel._previews
        session.finish()
        until(lambda: not panel._hidden)
        panel._preview()
        assert PAST not in shown(bench) and panel._previews


def test_marks_of_an_answer_end_as_the_next_command_is_typed_and_as_another_thing_is_selected():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        session, panel = mine(bench), mine(bench).panels[CommandPanel]
        panel._drive.speed = 8.0

        def answered():
            panel.ask("go to the couch")
            until(lambda: "Done" in shown(bench))
            assert bench.wait_idle() and panel._lit and session.scene.texts["command"]

        answered()
        session.select(3)
        assert bench.wait_idle() and not panel._lit
        assert [one.text for one in session.scene.texts["command"] if "couch" in one.text] == []
        session.select(None)
        answered()
        session.select(3)
        panel._text.value = "go to the couch"
        panel._typed()  # before what it means is looked up
        panel._end_typing()
        assert session.selected is None and not panel._lit
        assert [one.text for one in session.scene.texts["command"] if "couch" in one.text] == []
        session.select(3)
        panel._send(paused=False)
        until(lambda: "Done" in shown(bench))
        assert session.selected is None


def test_escape_takes_the_path_of_a_drive_that_is_over_off_the_map():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        session, panel = mine(bench), mine(bench).panels[CommandPanel]
        for command in ("go to the couch", "move forward 0.3 meters"):
            panel.reset()
            panel._drive.speed = 0.02
            panel.ask(command)
            until(lambda: panel.driving)
            session.panels[HelpPanel]._escape()
            assert session.wait_idle() and drawn(session)[0]  # on its way
            panel._drive.speed = 8.0
            until(lambda: "Done" in shown(bench))
            session.select(3)
            assert session.wait_idle() and drawn(session)[0]
            session.panels[HelpPanel]._escape()
            assert session.wait_idle() and drawn(session) == (False, []) and not panel._lit


def test_what_others_are_looked_for_by_is_named_outlined_and_called_doubtful():
    simap = toy_map()
    table, sofa = (simap.of_class(label)[0] for label in ("dining table", "couch"))
    text = f"The dining table that is meant is {table.name}"
    by_table = answer(simap, "go to the chair closest to the dining table", TOY_POSE)
    assert anchors_text(simap, by_table, ()) == [f"{text}."]
    assert anchors_text(simap, by_table, {table.id}) == [f"{text}, which is doubtful."]
    by_sofa = answer(simap, 'robot.face(nearest(things("chair"), 1, nearest(things("couch"))))', TOY_POSE)
    assert by_sofa.anchors == (sofa.id,) and anchors_text(simap, by_sofa, ()) == []  # there is but one
    assert anchors_text(simap, by_sofa, {sofa.id}) == [f"The couch that is meant is {sofa.name}, which is doubtful."]
    with toy_workbench(real_services()) as bench, fake_page(bench):
        session, panel = mine(bench), mine(bench).panels[CommandPanel]
        panel._drive.speed = 8.0
        for command, others in (
            ("go to the chair closest to the dining table", {1}),
            ("how many chairs are next to the dining table?", {1}),
            ("is there a chair on the dining table?", set()),
        ):
            panel._text.value = command
            panel._preview()
            for sent in (False, True):
                if sent:
                    panel.ask(command)
                    until(lambda: any(end in shown(bench) for end in ("Done", "Answer")))
                assert session.wait_idle() and text in shown(bench), (command, sent)
                assert panel._lit == {table.id, *others} and table.name in drawn(session)[1]


def test_another_reading_is_told_in_words():
    others = [""]

    def read(text, counts):
        return Reading('robot.move_to_object("couch")', (), tuple(others))

    services = replace(real_services(), ask=lambda *asked, robot: answer(*asked, reader=read, robot=robot))
    with toy_workbench(services) as bench, fake_page(bench):
        panel = mine(bench).panels[CommandPanel]
        panel._drive.speed = 8.0
        for others[0], words in (
            ('robot.move_to_object("potted plant")', r"To the potted plant, a path of .* That is potted plant 9\."),
            ('robot.move_to_object("piano")', ""),  # what cannot be done is not offered
            ('robot.move_to_object("couch", 1)', ""),  # nor what comes to the same
        ):
            for sent in (False, True):  # before it is sent, too
                panel._text.value = "there"
                if sent:
                    panel.ask("there")
                    until(lambda: "Done" in shown(bench))
                else:
                    panel._preview()
                assert re.search(words, panel._other_program.content) and panel._other.visible == bool(words), sent
            assert "line 1" not in panel._other_program.content
            panel.reset()
            assert not panel._other.visible
        others[0] = 'robot.move_to_object("potted plant")'
        panel._preview()
        panel.run_other_reading()
        until(lambda: "Done" in shown(bench))
        assert panel._answer is not None and panel._answer.goals[0].instance == 9 and panel._other.visible


def test_go_waits_for_the_keys_that_the_browser_still_holds_back(monkeypatch):
    with toy_workbench(real_services()) as bench, fake_page(bench):
        panel = mine(bench).panels[CommandPanel]
        panel._text.value, panel._typed_at = "go to the couch 9", math.inf  # just now, however slow the machine is
        arrives = SimpleNamespace(
            monotonic=time.monotonic, sleep=lambda _: setattr(panel._text, "value", "turn around")
        )
        monkeypatch.setattr("simaps_viz.viewer.panels.command.time", arrives)
        panel._pressed("Go")
        until(lambda: "Done" in shown(bench))
        assert [past.command for past in panel._past] == ["turn around"]


def test_a_hanging_model_holds_nothing_up_and_stop_ends_the_wait():
    with serving(hangs) as server:
        model = workbench.language_model(f"m@{server.url}")
        with toy_workbench(real_services(model=model)) as bench, fake_page(bench):
            mine(bench).panels[CommandPanel].ask("go to the couch")
            assert server.arrived.wait(60.0)
            assert "Working on it" in shown(bench)
            mine(bench).select(3)
            assert mine(bench).worker.wait_idle()  # the map still answers
            mine(bench).panels[CommandPanel].stop()
            assert "Stopped" in shown(bench) and server.left.wait(60.0)
            assert bench.wait_idle()
            assert "Stopped" in shown(bench) and mine(bench).pose == TOY_POSE
            assert "cancelled" in mine(bench).panels[CommandPanel]._exchanges.content


def test_what_a_model_was_sent_is_shown_and_off_means_off():
    with serving(writes('robot.move_to_object("couch")')) as server:
        model = workbench.language_model(f"m@{server.url}")
        with toy_workbench(real_services(model=model)) as bench, fake_page(bench):
            mine(bench).panels[CommandPanel]._drive.speed = 8.0
            mine(bench).panels[CommandPanel].ask("va au canapé")
            until(lambda: "Done" in shown(bench))
            assert "by m" in shown(bench) and mine(bench).panels[CommandPanel]._conversation.visible
            text = mine(bench).panels[CommandPanel]._exchanges.content
            assert "va au canapé" in text and "couch\\&quot;)&quot;, &quot;refusal&quot;: null" in text
            mine(bench).panels[CommandPanel]._model.value = False
            mine(bench).panels[CommandPanel].ask("turn left")
            until(lambda: "Done" in shown(bench))
            assert len(server.received) == 1 and not mine(bench).panels[CommandPanel]._conversation.visible


def test_the_grammar_reads_when_the_server_is_gone():
    with serving(writes("robot.turn(1)")) as server:
        address = server.url
    model = workbench.language_model(f"m@{address}")
    told = []
    assert model is not None
    said = model.ask(toy_map(), "go to the couch", TOY_POSE, threading.Event(), told.append)
    assert said.status == "ok" and said.notes[0].startswith("read offline: ") and told[0][0].error


def test_what_can_be_said_instead_of_a_refused_command_is_offered_until_the_next_one():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        panel = mine(bench).panels[CommandPanel]
        offered = lambda: [one.label for one in panel._suggested if one.visible]  # noqa: E731
        for command in ("sing me a song", "go to the piano"):
            panel.ask(command)
            until(lambda: "Refused" in shown(bench))
            assert mine(bench).wait_idle() and 0 < len(offered()) <= 3 and "Try:" not in shown(bench)
            assert panel._examples.visible and WORKS in shown(bench)  # which may have nothing to do with what was meant
            assert [answer(bench.simap, one, TOY_POSE).status for one in panel._instead] == ["ok"] * len(offered())
        panel._drive.speed = 8.0
        panel._try_instead(0)
        until(lambda: "Done" in shown(bench))
        assert panel._past[0].status == "ok" and offered() == [] and WORKS not in shown(bench)


def test_commands_on_top_of_each_other_leave_the_last_one():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        mine(bench).panels[CommandPanel]._drive.speed = 8.0
        for n in range(12):
            mine(bench).panels[CommandPanel].ask("turn left" if n % 2 else "go to the couch")
        mine(bench).panels[CommandPanel].ask("robot.turn_absolute(180)")
        until(lambda: "Done" in shown(bench) and mine(bench).pose.heading_deg == pytest.approx(180.0))
        assert (
            mine(bench).panels[CommandPanel]._past[0].command == "robot.turn_absolute(180)"
            and len(mine(bench).panels[CommandPanel]._past) == 3
        )


def test_an_answer_is_shown_in_words_and_on_the_map_and_the_robot_stays():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        page, panel = mine(bench), mine(bench).panels[CommandPanel]
        panel.ask("tell(things('chair'), 'count')")
        until(lambda: "There are 3 chairs on this map." in shown(bench))
        assert "Answer" in shown(bench) and page.pose == TOY_POSE and not panel.driving
        chairs = frozenset({1, 3, 4})
        assert panel.style(page.simap, Style()).lit == chairs
        assert panel.style(page.simap, Style(lit=frozenset({5}))).lit == chairs | {5}
        panel.ask("robot.turn(90)")
        until(lambda: "Done" in shown(bench))
        assert panel.style(page.simap, Style()).lit is None


def test_the_plain_service_still_works_without_steps():
    with toy_workbench(toy_services()) as bench, fake_page(bench):
        mine(bench).panels[CommandPanel]._drive.speed = 8.0
        mine(bench).panels[CommandPanel].ask("go to the chair")
        until(lambda: "Done" in shown(bench))
        assert mine(bench).pose.x_m == pytest.approx(1.5)


def test_what_a_typed_command_would_mean_is_marked_and_nothing_runs(monkeypatch):
    asked, read = [], threading.Event()

    def ask(simap, command, pose, robot):
        asked.append((threading.current_thread().name, command))
        assert command != "go to the second chair" or read.wait(60.0)
        return answer(simap, command, pose, robot=robot)

    with toy_workbench(replace(real_services(), ask=ask)) as bench, fake_page(bench):
        page, panel = mine(bench), mine(bench).panels[CommandPanel]
        assert page.wait_idle() and len(asked) == 1  # reading and planning are prepared
        monkeypatch.setattr("simaps_viz.viewer.panels.command.PREVIEW_S", 0.05)

        def types(text):
            panel._text.value = text
            panel._typed()
            until(lambda: panel._typing is None or not panel._typing.is_alive())
            assert page.wait_idle()

        def marked():
            return [one.text for one in page.scene.texts["command"] if one.text], panel.style(page.simap, Style()).lit

        for text in ("g", "go to", "go to the third"):
            panel._text.value = text
            panel._typed()
        types("go to the third chair")
        assert asked[1:] == [("workbench-worker", "go to the third chair")]  # after a pause, and not where keys arrive
        labels, lit = marked()
        assert lit == {4} and labels[0].startswith("▶ 3 · chair 4") and len(labels) == 4
        assert labels[-1] == "stops here" and len(panel._marks.path_m) > 1  # where the robot would stop
        assert page.pose == TOY_POSE and not panel.driving and not panel._past and "Go does this" in shown(bench)
        types("go to the third chai and")
        assert marked() == ([], None) and "Go cannot do this" in shown(bench)
        page.robot, slim = replace(page.robot, radius_m=0.5), page.robot
        types("go to the plant")  # which it cannot reach
        plant = page.simap.of_class("potted plant")[0]
        assert "Go cannot do this" in shown(bench) and marked() == ([plant.name], {plant.id})
        page.robot = slim
        types("go to the couch")
        assert marked()[1] == {5}
        panel.told({"type": "tabs", "open": ["Errors"]})
        assert marked() == ([], None)  # it is about something else there
        panel.told({"type": "tabs", "open": ["Command"]})
        assert page.wait_idle() and marked()[1] == {5}
        types("")
        assert marked() == ([], None)
        types("go to the couch")
        panel._drive.speed = 0.02
        panel.ask("go to the second chair")
        assert marked() == ([], None)  # at once, before the command is read
        read.set()
        until(lambda: panel.driving)
        types("go to the third chair")  # the robot is on its way to another
        assert marked()[1] == {4} and panel._run.options == ("Go", "Pause", "Stop")
        assert "Go ends this drive, and does this" in shown(bench) and not panel._program.visible
        types("")
        assert marked()[1] == {1} and "On the way" in shown(bench) and panel._program.visible
        assert panel._run.options == ("Pause", "Step", "Stop")
        types("go to the third chair")
        panel._drive.speed = 8.0
        until(lambda: not panel.driving and "Go does this" in shown(bench))  # not what came of the old one
        assert marked()[1] == {4} and statuses(bench)["go to the second chair"] == "ok"


def test_while_what_is_typed_is_read_the_page_says_so_each_time(monkeypatch):
    read = threading.Event()

    def ask(simap, command, pose, robot):
        assert read.wait(60.0)
        return answer(simap, command, pose, robot=robot)

    with toy_workbench(replace(real_services(), ask=ask)) as bench, fake_page(bench):
        page, panel = mine(bench), mine(bench).panels[CommandPanel]
        monkeypatch.setattr("simaps_viz.viewer.panels.command.PREVIEW_S", 0.05)
        seen = lambda: shown(bench).rpartition('<div style="position:absolute;inset:0">')[2]  # noqa: E731
        for text in ("go to the couch", "go to the third chair", "go to the piano", "go to the couch"):
            read.clear()
            panel._text.value = text
            panel._typed()
            assert READING in seen() and "Go " not in seen()  # nothing of the command before
            read.set()
            until(lambda: "Go does this" in seen() or "Go cannot do this" in seen())
            assert page.wait_idle() and READING not in shown(bench)


def test_step_says_which_line_it_runs_from_the_first_press_on():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        panel = mine(bench).panels[CommandPanel]
        panel._drive.speed = 8.0
        panel.ask("turn right, then go to the couch", paused=True)
        until(lambda: "Step runs line 1 of 2: robot.turn(90)" in shown(bench))
        assert "Paused" in shown(bench) and mine(bench).pose == TOY_POSE
        panel.step()
        until(lambda: "Step runs line 2 of 2: robot.move_to_object(&quot;couch&quot;)" in shown(bench))
        until(lambda: panel._drive.paused)
        assert "Step runs line 1" not in shown(bench)
        panel.pause()
        until(lambda: "Done" in shown(bench))
        assert "Step runs" not in shown(bench)


def statuses(bench):
    return {past.command: past.status for past in mine(bench).panels[CommandPanel]._past}


def test_the_history_ticks_only_rides_that_arrived():
    with toy_workbench(real_services()) as bench, fake_page(bench):
        panel = mine(bench).panels[CommandPanel]
        panel._drive.speed = 0.02
        panel.ask("go to the couch")
        until(lambda: panel.driving and "On the way" in shown(bench))
        assert statuses(bench) == {"go to the couch": ""}
        panel.pause()
        assert "Paused" in shown(bench) and "On the way" not in shown(bench)
        panel.pause()
        assert "On the way" in shown(bench)
        panel.stop()
        assert statuses(bench) == {"go to the couch": "stopped"}
        panel.ask("turn left")
        until(lambda: panel.driving)
        panel.ask("go to the couch", paused=True)  # which ends the one before
        until(lambda: panel.driving and "Paused" in shown(bench))
        assert statuses(bench) == {"go to the couch": "", "turn left": "stopped"}
        panel._drive.speed = 8.0
        panel.pause()
        until(lambda: "Done" in shown(bench))
        assert statuses(bench) == {"go to the couch": "ok", "turn left": "stopped"}


def drawn(session):
    scene = session.scene
    return session.client.scene.get_handle_by_name("/path") is not None, [one.text for one in scene.texts["command"]]


def test_path_and_labels_outlive_a_reload_and_leave_maps_of_the_past():
    with toy_workbench(real_services()) as bench:
        page = FakePage(bench)
        session, panel = page.session, page.session.panels[CommandPanel]
        panel._drive.speed = 8.0
        panel.ask("go to the couch")
        until(lambda: "Done" in shown(bench))
        there = drawn(session)
        assert there[0] and there[1][0].startswith("▶ 1")
        session.show_frame(0)
        until(lambda: drawn(session) == (False, []))
        session.show_frame(session.last_frame)
        until(lambda: drawn(session) == there)
        page.close()
        gone(bench, session)
        with fake_page(bench, tab=page.tab) as again:
            until(lambda: drawn(again.session) == there)
            again.session.panels[CommandPanel].reset()
            assert drawn(again.session) == (False, [])


def test_a_low_robot_drives_under_tables_and_a_tall_one_does_not():
    simap = toy_map()
    table = simap.by_id(6)
    lowest = np.where(simap.instance == table.id, np.float32(0.7), simap.grid.lowest_m)
    simap = replace(simap, grid=replace(simap.grid, lowest_m=lowest))
    x, y = (float(round(value, 3)) for value in table.centroid_m[:2])
    with (
        Workbench(simap, services=real_services(), port=free_port(), start=TOY_POSE) as bench,
        fake_page(bench) as page,
    ):
        session, panel = page.session, page.session.panels[CommandPanel]
        panel._drive.speed = 8.0

        def drives(height_m):
            panel._height.value = height_m
            panel.reset()
            panel.ask(f"robot.move_to(({x}, {y}))\n")
            assert session.wait_idle()
            until(lambda: not panel.driving)
            assert panel._answer is not None
            return panel._answer.status, float(np.hypot(session.pose.x_m - x, session.pose.y_m - y)) < 0.1

        assert drives(0.3) == ("ok", True)
        assert drives(1.2) != ("ok", True)
        panel._height.value = 0.3
        state = panel.state()
        panel._height.value = 1.5
        panel.restore(state)
        assert session.robot.height_m == 0.3
