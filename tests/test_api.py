"""Finding and planning from Python, with answers worked out on the drawing in toy_maps."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from toy_maps import TOY_POSE, toy_map

from simaps_viz import CommandError, InputError, PlanningError, Pose2, RobotShape, ask, find, plan, to_pandas


@pytest.fixture(scope="module")
def simap():
    return toy_map()


def ids(found):
    return [one.id for one in found]


@pytest.mark.parametrize(
    ("name", "near", "expected"),
    [
        ("chair", None, [1, 3, 4]),
        ("chair", (4.5, -0.5), [4, 1, 3]),
        ("chairs", TOY_POSE, [3, 1, 4]),
        ("chair", "potted plant", [4, 1, 3]),
        ("sofa", None, [5]),
        ("dining table", "couch", [8, 6]),
        ("dining table", "chair", [6, 8]),
    ],
)
def test_find(simap, name, near, expected):
    assert ids(find(simap, name, near=near)) == expected


def test_methods_of_the_map_are_the_functions(simap):
    assert simap.find("chairs", near="sofa") == find(simap, "chairs", near="sofa")
    robot = RobotShape(radius_m=0.25)
    ways = simap.plan(TOY_POSE, "sofa", robot=robot), plan(simap, TOY_POSE, "sofa", robot=robot)
    assert ways[0].points_m.tolist() == ways[1].points_m.tolist() != simap.plan(TOY_POSE, "sofa").points_m.tolist()
    assert simap.to_pandas().equals(to_pandas(simap))


def test_ask(simap):
    """As `simaps query` answers: from the pose, or from where the first camera stood that has free floor by it."""
    done = simap.ask("go to the nearest chair, then turn left", pose=TOY_POSE)
    assert done.status == "ok" and done.reason is None and done.program.startswith("robot.move_to_object(")
    assert [goal.instance for goal in done.goals][:1] == [3] and done.path_m[0].tolist() == [0.5, 0.5]
    wide = RobotShape(radius_m=0.3)
    by_method = simap.ask("go to the sofa", pose=TOY_POSE, robot=wide)
    by_function = ask(simap, "go to the sofa", pose=TOY_POSE, robot=wide)
    assert by_method.to_json() == by_function.to_json() != simap.ask("go to the sofa", pose=TOY_POSE).to_json()
    assert simap.ask("robot.turn(90)", pose=TOY_POSE).final_pose.heading_deg == pytest.approx(180.0)
    T_map_camera = np.tile(np.eye(4), (2, 1, 1))  # both look up; the first stands outside of the house
    T_map_camera[0, :3, 3], T_map_camera[1, :3, 3] = (-5.0, 0.0, 1.5), (0.5, 0.9, 1.5)
    seen = replace(simap, T_map_camera=T_map_camera)
    assert seen.ask("go to the chair").path_m[0].tolist() == [0.5, 0.9]


def test_what_cannot_be_done_is_an_answer(simap):
    refused = simap.ask("go to the piano", pose=TOY_POSE)
    assert refused.status == "refused" and refused.reason == "There is no piano on this map."
    assert refused.final_pose == TOY_POSE and refused.path_length_m == 0.0
    assert simap.ask("go to the chair", pose=Pose2(90.0, 0.0, 0.0)).status == "failed"


@pytest.mark.parametrize(("command", "pose"), [(3, TOY_POSE), ("turn left", (0.5, 0.5)), ("turn left", "here")])
def test_a_command_is_text_and_a_pose_has_a_heading(simap, command, pose):
    with pytest.raises(InputError, match=r"command: expected text, found 3|pose: expected a Pose2"):
        simap.ask(command, pose=pose)


def test_a_map_without_cameras_is_asked_with_a_pose(simap):
    bare = replace(simap, T_map_camera=np.zeros((0, 4, 4)), frame_names=())
    assert bare.ask("turn left", pose=TOY_POSE).status == "ok"
    with pytest.raises(InputError, match="start pose: expected a map with at least one camera"):
        bare.ask("turn left")


def test_near_an_instance_leaves_it_out(simap):
    assert ids(find(simap, "chair", near=simap.by_id(4))) == [1, 3]
    assert find(simap, "chair", near="chair") == ()


def test_find_names_what_there_is(simap):
    with pytest.raises(CommandError, match=r"^There is no piano on this map\.$"):
        find(simap, "piano")


@pytest.mark.parametrize(("name", "near"), [("", None), (" ", None), (3, None), (None, None), ("chair", "")])
def test_names_are_checked(simap, name, near):
    with pytest.raises(InputError, match="expected the name of objects, found"):
        find(simap, name, near=near)


@pytest.mark.parametrize("place", [(float("nan"), 0.0), ("a", 1.0), (None, 1.0), (float("inf"), 0.0)])
def test_a_spot_is_two_numbers(simap, place):
    with pytest.raises(InputError, match="place: expected x and y in metres"):
        simap.at(*place)


def test_plan_to_a_point_an_object_and_a_name(simap):
    way = plan(simap, (0.5, 0.5), (4.0, 0.9))
    assert way.points_m[0].tolist() == [0.5, 0.5] and way.points_m[-1] == pytest.approx([4.0, 0.9])
    assert way.length_m >= 3.5
    couch = simap.of_class("couch")[0]
    by_instance, by_name = plan(simap, TOY_POSE, couch), plan(simap, TOY_POSE, "sofa")
    assert by_instance.points_m.tolist() == by_name.points_m.tolist()
    (x_low, y_low, _), (x_high, _, _) = couch.aabb_m
    x, y = by_name.points_m[-1]
    assert x_low - 0.5 < x < x_high + 0.5 and y_low - 0.5 < y < y_low + 0.1
    assert plan(simap, couch, Pose2(0.5, 0.5, 0.0)).points_m[-1].tolist() == [0.5, 0.5]


def test_plan_says_why_not(simap):
    with pytest.raises(PlanningError, match="not free floor"):
        plan(simap, (0.5, 0.5), (0.5, 1.8))
    with pytest.raises(PlanningError):
        plan(simap, (0.5, 0.5), (4.0, 0.5), robot=RobotShape(radius_m=0.9))
    with pytest.raises(CommandError, match="piano"):
        plan(simap, (0.5, 0.5), "piano")


@pytest.mark.parametrize("wrong", [(1.0,), (1.0, float("nan")), (1.0, "x"), None])
def test_places_are_checked(simap, wrong):
    with pytest.raises(InputError, match="place: expected"):
        plan(simap, wrong, (0.5, 0.5))


def test_frame(simap):
    frame = to_pandas(simap)
    assert frame.index.name == "id" and frame.groupby("label").size().to_dict() == simap.counts()
    assert frame.loc[3, "area_m2"] == pytest.approx(64 * 0.0025)


def test_frame_without_pandas(simap, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"to_pandas: expected the package pandas, .*simaps-viz\[pandas\]"):
        to_pandas(simap)
