"""Edits by hand: join two objects, cut one in two, give one another class, take one away.

An edit names *cells*, not ids: ids follow from a partition and mean other objects once Louvain ran with another
resolution, while cells stay where they are. "These cells are one object" holds for any partition of the same grid, so
edits can be applied again whatever K, affinity or resolution make of the rest.

An edit is made on the map that a person looks at (`merge`, `split`, `relabel`, `delete`) and applied, with all edits
before it, to the map as it was built (`apply_edits`). The edits of a map and their file are in `mapping.mending`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import is_thing
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_CLASSES
from simaps_viz.mapping.floor_plan import room_layer
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.partition import applied_steps, empty_log, group_views, instance_of_community, look_up
from simaps_viz.mapping.simap import assemble, joining_threshold, origin_of
from simaps_viz.structures import CellGraph, Grid, GridSpec, Instance, MergeLog, Room, SIMap, Views

Point = tuple[float, float]
"""x and y in metres, map frame."""
MAX_LABEL_LENGTH = 40
"""Characters of a class name."""


class EditRefused(InputError):  # noqa: N818 - a refusal, not a fault
    """An edit makes no sense on this map; ``plain`` explains it to a person who sees the map, without ids."""

    def __init__(self, message: str, plain: str) -> None:
        super().__init__(message)
        self.plain = plain


@dataclass(frozen=True)
class Region:
    """Cells of a grid, as runs of flat cell numbers (row * cols + col)."""

    runs: tuple[tuple[int, int], ...]
    """(first cell, number of cells), ascending, with gaps between."""

    @classmethod
    def of(cls, cells: NDArray) -> "Region":
        """Return the region of flat cell numbers, int64 [n], ascending."""
        if len(cells) == 0:
            return cls(())
        begins = np.flatnonzero(np.r_[True, np.diff(cells) != 1])
        lengths = np.diff(np.r_[begins, len(cells)])
        return cls(tuple(zip(cells[begins].tolist(), lengths.tolist(), strict=True)))

    def cells(self) -> NDArray:
        """Return the flat cell numbers, int64 [n], ascending."""
        if not self.runs:
            return np.zeros(0, np.int64)
        first, length = np.array(self.runs, np.int64).T
        starts = np.cumsum(length) - length
        return np.repeat(first - starts, length) + np.arange(int(length.sum()))


@dataclass(frozen=True)
class Edit:
    """What a person decided about some cells, as one of `MAKERS`."""

    kind: str
    """Merge: these cells are one object. Split: they are two, one on each side of a line. Relabel: they are one object
    of another class, or none when that is uncountable (wall). Delete: they are no object and have no class, and still
    block a robot. Of rooms, which are those that have most of these cells: rename-room, join-rooms, cut-room."""
    ids: tuple[int, ...]
    """The ids of the objects or rooms when the edit was made; only for descriptions."""
    was: tuple[str, ...]
    """Their classes, or the rooms' names."""
    region: Region
    label: str = ""
    """The class or name that they have now; empty for those that name none."""
    line_m: tuple[Point, Point] | None = None
    """Two points of the straight line of a cut, which extends beyond both. A cell whose centre is on it belongs to the
    right."""

    @property
    def of_room(self) -> bool:
        """Whether it is about rooms, not objects."""
        return self.kind.endswith(("-room", "-rooms"))


TWO, CUTS, LABELLED = ("merge", "join-rooms"), ("split", "cut-room"), ("merge", "relabel", "rename-room")
"""The kinds that join two objects or rooms, those that cut one, and those that name what comes of it."""


def describe_by_id(edit: Edit) -> str:
    """Describe an edit by the ids that its objects had: "joined chair #3 and chair #4"."""
    if edit.of_room:  # whose names are unlike
        return _describe(edit, [f"the {name.removeprefix('the ')}" for name in edit.was])
    return _describe(edit, [f"{label} #{i}" for label, i in zip(edit.was, edit.ids, strict=True)])


def describe_by_number(edit: Edit, simap: SIMap) -> str:
    """Describe an edit of the map it was made on as the page numbers objects: "joined chair 2 and chair 3"."""
    return describe_by_id(edit) if edit.of_room else _describe(edit, [simap.by_id(i).name for i in edit.ids])


def describe_by_class(edit: Edit) -> str:
    """Describe an edit where the map it was made on is not at hand, by classes alone: "took one away: chair"."""
    label = " and ".join(dict.fromkeys(edit.was))
    plain = {
        "merge": f"joined two objects: {label}", "split": f"cut one in two: {label}",
        "relabel": f"{label} is called {edit.label}", "delete": f"took one away: {label}",
    }  # fmt: skip
    return plain.get(edit.kind) or describe_by_id(edit)


def _describe(edit: Edit, names: Sequence[str]) -> str:
    if edit.kind in TWO:
        return f"joined {names[0]} and {names[1]}"
    if edit.kind in CUTS:
        return f"cut {names[0]} in two"
    return f"{names[0]} is called {edit.label}" if edit.label else f"took away {names[0]}"


def _shown(simap: SIMap, instance_id: int) -> Instance:
    """Return an object that has cells on the map; raises InputError for any other."""
    one = simap.by_id(instance_id)
    if one in simap.hidden:
        raise EditRefused(
            f"{one.label} #{one.id}: expected an object that the map shows from above, found one under or in others",
            "That lies under or in something else. Only what the map shows from above can be changed by hand.",
        )
    return one


def merge(simap: SIMap, first_id: int, second_id: int) -> Edit:
    """Join two objects; the class is that of the first.

    Raises:
        InputError: one of them is not on the map, or they are the same.
    """
    first, second = _shown(simap, first_id), _shown(simap, second_id)
    if first.id == second.id:
        raise EditRefused(
            f"join: expected two objects, found {first.label} #{first.id} twice",
            "That is the same object. Choose another one.",
        )
    both = np.flatnonzero(np.isin(simap.instance, (first.id, second.id)))
    return Edit("merge", (first.id, second.id), (first.label, second.label), Region.of(both), first.label)


def split(simap: SIMap, instance_id: int, start_m: Point, end_m: Point) -> Edit:
    """Cut an object along the straight line through two points, map frame, metres.

    Raises:
        InputError: it is not on the map, the line has no direction or does not cut it, or a side is too small.
    """
    one = _shown(simap, instance_id)
    line = (_point(start_m), _point(end_m))
    if np.hypot(line[1][0] - line[0][0], line[1][1] - line[0][1]) < 1e-6:
        raise EditRefused(
            "cut: expected a line between two different points, found the same point twice",
            f"Both clicks are at the same place. Click on both sides of {one.name}.",
        )
    cells = _cells(simap, one.id)
    check_sides(sides(simap.spec, cells, line), f"{one.label} #{one.id}", min_cells(simap), one.name)
    return Edit("split", (one.id,), (one.label,), Region.of(cells), one.label, line)


def relabel(simap: SIMap, instance_id: int, label: str) -> Edit:
    """Change the class of an object to one of the map, in whatever case, or to a new one.

    Raises:
        InputError: it is not on the map, or has that class already, or the name cannot be a class.
    """
    one = _shown(simap, instance_id)
    name = class_name(simap, label)
    if name == one.label:
        raise EditRefused(
            f"class: expected another one than {name} for #{one.id}, which is called so already",
            f"It is called {name} already. Choose another class.",
        )
    return Edit("relabel", (one.id,), (one.label,), Region.of(_cells(simap, one.id)), name)


def delete(simap: SIMap, instance_id: int) -> Edit:
    """Take an object away.

    Raises:
        InputError: it is not on the map.
    """
    one = _shown(simap, instance_id)
    return Edit("delete", (one.id,), (one.label,), Region.of(_cells(simap, one.id)))


def rename_room(simap: SIMap, room_id: int, name: str) -> Edit:
    """Name a room as a person does.

    Raises:
        InputError: it is not on the map, or the name is empty, too long, or that of another room.
    """
    room, wanted = _room(simap, room_id), " ".join(name.split())
    if not wanted or not wanted.isprintable() or len(wanted) > MAX_LABEL_LENGTH:
        raise EditRefused(
            f"room: expected a name of 1 to {MAX_LABEL_LENGTH} characters, found {name[:60]!r}",
            f"A room has a name of 1 to {MAX_LABEL_LENGTH} characters.",
        )
    if any(other.name.casefold() == wanted.casefold() for other in simap.rooms):
        raise EditRefused(
            f"room: expected a name that no room has, found {wanted!r}", f"There is a room called {wanted} already."
        )
    return Edit("rename-room", (room.id,), (room.name,), _region_of(simap, room.id), wanted)


def join_rooms(simap: SIMap, first_id: int, second_id: int) -> Edit:
    """Join two rooms; the larger one keeps its id and its name.

    Raises:
        InputError: one of them is not on the map, or they are the same.
    """
    first, second = _room(simap, first_id), _room(simap, second_id)
    if first.id == second.id:
        raise EditRefused(
            f"rooms: expected two rooms, found room {first.id} twice", "That is the same room. Choose another one."
        )
    region = _region_of(simap, first.id, second.id)
    return Edit("join-rooms", (first.id, second.id), (first.name, second.name), region)


def cut_room(simap: SIMap, room_id: int, start_m: Point, end_m: Point) -> Edit:
    """Cut a room along the straight line through two points, map frame, metres; the larger part keeps id and name.

    Raises:
        InputError: it is not on the map, the line has no direction or does not cut it.
    """
    room, line = _room(simap, room_id), (_point(start_m), _point(end_m))
    if line[0] == line[1]:
        raise EditRefused(
            "cut: expected a line between two different points, found the same point twice",
            f"Both clicks are at the same place. Click on both sides of the {room.name}.",
        )
    region = _region_of(simap, room.id)
    check_sides(sides(simap.spec, region.cells(), line), f"room {room.id}", 1, f"the {room.name}")
    return Edit("cut-room", (room.id,), (room.name,), region, line_m=line)


MAKERS: dict[str, Callable[..., Edit]] = {
    "merge": merge, "split": split, "relabel": relabel, "delete": delete,
    "rename-room": rename_room, "join-rooms": join_rooms, "cut-room": cut_room,
}  # fmt: skip
"""What makes an edit of each kind, from the map that is shown and what the kind asks for."""


def _room(simap: SIMap, room_id: int) -> Room:
    for room in simap.rooms:
        if room.id == room_id:
            return room
    raise InputError(f"room {room_id}: not on this map, which has {len(simap.rooms)} rooms")


def _region_of(simap: SIMap, *room_ids: int) -> Region:
    return Region.of(np.flatnonzero(np.isin(simap.room_cells, room_ids)))


def class_name(simap: SIMap, text: str) -> str:
    """Return a class name as the map spells it, or a new one with single spaces.

    Raises:
        InputError: it is empty, "none", too long, or has characters that cannot be shown.
    """
    name = " ".join(text.split())
    if not name or not name.isprintable() or len(name) > MAX_LABEL_LENGTH or name.casefold() == "none":
        raise EditRefused(
            f"class: expected a name of 1 to {MAX_LABEL_LENGTH} characters, found {text[:60]!r}",
            f'A class has a name of 1 to {MAX_LABEL_LENGTH} characters, other than "none". This one has {len(name)}.',
        )
    known = {label.casefold(): label for label in simap.grid.labels}
    return known.get(name.casefold(), name)


def sides(spec: GridSpec, cells: NDArray, line_m: tuple[Point, Point]) -> tuple[NDArray, NDArray]:
    """Sort cells by the side of a line that their centres are on.

    Args:
        spec: the grid.
        cells: int [n], row * cols + col.
        line_m: two different points of the line, (x, y) in the map frame; left and right are seen along it.

    Returns:
        The cells left of the line, and those right of it or on it, int, in the order given.
    """
    (ax, ay), (bx, by) = line_m
    row, col = np.divmod(cells, spec.cols)
    x, y = spec.centres_of(row, col).T
    length = np.hypot(bx - ax, by - ay)
    off_m = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / length
    left = off_m > 1e-9
    return cells[left], cells[~left]


def check_sides(both: tuple[NDArray, NDArray], name: str, least: int, plain_name: str = "the object") -> None:
    """Raise EditRefused unless a cut leaves cells enough for an object on both sides.

    Args:
        both: the cells of each side, from `sides`.
        name: the object that is cut.
        least: the number of cells that an object of this map has at least.
        plain_name: the object, for a person who sees the map.
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


def min_cells(simap: SIMap) -> int:
    """Return the number of cells that an object of the map has at least."""
    return max(int(simap.parameters.get("min_cells", 1)), 1)


def _cells(simap: SIMap, instance_id: int) -> NDArray:
    return np.flatnonzero(simap.instance == instance_id)


def _point(point: Point) -> Point:
    x, y = (round(float(v), 4) for v in point)
    if not np.isfinite([x, y]).all():
        raise InputError(f"cut: expected points in metres, found {point!r}")
    return x, y


@dataclass(frozen=True, eq=False)
class Edited:
    """A map with edits applied."""

    simap: SIMap
    refused: tuple[tuple[int, str], ...] = ()
    """(position, reason) of the edits that no longer make sense on this map. They changed nothing."""


def apply_edits(simap: SIMap, edits: Sequence[Edit]) -> Edited:
    """Apply edits, in order, to a map that has none yet; the map itself is returned when none of them applies.

    What no edit touched keeps its id, its cells and its facts.
    """
    if not edits:
        return Edited(simap)
    base = _with_communities(simap)
    draft = _Draft(base)
    refused = []
    for i, edit in enumerate(edits):
        try:
            draft.apply(edit)
        except InputError as error:
            refused.append((i, str(error)))
    failed = {i for i, _ in refused}
    of_rooms = {edit.of_room for i, edit in enumerate(edits) if i not in failed}
    finished = _finish(simap, base, draft) if False in of_rooms else simap
    if True in of_rooms:
        finished = replace(finished, room=draft.room.reshape(simap.spec.shape), room_names=draft.room_names)
    return Edited(finished, tuple(refused))


def apply(simap: SIMap, edit: Edit) -> SIMap:
    """Apply one edit to a map that has none yet.

    Raises:
        InputError: it does not make sense on this map.
    """
    done = apply_edits(simap, (edit,))
    if done.refused:
        raise InputError(done.refused[0][1])
    return done.simap


class _Draft:
    """The arrays of a map that edits change, flat: the label and the community of each cell."""

    def __init__(self, simap: SIMap) -> None:
        self.spec = simap.spec
        self.least = min_cells(simap)
        self.label = simap.grid.label.reshape(-1).copy()
        self.labels = list(simap.grid.labels)
        self.is_thing = list(simap.grid.is_thing)
        self.community = simap.community.reshape(-1).copy()
        numbers = (simap.community, simap.views.community, simap.merges.source, simap.merges.target)
        self.next = 1 + max(*(int(part.max(initial=0)) for part in numbers), *(one.id for one in simap.hidden), 0)
        self.size = np.bincount(self.community, minlength=self.next).tolist()
        self.touched: set[int] = set()
        self._simap = simap
        self.room_names = dict(simap.room_names)

    @cached_property
    def room(self) -> NDArray:
        """The room of each cell, flat, int32; its names are in ``room_names``."""
        return room_layer(self._simap).reshape(-1).copy()

    def class_index(self, label: str) -> int:
        """Return the index of a class, which is added when it is new."""
        if label not in self.labels:
            if len(self.labels) >= MAX_CLASSES:
                raise InputError(f"class {label}: expected fewer than {MAX_CLASSES} classes on a map")
            self.labels.append(label)
            self.is_thing.append(is_thing(label))
        return self.labels.index(label)

    def fresh(self) -> int:
        """Return a number that no community has had."""
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
        # cells left over leave first, so that what remains of a community belongs to its group
        owned, rest = self._owners(groups)
        for number in rest:
            self._leave(number, groups)
        for group, numbers in zip(groups, owned, strict=True):
            self.label[group] = index
            number = 0
            if index and self.is_thing[index]:
                number = min(numbers) if numbers else self.fresh()
            # sizes change with the cells; communities that belonged to the group are no longer in the merge log
            old, counts = np.unique(self.community[group], return_counts=True)
            for one, cells in zip(old.tolist(), counts.tolist(), strict=True):
                self.size[one] -= cells
            self.community[group] = number
            self.size[number] += len(group)
            self.touched.update(numbers)

    def _owners(self, groups: Sequence[NDArray]) -> tuple[list[list[int]], list[int]]:
        """Return the communities that belong to each group, and which of these have cells outside all groups."""
        share: dict[int, list[int]] = {}
        for i, group in enumerate(groups):
            for number, cells in zip(
                *(a.tolist() for a in np.unique(self.community[group], return_counts=True)), strict=True
            ):
                if number:
                    share.setdefault(number, [0] * len(groups))[i] += cells
        # a community belongs to the group that has most of its cells, unless more of them lie outside
        owned: list[list[int]] = [[] for _ in groups]
        rest = []
        for number, cells in share.items():
            outside = self.size[number] - sum(cells)
            if max(cells) >= outside:
                owned[cells.index(max(cells))].append(number)
                rest += [number] if outside else []
        return owned, rest

    def _leave(self, number: int, groups: Sequence[NDArray]) -> None:
        """Move the cells of a community that lie outside all groups to a community of their own."""
        left = np.setdiff1d(np.flatnonzero(self.community == number), np.concatenate(groups), assume_unique=True)
        fresh = self.fresh()
        self.community[left] = fresh
        self.size[number] -= len(left)
        self.size[fresh] += len(left)

    def _cells_of(self, edit: Edit) -> NDArray:
        """Return the cells of an edit that still have the class it names.

        Raises:
            InputError: these are fewer than half.
        """
        cells = edit.region.cells()
        wanted = [self.labels.index(name) for name in edit.was if name in self.labels]
        kept = cells[np.isin(self.label[cells], wanted) & (self.community[cells] > 0)]
        if len(cells) == 0 or 2 * len(kept) < len(cells):
            what = " or ".join(dict.fromkeys(edit.was))
            raise InputError(
                f"{describe_by_id(edit)}: no longer makes sense: {len(kept)} of its {len(cells)} cells are {what} now"
            )
        return kept

    def apply(self, edit: Edit) -> None:
        """Apply one edit, or raise InputError and change nothing."""
        if edit.of_room:
            self._apply_to_rooms(edit)
            return
        cells = self._cells_of(edit)
        if edit.line_m is not None:
            both = sides(self.spec, cells, edit.line_m)
            check_sides(both, f"{edit.label} #{edit.ids[0]}", self.least)
            self.claim(both, edit.label)
        else:
            self.claim([cells], edit.label or self.labels[0])

    def _apply_to_rooms(self, edit: Edit) -> None:
        region = edit.region.cells()
        count = np.bincount(self.room[region], minlength=int(self.room.max(initial=0)) + 1)
        if not 2 * int(count[1:].sum()) >= max(len(region), 1):
            raise InputError(f"{describe_by_id(edit)}: no longer makes sense: most of its cells are in no room now")
        largest = 1 + int(count[1:].argmax())
        if edit.label:
            self.room_names[largest] = edit.label
        elif edit.line_m is None:
            mostly = 2 * count >= np.maximum(np.bincount(self.room, minlength=len(count)), 1)
            joined = [i for i in np.flatnonzero(mostly).tolist() if i > 0]
            if len(joined) < 2:
                raise InputError(f"{describe_by_id(edit)}: no longer makes sense: they are one room now")
            self.room[np.isin(self.room, joined)] = largest
            for one in set(joined) - {largest}:
                self.room_names.pop(one, None)
        else:
            both = sides(self.spec, np.flatnonzero(self.room == largest), edit.line_m)
            check_sides(both, f"room {largest}", 1)
            self.room[min(both, key=len)] = len(count)


def _with_communities(simap: SIMap) -> SIMap:
    """Return the map itself or, if its instances do not follow from its communities, one where each is a community."""
    applied = applied_steps(simap.merges, joining_threshold(simap.method, simap.parameters))
    highest = max(int(a.max(initial=0)) for a in (simap.community, simap.merges.source, simap.merges.target))
    follows = look_up(instance_of_community(simap.merges, applied, highest), simap.community)
    follows[np.bincount(follows.reshape(-1))[follows] < min_cells(simap)] = 0
    if np.array_equal(follows, simap.instance):
        return simap
    return replace(simap, community=simap.instance, merges=empty_log())


def _finish(simap: SIMap, base: SIMap, draft: _Draft) -> SIMap:
    """Return the edited map; ``base`` is ``simap`` with the communities that the draft began with."""
    shape = simap.spec.shape
    community, grid = draft.community.reshape(shape), simap.grid
    if not np.array_equal(draft.label, grid.label.reshape(-1)) or len(draft.labels) > len(grid.labels):
        grid = Grid(
            grid.spec, tuple(draft.labels), tuple(draft.is_thing), draft.label.reshape(shape), grid.height_m,
            grid.lowest_m, grid.observations,
        )  # fmt: skip
    # merge log, graphs and views follow the communities
    log = log_without(base.merges, np.fromiter(draft.touched, np.int32, len(draft.touched)))
    mended = assemble(grid, graphs_after(simap, grid), community, log, views_after(simap, community), origin_of(simap))
    # an instance that no edit touched keeps its facts, which its cells alone may not tell
    changed = (mended.instance != simap.instance) | (grid.label != simap.grid.label)
    touched = set(np.unique(mended.instance[changed]).tolist()) | set(np.unique(simap.instance[changed]).tolist())
    touched |= set(np.unique(mended.instance[community != base.community]).tolist())
    before = {one.id: one for one in simap.instances if one.id not in touched}
    return replace(mended, instances=tuple(before.get(one.id, one) for one in mended.instances))


def log_without(log: MergeLog, communities: NDArray) -> MergeLog:
    """Return a merge log without the steps of some communities.

    Every threshold still takes the same of the other steps: it takes the steps of a class up to the first whose score
    is too low, so a step after a dropped one takes over its score if that is lower.
    """
    gone = np.isin(log.source, communities) | np.isin(log.target, communities)
    if not gone.any():
        return log
    score = log.score.copy()
    starts = np.flatnonzero(np.r_[True, np.diff(log.label) != 0])
    for first, last in zip(starts.tolist(), [*starts[1:].tolist(), len(log)], strict=True):
        here = slice(first, last)
        if gone[here].any():
            dropped = np.where(gone[here], log.score[here], np.float32(np.inf))
            score[here] = np.minimum(score[here], np.minimum.accumulate(dropped))
    kept = ~gone
    return MergeLog(log.label[kept], log.source[kept], log.target[kept], score[kept])


def views_after(simap: SIMap, after: NDArray) -> Views:
    """Return the views after an edit: new communities inherit views of old ones in proportion to the cells they share.

    Args:
        simap: the map before the edit.
        after: int32 [rows, cols], its communities after the edit, 0 = none.
    """
    views, before = simap.views, simap.community
    touched = np.unique(before[(before != after) & (before > 0)])
    changed = np.isin(views.community, touched)
    if not changed.any():
        return views
    # how many cells each pair of an old and a new community shares
    there = np.isin(before, touched)
    pairs, overlap = np.unique(before[there].astype(np.int64) << 32 | after[there], return_counts=True)
    old, new = pairs >> 32, pairs & 0xFFFFFFFF
    sizes = np.bincount(old, overlap)
    # one row for each changed view and each new community that shares cells with its old one
    rows = np.flatnonzero(changed)
    first, last = (np.searchsorted(old, views.community[rows], side=side) for side in ("left", "right"))
    row = np.repeat(rows, last - first)
    at = np.arange(len(row)) + np.repeat(first - (np.cumsum(last - first) - (last - first)), last - first)
    cells = np.rint(views.cells[row] * overlap[at] / sizes[old[at]]).astype(np.int64)
    kept = (new[at] > 0) & (cells > 0)
    return _summed(views, ~changed, row[kept], new[at][kept], cells[kept])


def _summed(views: Views, untouched: NDArray, row: NDArray, community: NDArray, cells: NDArray) -> Views:
    """Return the untouched views and the shares; shares of one community, frame and segment become one view."""
    groups = group_views(community, views.frame[row], views.segment[row])
    first, group = groups.first, groups.of_row
    total = np.bincount(group, cells, minlength=len(first)).astype(np.int32)
    mean = np.bincount(group, cells * views.score[row], minlength=len(first)) / np.maximum(total, 1)
    return Views(
        community=np.r_[views.community[untouched], community[first].astype(np.int32)],
        frame=np.r_[views.frame[untouched], views.frame[row[first]]],
        segment=np.r_[views.segment[untouched], views.segment[row[first]]],
        cells=np.r_[views.cells[untouched], total],
        score=np.r_[views.score[untouched], mean.astype(np.float32)],
    )


def graphs_after(simap: SIMap, grid: Grid) -> tuple[CellGraph, ...]:
    """Return the graphs of the classes on an edited grid: an edge stays where both of its cells have one class."""
    before, after = simap.grid.label.reshape(-1), grid.label.reshape(-1)
    moved = before != after
    if not simap.graphs or not moved.any():
        return simap.graphs
    affected = {int(i) for i in np.unique(np.r_[before[moved], after[moved]])}
    graphs = {graph.label: graph for graph in simap.graphs if graph.label not in affected}
    links = _links([graph for graph in simap.graphs if graph.label in affected])
    for index in sorted(affected):
        cells = np.flatnonzero(after == index)
        if index == 0 or not grid.is_thing[index] or len(cells) == 0:
            continue
        mine = links[:, (after[links[0]] == index) & (after[links[1]] == index)]
        mine = mine[:, np.lexsort((mine[1], mine[0]))]
        edges = np.searchsorted(cells, mine[:2].T).astype(np.int32)
        seen = None if method_of(simap.method).weighs_evidence else grid.observations.reshape(-1)[cells]
        graphs[index] = CellGraph(index, cells, edges, mine[2], mine[3], seen)
    return tuple(graphs[index] for index in sorted(graphs))


def _links(graphs: list[CellGraph]) -> NDArray:
    """Return the edges of graphs, int64 [4, m]: the two flat cell numbers, count, different."""
    if not graphs:
        return np.zeros((4, 0), np.int64)
    parts = [
        np.stack([graph.cells[graph.edges[:, 0]], graph.cells[graph.edges[:, 1]], graph.counts, graph.different])
        for graph in graphs
    ]
    return np.concatenate(parts, axis=1)
