"""How the objects of a map came about, step by step: classes, the levels of Louvain, then the merge log.

A map keeps its communities and its merge log. The levels before the communities are computed again from its graphs,
with the same seed; the last level is the map's own communities.
"""

import threading
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.mapping.explain import seen_together
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.partition import applied_steps, empty_log, instance_of_community, look_up
from simaps_viz.mapping.simap import joining_threshold, slider_of
from simaps_viz.structures import SIMap

MAX_LEVELS = 12
CLASSES = 0
"""The first position: no cells are grouped yet."""


class Timeline:
    """The positions of one map: 0 classes only, then the levels of Louvain, then one for each merge.

    The merges that the map applies come first, in the order of its log; those that only a smaller threshold would apply
    follow. Several threads may share a timeline.
    """

    def __init__(self, simap: SIMap, like: "Timeline | None" = None) -> None:
        """Prepare the timeline; levels are computed when first asked for.

        Args:
            simap: the map.
            like: a timeline of the map for another threshold; its levels are shared.
        """
        self.simap = simap
        threshold = joining_threshold(simap.method, simap.parameters)
        applied = applied_steps(simap.merges, threshold)
        self._order = np.concatenate([np.flatnonzero(applied), np.flatnonzero(~applied)])
        self.taken = int(applied.sum())
        """Number of merges that the map applies."""
        self._communities = int(simap.community.max(initial=0))
        same = like is not None and like.simap.community is simap.community and like.simap.graphs is simap.graphs
        self._shared = like._shared if like is not None and same else _Levels()

    @property
    def levels(self) -> int:
        """Number of levels of Louvain, at least 1."""
        return max(len(self._levels()), 1)

    @property
    def last(self) -> int:
        """The last position."""
        return self.levels + len(self._order)

    @property
    def finished(self) -> int:
        """The position of the map itself."""
        return self.levels + self.taken

    def map_at(self, position: int) -> SIMap:
        """Return the map as it would be at a position, to look at; its instances have no facts."""
        levels = self.levels
        if position == self.finished:
            return self.simap
        if position <= CLASSES:
            return replace(self.simap, instance=np.zeros_like(self.simap.instance), instances=())
        if position < levels:
            return self._levels()[position - 1]
        ids = look_up(self._names(position - levels), self.simap.community)
        return replace(self.simap, instance=ids, instances=())

    def name(self, position: int) -> str:
        """Return what a position is called, wherever the page speaks of it: steps are counted without the levels."""
        if position <= CLASSES:
            return "classes only"
        if position < self.levels:
            return f"Louvain, level {position} of {self.levels}"
        if position == self.levels:
            return "Louvain's communities"
        return f"step {position - self.levels} of {len(self._order)}"

    def words(self, position: int) -> str:
        """Describe what a position shows, for the page."""
        name = self.name(position)
        name = name[0].upper() + name[1:]
        done = position - self.levels
        if position <= CLASSES:
            return f"{name}: each cell has a class, but no cells are grouped into objects yet."
        if done < 0:
            count = _count(self._levels()[position - 1].community)
            return f"{name}: {count} communities."
        if done == 0:
            return f"{name}: {_count(self.simap.community)} parts, before any is joined."
        at = int(self._order[done - 1])
        taken = "" if done <= self.taken else ", which the map does not apply"
        end = f" This is the map: {self.taken} steps applied." if done == self.taken else ""
        return f"{name}{taken}: {self._joined(at, done)}.{end}"

    def recorded(self, position: int) -> tuple[str, int]:
        """Return the timeline of a recorded build ("louvain" or "merge") that shows a position, and the time on it."""
        return ("louvain", position) if position <= self.levels else ("merge", position - self.levels)

    def position_of(self, timeline: str, time: int) -> int:
        """Return the position of a time on timeline "louvain" or "merge" of a recorded build."""
        position = self.levels + time if timeline == "merge" else min(time, self.levels)
        return min(max(position, CLASSES), self.last)

    def done_at(self, position: int) -> NDArray:
        """Return bool [steps of the merge log], whether each step is done at a position."""
        done = np.zeros(len(self._order), dtype=bool)
        done[self._order[: max(position - self.levels, 0)]] = True
        return done

    def _names(self, merges: int) -> NDArray:
        """Return int32 [communities + 1], the instance of each community after so many merges."""
        return instance_of_community(self.simap.merges, self.done_at(self.levels + merges), self._communities)

    def _joined(self, at: int, done: int) -> str:
        log, before = self.simap.merges, self._names(done - 1)
        source, target = int(before[log.source[at]]), int(before[log.target[at]])
        name, share = self.simap.grid.labels[int(log.label[at])], 100.0 * float(log.score[at])
        seen = seen_together(self.simap, np.flatnonzero(before == source), np.flatnonzero(before == target))
        frames = f"; of {len(seen)} frames that saw both, {len(seen.as_one)} saw one object" if len(seen) else ""
        reason = slider_of(self.simap).reason.format(share)
        return f"{name}, parts {source} and {target} joined: {reason}{frames}"

    def _levels(self) -> list[SIMap]:
        """Return a map for each level of Louvain, the last of which is the map's own communities."""
        with self._shared.lock:
            if self._shared.maps is None:
                self._shared.maps = _levels_of(self.simap)
            return self._shared.maps


class _Levels:
    """The levels of Louvain, shared by the timelines of a map for all thresholds."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.maps: list[SIMap] | None = None


def _levels_of(simap: SIMap) -> list[SIMap]:
    """Run Louvain again, with one level more each time, until nothing changes; none where the map has no graphs."""
    found: list[SIMap] = []
    if method_of(simap.method).slider is None or not any(len(graph.edges) for graph in simap.graphs):
        return found
    before = -1
    for level in range(1, MAX_LEVELS + 1):
        community = _level(simap, level)
        count = int(community.max(initial=0))
        if count == before:
            break
        before = count
        found.append(replace(simap, community=community, instance=community, instances=(), merges=empty_log()))
    return found


def _level(simap: SIMap, level: int) -> NDArray:
    """Return the communities after so many levels, int32 [rows, cols], numbered from 1, 0 = none."""
    parts = method_of(simap.method).level(simap.graphs, simap.spec, simap.parameters, level)
    community, first = np.zeros(simap.spec.rows * simap.spec.cols, dtype=np.int32), 1
    for graph, part in zip(simap.graphs, parts, strict=True):
        community[graph.cells] = part + first
        first += int(part.max(initial=-1)) + 1
    return community.reshape(simap.spec.shape)


def _count(ids: NDArray) -> int:
    """Return the number of different ids, without 0."""
    return int(np.count_nonzero(np.unique(ids)))
