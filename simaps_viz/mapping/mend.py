"""Replaying edits on a map: a mended map is a map like any other, and as good a start for another K.

What edits touched becomes one finest community each, which no step of the merge log reaches any more. So what a person
mended stays as it is while K moves all the rest; `repartition` of a mended map is the mended map for that K. (Louvain
with another resolution begins from the cells again: there, edits are replayed on the unmended map.)
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.labels import is_thing
from simaps_viz.mapping.bands import look_up
from simaps_viz.mapping.edits import Delete, Edit, Merge, Relabel, Split, check_sides, sides, smallest
from simaps_viz.mapping.mend_parts import graphs_after, log_without, views_after
from simaps_viz.mapping.partition import applied_steps, empty_log, instance_of_community
from simaps_viz.mapping.simap import assemble, joining_threshold, origin_of
from simaps_viz.structures import Grid, SIMap

MOST_CLASSES = np.iinfo(np.int16).max


@dataclass(frozen=True, eq=False)
class Replayed:
    """A map with edits on it."""

    simap: SIMap
    refused: tuple[tuple[int, str], ...] = ()
    """Position among the edits and why, in words: those that no longer make sense here. They changed nothing."""


class _Sheet:
    """The arrays that edits change, flat."""

    def __init__(self, simap: SIMap) -> None:
        self.spec = simap.spec
        self.least = smallest(simap)
        self.label = simap.grid.label.reshape(-1).copy()
        self.labels = list(simap.grid.labels)
        self.is_thing = list(simap.grid.is_thing)
        self.community = simap.community.reshape(-1).copy()
        numbers = (simap.community, simap.views.community, simap.merges.source, simap.merges.target)
        self.next = 1 + max(int(part.max(initial=0)) for part in numbers)
        self.size = np.bincount(self.community, minlength=self.next).tolist()
        self.touched: set[int] = set()

    def class_index(self, label: str) -> int:
        """Give the index of a class, which is added when it is new."""
        if label not in self.labels:
            if len(self.labels) >= MOST_CLASSES:
                raise InputError(f"class {label}: expected fewer than {MOST_CLASSES} classes on a map")
            self.labels.append(label)
            self.is_thing.append(is_thing(label))
        return self.labels.index(label)

    def fresh(self) -> int:
        """Give a number no community has had."""
        self.size.append(0)
        self.next += 1
        return self.next - 1

    def claim(self, groups: Sequence[NDArray], label: str) -> None:
        """Make every group of cells one community of a class, or of none where the class is uncountable.

        A community belongs to the group, or to the cells outside, that has most of its cells (ties: the first group). A
        group takes the smallest number of those that belong to it, so that what it was mainly made of keeps its name;
        cells left over from a community that belongs to a group get a fresh one.
        """
        index = self.class_index(label)
        owned, rest = self._owners(groups)
        for number in rest:
            self._leave(number, groups)
        for group, numbers in zip(groups, owned, strict=True):
            self.label[group] = index
            number = 0
            if index and self.is_thing[index]:
                number = min(numbers) if numbers else self.fresh()
            old, counts = np.unique(self.community[group], return_counts=True)
            for one, cells in zip(old.tolist(), counts.tolist(), strict=True):
                self.size[one] -= cells
            self.community[group] = number
            self.size[number] += len(group)
            self.touched.update(numbers)

    def _owners(self, groups: Sequence[NDArray]) -> tuple[list[list[int]], list[int]]:
        """Say which communities belong to each group, and which of these have cells outside all groups."""
        share: dict[int, list[int]] = {}
        for i, group in enumerate(groups):
            for number, cells in zip(
                *(a.tolist() for a in np.unique(self.community[group], return_counts=True)), strict=True
            ):
                if number:
                    share.setdefault(number, [0] * len(groups))[i] += cells
        owned: list[list[int]] = [[] for _ in groups]
        rest = []
        for number, cells in share.items():
            outside = self.size[number] - sum(cells)
            if max(cells) >= outside:
                owned[cells.index(max(cells))].append(number)
                rest += [number] if outside else []
        return owned, rest

    def _leave(self, number: int, groups: Sequence[NDArray]) -> None:
        """Give the cells of a community that lie outside all groups a number of their own."""
        left = np.setdiff1d(np.flatnonzero(self.community == number), np.concatenate(groups), assume_unique=True)
        fresh = self.fresh()
        self.community[left] = fresh
        self.size[number] -= len(left)
        self.size[fresh] += len(left)

    def still(self, edit: Edit) -> NDArray:
        """Give the cells of an edit that still carry the class it speaks of.

        Raises:
            InputError: these are fewer than half.
        """
        cells = edit.region.cells()
        wanted = [self.labels.index(name) for name in edit.was if name in self.labels]
        kept = cells[np.isin(self.label[cells], wanted) & (self.community[cells] > 0)]
        if len(cells) == 0 or 2 * len(kept) < len(cells):
            what = " or ".join(dict.fromkeys(edit.was))
            raise InputError(
                f"{edit.words}: no longer makes sense: {len(kept)} of its {len(cells)} cells are {what} now"
            )
        return kept

    def apply(self, edit: Edit) -> None:
        """Do one edit, or raise InputError and change nothing."""
        cells = self.still(edit)
        if isinstance(edit, Split):
            both = sides(self.spec, cells, edit.line_m)
            check_sides(both, f"{edit.label} #{edit.object}", self.least)
            self.claim(both, edit.label)
        elif isinstance(edit, Merge | Relabel):
            self.claim([cells], edit.label)
        elif isinstance(edit, Delete):
            self.claim([cells], self.labels[0])


def replay(simap: SIMap, edits: Sequence[Edit]) -> Replayed:
    """Do edits, in order, on a map that has none yet; the map itself is returned when nothing remains to be done.

    Whatever an edit did not touch keeps its id, its cells and all that is said of it.
    """
    if not edits:
        return Replayed(simap)
    base = _with_communities(simap)
    sheet = _Sheet(base)
    refused = []
    for i, edit in enumerate(edits):
        try:
            sheet.apply(edit)
        except InputError as error:
            refused.append((i, str(error)))
    if len(refused) == len(edits):
        return Replayed(simap, tuple(refused))
    return Replayed(_finish(simap, base, sheet), tuple(refused))


def apply(simap: SIMap, edit: Edit) -> SIMap:
    """Do one edit on a map that has none yet.

    Raises:
        InputError: it does not make sense on this map.
    """
    done = replay(simap, (edit,))
    if done.refused:
        raise InputError(done.refused[0][1])
    return done.simap


def _with_communities(simap: SIMap) -> SIMap:
    """Give the map itself, or, when its instances do not follow from its communities, one where each is a community."""
    applied = applied_steps(simap.merges, joining_threshold(simap.method, simap.parameters))
    highest = max(int(a.max(initial=0)) for a in (simap.community, simap.merges.source, simap.merges.target))
    follows = look_up(instance_of_community(simap.merges, applied, highest), simap.community)
    follows[np.bincount(follows.reshape(-1))[follows] < smallest(simap)] = 0
    if np.array_equal(follows, simap.instance):
        return simap
    return replace(simap, community=simap.instance, merges=empty_log())


def _finish(simap: SIMap, base: SIMap, sheet: _Sheet) -> SIMap:
    """Put a mended map together; ``base`` is ``simap`` with the communities that the sheet began with."""
    shape = simap.spec.shape
    community, grid = sheet.community.reshape(shape), simap.grid
    if not np.array_equal(sheet.label, grid.label.reshape(-1)) or len(sheet.labels) > len(grid.labels):
        grid = Grid(
            grid.spec, tuple(sheet.labels), tuple(sheet.is_thing), sheet.label.reshape(shape), grid.height_m,
            grid.lowest_m, grid.observations,
        )  # fmt: skip
    log = log_without(base.merges, np.fromiter(sheet.touched, np.int32, len(sheet.touched)))
    mended = assemble(grid, graphs_after(simap, grid), community, log, views_after(simap, community), origin_of(simap))
    changed = (mended.instance != simap.instance) | (grid.label != simap.grid.label)
    touched = set(np.unique(mended.instance[changed]).tolist()) | set(np.unique(simap.instance[changed]).tolist())
    touched |= set(np.unique(mended.instance[community != base.community]).tolist())
    before = {one.id: one for one in simap.instances if one.id not in touched}
    return replace(mended, instances=tuple(before.get(one.id, one) for one in mended.instances))
