"""How well two segmentations of the same frame, or two maps of the same frames, agree: segment by segment."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from simaps_viz.structures import Segmentation, SIMap

MATCHED = 0.5
"""Least intersection over union of two that are the same; at most one can have more than this."""


@dataclass(frozen=True)
class Agreement:
    """What two sides have in common."""

    ious: tuple[float, ...]
    """Of those that match."""
    lost: int
    """Of the reference's, without a match."""
    extra: int
    """Of the other side's, without a match."""

    @property
    def mean_iou(self) -> float:
        """Over those that match; 1 where there are none on either side."""
        return float(np.mean(self.ious)) if self.ious else float(not self.lost and not self.extra)

    def __str__(self) -> str:
        """Return the comparison as one line."""
        return f"{len(self.ious)} match, mean IoU {self.mean_iou:.3f}; {self.lost} only there, {self.extra} only here"


def agreement(pairs: Iterable[tuple[Segmentation, Segmentation]]) -> Agreement:
    """Compare the things of frames, those of a class with one another.

    Args:
        pairs: (ours, reference), a pair for each frame.
    """
    ious: list[float] = []
    lost = extra = 0
    for ours, theirs in pairs:
        mine = {s.id: s.label for s in ours.segments if s.is_thing}
        wanted = {s.id: s.label for s in theirs.segments if s.is_thing}
        found = _matches(ours.ids, theirs.ids, mine, wanted)
        ious += found.values()
        lost, extra = lost + len(wanted) - len(found), extra + len(mine) - len(found)
    return Agreement(tuple(ious), lost, extra)


def map_agreement(ours: SIMap, theirs: SIMap, *, min_cells: int = 20) -> Agreement:
    """Compare the instances of two maps of the same place, whose grids may lie differently by whole cells.

    Args:
        ours: one map.
        theirs: the reference.
        min_cells: smaller instances may match, but need not, on either side.
    """
    first, second = ours.spec, theirs.spec
    x0, y0 = min(first.x0_m, second.x0_m), min(first.y0_m, second.y0_m)
    x1, y1 = (max(first.extent_m[i], second.extent_m[i]) for i in (2, 3))
    shape = (round((y1 - y0) / first.cell_size_m), round((x1 - x0) / first.cell_size_m))
    laid = []
    for simap in (ours, theirs):
        ids = np.zeros(shape, np.int32)
        spec = simap.spec
        row, col = round((spec.y0_m - y0) / spec.cell_size_m), round((spec.x0_m - x0) / spec.cell_size_m)
        ids[row : row + spec.rows, col : col + spec.cols] = simap.instance
        laid.append(ids)
    mine, wanted = ({i.id: i.label for i in simap.instances} for simap in (ours, theirs))
    found = _matches(laid[0], laid[1], mine, wanted)
    large = [{i.id for i in simap.instances if i.cells >= min_cells} for simap in (ours, theirs)]
    counted = [iou for (a, b), iou in found.items() if a in large[0] or b in large[1]]
    lost, extra = large[1] - {b for _, b in found}, large[0] - {a for a, _ in found}
    return Agreement(tuple(counted), len(lost), len(extra))


def _matches(
    ours: np.ndarray, theirs: np.ndarray, mine: dict[int, str], wanted: dict[int, str]
) -> dict[tuple[int, int], float]:
    """Return the IoU of every pair of one class with more than `MATCHED` of it."""
    width = int(theirs.max(initial=0)) + 1
    pairs, counts = np.unique(ours.astype(np.int64) * width + theirs, return_counts=True)
    of_mine = np.bincount(ours.reshape(-1), minlength=1)
    of_theirs = np.bincount(theirs.reshape(-1), minlength=1)
    found: dict[tuple[int, int], float] = {}
    for pair, shared in zip(pairs.tolist(), counts.tolist(), strict=True):
        a, b = divmod(pair, width)
        if a in mine and b in wanted and mine[a] == wanted[b]:
            iou = shared / (of_mine[a] + of_theirs[b] - shared)
            if iou > MATCHED:
                found[a, b] = float(iou)
    return found
