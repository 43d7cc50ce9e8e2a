"""Two maps of one place laid over one another: common window, matched colours, differences, scores. Plain data."""

from collections import Counter
from dataclasses import dataclass
from typing import Literal

from numpy.typing import NDArray

from simaps_viz.colors.classes import ground_kinds
from simaps_viz.colors.instances import instance_colors
from simaps_viz.colors.palette import Color
from simaps_viz.evaluation.coloring import paint, partners
from simaps_viz.evaluation.differences import Difference, as_reference, extent_of, find_differences
from simaps_viz.evaluation.overlaps import ScoringRules, find_overlaps
from simaps_viz.evaluation.quality import Score, scores_of
from simaps_viz.evaluation.windows import joint_window, moved, moved_grid, whole_cells
from simaps_viz.structures import GridSpec, SIMap

BETWEEN_MAPS = ScoringRules(min_true_cells=8, min_found_cells=8)
"""Two maps are peers: what is too small to compare is so on both."""


@dataclass(frozen=True, eq=False)
class MapSide:
    """One of the two, on the window they share."""

    title: str
    colors: NDArray
    """uint8 [rows, cols, 3], RGB, row 0 at the south; an object has the colour of what it overlaps most on the left."""
    instance: NDArray
    """int32 [rows, cols], ids of this map, 0 = none."""
    ground: NDArray
    """uint8 [rows, cols], what lies where no instance does: 0 unseen, 1 floor, 2 clutter, 3 wall."""
    names: dict[int, str]
    """{id: class and number among its class on this map, such as "chair 4"}."""
    ignored: int
    """Objects too small to be compared."""
    least_cells: int
    """An object with fewer cells is too small."""

    @property
    def count(self) -> int:
        """Instances on the map."""
        return len(self.names)


@dataclass(frozen=True)
class Item:
    """A difference, seen from the page: left and right, and where it is."""

    kind: str
    """Value of a `Kind`."""
    left: tuple[int, ...]
    right: tuple[int, ...]
    label: str
    """Class on the reference; of an extra object its own."""
    other_label: str
    """Class on the other map; empty for a missed object."""
    extent_m: tuple[float, float, float, float]
    """(xmin, ymin, xmax, ymax) of all who take part, map frame, metres."""


@dataclass(frozen=True, eq=False)
class TwoMaps:
    """The comparison. Differences say what became of the reference on the other map."""

    spec: GridSpec
    left: MapSide
    right: MapSide
    reference: Literal["left", "right"]
    """The truth if one of them is, else the left one."""
    items: tuple[Item, ...]
    counts: dict[str, int]
    """{kind: how many}, all kinds, the gravest first."""
    same: int
    """Objects that agree."""
    score: Score | None
    """Of the other map, when the reference is the truth."""


def compare_two(
    left: tuple[str, SIMap], right: tuple[str, SIMap], *, truth: Literal["left", "right"] | None = None
) -> TwoMaps:
    """Lay two maps of one place over one another.

    Args:
        left: title and map; its colours are what the right one's follow.
        right: the same.
        truth: which of them is the truth, if one is; the other is then scored by it.

    Raises:
        InputError: they lie in different map frames, or their cells do not coincide.
    """
    swapped = truth == "right"
    reference, other = (right[1], left[1]) if swapped else (left[1], right[1])
    overlaps = find_overlaps(other, as_reference(reference), None if truth else BETWEEN_MAPS)
    differences = find_differences(overlaps)
    window = joint_window(left[1].spec, right[1].spec)
    on_left, on_right = _on(left[1], window), _on(right[1], window)
    table = instance_colors(left[1])  # those it has on the page
    colors: dict[int, Color] = {i.id: tuple(table[i.id].tolist()) for i in left[1].instances}
    items = tuple(_item(d, on_left, on_right, window, swapped) for d in differences.items)
    # A cup on a table that the left map does not know lies on the table, but is not the table.
    alone = {i for item in items if item.kind in ("missed", "extra") for i in item.right}
    follow = {
        own: colors[left_id]
        for own, left_id in partners(on_right, on_left).items()
        if own not in alone and left_id in colors
    }
    rules = ScoringRules() if truth else BETWEEN_MAPS
    small = tuple(zip(differences.ignored, (rules.min_true_cells, rules.min_found_cells), strict=True))
    return TwoMaps(
        spec=window,
        left=_side(left, window, on_left, colors, small[swapped]),
        right=_side(right, window, on_right, follow, small[not swapped]),
        reference="right" if swapped else "left",
        items=items,
        counts={kind.value: count for kind, count in differences.counts().items()},
        same=differences.same,
        score=scores_of(overlaps, other).overall if truth else None,
    )


def _on(simap: SIMap, window: GridSpec) -> NDArray:
    return moved(simap.instance, whole_cells(simap.spec, window), window.shape, 0)


def _side(named: tuple[str, SIMap], window: GridSpec, cells: NDArray, colors: dict, small: tuple[int, int]) -> MapSide:
    title, simap = named
    grid = moved_grid(simap.grid, window)
    return MapSide(title, paint(grid, cells, colors), cells, ground_kinds(grid), _names(simap), *small)


def _names(simap: SIMap) -> dict[int, str]:
    number: Counter[str] = Counter()
    names = {}
    for one in simap.instances:
        number[one.label] += 1
        names[one.id] = f"{one.label} {number[one.label]}"
    return names


def _item(d: Difference, on_left: NDArray, on_right: NDArray, window: GridSpec, swapped: bool) -> Item:
    left, right = (d.other, d.reference) if swapped else (d.reference, d.other)
    box = extent_of({"left": (on_left, left), "right": (on_right, right)}) or (0, 0, window.rows, window.cols)
    s, x0, y0 = window.cell_size_m, window.x0_m, window.y0_m
    extent = (x0 + box[1] * s, y0 + box[0] * s, x0 + box[3] * s, y0 + box[2] * s)
    return Item(d.kind.value, left, right, d.label, d.other_label, extent)
