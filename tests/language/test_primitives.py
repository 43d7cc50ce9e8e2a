"""The table of primitives says the same as the design, and the robot has every one of them."""

import inspect

from simaps_viz.language.primitives import PRIMITIVES, SIDES
from simaps_viz.navigation.robot import Robot

SIGNATURES = """
move_to(pos)
move_forward(meters)
turn(angle_deg)
turn_absolute(angle_deg)
face(name, instance)
with_object_on_left(name, instance)
with_object_on_right(name, instance)
move_to_object(name, instance)
move_to_nth_closest(name, n)
move_to_left(name, instance)
move_to_right(name, instance)
move_in_between(name_a, name_b, instance_a, instance_b)
move_north(name, instance)
move_south(name, instance)
move_east(name, instance)
move_west(name, instance)
get_pos(name, instance)
get_contour(name, instance)
instances(name)
nth_from(name, side, n)
closest_to(name, other, instance)
between(name, other_a, other_b)
in_view(name)
"""


def test_the_23() -> None:
    assert [f"{p.name}({', '.join(q.name for q in p.parameters)})" for p in PRIMITIVES.values()] == SIGNATURES.split(
        "\n"
    )[1:-1]
    assert len(PRIMITIVES) == 23
    kinds = [p.kind for p in PRIMITIVES.values()]
    assert (kinds.count("motion"), kinds.count("goal"), kinds.count("lookup")) == (7, 9, 7)
    assert SIDES == ("left", "right", "north", "south", "east", "west")


def test_only_look_ups_give_something_and_all_say_what_they_mean() -> None:
    for primitive in PRIMITIVES.values():
        assert (primitive.result != "nothing") == (primitive.kind == "lookup"), primitive.name
        assert primitive.meaning.endswith(".")
        assert primitive.signature.startswith(f"robot.{primitive.name}(")


def test_the_robot_takes_the_parameters_of_every_primitive() -> None:
    for name, primitive in PRIMITIVES.items():
        taken = list(inspect.signature(getattr(Robot, f"_{name}")).parameters)[1:]
        assert taken == [parameter.name for parameter in primitive.parameters]


def test_instances_left_out_are_the_closest() -> None:
    for primitive in PRIMITIVES.values():
        for parameter in primitive.parameters:
            if parameter.type == "instance":
                assert parameter.default == (None if parameter.name == "instance_b" else 1)
