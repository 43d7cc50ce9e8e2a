"""What differs between two maps of one place, object by object: merged, split, missed, invented, named otherwise."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from simaps_viz.evaluation.overlaps import Objects, Overlaps
from simaps_viz.evaluation.truth import Truth
from simaps_viz.structures import SIMap

_INSIDE = 0.5
"""Share of an object's cells from which it is said to lie on another."""


class Kind(Enum):
    """How the other map differs from the reference, the gravest first."""

    MERGED = "merged"
    """Several objects of the reference are one."""
    SPLIT = "split"
    """One object of the reference is several."""
    MISSED = "missed"
    """An object of the reference is not there."""
    EXTRA = "extra"
    """An object lies on none of the reference of its class."""
    LABEL = "label"
    """The same object has another class."""
    OUTLINE = "outline"
    """The object is there, but less than half of what the two say of it agrees."""


@dataclass(frozen=True)
class Difference:
    """One difference, and who takes part in it."""

    kind: Kind
    reference: tuple[int, ...]
    """Ids on the reference map, ascending; empty for an extra object."""
    other: tuple[int, ...]
    """Ids on the other map, ascending; empty for a missed object."""
    label: str
    """Class of the (first) reference object, or of the extra one."""
    other_label: str
    """Class on the other map; empty for a missed object."""
    cells: int
    """Of all who take part, on both maps together."""


@dataclass(frozen=True, eq=False)
class Differences:
    """All of them, and what agrees."""

    items: tuple[Difference, ...]
    """By kind, the largest first."""
    same: int
    """Pairs that take part in none: same class, intersection over union above 0.5."""
    ignored: tuple[int, int]
    """Objects of (reference, other) too small to be compared."""

    def counts(self) -> dict[Kind, int]:
        """Return the number of each kind, in the kinds' order; all kinds."""
        number = Counter(item.kind for item in self.items)
        return {kind: number[kind] for kind in Kind}


def as_reference(simap: SIMap) -> Truth:
    """Take a map for the truth, so that another can be laid on it."""
    names = {instance.id: instance.label for instance in simap.instances}
    return Truth(simap.grid, simap.instance, names, simap.T_map_world, simap.method)


def find_differences(overlaps: Overlaps) -> Differences:
    """Name every difference: each object that counts is either in agreement or part of one at least.

    Args:
        overlaps: of the reference (``true``) and the other map (``found``); see `find_overlaps`.
    """
    finder = _Finder(overlaps)
    finder.find_groups()
    finder.find_labels()
    finder.find_leftovers()
    order = list(Kind)
    items = sorted(finder.items, key=lambda d: (order.index(d.kind), -d.cells, d.reference, d.other))
    ignored = (int((~overlaps.true.counts).sum()), int((~overlaps.found.counts).sum()))
    return Differences(tuple(items), finder.same, ignored)


class _Finder:
    """Goes over the overlaps once; notes who is accounted for."""

    def __init__(self, overlaps: Overlaps) -> None:
        self._o = overlaps
        self.items: list[Difference] = []
        self._known = np.zeros(len(overlaps.true.ids), bool)
        self._known_found = np.zeros(len(overlaps.found.ids), bool)
        self.same = 0

    def find_groups(self) -> None:
        """Merged, split and matching ones."""
        o = self._o
        true, found = o.pairs[o.covering, 0], o.pairs[o.covering, 1]
        for at in np.flatnonzero(o.merged).tolist():
            self._add(Kind.MERGED, true[found == at].tolist(), [at])
        for at in np.flatnonzero(o.split).tolist():
            self._add(Kind.SPLIT, [at], found[true == at].tolist())
        for t, f, _ in o.pairs[o.matched].tolist():
            self.same += not (self._known[t] or self._known_found[f])
            self._known[t] = self._known_found[f] = True

    def find_labels(self) -> None:
        """Same cells, another class."""
        o = self._o
        t, f = o.pairs[:, 0], o.pairs[:, 1]
        other = o.true.counts[t] & o.found.counts[f] & (o.true.label[t] != o.found.label[f]) & (o.iou > 0.5)
        for a, b, _ in o.pairs[other & ~self._known[t] & ~self._known_found[f]].tolist():
            self._add(Kind.LABEL, [a], [b])

    def find_leftovers(self) -> None:
        """Missed ones, extra ones, and those of which only a part agrees."""
        o = self._o
        pairs = o.pairs[o.same_class]
        covered = np.bincount(pairs[:, 0], weights=pairs[:, 2], minlength=len(o.true.ids))
        for at in np.flatnonzero(o.true.counts & ~self._known).tolist():
            mine = pairs[pairs[:, 0] == at]
            if covered[at] < o.rules.notable_share * o.true.cells[at]:
                self._add(Kind.MISSED, [at], [])
            else:
                self._add(Kind.OUTLINE, [at], [int(mine[mine[:, 2].argmax(), 1])])
        for at in np.flatnonzero(o.found.counts & ~self._known_found).tolist():
            mine = pairs[pairs[:, 1] == at]
            inside = mine[mine[:, 2] > _INSIDE * o.found.cells[at]]
            if len(inside):
                self._add(Kind.OUTLINE, [int(inside[0, 0])], [at])
            else:
                self._add(Kind.EXTRA, [], [at])

    def _add(self, kind: Kind, true: Sequence[int], found: Sequence[int]) -> None:
        o = self._o
        label, cells = _label_of(o.labels, o.true, true), int(o.true.cells[list(true)].sum())
        other, more = _label_of(o.labels, o.found, found), int(o.found.cells[list(found)].sum())
        ids = (tuple(sorted(o.true.ids[list(true)].tolist())), tuple(sorted(o.found.ids[list(found)].tolist())))
        self.items.append(Difference(kind, *ids, label or other, other, cells + more))
        self._known[list(true)] = True
        self._known_found[list(found)] = True


def _label_of(labels: tuple[str, ...], objects: Objects, positions: Sequence[int]) -> str:
    return labels[objects.label[positions[0]]] if positions else ""


def extent_of(cells: Mapping[str, tuple[NDArray, Sequence[int]]]) -> tuple[int, int, int, int] | None:
    """Return the (lowest row, lowest column, highest row + 1, highest column + 1) that some objects cover.

    Args:
        cells: {side: (ids int [rows, cols], which of them)}; all of one window. None when they have no cells.
    """
    where = [np.argwhere(np.isin(ids, list(wanted))) for ids, wanted in cells.values() if len(wanted)]
    points = np.concatenate(where) if where else np.zeros((0, 2), np.int64)
    if not len(points):
        return None
    low, high = points.min(axis=0), points.max(axis=0) + 1
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])
