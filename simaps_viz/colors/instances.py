"""Colours of a map's objects: neighbours differ, and an object keeps its colour whatever else changes.

Every finest community gets a colour once, and an instance has that of the community it is called by. So moving K or the
evidence never recolours what it does not join. A map built anew, mended or parted otherwise takes over the colours of
the one before it by overlap (``take_over``).
"""

import threading
import weakref
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import COMMON, class_color
from simaps_viz.colors.palette import PALETTE, Color, as_color
from simaps_viz.structures import GridSpec, MergeLog, SIMap

MOST = 24


class Remembered:
    """The last few results, found by the very arrays they came from; never keeps such an array alive."""

    def __init__(self) -> None:
        """Start empty."""
        self._lock = threading.Lock()
        self._kept: list[tuple[tuple[weakref.ref, ...], Hashable, NDArray]] = []

    def find(self, arrays: Sequence[NDArray], name: Hashable = None) -> NDArray | None:
        """Return what was kept for these arrays under that name."""
        with self._lock:
            for refs, kept_name, result in self._kept:
                same = len(refs) == len(arrays) and all(ref() is one for ref, one in zip(refs, arrays, strict=True))
                if same and kept_name == name:
                    return result
        return None

    def keep(self, arrays: Sequence[NDArray], name: Hashable, result: NDArray) -> None:
        """Keep a result; nobody may write into it."""
        with self._lock:
            alive = [entry for entry in self._kept if all(ref() is not None for ref in entry[0])]
            self._kept = [(tuple(weakref.ref(one) for one in arrays), name, result), *alive][:MOST]


NEAR_CELLS = 3
"""Objects with fewer cells than this between them, along a row, a column or a diagonal, are near one another."""
TOUCHES = 1000
"""Near neighbours of one colour that one pair of touching ones is worth avoiding for."""


_kept = Remembered()
_one_at_a_time = threading.RLock()
"""Several pages may want the colours of a large map, which take a second, at once."""


def instance_colors(simap: SIMap) -> NDArray:
    """Return the colour of every instance and every finest community.

    Returns:
        uint8 [n, 3], RGB, at the place of its id; row 0 is black. The same for every K or evidence of a map.
    """
    arrays = _arrays(simap)
    with _one_at_a_time:
        colors = _kept.find(arrays)
        if colors is None:
            colors = _colors(simap, None)
            _kept.keep(arrays, None, colors)
    return colors


def take_over(simap: SIMap, before: SIMap, first: int | None = None) -> None:
    """Let the objects of a map have the colours of those of another map of the same place that they overlap most.

    The object in which most of the earlier map's object ``first`` lies has that one's colour, however little that is.

    To be called before the first ``instance_colors(simap)``; does nothing when the two share their communities.
    """
    arrays = _arrays(simap)
    theirs = _arrays(before)
    if len(arrays) == len(theirs) and all(new is old for new, old in zip(arrays, theirs, strict=True)):
        return
    with _one_at_a_time:
        if _kept.find(arrays) is None:
            _kept.keep(arrays, None, _colors(simap, _worn_before(simap, before, first)))


@dataclass(frozen=True, eq=False)
class Colored:
    """Objects on a grid, each in a colour."""

    spec: GridSpec
    ids: NDArray
    """int32 [rows, cols], 0 = none."""
    colors: NDArray
    """uint8 [n, 3], RGB, at the place of the id."""


def colors_like(spec: GridSpec, ids: NDArray, before: Colored | None) -> NDArray:
    """Colour objects of which nothing is known but where they are.

    Neighbours differ; otherwise an object has the colour of what was there before and overlaps it most.

    Args:
        spec: of the grid.
        ids: int32 [rows, cols], 0 = none.
        before: what was there before; None = nothing.

    Returns:
        uint8 [n, 3], RGB, at the place of the id; row 0 is black.
    """
    size = 1 + int(ids.max(initial=0))
    old = None if before is None else _on_cells_of(spec, before.spec, before.ids)
    worn = np.full(size, -1) if before is None or old is None else _worn(ids, old, _places_of(before.colors), size)
    cells = np.bincount(ids.reshape(-1), minlength=size)
    cells[0] = 0
    beside: Neighbours = [{} for _ in range(size)]
    pairs, weight = near_pairs(ids)
    for (a, b), w in zip(pairs.tolist(), weight.tolist(), strict=True):
        beside[a][b] = beside[b][a] = w
    wish = np.where(worn >= 0, worn, (np.arange(size) - 1) % len(PALETTE))
    had_one = (worn >= 0).astype(int)  # who had a colour chooses first
    colors = np.array(PALETTE, np.uint8)[_choose(cells, had_one, beside, wish)]
    colors[0] = 0
    return colors


def keep_classes(simap: SIMap, other: SIMap) -> None:
    """Let the classes of a map have the colours they have on another map with the same names of classes."""
    class_colors(other)
    colors = _kept.find((other.grid.label,), "classes")
    if colors is not None and _kept.find((simap.grid.label,), "classes") is None:
        _kept.keep((simap.grid.label,), "classes", colors)


def class_colors(simap: SIMap) -> dict[str, Color]:
    """Return every countable class that is on the map its colour; no two alike while the palette lasts.

    Then colours repeat, but not between classes that touch, while that can be. The same for every K or evidence.
    """
    arrays = (simap.grid.label,)
    colors = _kept.find(arrays, "classes")
    if colors is None:
        colors = _class_colors(simap)
        _kept.keep(arrays, "classes", colors)
    names = {simap.grid.labels[graph.label] for graph in simap.graphs} | {one.label for one in simap.instances}
    places = {name: place for place, name in enumerate(simap.grid.labels)}
    return {name: as_color(colors[places[name]]) if name in places else class_color(name) for name in sorted(names)}


def _class_colors(simap: SIMap) -> NDArray:
    """Return uint8 [labels, 3]; classes of rooms choose first, then the others by name."""
    labels = simap.grid.labels
    used = np.zeros(len(PALETTE))
    things = np.array(simap.grid.is_thing, dtype=bool)[simap.grid.label]
    present = np.flatnonzero(np.bincount(simap.grid.label[things], minlength=len(labels)))
    keys = _pairs_apart(np.where(things, simap.grid.label, 0), 1, len(labels))
    touching = np.stack(np.divmod(keys, len(labels)), axis=1)
    chosen = np.full(len(labels), -1)
    colors = np.array([class_color(name) for name in labels], np.uint8).reshape(-1, 3)
    order = sorted(present.tolist(), key=lambda i: (labels[i] not in COMMON, labels[i]))
    for one in order:
        beside = np.r_[touching[touching[:, 0] == one, 1], touching[touching[:, 1] == one, 0]]
        cost = used.copy()
        if len(order) > len(PALETTE):
            worn = chosen[beside]
            cost += np.bincount(worn[worn >= 0], minlength=len(PALETTE)) * TOUCHES
        around = np.roll(np.arange(len(PALETTE)), -_place_of(class_color(labels[one])))
        chosen[one] = around[np.argmin(cost[around])]
        used[chosen[one]] += 1
        colors[one] = PALETTE[chosen[one]]
    return colors


def _place_of(color: Color) -> int:
    return PALETTE.index(color) if color in PALETTE else 0


def _arrays(simap: SIMap) -> tuple[NDArray, ...]:
    """The arrays that the colours depend on."""
    own = () if _called_by_communities(simap) else (simap.instance,)
    return (simap.community, simap.merges.source, *own)


def _called_by_communities(simap: SIMap) -> bool:
    """Return whether every instance is called by a community that lies in it, as in a map nobody has mended."""
    return max((one.id for one in simap.instances), default=0) <= int(simap.community.max(initial=0))


def _colors(simap: SIMap, worn: NDArray | None) -> NDArray:
    community, instance = simap.community, simap.instance
    size = 1 + max(int(community.max(initial=0)), int(instance.max(initial=0)))
    cells = np.bincount(community.reshape(-1), minlength=size)
    cells[0] = 0
    pairs, weight = near_pairs(community)
    if not _called_by_communities(simap):
        others, their_weight = near_pairs(instance)
        pairs, weight = np.concatenate([pairs, others]), np.concatenate([weight, their_weight])
        cells = np.where(cells > 0, cells, np.bincount(instance.reshape(-1), minlength=size))
        cells[0] = 0
    conflicts, lasts = _ever_neighbours(pairs, weight, simap.merges, size)
    wish = (np.arange(size) - 1) % len(PALETTE)
    if worn is not None:
        wish[: len(worn)] = np.where(worn >= 0, worn, wish[: len(worn)])
    chosen = _choose(cells, lasts, conflicts, wish)
    colors = np.array(PALETTE, np.uint8)[chosen]
    colors[0] = 0
    return colors


def near_pairs(ids: NDArray) -> tuple[NDArray, NDArray]:
    """Find the ids that lie near one another; 0 is nobody.

    Args:
        ids: int [rows, cols].

    Returns:
        int64 [n, 2], pairs, lower id first, ascending; and int64 [n], TOUCHES where cells of the two touch, else 1.
    """
    size = int(ids.max(initial=0)) + 1
    found = [_pairs_apart(ids, step, size) for step in range(1, NEAR_CELLS + 1)]
    keys = np.unique(np.concatenate(found))
    return np.stack(np.divmod(keys, size), axis=1), np.where(np.isin(keys, found[0]), TOUCHES, 1)


def _pairs_apart(ids: NDArray, step: int, size: int) -> NDArray:
    found = []
    for a, b in (
        (ids[:, :-step], ids[:, step:]),
        (ids[:-step], ids[step:]),
        (ids[:-step, :-step], ids[step:, step:]),
        (ids[:-step, step:], ids[step:, :-step]),
    ):
        edge = np.nonzero(a != b)  # few, so what follows costs little
        one, other = a[edge], b[edge]
        low, high = np.minimum(one, other).astype(np.int64), np.maximum(one, other)
        found.append(np.unique((low * size + high)[low > 0]))
    return np.unique(np.concatenate(found))


Neighbours = list[dict[int, int]]
"""For each community: {another: how much it matters that their colours differ}."""


def _ever_neighbours(pairs: NDArray, weight: NDArray, merges: MergeLog, size: int) -> tuple[Neighbours, NDArray]:
    """Find, for each community, those that should not share its colour: they call an instance near its own.

    The merges are replayed from the strictest threshold to the laxest; what becomes one is called by its smallest
    community, which then has the neighbours of both.

    Returns:
        those neighbours; and int [size], after how many merges nothing is called by the community any more.
    """
    beside: Neighbours = [{} for _ in range(size)]
    for (a, b), w in zip(pairs.tolist(), weight.tolist(), strict=True):
        beside[a][b] = beside[b][a] = w
    conflicts = [dict(one) for one in beside]
    lasts = np.full(size, len(merges))
    parent = list(range(size))

    def root(at: int) -> int:
        while parent[at] != at:
            parent[at] = parent[parent[at]]
            at = parent[at]
        return at

    for count, step in enumerate(_strictest_first(merges).tolist()):
        keeps, goes = sorted((root(int(merges.source[step])), root(int(merges.target[step]))))
        if keeps == goes:
            continue
        parent[goes], lasts[goes] = keeps, count
        for one, w in beside[goes].items():
            if one != keeps:
                del beside[one][goes]
                larger = max(w, beside[keeps].get(one, 0))
                beside[keeps][one] = beside[one][keeps] = larger
                conflicts[keeps][one] = conflicts[one][keeps] = larger
        beside[keeps].pop(goes, None)
        beside[goes] = {}
    return conflicts, lasts


def _strictest_first(merges: MergeLog) -> NDArray:
    """Return the steps in the order in which they are taken while the threshold falls.

    A step is taken with all that come before it in its class, so at the least score among those.
    """
    score = merges.score.astype(np.float64)
    starts = np.flatnonzero(np.diff(merges.label) != 0) + 1
    for part in np.split(score, starts):
        np.minimum.accumulate(part, out=part)
    return np.argsort(-score, kind="stable")


def _choose(cells: NDArray, lasts: NDArray, conflicts: Neighbours, wish: NDArray) -> NDArray:
    """Colour those that call an instance longest first, the largest of them first.

    Each gets its wish, or the next colour that no neighbour has, or the one whose neighbours matter least.

    Returns:
        int [n], places in the palette.
    """
    chosen = np.full(len(cells), -1)
    order = np.lexsort((np.arange(len(cells)), -cells, -lasts))
    for one in order[cells[order] > 0].tolist():
        taken = np.zeros(len(PALETTE))
        for other, weight in conflicts[one].items():
            if chosen[other] >= 0:
                taken[chosen[other]] += weight
        around = np.roll(np.arange(len(PALETTE)), -int(wish[one]))
        chosen[one] = around[np.argmin(taken[around])]
    return np.where(chosen < 0, wish, chosen)


def _worn_before(simap: SIMap, before: SIMap, first: int | None) -> NDArray | None:
    """Give, for each community, the palette place of the instance of the earlier map it overlaps most; -1 = none."""
    old = _on_cells_of(simap.spec, before.spec, before.instance)
    if old is None:
        return None
    size = 1 + max(int(simap.community.max(initial=0)), int(simap.instance.max(initial=0)))
    places = _places_of(instance_colors(before))
    of_instances, of_communities = (_worn(ids, old, places, size) for ids in (simap.instance, simap.community))
    worn = np.where(of_communities >= 0, of_communities, of_instances)  # communities overrule, where there are any
    if first is not None:
        inside = simap.instance[(old == first) & (simap.instance > 0)]
        if inside.size:
            worn[np.bincount(inside).argmax()] = places[first]
    return worn


def _places_of(colors: NDArray) -> NDArray:
    """Return the palette place of each colour, int [n]; -1 = none."""
    places = {color: place for place, color in enumerate(PALETTE)}
    return np.array([places.get(tuple(color), -1) for color in colors.tolist()])


def _worn(ids: NDArray, old: NDArray, places: NDArray, size: int) -> NDArray:
    """Give, for each id, the palette place of what it overlaps most, int [size]; -1 = none."""
    worn = np.full(size, -1)
    both = (ids > 0) & (old > 0)
    if both.any():
        most = int(old.max()) + 1
        keys, shared = np.unique(ids[both].astype(np.int64) * most + old[both], return_counts=True)
        mine, theirs = np.divmod(keys, most)
        order = np.argsort(shared, kind="stable")
        worn[mine[order]] = places[theirs[order]]  # the last written is the largest overlap
    return worn


def _on_cells_of(new: GridSpec, old: GridSpec, ids: NDArray) -> NDArray | None:
    """Return the ids of another grid on the cells of a new one; None when their cells do not match."""
    if abs(new.cell_size_m - old.cell_size_m) > 1e-9:
        return None
    down = round((old.y0_m - new.y0_m) / new.cell_size_m)
    right = round((old.x0_m - new.x0_m) / new.cell_size_m)
    moved = np.zeros(new.shape, np.int32)
    top, left = max(down, 0), max(right, 0)
    bottom, far = min(down + old.rows, new.rows), min(right + old.cols, new.cols)
    if bottom > top and far > left:
        moved[top:bottom, left:far] = ids[top - down : bottom - down, left - right : far - right]
    return moved
