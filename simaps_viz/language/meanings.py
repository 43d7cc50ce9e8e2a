"""The pieces a spoken command is made of, on the way from words to program text."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

from lark import Token

T = TypeVar("T")
_HEADINGS: Final = {"north": 0.0, "east": 90.0, "south": 180.0, "west": 270.0}


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
    """Of the loop's body."""

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
        """Return what to call it in a sentence."""
        return f"the {self.label}"


@dataclass(frozen=True)
class Pair:
    """Two things something lies between."""

    a: Thing
    b: Thing


@dataclass(frozen=True)
class Side:
    """A side: left, right, a compass word, or "" with a heading between two of those."""

    name: str
    heading_deg: float | None = None

    @property
    def heading(self) -> str:
        """Degrees clockwise from north, of a compass word."""
        return tidy(_HEADINGS[self.name] if self.heading_deg is None else self.heading_deg)


@dataclass(frozen=True)
class Measure:
    """A number as program text, metres or degrees."""

    text: str

    def negated(self) -> "Measure":
        """Return it with the other sign."""
        return Measure(self.text[1:] if self.text.startswith("-") else f"-{self.text}")


@dataclass(frozen=True)
class Part:
    """A word or phrase that says which thing is meant."""

    kind: str
    """The name of its rule, e.g. "nearest", "from_side"."""
    rank: int | None = None
    """-1 is the last."""
    side: str = ""
    other: Thing | Pair | None = None


@dataclass(frozen=True)
class Step:
    """The program lines of one spoken step."""

    lines: tuple[str, ...]


def quoted(label: str) -> str:
    """Return a label as a string of a program; quotes and backslashes cannot leave it."""
    plain = "".join(c for c in label if c.isprintable() and c not in '"\\')
    return f'"{plain}"'


def tidy(number: float) -> str:
    """Return a number as program text without needless digits: 2.0 -> "2"."""
    return f"{round(number, 6):.6f}".rstrip("0").rstrip(".")


def first(kind: type[T], children: Sequence[object]) -> T:
    """Return the first child of a kind; the grammar promises there is one."""
    return next(child for child in children if isinstance(child, kind) and not isinstance(child, Token))


def maybe(kind: type[T], children: Sequence[object]) -> T | None:
    """Return the first child of a kind, or None."""
    return next((child for child in children if isinstance(child, kind) and not isinstance(child, Token)), None)


def token(kind: str, children: Sequence[object]) -> Token | None:
    """Return the first token of a kind, or None."""
    return next((child for child in children if isinstance(child, Token) and child.type == kind), None)
