"""Program text for places no single primitive drives to: in front of a thing, behind it, at its corner, 3 m off.

"In front of" is the side of the map's four towards where the command was given, "behind" the opposite one.
"""

from collections.abc import Callable
from typing import Final

from simaps_viz.language.meanings import Thing

START: Final = 'start = robot.get_pos("robot")'
CORNER_M: Final = 0.6
"""From the corner of a thing's outline to where the robot stops beside it, along x and along y."""
_COMPASS: Final = {"north": (0, 1), "south": (0, -1), "east": (1, 0), "west": (-1, 0)}
Fresh = Callable[[str], str]


def facing_side(thing: Thing, away: bool, fresh: Fresh) -> list[str]:
    """Drive to the side of a thing that faces the start, or the one away from it."""
    at, dx, dy = fresh("at"), fresh("dx"), fresh("dy")
    sides = ("west", "east", "south", "north") if away else ("east", "west", "north", "south")
    east, west, north, south = (f"robot.move_{side}({thing.arguments})" for side in sides)
    return [
        START,
        f"{at} = robot.get_pos({thing.arguments})",
        f"{dx} = start[0] - {at}[0]",
        f"{dy} = start[1] - {at}[1]",
        f"if {dx} * {dx} > {dy} * {dy}:",
        f"    if {dx} > 0:",
        f"        {east}",
        "    else:",
        f"        {west}",
        "else:",
        f"    if {dy} > 0:",
        f"        {north}",
        "    else:",
        f"        {south}",
    ]


def off(thing: Thing, side: str, distance: str, fresh: Fresh) -> list[str]:
    """Drive to a point some metres from the middle of a thing, to a side, towards the start or away from it."""
    at = fresh("at")
    lines = [f"{at} = robot.get_pos({thing.arguments})"]
    if side in _COMPASS:
        x, y = (_plus(f"{at}[{i}]", distance, _COMPASS[side][i]) for i in (0, 1))
        return [*lines, f"robot.move_to([{x}, {y}])"]
    dx, dy, square, far, turn = (fresh(name) for name in ("dx", "dy", "square", "distance", "turn"))
    lines += [
        START,
        f"{dx} = {at}[0] - start[0]",
        f"{dy} = {at}[1] - start[1]",
        f"{square} = {dx} * {dx} + {dy} * {dy} + 0.000001",
        f"{far} = {square} / 2 + 0.5",
        f"for {turn} in [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]:",
        f"    {far} = ({far} + {square} / {far}) / 2",
    ]
    ahead = {"left": (f"-{dy}", dx), "right": (dy, f"-{dx}"), "front": (f"-{dx}", f"-{dy}"), "behind": (dx, dy)}[side]
    x, y = (f"{at}[{i}] + {ahead[i]} * {distance} / {far}" for i in (0, 1))
    return [*lines, f"robot.move_to([{x}, {y}])"]


def halfway(thing: Thing, fresh: Fresh) -> list[str]:
    """Drive to the middle of the line from where the robot stands to the middle of a thing."""
    at, here = fresh("at"), fresh("here")
    x, y = (f"({here}[{i}] + {at}[{i}]) / 2" for i in (0, 1))
    lines = [f"{at} = robot.get_pos({thing.arguments})", f'{here} = robot.get_pos("robot")']
    return [*lines, f"robot.move_to([{x}, {y}])"]


def corner(thing: Thing, heading_deg: float, fresh: Fresh) -> list[str]:
    """Drive beside the corner of a thing's outline that lies north-east, south-east, south-west or north-west."""
    north, east = heading_deg < 90.0 or heading_deg > 270.0, heading_deg < 180.0
    x, y, point = fresh("x"), fresh("y"), fresh("point")
    return [
        f"{x} = robot.get_pos({thing.arguments})[0]",
        f"{y} = robot.get_pos({thing.arguments})[1]",
        f"for {point} in robot.get_contour({thing.arguments}):",
        f"    if {point}[0] {'>' if east else '<'} {x}:",
        f"        {x} = {point}[0]",
        f"    if {point}[1] {'>' if north else '<'} {y}:",
        f"        {y} = {point}[1]",
        f"robot.move_to([{x} {'+' if east else '-'} {CORNER_M}, {y} {'+' if north else '-'} {CORNER_M}])",
    ]


def _plus(what: str, distance: str, times: int) -> str:
    return what if times == 0 else f"{what} {'+' if times > 0 else '-'} {distance}"
