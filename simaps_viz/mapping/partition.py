"""From finest communities and a merge log to instances: a prefix of the log, looked up, never recomputed."""

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import Grid, Instance, MergeLog, Views


def applied_steps(log: MergeLog, threshold: float) -> NDArray:
    """Tell which steps of a merge log a threshold takes.

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
    """Give the log of a method that joins nothing."""
    return MergeLog(np.zeros(0, np.int16), np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0, np.float32))


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
    parent = list(range(communities + 1))
    for source, target in zip(log.source[applied].tolist(), log.target[applied].tolist(), strict=True):
        parent[source] = target
    smallest = list(range(communities + 1))
    root = smallest.copy()
    for community in range(communities + 1):
        at = community
        while parent[at] != at:
            parent[at] = parent[parent[at]]
            at = parent[at]
        root[community] = at
        smallest[at] = min(smallest[at], community)
    return np.array(smallest, dtype=np.int32)[np.array(root)]


def describe_instances(grid: Grid, instance: NDArray, views: Views, instance_of: NDArray) -> tuple[Instance, ...]:
    """Measure every instance: cells, centroid, box, frames, score. Sorted by class name, then id."""
    flat = instance.reshape(-1)
    where = np.flatnonzero(flat)
    ids, group = np.unique(flat[where], return_inverse=True)
    if len(ids) == 0:
        return ()
    spec = grid.spec
    row, col = np.divmod(where, spec.cols)
    x = spec.x0_m + (col + 0.5) * spec.cell_size_m
    y = spec.y0_m + (row + 0.5) * spec.cell_size_m
    z = grid.height_m.reshape(-1)[where].astype(np.float64)
    n = np.bincount(group)
    mean = [np.bincount(group, weights=axis) / n for axis in (x, y, z)]
    half = spec.cell_size_m / 2.0
    low = [_extreme(np.minimum, group, axis, np.inf, len(ids)) for axis in (x - half, y - half, z)]
    high = [_extreme(np.maximum, group, axis, -np.inf, len(ids)) for axis in (x + half, y + half, z)]
    label = np.zeros(len(ids), dtype=int)
    label[group] = grid.label.reshape(-1)[where]
    frames, score = _seen(views, instance_of, ids)

    found = []
    for i, instance_id in enumerate(ids.tolist()):
        found.append(
            Instance(
                id=instance_id,
                label=grid.labels[label[i]],
                cells=int(n[i]),
                centroid_m=_triple(mean, i),
                aabb_m=(_triple(low, i), _triple(high, i)),
                frames=int(frames[i]),
                score=round(float(score[i]), 4),
            )
        )
    return tuple(sorted(found, key=lambda one: (one.label, one.id)))


def _extreme(ufunc: np.ufunc, group: NDArray, values: NDArray, start: float, size: int) -> NDArray:
    result = np.full(size, start)
    ufunc.at(result, group, values)
    return result


def _triple(axes: list[NDArray], i: int) -> tuple[float, float, float]:
    return (round(float(axes[0][i]), 4), round(float(axes[1][i]), 4), round(float(axes[2][i]), 4))


def _seen(views: Views, instance_of: NDArray, ids: NDArray) -> tuple[NDArray, NDArray]:
    """Count the frames that saw each instance, and the mean confidence of the segments that named its cells."""
    instance = instance_of[views.community]
    known = instance > 0
    views_cells, views_score, views_frame = views.cells[known], views.score[known], views.frame[known]
    instance = instance[known]
    at = np.searchsorted(ids, instance)
    pairs = np.unique(at.astype(np.int64) << 32 | views_frame.astype(np.int64))
    frames = np.bincount(pairs >> 32, minlength=len(ids))
    cells = np.bincount(at, weights=views_cells, minlength=len(ids))
    total = np.bincount(at, weights=views_cells * views_score.astype(np.float64), minlength=len(ids))
    return frames, total / np.maximum(cells, 1)
