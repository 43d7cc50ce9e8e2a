"""The third dimension: which surface lies at which height, and whose it is; things under, in and on other things.

The map from above stays what it is. Below its tops, the surface that frames saw is cut into *nodes*: in one cell, the
steps of height of one class, without a gap and on one side of where segments meet. The node at a cell's top is the
map's; all others are *lower* nodes, and are partitioned by the same evidence: frames saw two nodes in one segment or in
two. What the evidence ties to an object of the map becomes part of it; of the rest, what has segments of its own
becomes objects of their own, which no cell of the map shows.

Frames are looked at in four passes; those on disk are read for each, so memory follows the map, not their number.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.mapping.communities import MIN_PAIR_AFFINITY, communities_of_pairs
from simaps_viz.mapping.in_space import least_sizes, majority
from simaps_viz.mapping.pooling import PoolSettings, join_parts
from simaps_viz.mapping.projection import ON_A_STEP, STEPS_PER_M, below_lowest, count_bits, first_step, lowest_run
from simaps_viz.mapping.steps import FrameList
from simaps_viz.mapping.surface import STEP_M, Surface
from simaps_viz.structures import Grid, GridSpec, Instance, SIMap

_MOST_VOTES = 1023
"""No voxel counts more frames of a class."""
_GAP = 2
"""Nodes of neighbouring cells are near across fewer free steps (10 cm)."""
_TOP_STEPS = 3
"""The node that the map shows reaches at least so close to the cell's top."""
_TOUCHING_BELOW = 0.3
"""Below tops, so much of what is imagined of two parts that touch is *same*: there, things of a class stand close to
each other in shelves, and no frame need show both."""
_REMNANT = 20
"""Groups of fewer nodes join what they touch by the belief of the map, `PoolSettings.touching_same`."""
_MIN_FRAMES = 2
_MIN_MEETINGS = 3
"""So many frames have to see two segments meet in a cell, one above the other, for a node to end there."""
_CLASS_BITS, _STEP_BITS = 15, 6
"""Of a place: cell, class and step as one number."""
_FLUSH = 1 << 20
_LOW = 0xFFFFFFFF
"""The second number of a key."""

Point3 = tuple[float, float, float]
Box3 = tuple[Point3, Point3]


@dataclass(frozen=True, eq=False)
class SpaceSettings:
    """How the surface is partitioned; from the settings of the map's method."""

    below_floor_m: float
    weight_of_label: NDArray
    """float64 [labels], what one frame's vote for a class counts."""
    resolution: float
    seed: int
    pooling: PoolSettings
    affinity: float
    """Two parts are one object while their affinity exceeds this."""
    min_cells: int
    """Objects with a smaller footprint are none."""
    exact: bool
    """Masks count as exact. If not, what a single frame saw is no object, and what lies on the floor is not part of a
    class that stands higher: masks of chairs cover the floor seen between their legs."""


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Steps of one class in one cell. Arrays aligned, cells ascending."""

    cell: NDArray
    """int32 [n], flat cell of the grid."""
    label: NDArray
    """int16 [n]."""
    steps: NDArray
    """uint64 [n], bit k is step ``first_step`` + k."""

    def where(self, kept: NDArray) -> "_Nodes":
        """Return the nodes at some places, int, ascending."""
        return _Nodes(self.cell[kept], self.label[kept], self.steps[kept])


def find_surface(
    simap: SIMap, frames: FrameList, origin_cell: tuple[int, int], settings: SpaceSettings
) -> tuple[Surface, tuple[Instance, ...]]:
    """Find the surface that frames saw, and the objects that the map from above does not show.

    Args:
        simap: the finished map from above.
        frames: all its frames, in order.
        origin_cell: (row, col), counted from the map's origin, of the grid's cell (0, 0).
        settings: how.

    Returns:
        The surface; and the hidden objects, whose ids follow those of the map's communities.
    """
    grid, instance = simap.grid, simap.instance
    first_id = int(max(simap.community.max(initial=0), instance.max(initial=0))) + 1
    lowest, seen = first_step(settings.below_floor_m), _Seen(grid, frames, origin_cell)
    nodes = _elected_nodes(grid, seen, lowest, settings.weight_of_label)
    # The node at a cell's top is what the map shows there; the other ones of things are to be partitioned.
    is_thing = np.array(grid.is_thing) & (np.arange(len(grid.labels)) > 0)
    shown = _shown(
        nodes.cell, nodes.label, nodes.steps, grid.label.reshape(-1), is_thing, grid.height_m.reshape(-1), lowest
    )
    top = shown & is_thing[nodes.label]
    top[top] = instance.reshape(-1)[nodes.cell[top]] > 0
    if not settings.exact:
        _leave_floor(nodes, top, is_thing, lowest)
    # Owners: 0 is what the map shows in the cell, below 0 a class without an object.
    owner = -1 - nodes.label.astype(np.int32)
    owner[top | (shown & ~is_thing[nodes.label])] = 0
    del shown
    # Only classes of which something lies below need evidence: few of the nodes of a building.
    matters = np.zeros(len(grid.labels), np.bool_)
    matters[nodes.label[is_thing[nodes.label] & ~top]] = True
    of_matter = np.flatnonzero(matters[nodes.label])
    hidden = []
    if len(of_matter):
        part, shown_in = (
            nodes.where(of_matter),
            np.where(top[of_matter], instance.reshape(-1)[nodes.cell[of_matter]], 0).astype(np.int32),
        )
        partition = _Partition(grid, part, np.flatnonzero(~top[of_matter]), shown_in, settings)
        groups = partition.groups(seen, lowest, matters)
        hidden = _hidden(grid, part, shown_in, groups, first_id, settings, lowest)
        lower = of_matter[groups.lower]
        del partition, part, shown_in
        owner[lower] = np.where(groups.instance > 0, groups.instance, owner[lower])
        for one, group in hidden:
            owner[lower[groups.group == group]] = one.id
    del top, of_matter  # what is large is let go before runs are made beside the nodes
    cell, low, high, owned = _as_runs(nodes.cell, nodes.steps, owner, lowest)
    _ascend(cell, low, high, owned)
    return Surface(grid.spec, cell, low, high, owned), tuple(one for one, _ in hidden)


_FrameColumns = tuple[NDArray, NDArray, NDArray, NDArray, NDArray, NDArray]
"""What a frame saw: cell int32, class int16, segment int32, low int8 and high int8 of each run, and the score of each
segment, float64 [highest id + 1]."""


@dataclass(eq=False)
class _Seen:
    """The runs of all frames on the finished grid, as often as asked for."""

    grid: Grid
    frames: FrameList
    origin_cell: tuple[int, int]

    def __iter__(self) -> Iterator[_FrameColumns]:
        """Yield the runs of each frame, in order; those of frames in memory are placed once."""
        return iter(self._placed) if self.frames.all_held else self._place()

    @cached_property
    def _placed(self) -> list[_FrameColumns]:
        return list(self._place())

    def _place(self) -> Iterator[_FrameColumns]:
        index_of = {name: i for i, name in enumerate(self.grid.labels)}
        row0, col0 = self.origin_cell
        for frame in self.frames:
            readings, runs = frame.readings, frame.runs
            cell = _cells(runs.reading, readings.rows, readings.cols, row0, col0, self.grid.spec.cols)
            ids = np.array([s.id for s in frame.segments], np.int64)
            size = int(ids.max(initial=0)) + 1
            label_of, score_of = np.zeros(size, np.int16), np.zeros(size)
            label_of[ids] = [index_of[s.label] for s in frame.segments]
            score_of[ids] = [s.score for s in frame.segments]
            yield cell, label_of[runs.segments], runs.segments, runs.low, runs.high, score_of


@njit(cache=True, nogil=True)
def _cells(
    reading: NDArray,  # int32 [m]
    rows: NDArray,  # int32 [n], counted from the map's origin
    cols: NDArray,  # int32 [n]
    row0: int,
    col0: int,
    width: int,
) -> NDArray:
    found = np.zeros(len(reading), np.int32)
    for i in range(len(reading)):
        found[i] = (rows[reading[i]] - row0) * width + cols[reading[i]] - col0
    return found


def _elected_nodes(grid: Grid, seen: _Seen, lowest: int, weight_of_label: NDArray) -> _Nodes:
    """Let frames vote for the class of each voxel, and cut what each class has in a cell into nodes."""
    size = grid.label.size
    thing = np.array(grid.is_thing) & (np.arange(len(grid.labels)) > 0)
    following, label, steps = (np.zeros(size + size // 16 + 1024, t) for t in (np.int32, np.int16, np.uint64))
    place, met = np.zeros(0, np.int64), np.zeros(0, np.int64)
    waiting, rows = list[NDArray](), 0
    for cell, of_label, segment, low, high, _ in seen:
        waiting.append(_meetings(cell, of_label, segment, low, high, lowest, thing))
        rows += len(waiting[-1])
        if rows > _FLUSH:
            place, met, waiting, rows = *_counted(place, met, waiting), [], 0
        done = 0
        while True:
            size, done = _gather(cell, of_label, low, high, lowest, following, label, steps, size, done)
            if done == len(cell):
                break
            following, label, steps = (np.resize(one, len(one) * 5 // 4) for one in (following, label, steps))
            following[size:], steps[size:] = 0, 0
    place, met = _counted(place, met, waiting)
    # From here on the entries of a cell lie side by side. Where classes share a step, count how often each was seen;
    # where segments meet, how often one reaches across.
    first, label, steps = _by_cell(following, label, steps, grid.label.size, size)
    del following
    contested = _contested(first, steps)
    start = contested[2]
    across, watched = np.zeros(len(place), np.int32), np.zeros(grid.label.size, np.bool_)
    watched[place[met >= _MIN_MEETINGS] >> _CLASS_BITS + _STEP_BITS] = True
    if start[-1] or len(place):
        votes = np.zeros(start[-1], np.uint16)
        for cell, of_label, _, low, high, _ in seen:
            _count(cell, of_label, low, high, lowest, first, label, *contested, votes)
            _count_across(cell, of_label, low, high, lowest, watched, place, across)
        _elect(first, label, steps, *contested, votes, weight_of_label)
    del contested, start, watched
    return _Nodes(*_cut(first, label, steps, thing, place, met, across))


def _counted(place: NDArray, count: NDArray, more: list[NDArray]) -> tuple[NDArray, NDArray]:
    """Return the distinct places, ascending, and how often each came: ``count`` times and once for each of ``more``."""
    places, at = np.unique(np.concatenate([place, *more]), return_inverse=True)
    ones = np.ones(len(at) - len(place), np.int64)
    return places, np.bincount(at, np.concatenate([count, ones]), len(places)).astype(np.int64)


@njit(cache=True, nogil=True, inline="always")
def _place(cell, label):  # int32, int16 -> int64
    """Return the number of the lowest step of a class in a cell; those of the steps above follow it."""
    return (np.int64(cell) << _CLASS_BITS | np.int64(label)) << _STEP_BITS


@njit(cache=True, nogil=True)
def _meetings(
    cell: NDArray,  # int32 [m], ascending
    label_of: NDArray,  # int16 [m]
    segment_of: NDArray,  # int32 [m]
    low: NDArray,  # int8 [m]
    high: NDArray,  # int8 [m]
    lowest: int,
    thing: NDArray,  # bool [labels]
) -> NDArray:
    """Return the places, int64, where a frame saw two segments of a thing's class meet, one above the other.

    From the highest step of the lower one to the lowest of the upper one, any of them may be where.
    """
    found = np.zeros(len(cell), np.int64)
    n, first = 0, 0
    for i in range(len(cell)):
        if cell[i] != cell[first]:
            first = i
        if not thing[label_of[i]]:
            continue
        over, j = -1, first  # the lowest run above, of another segment
        while j < len(cell) and cell[j] == cell[i]:
            if (
                label_of[j] == label_of[i]
                and segment_of[j] != segment_of[i]
                and low[j] > low[i]
                and low[j] >= high[i]
                and high[j] > high[i]
                and (over < 0 or low[j] < low[over])
            ):
                over = j
            j += 1
        if over < 0:
            continue
        for step in range(max(high[i] - lowest, 0), min(low[over] - lowest + 1, 1 << _STEP_BITS)):
            if n == len(found):
                found = np.concatenate((found, np.zeros(n, np.int64)))
            found[n] = _place(cell[i], label_of[i]) + step
            n += 1
    return found[:n].copy()  # without the room that is kept beside it


@njit(cache=True, nogil=True)
def _count_across(
    cell: NDArray,  # int32 [m]
    label_of: NDArray,  # int16 [m]
    low: NDArray,  # int8 [m]
    high: NDArray,  # int8 [m]
    lowest: int,
    watched: NDArray,  # bool [cells], has places
    place: NDArray,  # int64 [places], ascending
    across: NDArray,  # in/out int32 [places]
) -> None:
    """Count the runs of one frame that reach past a place at both ends."""
    for i in range(len(cell)):
        if not watched[cell[i]]:
            continue
        base = _place(cell[i], label_of[i])
        last = base + min(high[i] - lowest, 1 << _STEP_BITS)
        at = np.searchsorted(place, base + max(low[i] - lowest + 1, 0))
        while at < len(place) and place[at] < last:
            across[at] += 1
            at += 1


@njit(cache=True, nogil=True, inline="always")
def _mask(low, high, lowest):  # int8, int8, int -> uint64
    """Return the bits of the steps from low to high; steps that no column has are left out."""
    first, last = max(low - lowest, 0), min(high - lowest, 63)
    if last < first:
        return np.uint64(0)
    return (~np.uint64(0) >> np.uint64(63 - (last - first))) << np.uint64(first)


@njit(cache=True, nogil=True)
def _gather(
    cell: NDArray,  # int32 [m]
    label_of: NDArray,  # int16 [m]
    low: NDArray,  # int8 [m]
    high: NDArray,  # int8 [m]
    lowest: int,
    following: NDArray,  # in/out int32 [entries], next entry of the same cell, 0 = none
    label: NDArray,  # in/out int16 [entries]
    steps: NDArray,  # in/out uint64 [entries]
    size: int,
    done: int,
) -> tuple[int, int]:
    """Add runs to the entry of their cell and class; return the entries in use and the runs done, as `votes._tally`."""
    for i in range(done, len(cell)):
        at = cell[i]
        if steps[at] == 0:
            label[at] = label_of[i]
        while label[at] != label_of[i] and following[at] > 0:
            at = following[at]
        if label[at] != label_of[i]:
            if size == len(label):
                return size, i
            following[at] = size
            at = size
            label[at] = label_of[i]
            size += 1
        steps[at] |= _mask(low[i], high[i], lowest)
    return size, len(cell)


@njit(cache=True, nogil=True)
def _by_cell(
    following: NDArray,  # int32 [entries], as `_gather` leaves it, with the two that follow
    label: NDArray,  # int16 [entries]
    steps: NDArray,  # uint64 [entries]
    cells: int,
    size: int,
) -> tuple[NDArray, NDArray, NDArray]:
    """Lay the entries of each cell side by side, in the order met, without those that have no step.

    Returns:
        int32 [cells + 1], the first entry of each cell; and of each entry its class, int16, and its steps, uint64.
    """
    n = np.count_nonzero(steps[:size])
    first, of_label, of_steps = np.zeros(cells + 1, np.int32), np.zeros(n, np.int16), np.zeros(n, np.uint64)
    n = 0
    for c in range(cells):
        at = c
        while True:
            if steps[at] != 0:
                of_label[n], of_steps[n] = label[at], steps[at]
                n += 1
            at = following[at]
            if at == 0:
                break
        first[c + 1] = n
    return first, of_label, of_steps


@njit(cache=True, nogil=True)
def _contested(
    first: NDArray,  # int32 [cells + 1]
    steps: NDArray,  # uint64 [entries]
) -> tuple[NDArray, NDArray, NDArray]:
    """Number the entries of the cells in which two classes share a step.

    Returns:
        int32 [entries], -1 = not such an entry; uint64 [n], the steps of each that others share; and int64 [n + 1],
        where its votes start, one number for each of these steps, ascending.
    """
    slot = np.full(len(steps), -1, np.int32)
    shared_of, start = np.zeros(0, np.uint64), np.zeros(1, np.int64)
    for fill in range(2):
        n = 0
        for c in range(len(first) - 1):
            known, shared = np.uint64(0), np.uint64(0)
            for at in range(first[c], first[c + 1]):
                shared |= known & steps[at]
                known |= steps[at]
            if shared == 0:
                continue
            for at in range(first[c], first[c + 1]):
                if fill:
                    slot[at], shared_of[n] = n, shared & steps[at]
                    start[n + 1] = start[n] + count_bits(shared_of[n])
                n += 1
        if not fill:
            shared_of, start = np.zeros(n, np.uint64), np.zeros(n + 1, np.int64)
    return slot, shared_of, start


@njit(cache=True, nogil=True)
def _count(
    cell: NDArray,  # int32 [m]
    label_of: NDArray,  # int16 [m]
    low: NDArray,  # int8 [m]
    high: NDArray,  # int8 [m]
    lowest: int,
    first: NDArray,  # int32 [cells + 1]
    label: NDArray,  # int16 [entries]
    slot: NDArray,  # int32 [entries], as `_contested` returns it, with the two that follow
    shared_of: NDArray,  # uint64 [contested]
    start: NDArray,  # int64 [contested + 1]
    votes: NDArray,  # in/out uint16 [shared steps]
) -> None:
    """Count the votes of one frame; the shared steps of a run follow each other."""
    for i in range(len(cell)):
        for at in range(first[cell[i]], first[cell[i] + 1]):
            if slot[at] < 0:
                break
            if label[at] != label_of[i]:
                continue
            shared = shared_of[slot[at]]
            of_run = shared & _mask(low[i], high[i], lowest)
            begin = start[slot[at]] + count_bits(shared & below_lowest(of_run))
            for k in range(begin, begin + count_bits(of_run)):
                if votes[k] < _MOST_VOTES:
                    votes[k] += 1
            break


@njit(cache=True, nogil=True)
def _elect(
    first: NDArray,  # int32 [cells + 1]
    label: NDArray,  # int16 [entries]
    steps: NDArray,  # in/out uint64 [entries]
    slot: NDArray,  # int32 [entries], as `_contested` returns it, with the two that follow
    shared_of: NDArray,  # uint64 [contested]
    start: NDArray,  # int64 [contested + 1]
    votes: NDArray,  # uint16 [shared steps]
    weight: NDArray,  # float64 [labels]
) -> None:
    """Leave every contested step to the class with the heaviest votes; ties go to the class met first."""
    one = np.uint64(1)
    for c in range(len(first) - 1):
        left = np.uint64(0)
        for at in range(first[c], first[c + 1]):
            if slot[at] >= 0:
                left |= shared_of[slot[at]]
        while left:
            bit = left & (~left + one)
            left &= ~bit
            best, heaviest = -1, 0.0
            for at in range(first[c], first[c + 1]):
                row = slot[at]
                if shared_of[row] & bit:
                    votes_here = votes[start[row] + count_bits(shared_of[row] & (bit - one))] * weight[label[at]]
                    if best < 0 or votes_here > heaviest:
                        best, heaviest = at, votes_here
            for at in range(first[c], first[c + 1]):
                if at != best:
                    steps[at] &= ~bit


@njit(cache=True, nogil=True)
def _cut(
    first: NDArray,  # int32 [cells + 1]
    label: NDArray,  # int16 [entries]
    steps: NDArray,  # uint64 [entries]
    thing: NDArray,  # bool [labels], what is cut at gaps and where segments meet
    place: NDArray,  # int64 [places], ascending, where they do, with the two that follow
    met: NDArray,  # int64 [places], how often
    across: NDArray,  # int32 [places], how often one segment reaches across
) -> tuple[NDArray, NDArray, NDArray]:
    """Return the nodes: cell int32, ascending, class int16, steps uint64."""
    of_cell, of_label, of_steps = np.zeros(0, np.int32), np.zeros(0, np.int16), np.zeros(0, np.uint64)
    for fill in range(2):
        n, near = 0, 0
        for c in range(len(first) - 1):
            while near < len(place) and place[near] < _place(c, 0):
                near += 1
            meet = near < len(place) and place[near] < _place(c + 1, 0)
            for at in range(first[c], first[c + 1]):
                left, uncut = steps[at], np.uint64(0)
                while left:
                    part = lowest_run(left) if thing[label[at]] else left
                    if meet and thing[label[at]] and part != uncut:
                        whole = part
                        part = _below_meeting(part, _place(c, label[at]), place, met, across)
                        uncut = whole & ~part
                    left &= ~part
                    if fill:
                        of_cell[n], of_label[n], of_steps[n] = c, label[at], part
                    n += 1
        if not fill:
            of_cell, of_label, of_steps = np.zeros(n, np.int32), np.zeros(n, np.int16), np.zeros(n, np.uint64)
    return of_cell, of_label, of_steps


@njit(cache=True, nogil=True)
def _below_meeting(
    run: np.uint64,
    base: np.int64,  # number of the lowest step
    place: NDArray,  # int64 [places], as for `_cut`, with the two that follow
    met: NDArray,  # int64 [places]
    across: NDArray,  # int32 [places]
) -> np.uint64:
    """Return the steps of a run up to where two things of its class meet; all of them if none do.

    Things that stand on one another meet at one height, in frame after frame. Where two stand side by side in a cell,
    frames see them meet at any height.
    """
    inside = run & run << np.uint64(1) & run >> np.uint64(1)
    first = last = np.searchsorted(place, base)
    total = 0
    while last < len(place) and place[last] < base + (1 << _STEP_BITS):
        if inside >> np.uint64(place[last] - base) & np.uint64(1):
            total += met[last]
        last += 1
    best, most = -1, 0
    for i in range(first, last):
        step, close = place[i] - base, 0
        if met[i] < max(_MIN_MEETINGS, 2 * across[i] + 1, most + 1) or not inside >> np.uint64(step) & np.uint64(1):
            continue
        for k in range(max(i - 1, first), min(i + 2, last)):
            if abs(place[k] - place[i]) <= 1:
                close += met[k]
        if 2 * close > total:
            best, most = step, met[i]
    return run if best < 0 else run & ((np.uint64(2) << np.uint64(best)) - np.uint64(1))


@njit(cache=True, nogil=True)
def first_of_cells(cell: NDArray, cells: int) -> NDArray:
    """Return the first node of each cell, int32 [cells + 1], of the cell of each node, int32 [n], ascending.

    A large building's memory peaks here, and NumPy's bincount and cumsum would take five times as much.
    """
    first = np.zeros(cells + 1, np.int32)
    for c in cell:
        first[c + 1] += 1
    for c in range(cells):
        first[c + 1] += first[c]
    return first


@njit(cache=True, nogil=True, inline="always")
def _highest(steps):  # uint64 -> int
    """Return the highest bit of a number above 0."""
    k = 0
    while steps > np.uint64(1):
        steps >>= np.uint64(1)
        k += 1
    return k


@njit(cache=True, nogil=True)
def _shown(
    cell: NDArray,  # int32 [n]
    label: NDArray,  # int16 [n]
    steps: NDArray,  # uint64 [n]
    map_label: NDArray,  # int16 [cells]
    thing: NDArray,  # bool [labels]
    height_m: NDArray,  # float32 [cells], near which the node of a thing has to end
    lowest: int,
) -> NDArray:
    """Return which nodes the map shows: of a thing the highest in its cell, of anything else all of the class; bool."""
    shown = np.zeros(len(cell), np.bool_)
    best = -1
    for i in range(len(cell)):
        if best >= 0 and cell[best] != cell[i]:
            best = -1
        if label[i] != map_label[cell[i]]:
            continue
        if not thing[label[i]]:
            shown[i] = True
        elif best < 0 or steps[i] > steps[best]:
            top = math.floor(height_m[cell[i]] * STEPS_PER_M + ON_A_STEP)
            shown[i] = _highest(steps[i]) + lowest >= top - _TOP_STEPS
            if shown[i]:
                if best >= 0:
                    shown[best] = False
                best = i
    return shown


@njit(cache=True, nogil=True)
def _as_runs(
    cell: NDArray,  # int32 [n]
    steps: NDArray,  # uint64 [n]
    owner: NDArray,  # int32 [n]
    lowest: int,
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Cut nodes into runs without a gap: cell int32, low int8, high int8 and owner int32 of each."""
    size = 0
    for i in range(len(cell)):
        size += count_bits(steps[i] & ~(steps[i] << np.uint64(1)))
    of_cell, of_owner = np.zeros(size, np.int32), np.zeros(size, np.int32)
    low, high = np.zeros(size, np.int8), np.zeros(size, np.int8)
    n = 0
    for i in range(len(cell)):
        left = steps[i]
        while left:
            run, first = lowest_run(left), lowest + count_bits(below_lowest(left))
            of_cell[n], of_owner[n], low[n], high[n] = cell[i], owner[i], first, first + count_bits(run) - 1
            left &= ~run
            n += 1
    return of_cell, low, high, of_owner


@njit(cache=True, nogil=True)
def _ascend(
    cell: NDArray,  # int32 [n], ascending
    low: NDArray,  # in/out int8 [n]
    high: NDArray,  # in/out int8 [n]
    owner: NDArray,  # in/out int32 [n]
) -> None:
    """Sort the runs of each cell by height, which packs better; there are few in a cell."""
    for i in range(1, len(cell)):
        at = i
        while at > 0 and cell[at - 1] == cell[i] and low[at - 1] > low[at]:
            low[at - 1], low[at] = low[at], low[at - 1]
            high[at - 1], high[at] = high[at], high[at - 1]
            owner[at - 1], owner[at] = owner[at], owner[at - 1]
            at -= 1


def _leave_floor(nodes: _Nodes, top: NDArray, is_thing: NDArray, lowest: int) -> None:
    """Leave to no class the lower nodes that end on the floor, of classes most of whose nodes end higher."""
    on_floor = nodes.steps < np.uint64(1) << np.uint64(1 - lowest)  # no step above the lowest 5 cm
    count = np.bincount(nodes.label, minlength=len(is_thing))
    stands = is_thing & (2 * np.bincount(nodes.label[on_floor], minlength=len(is_thing)) < count)
    nodes.label[on_floor & ~top & stands[nodes.label]] = 0


@dataclass(frozen=True, eq=False)
class _Groups:
    """What the lower nodes are parts of. Arrays aligned with them."""

    group: NDArray
    """int32 [lower], number of the group."""
    instance: NDArray
    """int32 [lower], the object of the map that the group is tied to, 0 = none."""
    lower: NDArray
    """int64 [lower], the nodes."""
    frames: NDArray
    """int64 [groups], how many frames saw it."""
    score: NDArray
    """float64 [groups], mean confidence of the segments that named it."""
    apart: NDArray
    """bool [groups], whether it has segments of its own, see `_has_segments`."""


@dataclass(eq=False)
class _Partition:
    """The partition of the lower nodes."""

    grid: Grid
    nodes: _Nodes
    lower: NDArray
    """int64 [lower], their nodes."""
    top: NDArray
    """int32 [nodes], the instance that the map shows there, 0 = a lower node, or of no thing."""
    settings: SpaceSettings

    def groups(self, seen: _Seen, lowest: int, matters: NDArray) -> _Groups:
        """Partition them; ``matters``, bool [labels], names the classes of the nodes."""
        nodes, settings, spec = self.nodes, self.settings, self.grid.spec
        number = np.full(len(nodes.cell), -1, np.int32)
        number[self.lower] = np.arange(len(self.lower))
        starts = first_of_cells(nodes.cell, spec.rows * spec.cols)
        start, other, touches = _neighbours(
            nodes.cell, nodes.label, nodes.steps, starts, number, self.top, self.lower, spec.rows, spec.cols
        )
        # 1. Same or different, of neighbouring nodes; Louvain joins the lower ones to finest communities.
        same, different = np.zeros(len(other), np.int32), np.zeros(len(other), np.int32)
        sights = _Sights(nodes, starts, lowest, matters, seen)
        for frame, (at, _, _) in enumerate(sights):
            _count_neighbours(at, number, start, other, sights.frame, sights.segment, frame, same, different)
        first = np.repeat(np.arange(len(self.lower), dtype=np.int32), np.diff(start))
        weight = same / (same + different + 1.0)
        strong = np.flatnonzero((weight > MIN_PAIR_AFFINITY) & (number[other] >= 0))
        community = communities_of_pairs(
            weight[strong], first[strong], number[other[strong]], len(self.lower),
            resolution=settings.resolution, seed=settings.seed,
        )  # fmt: skip
        # 2. Parts are the objects of the map, then the finest communities. Evidence on each two, over all frames.
        objects = np.flatnonzero(np.bincount(self.top)[1:]) + 1
        tops = len(objects)
        unit = (np.searchsorted(objects, np.arange(int(self.top.max()) + 1)).astype(np.int32))[self.top]
        unit[self.lower] = community + tops
        units = tops + int(community.max(initial=-1)) + 1
        nodes_of = np.bincount(unit, minlength=units)
        two = unit[self.lower[first[touches]]], unit[other[touches]]
        touching = np.stack([np.minimum(*two), np.maximum(*two)], axis=1)[two[0] != two[1]]
        pooled, seen_in, named = self._pooled(sights, unit, tops, nodes_of, touching)
        # 3. Join them, best first.
        root = _join(units, tops, pooled, _among(pooled[0], touching), nodes_of, settings)
        group = root[unit[self.lower]]
        instance = np.where(group < tops, np.r_[objects, 0][np.minimum(group, tops)], 0)
        score = np.bincount(root, named[0], units) / np.maximum(np.bincount(root, named[1], units), 1e-9)
        frames = np.bincount(np.unique(root[seen_in[0]] << 32 | seen_in[1] >> 32) >> 32, minlength=units)
        return _Groups(group, instance.astype(np.int32), self.lower, frames, score, _has_segments(root, seen_in))

    def _pooled(
        self, sights: "_Sights", unit: NDArray, tops: int, nodes_of: NDArray, touching: NDArray
    ) -> tuple["_Evidence", "_SeenIn", tuple[NDArray, NDArray]]:
        """Sum up the evidence on every two parts that were seen together or are among those that touch, int32 [t, 2].

        Returns:
            The evidence; what was seen of each part in each segment; and of each part the confidence of segments and
            the nodes they named, float64 [units].
        """
        units = len(nodes_of)
        waiting, size, seen_in = [(touching, np.zeros((len(touching), 2)))], 0, list[_SeenIn]()
        named, place = (np.zeros(units), np.zeros(units)), np.full(units, -1, np.int32)
        for frame, (at, segment, score) in enumerate(sights):
            of_unit = unit[at]
            _add_scores(of_unit, segment, score, *named)
            part, of, count, ends, evidence = _pairs(of_unit, segment, self.nodes.label[at], nodes_of, tops, place)
            seen_in.append((part, np.int64(frame) << 32 | of, count))
            waiting.append((ends, evidence))
            size += len(ends)
            if size > _FLUSH:
                waiting, size = [_all_summed(waiting, units)], 0
        part, segment, count = map(np.concatenate, zip(*seen_in, strict=True))
        return _all_summed(waiting, units), (part, segment, count), named


_Evidence = tuple[NDArray, NDArray]
"""What was seen of every two parts: the parts, int32 [p, 2], and how much as the same and as different, float64 [p, 2].
"""
_SeenIn = tuple[NDArray, NDArray, NDArray]
"""What was seen of a part in a segment: the part int32 [s], the frame, shifted by 32 bits, and the segment int64 [s],
and how many nodes float64 [s]."""


@dataclass(eq=False)
class _Sights:
    """Which nodes each frame saw, and in which segment; as often as asked for."""

    nodes: _Nodes
    starts: NDArray
    """int32 [cells + 1], the first node of each cell."""
    lowest: int
    matters: NDArray
    """bool [labels], classes of the nodes."""
    seen: _Seen

    def __post_init__(self) -> None:
        count = len(self.nodes.cell)
        self.frame, self.segment = np.full(count, -1, np.int32), np.zeros(count, np.int32)
        """int32 [nodes], the frame that saw the node last, and the segment with most of its steps."""
        self._steps = np.zeros(count, np.int8)
        self._held: list[tuple[NDArray, NDArray, NDArray]] = []

    def __iter__(self) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
        """Yield of each frame the nodes that it saw, int32, in the order met, their segments, and segments' scores.

        Frames in memory are looked at once.
        """
        if self._held:
            yield from self._held
            return
        self.frame.fill(-1)
        for frame, (cell, label, segment, low, high, score) in enumerate(self.seen):
            at = _look(
                frame, cell, label, segment, low, high, self.lowest, self.matters, self.starts, self.nodes.label,
                self.nodes.steps, self.frame, self.segment, self._steps,
            )  # fmt: skip
            found = at, self.segment[at], score
            if self.seen.frames.all_held:
                self._held.append(found)
            yield found


@njit(cache=True, nogil=True)
def _look(
    number: int,
    cell: NDArray,  # int32 [m]
    label_of: NDArray,  # int16 [m]
    segment_of: NDArray,  # int32 [m]
    low: NDArray,  # int8 [m]
    high: NDArray,  # int8 [m]
    lowest: int,
    matters: NDArray,  # bool [labels]
    first: NDArray,  # int32 [cells + 1]
    label: NDArray,  # int16 [nodes]
    steps: NDArray,  # uint64 [nodes]
    frame: NDArray,  # in/out int32 [nodes]
    segment: NDArray,  # in/out int32 [nodes]
    shared: NDArray,  # in/out int8 [nodes], steps of that segment
) -> NDArray:
    found = np.zeros(len(cell), np.int32)
    n = 0
    for i in range(len(cell)):
        if not matters[label_of[i]]:
            continue
        mask = _mask(low[i], high[i], lowest)
        for node in range(first[cell[i]], first[cell[i] + 1]):
            both = steps[node] & mask
            if label[node] != label_of[i] or both == 0:
                continue
            count = count_bits(both)
            if frame[node] != number:
                frame[node] = number
                if n == len(found):
                    found = np.concatenate((found, np.zeros(n + 1, np.int32)))
                found[n] = node
                n += 1
            elif count <= shared[node]:
                continue
            segment[node], shared[node] = segment_of[i], count
    return found[:n].copy()


@njit(cache=True, nogil=True)
def _neighbours(  # noqa: C901, PLR0912 - one loop over shared arrays
    cell: NDArray,  # int32 [nodes]
    label: NDArray,  # int16 [nodes]
    steps: NDArray,  # uint64 [nodes]
    first: NDArray,  # int32 [cells + 1]
    number: NDArray,  # int32 [nodes], place among the lower nodes, -1 = none
    top: NDArray,  # int32 [nodes]
    lower: NDArray,  # int64 [lower]
    rows: int,
    cols: int,
) -> tuple[NDArray, NDArray, NDArray]:
    """Return the neighbours of each lower node: nodes of its class in its own and the eight cells around.

    A pair of lower nodes is listed with the earlier one. Those of other cells must be near in height as well.

    Returns:
        int32 [lower + 1], where the neighbours of each start; int32 [edges], nodes; bool [edges], near in height.
    """
    start = np.zeros(len(lower) + 1, np.int32)
    for fill in range(2):
        n = 0
        if fill:
            other, touches = np.zeros(start[len(lower)], np.int32), np.zeros(start[len(lower)], np.bool_)
        for i in range(len(lower)):
            start[i] = n
            node = lower[i]
            row, col = cell[node] // cols, cell[node] % cols
            grown = steps[node]
            for k in range(1, _GAP + 1):
                grown |= steps[node] << np.uint64(k) | steps[node] >> np.uint64(k)
            for dr in range(-1, 2):
                for dc in range(-1, 2):
                    if row + dr < 0 or row + dr >= rows or col + dc < 0 or col + dc >= cols:
                        continue
                    there = (row + dr) * cols + col + dc
                    for its in range(first[there], first[there + 1]):
                        if its == node or label[its] != label[node]:
                            continue
                        if number[its] < 0 and top[its] == 0:
                            continue
                        if number[its] >= 0 and its < node:
                            continue
                        near = (grown & steps[its]) != 0
                        if not near and (dr != 0 or dc != 0):
                            continue
                        if fill:
                            other[n], touches[n] = its, near
                        n += 1
        start[len(lower)] = n
    return start, other, touches


@njit(cache=True, nogil=True)
def _count_neighbours(
    at: NDArray,  # int32 [k], nodes that the frame saw
    number: NDArray,  # int32 [nodes]
    start: NDArray,  # int32 [lower + 1]
    other: NDArray,  # int32 [edges]
    frame: NDArray,  # int32 [nodes]
    segment: NDArray,  # int32 [nodes]
    now: int,
    same: NDArray,  # in/out int32 [edges]
    different: NDArray,  # in/out int32 [edges]
) -> None:
    for node in at:
        i = number[node]
        if i < 0:
            continue
        for e in range(start[i], start[i + 1]):
            if frame[other[e]] == now:
                if segment[other[e]] == segment[node]:
                    same[e] += 1
                else:
                    different[e] += 1


@njit(cache=True, nogil=True)
def _add_scores(
    unit: NDArray,  # int32 [k]
    segment: NDArray,  # int32 [k]
    score_of: NDArray,  # float64 [segments]
    score: NDArray,  # in/out float64 [units]
    nodes: NDArray,  # in/out float64 [units]
) -> None:
    for i in range(len(unit)):
        score[unit[i]] += score_of[segment[i]]
        nodes[unit[i]] += 1.0


@njit(cache=True, nogil=True)
def _rows(
    unit: NDArray,  # int32 [k], as for `_pairs`, with the three that follow
    segment: NDArray,  # int32 [k]
    label: NDArray,  # int16 [k]
    place: NDArray,  # int32 [units]
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Count the nodes of each part by segment.

    Returns:
        part int32, in the order met, its class int16, its nodes float64 and its first row int32. A row is a part int32,
        a segment int32, how many nodes of the part lie in it float64, and the part's next row int32, -1 = none; those
        of a part ascend.
    """
    row_part, row_segment = np.zeros(len(unit), np.int32), np.zeros(len(unit), np.int32)
    row_nodes = np.zeros(len(unit))
    following, head = np.full(len(unit), -1, np.int32), np.full(len(unit), -1, np.int32)
    part, nodes, of_label = np.zeros(len(unit), np.int32), np.zeros(len(unit)), np.zeros(len(unit), np.int16)
    rows, parts = 0, 0
    for i in range(len(unit)):
        p = place[unit[i]]
        if p < 0:
            p = place[unit[i]] = parts
            part[p], of_label[p] = unit[i], label[i]
            parts += 1
        nodes[p] += 1.0
        before, row = -1, head[p]
        while row >= 0 and row_segment[row] < segment[i]:
            before, row = row, following[row]
        if row < 0 or row_segment[row] != segment[i]:
            row_part[rows], row_segment[rows], following[rows] = unit[i], segment[i], row
            if before < 0:
                head[p] = rows
            else:
                following[before] = rows
            row = rows
            rows += 1
        row_nodes[row] += 1.0
    for one in part[:parts]:
        place[one] = -1
    of_rows = row_part[:rows].copy(), row_segment[:rows].copy(), row_nodes[:rows].copy()  # they are kept
    return part[:parts], of_label, nodes, head, *of_rows, following


@njit(cache=True, nogil=True)
def _pairs(
    unit: NDArray,  # int32 [k], parts of the nodes that a frame saw
    segment: NDArray,  # int32 [k]
    label: NDArray,  # int16 [k], of a part always the same
    nodes_of: NDArray,  # int64 [units], how many each part has
    tops: int,
    place: NDArray,  # int32 [units], scratch: all -1, and so again in the end
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Return how much one frame saw of which part in which segment, and what it says about every two of a class.

    Two parts are one as far as their nodes lie in the same segments. That counts as many nodes as were seen of the one
    of which fewer were, and of two lower parts only the share that was seen of the one of which less was: a mask that
    slips over an edge shows a sliver of the next part, in the same segment as all parts of its own object.

    Returns:
        Part int32 [r], segment int32 [r] and how many nodes of the part lie in it, float64 [r]; int32 [p, 2], two
        parts, ascending; float64 [p, 2], same and different.
    """
    part, of_label, nodes, head, row_part, row_segment, row_nodes, following = _rows(unit, segment, label, place)
    parts = len(part)
    # The lower parts of each class are a list, too; so each part meets those that follow it only.
    order = np.argsort(part)
    later, count = np.full(parts, -1, np.int32), 0
    first, lower = np.full(label.max() + 1 if parts else 0, -1, np.int32), np.zeros(label.max() + 1 if parts else 0)
    for a in order[::-1]:
        later[a] = first[of_label[a]]
        count += lower[of_label[a]]
        if part[a] >= tops:
            first[of_label[a]] = a
            lower[of_label[a]] += 1
    ends, evidence = np.zeros((int(count), 2), np.int32), np.zeros((int(count), 2))
    n = 0
    for a in order:
        b = later[a]
        while b >= 0:
            agree = 0.0
            i, j = head[a], head[b]
            while i >= 0 and j >= 0:
                if row_segment[i] == row_segment[j]:
                    agree += row_nodes[i] / nodes[a] * (row_nodes[j] / nodes[b])
                    i, j = following[i], following[j]
                elif row_segment[i] < row_segment[j]:
                    i = following[i]
                else:
                    j = following[j]
            weight = min(nodes[a], nodes[b])
            if part[a] >= tops:
                weight *= min(nodes[a] / nodes_of[part[a]], nodes[b] / nodes_of[part[b]])
            ends[n, 0], ends[n, 1] = part[a], part[b]
            evidence[n, 0], evidence[n, 1] = agree * weight, (1 - agree) * weight
            n += 1
            b = later[b]
    return row_part, row_segment, row_nodes, ends, evidence


@njit(cache=True, nogil=True)
def _summed(
    ends: NDArray,  # int32 [n, 2], two parts
    evidence: NDArray,  # float64 [n, 2], same and different
    parts: int,
) -> tuple[NDArray, NDArray]:
    """Add up the evidence on the same two parts; the sums ascend by parts."""
    # Count, by the second part and then by the first, where the rows of each begin: they need not be compared.
    order = np.zeros(len(ends), np.int32)
    for column in (1, 0):
        start = np.zeros(parts + 1, np.int64)
        for i in range(len(ends)):
            start[ends[i, column] + 1] += 1
        start, before, order = np.cumsum(start), order, np.zeros(len(ends), np.int32)
        for k in range(len(ends)):
            i = k if column == 1 else before[k]
            part = ends[i, column]
            order[start[part]] = i
            start[part] += 1
    of, sums = np.zeros((len(ends), 2), np.int32), np.zeros((len(ends), 2))
    n = -1
    for i in order:
        if n < 0 or of[n, 0] != ends[i, 0] or of[n, 1] != ends[i, 1]:
            n += 1
            of[n, 0], of[n, 1], sums[n, 0], sums[n, 1] = ends[i, 0], ends[i, 1], evidence[i, 0], evidence[i, 1]
        else:
            sums[n, 0] += evidence[i, 0]
            sums[n, 1] += evidence[i, 1]
    return of[: n + 1].copy(), sums[: n + 1].copy()


def _all_summed(found: list[_Evidence], parts: int) -> _Evidence:
    """Add up what was found one after the other."""
    return _summed(np.concatenate([ends for ends, _ in found]), np.concatenate([sums for _, sums in found]), parts)


def _join(
    units: int, tops: int, pooled: _Evidence, near: NDArray, nodes_of: NDArray, settings: SpaceSettings
) -> NDArray:
    """Join parts of objects, best affinity first; two objects of the map stay two, each with what most ties to it.

    Args:
        units: number of parts.
        tops: the first so many are objects of the map.
        pooled: the evidence on every two; ascending.
        near: bool, aligned with it: they touch.
        nodes_of: int64 [units].
        settings: how.

    Returns:
        int64 [units]: a part that each was joined with; objects of the map keep their number.
    """
    share = min(settings.pooling.touching_same, _TOUCHING_BELOW)
    with_imagined = _with_imagined(pooled, near & (pooled[0][:, 0] >= tops), settings.pooling.imagined_pairs, share)
    parent = _joined(units, tops, with_imagined, near, settings, share)
    group = _with_most_evidence(parent, tops, pooled, settings.affinity)
    # What is too small to be believed an object by itself belongs to what it touches, as on the map. Numbers that come
    # first stay apart.
    numbers = np.unique(group)
    alone = (numbers < tops) | (np.bincount(group, nodes_of, units)[numbers] >= _REMNANT)
    numbers = numbers[np.argsort(~alone, kind="stable")]
    new = np.zeros(units, np.int32)
    new[numbers] = np.arange(len(numbers))
    two = new[group[pooled[0][:, 0]]], new[group[pooled[0][:, 1]]]
    ends = np.stack([np.minimum(*two), np.maximum(*two)], axis=1)
    pooled = _summed(ends, pooled[1], len(numbers))
    parent = _joined(
        len(numbers), int(alone.sum()), pooled, _among(pooled[0], ends[near]), settings, settings.pooling.touching_same
    )
    return numbers[parent[new[group]]]


def _with_imagined(pooled: _Evidence, touching: NDArray, pairs: float, share: float) -> _Evidence:
    """Return the evidence with what is imagined of parts that touch, bool, for `_joined` to add up as groups grow.

    So two rows of books, of many parts each, are not joined by the little that frames say of each two parts. The more
    frames say of them, the fewer pairs are imagined.

    Args:
        pooled: the evidence.
        touching: bool, aligned with it, the parts of which pairs are imagined.
        pairs: how many where frames say nothing; half as many where they say as much.
        share: how much of it is *same*.
    """
    ends, evidence = pooled
    same, different = evidence.T
    imagined = np.where(touching, pairs * pairs / np.maximum(pairs + (same + different), 1e-9), 0.0)
    return ends, np.stack([same + imagined * share, different + imagined * (1.0 - share)], axis=1)


def _joined(
    units: int, kept: int, pooled: _Evidence, near: NDArray, settings: SpaceSettings, touching_same: float
) -> NDArray:
    """Join parts, best affinity first, of which the first so many stay apart; return the smallest of each group."""
    two = pooled[0][:, 0] != pooled[0][:, 1]
    low, high, same, different = (of[:, k][two] for of in pooled for k in (0, 1))
    source, target, _ = join_parts(
        units, low, high, same, different, near[two],
        replace(settings.pooling, touching_same=touching_same), kept=kept, above=settings.affinity,
    )  # fmt: skip
    parent = np.arange(units)
    parent[source] = target
    for unit in range(units):  # a part is joined to smaller ones only
        parent[unit] = parent[parent[unit]]
    return parent


def _has_segments(group: NDArray, seen_in: _SeenIn) -> NDArray:
    """Return whether groups have segments of their own, bool [units]; ``group`` is that of each part, int64 [units].

    What frames saw of a group lies mostly in segments of which no other group has more. What lies mostly in those of
    others is a part of them that no evidence tied to one of them, as masks wander from one to the next.
    """
    part, segment, nodes = seen_in
    of = group[part]
    segments, host, _ = majority(segment, of, nodes.astype(np.int64))
    own = np.where(host[np.searchsorted(segments, segment)] == of, nodes, -nodes)
    return np.bincount(of, own, len(group)) >= 0.0


def _with_most_evidence(parent: NDArray, tops: int, pooled: _Evidence, least: float) -> NDArray:
    """Leave each group that is tied to an object of the map to the one that most evidence ties it to.

    A few cells that broke off an object of the map are seen with what lies below in fewer frames than the rest of it,
    and so with fewer errors: they may come first, and the rest cannot follow, as objects of the map stay apart.
    """
    (a, b), evidence = pooled[0].T.astype(np.int64), pooled[1]
    tied = (a < tops) & (b >= tops)
    tied[tied] = parent[b[tied]] < tops
    pairs, at = np.unique((parent[b[tied]] << 32) | a[tied], return_inverse=True)
    same, different = (np.bincount(at, evidence[tied, k], len(pairs)) for k in (0, 1))
    order = np.argsort(same - different, kind="stable")  # the most evidence is written last
    order = order[same[order] > least * (same + different)[order]]
    owner = np.arange(len(parent))
    owner[pairs[order] >> 32] = pairs[order] & 0xFFFFFFFF
    return np.where(np.arange(len(parent)) < tops, parent, owner[parent])


def _among(ends: NDArray, others: NDArray) -> NDArray:
    """Return which pairs of parts, which ascend, are the same as one of the others; each of these is there."""
    keys, others = (of[:, 0].astype(np.int64) << 32 | of[:, 1] for of in (ends, others))
    found = np.zeros(len(keys), np.bool_)
    found[np.searchsorted(keys, others)] = True
    return found


def _hidden(
    grid: Grid, nodes: _Nodes, top: NDArray, groups: _Groups, first_id: int, settings: SpaceSettings, lowest: int
) -> list[tuple[Instance, int]]:
    """Describe the groups that are tied to no object of the map and are large enough, with their group numbers.

    Their ids follow the order of class names, then of their first cells.

    Args:
        grid: the map.
        nodes: of the classes of which something lies below.
        top: int32 [nodes], the instance that the map shows there, 0 = a lower node.
        groups: what the lower nodes are parts of.
        first_id: follows those of the map.
        settings: how.
        lowest: first step of a column.
    """
    lower = groups.lower
    free = np.flatnonzero(groups.instance == 0)
    cell, label, steps = nodes.cell[lower[free]], nodes.label[lower[free]], nodes.steps[lower[free]]
    numbers, at = np.unique(groups.group[free], return_inverse=True)
    order = np.argsort(at, kind="stable")
    # Voxels of each group, and those it needs beside what else there is of its class.
    owner = top.copy()
    owner[lower] = np.where(groups.instance > 0, groups.instance, first_id + groups.group)
    voxels = np.bincount(owner, np.bitwise_count(nodes.steps)).astype(np.int64)
    owners, class_of = np.flatnonzero(voxels), np.zeros(len(voxels), np.int16)
    class_of[owner] = nodes.label
    small = set(owners[voxels[owners] < least_sizes(voxels[owners], class_of[owners])].tolist())
    found = []
    for members in np.split(order, np.cumsum(np.bincount(at))[:-1]) if len(numbers) else ():
        group = int(numbers[at[members[0]]])
        glimpsed = groups.frames[group] < _MIN_FRAMES and not settings.exact
        if glimpsed or not groups.apart[group] or len(cells := np.unique(cell[members])) < settings.min_cells:
            continue
        run = _as_runs(cell[members], steps[members], np.zeros(len(members), np.int32), lowest)
        name = grid.labels[label[members[0]]]
        found.append((name, int(cells[0]), group, _described(grid.spec, cells, run[:3])))
    found.sort(key=lambda one: one[:3])
    return [
        (Instance(first_id + k, name, cells, middle, box, int(groups.frames[group]), float(groups.score[group])), group)
        for k, (name, _, group, (cells, middle, box)) in enumerate(found)
        if first_id + group not in small
    ]


def _described(spec: GridSpec, cells: NDArray, runs: tuple[NDArray, NDArray, NDArray]) -> tuple[int, Point3, Box3]:
    """Return the number of cells, the middle and the box of an object, metres, map frame."""
    s, (row, col) = spec.cell_size_m, np.divmod(cells, spec.cols)
    low = (spec.x0_m + col.min() * s, spec.y0_m + row.min() * s, float(runs[1].min()) * STEP_M)
    high = (spec.x0_m + (col.max() + 1) * s, spec.y0_m + (row.max() + 1) * s, (float(runs[2].max()) + 1) * STEP_M)
    size = runs[2].astype(np.int64) - runs[1] + 1
    z = float(((runs[1] + runs[2] + 1.0) / 2.0 * size).sum() / size.sum()) * STEP_M
    centre = (float(spec.x0_m + (col.mean() + 0.5) * s), float(spec.y0_m + (row.mean() + 0.5) * s), z)
    return len(cells), centre, (tuple(map(float, low)), tuple(map(float, high)))  # pyright: ignore[reportReturnType]
