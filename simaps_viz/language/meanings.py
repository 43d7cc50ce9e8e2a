"""The pieces a spoken command is made of, on the way from words to program text."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

from lark import Token

T = TypeVar("T")
_HEADINGS: Final = {"north": "0", "east": "90", "south": "180", "west": "270"}


@dataclass(frozen=True)
class Noun:
    """A class name: one of the map's, or what was said."""

    label: str


@dataclass(frozen=True)
class Thing:
    """A thing that was named: its class, and which one as program text ("" = the closest)."""

    label: str
    which: str = ""
    is_loop: bool = False
    """It stands for each thing of a loop in turn."""

    @property
    def arguments(self) -> str:
        """Give e.g. ``"chair", 3``."""
        return quoted(self.label) + (f", {self.which}" if self.which else "")

    @property
    def value(self) -> str:
        """Give program text for an instance, or a class name for its closest, where either may stand."""
        if not self.which:
            return quoted(self.label)
        if self.which.isdigit():
            return f"robot.instances({quoted(self.label)})[{int(self.which) - 1}]"
        return self.which


@dataclass(frozen=True)
class Pair:
    """Two things something lies between."""

    a: Thing
    b: Thing


@dataclass(frozen=True)
class Side:
    """A side: left, right, or a compass word."""

    name: str

    @property
    def heading(self) -> str:
        """Degrees clockwise from north, of a compass word."""
        return _HEADINGS[self.name]


@dataclass(frozen=True)
class Measure:
    """A number as program text, metres or degrees."""

    text: str

    def negated(self) -> "Measure":
        """Give it with the other sign."""
        return Measure(self.text[1:] if self.text.startswith("-") else f"-{self.text}")


@dataclass(frozen=True)
class Step:
    """The program lines of one spoken step."""

    lines: tuple[str, ...]
    in_loop: bool = False
    """They belong to the body of the loop before them."""


def quoted(label: str) -> str:
    """Give a label as a string of a program; quotes and backslashes cannot leave it."""
    plain = "".join(c for c in label if c.isprintable() and c not in '"\\')
    return f'"{plain}"'


def tidy(number: float) -> str:
    """Give a number as program text without needless digits: 2.0 -> "2"."""
    return f"{round(number, 6):.6f}".rstrip("0").rstrip(".")


def first(kind: type[T], children: Sequence[object]) -> T:
    """Give the first child of a kind; the grammar promises there is one."""
    return next(child for child in children if isinstance(child, kind) and not isinstance(child, Token))


def token(kind: str, children: Sequence[object]) -> Token | None:
    """Give the first token of a kind, or None."""
    return next((child for child in children if isinstance(child, Token) and child.type == kind), None)
