"""Judging a map of a real scan, without truth: how many objects of a class a person counted, and how many it has."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.language.words import Vocabulary
from simaps_viz.structures import Grid, SIMap

MIN_CELLS = 20
"""Found instances of fewer cells are not counted, unless asked for."""


@dataclass(frozen=True)
class CountScore:
    """One class, counted by a person and on the map."""

    label: str
    """Class of the map, or several that are counted together: "coffee table + dining table"."""
    expected: int
    found: int

    @property
    def difference(self) -> int:
        """Found - expected."""
        return self.found - self.expected

    def to_json(self) -> dict[str, Any]:
        """Return numbers by name."""
        return {**asdict(self), "difference": self.difference}


def parse_counts(text: str) -> dict[str, int]:
    """Read "chair=11,table=2".

    Raises:
        InputError: it reads otherwise, or a name comes twice.
    """
    counts: dict[str, int] = {}
    for part in text.split(","):
        name, _, number = (piece.strip() for piece in part.partition("="))
        if not name or not number.isdecimal():
            raise InputError(f'counts: expected name=number, like "chair=11,table=2", found "{part.strip()}"')
        if name in counts:
            raise InputError(f"counts: expected each name once, found {name} again")
        counts[name] = int(number)
    return counts


def score_counts(simap: SIMap, expected: Mapping[str, int], *, min_cells: int = MIN_CELLS) -> tuple[CountScore, ...]:
    """Compare a person's counts with the map's.

    Args:
        simap: the map.
        expected: {name: number}; a name may be a synonym or plural of one of the map's classes ("tables").
        min_cells: do not count instances of fewer cells.

    Returns:
        One for each name, in the given order.

    Raises:
        InputError: the map has no class of that name (its classes are listed), or two names mean one class.
    """
    sizes = [(instance.label, instance.cells) for instance in simap.instances]
    return tuple(
        CountScore(" + ".join(labels), expected[name], sum(label in labels and n >= min_cells for label, n in sizes))
        for name, labels in resolve_classes(things_of(simap.grid), expected).items()
    )


def resolve_classes(things: Sequence[str], names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return {name: countable classes it means, together}; raises InputError like `score_counts`."""
    vocabulary = Vocabulary(things)
    classes: dict[str, tuple[str, ...]] = {}
    for name in names:
        meaning = vocabulary.resolve(name)
        if meaning is None:
            listed = ", ".join(sorted(things)) or "none"
            raise InputError(f'counts: expected a class of the map ({listed}), found "{name}"')
        other = next((n for n, labels in classes.items() if set(labels) & set(meaning.labels)), None)
        if other is not None:
            raise InputError(f'counts: expected names for different classes, found "{other}" and "{name}" to share one')
        classes[name] = meaning.labels
    return classes


def things_of(source: Grid | FrameSource) -> tuple[str, ...]:
    """Return the countable classes of a map's grid or of a sequence."""
    return tuple(name for name, thing in zip(source.labels, source.is_thing, strict=True) if thing)
