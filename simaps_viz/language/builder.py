"""Turns the syntax tree of a spoken command into program text: one method for each rule of ``commands.lark``."""
# ruff: noqa: D102 - the grammar says what each rule means

import keyword
import re
from collections.abc import Mapping, Sequence

from lark import Token, Transformer

from simaps_viz.errors import CommandError
from simaps_viz.language.meanings import Measure, Noun, Pair, Side, Step, Thing, first, quoted, tidy, token
from simaps_viz.language.words import Vocabulary, plain, singular

_OPPOSITE = {"left": "right", "right": "left", "north": "south", "south": "north", "east": "west", "west": "east"}
_MAX_RANK = 10_000

Children = Sequence[object]


class Builder(Transformer):
    """Builds program text, noting how words were read.

    Args:
        vocabulary: of the map.
        choices: {spoken word: class}, overrides what an ambiguous word means.
    """

    def __init__(self, vocabulary: Vocabulary, choices: Mapping[str, str] | None = None) -> None:
        super().__init__()
        self._vocabulary = vocabulary
        self._choices = choices or {}
        self._last: Thing | None = None
        self._returns = False
        self._used_loop = False
        self.notes: list[str] = []
        self.ambiguous: dict[str, tuple[str, ...]] = {}
        """{spoken word: the other classes it may mean}."""

    # ---- the whole

    def start(self, children: Children) -> str:
        lines = ['start = robot.get_pos("robot")'] if self._returns else []
        for step in children:
            if isinstance(step, Step):
                lines += [f"    {line}" if step.in_loop else line for line in step.lines]
        return "\n".join(lines)

    def step(self, children: Children) -> Step:
        return first(Step, children)

    # ---- driving to things

    def go_object(self, children: Children) -> Step:
        thing = first(Thing, children)
        if thing.which.isdigit():
            return self._do(f"move_to_nth_closest({thing.arguments})")
        return self._do(f"move_to_object({thing.arguments})")

    def go_each(self, children: Children) -> Step:
        label = first(Noun, children).label
        lookup = "in_view" if "view" in children else "instances"
        name = re.sub(r"\W+", "_", label.lower()).strip("_")
        if not (name.isidentifier() and name.isascii()) or keyword.iskeyword(name) or name in ("robot", "start"):
            name = "thing"
        self._last = Thing(label, name, is_loop=True)
        go = f"    robot.move_to_object({quoted(label)}, {name})"
        return Step((f"for {name} in robot.{lookup}({quoted(label)}):", go))

    def go_between(self, children: Children) -> Step:
        pair = first(Pair, children)
        names = f"{quoted(pair.a.label)}, {quoted(pair.b.label)}"
        if pair.b.which:
            return self._do(f"move_in_between({names}, {pair.a.which or 1}, {pair.b.which})")
        return self._do(f"move_in_between({names}{', ' + pair.a.which if pair.a.which else ''})")

    def go_beside(self, children: Children) -> Step:
        side = first(Side, children).name
        return self._do(f"move_{'to_' if side in _LATERAL else ''}{side}({first(Thing, children).arguments})")

    def go_back(self, _: Children) -> Step:
        self._returns = True
        return self._do("move_to(start)")

    def go_position(self, children: Children) -> Step:
        x, y = [tidy(float(child)) for child in children if isinstance(child, Token) and child.type == "NUM"]
        return self._do(f"move_to([{x}, {y}])")

    # ---- turning

    def face(self, children: Children) -> Step:
        return self._do(f"face({first(Thing, children).arguments})")

    def face_compass(self, children: Children) -> Step:
        return self._do(f"turn_absolute({first(Side, children).heading})")

    def face_heading(self, children: Children) -> Step:
        return self._do(f"turn_absolute({first(Measure, children).text})")

    def with_object(self, children: Children) -> Step:
        return self._do(f"with_object_on_{first(Side, children).name}({first(Thing, children).arguments})")

    def turn(self, children: Children) -> Step:
        way = next((child for child in children if isinstance(child, Side)), None)
        angle = next((child for child in children if isinstance(child, Measure)), Measure("90"))
        if way is None:
            self._note(f"{angle.text} degrees without a side is read as a turn to the right")
        elif way.name == "left":
            angle = angle.negated()
        return self._do(f"turn({angle.text})")

    def turn_around(self, _: Children) -> Step:
        return self._do("turn(180)")

    # ---- moving without a goal

    def forward(self, children: Children) -> Step:
        return self._do(f"move_forward({self._distance(children).text})")

    def backward(self, children: Children) -> Step:
        return self._do(f"move_forward({self._distance(children).negated().text})")

    def compass_move(self, children: Children) -> Step:
        heading = first(Side, children).heading
        return self._do(f"turn_absolute({heading})", f"move_forward({self._distance(children).text})")

    def sideways(self, children: Children) -> Step:
        turn = 90 if first(Side, children).name == "right" else -90
        return self._do(f"turn({turn})", f"move_forward({self._distance(children).text})")

    def distance(self, children: Children) -> Measure:
        number = token("NUM", children)
        amount = float(number) if number else 0.5 if token("HALF", children) else 1.0
        if token("CENTIMETRES", children):
            amount /= 100.0
        elif token("FEET", children):
            amount *= 0.3048
        elif not token("METRES", children):
            self._note(f"{tidy(amount)} is read as metres")
        return Measure(tidy(amount))

    def angle(self, children: Children) -> Measure:
        return Measure(tidy(float(token("NUM", children) or 0.0)))

    def side(self, children: Children) -> Side:
        kind = next(child.type for child in children if isinstance(child, Token))
        return Side({"CLOCKWISE": "right", "COUNTERCLOCKWISE": "left"}.get(kind, kind.lower()))

    lateral = compass = way = side

    # ---- which thing is meant

    def noun(self, children: Children) -> Noun:
        spoken = " ".join(str(child) for child in children)
        found = self._vocabulary.resolve(spoken)
        one = singular(plain(spoken))
        if not found:
            return Noun(one)
        label = self._choices.get(one, found[0])
        others = tuple(other for other in found if other != label)
        if others:
            self.ambiguous[one] = others
            self._note(f'"{one}" is read as {label}; this map also has {", ".join(others)}')
        elif plain(label) not in (one, plain(spoken)):
            self._note(f'"{one}" is read as {label}')
        return Noun(label)

    nouns = noun

    def pair(self, children: Children) -> Pair:
        a, b = [child for child in children if isinstance(child, Thing)]
        return Pair(a, b)

    def pair_of_two(self, children: Children) -> Pair:
        number = token("NUM", children)
        if number and float(number) != 2:
            raise CommandError(f"between takes two things, not {tidy(float(number))}")
        thing = Thing(first(Noun, children).label)
        return Pair(thing, thing)

    def object(self, children: Children) -> Thing:
        return first(Thing, children)

    def it(self, _: Children) -> Thing:
        if self._last is None:
            raise CommandError('"it" was not understood: nothing was named before it')
        self._used_loop |= self._last.is_loop
        return self._last

    def closest(self, children: Children) -> Thing:
        return self._mean(children, "")

    def nth(self, children: Children) -> Thing:
        rank = _rank(children)
        return self._mean(children, str(rank) if rank > 0 else self._indexed("instances", children, rank))

    def numbered(self, children: Children) -> Thing:
        number = float(token("NUM", children) or 0.0)
        if number != int(number) or not 1 <= number <= _MAX_RANK:
            raise CommandError(f"the number of a thing is a whole number from 1, found {tidy(number)}")
        self._note(f"number {tidy(number)} is counted from the closest")
        return self._mean(children, tidy(number))

    def farthest(self, children: Children) -> Thing:
        return self._mean(children, self._indexed("instances", children, -_rank(children)))

    def outermost(self, children: Children) -> Thing:
        return self._from_side(children, str(token("MOST", children)).removesuffix("ernmost").removesuffix("most"))

    def nth_from(self, children: Children) -> Thing:
        return self._from_side(children, first(Side, children).name)

    def in_view(self, children: Children) -> Thing:
        rank = _rank(children)
        return self._mean(children, self._indexed("in_view", children, rank - 1 if rank > 0 else rank))

    def closest_to(self, children: Children) -> Thing:
        name, other = quoted(first(Noun, children).label), first(Thing, children)
        ranked = other.which.isdigit()
        arguments = other.arguments if ranked else other.value
        return self._mean(children, f"robot.closest_to({name}, {arguments})")

    def between(self, children: Children) -> Thing:
        name, pair = quoted(first(Noun, children).label), first(Pair, children)
        return self._mean(children, f"robot.between({name}, {pair.a.value}, {pair.b.value})")

    def view(self, _: Children) -> str:
        return "view"

    # ---- helpers

    def _mean(self, children: Children, which: str) -> Thing:
        self._last = Thing(first(Noun, children).label, which)
        return self._last

    @staticmethod
    def _indexed(lookup: str, children: Children, index: int) -> str:
        return f"robot.{lookup}({quoted(first(Noun, children).label)})[{index}]"

    def _from_side(self, children: Children, side: str) -> Thing:
        rank = _rank(children)
        if rank < 0:
            side, rank = _OPPOSITE[side], -rank
        return self._mean(children, f'robot.nth_from({quoted(first(Noun, children).label)}, "{side}", {rank})')

    def _do(self, *calls: str) -> Step:
        step = Step(tuple(f"robot.{call}" for call in calls), self._used_loop)
        self._used_loop = False
        return step

    def _distance(self, children: Children) -> Measure:
        given = next((child for child in children if isinstance(child, Measure)), None)
        if given is None:
            self._note("no distance was said: 1 m")
        return given or Measure("1")

    def _note(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)


_LATERAL = ("left", "right")


def _rank(children: Children) -> int:
    """Give the rank an ordinal says, 1 when there is none, -1 for "last"."""
    word = token("ORD", children)
    rank = int(word) if word else 1
    if rank == 0 or rank > _MAX_RANK:
        raise CommandError(f"ranks count from 1 to {_MAX_RANK}, found {rank}")
    return rank
