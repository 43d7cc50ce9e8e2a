"""A small chart parser: rules are patterns over tokens, each with the function that makes its value.

A pattern is a regular expression over tokens and other rules: ``"(GO | STAND) TO? goal:np"``. Names in capitals are
kinds of tokens, the others rules. What a rule or a named token (``n:NUM``) gives is handed to the function under its
name, or under the name before the colon; below ``*`` or ``+`` a tuple of them, into which tuples are joined. Names that
begin with "_" are not handed over; ``&`` before a part only looks whether it follows, ``!`` whether it does not. Of the
readings of a rule that end at the same token the likeliest few are kept, so that parsing takes polynomial time however
many attachments a sentence has.
"""

import re
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from simaps_viz.errors import CommandError

_KEPT: Final = 4
"""Readings kept of those that end at the same token."""
MAX_READINGS: Final = 5_000
"""Readings of parts of a sentence; so many take a second or two, and of 1,900 that people said none has a quarter."""
_PIECE: Final = re.compile(r"[()|?*+&!]|[\w:]+")


TOO_MANY: Final = "too many things are tied to one another in one phrase; say it in several steps"


class InvolvedError(CommandError):
    """A sentence has too many readings to look through."""


def no_reading() -> Any:
    """Drop a reading, without words, from the function of its rule."""
    raise CommandError("")


def no_reading_if(senseless: object) -> None:
    """Drop a reading where it makes no sense."""
    if senseless:
        no_reading()


@dataclass(frozen=True)
class Edge:
    """One way to read the words at some place of a sentence as a token."""

    kind: str
    value: Any
    end: int
    """The place after it."""
    cost: float = 0.0


@dataclass(frozen=True)
class Found:
    """A reading of a rule: where it ends, its value, and how unlikely it is."""

    end: int
    value: Any
    cost: float


@dataclass(frozen=True)
class _Symbol:
    name: str
    key: str
    several: bool


@dataclass(frozen=True)
class _Sequence:
    parts: tuple[Any, ...]


@dataclass(frozen=True)
class _Choice:
    parts: tuple[Any, ...]


@dataclass(frozen=True)
class _Repeat:
    part: Any
    least: int
    most: int


@dataclass(frozen=True)
class _Ahead:
    part: Any
    follows: bool


@dataclass
class _Rule:
    pattern: Any
    make: Callable[..., Any]
    cost: float
    first: tuple[frozenset[str], bool] | None = None
    """The kinds of tokens that can begin it, and whether it may be empty; found when it is first looked at."""


class Grammar:
    """A set of rules; each rule has one or more patterns."""

    def __init__(self) -> None:
        self._rules: dict[str, list[_Rule]] = {}
        self._first: dict[str, tuple[frozenset[str], bool]] = {}
        self._lock = threading.RLock()  # several pages may read their first commands at once

    def rule(self, name: str, *patterns: str, cost: float = 0.0) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        """Return a decorator that adds patterns to a rule; ``cost`` says how unlikely they are."""

        def add(make: Callable[..., Any]) -> Callable[..., Any]:
            found = [_Rule(_compiled(pattern), make, cost) for pattern in patterns]
            self._rules.setdefault(name, []).extend(found)
            return make

        return add

    def words(self, name: str, *patterns: str) -> None:
        """Add patterns that give no value."""
        self.rule(name, *patterns)(lambda **_: None)

    def rules_of(self, name: str) -> Sequence[_Rule]:
        """Return the patterns of a rule."""
        return self._rules[name]

    def first(self, part: Any) -> tuple[frozenset[str], bool]:
        """Return the kinds of tokens that can begin a pattern, and whether it may be empty."""
        with self._lock:  # what is being looked for has no kinds yet, which another thread must not take for the answer
            return self._begins(part)

    def _begins(self, part: Any) -> tuple[frozenset[str], bool]:
        match part:
            case _Symbol(name=name) if name.isupper():
                return frozenset([name]), False
            case _Symbol(name=name):
                if name not in self._first:
                    self._first[name] = (frozenset(), False)  # no rule begins with itself
                    self._first[name] = self._either([rule.pattern for rule in self._rules[name]])
                return self._first[name]
            case _Sequence(parts=parts):
                found: frozenset[str] = frozenset()
                for one in parts:  # a rule further on may be one whose own first tokens are being looked for
                    kinds, empty = self._begins(one)
                    found |= kinds
                    if not empty:
                        return found, False
                return found, True
            case _Choice(parts=parts):
                return self._either(parts)
            case _:
                kinds, empty = self._begins(part.part)
                return (frozenset(), True) if isinstance(part, _Ahead) else (kinds, empty or part.least == 0)

    def _either(self, parts: Sequence[Any]) -> tuple[frozenset[str], bool]:
        found = list(map(self._begins, parts))
        return frozenset().union(*(kinds for kinds, _ in found)), any(empty for _, empty in found)


def _compiled(pattern: str) -> Any:
    pieces = _PIECE.findall(pattern)
    part, end = _choice(pieces, 0, several=False)
    assert end == len(pieces), pattern
    return part


def _choice(pieces: list[str], at: int, several: bool) -> tuple[Any, int]:
    options = []
    while True:
        parts = []
        while at < len(pieces) and pieces[at] not in "|)":
            ahead = pieces[at] if pieces[at] in "&!" else ""
            at += bool(ahead)
            after = _end_of(pieces, at)
            mark = pieces[after] if after < len(pieces) and pieces[after] in "?*+" else ""
            inside = several or mark in ("*", "+")
            if pieces[at] == "(":
                part, _ = _choice(pieces, at + 1, inside)
            else:
                key, _, name = pieces[at].rpartition(":")
                key = key or ("" if name.isupper() or name.startswith("_") else name)
                part = _Symbol(name, key, inside)
            if ahead:
                part = _Ahead(part, ahead == "&")
            elif mark:
                part = _Repeat(part, int(mark == "+"), 1 if mark == "?" else 60)
            parts.append(part)
            at = after + bool(mark)
        options.append(parts[0] if len(parts) == 1 else _Sequence(tuple(parts)))
        if at >= len(pieces) or pieces[at] == ")":
            return (options[0] if len(options) == 1 else _Choice(tuple(options))), at + (at < len(pieces))
        at += 1


def _end_of(pieces: list[str], at: int) -> int:
    depth = 0
    while True:
        depth += (pieces[at] == "(") - (pieces[at] == ")")
        at += 1
        if depth == 0:
            return at


Captures = tuple[tuple[str, Any], ...]


@dataclass
class Chart:
    """The readings of one sentence.

    Args:
        grammar: the rules.
        edges: for each place of the sentence, the tokens that can begin there.
    """

    grammar: Grammar
    edges: Sequence[Sequence[Edge]]
    furthest: int = 0
    """The last place at which a token was looked for."""
    refusal: tuple[int, CommandError] | None = None
    """The error that the function of a rule raised for the longest reading, and where that ended.

    One without words only says that there is no such reading."""
    readings: int = 0
    """How many readings of parts were made."""
    _memo: dict[tuple[str, int], list[Found]] = field(default_factory=dict)

    def parse(self, name: str, at: int = 0) -> list[Found]:
        """Return the readings of a rule that begin at a place, the likeliest of each end first.

        Raises:
            InvolvedError: there are more than `MAX_READINGS` of parts of the sentence.
        """
        if (name, at) not in self._memo:
            self._memo[name, at] = []
            self._memo[name, at] = _kept(self._readings(name, at))
        return self._memo[name, at]

    def _readings(self, name: str, at: int) -> Iterator[Found]:
        here = {edge.kind for edge in self.edges[at]}
        for rule in self.grammar.rules_of(name):
            rule.first = rule.first or self.grammar.first(rule.pattern)
            kinds, empty = rule.first
            if not empty and here.isdisjoint(kinds):
                self.furthest = max(self.furthest, at)
                continue
            for end, captures, cost in self._match(rule.pattern, at, (), 0.0):
                try:
                    value = rule.make(**dict(captures))
                except CommandError as error:
                    if str(error) and (self.refusal is None or end > self.refusal[0]):
                        self.refusal = (end, error)
                    continue
                self.readings += 1
                if self.readings > MAX_READINGS:
                    raise InvolvedError(TOO_MANY)
                yield Found(end, value, cost + rule.cost + getattr(value, "penalty", 0.0))

    def _match(self, part: Any, at: int, captures: Captures, cost: float) -> Iterator[tuple[int, Captures, float]]:
        match part:
            case _Symbol(name=name, key=key, several=several):
                if name.isupper():
                    self.furthest = max(self.furthest, at)
                    found = [Found(e.end, e.value, e.cost) for e in self.edges[at] if e.kind == name]
                else:
                    found = self.parse(name, at)
                for one in found:
                    kept = _captured(captures, key, several, one.value) if key else captures
                    yield one.end, kept, cost + one.cost
            case _Sequence(parts=parts):
                yield from self._follow(parts, at, captures, cost)
            case _Choice(parts=parts):
                for one in parts:
                    yield from self._match(one, at, captures, cost)
            case _Ahead(part=inner, follows=follows):
                if any(True for _ in self._match(inner, at, (), 0.0)) == follows:
                    yield at, captures, cost
            case _:
                yield from self._repeat(part, at, captures, cost)

    def _repeat(self, part: _Repeat, at: int, captures: Captures, cost: float) -> Iterator[tuple[int, Captures, float]]:
        states = [(at, captures, cost)]
        if part.least == 0:
            yield at, captures, cost
        for _ in range(part.most):
            states = _fewer([new for old in states for new in self._match(part.part, *old) if new[0] > old[0]])
            yield from states
            if not states:
                return

    def _follow(
        self, parts: Sequence[Any], at: int, captures: Captures, cost: float
    ) -> Iterator[tuple[int, Captures, float]]:
        if not parts:
            yield at, captures, cost
            return
        for state in self._match(parts[0], at, captures, cost):
            yield from self._follow(parts[1:], *state)


def _captured(captures: Captures, key: str, several: bool, value: Any) -> Captures:
    if not several:
        return (*captures, (key, value))
    before = next((old for name, old in captures if name == key), ())
    before, more = (one if type(one) is tuple else (one,) for one in (before, value))
    return (*(pair for pair in captures if pair[0] != key), (key, (*before, *more)))


def _fewer(states: list[tuple[int, Captures, float]]) -> list[tuple[int, Captures, float]]:
    kept: dict[int, int] = {}
    found = []
    for state in sorted(states, key=lambda s: s[2]):
        kept[state[0]] = kept.get(state[0], 0) + 1
        if kept[state[0]] <= _KEPT:
            found.append(state)
    return found


def _kept(readings: Iterator[Found]) -> list[Found]:
    """Keep the likeliest few readings of each end, and of equal values one; longer readings come first."""
    kept: dict[int, list[Found]] = {}
    for reading in sorted(readings, key=lambda r: r.cost):
        here = kept.setdefault(reading.end, [])
        if len(here) < _KEPT and all(other.value != reading.value for other in here):
            here.append(reading)
    return [reading for end in sorted(kept, reverse=True) for reading in kept[end]]
