"""What has gone, moved or come between what is forgotten of a map and what is believed."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from simaps_viz.mapping.partition import owner_of_community
from simaps_viz.mapping.steps import FrameList
from simaps_viz.structures import Instance, Point, SIMap

Kind = Literal["moved", "gone", "new"]
MIN_CELLS = 9
"""Smaller things are not reported."""
ALIKE = 0.5
"""The smaller of two footprints is at least this share of the larger, where they may be of one object."""
TAIL = 0.05
"""Share of an object's sightings that may be stray ones, at either end."""
MOST = 0.5
"""Share of an object's cells for which something has to hold."""


@dataclass(frozen=True)
class Change:
    """One object that has moved, gone or come."""

    kind: Kind
    label: str
    frame: str
    """Where it was first seen at its new place, or last at its old one."""
    at_m: Point | None = None
    """Where it is; None where it has gone."""
    from_m: Point | None = None
    """Where it was; None where it is new."""
    id: int | None = None
    """Of the instance on the map it was found on; None where it has gone."""

    def words(self) -> str:
        """Describe it in a sentence without its subject: "moved here by 2.1 m"."""
        if self.kind == "moved" and self.at_m is not None and self.from_m is not None:
            by_m = float(np.hypot(self.at_m[0] - self.from_m[0], self.at_m[1] - self.from_m[1]))
            return f"moved by {by_m:.1f} m, from ({self.from_m[0]:.1f}, {self.from_m[1]:.1f})"
        place = self.at_m or self.from_m or (0.0, 0.0)
        return f"{self.kind}, at ({place[0]:.1f}, {place[1]:.1f})"


def find_changes(simap: SIMap, ghosts: SIMap, gone: FrameList, kept: FrameList, *, old: int = 0) -> tuple[Change, ...]:
    """Find which objects of a map moved, which have gone, and which were not there before.

    Args:
        simap: what is believed.
        ghosts: the map of what is forgotten.
        gone: what frames saw that is forgotten; all frames.
        kept: what they saw that is believed; all frames.
        old: so many of the first frames are an earlier map; only what these saw as free can have something new on it.
    """
    past, present = _sightings(ghosts), _sightings(simap)
    before = [
        one for one in ghosts.instances
        if one.cells >= MIN_CELLS and one.id in past and not _is_there(simap, present, one, past[one.id])
    ]  # fmt: skip
    after = [one for one in simap.instances if one.cells >= MIN_CELLS and one.id in present]
    last = {one.id: past[one.id].until(1.0 - TAIL) for one in before}
    first = {one.id: present[one.id].since(old, MOST * one.cells) for one in after}
    seen = _first_seen(simap, gone, kept)
    # An object has moved where one of its class and size came after it was last seen, to a place known before.
    cost = np.full((len(before), len(after)), np.inf)
    for i, ghost in enumerate(before):
        for j, one in enumerate(after):
            alike = min(ghost.cells, one.cells) >= ALIKE * max(ghost.cells, one.cells)
            if alike and ghost.label == one.label and first[one.id] > last[ghost.id]:
                known = seen[simap.instance == one.id] <= last[ghost.id]
                if known.mean() >= MOST:
                    cost[i, j] = np.hypot(*np.subtract(ghost.centroid_m[:2], one.centroid_m[:2]))
    pairs = linear_sum_assignment(np.where(np.isinf(cost), 1e6, cost))
    moved = {int(i): int(j) for i, j in zip(*pairs, strict=True) if np.isfinite(cost[i, j])}
    found = [
        Change("moved", after[j].label, simap.frame_names[first[after[j].id]], _place(after[j]), _place(before[i]),
               after[j].id)
        for i, j in moved.items()
    ]  # fmt: skip
    found += [
        Change("gone", one.label, ghosts.frame_names[last[one.id]], from_m=_place(one))
        for i, one in enumerate(before) if i not in moved
    ]  # fmt: skip
    if old:
        free = _free_before(simap, gone, kept, old)
        for j, one in enumerate(after):
            if j not in moved.values() and first[one.id] >= old and free[simap.instance == one.id].mean() >= MOST:
                found.append(Change("new", one.label, simap.frame_names[first[one.id]], _place(one), id=one.id))
    return tuple(found)


def leftovers(simap: SIMap, ghosts: SIMap) -> list[tuple[Instance, Instance]]:
    """Return (object on the map, forgotten object) where the first is what was left of the second.

    It is the smaller part, the same segments showed both, and none has shown the first since the second was last seen.
    """
    past, present, found = _sightings(ghosts), _sightings(simap), []
    for ghost in ghosts.instances:
        for one in simap.instances:
            if one.label == ghost.label and one.id in present and ghost.id in past:
                left, gone = present[one.id], past[ghost.id]
                same = left.cells[np.isin(left.key, gone.key)].sum() >= MOST * left.cells.sum()
                if same and ghost.cells >= one.cells and left.until(1.0 - TAIL) <= gone.until(1.0):
                    found.append((one, ghost))
    return found


def cells_of(simap: SIMap, one: Instance) -> tuple[NDArray, NDArray]:
    """Return the rows and columns of an object's cells, counted from the map's origin, int32 [n] each."""
    rows, cols = np.nonzero(simap.instance == one.id)
    row0, col0 = simap.spec.origin_cell
    return (rows + row0).astype(np.int32), (cols + col0).astype(np.int32)


def changes_in(simap: SIMap) -> tuple[Change, ...]:
    """Return the changes that a map's file holds, as far as they are well-formed and about objects still on it."""
    entries = simap.provenance.get("changes")
    found = (_change_of(entry) for entry in (entries if isinstance(entries, list) else ()))
    labels = {one.id: one.label for one in simap.instances}
    return tuple(one for one in found if one is not None and (one.id is None or labels.get(one.id) == one.label))


def as_json(changes: tuple[Change, ...]) -> list[dict[str, Any]]:
    """Return changes JSON-able, for a map's provenance."""
    given = [{name: value for name, value in asdict(one).items() if value is not None} for one in changes]
    return [{k: list(value) if isinstance(value, tuple) else value for k, value in one.items()} for one in given]


def _change_of(entry: Any) -> Change | None:
    if not isinstance(entry, Mapping) or entry.get("kind") not in get_args(Kind):
        return None
    words, number = (entry.get("label"), entry.get("frame")), entry.get("id")
    if not all(isinstance(one, str) for one in words) or not (number is None or type(number) is int):
        return None
    try:
        places = [None if entry.get(name) is None else tuple(map(float, entry[name])) for name in ("at_m", "from_m")]
    except (TypeError, ValueError, OverflowError):
        return None
    if any(one is not None and (len(one) != 2 or not np.isfinite(one).all()) for one in places):
        return None
    at_m, from_m = ((one[0], one[1]) if one is not None else None for one in places)
    return Change(entry["kind"], entry["label"], entry["frame"], at_m, from_m, number)


@dataclass(frozen=True, eq=False)
class _Sightings:
    """In which segments of which frames an object was seen."""

    frame: NDArray
    """int64 [n], place in ``frame_names``."""
    key: NDArray
    """int64 [n], of frame and segment."""
    cells: NDArray
    """int64 [n]."""

    def until(self, share: float) -> int:
        """Return the frame until which this share of the cells was seen."""
        seen = np.bincount(self.frame, self.cells, minlength=1)
        return int(np.searchsorted(np.cumsum(seen), share * seen.sum()))

    def since(self, old: int, cells: float) -> int:
        """Return the frame since which it is seen; 0 where one of the ``old`` frames saw so many cells of it."""
        known = np.bincount(self.frame[self.frame < old], self.cells[self.frame < old], minlength=1)
        return 0 if known.max() >= cells else self.until(TAIL)


def _sightings(simap: SIMap) -> dict[int, _Sightings]:
    views = simap.views
    one, frame = owner_of_community(simap)[views.community], views.frame.astype(np.int64)
    key, cells = (frame << 32) + views.segment, views.cells.astype(np.int64)
    return {i.id: _Sightings(frame[at], key[at], cells[at]) for i in simap.instances if (at := one == i.id).any()}


def _is_there(simap: SIMap, seen: dict[int, _Sightings], ghost: Instance, past: _Sightings) -> bool:
    """Whether most of an object is still on the map: segments that showed what is forgotten show it, too."""
    for one in simap.instances:
        if one.label == ghost.label and one.id in seen and one.cells >= MOST * ghost.cells:
            shared = past.cells[np.isin(past.key, seen[one.id].key)].sum()
            if shared >= MOST * past.cells.sum():
                return True
    return False


def _first_seen(simap: SIMap, *lists: FrameList) -> NDArray:
    """Return the first frame that saw each cell, int32 [rows, cols], by its place in ``frame_names``."""
    first = np.full(simap.spec.shape, np.iinfo(np.int32).max, np.int32)
    for frames in lists:
        for at, frame in enumerate(frames):
            rows, cols = _on(simap, frame.readings.rows, frame.readings.cols)
            first[rows, cols] = np.minimum(first[rows, cols], at)
    return first


def _free_before(simap: SIMap, gone: FrameList, kept: FrameList, old: int) -> NDArray:
    """Return where the first frames saw a cell and no obstacle in it, bool [rows, cols]."""
    top = np.full(simap.spec.shape, np.inf, np.float32)
    for frames in (gone, kept):
        for frame in frames[:old]:
            rows, cols = _on(simap, frame.readings.rows, frame.readings.cols)
            inside = (frame.readings.height_m, top[rows, cols])
            top[rows, cols] = np.where(np.isinf(inside[1]), inside[0], np.maximum(*inside))
    return top < float(simap.parameters.get("obstacle_height_m", 0.1))


def _on(simap: SIMap, rows: NDArray, cols: NDArray) -> tuple[NDArray, NDArray]:
    """Return cells counted from the map's origin as rows and columns of its grid."""
    row0, col0 = simap.spec.origin_cell
    return rows - row0, cols - col0


def _place(one: Instance) -> Point:
    return round(one.centroid_m[0], 3), round(one.centroid_m[1], 3)
