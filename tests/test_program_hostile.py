"""Programs that mean harm, or only nonsense: each is refused or stopped, none reaches Python."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_maps import TOY_POSE, toy_map

from simaps_viz.errors import CommandError
from simaps_viz.language.primitives import PRIMITIVES
from simaps_viz.language.program import parse_program
from simaps_viz.navigation.agent import answer

NEST = "".join(" " * i + f"for x{i} in robot.instances('chair'):\n" for i in range(9)) + " " * 9 + "robot.turn(1)"
REFUSED = {
    "import": "import os\nrobot.turn(1)",
    "from import": "from os import system",
    "dunder import": "__import__('os').system('true')",
    "dunder attribute": "robot.__class__.__bases__",
    "dunder call": "robot.__init__('x')",
    "private method": "robot._turn(1)",
    "method of robot that is no primitive": "robot.take_poses()",
    "attribute of a result": "robot.turn(robot.get_pos('chair').imag)",
    "attribute of a string": "robot.turn('{}'.format(1))",
    "attribute walk": "x = robot.instances('chair')[0].__dict__",
    "eval": "eval('1')",
    "exec": "exec('robot.turn(1)')",
    "open": "open('/etc/hostname')",
    "getattr": "getattr(robot, 'turn')(1)",
    "print": "print(robot)",
    "range": "for i in range(10):\n    robot.turn(1)",
    "list comprehension": "x = [i for i in [1, 2]]",
    "generator": "x = (i for i in [1, 2])",
    "dict": "x = {1: 2}",
    "set": "x = {1, 2}",
    "lambda": "x = lambda: 1",
    "definition": "def f():\n    robot.turn(1)\nf()",
    "class": "class A:\n    pass",
    "decorator": "@robot.turn\ndef f(): pass",
    "f-string": "robot.face(f'{robot}')",
    "format spec f-string": "robot.face(f'{1:>1000000000}')",
    "huge power": "robot.turn(9**9**9)",
    "huge shift": "robot.turn(1 << 999999999)",
    "modulo string": "x = '%999999999d' % 1",
    "string times number": "robot.face('a' * 1000000000)",
    "list times number": "x = [1] * 1000000000",
    "string plus string": "robot.face('cha' + 'ir')",
    "huge number": "robot.turn(1000000000000)",
    "huge digits": "robot.turn(" + "9" * 9000 + ")",
    "infinity": "robot.turn(1e999)",
    "complex": "robot.turn(1j)",
    "bytes": "robot.face(b'chair')",
    "none": "robot.face('chair', None)",
    "ellipsis": "robot.turn(...)",
    "while": "while True:\n    robot.turn(1)",
    "while else": "while 1:\n    pass\nelse:\n    robot.turn(1)",
    "break": "for x in [1]:\n    break",
    "for else": "for x in [1]:\n    robot.turn(1)\nelse:\n    robot.turn(2)",
    "try": "try:\n    robot.turn(1)\nexcept:\n    robot.turn(2)",
    "with": "with robot:\n    robot.turn(1)",
    "raise": "raise robot",
    "assert": "assert robot",
    "del": "x = 1\ndel x",
    "global": "global x\nx = 1",
    "walrus": "robot.turn((x := 1))",
    "augmented": "x = 1\nx += 1",
    "unpacking": "x, y = robot.get_pos('chair')",
    "two targets": "x = y = 1",
    "assign to robot": "robot = 1",
    "assign to attribute": "robot.turn = 1",
    "assign to item": "x = [1]\nx[0] = x",
    "loop over robot": "for robot in [1]:\n    robot.turn(1)",
    "starred": "robot.turn(*[1])",
    "double starred": "robot.turn(**[1])",
    "ternary": "robot.turn(1 if 1 else 2)",
    "is": "if 1 is 1:\n    robot.turn(1)",
    "in": "if 1 in [1]:\n    robot.turn(1)",
    "invert": "robot.turn(~1)",
    "match": "match 1:\n    case 1:\n        robot.turn(1)",
    "await": "await robot.turn(1)",
    "yield": "yield robot",
    "annotation": "x: int = 1",
    "docstring": "'robot.turn(1)'",
    "cyrillic o": "rоbot.turn(1)",
    "wide letters fold to robot": "ｒｏｂｏｔ.turn(1)",
    "wide letters in a primitive": "robot.ｔｕｒｎ(1)",
    "wide letters in a name": "ｘ = 1",
    "null byte": "robot.turn(1)\x00",
    "lone surrogate": "robot.face('\ud800')",
    "bad escape": "robot.face('\\N{NOT A NAME}')",
    "deep parentheses": "robot.turn(" + "(" * 150 + "1" + ")" * 150 + ")" * 1 + "[0]" * 150,
    "deep parentheses, unclosed": "(" * 9000,
    "deep minus": "robot.turn(" + "-" * 5000 + "1)",
    "deep lists": "x = " + "[" * 90 + "]" * 90,
    "long sum": "robot.turn(" + "1+" * 4000 + "1)",
    "deep loops": "".join(" " * i + "for a in [1]:\n" for i in range(90)) + " " * 90 + "robot.turn(1)",
    "deep elif": "if 0:\n robot.turn(1)\n" + "elif 0:\n robot.turn(1)\n" * 200,
    "long string": "robot.face('" + "a" * 101 + "')",
    "long program": "robot.turn(1)\n" * 1000,
    "unknown object in a branch never taken": "if 1 > 2:\n    robot.move_to_object('piano')",
    "rank in a branch never taken": "if 1 > 2:\n    robot.move_to_object('chair', 99)",
    "whole turn of the screw": "robot.turn(999999)",
    "outside the map": "robot.move_to([99999, 99999])",
    "computed rank": "x = 1\nrobot.move_to_object('chair', x - 1)",
}
STOPPED = {
    "many loops": NEST,
    "back and forth": "for a in robot.get_contour('couch'):\n    for b in robot.get_contour('couch'):\n"
    "        robot.move_to_object('chair', 1)\n        robot.move_to_object('chair', 3)",
    "through the wall": "robot.move_forward(1000)",
}


@pytest.fixture(scope="module")
def simap():
    return toy_map()


@pytest.mark.parametrize("program", REFUSED.values(), ids=REFUSED.keys())
def test_refused(simap, program: str) -> None:
    said = answer(simap, "", TOY_POSE, program=program)
    assert said.status == "refused"
    assert said.reason and "\n" not in said.reason and len(said.reason) < 600
    assert "line " in said.reason or said.reason.startswith("program: ")
    assert said.path_length_m == 0.0
    assert said.goals == ()
    assert said.final_pose == TOY_POSE


@pytest.mark.parametrize("program", STOPPED.values(), ids=STOPPED.keys())
def test_stopped(simap, program: str) -> None:
    said = answer(simap, "", TOY_POSE, program=program)
    assert said.status == "failed"
    assert said.path_length_m <= 1000.0


def test_values_cannot_grow_without_end(simap) -> None:
    """Lists that hold themselves twice double at every turn; nothing may ever walk them."""
    program = "x = [1]\nfor a in robot.get_contour('couch'):\n    x = [x, x]\nif x:\n    robot.turn(90)"
    assert answer(simap, "", TOY_POSE, program=program).status == "ok"
    compared = program.replace("if x:", "y = [x, x]\nif y == x:")
    assert answer(simap, "", TOY_POSE, program=compared).status == "refused"


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=80))
def test_any_text_is_a_program_or_a_command_error(text: str) -> None:
    try:
        parse_program(text)
    except CommandError as error:
        assert "\n" not in str(error)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.builds(
            "{}robot.{}({})".format,
            st.sampled_from(["", "x = ", "for x in ", "if "]),
            st.sampled_from([*PRIMITIVES, "fly", "__class__"]),
            st.lists(st.sampled_from(["'chair'", "1", "x", "[1, 2]", "-1", "'left'", "n=2", "*x", "x[0]"])).map(
                ", ".join
            ),
        ),
        max_size=4,
    ).map("\n".join)
)
def test_pieces_of_programs_never_break_the_validator(text: str) -> None:
    try:
        parse_program(text)
    except CommandError as error:
        assert str(error).startswith(("line ", "program: "))
