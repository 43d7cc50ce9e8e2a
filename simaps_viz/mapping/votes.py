"""Votes: the class of a cell by all frames that saw its top, not by the single highest pixel.

One frame is one vote of a cell: the segment of its highest pixel there. It counts when that pixel lies near the cell's
top, with the segment's confidence as weight; a frame that saw nothing there is a weak vote, because detectors miss more
than they invent. Cells lend their votes to neighbours of about the same height, because mask borders wander.

Constants do not suit every network, though. What the masks of a map get wrong is learned from its own readings, and the
votes are only where that begins; see `mask_errors`.

Exact masks need none of this, and there the highest pixel knows thin things best. The votes themselves show it: where
readings of one cell hardly ever disagree, masks are exact.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.mapping.mask_errors import DEPTHS, depth_of, learn_classes
from simaps_viz.mapping.observations import AllReadings
from simaps_viz.structures import Grid

_CANDIDATES = 32  # classes that can compete for one cell; more are left out

STEP_M = 0.03
"""A surface that frames without masks have seen goes on while its cells differ by less than this in height."""
RINGS = 8
"""For at most so many cells."""


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
    rounds: int = 6
    """How often the errors of the masks are learned, and the classes named anew by them; more than 6 change little.
    0 = never."""
    exact_below: float = 0.01
    """Masks count as exact, and the highest pixel decides, when less than this share of readings disagrees."""


def vote_labels(grid: Grid, readings: AllReadings, settings: VoteSettings) -> tuple[NDArray, float]:
    """Name every cell by its votes.

    Args:
        grid: the map by highest pixels.
        readings: of all frames on it.
        settings: how.

    Returns:
        int16 [rows, cols], index into ``grid.labels``, 0 = none; and the share of readings that disagree with the most
        frequent one of their cell (cells with at least three).
    """
    following, label, votes, by_depth = _gather_votes(grid, readings, settings)
    counts = by_depth.sum(axis=1, dtype=np.int32)
    disagreement = _disagreement(following, counts, grid.label.size)
    if not settings.enabled or disagreement < settings.exact_below:
        return grid.label, disagreement
    heights = np.nan_to_num(grid.height_m.reshape(-1), nan=-np.inf)
    standing = np.zeros(len(grid.labels), dtype=np.bool_)
    named = _elect(
        following, label, votes, counts, heights, grid.spec.rows, grid.spec.cols,
        settings.neighbours, settings.height_scale_m, standing, settings.floor_m,
    )  # fmt: skip
    if settings.floor_m > 0.0:
        standing = _standing(named, heights, grid, settings.floor_m)
        named = _elect(
            following, label, votes, counts, heights, grid.spec.rows, grid.spec.cols,
            settings.neighbours, settings.height_scale_m, standing, settings.floor_m,
        )  # fmt: skip
    named, top = named.reshape(grid.spec.shape), heights.reshape(grid.spec.shape)
    if settings.rounds > 0:
        entries = following, label, by_depth
        named = learn_classes(named, entries, top, standing, settings.floor_m, settings.rounds)
    return named, disagreement


def spread_labels(label: NDArray, height_m: NDArray, unsegmented: NDArray) -> NDArray:
    """Name the cells whose top only frames saw that were not segmented, like the surface that they continue.

    Ring by ring, at most `RINGS`, each takes the class of the named one of its 8 neighbours that is nearest in height,
    the first of equal ones, if it is less than `STEP_M` higher or lower.

    Args:
        label: int16 [rows, cols], 0 = none.
        height_m: float32 [rows, cols], NaN = never seen.
        unsegmented: bool [rows, cols].

    Returns:
        int16 [rows, cols].
    """
    named = np.where(unsegmented, 0, label).astype(np.int16)
    for _ in range(RINGS):
        further = _next_ring(named, height_m, unsegmented)
        if np.array_equal(further, named):
            break
        named = further
    return named


@njit(cache=True, nogil=True)
def _next_ring(
    named: NDArray,  # int16 [rows, cols]
    height_m: NDArray,  # float32 [rows, cols], NaN = never seen
    unsegmented: NDArray,  # bool [rows, cols]
) -> NDArray:
    """Return the labels after one more ring of cells was named."""
    rows, cols = named.shape
    further = named.copy()
    for row in range(rows):
        for col in range(cols):
            if not unsegmented[row, col] or named[row, col] > 0:
                continue
            nearest = np.float32(STEP_M)
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                for c in range(max(col - 1, 0), min(col + 2, cols)):
                    apart = abs(height_m[r, c] - height_m[row, col])
                    if named[r, c] > 0 and apart < nearest:  # NaN is not less
                        nearest = apart
                        further[row, col] = named[r, c]
    return further


def _standing(label: NDArray, top: NDArray, grid: Grid, floor_m: float) -> NDArray:
    """Return which thing classes have most of their cells higher than the floor, bool [labels]."""
    seen = top > -np.inf
    cells = np.bincount(label[seen], minlength=len(grid.labels))
    low = np.bincount(label[seen & (top < floor_m)], minlength=len(grid.labels))
    return np.array(grid.is_thing) & (2 * low < cells)


def _gather_votes(
    grid: Grid, readings: AllReadings, settings: VoteSettings
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Sum up the votes of every cell by class, batch by batch: memory follows the map, not the frames.

    The classes of a cell form a linked list. np.unique over (cell, class) with np.add.at gives the same sums, but has
    to sort the readings: 413 ms in place of 71 for the 1.2 million of a flat, and it would hold all batches.

    Returns:
        Entries, those of one cell and one class each: the next entry of the same cell int32 (0 = none), class int16,
        votes float32, readings int32 [`DEPTHS`] by depth below the top, [1] where no errors are learned. Entry c is the
        first of cell c, in the order in which the classes were met; it has no readings when the cell has none.
    """
    top = grid.height_m.reshape(-1)
    named = np.where(np.array(grid.is_thing), 1.0, settings.stuff)
    size, depths = top.size, DEPTHS if settings.rounds > 0 else 1  # nothing else asks how deep readings lie
    entries = _room_for(size + max(size // 4, 1024), depths)
    for part in readings.batches():
        weight = part.score if settings.scores else (part.label > 0).astype(np.float32)
        weight = np.where(part.label > 0, weight * named[part.label], settings.nothing).astype(np.float32)
        done = 0
        while True:
            size, done = _tally(
                part.cell, part.height_m, part.label, weight, top, np.float32(settings.window_m),
                entries[0], entries[1], entries[2], entries[3], size, done,
            )  # fmt: skip
            if done == len(part):
                break
            larger = _room_for(size * 3 // 2, depths)
            for old, new in zip(entries, larger, strict=True):
                new[:size] = old[:size]
            entries = larger
    following, label, votes, by_depth = entries
    return following, label, votes, by_depth


def _room_for(entries: int, depths: int) -> tuple[NDArray, ...]:
    """Return room for entries; what is not used yet takes no memory."""
    by_depth = np.zeros((entries, depths), np.int32)
    return *(np.zeros(entries, dtype) for dtype in (np.int32, np.int16, np.float32)), by_depth


@njit(cache=True, nogil=True)
def _tally(
    cell: NDArray,  # int32 [v], of each reading
    height_m: NDArray,  # float32 [v]
    label_of: NDArray,  # int16 [v]
    weight_of: NDArray,  # float32 [v]
    top: NDArray,  # float32 [cells]
    window_m: np.float32,
    following: NDArray,  # in/out int32 [room], next entry of the same cell, 0 = none
    label: NDArray,  # in/out int16 [room]
    votes: NDArray,  # in/out float32 [room]
    by_depth: NDArray,  # in/out int32 [room, depths], how many
    size: int,
    done: int,
) -> tuple[int, int]:
    """Add readings from ``done`` on to the entries of their cells; stop where the room ends.

    Returns the number of entries, and of the readings done so far.
    """
    for i in range(done, len(cell)):
        at = cell[i]
        # What lies well below the cell's top is another surface.
        if not height_m[i] > top[at] - window_m:
            continue
        # Follow the cell's list to the entry of this class; the first entry of a cell has the cell's own number.
        if not by_depth[at].any():
            label[at] = label_of[i]
        while label[at] != label_of[i] and following[at] > 0:
            at = following[at]
        # A class that the cell has not met goes to the end of its list.
        if label[at] != label_of[i]:
            if size == len(label):
                return size, i
            following[at] = size
            at = size
            label[at] = label_of[i]
            size += 1
        votes[at] += weight_of[i]
        depth = depth_of(top[cell[i]] - height_m[i]) if by_depth.shape[1] > 1 else 0
        by_depth[at, depth] += 1
    return size, len(cell)


@njit(cache=True, nogil=True)
def _disagreement(
    following: NDArray,  # int32 [entries]
    counts: NDArray,  # int32 [entries]
    cells: int,
) -> float:
    """Return the share of readings that disagree with the most frequent class of their cell."""
    total = most = 0
    for c in range(cells):
        all_of_cell = best = counts[c]
        at = following[c]
        while at > 0:
            all_of_cell += counts[at]
            best = max(best, counts[at])
            at = following[at]
        if all_of_cell >= 3:
            total += all_of_cell
            most += best
    return 1.0 - most / total if total else 0.0


@njit(cache=True, nogil=True)
def _elect(  # noqa: C901, PLR0912 - one loop over shared arrays
    following: NDArray,  # int32 [entries]
    label: NDArray,  # int16 [entries]
    votes: NDArray,  # float32 [entries]
    counts: NDArray,  # int32 [entries]
    top: NDArray,  # float32 [cells], -inf = never seen
    rows: int,
    cols: int,
    neighbours: float,
    scale: float,
    standing: NDArray,  # bool [labels], classes that do not lie on the floor
    floor_m: float,
) -> NDArray:
    """Let every cell's own and borrowed votes choose its class; ties go to the class met first, its own before."""
    named = np.zeros(rows * cols, dtype=np.int16)
    candidate = np.zeros(_CANDIDATES, dtype=np.int16)
    weight = np.zeros(_CANDIDATES, dtype=np.float64)
    for row in range(rows):
        for col in range(cols):
            c = row * cols + col
            if counts[c] == 0:
                continue
            n = 0
            for step in range(9):  # the cell itself first
                dr, dc = (step + 4) % 9 // 3 - 1, (step + 4) % 9 % 3 - 1
                if row + dr < 0 or row + dr >= rows or col + dc < 0 or col + dc >= cols:
                    continue
                other = c + dr * cols + dc
                # How much this neighbour lends: less across a step in height, and less over a corner.
                share = 1.0
                if step > 0:
                    if neighbours <= 0.0 or counts[other] == 0:
                        continue
                    share = neighbours * np.exp(-abs(top[other] - top[c]) / scale)
                    if dr != 0 and dc != 0:
                        share *= 0.7
                # Add its votes, class by class.
                after = other
                while after >= 0:
                    k, after = after, (following[after] if following[after] > 0 else -1)
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
            # The heaviest class wins; the first of equal ones.
            best = 0
            for at in range(1, n):
                if weight[at] > weight[best]:
                    best = at
            named[c] = candidate[best]
    return named
