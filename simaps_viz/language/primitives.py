"""The calls of a robot program: the 23 primitives on ``robot``, and the functions that make sets of things.

Their names, parameters and meanings lie in ``primitives.json`` and ``functions.json``; validation, the interpreter and
the prompt of a language model all read them there. Every look-up and function is evaluated when its line runs, from
where the robot is then.
"""

import ast
from dataclasses import dataclass
from typing import Any, Final, Literal

from simaps_viz.language.words import load

Kind = Literal["motion", "goal", "lookup", "function"]
Result = Literal["nothing", "instance", "instances", "position", "positions", "number"]

REQUIRED: Final = object()
_FUNCTIONS: Final = load("functions.json")
CHOICES: Final[dict[str, tuple[str, ...]]] = {kind: tuple(words) for kind, words in _FUNCTIONS["words"].items()}
"""{type of a parameter: the words it may be}."""
SIDES: Final = CHOICES["side"]
SAID: Final[dict[str, Any]] = _FUNCTIONS["said"]
"""How sides, places, orders and sizes are called in sentences."""
ARGUMENT_KINDS: Final[dict[str, str]] = {
    "label": "a name in quotes, a thing, a set or a room",
    "object": "a name in quotes, a thing or a set",
    "things": "a set, a thing or a name in quotes",
    "target": "a set, a thing, a room or a name in quotes",
    "text": "words in quotes",
    "number": "a number",
    "count": "a whole number from 1",
    "rank": "a whole number, from 1 or, from the end, from -1",
    "instance": "a rank (whole number from 1), a thing or a set",
    "position": "a position [x, y]",
    "value": "any value",
    **{kind: f"one of {', '.join(repr(word) for word in words)}" for kind, words in CHOICES.items()},
}
"""{type of a parameter: what it takes, in words}. A rank counts from the closest; of a name, its closest thing is
meant; positions are in metres, map frame."""
RANK_OF: Final = {"instance": "name", "n": "name", "instance_a": "name_a", "instance_b": "name_b"}
"""{parameter that is a rank: parameter that says of what}; with closest_to, ``instance`` ranks ``other``."""
SELF: Final = "robot"
"""``get_pos("robot")`` is where the robot stands now; no class of a map is called so."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a call; its type is a key of ``ARGUMENT_KINDS``."""

    name: str
    type: str
    default: Any = REQUIRED

    @property
    def required(self) -> bool:
        """Return whether a call must give it."""
        return self.default is REQUIRED


@dataclass(frozen=True)
class Primitive:
    """One call a program can make: on ``robot``, or of a function."""

    name: str
    kind: Kind
    parameters: tuple[Parameter, ...]
    meaning: str
    result: Result = "nothing"
    typed: str = ""
    """The signature with the types of its parameters."""

    @property
    def signature(self) -> str:
        """Return e.g. ``robot.face(name, instance=1)`` or ``nearest(S, n=1, of='')``."""
        words = [p.name if p.required else f"{p.name}={p.default!r}" for p in self.parameters]
        return f"{'' if self.kind == 'function' else 'robot.'}{self.name}({', '.join(words)})"


def _primitive(typed: str, meaning: str, kind: Kind = "function") -> Primitive:
    """Read one from its signature: "face(name: label, instance: instance = 1)", "count(S: things) -> number"."""
    read = ast.parse(f"def {typed}: ...").body[0]
    assert isinstance(read, ast.FunctionDef), typed
    defaults = [REQUIRED] * (len(read.args.args) - len(read.args.defaults)) + [
        ast.literal_eval(default) for default in read.args.defaults
    ]
    names = [(one.arg, ast.unparse(one.annotation or one)) for one in read.args.args]
    parameters = tuple(Parameter(*one, default) for one, default in zip(names, defaults, strict=True))
    result: Any = ast.unparse(read.returns) if read.returns else "nothing"
    return Primitive(read.name, kind, parameters, meaning, result, typed)


_READ: Final = [
    _primitive(typed, meaning, kind)
    for kind, ones in load("primitives.json").items()
    for typed, meaning in ones.items()
]
PRIMITIVES: Final = {one.name: one for one in _READ}
"""All 23, by name; those of ``primitives.json``."""
FUNCTIONS: Final = {one.name: one for one in (_primitive(*pair) for pair in _FUNCTIONS["functions"].items())}
"""All functions, by name; those of ``functions.json``."""
