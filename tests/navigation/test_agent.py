import json
import math
from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_maps import TOY_POSE, Box, map_from_drawing, map_of_boxes, toy_map

from simaps_viz.errors import CommandError, InputError, PlanningError
from simaps_viz.language.interpreter import Budget
from simaps_viz.navigation.agent import Agent, Answer, answer, is_program, outcome_text
from simaps_viz.navigation.planner import Planner, RobotShape
from simaps_viz.navigation.robot import MAX_STRAIGHT_M, Motion, drive, spin, straight
from simaps_viz.structures import GridSpec, Path, Pose2

POINT = RobotShape(radius_m=0.02)
OPEN = GridSpec(120, 120, 0.05, 0.0, 0.0)


@pytest.fixture(scope="module")
def simap():
    return toy_map()


def one_chair():
    """A chair 0.5 x 0.3 m whose centroid is (3.25, 3.15), on open floor of 6 x 6 m."""
    return map_of_boxes(OPEN, [Box("chair", 60, 60, 6, 10, 0.8)])


def test_answer_is_the_line_query_prints(simap) -> None:
    said = answer(simap, "go to the third chair from here", TOY_POSE)
    line = json.loads(json.dumps(said.to_json()))
    assert list(line) == [
        *("status", "reason", "program", "goals", "path", "final_pose", "path_length_m", "notes", "alternatives")
    ]
    assert line["status"] == "ok" and line["reason"] is None
    assert line["program"] == 'robot.move_to_nth_closest("chair", 3)'
    (goal,) = line["goals"]
    assert list(goal) == ["primitive", "label", "instance", "point"]
    assert (goal["primitive"], goal["label"], goal["instance"]) == ("move_to_nth_closest", "chair", 4)
    assert line["path"][0] == [0.5, 0.5]
    assert line["path"][-1] == goal["point"] == line["final_pose"][:2]
    lengths = np.linalg.norm(np.diff(line["path"], axis=0), axis=1)
    assert line["path_length_m"] == pytest.approx(lengths.sum(), abs=1e-5)
    (x0, y0), (x1, y1) = line["path"][-2:]
    assert line["final_pose"][2] == pytest.approx(math.degrees(math.atan2(x1 - x0, y1 - y0)) % 360.0, abs=1e-3)


def test_refused_leaves_the_robot(simap) -> None:
    line = answer(simap, "go to the piano", TOY_POSE).to_json()
    assert line["status"] == "refused"
    assert line["reason"] == ("There is no piano on this map.")
    assert line["program"] == 'robot.move_to_object(search("piano"))'
    assert (line["goals"], line["path"], line["final_pose"]) == ([], [[0.5, 0.5]], [0.5, 0.5, 90.0])
    assert line["path_length_m"] == 0.0
    late = answer(simap, "go to the couch, then to the 4th chair", TOY_POSE)
    assert late.status == "refused" and late.path_length_m == 0.0
    assert late.reason == "There are only 3 chairs on this map; the 4th was asked for."


def stays(said: Answer) -> bool:
    there = (said.goals, said.steps, said.path_length_m, said.final_pose) == ((), (), 0.0, TOY_POSE)
    return there and said.path_m.tolist() == [[0.5, 0.5]]


def test_refused_after_metres_also_leaves_the_robot(simap) -> None:
    said = answer(simap, "robot.move_to_object('couch')\nx = robot.in_view('dining table')[0]", TOY_POSE)
    assert said.status == "refused"  # it is in view from the start, but not from the couch
    assert said.reason == "line 2: There is no dining table in view."
    assert stays(said)


def test_failed_after_metres_also_leaves_the_robot(simap) -> None:
    said = answer(simap, "turn left and go forward 3 m", TOY_POSE)
    assert said.status == "failed"
    assert said.reason == "the way ahead is free for 0.80 m, then a dining table; 3 m were asked for"
    assert stays(said)
    plant = simap.of_class("potted plant")[0]
    fat = answer(simap, "go to the plant", TOY_POSE, robot=RobotShape(radius_m=0.5))
    assert fat.status == "failed" and fat.reason
    assert fat.reason.startswith(f"the robot cannot get to {plant.name}: the nearest it can stand is ")


def test_programs_are_recognised_and_name_their_line(simap) -> None:
    said = answer(simap, "robot.move_to_object('chair', 2)", TOY_POSE)
    assert said.status == "ok" and said.goals[0].instance == 1
    loop = "for c in robot.instances('chair'):\n    robot.move_to_object('chair', c)"
    assert [goal.instance for goal in answer(simap, loop, TOY_POSE).goals] == [3, 1, 4]
    bad = answer(simap, "robot.turn(90)\nrobot.face('piano')", TOY_POSE)
    assert bad.status == "refused" and bad.reason and bad.reason.startswith("line 2: face: There is no piano")
    given = answer(simap, "whatever was said", TOY_POSE, program="robot.turn(90)")
    assert given.status == "ok" and given.program == "robot.turn(90)"
    assert is_program("robot.fly(1)") and is_program("tell(things('chair'), 'count')")
    assert not is_program("tell me (please) how many chairs there are") and not is_program(
        "go to the robot. Then turn (left)"
    )


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_pose_has_to_be_finite(simap, bad: float) -> None:
    with pytest.raises(InputError, match="pose: expected three finite numbers"):
        answer(simap, "turn left", Pose2(0.0, bad, 0.0))


def test_a_pose_off_the_map_fails_in_words(simap) -> None:
    said = answer(simap, "go to the chair", Pose2(50.0, 0.0, 0.0))
    assert said.status == "failed" and said.reason and "the robot cannot start at (50.00, 0.00)" in said.reason


@pytest.mark.parametrize(
    ("program", "heading"),
    [
        ("robot.turn(90)", 90.0),
        ("robot.turn(-90)", 270.0),
        ("robot.turn(450)", 90.0),
        ("robot.turn_absolute(135)", 135.0),
        ("robot.turn_absolute(-90)", 270.0),
        ("robot.face('chair')", 45.0),
        ("robot.with_object_on_left('chair')", 135.0),
        ("robot.with_object_on_right('chair')", 315.0),
    ],
)
def test_turns(program: str, heading: float) -> None:
    pose = Pose2.from_heading(1.25, 1.15, 0.0)  # the chair's centroid lies 2 m north and 2 m east
    said = answer(one_chair(), program, pose)
    assert said.final_pose.heading_deg == pytest.approx(heading, abs=1e-6)
    assert (said.final_pose.x_m, said.final_pose.y_m, said.path_length_m) == (1.25, 1.15, 0.0)


@pytest.mark.parametrize(
    ("primitive", "side"),
    [
        ("move_north", (0.0, 1.0)),
        ("move_south", (0.0, -1.0)),
        ("move_east", (1.0, 0.0)),
        ("move_west", (-1.0, 0.0)),
        ("move_to_left", (-1.0, 0.0)),  # the viewer stands south of the chair
        ("move_to_right", (1.0, 0.0)),
    ],
)
def test_beside_is_extent_plus_radius_plus_clearance(primitive: str, side: tuple[float, float]) -> None:
    said = answer(one_chair(), f"robot.{primitive}('chair')", Pose2(3.25, 0.55, 0.0))
    extent = 0.25 if side[0] else 0.15
    expected = np.array([3.25, 3.15]) + np.array(side) * (extent + 0.2 + 0.3)
    assert said.goals[0].point_m == pytest.approx(tuple(expected))
    assert (said.final_pose.x_m, said.final_pose.y_m) == pytest.approx(tuple(expected))


@settings(max_examples=25, deadline=None)
@given(st.floats(0.3, 5.7), st.floats(0.3, 5.7), st.floats(0.0, 360.0))
def test_left_and_right_are_as_seen_from_where_the_command_was_given(x: float, y: float, heading: float) -> None:
    simap, pose = one_chair(), Pose2.from_heading(x, y, heading)
    if np.hypot(x - 3.25, y - 3.15) < 0.8:
        return
    to_chair = np.array([3.25 - x, 3.15 - y])
    for primitive, sign in (("move_to_left", 1.0), ("move_to_right", -1.0)):
        # turning, or driving elsewhere first, does not change what left means
        said = answer(simap, f"robot.turn(70)\nrobot.{primitive}('chair')", pose)
        offset = np.array(said.goals[-1].point_m) - (3.25, 3.15)
        across = to_chair[0] * offset[1] - to_chair[1] * offset[0]
        assert across * sign > 0.99 * np.linalg.norm(to_chair) * np.linalg.norm(offset)


def test_beside_a_wall_stays_on_the_side_or_fails() -> None:
    chair, wall = Box("chair", 60, 60, 6, 10, 0.8), Box("wall", 69, 0, 2, 120, 2.0)
    walled = map_of_boxes(OPEN, [chair], [wall])
    said = answer(walled, "go north of the chair", Pose2(3.25, 0.55, 0.0))
    assert said.status == "failed" and said.reason
    assert "north of the chair" in said.reason
    assert answer(walled, "go south of the chair", Pose2(3.25, 0.55, 0.0)).status == "ok"


def test_in_between_is_the_middle_of_the_gap() -> None:
    couch, chair = Box("couch", 50, 20, 6, 30, 0.7), Box("chair", 50, 80, 6, 6, 0.8)
    simap = map_of_boxes(OPEN, [couch, chair])
    said = answer(simap, "go between the chair and the couch", Pose2(3.0, 0.5, 0.0))
    assert said.goals[0].point_m == pytest.approx((3.25, 2.65), abs=0.01)  # the gap goes from x = 2.5 to x = 4.0
    goal = said.to_json()["goals"][0]
    assert (goal["label"], goal["instance"], goal["other_label"], goal["other_instance"]) == ("chair", 2, "couch", 1)


def test_ranks_are_those_of_where_the_robot_is_by_then(simap) -> None:
    said = answer(simap, "robot.move_to_object('chair', 3)\nrobot.move_to_object('chair', 2)", TOY_POSE)
    assert [goal.instance for goal in said.goals] == [4, 1]
    agent = Agent(simap, TOY_POSE)
    assert agent.run_program("robot.move_to_object('chair', 3)").robot.goals[-1].instance == 4
    second = agent.run_program("robot.move_to_object('chair')").robot
    assert second.goals[-1].instance == 4, "now the closest"
    assert second.path_length_m == 0.0


def test_the_view_is_that_of_where_the_robot_looks_by_then(simap) -> None:
    program = "robot.turn_absolute({})\nfor thing in robot.in_view('couch'):\n    robot.face('couch', thing)"
    assert answer(simap, program.format(270), Pose2.from_heading(3.0, 0.5, 0.0)).goals == ()
    assert len(answer(simap, program.format(0), Pose2.from_heading(3.0, 0.5, 180.0)).goals) == 1


def test_get_pos_contour_and_move_to(simap) -> None:
    there = answer(simap, "robot.move_to(robot.get_pos('couch'))", TOY_POSE)
    near = answer(simap, "robot.move_to_object('couch')", TOY_POSE)
    assert there.goals[0].instance == 5
    assert there.final_pose == near.final_pose
    robot = Agent(simap, TOY_POSE).run_program("robot.turn(0)").robot
    outline = robot._get_contour("chair", 1)
    assert len(outline) == 28  # the border cells of 8 x 8
    assert {tuple(np.round(p, 6)) for p in outline} == {
        tuple(np.round(simap.spec.centre_of(r, c), 6))
        for r in range(20, 28)
        for c in range(12, 20)
        if r in (20, 27) or c in (12, 19)
    }
    assert robot._get_pos("robot", 1) == [0.5, 0.5]


def test_steps_tell_line_goal_and_poses(simap) -> None:
    agent = Agent(simap, TOY_POSE)
    events = list(agent.steps("x = robot.instances('chair')\nrobot.move_to_object('chair', x[1])\nrobot.turn(90)"))
    assert [(e.line, e.done) for e in events] == [(1, False), (1, True), (2, False), (2, True), (3, False), (3, True)]
    assert events[2].text == "robot.move_to_object('chair', x[1])"
    assert [e.goal.instance if e.goal else None for e in events] == [None, None, None, 1, None, None]
    assert [len(e.poses) > 0 for e in events] == [False, False, False, True, False, True]
    driven = np.concatenate([e.poses for e in events])
    assert driven[0] == pytest.approx([0.5, 0.5, 0.0])
    assert driven[-1] == pytest.approx([agent.pose.x_m, agent.pose.y_m, agent.pose.yaw_rad])


def test_stopping_leaves_the_robot_where_the_last_statement_put_it(simap) -> None:
    agent = Agent(simap, TOY_POSE)
    steps = agent.steps("robot.move_forward(1)\nrobot.move_forward(1)")
    assert agent.pose == TOY_POSE
    for event in steps:
        if event.done:
            break
    steps.close()
    assert (agent.pose.x_m, agent.pose.y_m) == pytest.approx((1.5, 0.5))


def test_the_whole_program_is_checked_before_the_first_step(simap) -> None:
    agent = Agent(simap, TOY_POSE)
    with pytest.raises(CommandError, match=r"^line 2: nth_from: There are only 3 chairs"):
        agent.steps("robot.turn(90)\nx = robot.nth_from('chair', 'left', 9)")
    with pytest.raises(CommandError, match=r"^line 1: closest_to: There is only 1 couch"):
        agent.steps("x = robot.closest_to('chair', 'couch', 2)")
    assert agent.pose == TOY_POSE


LOOP = """x = robot.get_pos("robot")
for c in robot.instances("chair"):
    if c == robot.instances("chair")[0]:
        robot.move_to_object("chair", c)
    else:
        robot.face("chair", c)
"""


def test_a_loop_is_stepped_paused_and_stopped(simap) -> None:
    whole = [(e.line, e.done, e.text) for e in Agent(simap, TOY_POSE).steps(LOOP)]
    assert [line for line, done, _ in whole if not done] == [1, 2, 3, 4, 3, 6, 3, 6]
    for taken in range(len(whole) + 1):
        agent = Agent(simap, TOY_POSE)
        steps = agent.steps(LOOP)
        assert [(e.line, e.done, e.text) for e in islice(steps, taken)] == whole[:taken]
        steps.close()
        assert next(steps, None) is None
        arrived = taken > whole.index((4, True, 'robot.move_to_object("chair", c)'))
        assert (agent.pose.x_m != 0.5) == arrived
        agent.run_program("robot.turn(0)")  # and the robot takes the next program from there


def test_a_new_program_stops_the_one_before(simap) -> None:
    agent = Agent(simap, TOY_POSE)
    first = agent.steps("robot.move_forward(1)\nrobot.move_forward(1)")
    list(islice(first, 2))
    second = agent.steps("robot.turn(90)")
    assert next(first, None) is None
    list(second)
    assert (agent.pose.x_m, agent.pose.y_m) == pytest.approx((1.5, 0.5))
    assert agent.pose.heading_deg == pytest.approx(180.0)


def test_a_refused_program_leaves_the_one_before_running(simap) -> None:
    agent = Agent(simap, TOY_POSE)
    first = agent.steps("robot.move_forward(1)\nrobot.move_forward(0.5)")
    list(islice(first, 2))
    with pytest.raises(CommandError, match="There is no piano"):
        agent.steps("robot.face('piano')")
    list(first)
    assert agent.pose.x_m == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("program", "reason"),
    [
        ("robot.move_forward(1)\nfor x in ['couch', 'piano']:\n    robot.face(x)", "line 3: face: There is no piano"),
        (
            "robot.move_forward(1)\nc = robot.instances('chair')[3]",
            "line 2: There are only 3 chairs on this map; the 4th",
        ),
        ("robot.move_forward(1)\nx = robot.between('couch', 'chair', 'chair')", "line 2: between: There is no couch"),
        ("robot.move_forward(1)\nx = 1 / 0", "line 2: division by zero"),
        ("robot.turn(1)\np = robot.get_pos('robot')\nrobot.turn(1 / (p[0] - 0.5))", "line 3: division by zero"),
    ],
)
def test_what_is_bound_to_be_refused_never_starts(simap, program: str, reason: str) -> None:
    agent = Agent(simap, TOY_POSE)
    with pytest.raises(CommandError, match=f"^{reason}"):
        agent.steps(program)
    assert agent.pose == TOY_POSE


def test_a_branch_is_that_of_where_the_drive_ends(simap) -> None:
    program = (
        "robot.move_forward(1)\np = robot.get_pos('robot')\nif p[0] > {}:\n    robot.face('piano')\nrobot.turn(90)"
    )
    assert answer(simap, program.format(2.0), TOY_POSE).status == "ok"
    said = answer(simap, program.format(1.0), TOY_POSE)
    assert said.status == "refused" and said.reason and said.reason.startswith("line 4: face: There is no piano")
    assert stays(said)


def test_a_drive_too_long_to_sample_is_refused() -> None:
    assert len(straight(TOY_POSE, MAX_STRAIGHT_M)) > 100_000
    for metres in (MAX_STRAIGHT_M * 1.001, -1e12):
        with pytest.raises(PlanningError, match=r"^one straight drive is at most 10000 m"):
            straight(TOY_POSE, metres)


def test_poses_follow_the_path_within_the_limits(simap) -> None:
    motion = Motion(speed_mps=0.5, turn_rate_rps=1.0, dt_s=0.1)
    agent = Agent(simap, TOY_POSE, motion=motion)
    poses = np.concatenate([e.poses for e in agent.steps("robot.move_to_object('couch')\nrobot.turn(200)")])
    step = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    turn = np.abs((np.diff(poses[:, 2]) + np.pi) % (2 * np.pi) - np.pi)
    assert step.max() <= 0.5 * 0.1 + 1e-9
    assert turn.max() <= 1.0 * 0.1 + 1e-9
    assert (np.minimum(step, turn) < 1e-9).all(), "it turns on the spot or drives straight"
    along = np.arctan2(np.diff(poses[:, 1]), np.diff(poses[:, 0]))
    moving = step > 1e-9
    assert np.allclose(np.cos(along[moving] - poses[1:, 2][moving]), 1.0), "it looks where it drives"


def test_drive_and_spin_end_exactly() -> None:
    way = Path(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]]))
    poses = drive(way, np.pi)
    assert poses[0] == pytest.approx([0.0, 0.0, np.pi])
    assert poses[-1] == pytest.approx([1.0, 2.0, np.pi / 2])
    assert len(drive(Path(np.array([[1.0, 1.0]])), 0.3)) == 1
    assert spin(Pose2(0.0, 0.0, 0.0), -np.pi)[-1, 2] == pytest.approx(np.pi)
    assert len(spin(Pose2(0.0, 0.0, 0.0), 2 * np.pi)) > 60, "a whole turn is a turn"


def test_reverse_keeps_looking_ahead(simap) -> None:
    said = answer(simap, "move back 50 cm", TOY_POSE)
    assert said.final_pose.heading_deg == pytest.approx(90.0)
    assert (said.final_pose.x_m, said.final_pose.y_m) == pytest.approx((0.0, 0.5))


def test_a_robot_already_there_does_not_move(simap) -> None:
    first = answer(simap, "go to the chair", TOY_POSE)
    again = answer(simap, "go to the chair", first.final_pose)
    assert again.status == "ok" and again.path_length_m == 0.0
    assert again.final_pose == first.final_pose


def test_an_object_nobody_can_get_to_fails() -> None:
    sealed = map_from_drawing(
        "..........\n.#######..\n.#.....#..\n.#..A..#..\n.#.....#..\n.#######..\n..........", {"A": "chair"}
    )
    assert answer(sealed, "go to the chair", Pose2(0.1, 0.1, 0.0), robot=POINT).status == "ok"  # within 1.5 m, outside
    far = map_from_drawing(
        "..........\n.#######..\n.#.....#..\n.#..A..#..\n.#.....#..\n.#######..\n..........", {"A": "chair"}, cells=20
    )
    said = answer(far, "go to the chair", Pose2(0.1, 0.1, 0.0), robot=POINT)
    assert said.status == "failed" and said.reason
    assert f"the robot cannot get to {far.instances[0].name}: the nearest it can stand is" in said.reason


def test_path_budget(simap) -> None:
    program = "for a in [1, 2, 3, 4, 5]:\n    for b in [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14]:\n"
    program += "        robot.move_to([0.5, 0.5])\n        robot.move_to([3.2, 1.0])\n" * 4
    said = answer(simap, program, TOY_POSE)
    assert said.status == "failed" and said.reason and "would drive more than 1000 m" in said.reason
    assert stays(said)


def test_planning_budget(simap) -> None:
    """Planning is counted in cells, so that a program stops at the same line on every machine."""
    program = "robot.move_to_object('couch')\nrobot.move_to_object('chair', 3)\nrobot.move_to_object('couch')"
    assert (
        len(Agent(simap, TOY_POSE, budget=Budget(planned_cells=3 * simap.instance.size)).rehearse(program).steps) == 6
    )
    with pytest.raises(PlanningError, match=r"^line 3: move_to_object: stopped: the program would plan over more"):
        Agent(simap, TOY_POSE, budget=Budget(planned_cells=2 * simap.instance.size)).steps(program)


def turns_around(path_m: np.ndarray, centre: tuple[float, ...]) -> float:
    a, b = path_m[:-1] - centre[:2], path_m[1:] - centre[:2]
    return float(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum() / (2.0 * np.pi))


@pytest.mark.parametrize(("turns", "winding"), [("", -1.0), (", 2", -2.0), (", -3", 3.0)])
def test_a_lap_is_driven_as_it_is_planned(simap, turns: str, winding: float) -> None:
    """The table in the middle of the east room: the ring, once the robot is on it, is a closed path around it."""
    program = f"positions = lap(nth(things('table'), 2){turns})\nfor point in positions:\n    robot.move_to(point)"
    said = answer(simap, program, TOY_POSE)
    assert said.status == "ok" and {goal.instance for goal in said.goals} == {8}
    there = next(k for k, point in enumerate(said.path_m) if tuple(point) == said.goals[0].point_m)
    ring = said.path_m[there:]
    assert ring[-1] == pytest.approx(ring[0])
    assert turns_around(ring, simap.by_id(8).centroid_m) == pytest.approx(winding, abs=1e-6)


def test_no_way_all_around_is_said_before_the_first_metre(simap) -> None:
    said = answer(simap, "robot.move_forward(1)\nfor point in lap('couch'):\n    robot.move_to(point)", TOY_POSE)
    assert said.status == "failed" and stays(said)
    assert said.reason == "line 2: lap: there is no way all around the couch: something stands against it"


def test_sets_are_those_of_where_the_robot_is_by_then(simap) -> None:
    """Chair 1 is to the left of a robot that looks east, and to the right of one that looks north."""
    for heading, side, other in ((90, "left", "right"), (0, "right", "left")):
        program = f"robot.turn_absolute({heading})\nrobot.move_to_object(nearest(side(things('chair'), '{{}}')))"
        assert answer(simap, program.format(side), TOY_POSE).goals[-1].instance == 1
        assert [g.instance for g in answer(simap, program.format(other), TOY_POSE).goals] != [1]


def test_goals_know_in_words_what_was_chosen(simap) -> None:
    said = answer(simap, "robot.face(first(order(things('chair'), 'left')))\nrobot.move_to_object('couch')", TOY_POSE)
    assert [goal.words for goal in said.goals] == ["leftmost chair", ""]
    assert outcome_text(said).startswith("Facing the leftmost chair, then to the couch, ")


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (
            "robot.move_to_object('couch')\nrobot.move_to(pose('start'))",
            "To the couch, then back to where it started, ",
        ),
        ("robot.move_in_between('couch', 'dining table')", "Between the couch and the dining table, a path of "),
        ("robot.move_to_left('couch')", "To the left of the couch, as seen from the robot, "),
        (
            "robot.move_to_object(nearest(side(things('chair'), 'right', 'couch')))",
            " of the couch, as seen from the robot, ",
        ),
        ("robot.face('couch')", "Facing the couch, without driving, at x 0.50 m, y 0.50 m, heading "),
        ("for one in things('chair'):\n    robot.move_to_object(one)", "To 3 chairs, a path of "),
        ("for point in lap('dining table'):\n    robot.move_to(point)", "Around the dining table, a path of "),
        ("robot.turn(90)", "Without driving, at x 0.50 m, y 0.50 m, heading 180° (south) in the end."),
    ],
)
def test_outcomes_say_where_each_stop_is(simap, program, words) -> None:
    said = answer(simap, program, TOY_POSE)
    assert said.status == "ok", said.reason
    assert words in outcome_text(said)


def test_where_the_robot_is_already_is_said(simap) -> None:
    there = answer(simap, "robot.move_to_object('couch')", TOY_POSE).final_pose
    said = outcome_text(answer(simap, "robot.move_to_object('couch')", there))
    assert said.startswith(f"To the couch, where the robot is already, at x {there.x_m:.2f} m")


def test_the_branch_not_taken_may_name_what_is_not_there(simap) -> None:
    program = "if count(things('piano')) > 0:\n    robot.move_to_object('piano')\nelse:\n    robot.face('couch')"
    assert [goal.instance for goal in answer(simap, program, TOY_POSE).goals] == [5]


def test_a_question_is_answered_and_the_robot_stays(simap) -> None:
    said = answer(simap, "tell(things('chair'), 'count')", TOY_POSE)
    line = json.loads(json.dumps(said.to_json()))
    assert (line["status"], line["final_pose"], line["path"]) == ("ok", [0.5, 0.5, 90.0], [[0.5, 0.5]])
    assert line["answer"]["value"] == 3 and sorted(line["answer"]["instances"]) == [1, 3, 4]
    assert outcome_text(said) == line["answer"]["text"] == "There are 3 chairs on this map."
    gone = answer(simap, "", TOY_POSE, program="robot.move_to_object('couch')\ntell(nearest(things('chair')), 'which')")
    assert gone.answer and gone.answer["instances"] == [1] and gone.path_length_m > 0.0
    text = outcome_text(gone)
    assert text.startswith(gone.answer["text"]) and "To the couch" in text
    assert "answer" not in answer(simap, "robot.turn(90)", TOY_POSE).to_json()


STATEMENTS = st.sampled_from(
    [
        "robot.move_to_object('chair')",
        "robot.move_to_object('chair', 3)",
        "robot.move_to_left('dining table')",
        "robot.move_north('couch')",
        "robot.move_in_between('chair', 'potted plant')",
        "robot.move_forward(0.7)",
        "robot.move_forward(-1.5)",
        "robot.turn(110)",
        "robot.face('couch')",
        "robot.move_to([3.5, -0.5])",
        "robot.move_to_object(farthest(side(things('anything'), 'front')))",
        "for p in lap(nearest(things('anything'))):\n    robot.move_to(p)",
        "for p in lap('chair', 0.6):\n    robot.move_to(p)",
        "robot.move_to(spot('potted plant', 'west', 0.4))",
        "robot.move_to_object('chair', robot.in_view('chair')[0])",
        "for c in robot.instances('chair'):\n    robot.move_to_nth_closest('chair', 2)",
    ]
)


@settings(max_examples=30, deadline=None)
@given(st.lists(STATEMENTS, min_size=1, max_size=5), st.floats(0.0, 360.0))
def test_any_program_is_done_to_its_end_over_free_floor_or_not_begun(simap, lines: list[str], heading: float) -> None:
    start, planner = Pose2.from_heading(0.5, 0.5, heading), Planner(simap.grid)
    said = answer(simap, "\n".join(lines), start)
    assert said.path_m[0].tolist() == [0.5, 0.5]
    if said.status != "ok":
        assert (said.goals, said.path_length_m, said.final_pose, len(said.path_m)) == ((), 0.0, start, 1)
        return
    driven = np.concatenate([step.poses for step in said.steps])
    assert all(planner.free[planner.spec.cell_of(x, y)] for x, y in driven[:, :2].tolist())
    assert np.abs(np.diff(driven[:, :2], axis=0)).max(initial=0.0) <= 0.05
    assert driven[-1] == pytest.approx([said.final_pose.x_m, said.final_pose.y_m, said.final_pose.yaw_rad])
    assert said.path_m[-1] == pytest.approx(driven[-1, :2])
    legs = np.linalg.norm(np.diff(said.path_m, axis=0), axis=1)
    assert said.path_length_m == pytest.approx(legs.sum())
    assert len(said.steps) == 2 * sum(step.done for step in said.steps)
