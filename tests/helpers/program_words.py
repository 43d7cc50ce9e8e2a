"""Shared by the tests of language and others."""

from random import Random

from simaps_viz.language.primitives import CHOICES, FUNCTIONS, PRIMITIVES, Parameter

VALID = (
    "robot.move_to_object('chair', 2)",
    "x = robot.get_pos('robot')\nrobot.move_forward(0.5)\nrobot.move_to(x)",
    "for c in robot.instances('chair'):\n    robot.face('chair', c)\n    robot.turn(-90)",
    "if robot.in_view('couch'):\n    robot.move_to_left('couch')\nelif 1 < 2 <= 3 and not 4 == 5:\n    robot.turn(90)\n"
    "else:\n    robot.turn_absolute(heading)",
    "t = robot.nth_from('dining table', \"left\", 1)\nrobot.move_north('dining table', instance=t)",
    "p = robot.get_contour('couch')[-1]\nrobot.move_to([p[0] + 0.5, (p[1] - 1) / 2 * 2])",
    "robot.move_in_between('chair', name_b='couch', instance_a=1)",
    "n = 1\nfor a in [1, 2.5, [3, 'x']]:\n    for b in [a, n]:\n        n = n * 2\nrobot.turn(n)  # done",
    "robot.face('chair', robot.closest_to('chair', robot.between('chair', 'couch', 'dining table')))",
    "robot.move_to_object(nth(order(side(things('chair'), 'left'), 'far'), 1))\ntell(near('seat', 'couch'), 'what')",
    "for t in without('dining table', 'tv'):\n    if distance(t) < 3 and count(near('chair', t)) > 0:\n"
    "        robot.face(t)\n        robot.move_to(spot(t, 'front', 0.5))",
)

_NAMES = ("chair", "couch", "dining table", "seat", "anything", "piano", "robot", "map", "other", "kitchen")
_MAKES = {
    "things": ("instances", "instances", "instance"),
    "target": ("instances", "instance", "position"),
    "label": ("instances", "instance"),
    "object": ("instances", "instance"),
    "instance": ("instance", "number"),
    "position": ("position",),
    "number": ("number",),
    "value": ("instances", "instance", "number", "position", "positions"),
}


def random_program(r: Random) -> str:
    """Return a program of functions, nested at random, that is mostly valid."""
    lines = ["x = things('anything')"]
    for _ in range(r.randint(1, 4)):
        kind = r.random()
        if kind < 0.45:
            lines.append(_call(r, f"robot.{r.choice(tuple(PRIMITIVES))}", 3))
        elif kind < 0.6:
            lines.append(f"x = {_made(r, r.choice(('instances', 'instances', 'instance')), 4)}")
        elif kind < 0.75:
            lines.append(
                f"for x in {_made(r, r.choice(('instances', 'positions')), 3)}:\n    {_call(r, 'robot.face', 2)}"
            )
        elif kind < 0.9:
            lines.append(_call(r, "tell", 4))
        else:
            lines.append(f"if {_made(r, 'number', 2)} > {r.randint(0, 3)}:\n    {_call(r, 'tell', 2)}")
    return "\n".join(lines)


def _call(r: Random, name: str, depth: int) -> str:
    call = PRIMITIVES[name.removeprefix("robot.")] if name.startswith("robot.") else FUNCTIONS[name]
    given = [p for p in call.parameters if p.required or r.random() < 0.5]
    return f"{name}({', '.join(f'{p.name}={_argument(r, p, depth)}' for p in given)})"


def _made(r: Random, result: str, depth: int) -> str:
    names = [name for name, function in FUNCTIONS.items() if function.result == result]
    return _call(r, r.choice(names), depth - 1)


def _argument(r: Random, parameter: Parameter, depth: int) -> str:
    if r.random() < 0.02:
        return r.choice(("x", "-1", "1e6", "''", "[]", "[1, 2]", "True", "x[0]"))
    if parameter.type in CHOICES:
        return repr(r.choice(CHOICES[parameter.type]))
    if parameter.type in ("count", "rank") or (parameter.type in ("number", "instance") and r.random() < 0.7):
        return str(r.choice((1, 1, 1, 1, 2, 2, 3)) if r.random() < 0.9 else r.choice((-1, 0.5, 40)))
    if parameter.type not in _MAKES or depth <= 0 or r.random() < 0.3:
        return (
            "x"
            if parameter.type in _MAKES and r.random() < 0.4
            else repr(r.choice(_NAMES if r.random() < 0.3 else _NAMES[:5]))
        )
    return _made(r, r.choice(_MAKES[parameter.type]), depth)


WORDS = (
    *(f"robot.{name}(" for name in PRIMITIVES),
    *(f"{name}(" for name in FUNCTIONS),
    *(
        "robot",
        ".",
        "(",
        ")",
        "[",
        "]",
        "{",
        "}",
        ",",
        ":",
        "=",
        "\n",
        "\n    ",
        "\n        ",
        "    ",
        ";",
        "\\\n",
        "#",
    ),
    *("for ", " in ", "if ", "elif ", "else:", "and ", "or ", "not ", "True", "False", "None", "x", "y", "chair", "_"),
    *("'chair'", '"couch"', "'left'", "'piano'", "''", "'", '"""', "f'{x}'", "b'x'", "'\\ud800'", "'\\n'"),
    *("0", "1", "2", "-1", "1.5", "1e999", "1e6", "1j", "0x1f", "9" * 30, "1_0", "..."),
    *(
        "+",
        "-",
        "*",
        "/",
        "//",
        "%",
        "**",
        "@",
        "~",
        "<<",
        "|",
        "<",
        ">",
        "<=",
        "==",
        "!=",
        ":=",
        "->",
        "+=",
        "is ",
        "*x",
    ),
    *(
        "import os",
        "from os import *",
        "lambda: ",
        "def f():",
        "class A:",
        "while ",
        "try:",
        "except:",
        "with ",
        "del ",
    ),
    *("match x:", "case _:", "async ", "await ", "yield ", "return ", "global x", "assert ", "raise ", "pass", "break"),
    *(
        "__import__",
        ".__class__",
        "eval(",
        "getattr(",
        "instance=",
        "**{}",
        "x=",
        "ｘ",
        "о",
        "\u202e",
        "\x00",
        "\x0c",
        "\r",
    ),
)
