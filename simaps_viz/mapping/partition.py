"""From finest communities and a merge log to instances: a prefix of the log, looked up, never recomputed.

Layers of large maps are looked up and counted in blocks of rows, as NumPy needs 8 bytes a cell for it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.structures import Grid, Instance, MergeLog, SIMap, Views


@dataclass(frozen=True, eq=False)
class Groups:
    """Rows sorted by community, then frame, then segment, those that agree in all three side by side."""

    order: NDArray
    """int64 [n], the rows so sorted; equal ones as they came."""
    start: NDArray
    """int64 [g], where in ``order`` each group starts."""

    @property
    def first(self) -> NDArray:
        """int64 [g], the first row of each group."""
        return self.order[self.start]

    @property
    def size(self) -> NDArray:
        """int64 [g], rows of each group."""
        return np.diff(self.start, append=len(self.order))

    @property
    def of_row(self) -> NDArray:
        """int64 [n], the group of each row."""
        group = np.empty(len(self.order), np.int64)
        group[self.order] = np.repeat(np.arange(len(self.start)), self.size)
        return group


def group_views(community: NDArray, frame: NDArray, segment: NDArray) -> Groups:
    """Group rows of views or readings; all numbers are whole and from 0, [n] each."""
    columns = [column.astype(np.int64, copy=False) for column in (community, frame, segment)]
    widths = [int(column.max(initial=0)).bit_length() for column in columns]
    if sum(widths) < 64:  # one key is sorted faster than three
        key = (columns[0] << widths[1] | columns[1]) << widths[2] | columns[2]
        order = np.argsort(key, kind="stable")
        keys = [key[order]]
    else:
        order = np.lexsort(columns[::-1])
        keys = [column[order] for column in columns]
    starts = np.ones(len(order), bool)
    starts[1:] = np.logical_or.reduce([key[1:] != key[:-1] for key in keys])
    return Groups(order, np.flatnonzero(starts))


def applied_steps(log: MergeLog, threshold: float) -> NDArray:
    """Return which steps of a merge log a threshold takes.

    In each class that is the prefix before the first step whose score is not above the threshold.

    Args:
        log: steps of one class stand together.
        threshold: in the unit of ``log.score``.

    Returns:
        bool [steps].
    """
    if len(log) == 0:
        return np.zeros(0, dtype=bool)
    stops = ~(log.score > np.float32(threshold))
    before = np.cumsum(stops)
    starts = np.flatnonzero(np.r_[True, np.diff(log.label) != 0])
    stops_before_class = np.repeat(before[starts] - stops[starts], np.diff(np.r_[starts, len(log)]))
    return before == stops_before_class


def empty_log() -> MergeLog:
    """Return the log of a method that joins nothing."""
    return MergeLog(np.zeros(0, np.int16), np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0, np.float32))


def empty_views() -> Views:
    """Return the views of a map without frames."""
    nothing = np.zeros(0, np.int32)
    return Views(nothing, nothing, nothing, nothing, np.zeros(0, np.float32))


def instance_of_community(log: MergeLog, applied: NDArray, communities: int) -> NDArray:
    """Follow the applied merges.

    Args:
        log: the merge log.
        applied: bool [steps].
        communities: highest community number.

    Returns:
        int32 [communities + 1]: the instance of each community; an instance is called by its smallest community, so
        that its name stays when K moves. Entry 0 is 0.
    """
    return _follow(log.source[applied], log.target[applied], communities)


@njit(cache=True, nogil=True)
def _follow(
    source: NDArray,  # int32 [steps]
    target: NDArray,  # int32 [steps]
    communities: int,
) -> NDArray:
    """Return the smallest community that each community was joined with, int32 [communities + 1]."""
    parent = np.arange(communities + 1).astype(np.int32)
    for step in range(len(source)):
        parent[source[step]] = target[step]
    root = parent.copy()
    smallest = np.full(communities + 1, -1, dtype=np.int32)
    for community in range(communities + 1):
        at = community
        while parent[at] != at:
            parent[at] = parent[parent[at]]
            at = parent[at]
        root[community] = at
        if smallest[at] < 0:  # communities are met in ascending order
            smallest[at] = community
    return smallest[root]


def owner_of_community(simap: SIMap) -> NDArray:
    """Return int64 [communities + 1]: the instance that each finest community belongs to now, 0 = none."""
    community, instance = simap.community.reshape(-1), simap.instance.reshape(-1)
    cell = np.flatnonzero(community)  # few of the cells of a building
    owner = np.zeros(max(int(community.max(initial=0)), int(simap.views.community.max(initial=0))) + 1, np.int64)
    owner[community[cell]] = instance[cell]
    return owner


def describe_instances(grid: Grid, instance: NDArray, views: Views, instance_of: NDArray) -> tuple[Instance, ...]:
    """Measure every instance: cells, centroid, box, frames, score.

    Args:
        grid: the map.
        instance: int32 [rows, cols], ids, 0 = none.
        views: what each frame's segments named.
        instance_of: int32 [communities + 1], the instance that a community is called, 0 = none.

    Returns:
        sorted by class name, then id; lengths in metres of the map frame.
    """
    spec, size = grid.spec, int(instance.max(initial=0)) + 1
    place = spec.x0_m, spec.y0_m, spec.cell_size_m
    cells, label, total, low, high = _measured(instance, grid.height_m, grid.label, *place, size)
    ids = np.flatnonzero(cells)
    if len(ids) == 0:
        return ()
    half = np.array([spec.cell_size_m / 2.0, spec.cell_size_m / 2.0, 0.0])[:, None]
    n, label = cells[ids], label[ids]
    mean, low, high = total[:, ids] / n, low[:, ids] - half, high[:, ids] + half
    frames, score = _seen(views, instance_of, ids)

    centroids, lows, highs = (list(zip(*map(_rounded, axes), strict=True)) for axes in (mean, low, high))
    # Python objects last, all columns at once.
    columns = zip(
        ids.tolist(), label.tolist(), n.tolist(), centroids, lows, highs, frames.tolist(), _rounded(score), strict=True
    )
    found = [
        Instance(instance_id, grid.labels[index], cells, centroid, (lowest, highest), seen, confidence)
        for instance_id, index, cells, centroid, lowest, highest, seen, confidence in columns
    ]
    return tuple(sorted(found, key=lambda one: (one.label, one.id)))


@njit(cache=True)
def _measured(
    instance: NDArray, height_m: NDArray, label: NDArray, x0_m: float, y0_m: float, cell_size_m: float, size: int
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Return of each id how many cells it has, its label, and of their tops the sum, least and greatest, [3, ids]."""
    cells, labels = np.zeros(size, np.int64), np.zeros(size, np.int64)
    total, low, high = np.zeros((3, size)), np.full((3, size), np.inf), np.full((3, size), -np.inf)
    for row in range(instance.shape[0]):
        for col in range(instance.shape[1]):
            one = instance[row, col]
            if one == 0:
                continue
            cells[one] += 1
            labels[one] = label[row, col]
            x_m, y_m = x0_m + (col + 0.5) * cell_size_m, y0_m + (row + 0.5) * cell_size_m
            for axis, value in enumerate((x_m, y_m, np.float64(height_m[row, col]))):
                total[axis, one] += value
                low[axis, one] = np.minimum(low[axis, one], value)
                high[axis, one] = np.maximum(high[axis, one], value)
    return cells, labels, total, low, high


def _rounded(values: NDArray) -> list[float]:
    """Round to 4 digits as `round` does, which is slow; what lies about halfway between two numbers is left to it."""
    scaled = values * 1e4
    result = (np.rint(scaled) / 1e4).tolist()
    for i in np.flatnonzero(np.abs(scaled - np.floor(scaled) - 0.5) < 1e-3).tolist():
        result[i] = round(float(values[i]), 4)
    return result


def _seen(views: Views, instance_of: NDArray, ids: NDArray) -> tuple[NDArray, NDArray]:
    """Count the frames that saw each instance, and the mean confidence of the segments that named its cells."""
    place = np.full(max(int(ids[-1]), int(instance_of.max(initial=0))) + 1, -1, dtype=np.int32)
    place[ids] = np.arange(len(ids))
    place[0] = -1
    at = place[instance_of][views.community]
    highest = int(views.frame.max(initial=-1))
    frames, cells, total = _sum_views(at, views.frame, views.cells, views.score, len(ids), highest + 1)
    return frames, total / np.maximum(cells, 1)


@njit(cache=True, nogil=True)
def _sum_views(
    at: NDArray,  # int32 [views], position of the view's instance, -1 = none
    frame: NDArray,  # int32 [views]
    cells_of: NDArray,  # int32 [views]
    score: NDArray,  # float32 [views]
    instances: int,
    frames: int,
) -> tuple[NDArray, NDArray, NDArray]:
    """Count, for each instance, the different frames of its views, their cells, and their cells times their score.

    np.unique and np.bincount give the same numbers, in 1.5 ms in place of 0.24 for the 41,000 views of a house, and
    the slider waits for them.
    """
    # Sum up, and count the views of each instance.
    start = np.zeros(instances + 1, dtype=np.int64)
    cells = np.zeros(instances, dtype=np.float64)
    total = np.zeros(instances, dtype=np.float64)
    for view in range(len(at)):
        if at[view] >= 0:
            start[at[view] + 1] += 1
            cells[at[view]] += cells_of[view]
            total[at[view]] += cells_of[view] * np.float64(score[view])
    # Bucket the frames by instance.
    for i in range(instances):
        start[i + 1] += start[i]
    free = start[:-1].copy()
    frame_of = np.zeros(start[instances], dtype=np.int32)  # sorted by instance
    for view in range(len(at)):
        if at[view] >= 0:
            frame_of[free[at[view]]] = frame[view]
            free[at[view]] += 1
    # Count each frame once for an instance.
    last = np.full(frames, -1, dtype=np.int32)  # the last instance a frame was counted for
    different = np.zeros(instances, dtype=np.int64)
    for i in range(instances):
        for k in range(start[i], start[i + 1]):
            if last[frame_of[k]] != i:
                last[frame_of[k]] = i
                different[i] += 1
    return different, cells, total


BLOCK_CELLS = 1 << 20
"""About how many cells are in a block."""


def row_blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield slices of rows that cover a layer of that shape."""
    rows, cols = shape
    step = max(BLOCK_CELLS // max(cols, 1), 1)
    for first in range(0, rows, step):
        yield slice(first, min(first + step, rows))


def look_up(table: NDArray, ids: NDArray) -> NDArray:
    """Return ``table[ids]``.

    Args:
        table: [k].
        ids: whole numbers from 0 to k - 1, [rows, cols].

    Returns:
        [rows, cols], the table's dtype.
    """
    found = np.zeros(ids.shape, dtype=table.dtype)
    for block in row_blocks(ids.shape):
        found[block] = table[ids[block]]
    return found


def count_ids(ids: NDArray, size: int) -> NDArray:
    """Count the cells of each id above 0, int64 [size]; entry 0 stays 0.

    Args:
        ids: whole numbers from 0 to size - 1, [rows, cols].
        size: length of the result.
    """
    there = [part[part > 0] for part in (ids[block] for block in row_blocks(ids.shape))]
    return np.bincount(np.concatenate([np.zeros(0, ids.dtype), *there]), minlength=size)
