"""Turns the syntax trees of spoken steps to program text: one method for each rule of ``commands.lark``."""
# ruff: noqa: D102 - the grammar says what each rule means

from collections.abc import Mapping, Sequence
from typing import Final

from lark import Token

from simaps_viz.language import places
from simaps_viz.language.meanings import Measure, Pair, Side, Step, Thing, first, maybe, quoted, tidy, token
from simaps_viz.language.things import Children, ThingBuilder
from simaps_viz.language.words import Vocabulary

_METRES: Final = {
    "METRES": 1.0,
    "CENTIMETRES": 0.01,
    "MILLIMETRES": 0.001,
    "KILOMETRES": 1000.0,
    "FEET": 0.3048,
    "INCHES": 0.0254,
    "YARDS": 0.9144,
    "STEPS": 0.7,
}
_A_LITTLE_M: Final = "0.5"
_A_LITTLE_DEG: Final = "30"
_LATERAL: Final = ("left", "right")


class Builder(ThingBuilder):
    """Builds program text, step by step, noting how words were read.

    Args:
        vocabulary: of the map.
        choices: {spoken word: class}, overrides what an ambiguous word means.
    """

    def __init__(self, vocabulary: Vocabulary, choices: Mapping[str, str] | None = None) -> None:
        super().__init__(vocabulary, choices)
        self._loop_of: Thing | None = None
        self._verb = "go"
        self.lines: list[str] = []

    def copy(self) -> "Builder":
        """Return one in the same state, that can go its own way."""
        other = Builder(self._vocabulary, self._choices)
        other._last, other._before = self._last, self._before
        other._names, other._loop_of = dict(self._names), self._loop_of
        other._verb, other.lines = self._verb, list(self.lines)
        other.notes, other.ambiguous = list(self.notes), dict(self.ambiguous)
        return other

    @property
    def program(self) -> str:
        """The program so far."""
        start = places.START
        head = [start] if any("start" in line for line in self.lines) else []
        return "\n".join([*head, *(line for line in self.lines if line.strip() != start)])

    # ---- the whole of a step

    def start(self, children: Children) -> None:
        lines = list(first(Step, children).lines)
        times = 2 if token("TWICE", children) else int(float(m.text)) if (m := maybe(Measure, children)) else 1
        if times > 1:
            head = f"for {self._fresh('turn')} in [{', '.join(str(n + 1) for n in range(min(times, 100)))}]:"
            lines = [head, *(f"    {line}" for line in lines)]
        self.lines += lines
        self._before = self._last

    start_go = start_turn = start_any = start

    def _do(self, call: str, thing: Thing | None = None) -> Step:
        """Return the lines of one call, in the loop it belongs to; ``{}`` in the call is the thing's arguments."""
        written = f"robot.{call.format(thing.arguments) if thing else call}"
        return self._lines([written], thing)

    def _lines(self, lines: Sequence[str], thing: Thing | None = None) -> Step:
        if thing is None or (not thing.loop and not thing.indent):
            self._loop_of = None if thing is None or not thing.indent else self._loop_of
            return Step((*(thing.before if thing else ()), *lines))
        indented = tuple(thing.indent + line for line in lines)
        if thing.loop:
            self._loop_of = thing
            return Step((*thing.before, *thing.loop, *indented))
        return Step(indented if self._loop_of and self._loop_of.which == thing.which else tuple(lines))

    # ---- driving to things

    def go_object(self, children: Children) -> Step:
        thing = first(Thing, children)
        verb = self._verb if len(children) == 1 or all(isinstance(c, Thing) for c in children) else "go"
        if verb == "face":
            return self._do("face({})", thing)
        self._verb = "go"
        if thing.which.isdigit() and not thing.loop:
            return self._do("move_to_nth_closest({})", thing)
        return self._do("move_to_object({})", thing)

    def go_between(self, children: Children) -> Step:
        pair = first(Pair, children)
        names = f"{quoted(pair.a.label)}, {quoted(pair.b.label)}"
        before = (*pair.a.before, *pair.b.before)
        if pair.b.which:
            call = f"robot.move_in_between({names}, {pair.a.which or 1}, {pair.b.which})"
        else:
            call = f"robot.move_in_between({names}{', ' + pair.a.which if pair.a.which else ''})"
        return Step((*before, *self._lines([call]).lines))

    def go_middle(self, children: Children) -> Step:
        thing = first(Thing, children)
        return self._do("move_to(robot.get_pos({}))", thing)

    def go_beside(self, children: Children) -> Step:
        side = first(Side, children).name
        return self._do(f"move_{'to_' if side in _LATERAL else ''}{side}({{}})", first(Thing, children))

    def beside_at(self, children: Children) -> Step:
        return self._go_off(first(Side, children).name, children)

    def front_at(self, children: Children) -> Step:
        return self._go_off("front", children)

    def behind_at(self, children: Children) -> Step:
        return self._go_off("behind", children)

    def _go_off(self, side: str, children: Children) -> Step:
        thing, distance = first(Thing, children), first(Measure, children)
        self._note(f"{distance.text} m is measured from the middle of {thing.in_words}")
        return self._lines(places.off(thing, side, distance.text, self._fresh), thing)

    def go_toward(self, children: Children) -> Step:
        thing = first(Thing, children)
        distance = first(Measure, children).text
        return self._lines([f"robot.face({thing.arguments})", f"robot.move_forward({distance})"], thing)

    def go_away(self, children: Children) -> Step:
        thing = first(Thing, children)
        back = self._distance(children).negated().text
        return self._lines([f"robot.face({thing.arguments})", f"robot.move_forward({back})"], thing)

    def go_halfway(self, children: Children) -> Step:
        thing = first(Thing, children)
        self._note(f"half way is on the straight line to the middle of {thing.in_words}")
        return self._lines(places.halfway(thing, self._fresh), thing)

    def go_corner(self, children: Children) -> Step:
        thing, side = first(Thing, children), first(Side, children)
        return self._lines(places.corner(thing, side.heading_deg or 0.0, self._fresh), thing)

    def go_front(self, children: Children) -> Step:
        return self._facing_side(first(Thing, children), "in front of", False)

    def go_behind(self, children: Children) -> Step:
        return self._facing_side(first(Thing, children), "behind", True)

    def _facing_side(self, thing: Thing, words: str, away: bool) -> Step:
        way = "away from" if away else "towards"
        self._note(f"{words} {thing.in_words} is read as its side {way} where the command was given")
        return self._lines(places.facing_side(thing, away, self._fresh), thing)

    def circle(self, children: Children) -> Step:
        thing = first(Thing, children)
        self._note(f"around {thing.in_words} is read as to its four sides, clockwise from the north")
        calls = [f"robot.move_{side}({thing.arguments})" for side in ("north", "east", "south", "west", "north")]
        return self._lines(calls, thing)

    def go_back(self, _: Children) -> Step:
        return self._do("move_to(start)")

    def go_position(self, children: Children) -> Step:
        x, y = [tidy(float(child)) for child in children if isinstance(child, Token) and child.type == "NUM"]
        return self._do(f"move_to([{x}, {y}])")

    def halt(self, _: Children) -> Step:
        self._note("the robot stays where it is")
        return self._do("turn(0)")

    # ---- turning

    def face(self, children: Children) -> Step:
        self._verb = "face"
        return self._do("face({})", first(Thing, children))

    def face_away(self, children: Children) -> Step:
        thing = first(Thing, children)
        return self._lines([f"robot.face({thing.arguments})", "robot.turn(180)"], thing)

    def face_compass(self, children: Children) -> Step:
        return self._do(f"turn_absolute({first(Side, children).heading})")

    def face_heading(self, children: Children) -> Step:
        return self._do(f"turn_absolute({first(Measure, children).text})")

    def with_object(self, children: Children) -> Step:
        return self._do(f"with_object_on_{first(Side, children).name}({{}})", first(Thing, children))

    def turn(self, children: Children) -> Step:
        way = maybe(Side, children)
        angle = maybe(Measure, children) or Measure("90")
        if way is None:
            self._note(f"{angle.text} degrees without a side is read as a turn to the right")
        elif way.name == "left":
            angle = angle.negated()
        return self._do(f"turn({angle.text})")

    def slight(self, _: Children) -> Measure:
        self._note(f"a little is read as {_A_LITTLE_DEG} degrees")
        return Measure(_A_LITTLE_DEG)

    def turn_around(self, _: Children) -> Step:
        return self._do("turn(180)")

    def turn_fully(self, children: Children) -> Step:
        way = maybe(Side, children)
        self._note("a full turn is 360 degrees")
        return self._do(f"turn({'-' if way and way.name == 'left' else ''}360)")

    # ---- moving without a goal

    def forward(self, children: Children) -> Step:
        return self._do(f"move_forward({self._distance(children).text})")

    def backward(self, children: Children) -> Step:
        return self._do(f"move_forward({self._distance(children).negated().text})")

    def compass_move(self, children: Children) -> Step:
        heading = first(Side, children).heading
        return self._lines([f"robot.turn_absolute({heading})", f"robot.move_forward({self._distance(children).text})"])

    def sideways(self, children: Children) -> Step:
        turn = 90 if first(Side, children).name == "right" else -90
        return self._lines([f"robot.turn({turn})", f"robot.move_forward({self._distance(children).text})"])

    def strafe(self, children: Children) -> Step:
        turn = 90 if first(Side, children).name == "right" else -90
        self._note("the robot cannot drive sideways: it turns, drives, and turns back")
        move = f"robot.move_forward({self._distance(children).text})"
        return self._lines([f"robot.turn({turn})", move, f"robot.turn({-turn})"])

    def distance(self, children: Children) -> Measure:
        if token("SLIGHTLY", children):
            self._note(f"a little is read as {_A_LITTLE_M} m")
            return Measure(_A_LITTLE_M)
        given = maybe(Measure, children)
        amount = float(given.text) if given else 1.0
        amount *= 0.25 if token("QUARTER", children) else 0.5 if token("HALF", children) else 1.0
        unit = next((child.type for child in children if isinstance(child, Token) and child.type in _METRES), None)
        if unit is None:
            self._note(f"{tidy(amount)} is read as metres")
        elif unit == "STEPS":
            self._note(f"a step is read as {_METRES[unit]:g} m")
        return Measure(tidy(amount * _METRES.get(unit or "METRES", 1.0)))

    def angle(self, children: Children) -> Measure:
        return Measure(tidy(float(token("NUM", children) or 0.0)))

    def quarter(self, children: Children) -> Measure:
        given = maybe(Measure, children)
        return Measure(tidy(90.0 * float(given.text) if given else 90.0))

    def nth_turn(self, children: Children) -> Measure:
        return Measure(tidy(360.0 / max(int(token("ORD", children) or 1), 1)))

    def half_turn(self, _: Children) -> Measure:
        return Measure("180")

    def _distance(self, children: Children) -> Measure:
        given = maybe(Measure, children)
        if given is None and token("STEPS", children):
            self._note(f"a step is read as {_METRES['STEPS']:g} m")
            return Measure(tidy(_METRES["STEPS"]))
        if given is None:
            self._note("no distance was said: 1 m")
        return given or Measure("1")
