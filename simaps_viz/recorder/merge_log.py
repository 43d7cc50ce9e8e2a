"""Two more timelines: Louvain level by level, and the merge log step by step."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from simaps_viz.colors.instances import instance_colors, take_over
from simaps_viz.events import CommunitiesFound, MergesFound
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.timeline import Timeline
from simaps_viz.recorder.map_log import MapLog
from simaps_viz.recorder.map_pictures import Merging, cell_centres, markdown, merge_order, on_picture, shown_steps
from simaps_viz.recorder.settings import RecorderSettings
from simaps_viz.structures import Grid, SIMap

MARK_COLOR = (20, 20, 20)
MARK_MARGIN_M = 0.15
"""Between the cells of two groups that join and the rectangle around them."""


def log_louvain(stream: rr.RecordingStream, map_log: MapLog, event: CommunitiesFound, simap: SIMap | None) -> int:
    """Log timeline "louvain": 0 = classes only, then its levels, the last of which are the final communities.

    Args:
        stream: where to.
        map_log: draws the maps.
        event: the final communities.
        simap: the finished map; without it only the last level is known.

    Returns:
        Number of levels.
    """
    found = [] if simap is None else _levels_between(simap)
    levels = len(found) + 1
    stream.reset_time()
    stream.set_time("louvain", sequence=0)
    map_log.log_grid(event.grid)
    map_log.log_things(event.grid)
    stream.log("/now", markdown("**Before**: the map knows classes, not objects."))
    for position, level in enumerate(found, 1):
        stream.set_time("louvain", sequence=position)
        map_log.log_objects(event.grid, level.community, instance_colors(level))
        count = np.count_nonzero(np.unique(level.community))
        stream.log("/now", markdown(f"**Louvain, level {position} of {levels}**: {count} communities."))
    stream.set_time("louvain", sequence=levels)
    map_log.log_objects(event.grid, event.community)
    count = np.count_nonzero(np.unique(event.community))
    stream.log("/now", markdown(f"**Louvain** found {count} communities: pieces of objects, or whole ones."))
    stream.reset_time()
    return levels


def _levels_between(simap: SIMap) -> list[SIMap]:
    """Return the maps of Louvain's intermediate levels, in colours like those of the map."""
    steps = Timeline(simap)
    found = [steps.map_at(position) for position in range(1, steps.levels)]
    for level in found:
        take_over(level, simap)
    return found


def log_merges(
    stream: rr.RecordingStream, map_log: MapLog, event: MergesFound, settings: RecorderSettings, simap: SIMap | None
) -> None:
    """Log timeline "merge": 0 = the finest communities, n = after n merges.

    The steps the chosen K takes come first, in the order of the log, so that the map after them is the finished one
    (but for specks too small for an instance); those that only a smaller K would take follow. Not every
    step gets a picture, but each is told in words.
    """
    log, grid = event.log, event.grid
    order = merge_order(event.applied)
    applied = int(event.applied.sum())
    pictures = set(shown_steps(len(log), applied, settings.merge_pictures).tolist())
    merging = Merging(log, order, int(event.community.max(initial=0)))
    places = _Places(grid, event.community)
    stream.reset_time()
    stream.set_time("merge", sequence=0)
    map_log.log_grid(grid)
    map_log.log_objects(grid, event.community)
    stream.log("/now", markdown(f"**Merge log**: {len(log)} steps, {applied} of them taken{_chosen(simap)}."))
    for position in range(len(log)):
        stream.set_time("merge", sequence=position + 1)
        before = merging.name_of.copy()
        source, target = merging.step(position)
        stream.log("/map/merge", _mark(places, before == source, before == target))
        at = int(order[position])
        name, share = grid.labels[int(log.label[at])], float(log.score[at])
        taken = f"taken{_chosen(simap)}" if position < applied else f"**not** taken{_chosen(simap)}"
        text = f"{name}: community {source} joins {target}, {_score(share, simap)}"
        stream.log("/now", markdown(f"**Step {position + 1} of {len(log)}**, {taken}. {text}."))
        stream.log("/log", rr.TextLog(f"{position + 1}: {text}", level="INFO" if position < applied else "DEBUG"))
        if position + 1 in pictures:
            map_log.log_object_ids(grid, merging.name_of[event.community])
    stream.reset_time()


class _Places:
    """Where groups of communities lie. A group is given as bool [communities + 1]."""

    def __init__(self, grid: Grid, community: NDArray) -> None:
        rows, cols = np.nonzero(community)
        of_cell = community[rows, cols]
        xy = cell_centres(grid.spec, rows, cols)
        size = int(community.max(initial=0)) + 1
        self._cells = np.bincount(of_cell, minlength=size)
        self._sums = np.stack([np.bincount(of_cell, weights=xy[:, axis], minlength=size) for axis in (0, 1)], axis=-1)
        self._low, self._high = np.full((size, 2), np.inf), np.full((size, 2), -np.inf)
        np.minimum.at(self._low, of_cell, xy)
        np.maximum.at(self._high, of_cell, xy)

    def centre(self, group: NDArray) -> NDArray:
        """Return the mean of the group's cells, float64 [2], map frame, metres."""
        return self._sums[group].sum(axis=0) / max(int(self._cells[group].sum()), 1)

    def frame(self, group: NDArray) -> NDArray:
        """Return the corners of a rectangle around the group, closed, float64 [5, 2], map frame, metres."""
        (x0, y0), (x1, y1) = self._low[group].min(axis=0) - MARK_MARGIN_M, self._high[group].max(axis=0) + MARK_MARGIN_M
        return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])


def _mark(places: _Places, source: NDArray, target: NDArray) -> rr.LineStrips2D:
    """Draw a rectangle around two groups that join, and a line from the middle of one to that of the other."""
    link = np.stack([places.centre(source), places.centre(target)])
    strips = [on_picture(link), on_picture(places.frame(source | target))]
    return rr.LineStrips2D(strips, colors=MARK_COLOR, radii=0.025, draw_order=30.0)


def _chosen(simap: SIMap | None) -> str:
    if simap is None:
        return ""
    slider = method_of(simap.method).slider
    value = simap.parameters.get(slider.parameter) if slider is not None else None
    return f" at {slider.setting.format(value)}" if slider is not None and isinstance(value, int | float) else ""


def _score(score: float, simap: SIMap | None) -> str:
    slider = method_of(simap.method).slider if simap is not None else None
    if slider is not None:
        return slider.reason.format(100 * score)
    return f"score {score:.2f}"
