"""The 23 primitives of a robot program: their names, parameters, kinds and exact meaning.

Words used below:

- The *viewer* is the robot as it stood when the command was given; ranks, left and right are the viewer's.
- A *name* is a class of the map, a synonym of one ("sofa" for couch), or a generic word that takes the instances of
  several classes together ("seat"; "any table" where a class is called exactly "table").
- *In view* is what lies within 45 degrees of where the viewer looks and is reached by a free line of sight from its
  camera (as high over the floor as the one the map was recorded with) to the top of one of the object's cells; walls,
  and whatever is high enough to stand in that line, hide it: see ``sight``.
- The distance to an instance is that from the viewer's position to the centre of the instance's nearest cell,
  in a straight line; 1 is the closest, ties go to the smaller id.
- A *side* of an object is a direction: north is +y, east is +x; *left* is a quarter turn counter-clockwise from the
  direction viewer -> centroid of the object, *right* a quarter turn clockwise.
- The point beside an object lies on the ray from its centroid along the side, at (extent of its cells along the side)
  + robot radius + 0.3 m. The robot stops in the free, reachable cell nearest to that point that is still within
  45 degrees of the side and 1.5 m of the point.
"""

from dataclasses import dataclass
from typing import Any, Final, Literal

from simaps_viz.language.lexicon import load

Kind = Literal["motion", "goal", "lookup"]
Type = Literal["label", "instance", "object", "number", "count", "side", "position"]
"""What an argument may be.

``label``: a class name. ``instance``: a rank (whole number from 1) or an instance a look-up gave. ``object``: a class
name (its closest instance is meant) or an instance a look-up gave. ``count``: a whole number from 1. ``position``: a
list of two numbers [x, y], metres, map frame.
"""
Result = Literal["nothing", "instance", "instances", "position", "positions"]

REQUIRED: Final = object()
SIDES: Final = ("left", "right", "north", "south", "east", "west")
SELF: Final = "robot"
"""``get_pos("robot")`` is where the robot stands now; no class of a map is called so."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a primitive."""

    name: str
    type: Type
    default: Any = REQUIRED

    @property
    def required(self) -> bool:
        """Return whether a call must give it."""
        return self.default is REQUIRED


@dataclass(frozen=True)
class Primitive:
    """One call a program can make on ``robot``."""

    name: str
    kind: Kind
    parameters: tuple[Parameter, ...]
    meaning: str
    result: Result = "nothing"

    @property
    def signature(self) -> str:
        """Return e.g. ``robot.face(name, instance=1)``."""
        words = [p.name if p.required else f"{p.name}={p.default!r}" for p in self.parameters]
        return f"robot.{self.name}({', '.join(words)})"


def _load_primitives() -> dict[str, Primitive]:
    return {
        name: Primitive(
            name, one["kind"], tuple(Parameter(**parameter) for parameter in one["parameters"]), one["meaning"],
            one["result"],
        )
        for name, one in load("primitives.json").items()
    }  # fmt: skip


PRIMITIVES: Final = _load_primitives()
"""All 23, by name; those of ``primitives.json``."""
