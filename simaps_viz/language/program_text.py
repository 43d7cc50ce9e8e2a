"""Program text for phrases that need several primitives: positions beside a thing, and things found by a search.

The text of a search counts and compares over ``instances``, ``in_view``, ``nth_from`` and ``get_pos``. Distances and
sides are those of centroids: left, right, in front (towards the viewer) and behind (away), seen from where the command
was given, within 60 degrees of that direction. As a place to drive to, "in front of" is that of the thing's four sides
which is turned to where the command was given, and "behind" the opposite one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

START: Final = 'start = robot.get_pos("robot")'
CORNER_M: Final = 0.6
"""From the corner of a thing's outline to where the robot stops beside it, along x and along y."""
NEAR_M: Final = 2.0
"""Centroids this close are near each other, where all things near another one are asked for."""
_NOTHING: Final = "1000000"
"""A squared distance no two things of a map have."""
_MAX_TEXT: Final = 90  # characters; a string of a program has at most 100
_COMPASS: Final = {"north": (0, 1), "south": (0, -1), "east": (1, 0), "west": (-1, 0)}
"""Unit vectors (x, y), map frame."""
_IN_WORDS: Final = {
    "left": "to the left of",
    "right": "to the right of",
    "north": "north of",
    "south": "south of",
    "east": "east of",
    "west": "west of",
    "front": "in front of",
    "behind": "behind",
    "near": "near",
}
Fresh = Callable[[str], str]
"""Returns a name that the program does not use yet, from a wish."""
Lines = tuple[str, ...]


@dataclass(frozen=True)
class Thing:
    """One thing, or each of several things in turn, as program text."""

    label: str
    which: str = ""
    """The instance; "" = the closest."""
    before: tuple[str, ...] = ()
    """Lines that have to run before ``which`` means anything."""
    loop: tuple[str, ...] = ()
    """Head of a loop that sets ``which`` to each thing in turn; empty for one thing."""
    indent: str = ""
    """The indent of the loop's body."""

    @property
    def arguments(self) -> str:
        """Return e.g. ``"chair", 3``."""
        return quoted(self.label) + (f", {self.which}" if self.which else "")

    @property
    def value(self) -> str:
        """Return program text for an instance, or a class name for its closest, where either may stand."""
        if not self.which:
            return quoted(self.label)
        if self.which.isdigit():
            return f"robot.instances({quoted(self.label)})[{int(self.which) - 1}]"
        return self.which

    @property
    def in_words(self) -> str:
        """Return its name in a sentence."""
        return f"the {self.label}"


def quoted(label: str) -> str:
    """Return a label as a string of a program; quotes and backslashes cannot leave it."""
    plain = "".join(c for c in label if c.isprintable() and c not in '"\\')
    return f'"{plain}"'


def tidy(number: float) -> str:
    """Return a number as program text without needless digits: 2.0 -> "2"."""
    return f"{round(number, 6):.6f}".rstrip("0").rstrip(".")


# ---- places


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


# ---- searches


@dataclass(frozen=True)
class Relation:
    """How a thing lies to another: a side, "front", "behind", "near", or "between" two."""

    kind: str
    things: tuple[Thing, ...]

    @property
    def in_words(self) -> str:
        """Return e.g. "to the left of the couch"."""
        if self.kind == "between":
            return f"between {self.things[0].in_words} and {self.things[1].in_words}"
        return f"{_IN_WORDS[self.kind]} {self.things[0].in_words}"


@dataclass(frozen=True)
class Wanted:
    """The target of a search; see ``selection.Selection``."""

    label: str
    variable: str
    order: str
    rank: int
    """From 1; of a loop: how many, 0 = all."""
    side: str
    other: Thing | None
    in_view: bool
    relations: tuple[Relation, ...]

    @property
    def source(self) -> str:
        """Return the look-up that lists the candidates, the closest first."""
        return f"robot.{'in_view' if self.in_view else 'instances'}({quoted(self.label)})"

    @property
    def in_words(self) -> str:
        """Return e.g. "chair to the left of the couch"."""
        words = [self.label, *(relation.in_words for relation in self.relations)]
        return " ".join([*words, "in view"] if self.in_view else words)


def pick(wanted: Wanted, fresh: Fresh) -> Lines:
    """Return lines that set ``wanted.variable`` to the thing, or refuse by name when there is none."""
    if wanted.order in ("to", "from"):
        return _by_distance(wanted, fresh)
    count, item = fresh("count"), fresh("candidate")
    test, places = _test(wanted, item, fresh)
    body = [
        *test[0],
        f"if {test[1]}:",
        f"    {count} = {count} + 1",
        f"    if {count} == {wanted.rank}:" if wanted.order != "far" else f"    if {count} >= {wanted.rank}:",
        f"        {wanted.variable} = {item}",
    ]
    guard = f"{wanted.variable} = {wanted.source}[{wanted.rank - 1}]"
    head, indent = _candidates(wanted, item, fresh)
    refusal = _refusal(wanted, f"{count} < {wanted.rank}", fresh)
    return (*places, guard, f"{count} = 0", *head, *_indented(indent, body), *refusal)


def _by_distance(wanted: Wanted, fresh: Fresh) -> Lines:
    """Go over the candidates ``rank`` times, each time finding the next one by distance to the other thing."""
    lines, places = _passes(wanted, wanted.rank, fresh)
    return (*places, f"{wanted.variable} = {wanted.source}[0]", *lines)


def _passes(wanted: Wanted, turns: int, fresh: Fresh) -> tuple[list[str], list[str]]:
    # Every pass finds the candidate with the smallest distance greater than that of the last pass.
    item, last, best, at, far = (fresh(name) for name in ("candidate", "last", "best", "at", "distance"))
    (test_lines, test), places = _test(wanted, item, fresh, at=at)
    assert wanted.other is not None
    place = _place_of(wanted.other, places, fresh)
    first = ""
    if wanted.order == "to" and turns > 1 and not wanted.relations and not wanted.in_view:
        # closest_to measures between cells, this search between centroids: the first is always the former's.
        first = fresh("first")
        arguments = wanted.other.arguments if wanted.other.which.isdigit() else wanted.other.value
        places.append(f"{first} = robot.closest_to({quoted(wanted.label)}, {arguments})")
        test = f"{item} != {first} and {test}" if test != "True" else f"{item} != {first}"
        turns -= 1
    sign = "-" if wanted.order == "from" else ""
    square = f"({at}[0] - {place}[0]) * ({at}[0] - {place}[0]) + ({at}[1] - {place}[1]) * ({at}[1] - {place}[1])"
    apart = _not_itself(wanted)
    inner = [
        f"{at} = robot.get_pos({quoted(wanted.label)}, {item})",
        f"{far} = {sign}({square})" if sign else f"{far} = {square}",
        *test_lines,
        f"if {far} > {last} and {far} < {best}{apart(far)}{'' if test == 'True' else f' and {test}'}:",
        f"    {best} = {far}",
        f"    {wanted.variable} = {item}",
    ]
    body = [f"{best} = {_NOTHING}", f"for {item} in {wanted.source}:", *_indented("    ", inner), f"{last} = {best}"]
    # The passes are turns of a loop; a distance that stays at its start means that there was no candidate left.
    turn = fresh("turn")
    lines = [
        f"{last} = -{_NOTHING}",
        f"{best} = 0",
        f"for {turn} in [{', '.join(str(n + 1) for n in range(turns))}]:",
        *_indented("    ", body),
    ]
    return [*lines, *_refusal(wanted, f"{last} == {_NOTHING}", fresh)], places


def _not_itself(wanted: Wanted) -> Callable[[str], str]:
    """Return the condition that excludes a thing from the search for the thing nearest to it."""
    same = wanted.other is not None and wanted.other.label == wanted.label
    return lambda far: f" and {far} != 0" if same else ""


def each(wanted: Wanted, fresh: Fresh) -> tuple[Lines, Lines, str]:
    """Return the head of a loop over the things, the lines before it, and the indent of its body."""
    item = wanted.variable
    (test_lines, test), places = _test(wanted, item, fresh)
    if wanted.order in ("to", "from") and wanted.rank and not wanted.relations:
        return _each_by_distance(wanted, fresh)
    guard = (
        [f"{fresh('nearest')} = {wanted.source}[{max(wanted.rank - 1, 0)}]"] if wanted.in_view or wanted.rank else []
    )
    # The closest few need no test: their ranks are enough.
    if wanted.rank and test == "True" and wanted.order == "near":
        if not wanted.in_view:
            ranks = ", ".join(str(n + 1) for n in range(wanted.rank))
            return (f"for {item} in [{ranks}]:",), tuple(places), "    "
        turn = fresh("turn")
        ranks = ", ".join(str(n) for n in range(wanted.rank))
        return (f"for {turn} in [{ranks}]:", f"    {item} = {wanted.source}[{turn}]"), tuple(places), "    "
    # Otherwise go over the candidates, test each, and count those that pass.
    head, indent = _candidates(wanted, item, fresh)
    lines, before = list(head), [*places, *guard]
    if test != "True":
        lines += [*_indented(indent, [*test_lines, f"if {test}:"])]
        indent += "    "
    if wanted.rank:
        count = fresh("count")
        before.append(f"{count} = 0")
        lines += [f"{indent}{count} = {count} + 1", f"{indent}if {count} <= {wanted.rank}:"]
        indent += "    "
    loop_at = next(i for i, line in enumerate(lines) if line.startswith("for "))
    return tuple(lines[loop_at:]), (*before, *lines[:loop_at]), indent


def _each_by_distance(wanted: Wanted, fresh: Fresh) -> tuple[Lines, Lines, str]:
    """Return each of the first few by distance to another thing: the search for one, with its rank a loop's."""
    lines, places = _passes(wanted, wanted.rank, fresh)
    at = next(i for i, line in enumerate(lines) if line.startswith("for "))
    end = next((i for i, line in enumerate(lines) if i > at and not line.startswith(" ")), len(lines))
    guard = f"{wanted.variable} = {wanted.source}[{wanted.rank - 1}]"
    return tuple(lines[at:end]), (*places, guard, *lines[:at]), "    "


def _candidates(wanted: Wanted, item: str, fresh: Fresh) -> tuple[list[str], str]:
    """Return lines that set ``item`` to each candidate in the order of ``wanted``, and the indent of what follows."""
    if wanted.order != "side":
        return [f"for {item} in {wanted.source}:"], "    "
    place, other = fresh("place"), fresh("each")
    lines = [
        f"{place} = 0",
        f"for {other} in robot.instances({quoted(wanted.label)}):",
        f"    {place} = {place} + 1",
        f'    {item} = robot.nth_from({quoted(wanted.label)}, "{wanted.side}", {place})',
    ]
    if not wanted.in_view:
        return lines, "    "
    seen = fresh("seen")
    return [*lines, f"    for {seen} in {wanted.source}:", f"        if {seen} == {item}:"], "            "


def _test(wanted: Wanted, item: str, fresh: Fresh, at: str = "") -> tuple[tuple[list[str], str], list[str]]:
    """Return lines and a condition that hold for a candidate, and lines that find what it is compared with."""
    lines: list[str] = []
    tests: list[str] = []
    places: list[str] = []
    if wanted.relations and not at:
        at = fresh("at")
        lines.append(f"{at} = robot.get_pos({quoted(wanted.label)}, {item})")
    for relation in wanted.relations:
        others = [_place_of(thing, places, fresh) for thing in relation.things]
        if relation.kind in ("left", "right", "front", "behind") and not any(p.startswith("start = ") for p in places):
            places.append(START)
        more, test = _relation(relation.kind, at, others, fresh)
        lines += more
        tests.append(test)
    return (lines, " and ".join(tests) or "True"), places


def _place_of(thing: Thing, places: list[str], fresh: Fresh) -> str:
    look_up = f"robot.get_pos({thing.arguments})"
    for line in places:
        if line.endswith(f" = {look_up}"):
            return line.split(" = ")[0]
    name = fresh("other")
    places.append(f"{name} = {look_up}")
    return name


def _relation(kind: str, at: str, others: list[str], fresh: Fresh) -> tuple[list[str], str]:
    """Return lines and a condition that a place lies on a side of others; see the module for the geometry."""
    o = others[0]
    if kind == "near":
        square = f"({at}[0] - {o}[0]) * ({at}[0] - {o}[0]) + ({at}[1] - {o}[1]) * ({at}[1] - {o}[1])"
        return [], f"{square} <= {NEAR_M * NEAR_M:g}"
    if kind == "between":
        a, b = others
        return [], f"({at}[0] - {a}[0]) * ({at}[0] - {b}[0]) + ({at}[1] - {a}[1]) * ({at}[1] - {b}[1]) < 0"
    # Along the direction of the side, and across it: within 60 degrees means across² <= 3 along².
    along, across = fresh("along"), fresh("across")
    if kind in _COMPASS:
        axis, sign = (0, _COMPASS[kind][0]) if _COMPASS[kind][0] else (1, _COMPASS[kind][1])
        away = f"{at}[{axis}] - {o}[{axis}]" if sign > 0 else f"{o}[{axis}] - {at}[{axis}]"
        lines = [f"{along} = {away}", f"{across} = {at}[{1 - axis}] - {o}[{1 - axis}]"]
    else:
        ahead = f"({o}[0] - start[0]) * ({at}[0] - {o}[0]) + ({o}[1] - start[1]) * ({at}[1] - {o}[1])"
        left = f"({o}[0] - start[0]) * ({at}[1] - {o}[1]) - ({o}[1] - start[1]) * ({at}[0] - {o}[0])"
        one, two = {"left": (left, ahead), "right": (f"-({left})", ahead), "behind": (ahead, left)}.get(
            kind, (f"-({ahead})", left)
        )
        lines = [f"{along} = {one}", f"{across} = {two}"]
    return lines, f"{along} > 0 and 3 * {along} * {along} >= {across} * {across}"


def _refusal(wanted: Wanted, test: str, fresh: Fresh) -> Lines:
    """Refuse by name: the map has no class called "chair to the left of the couch"."""
    missing = fresh("missing")
    return (f"if {test}:", f"    {missing} = {quoted(wanted.in_words[:_MAX_TEXT])}", f"    robot.face({missing})")


def _indented(indent: str, lines: list[str] | Lines) -> list[str]:
    return [indent + line for line in lines]
