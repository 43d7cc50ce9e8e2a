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


_NAME = Parameter("name", "label")
_INSTANCE = Parameter("instance", "instance", 1)


def _of_object(name: str, kind: Kind, meaning: str, result: Result = "nothing") -> Primitive:
    return Primitive(name, kind, (_NAME, _INSTANCE), meaning, result)


_ALL = (
    Primitive(
        "move_to",
        "motion",
        (Parameter("pos", "position"),),
        "Drive to the free, reachable cell nearest to the position [x, y] (at most 1.5 m from it or its object).",
    ),
    Primitive(
        "move_forward",
        "motion",
        (Parameter("meters", "number"),),
        "Drive straight ahead (negative: straight back) by that many metres; fails if anything is in the way.",
    ),
    Primitive(
        "turn",
        "motion",
        (Parameter("angle_deg", "number"),),
        "Turn on the spot by that many degrees; positive turns right (clockwise seen from above).",
    ),
    Primitive(
        "turn_absolute",
        "motion",
        (Parameter("angle_deg", "number"),),
        "Turn on the spot to a compass heading: 0 north, 90 east, 180 south, 270 west.",
    ),
    _of_object("face", "motion", "Turn on the spot until the object's centroid is straight ahead."),
    _of_object("with_object_on_left", "motion", "Turn on the spot until the object's centroid is exactly on the left."),
    _of_object(
        "with_object_on_right", "motion", "Turn on the spot until the object's centroid is exactly on the right."
    ),
    _of_object(
        "move_to_object",
        "goal",
        "Drive to the reachable free cell nearest to the object's cells (ties: the shorter way), at most 1.5 m off.",
    ),
    Primitive(
        "move_to_nth_closest",
        "goal",
        (_NAME, Parameter("n", "count")),
        "As move_to_object, to the n-th closest instance; 1 is the closest to where the command was given.",
    ),
    _of_object("move_to_left", "goal", "Drive to the point beside the object, on its left as the viewer sees it."),
    _of_object("move_to_right", "goal", "Drive to the point beside the object, on its right as the viewer sees it."),
    Primitive(
        "move_in_between",
        "goal",
        (
            Parameter("name_a", "label"),
            Parameter("name_b", "label"),
            Parameter("instance_a", "instance", 1),
            Parameter("instance_b", "instance", None),
        ),
        "Drive to the middle of the gap on the line between the two centroids; instance_b left out is the closest of "
        "name_b other than a.",
    ),
    _of_object("move_north", "goal", "Drive to the point beside the object, north of it on the map."),
    _of_object("move_south", "goal", "Drive to the point beside the object, south of it on the map."),
    _of_object("move_east", "goal", "Drive to the point beside the object, east of it on the map."),
    _of_object("move_west", "goal", "Drive to the point beside the object, west of it on the map."),
    _of_object(
        "get_pos",
        "lookup",
        'The object\'s centroid [x, y], metres; get_pos("robot") is where the robot stands now.',
        "position",
    ),
    _of_object("get_contour", "lookup", "The object's outline, a list of [x, y], metres, in order.", "positions"),
    Primitive("instances", "lookup", (_NAME,), "All instances of the class, the closest first.", "instances"),
    Primitive(
        "nth_from",
        "lookup",
        (_NAME, Parameter("side", "side"), Parameter("n", "count")),
        "The n-th instance of the class counted from a side, by centroids; left and right are the viewer's, "
        "all instances of the map count, also those behind.",
        "instance",
    ),
    Primitive(
        "closest_to",
        "lookup",
        (_NAME, Parameter("other", "object"), Parameter("instance", "instance", 1)),
        "The instance of the class whose cells come nearest to another object's, itself left out.",
        "instance",
    ),
    Primitive(
        "between",
        "lookup",
        (_NAME, Parameter("other_a", "object"), Parameter("other_b", "object")),
        "The instance of the class that lies between two objects: its centroid inside the circle over the line of "
        "their centroids, and nearest to that line; two equal class names mean the two closest instances.",
        "instance",
    ),
    Primitive(
        "in_view",
        "lookup",
        (_NAME,),
        "The instances of the class within the viewer's field of view (90 degrees) that no wall or high enough thing "
        "hides, closest first.",
        "instances",
    ),
)

PRIMITIVES: Final[dict[str, Primitive]] = {primitive.name: primitive for primitive in _ALL}
"""All 23, by name."""
