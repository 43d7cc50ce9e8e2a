"""Which of a class's things is meant, from the parts of a phrase: "the second" + "chair" + "nearest the desk"."""

import keyword
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from simaps_viz.errors import CommandError
from simaps_viz.language import program_text
from simaps_viz.language.program_text import NEAR_M, Relation, Thing, Wanted, quoted

MAX_RANK: Final = 10_000
_MAX_COUNT: Final = 100
PARTS: Final = frozenset([
    "away_from", "behind", "between", "farthest", "farthest_side", "from_here", "from_side", "from_side_of", "in_front",
    "near", "nearest", "numbered", "on_side", "outermost", "side_of", "swept", "view",
])  # fmt: skip
"""The rules of the grammar for what follows a noun, as "in view" does."""
_OPPOSITE: Final = {
    "left": "right", "right": "left", "north": "south", "south": "north", "east": "west", "west": "east",
}  # fmt: skip
_FAR_OF: Final = {"near": "far", "far": "near", "to": "from", "from": "to"}


@dataclass(frozen=True)
class Noun:
    """A class name, or several classes' generic name: one the map knows, or what was said."""

    label: str
    is_plural: bool = False
    wide: str = ""
    """A name that takes more classes together, for when more than one thing is needed."""
    count: int | None = None
    """How many of the class the map has, if that is known."""


@dataclass(frozen=True)
class Pair:
    """Two things something lies between."""

    a: Thing
    b: Thing


@dataclass(frozen=True)
class Part:
    """A word or phrase that says which thing is meant."""

    kind: str
    """The name of its rule, e.g. "nearest", "from_side"."""
    rank: int | None = None
    """-1 is the last."""
    side: str = ""
    other: Thing | Pair | None = None


@dataclass
class Selection:
    """The combined meaning of the parts of a phrase.

    ``order`` is how the things are counted: "near" or "far" from where the command was given, from a "side", or by
    the distance "to" or "from" another thing, nearest or farthest first.
    """

    label: str
    order: str = ""
    side: str = ""
    other: Thing | None = None
    rank: int | None = None
    in_view: bool = False
    relations: list[Relation] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, part: Part) -> None:
        """Take in one part.

        Raises:
            CommandError: when it contradicts an earlier part.
        """
        if part.rank is not None:
            self._set_rank(part.rank)
        getattr(self, f"_{part.kind}")(part)

    def _set_rank(self, rank: int) -> None:
        if rank == 0 or abs(rank) > MAX_RANK:
            raise CommandError(f"ranks count from 1 to {MAX_RANK}, found {rank}")
        if self.rank is not None and self.rank != rank:
            raise CommandError("two ranks were said for one thing")
        self.rank = rank

    def _count_by(self, order: str, *, side: str = "", other: Thing | None = None) -> None:
        same = self.order in ("", order) and self.side in ("", side) and (self.other is None or other is None)
        if not same:
            raise CommandError("two ways of counting were said for one thing")
        self.order, self.side, self.other = order, side or self.side, other or self.other

    def _ranked(self, _: Part) -> None:
        """Do nothing: by default things are ranked by their distance from where the command was given."""

    _from_here = _ranked

    def _numbered(self, _: Part) -> None:
        self.notes.append(f"number {self.rank} is counted from the closest")

    def _nearest(self, part: Part) -> None:
        if isinstance(part.other, Thing):
            self._near(part)
        elif self.order != "to":
            self._count_by("near")

    def _farthest(self, part: Part) -> None:
        if isinstance(part.other, Thing):
            self.order = "" if self.order == "far" else self.order
            self._count_by("from", other=part.other)
        else:
            self._count_by("far")

    def _near(self, part: Part) -> None:
        assert isinstance(part.other, Thing)
        if self.order in ("", "near"):
            self.order = ""
            self._count_by("to", other=part.other)
        else:
            self.relations.append(Relation("near", (part.other,)))

    def _away_from(self, part: Part) -> None:
        self._farthest(part) if self.order == "far" else self._near(part)

    def _from_side(self, part: Part) -> None:
        self._count_by("side", side=part.side)

    _outermost = _on_side = _farthest_side = _from_side

    def _from_side_of(self, part: Part) -> None:
        assert isinstance(part.other, Thing)
        self._from_side(part)
        self.notes.append(f"{part.other.in_words} was left out: from the {part.side} is counted over all of them")

    def _side_of(self, part: Part) -> None:
        assert isinstance(part.other, Thing)
        self.relations.append(Relation(part.side, (part.other,)))

    def _in_front(self, part: Part) -> None:
        self._side_of(replace(part, side="front"))

    def _behind(self, part: Part) -> None:
        self._side_of(replace(part, side="behind"))

    def _between(self, part: Part) -> None:
        assert isinstance(part.other, Pair)
        self.relations.append(Relation("between", (part.other.a, part.other.b)))

    def _view(self, _: Part) -> None:
        self.in_view = True

    # ---- from the parts to program text

    def _settle(self) -> None:
        """Bring order and rank into the form that has a rank from 1."""
        if not self.order and self.relations and self.relations[0].kind != "between":
            self.order, self.other = "to", self.relations[0].things[0]
        self.order = self.order or "near"
        if self.rank is not None and self.rank < 0:
            self.rank = -self.rank
            if self.order == "side":
                self.side = _OPPOSITE[self.side]
            else:
                self.order = _FAR_OF[self.order]

    @property
    def needs(self) -> int:
        """How many things of the class there must be for the phrase to make sense."""
        least = 2 if self.order or self.relations or self.rank is not None else 1
        return max(least, abs(self.rank or 1))

    def one(self, fresh: Callable[[str], str]) -> Thing:
        """Return the thing meant; ``fresh`` makes names that are not used yet."""
        explicit = self.order == "near"
        self._settle()
        name, rank = quoted(self.label), self.rank or 1
        others = [thing for relation in self.relations for thing in relation.things]
        before = tuple(line for thing in [*others, self.other] if thing for line in thing.before)
        # One look-up is enough for most phrases; the others need a search.
        which = None
        if self.in_view and self.order in ("near", "far") and not self.relations:
            which = f"robot.in_view({name})[{rank - 1 if self.order == 'near' else -rank}]"
        elif not self.in_view and not self.relations:
            which = self._looked_up(name, rank, explicit)
        elif not self.in_view and len(self.relations) == 1 and self.relations[0].kind == "between" and rank == 1:
            a, b = self.relations[0].things
            which = f"robot.between({name}, {a.value}, {b.value})"
        if which is not None:
            return Thing(self.label, which, before)
        if self.order == "far" and rank > 1:
            raise CommandError("only the farthest can be found where a side or neighbour is said too")
        variable = fresh(identifier(self.label))
        lines = program_text.pick(self._wanted(variable, rank), fresh)
        return Thing(self.label, variable, before + lines)

    def _looked_up(self, name: str, rank: int, explicit: bool) -> str | None:
        if self.order == "near":
            return "" if self.rank is None or (explicit and rank == 1) else str(rank)
        if self.order == "far":
            return f"robot.instances({name})[{-rank}]"
        if self.order == "side":
            return f'robot.nth_from({name}, "{self.side}", {rank})'
        if self.order == "to" and rank == 1 and self.other:
            arguments = self.other.arguments if self.other.which.isdigit() else self.other.value
            return f"robot.closest_to({name}, {arguments})"
        return None

    def _wanted(self, variable: str, rank: int) -> Wanted:
        return Wanted(
            self.label, variable, self.order, rank, self.side, self.other, self.in_view, tuple(self.relations)
        )

    def each(self, fresh: Callable[[str], str], count: int | None) -> Thing:
        """Return a loop over the things meant: the first ``count`` of them, or all."""
        if self.rank not in (None, 1, -1):
            raise CommandError("a rank and several things were said together")
        if count is not None and not 1 <= count <= _MAX_COUNT:
            raise CommandError(f"from 1 to {_MAX_COUNT} things can be visited, found {count}")
        if count is None and self.rank == -1:
            raise CommandError("the last of how many was not said")
        near = [r for r in self.relations if r.kind == "near"]
        if count is None and self.order == "to" and self.other and not near:
            self.order, relation = "", Relation("near", (self.other,))
            self.relations.append(relation)
            self.notes.append(f"near {self.other.in_words} is read as at most {NEAR_M:g} m from its middle")
        if self.order or self.rank or count is not None:
            self._settle()
        others = [thing for relation in self.relations for thing in relation.things]
        before = tuple(line for thing in [*others, self.other] if thing for line in thing.before)
        variable = fresh(identifier(self.label))
        wanted = self._wanted(variable, count or 0)
        loop, guard, indent = program_text.each(replace(wanted, order=self.order or "near"), fresh)
        return Thing(self.label, variable, before + guard, loop, indent)


def identifier(label: str) -> str:
    """Return a name a program can use for a thing of a class."""
    name = re.sub(r"\W+", "_", label.lower()).strip("_")
    if not (name.isidentifier() and name.isascii()) or keyword.iskeyword(name) or name in ("robot", "start"):
        return "thing"
    return name


def select(noun: Noun, parts: Sequence[Part]) -> Selection:
    """Put the parts of a phrase together."""
    selection = Selection(noun.label)
    for part in parts:
        selection.add(part)
    return selection
