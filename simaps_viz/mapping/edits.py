"""What a person may put right on a map by hand: join objects, cut one in two, name one anew, take one away.

An edit names *cells*, not ids: ids follow from a partition and mean other objects once Louvain ran with another
resolution, while cells stay where they are. "These cells are one object" holds for any partition of the same grid, so
that edits can be replayed on it whatever K, affinity or resolution says of the rest.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.structures import GridSpec, Instance, SIMap

Point = tuple[float, float]
"""x and y in metres, map frame."""
LONGEST_LABEL = 40
"""Characters of a class name."""


class EditRefused(InputError):  # noqa: N818 - a refusal, in words
    """An edit makes no sense on this map; ``plain`` says so to one who sees the map, without ids."""

    def __init__(self, message: str, plain: str) -> None:
        super().__init__(message)
        self.plain = plain


@dataclass(frozen=True)
class Region:
    """Some cells of a grid, as runs of flat cell numbers (row * cols + col)."""

    runs: tuple[tuple[int, int], ...]
    """(first cell, number of cells), ascending, with gaps between."""

    @classmethod
    def of(cls, cells: NDArray) -> "Region":
        """Make a region of flat cell numbers, int64 [n], ascending."""
        if len(cells) == 0:
            return cls(())
        begins = np.flatnonzero(np.r_[True, np.diff(cells) != 1])
        lengths = np.diff(np.r_[begins, len(cells)])
        return cls(tuple(zip(cells[begins].tolist(), lengths.tolist(), strict=True)))

    def cells(self) -> NDArray:
        """Give the flat cell numbers, int64 [n], ascending."""
        if not self.runs:
            return np.zeros(0, np.int64)
        first, length = np.array(self.runs, np.int64).T
        starts = np.cumsum(length) - length
        return np.repeat(first - starts, length) + np.arange(int(length.sum()))


@dataclass(frozen=True)
class Merge:
    """Some cells are one object."""

    objects: tuple[int, int]
    """Ids they had when it was said; only for words."""
    was: tuple[str, str]
    """Their classes."""
    label: str
    """Class of the one object: that of the first."""
    region: Region

    @property
    def words(self) -> str:
        """Say what was done."""
        (first, second), (a, b) = self.objects, self.was
        return f"joined {a} #{first} and {b} #{second}"


@dataclass(frozen=True)
class Split:
    """Some cells are two objects, one on each side of a line."""

    object: int
    """Id it had; only for words."""
    label: str
    region: Region
    line_m: tuple[Point, Point]
    """Two points of the straight line, which goes on beyond both. Cells whose centre lies on it belong to the right."""

    @property
    def words(self) -> str:
        """Say what was done."""
        return f"cut {self.label} #{self.object} in two"

    @property
    def was(self) -> tuple[str, ...]:
        """Class of the cells."""
        return (self.label,)


@dataclass(frozen=True)
class Relabel:
    """Some cells are one object, of another class; no object when the class is uncountable (wall)."""

    object: int
    """Id it had; only for words."""
    was: tuple[str]
    """Class it had."""
    label: str
    region: Region

    @property
    def words(self) -> str:
        """Say what was done."""
        return f"{self.was[0]} #{self.object} is called {self.label}"


@dataclass(frozen=True)
class Delete:
    """Some cells are no object and have no class; what stands there still blocks a robot."""

    object: int
    """Id it had; only for words."""
    was: tuple[str]
    """Class it had."""
    region: Region

    @property
    def words(self) -> str:
        """Say what was done."""
        return f"took away {self.was[0]} #{self.object}"


Edit = Merge | Split | Relabel | Delete


def merge(simap: SIMap, first_id: int, second_id: int) -> Merge:
    """Join two objects; the class is that of the first.

    Raises:
        InputError: one of them is not on the map, or they are the same.
    """
    first, second = simap.by_id(first_id), simap.by_id(second_id)
    if first.id == second.id:
        raise EditRefused(
            f"join: expected two objects, found {first.label} #{first.id} twice",
            "That is the same object. Choose another one.",
        )
    both = np.flatnonzero(np.isin(simap.instance, (first.id, second.id)))
    return Merge((first.id, second.id), (first.label, second.label), first.label, Region.of(both))


def split(simap: SIMap, instance_id: int, start_m: Point, end_m: Point) -> Split:
    """Cut an object along the straight line through two points, map frame, metres.

    Raises:
        InputError: it is not on the map, the line has no direction or does not cut it, or a side is too small.
    """
    one = simap.by_id(instance_id)
    line = (_point(start_m), _point(end_m))
    if np.hypot(line[1][0] - line[0][0], line[1][1] - line[0][1]) < 1e-6:
        raise EditRefused(
            "cut: expected a line between two different points, found the same point twice",
            f"Both clicks are at the same place. Click on both sides of {numbered(simap, one)}.",
        )
    cells = _cells(simap, one.id)
    check_sides(sides(simap.spec, cells, line), f"{one.label} #{one.id}", smallest(simap), numbered(simap, one))
    return Split(one.id, one.label, Region.of(cells), line)


def relabel(simap: SIMap, instance_id: int, label: str) -> Relabel:
    """Call an object something else: a class of the map, in whatever case, or a new one.

    Raises:
        InputError: it is not on the map, or is called so already, or that is no name for a class.
    """
    one = simap.by_id(instance_id)
    name = class_name(simap, label)
    if name == one.label:
        raise EditRefused(
            f"class: expected another one than {name} for #{one.id}, which is called so already",
            f"It is called {name} already. Choose another class.",
        )
    return Relabel(one.id, (one.label,), name, Region.of(_cells(simap, one.id)))


def delete(simap: SIMap, instance_id: int) -> Delete:
    """Take an object away.

    Raises:
        InputError: it is not on the map.
    """
    one = simap.by_id(instance_id)
    return Delete(one.id, (one.label,), Region.of(_cells(simap, one.id)))


def class_name(simap: SIMap, text: str) -> str:
    """Give a class name as the map writes it, or a new one with single spaces.

    Raises:
        InputError: it is empty, "none", too long, or has characters that cannot be shown.
    """
    name = " ".join(text.split())
    if not name or not name.isprintable() or len(name) > LONGEST_LABEL or name.casefold() == "none":
        raise EditRefused(
            f"class: expected a name of 1 to {LONGEST_LABEL} characters, found {text[:60]!r}",
            f'A class has a name of 1 to {LONGEST_LABEL} characters, other than "none". This one has {len(name)}.',
        )
    known = {label.casefold(): label for label in simap.grid.labels}
    return known.get(name.casefold(), name)


def sides(spec: GridSpec, cells: NDArray, line_m: tuple[Point, Point]) -> tuple[NDArray, NDArray]:
    """Sort cells by the side of a line their centres lie on.

    Args:
        spec: their grid.
        cells: int [n], row * cols + col.
        line_m: two different points of the line, (x, y) in the map frame; left and right are seen along it.

    Returns:
        the cells left of it, and those right of it or on it, each int, in the order given.
    """
    (ax, ay), (bx, by) = line_m
    row, col = np.divmod(cells, spec.cols)
    x = spec.x0_m + (col + 0.5) * spec.cell_size_m
    y = spec.y0_m + (row + 0.5) * spec.cell_size_m
    length = np.hypot(bx - ax, by - ay)
    off_m = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / length
    left = off_m > 1e-9
    return cells[left], cells[~left]


def check_sides(both: tuple[NDArray, NDArray], name: str, least: int, plain_name: str = "the object") -> None:
    """Raise EditRefused unless a cut leaves something worth calling an object on both sides.

    Args:
        both: the cells of each side, int, as `sides` gives them.
        name: of what is cut.
        least: cells that an object of this map has at least.
        plain_name: the same, for one who sees the map.
    """
    few = min(len(side) for side in both)
    if few == 0:
        raise EditRefused(
            f"cut: expected a line through {name}, found all of it on one side of the line",
            f"The line does not cross {plain_name}. Click on both sides of it.",
        )
    if few < least:
        raise EditRefused(
            f"cut: expected at least {least} cells of {name} on each side, as fewer are no object here; found {few}",
            f"The smaller part of {plain_name} would be too small for an object: {few} of at least {least} cells.",
        )


def numbered(simap: SIMap, one: Instance) -> str:
    """Name an object by its number among its class on this map, as the page does: "chair 7"."""
    return f"{one.label} {1 + [other.id for other in simap.of_class(one.label)].index(one.id)}"


def told(edit: Edit, simap: SIMap) -> str:
    """Say what an edit does to the map it is made on, without ids: "joined chair 2 and chair 3"."""
    ids = edit.objects if isinstance(edit, Merge) else (edit.object,)
    names = [numbered(simap, simap.by_id(one)) for one in ids]
    if isinstance(edit, Merge):
        return f"joined {names[0]} and {names[1]}"
    if isinstance(edit, Split):
        return f"cut {names[0]} in two"
    return f"{names[0]} is called {edit.label}" if isinstance(edit, Relabel) else f"took away {names[0]}"


def told_later(edit: Edit) -> str:
    """Say what an edit did where the map before it is not at hand: by classes alone."""
    if isinstance(edit, Merge):
        first, second = edit.was
        return f"joined two objects: {first} and {second}" if first != second else f"joined two objects: {first}"
    if isinstance(edit, Split):
        return f"cut one in two: {edit.label}"
    return f"{edit.was[0]} is called {edit.label}" if isinstance(edit, Relabel) else f"took one away: {edit.was[0]}"


def smallest(simap: SIMap) -> int:
    """Give how many cells the map's objects have at least."""
    return max(int(simap.parameters.get("min_cells", 1)), 1)


def _cells(simap: SIMap, instance_id: int) -> NDArray:
    return np.flatnonzero(simap.instance == instance_id)


def _point(point: Point) -> Point:
    x, y = (round(float(v), 4) for v in point)
    if not np.isfinite([x, y]).all():
        raise InputError(f"cut: expected points in metres, found {point!r}")
    return x, y
