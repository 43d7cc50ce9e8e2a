"""What the small Python means, and what its errors say."""

from collections.abc import Mapping
from typing import Any

import pytest

from simaps_viz.errors import CommandError, PlanningError
from simaps_viz.language.grounding import Things
from simaps_viz.language.interpreter import Budget, BudgetError, interpret
from simaps_viz.language.primitives import Primitive
from simaps_viz.language.program import ProgramError, ProgramStuckError, parse_program
from simaps_viz.structures import Instance


def _instance(number: int) -> Instance:
    return Instance(number, "chair", 4, (float(number), 0.0, 0.5), ((0, 0, 0), (1, 1, 1)), 1, 1.0)


class Spy:
    """Answers look-ups from a table and writes down every motion."""

    def __init__(self) -> None:
        self.did: list[tuple[str, tuple]] = []

    def __call__(self, primitive: Primitive, arguments: Mapping[str, Any]) -> Any:
        if primitive.kind != "lookup":
            self.did.append((primitive.name, tuple(arguments.values())))
            return None
        if primitive.result == "instances":
            found = () if arguments["name"] == "couch" else tuple(_instance(n) for n in (1, 2, 3))
            return Things(
                found, arguments["name"], f"{arguments['name']}s", after="in view" * (primitive.name == "in_view")
            )
        if primitive.result == "position":
            return [1.5, -2.0]
        if primitive.result == "positions":
            return [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
        return _instance(7)


def run(text: str, budget: Budget | None = None) -> list[tuple[str, tuple]]:
    spy = Spy()
    for _ in interpret(parse_program(text), spy, budget=budget):
        pass
    return spy.did


def lines(text: str) -> list[tuple[int, str]]:
    return [(turn.line, turn.phase) for turn in interpret(parse_program(text), Spy())]


@pytest.mark.parametrize(
    ("text", "turned"),
    [
        ("robot.turn(90)", [90]),
        ("robot.turn(angle_deg=-45.5)", [-45.5]),
        ("x = 1 + 2 * 3\nrobot.turn(x)", [7]),
        ("robot.turn(-(7 - 2) / 2)", [-2.5]),
        ("for x in [1, 2, 3]:\n    robot.turn(x * 10)", [10, 20, 30]),
        ("for x in []:\n    robot.turn(x)\nrobot.turn(9)", [9]),
        ("if 1 < 2 <= 2:\n    robot.turn(1)\nelse:\n    robot.turn(2)", [1]),
        (
            "if not 'a' == 'a':\n    robot.turn(1)\nelif 3 > 2 and 2 != 2:\n    x = 2\nelse:\n    robot.turn(3)",
            [3],
        ),
        ("if robot.instances('couch'):\n    robot.turn(1)\nelse:\n    robot.turn(2)", [2]),
        ("if robot.instances('chair') or 1:\n    robot.turn(1)", [1]),
        ("p = robot.get_pos('chair')\nrobot.turn(p[0] + p[1])", [-0.5]),
        ("x = [[1, 2], [3, 4]]\nrobot.turn(x[-1][0])", [3]),
        ("for p in robot.get_contour('chair'):\n    robot.turn(p[0])", [0, 1, 1]),
        ("if 1:\n    x = 1\nelse:\n    x = 2\nrobot.turn(x)", [1]),
        ("x = 1\nfor y in [1, 2, 3]:\n    x = x * 2\nrobot.turn(x)", [8]),
        ("# a comment\n\nrobot.turn(1); robot.turn(2)", [1, 2]),
        ("if False and robot.instances('chair')[99]:\n    robot.turn(1)\nrobot.turn(2)", [2]),
    ],
)
def test_values(text: str, turned: list[float]) -> None:
    assert run(text) == [("turn", (angle,)) for angle in turned]


def test_arguments_are_bound_and_defaults_filled() -> None:
    assert run("robot.move_to_object('chair')") == [("move_to_object", ("chair", 1))]
    assert run("robot.move_to_object(instance=3, name='chair')") == [("move_to_object", ("chair", 3))]
    assert run("robot.move_in_between('a', 'b')") == [("move_in_between", ("a", "b", 1, None))]
    assert run("robot.move_to_nth_closest('chair', 2.0)") == [("move_to_nth_closest", ("chair", 2))]
    assert run("robot.move_to([1, 2])") == run("robot.move_to((1, 2))") == [("move_to", ([1, 2],))]
    chosen = run("for c in robot.instances('chair'):\n    robot.face('chair', c)")
    assert [arguments[1].id for _, arguments in chosen] == [1, 2, 3]
    assert run("robot.face('chair', robot.nth_from('chair', 'left', 1))")[0][1][1].id == 7


def test_it_stops_before_and_after_every_statement() -> None:
    assert lines("robot.turn(1)\nx = 2") == [(1, "before"), (1, "after"), (2, "before"), (2, "after")]
    loop = lines("for x in [1, 2]:\n    robot.turn(x)\nrobot.turn(3)")
    body = [(2, "before"), (2, "after")]
    assert loop == [(1, "before"), *body, *body, (1, "after"), (3, "before"), (3, "after")]


def test_dropping_the_generator_stops_the_program() -> None:
    spy = Spy()
    turns = interpret(parse_program("robot.turn(1)\nrobot.turn(2)"), spy)
    assert next(turns).phase == "before"
    assert spy.did == []
    next(turns)
    turns.close()
    assert spy.did == [("turn", (1,))]


def test_every_statement_is_a_step_also_inside_for_and_if() -> None:
    text = "for c in [1, 2]:\n    if c == 2:\n        robot.turn(c)\n    else:\n        x = c\nrobot.turn(9)"
    steps = [(line, phase == "after") for line, phase in lines(text)]
    first = [(2, False), (5, False), (5, True), (2, True)]
    second = [(2, False), (3, False), (3, True), (2, True)]
    assert steps == [(1, False), *first, *second, (1, True), (6, False), (6, True)]


@pytest.mark.parametrize("taken", range(8))
def test_stopping_anywhere_in_a_loop_does_nothing_more(taken: int) -> None:
    spy = Spy()
    turns = interpret(parse_program("for x in [1, 2, 3]:\n    robot.turn(x)\nrobot.turn(9)"), spy)
    for _ in range(taken):
        next(turns)
    turns.close()
    done = [("turn", (x,)) for x in (1, 2, 3)][: max(0, (taken - 1) // 2)]
    assert spy.did == done
    assert next(turns, None) is None


def test_a_pause_costs_nothing_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("simaps_viz.language.interpreter.time.thread_time", lambda: now[0])
    for _ in interpret(parse_program("for x in [1, 2]:\n    robot.turn(x)"), Spy(), budget=Budget(seconds=1.0)):
        now[0] += 3600.0

    def slow(primitive: Primitive, _: Mapping[str, Any]) -> None:
        now[0] += 0.6

    with pytest.raises(BudgetError, match=r"^line 2: stopped: the program took more than 1 seconds of computing$"):
        list(interpret(parse_program("robot.turn(1)\nrobot.turn(2); robot.turn(3)"), slow, budget=Budget(seconds=1.0)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot.turn(1)\nrobot.fly(3)", "line 2: fly: not a primitive; there are: move_to, move_forward"),
        ("robot.turn()", r"line 1: turn: missing angle_deg; it is robot.turn\(angle_deg\)"),
        ("robot.turn(1, 2)", "line 1: turn: expected at most 1 arguments, found 2"),
        ("robot.turn(angle=1)", "line 1: turn: no parameter 'angle'"),
        ("robot.face('chair', name='chair')", "line 1: face: parameter 'name' given twice"),
        ("robot.turn('left')", "line 1: turn: angle_deg: expected a number, found 'left'"),
        ("robot.turn(True)", "line 1: turn: angle_deg: expected a number, found True"),
        (
            "robot.move_to_object(3)",
            "line 1: move_to_object: name: expected a name in quotes, a thing, a set or a room, found 3",
        ),
        ("robot.move_to_object('chair', 0)", "line 1: move_to_object: instance: expected a rank"),
        ("robot.move_to_object('chair', -1)", "line 1: move_to_object: instance: expected a rank"),
        ("robot.move_to_object('chair', 1.5)", "line 1: move_to_object: instance: expected a rank"),
        ("robot.move_to_object('')", "line 1: move_to_object: name: expected a name"),
        (
            "\n\nrobot.nth_from('chair', 'behind', 1)",
            "line 3: nth_from: side: expected one of 'left', 'right', 'north'",
        ),
        ("robot.move_to('chair')", "line 1: move_to: pos: expected a position"),
        (
            "robot.move_to(robot.instances('chair'))",
            "line 1: move_to: pos: expected a position .* found a set",
        ),
        (
            "robot.face(3 > 2)",
            "line 1: face: name: expected a name in quotes, a thing, a set or a room, found a truth value",
        ),
        ("x = nearest(things('chair'), 0)", "line 1: nearest: n: expected a whole number from 1, found 0"),
        (
            "x = nth(things('chair'), 0)",
            "line 1: nth: k: expected a whole number, from 1 or, from the end, from -1, found 0",
        ),
        ("x = side('chair', 'up')", "line 1: side: side: expected one of 'left', 'right', 'front', .*, found 'up'"),
        ("x = side('chair')", r"line 1: side: missing side; it is side\(S, side, of=''\)"),
        (
            "x = nearest(robot.get_pos('chair'))",
            "line 1: nearest: S: expected a set, a thing or a name in quotes, found a position",
        ),
        (
            "x = closest('chair')",
            "line 1: only calls of the form robot.primitive.* functions are: things, search, room,",
        ),
        ("things('chair').items", "line 1: a value that goes nowhere"),
        ("x = things('chair').items", "line 1: an attribute other than a call on robot"),
        ("x = count(things('chair'))[0]", "line 1: a number cannot be indexed"),
        (
            "if things('chair') == things('couch'):\n    robot.turn(1)",
            "line 1: sets, lists and positions cannot be compared",
        ),
        ("x = tell(things('chair'))", "line 1: a motion or tell gives no value"),
        ("robot.turn(x)", "line 1: 'x': no value on every way to this line"),
        ("if 1 > 2:\n    x = 1\nrobot.turn(x)", "line 3: 'x': no value on every way"),
        ("for x in [1]:\n    y = x\nrobot.turn(y)", "line 3: 'y': no value on every way"),
        ("x = robot.turn(1)", "line 1: a motion or tell gives no value"),
        ("robot.turn(1) + 2", "line 1: a value that goes nowhere is not allowed"),
        ("x = robot", "line 1: 'robot': robot is only there to be called"),
        ("for c in 3:\n    robot.turn(1)", "line 1: for goes over a set or a list, not over a number"),
        ("x = 3\nrobot.turn(x[0])", "line 2: a number cannot be indexed"),
        ("x = [1, 2][0:1]", "line 1: an index is a whole number"),
        ("robot.turn(", "line 1: this is not a program"),
        ("", "program: expected at least one line, found none"),
        ("# nothing", "program: expected at least one line, found none"),
    ],
)
def test_invalid_programs_are_refused_before_anything_runs(text: str, message: str) -> None:
    with pytest.raises(CommandError, match=f"^{message}"):
        parse_program(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = [1]\nrobot.turn(x[1])", "line 2: the 2nd item was asked for, but the list has 1"),
        ("c = robot.instances('couch')[0]", r"line 1: There is no couch on this map\."),
        ("c = robot.in_view('chair')[4]", "line 1: There are only 3 chairs in view; the 5th was asked for"),
        ("for c in robot.instances('couch'):\n    robot.turn(1)", r"line 1: There is no couch on this map\."),
        ("x = 1\nx = x / (x - 1)", "line 2: division by zero"),
        ("x = [1, 'a']\nrobot.turn(x[1])", "line 2: turn: angle_deg: expected a number"),
        ("x = ['a', 1]\ny = x[0] + 1", "line 2: arithmetic is for numbers, found a string"),
        ("x = [1, 'a']\nif x[0] < x[1]:\n    robot.turn(1)", "line 2: only numbers have an order"),
        ("x = [1]\nif x[0.5]:\n    robot.turn(1)", "line 2: an index is a whole number"),
        ("x = [[1, 2, 3]]\nrobot.move_to(x[0])", "line 2: move_to: pos: expected a position .*, found a list"),
        ("x = 10\nfor y in [1, 2, 3, 4, 5, 6]:\n    x = x * x\n", "line 3: a number grew too large"),
    ],
)
def test_errors_while_running_name_the_line(text: str, message: str) -> None:
    with pytest.raises(ProgramError, match=f"^{message}") as error:
        run(text)
    assert error.value.line == int(str(error.value).split(":")[0].removeprefix("line "))


def test_errors_of_primitives_get_line_and_name() -> None:
    def refuse(*_: Any) -> None:
        raise CommandError("There is no piano.")

    def stuck(*_: Any) -> None:
        raise PlanningError("no way")

    program = parse_program("\nrobot.move_to_object('piano')")
    with pytest.raises(ProgramError) as refused:
        list(interpret(program, refuse))
    assert str(refused.value) == "line 2: move_to_object: There is no piano."
    assert refused.value.message == "There is no piano."
    with pytest.raises(ProgramStuckError) as failed:
        list(interpret(program, stuck))
    assert str(failed.value) == "line 2: move_to_object: no way"
    assert isinstance(failed.value, PlanningError)


def test_budgets() -> None:
    loop = "for x in [1, 2, 3, 4]:\n    for y in [1, 2, 3, 4]:\n        robot.turn(1)"
    assert len(run(loop, Budget(loop_turns=20))) == 16
    with pytest.raises(BudgetError, match="line 2: stopped: the program took more than 19 loop turns"):
        run(loop, Budget(loop_turns=19))
    with pytest.raises(BudgetError, match="more than 50 steps"):
        run(loop, Budget(steps=50))
    with pytest.raises(BudgetError, match="seconds of computing"):
        run(loop, Budget(seconds=-1.0))
