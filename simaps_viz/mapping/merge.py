"""The K % rule: which communities of one class join, in which order. One run gives the answer for every K."""

import heapq
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

Step = tuple[int, int, float]
"""(source, target, share): the source ends and its cells belong to the target."""


def merge_steps(community: NDArray, edges: NDArray) -> list[Step]:
    """Merge C1 into C2 while any of C1's cells neighbours C2, always the largest share first.

    The share is the part of C1's cells that have an edge to a cell of C2. Stopping before the first step whose share
    is not above K / 100 gives the partition for K, so every K is a prefix of this log. Ties go to the lower source,
    then the lower target.

    Args:
        community: int [n], numbered from 0.
        edges: int [m, 2], positions in ``community``.

    Returns:
        The steps down to K = 0, in order.
    """
    return _Merger(community, edges).run()


class _Merger:
    """Keeps, for every two communities, how many cells of the first touch the second."""

    def __init__(self, community: NDArray, edges: NDArray) -> None:
        sizes = np.bincount(community) if len(community) else np.zeros(0, int)
        self.size = {c: int(n) for c, n in enumerate(sizes)}
        self.home: dict[int, int] = {}  # border cell -> its community
        self.touches: dict[int, set[int]] = defaultdict(set)  # border cell -> communities it has an edge to
        self.members: dict[int, set[int]] = defaultdict(set)  # community -> its border cells
        self.touched_by: dict[int, set[int]] = defaultdict(set)  # community -> border cells that touch it
        self.count: dict[int, dict[int, int]] = defaultdict(lambda: defaultdict(int))
        self.heap: list[tuple[float, int, int]] = []
        a, b = edges[:, 0], edges[:, 1]
        crosses = community[a] != community[b]
        both = np.concatenate([edges[crosses], edges[crosses][:, ::-1]])
        pairs = np.unique(np.stack([both[:, 0], community[both[:, 1]]], axis=1), axis=0) if len(both) else both
        for cell, other in pairs.tolist():
            self.home[cell] = home = int(community[cell])
            self.members[home].add(cell)
            self.touches[cell].add(other)
            self.touched_by[other].add(cell)
            self.count[home][other] += 1
        for source in self.count:
            self._offer_row(source)

    def _offer(self, source: int, target: int) -> None:
        touching = self.count[source].get(target, 0)
        if touching:
            heapq.heappush(self.heap, (-touching / self.size[source], source, target))

    def _offer_row(self, source: int) -> None:
        for target in self.count[source]:
            self._offer(source, target)

    def run(self) -> list[Step]:
        steps: list[Step] = []
        while self.heap:
            negative, source, target = heapq.heappop(self.heap)
            if source not in self.size or target not in self.size:
                continue
            touching = self.count[source].get(target, 0)
            if touching == 0 or touching / self.size[source] != -negative:
                continue  # an offer that a later merge has overtaken
            steps.append((source, target, -negative))
            self._join(source, target)
        return steps

    def _join(self, source: int, target: int) -> None:
        for cell in self.touched_by.pop(source, set()):
            self._redirect(cell, source, target)
        for cell in self.members.pop(source, set()):
            self._move(cell, target)
        row = self.count.pop(source, {})
        for other, touching in row.items():
            if other != target and touching:
                self.count[target][other] += touching
        self.count[target].pop(target, None)
        self.size[target] += self.size.pop(source)
        self._offer_row(target)

    def _redirect(self, cell: int, source: int, target: int) -> None:
        """A cell that touched the source touches the target now, unless it already did or lies in it."""
        home = self.home[cell]
        self.touches[cell].discard(source)
        self.count[home].pop(source, None)
        if home == target or target in self.touches[cell]:
            return
        self.touches[cell].add(target)
        self.touched_by[target].add(cell)
        self.count[home][target] += 1
        self._offer(home, target)

    def _move(self, cell: int, target: int) -> None:
        """A border cell of the source belongs to the target now, and no longer touches it from outside."""
        self.home[cell] = target
        self.members[target].add(cell)
        if target in self.touches[cell]:
            self.touches[cell].discard(target)
            self.touched_by[target].discard(cell)
