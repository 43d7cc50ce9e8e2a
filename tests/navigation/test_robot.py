"""Where each primitive takes the robot, by the geometry that ``primitives`` documents; open floor, no detours."""

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from toy_maps import TOY_POSE, Box, map_of_boxes, toy_map

from simaps_viz.errors import CommandError, PlanningError
from simaps_viz.language.primitives import FUNCTIONS, PRIMITIVES
from simaps_viz.navigation.agent import planner_of
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.navigation.robot import CLEARANCE_M, Robot
from simaps_viz.structures import GridSpec, Pose2, SIMap

SPEC = GridSpec(rows=160, cols=160, cell_size_m=0.05, x0_m=-4.0, y0_m=-4.0)
THINGS = (
    Box("couch", 76, 70, 8, 20, 0.7),  # x -0.5 .. 0.5, y -0.2 .. 0.2
    Box("chair", 120, 40, 8, 8, 0.85),  # x -2.0 .. -1.6, y 2.0 .. 2.4
    Box("chair", 120, 110, 8, 8, 0.85),  # x 1.5 .. 1.9, y 2.0 .. 2.4
)
SHAPE = RobotShape()
CELL = 0.05


@pytest.fixture(scope="module")
def simap():
    return map_of_boxes(SPEC, THINGS)


def run(simap, pose: Pose2, name: str, *values: object) -> Robot:
    robot = Robot(simap, planner_of(simap, SHAPE), pose)
    primitive = PRIMITIVES[name]
    given = dict(zip([p.name for p in primitive.parameters], values, strict=False))
    arguments = {p.name: given.get(p.name, p.default) for p in primitive.parameters}
    robot.call(primitive, arguments)
    return robot


@pytest.mark.parametrize(
    ("name", "way"),
    [("move_north", (0, 1)), ("move_south", (0, -1)), ("move_east", (1, 0)), ("move_west", (-1, 0))],
)
@pytest.mark.parametrize("start", [(0.0, -2.5), (2.5, 0.5), (-3.0, -1.0)])
def test_compass_sides_are_the_map_s(simap, start: tuple[float, float], name: str, way: tuple[int, int]) -> None:
    """At (extent along the side) + robot radius + 0.3 m from the centroid, wherever the robot stood."""
    robot = run(simap, Pose2(*start, 0.7), name, "couch")
    extent = 0.5 if way[0] else 0.2
    expected = np.array(way) * (extent + SHAPE.radius_m + CLEARANCE_M)
    assert np.hypot(*(np.array([robot.pose.x_m, robot.pose.y_m]) - expected)) <= CELL


@pytest.mark.parametrize("bearing", [0.0, 0.6, np.pi / 2, 2.2, -1.1, np.pi])
@pytest.mark.parametrize(("name", "turn"), [("move_to_left", 1.0), ("move_to_right", -1.0)])
def test_left_and_right_are_a_quarter_turn_from_the_way_the_viewer_sees_it(
    simap, bearing: float, name: str, turn: float
) -> None:
    """The viewer stands 2.5 m from the couch and looks anywhere: only where it stands matters."""
    toward = np.array([np.cos(bearing), np.sin(bearing)])
    start = -2.5 * toward
    for yaw in (0.0, bearing):
        robot = run(simap, Pose2(float(start[0]), float(start[1]), yaw), name, "couch")
        side = turn * np.array([-toward[1], toward[0]])
        extent = abs(side[0]) * 0.475 + abs(side[1]) * 0.175 + CELL / 2.0
        expected = side * (extent + SHAPE.radius_m + CLEARANCE_M)
        assert np.hypot(*(np.array([robot.pose.x_m, robot.pose.y_m]) - expected)) <= CELL


def test_sides_and_ranks_are_those_of_where_the_robot_is_by_then(simap) -> None:
    robot = Robot(simap, planner_of(simap, SHAPE), Pose2(0.0, -2.5, 0.0))
    assert robot.grounding.pick("chair", 1).id == 3
    robot.call(PRIMITIVES["move_to"], {"pos": [-1.0, 2.5]})
    assert robot.grounding.pick("chair", 1).id == 2
    robot.call(PRIMITIVES["move_to_left"], {"name": "couch", "instance": 1})
    assert robot.pose.x_m > 0.3  # left of the couch as seen from the north-west, though the first pose was south of it


def test_between_is_the_middle_of_the_gap(simap) -> None:
    robot = run(simap, Pose2(0.0, -2.5, 0.0), "move_in_between", "chair", "chair", 1, 2)
    assert {robot.goals[-1].instance, robot.goals[-1].other_instance} == {2, 3}
    assert (robot.pose.x_m, robot.pose.y_m) == pytest.approx(((-1.6 + 1.5) / 2.0, 2.2), abs=0.01)


def test_approaching_ends_as_near_as_the_robot_fits(simap) -> None:
    robot = run(simap, Pose2(0.1, -2.5, 0.0), "move_to_object", "couch")
    gap = -0.2 - robot.pose.y_m  # from the robot's centre to the couch's southern edge
    assert SHAPE.radius_m <= gap <= SHAPE.radius_m + 2.0 * CELL
    assert robot.pose.x_m == pytest.approx(0.1, abs=CELL)


@pytest.mark.parametrize(
    ("name", "offset"), [("face", 0.0), ("with_object_on_left", -90.0), ("with_object_on_right", 90.0)]
)
def test_turning_to_things(simap, name: str, offset: float) -> None:
    robot = run(simap, Pose2(-2.0, -2.0, 1.0), name, "couch")
    bearing = np.rad2deg(np.arctan2(2.0, 2.0))
    assert np.rad2deg(robot.pose.yaw_rad) == pytest.approx(bearing + offset, abs=1e-6)
    assert (robot.pose.x_m, robot.pose.y_m) == (-2.0, -2.0)


@pytest.mark.parametrize(
    ("name", "value", "heading", "moved"),
    [
        ("turn", 90.0, 180.0, (0.0, 0.0)),
        ("turn", -45.0, 45.0, (0.0, 0.0)),
        ("turn", 360.0, 90.0, (0.0, 0.0)),
        ("turn_absolute", 0.0, 0.0, (0.0, 0.0)),
        ("turn_absolute", 225.0, 225.0, (0.0, 0.0)),
        ("move_forward", 1.5, 90.0, (1.5, 0.0)),
        ("move_forward", -0.5, 90.0, (-0.5, 0.0)),
    ],
)
def test_turns_and_straight_drives(simap, name: str, value: float, heading: float, moved: tuple[float, float]) -> None:
    robot = run(simap, Pose2.from_heading(-2.0, -2.0, 90.0), name, value)
    assert robot.pose.heading_deg % 360.0 == pytest.approx(heading, abs=1e-6)
    assert (robot.pose.x_m + 2.0, robot.pose.y_m + 2.0) == pytest.approx(moved, abs=1e-6)


def test_a_position_on_a_rug_is_driven_to_exactly() -> None:
    simap = map_of_boxes(SPEC, [*THINGS, Box("potted plant", 20, 60, 40, 40, 0.01, lowest_m=float("nan"))])
    robot = run(simap, Pose2(0.0, 1.5, 0.0), "move_to", [0.3, -2.3])
    assert (robot.pose.x_m, robot.pose.y_m) == pytest.approx((0.3, -2.3))
    assert robot.goals[-1].instance is None
    beside = run(simap, Pose2(0.0, 1.5, 0.0), "move_to", [0.0, 0.0])
    assert beside.goals[-1].label == "couch" and beside.pose.y_m == pytest.approx(0.4, abs=0.1)


def test_look_ups(simap) -> None:
    robot = Robot(simap, planner_of(simap, SHAPE), Pose2(0.0, -2.5, np.pi / 2))

    def ask(primitive: str, **arguments: object) -> Any:
        return robot.call(PRIMITIVES[primitive], arguments)

    assert ask("get_pos", name="couch", instance=1) == pytest.approx([0.0, 0.0], abs=1e-6)
    assert ask("get_pos", name="robot", instance=1) == [0.0, -2.5]
    contour = np.array(ask("get_contour", name="couch", instance=1))
    assert contour.min(axis=0) == pytest.approx([-0.475, -0.175]) and contour.max(axis=0) == pytest.approx(
        [0.475, 0.175]
    )
    left, right = robot.grounding.simap.by_id(2), robot.grounding.simap.by_id(3)
    assert ask("instances", name="chair").items == (right, left)  # 1.5 m east of the middle is nearer than 1.6 m west
    assert ask("nth_from", name="chair", side="left", n=1) is left
    assert ask("nth_from", name="chair", side="east", n=2) is left
    assert ask("closest_to", name="chair", other="couch", instance=1) is right
    assert ask("in_view", name="chair").items == (right, left)


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("move_to_object", ("piano",), r"There is no piano on this map\."),
        ("move_north", ("chair", 3), r"There are only 2 chairs on this map; the 3rd was asked for\."),
        ("nth_from", ("couch", "left", 2), r"There is only 1 couch on this map; the 2nd was asked for\."),
        ("between", ("couch", "chair", "chair"), r"There is no couch between chair \d and chair \d\."),
        ("move_in_between", ("couch", "couch"), "There is only 1 couch on this map"),
        ("move_to", ([9.0, 9.0],), "outside the map"),
        ("turn", (4000.0,), "a turn is at most 3600 degrees"),
        ("closest_to", ("couch", "couch"), "There is only 1 couch on this map; none is left to be near it"),
    ],
)
def test_what_cannot_be_is_refused_in_words(simap, name: str, values: tuple, words: str) -> None:
    with pytest.raises(CommandError, match=words):
        run(simap, Pose2(0.0, -2.5, 0.0), name, *values)


@pytest.fixture
def two_rooms(monkeypatch: pytest.MonkeyPatch):
    """The toy map as a kitchen in the west and room 2 in the east; a wall with a door of 1 m lies between them."""
    simap = toy_map()
    cells = np.where(np.arange(120) < 61, 1, 2)[None] * np.ones((100, 1), np.int64)
    cells[simap.grid.label == simap.grid.labels.index("wall")] = 0
    rooms = (
        SimpleNamespace(id=1, name="kitchen", centre_m=(0.5, 0.5)),
        SimpleNamespace(id=2, name="room 2", centre_m=(3.5, 0.0)),
    )
    monkeypatch.setattr(SIMap, "rooms", rooms, raising=False)
    monkeypatch.setattr(SIMap, "room_cells", cells.astype(np.int32), raising=False)
    monkeypatch.setattr(
        SIMap, "rooms_named", lambda self, name: tuple(r for r in rooms if r.name == name), raising=False
    )
    return simap


def test_a_robot_drives_into_a_room_and_stays_where_it_is_inside(two_rooms) -> None:
    robot = run(two_rooms, TOY_POSE, "move_to_object", "room 2", 1)
    wall_m = 2.05  # the first cell of room 2 begins here
    assert robot.pose.x_m - wall_m == pytest.approx(1.0, abs=0.03) and -0.05 < robot.pose.y_m < 1.05
    assert (robot.goals[-1].label, robot.goals[-1].instance) == ("room 2", None)
    assert robot.goals[-1].point_m == (robot.pose.x_m, robot.pose.y_m)
    there = run(two_rooms, TOY_POSE, "move_to_object", "kitchen", 1)
    assert (there.pose, there.path_length_m) == (TOY_POSE, 0.0)
    near = run(two_rooms, Pose2(1.4, 0.5, 0.0), "move_to_object", "kitchen", 1)
    assert near.path_length_m == 0.0, "half as far from its edge will do for one that is in it"
    turned = run(two_rooms, TOY_POSE, "face", "room 2", 1)
    assert turned.pose.yaw_rad == pytest.approx(np.arctan2(-0.5, 3.0))


def test_a_room_nobody_can_get_into_fails(two_rooms) -> None:
    with pytest.raises(PlanningError, match="there is no free floor the robot can reach into room 2"):
        robot = Robot(two_rooms, planner_of(two_rooms, RobotShape(radius_m=0.55)), TOY_POSE)
        robot.call(PRIMITIVES["move_to_object"], {"name": "room 2", "instance": 1})


def spot(robot: Robot, side: str, metres: float | None = None) -> Any:
    return robot.call(FUNCTIONS["spot"], {"T": "couch", "side": side, "metres": metres})


@pytest.mark.parametrize(("side", "expected"), [("front", (0.0, -0.7)), ("behind", (0.0, 0.7)), ("left", (-1.0, 0.0))])
def test_a_place_by_a_thing_is_on_that_side_of_it(simap, side: str, expected: tuple[float, float]) -> None:
    robot = Robot(simap, planner_of(simap, SHAPE), Pose2(0.0, -2.5, 0.0))
    robot.call(PRIMITIVES["move_to"], {"pos": spot(robot, side)})
    assert (robot.pose.x_m, robot.pose.y_m) == pytest.approx(expected, abs=0.03)
    assert (robot.goals[-1].label, robot.goals[-1].instance) == ("couch", 1)


def test_the_next_room_is_not_behind_the_couch_and_its_front_is_not_either() -> None:
    """The couch stands against a wall; half a metre behind it there is free floor, on the other side of that wall."""
    thin = map_of_boxes(SPEC, THINGS[:1], [Box("wall", 84, 40, 1, 80, 2.0)])
    thick = map_of_boxes(SPEC, THINGS[:1], [Box("wall", 84, 0, 40, 160, 2.0)])
    for walled in (thin, thick):
        robot = Robot(walled, planner_of(walled, SHAPE), Pose2(0.0, -2.5, 0.0))
        for pos in (spot(robot, "behind"), spot(robot, "north")):
            with pytest.raises(
                PlanningError, match=r"^(the robot cannot get|there is no).*(behind|north of) the couch"
            ):
                robot.call(PRIMITIVES["move_to"], {"pos": pos})
        with pytest.raises(PlanningError, match="north of the couch"):
            robot.call(PRIMITIVES["move_north"], {"name": "couch", "instance": 1})
        assert robot.path_length_m == 0.0
    far = Robot(thin, planner_of(thin, SHAPE), Pose2(0.0, -2.5, 0.0))
    with pytest.raises(PlanningError, match="what lies north of the couch is not on the map"):
        far.call(PRIMITIVES["move_to"], {"pos": spot(far, "north", 9.0)})


def keep_off(robot: Robot, what: object, metres: float | None = None) -> None:
    robot.call(FUNCTIONS["avoid"], {"S": what, "metres": metres})


def off_m(simap: SIMap, ids: list[int], path: list[tuple[float, float]]) -> float:
    """Return how near a path comes to the cells of some things, from point to point every centimetre."""
    rows, cols = np.nonzero(np.isin(simap.instance, ids))
    x0, y0, size = simap.spec.x0_m, simap.spec.y0_m, simap.spec.cell_size_m
    cells = np.stack([x0 + (cols + 0.5) * size, y0 + (rows + 0.5) * size], axis=1)
    legs = [np.linspace(a, b, 2 + int(np.linalg.norm(np.subtract(b, a)) / 0.01)) for a, b in pairwise(path)]
    return float(min(np.linalg.norm(cells - point, axis=1).min() for point in np.concatenate(legs)))


@pytest.mark.parametrize("metres", [None, 0.6, 1.2])
@pytest.mark.parametrize(("start", "chair"), [((0.0, -2.5), 2), ((2.5, 0.0), 2), ((-3.0, -1.0), 3)])
def test_drives_keep_as_far_away_as_they_were_told(
    simap, start: tuple[float, float], chair: int, metres: float | None
) -> None:
    straight = run(simap, Pose2(*start, 0.7), "move_to_object", simap.by_id(chair))
    robot = Robot(simap, planner_of(simap, SHAPE), Pose2(*start, 0.7))
    keep_off(robot, "couch", metres)
    robot.call(PRIMITIVES["move_to_object"], {"name": simap.by_id(chair), "instance": 1})
    assert off_m(simap, [1], robot.path_m) >= (metres or 1.0)
    assert robot.path_length_m >= straight.path_length_m - 1e-9
    assert (robot.pose.x_m, robot.pose.y_m) == pytest.approx((straight.pose.x_m, straight.pose.y_m), abs=0.3)


def test_without_a_distance_a_drive_keeps_half_a_metre_away_where_there_is_no_other_way() -> None:
    walls = [Box("wall", 70, 0, 20, 50, 2.0), Box("wall", 70, 108, 20, 52, 2.0)]  # 0.9 m east of the couch a gap
    narrow = map_of_boxes(SPEC, THINGS, walls)
    robot = Robot(narrow, planner_of(narrow, SHAPE), Pose2(0.0, -2.5, 0.0))
    keep_off(robot, "couch")
    robot.call(PRIMITIVES["move_to_object"], {"name": narrow.by_id(3), "instance": 1})
    assert 0.5 <= off_m(narrow, [1], robot.path_m) < 1.0
    strict = Robot(narrow, planner_of(narrow, SHAPE), Pose2(0.0, -2.5, 0.0))
    keep_off(strict, "couch", 0.9)
    with pytest.raises(PlanningError, match="if it keeps away from what it is to avoid"):
        strict.call(PRIMITIVES["move_to_object"], {"name": narrow.by_id(3), "instance": 1})
    with pytest.raises(PlanningError, match="then what is to be kept away from; 3 m were asked for"):
        strict.call(PRIMITIVES["turn_absolute"], {"angle_deg": 0.0})
        strict.call(PRIMITIVES["move_forward"], {"meters": 3.0})
    assert strict.path_length_m == 0.0


def test_what_is_to_be_avoided_is_not_gone_to_and_not_stood_at(two_rooms) -> None:
    robot = Robot(two_rooms, planner_of(two_rooms, SHAPE), TOY_POSE)
    with pytest.raises(CommandError, match=r"already stands in the kitchen, which it is to keep away from"):
        keep_off(robot, robot.call(FUNCTIONS["room"], {"name": ""}))
    keep_off(robot, "couch")
    with pytest.raises(CommandError, match="is to keep away from the couch, and cannot go there too"):
        robot.call(PRIMITIVES["move_to_object"], {"name": "couch", "instance": 1})
    with pytest.raises(CommandError, match=r"already stands 1.3 m from the chair"):
        keep_off(Robot(two_rooms, planner_of(two_rooms, SHAPE), TOY_POSE), two_rooms.by_id(1), 2.0)


def test_a_way_that_is_told_is_the_way_that_is_driven(two_rooms) -> None:
    def tell(goal: object, begin: object = "") -> dict[str, Any]:
        robot = Robot(two_rooms, planner_of(two_rooms, SHAPE), TOY_POSE)
        robot.call(FUNCTIONS["tell"], {"value": goal, "kind": "way", "other": begin, "key": ""})
        assert robot.path_length_m == 0.0 and robot.pose == TOY_POSE and robot.answer is not None
        return dict(robot.answer)

    driven = run(two_rooms, TOY_POSE, "move_to_object", "couch")
    told = tell("couch")
    assert told["value"] == pytest.approx(driven.path_length_m, abs=1e-3) and told["instances"] == [5]
    said = f"The way to the couch is {driven.path_length_m:.1f} m long through the kitchen and room 2: straight on, "
    assert told["text"].startswith(said)
    length_m = driven.path_length_m
    driven.call(PRIMITIVES["move_to_object"], {"name": "potted plant", "instance": 1})
    assert tell("potted plant", "couch")["value"] == pytest.approx(driven.path_length_m - length_m, abs=1e-3)
