"""Turns the syntax trees of spoken steps to program text: one method for each rule of ``commands.lark``."""
# ruff: noqa: D102 - the grammar says what each rule means

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from lark import Token, Transformer

from simaps_viz.errors import CommandError
from simaps_viz.language import program_text
from simaps_viz.language.lexicon import COMPASS_POINTS
from simaps_viz.language.program_text import Thing, quoted, tidy
from simaps_viz.language.selection import MAX_RANK, PARTS, Noun, Pair, Part, Selection, identifier, select
from simaps_viz.language.words import ANY, Vocabulary, plain, plural, singular

T = TypeVar("T")
Children = Sequence[object]
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


@dataclass(frozen=True)
class Side:
    """A side: left, right, a compass word, or "" with a heading between two of those."""

    name: str
    heading_deg: float | None = None

    @property
    def heading(self) -> str:
        """Degrees clockwise from north, of a compass word."""
        return tidy(COMPASS_POINTS[self.name] if self.heading_deg is None else self.heading_deg)


@dataclass(frozen=True)
class Measure:
    """A number as program text, metres or degrees."""

    text: str

    def negated(self) -> "Measure":
        """Return it with the other sign."""
        return Measure(self.text[1:] if self.text.startswith("-") else f"-{self.text}")


@dataclass(frozen=True)
class Step:
    """The program lines of one spoken step."""

    lines: tuple[str, ...]


def first(kind: type[T], children: Sequence[object]) -> T:
    """Return the first child of a kind; the grammar promises there is one."""
    return next(child for child in children if isinstance(child, kind) and not isinstance(child, Token))


def maybe(kind: type[T], children: Sequence[object]) -> T | None:
    """Return the first child of a kind, or None."""
    return next((child for child in children if isinstance(child, kind) and not isinstance(child, Token)), None)


def token(kind: str, children: Sequence[object]) -> Token | None:
    """Return the first token of a kind, or None."""
    return next((child for child in children if isinstance(child, Token) and child.type == kind), None)


def first_token(children: Children) -> Token:
    """Return the first token; the grammar promises there is one."""
    return next(child for child in children if isinstance(child, Token))


class Builder(Transformer):
    """Builds program text step by step and notes how ambiguous words were interpreted.

    Args:
        vocabulary: of the map.
        choices: {spoken word: class}, overrides what an ambiguous word means.
    """

    def __init__(self, vocabulary: Vocabulary, choices: Mapping[str, str] | None = None) -> None:
        super().__init__()
        self._vocabulary = vocabulary
        self._choices = choices or {}
        self._last: Thing | None = None
        self._before: Thing | None = None
        self._names: dict[str, int] = {"start": 1, "robot": 1}
        self._loop_of: Thing | None = None
        self._verb = "go"
        self.lines: list[str] = []
        self.notes: list[str] = []
        self.ambiguous: dict[str, tuple[str, ...]] = {}
        """{spoken word: the other classes it may mean}."""

    def copy(self) -> "Builder":
        """Return a copy in the same state; what is added to one is not added to the other."""
        other = Builder(self._vocabulary, self._choices)
        other._last, other._before = self._last, self._before
        other._names, other._loop_of = dict(self._names), self._loop_of
        other._verb, other.lines = self._verb, list(self.lines)
        other.notes, other.ambiguous = list(self.notes), dict(self.ambiguous)
        return other

    @property
    def program(self) -> str:
        """The program built from the steps added until now."""
        start = program_text.START
        head = [start] if any("start" in line for line in self.lines) else []
        return "\n".join([*head, *(line for line in self.lines if line.strip() != start)])

    # ---- complete steps

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
        return self._lines(program_text.off(thing, side, distance.text, self._fresh), thing)

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
        return self._lines(program_text.halfway(thing, self._fresh), thing)

    def go_corner(self, children: Children) -> Step:
        thing, side = first(Thing, children), first(Side, children)
        return self._lines(program_text.corner(thing, side.heading_deg or 0.0, self._fresh), thing)

    def go_front(self, children: Children) -> Step:
        return self._facing_side(first(Thing, children), "in front of", False)

    def go_behind(self, children: Children) -> Step:
        return self._facing_side(first(Thing, children), "behind", True)

    def _facing_side(self, thing: Thing, words: str, away: bool) -> Step:
        way = "away from" if away else "towards"
        self._note(f"{words} {thing.in_words} is read as its side {way} where the command was given")
        return self._lines(program_text.facing_side(thing, away, self._fresh), thing)

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

    # ---- names of things

    def noun(self, children: Children) -> Noun:
        spoken = " ".join(str(child) for child in children)
        one = singular(plain(spoken))
        is_plural = one != plain(spoken)
        meaning = self._vocabulary.resolve(spoken)
        if meaning is None:
            return Noun(one, is_plural)
        if one in self._choices:
            self._note_reading(one, self._choices[one])
            return Noun(self._choices[one], is_plural)
        if len(meaning.labels) != 1:
            self.ambiguous[one] = (*meaning.labels, *meaning.others)
            everything = len(meaning.labels) == len(self._vocabulary.labels)
            taken = "everything on the map" if everything else f"{_listed(meaning.labels)} together"
            self._note(f'"{one}" takes {taken}')
            return Noun(one, is_plural)
        (label,) = meaning.labels
        exact = plain(label) in (one, plain(spoken))
        wide = f"{ANY}{one}" if exact and meaning.others else ""
        if meaning.others and not exact:
            self.ambiguous[one] = meaning.others
            self._note(f'"{one}" is read as {label}; this map also has {", ".join(meaning.others)}')
        elif not exact:
            self._note_reading(one, label)
        elif wide:
            self.ambiguous[one] = (wide,)
        return Noun(label, is_plural, wide, self._vocabulary.count(label))

    nouns = known = place = noun

    def _note_reading(self, spoken: str, label: str) -> None:
        if plain(label) != spoken:
            self._note(f'"{spoken}" is read as {label}')

    def _widened(self, noun: Noun, needed: int) -> Noun:
        """Take all classes of a kind where the one of that very name has too few."""
        if not noun.wide or (noun.count if noun.count is not None else 1) >= needed:
            return noun
        meaning = self._vocabulary.resolve(noun.wide)
        if meaning is None:
            return noun
        one = noun.wide.removeprefix(ANY)
        self.ambiguous[one] = (noun.label,)
        self._note(f'"{one}" takes {_listed(meaning.labels)} together')
        return Noun(noun.wide, noun.is_plural)

    # ---- parts of phrases

    def pre(self, children: Children) -> Part:
        side = maybe(Side, children)
        if side:
            return Part("from_side", side=side.name)
        kinds = {"NEAREST": "nearest", "FARTHEST": "farthest", "SEEN": "view"}
        word = first_token(children)
        if word.type == "MOST":
            return Part("outermost", side=str(word))
        return Part("ranked", _rank(children)) if word.type == "ORD" else Part(kinds[word.type])

    def numbered(self, children: Children) -> Part:
        number = first(Measure, children).text
        if "." in number or not 1 <= int(number) <= MAX_RANK:
            raise CommandError(f"the number of a thing is a whole number from 1, found {number}")
        return Part("numbered", int(number))

    def __default__(self, data: object, children: list[object], meta: Any) -> object:
        """Build a part from every rule in ``PARTS`` that has no method of its own."""
        return self._part(str(data), children) if data in PARTS else super().__default__(data, children, meta)

    def _part(self, kind: str, children: Children) -> Part:
        side, word = maybe(Side, children), token("MOST", children)
        other = maybe(Thing, children) or maybe(Pair, children)
        name = str(word) if word else side.name if side else ""
        if isinstance(other, Thing) and other.loop:
            raise CommandError(f"each of the {plural(other.label)} was said where one thing is needed")
        return Part(kind, _rank(children) if token("ORD", children) else None, name, other)

    def swept(self, children: Children) -> Part:
        return Part("from_side", side=first(Side, children).name)

    def side(self, children: Children) -> Side:
        word = first_token(children)
        if word.type == "INTER":
            return Side("", float(word))
        return Side({"CLOCKWISE": "right", "COUNTERCLOCKWISE": "left"}.get(word.type, word.type.lower()))

    lateral = compass = way = side

    def amount(self, children: Children) -> Measure:
        return Measure(tidy(float(first_token(children))))

    # ---- one thing

    def described(self, children: Children) -> Thing:
        parts = [child for child in children if isinstance(child, Part)]
        noun = first(Noun, children)
        selection = select(noun, parts)
        selection.label = self._widened(noun, selection.needs).label
        return self._one(selection)

    somewhere = described

    def another_one(self, children: Children) -> Thing:
        """Read "the second one": of the class named last."""
        noun = Noun(self._named_before("one").label)
        return self._one(select(noun, [child for child in children if isinstance(child, Part)]))

    def compound(self, children: Children) -> Thing:
        """Read "the desk chair": the chair nearest the desk."""
        of, noun = [child for child in children if isinstance(child, Noun)]
        self._note(f'"{of.label} {noun.label}" is read as the {noun.label} nearest the {of.label}')
        parts = [child for child in children if isinstance(child, Part)]
        return self._one(select(noun, [Part("near", other=Thing(of.label)), *parts]))

    def object(self, children: Children) -> Thing:
        return first(Thing, children)

    target = object

    def it(self, _: Children) -> Thing:
        return self._named_last("it")

    def other(self, children: Children) -> Thing:
        """Read "the other chair": the closest that is not the one named last."""
        noun = maybe(Noun, children)
        last = self._before
        label = noun.label if noun else self._named_before("one").label
        if last is None or last.label != label or last.loop or not last.which or last.which == "1":
            if last is None or last.label != label:
                self._note(f"the other {label} is read as the second closest")
            return self._mean(Thing(label, "2"))
        if last.which.isdigit():
            return self._mean(Thing(label, "1"))
        name = self._fresh(f"other_{identifier(label)}")
        lines = (
            f"{name} = robot.instances({quoted(label)})[0]",
            f"if {name} == {last.which}:",
            f"    {name} = robot.instances({quoted(label)})[1]",
        )
        return self._mean(Thing(label, name, lines))

    def pair(self, children: Children) -> Pair:
        a, b = [child for child in children if isinstance(child, Thing)]
        return Pair(a, b)

    def pair_elided(self, children: Children) -> Pair:
        """Read "the first and the third chair"."""
        at = next(i for i, child in enumerate(children) if isinstance(child, Token) and child.type == "AND")
        noun = first(Noun, children)
        behind = next(i for i, child in enumerate(children) if isinstance(child, Noun))
        shared = [child for child in children[behind:] if isinstance(child, Part)]
        noun = self._widened(noun, 2)
        halves = (children[:at], children[at:behind])
        a, b = [self._one(select(noun, [*(c for c in half if isinstance(c, Part)), *shared])) for half in halves]
        return Pair(a, b)

    def pair_of_two(self, children: Children) -> Pair:
        number = maybe(Measure, children)
        if number and number.text != "2":
            raise CommandError(f"between takes two things, not {number.text}")
        noun = self._widened(first(Noun, children), 2)
        parts = [child for child in children if isinstance(child, Part)]
        if all(part.kind in ("nearest", "from_here") and part.other is None for part in parts):
            return Pair(Thing(noun.label), Thing(noun.label))
        a, b = [self._one(select(noun, [*parts, Part("ranked", rank)])) for rank in (1, 2)]
        return Pair(a, b)

    # ---- several things

    def group(self, children: Children) -> Thing:
        noun, number = first(Noun, children), maybe(Measure, children)
        if number and "." in number.text:
            raise CommandError(f"things are counted in whole numbers, found {number.text}")
        count = 2 if token("BOTH", children) else int(number.text) if number else None
        selection = select(noun, [child for child in children if isinstance(child, Part)])
        selection.label = self._widened(noun, count or 2).label
        thing = selection.each(self._fresh, count)
        for note in selection.notes:
            self._note(note)
        return self._mean(thing)

    def others(self, children: Children) -> Thing:
        """Read "the other chairs": all but the one named last."""
        label, last = first(Noun, children).label, self._before
        name = self._fresh(identifier(label))
        if last is None or last.label != label or last.loop:
            self._note(f"the other {plural(label)} are read as all but the closest")
            last = Thing(label)
        loop = (f"for {name} in robot.instances({quoted(label)}):",)
        known = self._fresh("known")
        value = last.value if last.which else f"robot.instances({quoted(label)})[0]"
        before = (*last.before, f"{known} = {value}")
        return self._mean(Thing(label, name, before, (*loop, f"    if {name} != {known}:"), "        "))

    # ---- helpers

    def _one(self, selection: Selection) -> Thing:
        thing = selection.one(self._fresh)
        for note in selection.notes:
            self._note(note)
        return self._mean(thing)

    def _mean(self, thing: Thing) -> Thing:
        self._last = thing
        return thing

    def _named_last(self, word: str) -> Thing:
        if self._last is None:
            raise CommandError(f'"{word}" was not understood: nothing was named before it')
        # Its variables are set already.
        return Thing(self._last.label, self._last.which, indent=self._last.indent)

    def _named_before(self, word: str) -> Thing:
        """Return the thing that the steps before this one named last."""
        self._last = self._before
        return self._named_last(word)

    def _fresh(self, name: str) -> str:
        self._names[name] = self._names.get(name, 0) + 1
        return name if self._names[name] == 1 else f"{name}_{self._names[name]}"

    def _note(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)


def _rank(children: Children) -> int:
    return int(token("ORD", children) or 1)


def _listed(labels: Sequence[str]) -> str:
    return f"{', '.join(labels[:-1])} and {labels[-1]}"
