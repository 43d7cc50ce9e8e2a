"""What follows from changed cells: the merge log, the views and the graphs of a mended map."""

import numpy as np
from numpy.typing import NDArray

from simaps_viz.mapping.evidence import affine
from simaps_viz.mapping.graph import weighted
from simaps_viz.mapping.grouping import group_views
from simaps_viz.structures import CellGraph, Grid, MergeLog, SIMap, Views


def log_without(log: MergeLog, communities: NDArray) -> MergeLog:
    """Drop the steps that speak of some communities; every threshold takes the same of the other steps as before.

    A threshold takes a class's steps up to the first whose score it does not let pass. A step after a dropped one of
    lower score therefore takes over that score.
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
    """Hand the views of changed communities on: new ones take them in proportion to the cells they share.

    Args:
        simap: the map before.
        after: int32 [rows, cols], its communities now, 0 where nothing is left.
    """
    views, before = simap.views, simap.community
    touched = np.unique(before[(before != after) & (before > 0)])
    changed = np.isin(views.community, touched)
    if not changed.any():
        return views
    there = np.isin(before, touched)
    pairs, overlap = np.unique(before[there].astype(np.int64) << 32 | after[there], return_counts=True)
    old, new = pairs >> 32, pairs & 0xFFFFFFFF
    sizes = np.bincount(old, overlap)
    rows = np.flatnonzero(changed)
    first, last = (np.searchsorted(old, views.community[rows], side=side) for side in ("left", "right"))
    row = np.repeat(rows, last - first)
    at = np.arange(len(row)) + np.repeat(first - (np.cumsum(last - first) - (last - first)), last - first)
    cells = np.rint(views.cells[row] * overlap[at] / sizes[old[at]]).astype(np.int64)
    kept = (new[at] > 0) & (cells > 0)
    return _summed(views, ~changed, row[kept], new[at][kept], cells[kept])


def _summed(views: Views, untouched: NDArray, row: NDArray, community: NDArray, cells: NDArray) -> Views:
    """Add shares to the untouched views; shares of one community, frame and segment become one."""
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
    """Give the graphs of the classes as they are on ``grid``: edges stay where both of their cells have one class."""
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
        if simap.method == "evidence":
            graphs[index] = affine(index, cells, edges, mine[2], mine[3])
        else:
            graphs[index] = weighted(grid, index, cells, edges, mine[2])
    return tuple(graphs[index] for index in sorted(graphs))


def _links(graphs: list[CellGraph]) -> NDArray:
    """Give the edges of graphs, int64 [4, m]: the two flat cell numbers, counts, different."""
    if not graphs:
        return np.zeros((4, 0), np.int64)
    parts = [
        np.stack([graph.cells[graph.edges[:, 0]], graph.cells[graph.edges[:, 1]], graph.counts, graph.different])
        for graph in graphs
    ]
    return np.concatenate(parts, axis=1)
