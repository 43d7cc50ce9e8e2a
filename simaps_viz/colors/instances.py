"""Colours of a map's objects: neighbours differ, and an object keeps its colour whatever else changes.

Every finest community gets a colour once, and an instance has that of the community after which it is numbered. So
moving K or the evidence never recolours what it does not join. A map that was built anew, edited or split in another
way takes over the colours of the one before it by overlap (``take_over``).
"""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.array_cache import ArrayCache
from simaps_viz.colors.classes import COMMON, class_color
from simaps_viz.colors.palette import ALIKE, PALETTE, Color, as_color, color_of_number
from simaps_viz.geometry import moved, shared_cells
from simaps_viz.structures import GridSpec, MergeLog, SIMap

TOUCHES, CLOSE, NEAR = 100, 10, 1
"""How much it matters that the colours of two ids differ that touch, have one or two cells between them, or some more.
So a pair that touches is told apart even at the cost of many close ones, and a close one of many farther ones."""
_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
STEPS = {
    (s * down, s * right): weight
    for s, weight in {1: TOUCHES, 2: CLOSE, 3: CLOSE, 5: NEAR, 8: NEAR}.items()
    for down, right in _DIRECTIONS
} | dict.fromkeys([(5, 2), (2, 5), (5, -2), (2, -5), (7, 3), (3, 7), (7, -3), (3, -7)], NEAR)
"""{(rows, columns): weight}: ids are near one another if some of their cells are such a step apart; weights fall."""
SAME = 1000
"""How much worse the same colour is than two that some people confuse (``ALIKE``)."""
KEEPING = 150
"""What it costs that an object loses the colour it had: as much as to touch one or two of a colour like its own."""
WISHING = 5
"""What it costs that an object without an earlier colour does not have that of its number."""
LASTING = 0.15
"""The share of merges, those of the laxest thresholds, after which the ids left are the objects that people see; only
their colours are improved, as communities are too many."""
MAX_ROUNDS = 10

_CLOSENESS = SAME * np.eye(len(PALETTE), dtype=np.int64)
for _one, _other in ALIKE:
    _CLOSENESS[_one, _other] = _CLOSENESS[_other, _one] = 1

_instance_colors, _class_colors = ArrayCache(), ArrayCache()


def instance_colors(simap: SIMap) -> NDArray:
    """Return the colour of every instance and every finest community.

    Returns:
        uint8 [n, 3], RGB, indexed by id; row 0 is black. The same for every K or evidence of a map.
    """
    return _instance_colors.get(_arrays(simap), None, lambda: _chosen_colors(simap, None))


def color_of_instance(simap: SIMap, instance_id: int) -> Color:
    """Return the colour of one instance; one that no cell shows has the colour of its number."""
    colors = instance_colors(simap)
    return as_color(colors[instance_id]) if instance_id < len(colors) else color_of_number(instance_id)


def take_over(simap: SIMap, before: SIMap, first: int | None = None) -> None:
    """Let the objects of a map have the colours of those of an earlier map of the same place that they overlap most.

    The object in which most of the earlier map's object ``first`` lies gets that one's colour, however small the share.

    Has to be called before the first ``instance_colors(simap)``; does nothing when both maps share their communities.
    """
    arrays, earlier = _arrays(simap), _arrays(before)
    if len(arrays) == len(earlier) and all(new is old for new, old in zip(arrays, earlier, strict=True)):
        return
    _instance_colors.get(arrays, None, lambda: _chosen_colors(simap, _places_before(simap, before, first)))


@dataclass(frozen=True, eq=False)
class Colored:
    """Objects on a grid, each in a colour."""

    spec: GridSpec
    ids: NDArray
    """int32 [rows, cols], 0 = none."""
    colors: NDArray
    """uint8 [n, 3], RGB, indexed by id."""


def colors_like(spec: GridSpec, ids: NDArray, before: Colored | None) -> NDArray:
    """Colour objects of which only the cells are known.

    Neighbours differ; otherwise an object has the colour of the earlier object that it overlaps most.

    Args:
        spec: of the grid.
        ids: int32 [rows, cols], 0 = none.
        before: the earlier objects; None = there were none.

    Returns:
        uint8 [n, 3], RGB, indexed by id; row 0 is black.
    """
    size = 1 + int(ids.max(initial=0))
    old = None if before is None else _on_cells_of(spec, before.spec, before.ids)
    earlier = np.full(size, -1)
    if before is not None and old is not None:
        earlier = _places_by_overlap(ids, old, _places_of(before.colors), size)
    pairs, weight = near_pairs(ids)
    had_one = (earlier >= 0).astype(int)  # who had a colour chooses first
    coloring = _Coloring(_neighbours(pairs, weight, size), earlier, earlier >= 0)
    coloring.add(_by_rank(_cell_counts(ids, size), had_one))
    return coloring.colors()


def keep_classes(simap: SIMap, other: SIMap) -> None:
    """Let the classes of a map have the colours that they have on another map with the same class names."""
    colors = _colors_of_classes(other)
    _class_colors.get((simap.grid.label,), None, lambda: colors)


def class_colors(simap: SIMap) -> dict[str, Color]:
    """Return the colour of every countable class on the map; no two are alike as long as the palette suffices.

    After that colours repeat, but not between classes that touch, where possible. The same for every K or evidence.
    """
    colors = _colors_of_classes(simap)
    names = {simap.grid.labels[graph.label] for graph in simap.graphs} | {one.label for one in simap.instances}
    places = {name: place for place, name in enumerate(simap.grid.labels)}
    return {name: as_color(colors[places[name]]) if name in places else class_color(name) for name in sorted(names)}


def _colors_of_classes(simap: SIMap) -> NDArray:
    return _class_colors.get((simap.grid.label,), None, lambda: _choose_class_colors(simap))


def _choose_class_colors(simap: SIMap) -> NDArray:
    """Return uint8 [labels, 3]; common indoor classes choose first, then the others by name."""
    labels = simap.grid.labels
    used = np.zeros(len(PALETTE))
    things = np.array(simap.grid.is_thing, dtype=bool)[simap.grid.label]
    present = np.flatnonzero(np.bincount(simap.grid.label[things], minlength=len(labels)))
    pairs, weight = near_pairs(np.where(things, simap.grid.label, 0))
    touching = pairs[weight == TOUCHES]
    chosen = np.full(len(labels), -1)
    colors = np.array([class_color(name) for name in labels], np.uint8).reshape(-1, 3)
    order = sorted(present.tolist(), key=lambda i: (labels[i] not in COMMON, labels[i]))
    for one in order:
        # The least used colour, beginning with that of the name; once colours repeat, none that a toucher has.
        cost = used.copy()
        if len(order) > len(PALETTE):
            beside = np.r_[touching[touching[:, 0] == one, 1], touching[touching[:, 1] == one, 0]]
            taken = chosen[beside]
            cost += np.bincount(taken[taken >= 0], minlength=len(PALETTE)) * TOUCHES
        color = class_color(labels[one])
        chosen[one] = _first_cheapest(cost, PALETTE.index(color) if color in PALETTE else 0)
        used[chosen[one]] += 1
        colors[one] = PALETTE[chosen[one]]
    return colors


def _arrays(simap: SIMap) -> tuple[NDArray, ...]:
    """Return the arrays that the colours of instances depend on."""
    own = () if _numbered_by_communities(simap) else (simap.instance,)
    return (simap.community, simap.merges.source, *own)


def _numbered_by_communities(simap: SIMap) -> bool:
    """Whether every instance has the number of a community that lies in it, as on a map without edits."""
    return max((one.id for one in simap.instances), default=0) <= int(simap.community.max(initial=0))


def _chosen_colors(simap: SIMap, earlier: NDArray | None) -> NDArray:
    """Choose the colours of communities and instances; ``earlier``: palette places they had, int [n], -1 = none."""
    community, instance = simap.community, simap.instance
    size = 1 + max(int(community.max(initial=0)), int(instance.max(initial=0)))
    cells = _cell_counts(community, size)
    pairs, weight = near_pairs(community)
    if not _numbered_by_communities(simap):
        # Edits made instances with numbers of their own, which have neighbours too.
        others, their_weight = near_pairs(instance)
        pairs, weight = np.concatenate([pairs, others]), np.concatenate([weight, their_weight])
        cells = np.where(cells > 0, cells, _cell_counts(instance, size))
    conflicts, lasts = _ever_neighbours(_neighbours(pairs, weight, size), simap.merges)
    places = np.full(size, -1)
    if earlier is not None:
        places[: len(earlier)] = earlier
    # Those that number an object longest choose first, and their colours are improved before others look for theirs.
    shown = np.isin(np.arange(size), instance)  # the others are parts, which only wish to look like what they were in
    coloring, order = _Coloring(conflicts, places, (places >= 0) & shown), _by_rank(cells, lasts)
    lasting = lasts[order] >= (1.0 - LASTING) * len(simap.merges)
    coloring.add(order[lasting])
    coloring.improve(order[lasting])
    coloring.add(order[~lasting])
    return coloring.colors()


def _cell_counts(ids: NDArray, size: int) -> NDArray:
    """Count the cells of each id, int [size]; 0 is nobody and has none."""
    cells = np.bincount(ids.reshape(-1), minlength=size)
    cells[0] = 0
    return cells


def near_pairs(ids: NDArray) -> tuple[NDArray, NDArray]:
    """Find the ids that lie near one another; 0 is nobody.

    Args:
        ids: int [rows, cols].

    Returns:
        int64 [n, 2], pairs, lower id first, ascending; and int64 [n], the weight of the smallest step between them.
    """
    size = int(ids.max(initial=0)) + 1
    found = [_pairs_apart(ids, step) for step in STEPS]
    low, high = np.sort(np.concatenate(found), axis=1).T
    keys, first = np.unique(low * size + high, return_index=True)
    weight = np.repeat(list(STEPS.values()), [len(one) for one in found])
    return np.stack(np.divmod(keys, size), axis=1), weight[first]


def _pairs_apart(ids: NDArray, step: tuple[int, int]) -> NDArray:
    """Return the ids that have cells exactly that step apart, int64 [n, 2]; most pairs several times."""
    found = np.empty((1 + 4 * int(ids.max(initial=0)), 2), np.int64)
    count = _find_pairs(ids, *step, found)
    if count > len(found):
        found = np.empty((count, 2), np.int64)
        _find_pairs(ids, *step, found)
    return found[:count]


@numba.njit(cache=True)
def _find_pairs(ids: NDArray, down: int, right: int, found: NDArray) -> int:
    """Write pairs of ids with cells exactly that step apart; return how many there are, also if there is less room."""
    rows, cols = ids.shape
    first, count = max(0, -right), 0
    for row in range(rows - down):
        for col in range(first, min(cols, cols - right)):
            one, other = ids[row, col], ids[row + down, col + right]
            if not one or not other or one == other:
                continue
            # The cell to the west, or to the south, has told of the same pair.
            if col > first and ids[row, col - 1] == one and ids[row + down, col + right - 1] == other:
                continue
            if row > 0 and ids[row - 1, col] == one and ids[row + down - 1, col + right] == other:
                continue
            if count < len(found):
                found[count, 0], found[count, 1] = one, other
            count += 1
    return count


Neighbours = list[dict[int, int]]
"""For each community: {another: how much it matters that their colours differ}."""


def _neighbours(pairs: NDArray, weight: NDArray, size: int) -> Neighbours:
    beside: Neighbours = [{} for _ in range(size)]
    for (a, b), w in zip(pairs.tolist(), weight.tolist(), strict=True):
        beside[a][b] = beside[b][a] = w
    return beside


def _ever_neighbours(beside: Neighbours, merges: MergeLog) -> tuple[Neighbours, NDArray]:
    """Find, for each community, those that should not share its colour: they number an instance near its own.

    The merges are replayed from the strictest threshold to the laxest; what becomes one is numbered by its smallest
    community, which then has the neighbours of both.

    Args:
        beside: the neighbours before any merge; changed in place.
        merges: the merge log.

    Returns:
        those neighbours; and int [size], after how many merges nothing is numbered by the community any more.
    """
    conflicts = [dict(one) for one in beside]
    lasts = np.full(len(beside), len(merges))
    parent = list(range(len(beside)))

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
        # The neighbours of the one that goes become neighbours of the one that stays.
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


def _by_rank(cells: NDArray, rank: NDArray) -> NDArray:
    """Return the ids that have cells, the highest rank first, and among equals those of most cells."""
    order = np.lexsort((np.arange(len(cells)), -cells, -rank))
    return order[cells[order] > 0]


class _Coloring:
    """Ids and the colours chosen for them so far, as places in the palette."""

    def __init__(self, conflicts: Neighbours, earlier: NDArray, keep: NDArray) -> None:
        """Colour nobody yet.

        Args:
            conflicts: the neighbours of each id.
            earlier: int [n], the places that ids had before, -1 = none.
            keep: bool [n], the ids that should keep them; the others only begin with them.
        """
        self._others = [np.fromiter(one, np.int64, len(one)) for one in conflicts]
        self._weights = [np.fromiter(one.values(), np.int64, len(one)) for one in conflicts]
        self._wish = np.where(earlier >= 0, earlier, (np.arange(len(earlier)) - 1) % len(PALETTE))
        self._chosen = np.full(len(earlier), -1)
        # What each colour would cost each id: its closeness to those of neighbours, by how much these matter.
        other = np.arange(len(PALETTE)) != self._wish[:, None]
        self._cost = np.where(keep, KEEPING, WISHING)[:, None] * other

    def add(self, ids: NDArray) -> None:
        """Colour ids one after the other, each in the colour that costs least, beginning with the one it wishes."""
        for one in ids.tolist():
            self._put(one, _first_cheapest(self._cost[one], int(self._wish[one])))

    def improve(self, ids: NDArray) -> None:
        """Recolour ids as long as that makes neighbours more different, also where a neighbour has to give way."""
        for _ in range(MAX_ROUNDS):
            if not sum([self._improve(one) for one in ids.tolist()]):
                return

    def colors(self) -> NDArray:
        """Return the colours, uint8 [n, 3], RGB, indexed by id; row 0 is black."""
        colors = np.array(PALETTE, np.uint8)[np.where(self._chosen < 0, self._wish, self._chosen)]
        colors[0] = 0
        return colors

    def _put(self, one: int, place: int) -> None:
        before = self._chosen[one]
        if place == before:
            return
        change = _CLOSENESS[place] - (_CLOSENESS[before] if before >= 0 else 0)
        self._cost[self._others[one]] += self._weights[one][:, None] * change  # no id is twice among the others
        self._chosen[one] = place

    def _improve(self, one: int) -> bool:
        """Recolour an id, and those of its neighbours that would then look like it; whether that was for the better."""
        own = int(self._chosen[one])
        if self._cost[one, own] < CLOSE:
            return False  # farther neighbours alone are not worth a change
        colored = self._chosen[self._others[one]] >= 0
        others, weights = self._others[one][colored], self._weights[one][colored]
        theirs = self._chosen[others]
        # The gain of each colour: its own, and that of each neighbour that can then give way, as if it were alone.
        then = self._cost[others] + weights[:, None] * (_CLOSENESS - _CLOSENESS[own])[:, None]
        given = then[:, np.arange(len(others)), theirs] - then.min(axis=2)
        gain = self._cost[one, own] - self._cost[one] + given.sum(axis=1)
        for place in np.argsort(-gain, kind="stable").tolist():
            if gain[place] <= 0 or place == own:
                return False
            giving_way = np.argsort(-given[place], kind="stable")[: np.count_nonzero(given[place])]
            if self._try(one, place, others[giving_way]):
                return True
        return False

    def _try(self, one: int, place: int, giving_way: NDArray) -> bool:
        """Recolour an id and have neighbours give way, in this order; undo all of it unless something is gained."""
        undo = [(one, int(self._chosen[one]))]
        gained = int(self._cost[one, self._chosen[one]] - self._cost[one, place])
        self._put(one, place)
        for other in giving_way.tolist():
            was = int(self._chosen[other])
            best = _first_cheapest(self._cost[other], was)
            gained += int(self._cost[other, was] - self._cost[other, best])
            undo.append((other, was))
            self._put(other, best)
        if gained <= 0:
            for other, was in reversed(undo):
                self._put(other, was)
        return gained > 0


def _first_cheapest(cost: NDArray, start: int) -> int:
    """Return the place of the lowest cost, the first from ``start`` on, going around."""
    later, sooner = start + int(cost[start:].argmin()), int(cost[: start + 1].argmin())
    return sooner if cost[sooner] < cost[later] else later


def _places_before(simap: SIMap, before: SIMap, first: int | None) -> NDArray | None:
    """Return, for each id, the palette place of the earlier map's instance that it overlaps most; -1 = none."""
    old = _on_cells_of(simap.spec, before.spec, before.instance)
    if old is None:
        return None
    size = 1 + max(int(simap.community.max(initial=0)), int(simap.instance.max(initial=0)))
    places = _places_of(instance_colors(before))
    by_instance = _places_by_overlap(simap.instance, old, places, size)
    by_community = _places_by_overlap(simap.community, old, places, size)
    earlier = np.where(by_community >= 0, by_community, by_instance)  # communities overrule, where there are any
    if first is not None:
        inside = simap.instance[(old == first) & (simap.instance > 0)]
        if inside.size:
            earlier[np.bincount(inside).argmax()] = places[first]
    return earlier


def _places_of(colors: NDArray) -> NDArray:
    """Return the palette place of each colour, int [n]; -1 = none."""
    places = {color: place for place, color in enumerate(PALETTE)}
    return np.array([places.get(tuple(color), -1) for color in colors.tolist()])


def _places_by_overlap(ids: NDArray, old: NDArray, places: NDArray, size: int) -> NDArray:
    """Return, for each id, the palette place of the old id that it overlaps most, int [size]; -1 = none."""
    found = np.full(size, -1)
    mine, theirs, shared = shared_cells(ids, old)
    order = np.argsort(shared, kind="stable")
    found[mine[order]] = places[theirs[order]]  # the last written is the largest overlap
    return found


def _on_cells_of(new: GridSpec, old: GridSpec, ids: NDArray) -> NDArray | None:
    """Return the ids of another grid on the cells of a new one; None when their cells do not match."""
    if abs(new.cell_size_m - old.cell_size_m) > 1e-9:
        return None
    shift = (round((old.y0_m - new.y0_m) / new.cell_size_m), round((old.x0_m - new.x0_m) / new.cell_size_m))
    return moved(ids, shift, new.shape, 0)
