"""Votes: the class of a cell by all frames that saw its top, not by the single highest pixel.

One frame is one vote of a cell: the segment of its highest pixel there. It counts when that pixel lies near the cell's
top, with the segment's confidence as weight; a frame that saw nothing there is a weak vote, because detectors miss more
than they invent. Cells lend their votes to neighbours of about the same height, because mask borders wander.

Exact masks need none of this, and there the highest pixel knows thin things best. The votes themselves tell: where
readings of one cell hardly ever disagree, masks are exact.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.mapping.readings import Readings
from simaps_viz.structures import Grid

_CANDIDATES = 32  # classes that can compete for one cell; more are left out


@dataclass(frozen=True)
class VoteSettings:
    """How readings become the class of a cell."""

    enabled: bool = True
    """False: the highest pixel names the cell, as in the paper."""
    window_m: float = 0.06
    """A reading votes when it lies less than this below the cell's top."""
    nothing: float = 0.3
    """Weight of a frame that saw no segment there."""
    stuff: float = 0.6
    """Weight of a frame that saw stuff (wall, floor) there."""
    scores: bool = True
    """Votes weigh as much as the segment is confident; False: all alike."""
    neighbours: float = 1.0
    """How much of its votes a cell lends to each of its 8 neighbours (diagonal ones 0.7 of it); 0 = none."""
    height_scale_m: float = 0.015
    """Lending falls with the difference of the tops: exp(-difference / scale)."""
    floor_m: float = 0.04
    """Things that stand on the floor do not lie on it: a class most of whose cells are higher than this gets no cell
    that is lower. Masks of chairs cover the floor seen between their legs. 0 = off."""
    exact_below: float = 0.01
    """Masks count as exact, and the highest pixel decides, when less than this share of readings disagrees."""


def vote_labels(grid: Grid, readings: Readings, settings: VoteSettings) -> tuple[NDArray, float]:
    """Name every cell by its votes.

    Args:
        grid: the map by highest pixels.
        readings: of all frames on it.
        settings: how.

    Returns:
        int16 [rows, cols], index into ``grid.labels``, 0 = none; and the share of readings that disagree with the most
        frequent one of their cell (cells with at least three).
    """
    top = grid.height_m.reshape(-1)
    near = readings.height_m > top[readings.cell] - np.float32(settings.window_m)
    start, reading = _by_cell(readings.cell, near, top.size)
    weight = readings.score if settings.scores else (readings.label > 0).astype(np.float32)
    named = np.where(np.array(grid.is_thing), 1.0, settings.stuff)[readings.label]
    weight = np.where(readings.label > 0, weight * named, settings.nothing).astype(np.float32)
    first, label, votes, counts = _tally(start, reading, readings.label, weight)
    disagreement = _disagreement(first, counts)
    if not settings.enabled or disagreement < settings.exact_below:
        return grid.label, disagreement
    heights = np.nan_to_num(top, nan=-np.inf)
    free = np.zeros(len(grid.labels), dtype=np.bool_)
    named = _elect(
        first, label, votes, heights, grid.spec.rows, grid.spec.cols,
        settings.neighbours, settings.height_scale_m, free, settings.floor_m,
    )  # fmt: skip
    if settings.floor_m > 0.0:
        standing = _standing(named, heights, grid, settings.floor_m)
        named = _elect(
            first, label, votes, heights, grid.spec.rows, grid.spec.cols,
            settings.neighbours, settings.height_scale_m, standing, settings.floor_m,
        )  # fmt: skip
    return named.reshape(grid.spec.shape), disagreement


def _standing(label: NDArray, top: NDArray, grid: Grid, floor_m: float) -> NDArray:
    """Tell which thing classes have most of their cells higher than the floor, bool [labels]."""
    seen = top > -np.inf
    cells = np.bincount(label[seen], minlength=len(grid.labels))
    low = np.bincount(label[seen & (top < floor_m)], minlength=len(grid.labels))
    return np.array(grid.is_thing) & (2 * low < cells)


@njit(cache=True, nogil=True)
def _by_cell(cell: NDArray, kept: NDArray, cells: int) -> tuple[NDArray, NDArray]:
    """Sort the kept readings by cell: ``reading[start[c] : start[c + 1]]`` are those of cell c, in their order."""
    start = np.zeros(cells + 1, dtype=np.int32)
    for i in range(len(cell)):
        if kept[i]:
            start[cell[i] + 1] += 1
    for c in range(cells):
        start[c + 1] += start[c]
    at = start[:-1].copy()
    reading = np.zeros(start[cells], dtype=np.int32)
    for i in range(len(cell)):
        if kept[i]:
            reading[at[cell[i]]] = i
            at[cell[i]] += 1
    return start, reading


@njit(cache=True, nogil=True)
def _tally(start, reading, label_of, weight_of):
    """Sum up the votes of every cell by class: those of cell c stand at first[c] : first[c + 1]."""
    cells = len(start) - 1
    first = np.zeros(cells + 1, dtype=np.int32)
    label = np.zeros(len(reading), dtype=np.int16)
    votes = np.zeros(len(reading), dtype=np.float32)
    counts = np.zeros(len(reading), dtype=np.int32)
    n = 0
    for c in range(cells):
        first[c] = n
        for k in range(start[c], start[c + 1]):
            i = reading[k]
            at = first[c]
            while at < n and label[at] != label_of[i]:
                at += 1
            if at == n:
                label[n] = label_of[i]
                n += 1
            votes[at] += weight_of[i]
            counts[at] += 1
    first[cells] = n
    return first, label[:n], votes[:n], counts[:n]


@njit(cache=True, nogil=True)
def _disagreement(first: NDArray, counts: NDArray) -> float:
    total = most = 0
    for c in range(len(first) - 1):
        all_of_cell = best = 0
        for k in range(first[c], first[c + 1]):
            all_of_cell += counts[k]
            best = max(best, counts[k])
        if all_of_cell >= 3:
            total += all_of_cell
            most += best
    return 1.0 - most / total if total else 0.0


@njit(cache=True, nogil=True)
def _elect(first, label, votes, top, rows, cols, neighbours, scale, standing, floor_m):  # noqa: C901, PLR0912 - one loop over shared arrays
    """Let every cell's own and borrowed votes choose its class; ties go to the class met first, its own before."""
    named = np.zeros(rows * cols, dtype=np.int16)
    candidate = np.zeros(_CANDIDATES, dtype=np.int16)
    weight = np.zeros(_CANDIDATES, dtype=np.float64)
    for row in range(rows):
        for col in range(cols):
            c = row * cols + col
            if first[c] == first[c + 1]:
                continue
            n = 0
            for step in range(9):  # the cell itself first
                dr, dc = (step + 4) % 9 // 3 - 1, (step + 4) % 9 % 3 - 1
                if row + dr < 0 or row + dr >= rows or col + dc < 0 or col + dc >= cols:
                    continue
                other = c + dr * cols + dc
                share = 1.0
                if step > 0:
                    if neighbours <= 0.0 or first[other] == first[other + 1]:
                        continue
                    share = neighbours * np.exp(-abs(top[other] - top[c]) / scale)
                    if dr != 0 and dc != 0:
                        share *= 0.7
                for k in range(first[other], first[other + 1]):
                    if standing[label[k]] and top[c] < floor_m:
                        continue
                    at = 0
                    while at < n and candidate[at] != label[k]:
                        at += 1
                    if at == n:
                        if n == _CANDIDATES:
                            continue
                        candidate[n] = label[k]
                        weight[n] = 0.0
                        n += 1
                    weight[at] += share * votes[k]
            if n == 0:
                continue
            best = 0
            for at in range(1, n):
                if weight[at] > weight[best]:
                    best = at
            named[c] = candidate[best]
    return named
