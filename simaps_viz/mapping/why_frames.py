"""Which frames saw an object, and which saw two parts as one object or as two."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import SIMap


@dataclass(frozen=True)
class PairFrame:
    """A frame that saw two parts at once."""

    frame: int
    """Index into ``SIMap.frame_names``."""
    first: tuple[int, ...]
    """Segments, ids in that frame's segmentation, that named cells of the first part. Where the frame saw two, those
    that named more of the first part than of the second."""
    second: tuple[int, ...]
    """The same of the second part."""
    cells: int
    """How many cells of the part of which it saw fewer."""


@dataclass(frozen=True)
class Together:
    """The frames that saw two parts at once; those that saw most of both come first (ties: the earlier frame)."""

    as_one: tuple[PairFrame, ...]
    as_two: tuple[PairFrame, ...]

    def __len__(self) -> int:
        return len(self.as_one) + len(self.as_two)


@dataclass(frozen=True)
class SourceFrame:
    """A frame whose segments named cells of an instance."""

    frame: int
    """Index into ``SIMap.frame_names``."""
    segments: tuple[int, ...]
    """Ids in that frame's segmentation."""
    cells: int
    """How many of its cells."""
    as_one: bool
    """One segment named both ends of more than half of the pairs of cells it saw."""


def seen_together(simap: SIMap, first: NDArray, second: NDArray) -> Together:
    """Sort the frames that saw two groups of communities at once into those that saw one object and those that saw two.

    A frame's pairs of cells, one in each group, are seen as one where the same segment names both.

    Args:
        simap: the map.
        first: int [n], ids of the communities of one group.
        second: int [m], of the other, which shares none with it.
    """
    views = simap.views
    size = max(int(simap.community.max(initial=0)), int(views.community.max(initial=0))) + 1
    group = np.zeros(size, dtype=np.int8)
    group[first], group[second] = 1, 2
    of_view = group[views.community]
    kept = np.flatnonzero(of_view)
    kept = kept[_in_both(views.frame[kept], of_view[kept])]
    key = views.frame[kept].astype(np.int64) << 32 | views.segment[kept]
    names, at = np.unique(key, return_inverse=True)
    cells = [np.bincount(at, views.cells[kept] * (of_view[kept] == g), minlength=len(names)) for g in (1, 2)]
    frame, segment = names >> 32, names & 0xFFFFFFFF
    as_one: list[PairFrame] = []
    as_two: list[PairFrame] = []
    for f in np.unique(frame):
        here = slice(*np.searchsorted(frame, [f, f + 1]))
        a, b, ids = cells[0][here], cells[1][here], segment[here]
        one = 2.0 * (a @ b) > a.sum() * b.sum()
        first, second = a > 0, b > 0
        if not one:  # a few stray cells of the other part do not make a segment name both
            nearer = a / a.sum() - b / b.sum()
            first, second = (nearer > 0, nearer < 0) if nearer.any() else (first, second)
        seen = PairFrame(int(f), _ids(ids[first]), _ids(ids[second]), int(min(a.sum(), b.sum())))
        (as_one if one else as_two).append(seen)
    return Together(*(tuple(sorted(side, key=lambda one: (-one.cells, one.frame))) for side in (as_one, as_two)))


def _in_both(frame: NDArray, group: NDArray) -> NDArray:
    """Tell which entries belong to a frame that has entries of group 1 and of group 2."""
    if len(frame) == 0:
        return np.zeros(0, dtype=bool)
    seen = [np.bincount(frame[group == g], minlength=int(frame.max()) + 1) > 0 for g in (1, 2)]
    return (seen[0] & seen[1])[frame]


def source_frames(simap: SIMap, community: NDArray) -> tuple[SourceFrame, ...]:
    """Give the frames whose segments named cells of some communities, int [n]; those that named most come first."""
    views = simap.views
    mine = np.isin(views.community, community)
    frames, segments, cells = views.frame[mine], views.segment[mine], views.cells[mine]
    if not mine.any():
        return ()
    pairs, at = np.unique(frames.astype(np.int64) << 32 | segments, return_inverse=True)
    named = np.bincount(at, cells)
    names, starts = np.unique(pairs >> 32, return_index=True)
    totals, squares = np.add.reduceat(named, starts), np.add.reduceat(named**2, starts)
    ids = np.split(pairs & 0xFFFFFFFF, starts[1:])
    return tuple(
        SourceFrame(int(names[i]), _ids(ids[i]), int(totals[i]), bool(2.0 * squares[i] > totals[i] ** 2))
        for i in np.lexsort((names, -totals))
    )


def _ids(values: NDArray) -> tuple[int, ...]:
    return tuple(int(value) for value in values)
