"""Two maps of one place laid over one another: common window, matched colours, scores, and what differs.

Objects differ by being merged, split, missed, invented or named otherwise. Many of them share few colours, so that near
ones differ as far as the palette permits.

A map is compared with one by another method, or with the ground truth; each of those is made once.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from enum import Enum
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.build import METHOD_NAMES
from simaps_viz.build.methods import build
from simaps_viz.build.pipeline import BuildConfig, cache_key, made_folder, map_in_cache
from simaps_viz.colors import palette
from simaps_viz.colors.classes import ground_kinds
from simaps_viz.colors.instances import instance_colors
from simaps_viz.colors.palette import Color
from simaps_viz.datasets.source import FrameSource
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.errors import InputError
from simaps_viz.evaluation.quality import Objects, Overlaps, Score, ScoringRules, find_overlaps, scores_of
from simaps_viz.evaluation.space import (
    SpaceScores,
    SpaceTruth,
    origin_of_voxels,
    score_space,
    space_truth,
    truth_of_map,
)
from simaps_viz.evaluation.truth import (
    Truth,
    exact_of,
    joint_window,
    moved_grid,
    partners,
    settings_of,
    truth_as_map,
    truth_of,
    whole_cells,
)
from simaps_viz.events import BuildStarted, Event, FrameProjected, Progress
from simaps_viz.geometry import moved
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.in_space import has_voxels, space_points
from simaps_viz.structures import Grid, GridSpec, SIMap

NO_PARTNER: Color = (150, 153, 158)
"""An instance that overlaps no true one."""
PALETTE: tuple[Color, ...] = tuple(c for c in palette.PALETTE if c[0] <= 1.5 * max(c[1:]))
"""The page's colours without the reds, which are left to what marks an error (`compare.WRONG_RED`)."""


def distinct_colors(instance: NDArray) -> dict[int, Color]:
    """Choose a colour for every instance, the largest first: the one whose nearest user is farthest away.

    Args:
        instance: int [rows, cols], 0 = none.
    """
    flat = instance.reshape(-1)
    where = np.flatnonzero(flat)
    size = np.bincount(flat[where])
    ids = np.flatnonzero(size)
    row, col = np.divmod(where, instance.shape[1])
    middle = np.stack([np.bincount(flat[where], weights=axis)[ids] / size[ids] for axis in (row, col)], axis=1)
    order = np.lexsort((ids, -size[ids]))
    nearest = np.full((len(ids), len(PALETTE)), np.inf)
    chosen: dict[int, Color] = {}
    for at in order.tolist():
        # An unused colour is infinitely far; among those the first, so that the choice is always the same.
        color = int(np.argmax(nearest[at]))
        chosen[int(ids[at])] = PALETTE[color]
        apart = np.hypot(*(middle - middle[at]).T)
        nearest[:, color] = np.minimum(nearest[:, color], apart)
    return chosen


def paint(grid: Grid, instance: NDArray, colors: Mapping[int, Color]) -> NDArray:
    """Colour every cell: instances in their colours (or grey), the ground below them pale.

    Returns:
        uint8 [rows, cols, 3], RGB, row 0 at the south.
    """
    picture = np.array(LIGHT.grounds, np.uint8)[ground_kinds(grid)]
    palette = np.full((int(instance.max(initial=0)) + 1, 3), NO_PARTNER, np.uint8)
    for number, color in colors.items():
        if number < len(palette):
            palette[number] = color
    picture[instance > 0] = palette[instance[instance > 0]]
    return picture


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
    EDGE = "edge"
    """The same object, no difference as such, but its outline is not quite the same."""
    SMALL = "small"
    """Too small to be compared, and on no object of its class."""


NO_DIFFERENCE = (Kind.EDGE, Kind.SMALL)
"""Kinds that are listed, and do not count as differences."""


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
    """Cells of all objects that take part, on both maps together."""
    iou: float = 0.0
    """The largest intersection over union of one object with one of the other map, of those that take part."""


@dataclass(frozen=True, eq=False)
class Differences:
    """All differences, and the number of objects that agree."""

    items: tuple[Difference, ...]
    """By kind, the worst outline first, then the largest."""
    same: int
    """Pairs that take part in none: same class, intersection over union above 0.5."""
    ignored: tuple[int, int]
    """Objects of (reference, other) too small to be compared."""
    same_iou: float | None = None
    """Mean intersection over union of the pairs that agree; None without any."""

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
    finder.find_small()
    order = list(Kind)
    items = sorted(finder.items, key=lambda d: (order.index(d.kind), d.iou, -d.cells, d.reference, d.other))
    ignored = (int((~overlaps.true.counts).sum()), int((~overlaps.found.counts).sum()))
    same_iou = float(np.mean(finder.same_iou)) if finder.same_iou else None
    return Differences(tuple(items), len(finder.same_iou), ignored, same_iou)


class _Finder:
    """Goes over the overlaps once; notes who is accounted for."""

    def __init__(self, overlaps: Overlaps) -> None:
        self._o = overlaps
        self.items: list[Difference] = []
        self._known = np.zeros(len(overlaps.true.ids), bool)
        self._known_found = np.zeros(len(overlaps.found.ids), bool)
        self.same_iou: list[float] = []

    def find_groups(self) -> None:
        """Merged, split and matching ones."""
        o = self._o
        true, found = o.pairs[o.covering, 0], o.pairs[o.covering, 1]
        for at in np.flatnonzero(o.merged).tolist():
            self._add(Kind.MERGED, true[found == at].tolist(), [at])
        for at in np.flatnonzero(o.split).tolist():
            self._add(Kind.SPLIT, [at], found[true == at].tolist())
        for at in np.flatnonzero(o.matched).tolist():
            t, f, _ = o.pairs[at].tolist()
            if not (self._known[t] or self._known_found[f]):
                self.same_iou.append(float(o.iou[at]))
                if o.iou[at] < 1.0:
                    self._add(Kind.EDGE, [t], [f])
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

    def find_small(self) -> None:
        """Those that are too small to be compared, and are not the same small object on the other map."""
        o = self._o
        t, f = o.pairs[:, 0], o.pairs[:, 1]
        same = (o.true.label[t] == o.found.label[f]) & (o.iou > 0.5)
        for side, counts, met in ((0, o.true.counts, t), (1, o.found.counts, f)):
            for at in np.setdiff1d(np.flatnonzero(~counts), met[same]).tolist():
                self._add(Kind.SMALL, [] if side else [at], [at] if side else [])

    def _add(self, kind: Kind, true: Sequence[int], found: Sequence[int]) -> None:
        o = self._o
        between = np.isin(o.pairs[:, 0], list(true)) & np.isin(o.pairs[:, 1], list(found))
        iou = float(o.iou[between].max(initial=0.0))
        label, cells = _label_of(o.labels, o.true, true), int(o.true.cells[list(true)].sum())
        other, more = _label_of(o.labels, o.found, found), int(o.found.cells[list(found)].sum())
        ids = (tuple(sorted(o.true.ids[list(true)].tolist())), tuple(sorted(o.found.ids[list(found)].tolist())))
        self.items.append(Difference(kind, *ids, label or other, other, cells + more, iou))
        self._known[list(true)] = True
        self._known_found[list(found)] = True


def _label_of(labels: tuple[str, ...], objects: Objects, positions: Sequence[int]) -> str:
    return labels[objects.label[positions[0]]] if positions else ""


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
    """{id: name on this map, such as "chair 4"}."""
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
    iou: float
    """The largest intersection over union of two of those who take part."""


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
    same_iou: float | None
    """Mean intersection over union of those, None without any."""
    score: Score | None
    """The scores of the other map, when the reference is the truth."""
    space: SpaceScores | None = None
    """The scores of the other map in space; None where one of the two does not know the surface of things, as the
    truth does not: `MapMaker.scores_in_space` reads it from the frames."""

    @property
    def differences(self) -> tuple[Item, ...]:
        """The items that are differences: not what is the same object, or too small to be compared."""
        return tuple(item for item in self.items if Kind(item.kind) not in NO_DIFFERENCE)


def compare_two(
    left: tuple[str, SIMap],
    right: tuple[str, SIMap],
    *,
    truth: Literal["left", "right"] | None = None,
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
        same_iou=differences.same_iou,
        score=scores_of(overlaps, other).overall if truth else None,
        space=_in_space(reference, other),
    )


def _in_space(reference: SIMap, other: SIMap) -> SpaceScores | None:
    """Score a map in space against another; None where one of the two does not know the surface of things."""
    if not has_voxels(reference) or not has_voxels(other):
        return None
    return score_space(space_points(other), other.grid.labels, truth_of_map(reference))


def _on(simap: SIMap, window: GridSpec) -> NDArray:
    return moved(simap.instance, whole_cells(simap.spec, window), window.shape, 0)


def _side(named: tuple[str, SIMap], window: GridSpec, cells: NDArray, colors: dict, small: tuple[int, int]) -> MapSide:
    title, simap = named
    grid = moved_grid(simap.grid, window)
    return MapSide(
        title,
        paint(grid, cells, colors),
        cells,
        ground_kinds(grid),
        {one.id: one.name for one in simap.instances},
        *small,
    )


def _item(d: Difference, on_left: NDArray, on_right: NDArray, window: GridSpec, swapped: bool) -> Item:
    left, right = (d.other, d.reference) if swapped else (d.reference, d.other)
    # Whoever takes part has cells on at least one of the maps.
    points = np.argwhere(np.isin(on_left, left) | np.isin(on_right, right))
    low, high = points.min(axis=0).tolist(), (points.max(axis=0) + 1).tolist()
    s, x0, y0 = window.cell_size_m, window.x0_m, window.y0_m
    extent = (x0 + low[1] * s, y0 + low[0] * s, x0 + high[1] * s, y0 + high[0] * s)
    return Item(d.kind.value, left, right, d.label, d.other_label, extent, d.iou)


_BASELINES: Mapping[str, str] = {
    "vlmaps": "VLMaps (simulated encoder)",
    "vlmaps+components": "VLMaps + components (simulated encoder)",
}


TRUTH = "truth"
"""Key of the source that is the ground truth."""


@dataclass(frozen=True)
class Source:
    """A map that can be compared with another."""

    key: str
    title: str
    """Such as "Method paper" or "Ground truth"."""


class MapMaker:
    """Makes maps of one sequence by name, in the grid of the map they are to be compared with; each only once."""

    def __init__(self, sequence: FrameSource | None, folder: Path, truth: Path | None = None) -> None:
        """Take the sequence, the folder in which maps are kept, and where a map file may hold the truth."""
        self._folder, self.sequence = folder, sequence
        """None as long as its frames are not there."""
        self._truth = truth if truth is not None and truth.is_file() else None
        self._exact: FrameSource | None = None
        self._made: dict[Path, SIMap] = {}
        self._in_space: dict[Path, SpaceTruth] = {}

    @property
    def has_truth(self) -> bool:
        """Whether the truth is a file, so that no frame need be read for it."""
        return self._truth is not None

    def _with_exact_ids(self) -> FrameSource | None:
        """Return the sequence with exact ids, which is read once for all pages; None as long as there is none."""
        if self._exact is None and self.sequence is not None:
            self._exact = exact_of(self.sequence)
        return self._exact

    def sources(self, simap: SIMap) -> tuple[Source, ...]:
        """Return the maps that ``make`` can make for a map; without a sequence none but a truth that is a file."""
        known = self.has_truth or self._with_exact_ids() is not None
        truth = (Source(TRUTH, "Ground truth"),) if known else ()
        if self.sequence is None:
            return truth
        others = (name for name in METHOD_NAMES if name != simap.method)
        return *truth, *(Source(name, _BASELINES.get(name, f"Method {name}")) for name in others)

    def make(self, key: str, simap: SIMap, tell: Progress) -> SIMap:
        """Return a map by another method, or the true one.

        Args:
            key: of one of the ``sources``.
            simap: the map whose grid, frames and settings the new one takes over.
            tell: called with the progress, often enough that raising in it ends the work soon.

        Raises:
            InputError: there is no sequence, or no truth, or it cannot be read.
        """
        sequence = self.sequence
        if key == TRUTH and self._truth is not None:
            kept = self._truth
        elif sequence is None:
            raise InputError("comparison: expected the sequence the map was built from, found none")
        else:
            kept = self._kept(key, simap, sequence)
        if kept not in self._made:
            self._made[kept] = load_map(kept) if kept.is_file() else self._build(key, simap, tell, kept)
        return self._made[kept]

    def truth_in_space(self, simap: SIMap, tell: Progress) -> SpaceTruth:
        """Return the true objects in space for a map; arguments and errors as of `make`."""
        exact = self._with_exact_ids()
        if exact is None:
            raise InputError("comparison: expected the sequence the map was built from, with exact ids, found none")
        kept = self._kept(TRUTH, simap, exact)
        if kept not in self._in_space:
            self._in_space[kept] = space_truth(
                exact, simap.T_map_world, origin_of_voxels(simap), settings_of(simap),
                frame_names=simap.frame_names, progress=tell,
            )  # fmt: skip
        return self._in_space[kept]

    def scores_in_space(self, simap: SIMap, tell: Progress) -> SpaceScores:
        """Score a map in space against the truth, for which all frames are read; errors as of `make`."""
        truth = self.truth_in_space(simap, tell)
        return score_space(space_points(simap), simap.grid.labels, truth)

    def _build(self, key: str, simap: SIMap, tell: Progress, kept: Path) -> SIMap:
        sequence = self.sequence
        assert sequence is not None
        if key == TRUTH:
            exact = exact_of(sequence)
            if exact is None:
                raise InputError(f"{sequence.path}: expected exact ids, here or beside it, found none")
            made = truth_as_map(truth_of(simap, exact, tell))
        else:
            made = build(sequence, key, config_like(simap), [_Told(tell, key)])
        save_map(made, kept)
        return made

    def _kept(self, key: str, simap: SIMap, sequence: FrameSource) -> Path:
        """Return the path of the map; that of another method is where its own build would have written it."""
        if key != TRUTH:
            return map_in_cache(self._folder, sequence, key, config_like(simap))
        what = asdict(settings_of(simap)), simap.T_map_world.tolist(), list(simap.frame_names)
        return made_folder(self._folder / "compare") / f"{cache_key(sequence, key, *what)}.npz"


def config_like(simap: SIMap) -> BuildConfig:
    """Return the settings of another method that make its map comparable: the same grid, seed and smallest object."""
    given: Mapping[str, Any] = simap.parameters
    known = {f.name for f in fields(BuildConfig)}
    same = {name: given[name] for name in ("seed", "min_cells") if name in given and name in known}
    return replace(BuildConfig(), projection=settings_of(simap), **same)


class _Told:
    """Watches a build and tells how far it is."""

    wants_color = False

    def __init__(self, tell: Progress, method: str) -> None:
        self._tell, self._what, self._total = tell, f"mapping frames by method {method}", 1

    def on_event(self, event: Event) -> None:
        """Take one event of the build."""
        if isinstance(event, BuildStarted):
            self._total = len(event.frame_names)
        elif isinstance(event, FrameProjected):
            self._tell(self._what, event.frame.index + 1, self._total)
