"""The class of a cell by all frames that saw its top, not by the single highest pixel; and what masks get wrong.

One frame is one vote of a cell: the segment of its highest pixel there. It counts when that pixel lies near the cell's
top, with the segment's confidence as weight; a frame that saw nothing there is a weak vote, because detectors miss more
than they invent. Cells lend their votes to neighbours of about the same height, because mask borders wander.

Exact masks need none of this, and there the highest pixel knows thin things best. The votes themselves show it: where
readings of one cell hardly ever disagree, masks are exact.

Constants do not suit every network, though, and the votes are only where the rest begins. No constant says how often a
network misses a plant or takes a cup for the table below it; the readings of a map do. As
Dawid and Skene (1979) did for patients seen by several doctors, two steps take turns: the classes of the cells say how
often each class was read as which other, and how often that happens says how likely each class of a cell is. A cell's
height speaks for its class, too (floors are low), and so do its neighbours, as much as neighbours with such a step
between them were found to agree. All of these tables are counted on the map itself. Where a network has no class for
floor, walls and half of the things, all of them are *nothing*; so that is three classes, by the height of the cell.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.mapping.observations import AllReadings
from simaps_viz.structures import Grid

DEPTH_EDGES_M = (0.005, 0.015, 0.03)
"""Readings so far below the top of their cell are counted apart: the nearer, the surer they show what lies on top."""
DEPTHS = len(DEPTH_EDGES_M) + 1
_TRUST = np.array([1.0, 1.0, 0.7, 0.1])
"""How much a reading of each depth counts: well below the top it may be of another surface."""
_NOTHING_EDGES_M = (0.1, 1.0)
"""*Nothing* is a class of its own below, between and above these heights of a cell: floor is taken for other things
than walls are, and than things that the network has no word for."""
_KINDS = len(_NOTHING_EDGES_M) + 1
_STEP_EDGES_M = np.array([0.003, 0.006, 0.01, 0.015, 0.02, 0.03, 0.05, 0.1, 0.3], dtype=np.float32)
"""Steps between neighbours are counted apart at these."""
_AROUND = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Half of a cell's eight neighbours; the others have it as one of these."""
_HEIGHT_M = 0.05
_IMAGINED = 10.0
"""Readings, or cells, that a class is imagined to have had like all others, before its own are counted."""
_FIELD = 0.3
"""Share of what neighbours say that is new: each has heard the others, and the cell itself."""
_ALONE = 1
"""Rounds before neighbours are heard: where all cells of a thing are misnamed, each would keep the others so."""
_UNLIKELY = 1e-3
"""What a neighbour is less likely than this, it does not speak for."""
_SUREST = 0.999


def learn_classes(
    named: NDArray, readings: tuple[NDArray, NDArray, NDArray], top: NDArray, standing: NDArray, floor_m: float,
    rounds: int,
) -> NDArray:  # fmt: skip
    """Name every cell by what the masks of this map are found to get wrong.

    Args:
        named: int16 [rows, cols], classes to begin with.
        readings: entries of cells and classes as `votes` gathers them: the next entry of the cell int32 (0 = none),
            class int16, and int32 [entries, `DEPTHS`] how many readings.
        top: float32 [rows, cols], -inf = never seen.
        standing: bool [labels], classes that get no cell lower than ``floor_m``.
        floor_m: see ``standing``.
        rounds: how often errors and classes are found anew.

    Returns:
        int16 [rows, cols], 0 = none; a class is one that a frame read in the cell, or that the cell or a neighbour had.
    """
    following, label, counts = readings
    read = np.any(counts[: named.size], axis=1).reshape(top.shape)
    used = np.zeros(len(standing), dtype=np.bool_)
    used[label[counts.any(axis=1)]] = True
    used[named] = True
    used[0] = True
    index = (np.cumsum(used) - 1).astype(np.int16)  # of the classes of this map: tables grow with their square
    classes = np.flatnonzero(used).astype(np.int16)
    label = index[label]
    kind = np.digitize(top, _NOTHING_EDGES_M).astype(np.int16)
    first, candidate = _candidates(index[named], following, label, read, kind, top < floor_m, standing[classes])
    share = np.zeros(len(candidate))
    share[first[:-1][first[1:] > first[:-1]]] = 1.0  # the class to begin with comes first
    seen = top > -np.inf
    level = np.floor(np.where(seen, top, 0.0).astype(np.float64) / _HEIGHT_M).astype(np.int32)
    level -= level.min(initial=0)
    levels = int(level.max(initial=0)) + 1
    steps = _steps(first, top)
    for done in range(rounds):
        field = _FIELD if done >= _ALONE else 0.0
        tables = _tables(*_count(first, candidate, share, following, label, counts, steps, level, levels, len(classes)))
        share = _weigh(first, candidate, share, following, label, counts, steps, level, *tables, field)
    return _likeliest(named, first, classes[np.maximum(candidate - _KINDS + 1, 0)], share)


@njit(cache=True, nogil=True)
def depth_of(below_m: float) -> int:
    """Return the position, 0 to `DEPTHS` - 1, of a reading that lies so far below the top of its cell."""
    at = 0
    while at < DEPTHS - 1 and below_m >= DEPTH_EDGES_M[at]:
        at += 1
    return at


@njit(cache=True, nogil=True)
def _shown_as(one: int) -> int:
    """Return the class as which right masks show a candidate; see `_candidates`."""
    return max(one - _KINDS + 1, 0)


@njit(cache=True, nogil=True)
def _steps(first: NDArray, top: NDArray) -> NDArray:
    """Return the place of the step to each neighbour of `_AROUND` among those counted apart; -1 where none is read.

    Args:
        first: int64 [cells + 1], where the list of each cell begins.
        top: float32 [rows, cols].

    Returns:
        int8 [cells, 4].
    """
    rows, cols = top.shape
    steps = np.full((rows * cols, len(_AROUND)), -1, dtype=np.int8)
    for row in range(rows):
        for col in range(cols):
            c = row * cols + col
            if first[c] == first[c + 1]:
                continue
            for d in range(len(_AROUND)):
                r, k = row + _AROUND[d][0], col + _AROUND[d][1]
                if r >= rows or not 0 <= k < cols or first[r * cols + k] == first[r * cols + k + 1]:
                    continue
                step = abs(top[row, col] - top[r, k])
                at = 0
                while at < len(_STEP_EDGES_M) and step >= _STEP_EDGES_M[at]:
                    at += 1
                steps[c, d] = at
    return steps


@njit(cache=True, nogil=True)
def _candidates(
    named: NDArray,  # int16 [rows, cols]
    following: NDArray,  # int32 [entries]
    label: NDArray,  # int16 [entries]
    read: NDArray,  # bool [rows, cols], there are readings
    kind: NDArray,  # int16 [rows, cols], of nothing there
    low: NDArray,  # bool [rows, cols]
    standing: NDArray,  # bool [classes], those that no low cell may have
) -> tuple[NDArray, NDArray]:
    """List the classes that each cell may have: its own, those it was read as, and its neighbours'.

    Returns:
        int64 [cells + 1], where the list of each cell begins, and the lists int16; empty where there are no readings.
        In these the kinds of *nothing* come first, and all other classes `_KINDS` - 1 later than in ``label``.
    """
    rows, cols = named.shape
    first = np.zeros(rows * cols + 1, dtype=np.int64)
    listed = np.zeros(max(rows * cols, 16), dtype=np.int16)
    size = 0
    for row in range(rows):
        for col in range(cols):
            c = row * cols + col
            first[c] = begin = size
            if not read[row, col]:
                continue
            if size + 8 + len(standing) + 1 > len(listed):
                longer = np.zeros(2 * len(listed) + 8 + len(standing) + 1, dtype=np.int16)
                longer[:size] = listed[:size]
                listed = longer
            of_nothing = kind[row, col]
            listed[size] = named[row, col] + _KINDS - 1 if named[row, col] > 0 else of_nothing
            size += 1
            after = c
            while after >= 0:
                size = _add(label[after], of_nothing, listed, begin, size, standing, low[row, col])
                after = following[after] if following[after] > 0 else -1
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                for k in range(max(col - 1, 0), min(col + 2, cols)):
                    if read[r, k]:
                        size = _add(named[r, k], of_nothing, listed, begin, size, standing, low[row, col])
    first[rows * cols] = size
    return first, listed[:size].copy()


@njit(cache=True, nogil=True)
def _add(
    label: int,
    of_nothing: int,
    listed: NDArray,  # in/out int16
    begin: int,
    size: int,
    standing: NDArray,  # bool [classes]
    low: bool,
) -> int:
    """Add a class to the list that begins there, once, unless it stands and the cell is low; return the new size."""
    if low and standing[label]:
        return size
    one = label + _KINDS - 1 if label > 0 else of_nothing
    for k in range(begin, size):
        if listed[k] == one:
            return size
    listed[size] = one
    return size + 1


@njit(cache=True, nogil=True)
def _count(  # noqa: C901 - one loop over shared arrays
    first: NDArray,  # int64 [cells + 1]
    candidate: NDArray,  # int16 [n]
    share: NDArray,  # float64 [n], how likely
    following: NDArray,  # int32 [entries]
    label: NDArray,  # int16 [entries]
    counts: NDArray,  # int32 [entries, depths]
    steps: NDArray,  # int8 [cells, 4]
    level: NDArray,  # int32 [rows, cols]
    levels: int,
    classes: int,
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Count what was read, at which height, and beside what, each as likely as it is.

    Returns:
        float64 [depths, read as, class]; float64 [levels, class]; and of neighbours side by side and across a corner,
        float64 [2, steps], those of one class and all.
    """
    rows, cols = level.shape
    read = np.zeros((DEPTHS, classes, classes + _KINDS - 1))
    heights = np.zeros((levels, classes + _KINDS - 1))
    alike, pairs = np.zeros((2, len(_STEP_EDGES_M) + 1)), np.zeros((2, len(_STEP_EDGES_M) + 1))
    for row in range(rows):
        for col in range(cols):
            c = row * cols + col
            if first[c] == first[c + 1]:
                continue
            for k in range(first[c], first[c + 1]):
                if share[k] == 0.0:
                    continue
                heights[level[row, col], candidate[k]] += share[k]
                after = c
                while after >= 0:
                    for depth in range(DEPTHS):
                        read[depth, label[after], candidate[k]] += share[k] * counts[after, depth]
                    after = following[after] if following[after] > 0 else -1
            for d in range(len(_AROUND)):
                at = steps[c, d]
                if at < 0:
                    continue
                other = c + _AROUND[d][0] * cols + _AROUND[d][1]
                across = 1 if d > 1 else 0
                pairs[across, at] += 1.0
                for k in range(first[c], first[c + 1]):
                    for j in range(first[other], first[other + 1]):
                        if candidate[j] == candidate[k]:
                            alike[across, at] += share[k] * share[j]
    return read, heights, alike, pairs


@njit(cache=True, nogil=True)
def _tables(  # noqa: C901 - four tables, each of a few sums
    read: NDArray,  # float64 [depths, read as, class]
    heights: NDArray,  # float64 [levels, class]
    alike: NDArray,  # float64 [2, steps]
    pairs: NDArray,  # float64 [2, steps]
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Turn counts into probabilities; classes with few of them lean on what all have in common.

    Returns:
        float64 [depths, read as, class], log of P(read as | class); float64 [levels, class], log of P(class, level);
        float64 [class], P(class); float64 [2, steps], odds that neighbours are of one class for that reason.
    """
    # What each class is read as, at each depth. A class with few readings leans on how often all masks are right.
    depths, labels, classes = read.shape
    log_read = np.zeros_like(read)
    for depth in range(depths):
        total = right = 0.0
        of_class, as_label = np.zeros(classes), np.zeros(labels)
        for one in range(labels):
            for other in range(classes):
                total += read[depth, one, other]
                right += read[depth, one, other] if one == _shown_as(other) else 0.0
                as_label[one] += read[depth, one, other]
                of_class[other] += read[depth, one, other]
        agree = (right + 1.0) / (total + 2.0)
        for one in range(labels):
            often = (as_label[one] + 0.5) / (total + 0.5 * labels)
            for other in range(classes):
                usual = (1.0 - agree) * often + (agree if one == _shown_as(other) else 0.0)
                log_read[depth, one, other] = math.log(
                    (read[depth, one, other] + _IMAGINED * usual) / (of_class[other] + _IMAGINED)
                )
    # How frequent each class is, and at which heights it lies. A rare class leans on the heights of all cells.
    levels = len(heights)
    of_class, at_level, cells = np.zeros(classes), np.zeros(levels), 0.0
    for at in range(levels):
        for one in range(classes):
            of_class[one] += heights[at, one]
            at_level[at] += heights[at, one]
            cells += heights[at, one]
    share, log_level, by_chance = np.zeros(classes), np.zeros_like(heights), 0.0
    for one in range(classes):
        share[one] = (of_class[one] + 0.5) / (cells + 0.5 * classes)
        by_chance += share[one] * share[one]
    for at in range(levels):
        usual = (at_level[at] + 0.5) / (cells + 0.5 * levels)
        for one in range(classes):
            likely = (heights[at, one] + _IMAGINED * usual) / (of_class[one] + _IMAGINED)
            log_level[at, one] = math.log(share[one] * likely)
    # How often neighbours are of one class beyond chance, for each step in height between them.
    odds = np.zeros_like(alike)
    for across in range(2):
        for at in range(alike.shape[1]):
            same = ((alike[across, at] + 1.0) / (pairs[across, at] + 2.0) - by_chance) / (1.0 - by_chance + 1e-12)
            same = min(max(same, 0.0), _SUREST)
            odds[across, at] = same / (1.0 - same)
    return log_read, log_level, share, odds


@njit(cache=True, nogil=True)
def _weigh(  # noqa: C901, PLR0912 - one loop over shared arrays
    first: NDArray,  # int64 [cells + 1]
    candidate: NDArray,  # int16 [n]
    share: NDArray,  # float64 [n]
    following: NDArray,  # int32 [entries]
    label: NDArray,  # int16 [entries]
    counts: NDArray,  # int32 [entries, depths]
    steps: NDArray,  # int8 [cells, 4]
    level: NDArray,  # int32 [rows, cols]
    log_read: NDArray,  # float64 [depths, read as, class]
    log_level: NDArray,  # float64 [levels, class]
    share_of_class: NDArray,  # float64 [class]
    odds: NDArray,  # float64 [2, steps]
    field: float,
) -> NDArray:
    """Return how likely each candidate of each cell is, by its readings, its height and its neighbours; float64 [n]."""
    rows, cols = level.shape
    found = np.zeros_like(share)
    odds_of = np.ones(len(share_of_class))
    for row in range(rows):
        for col in range(cols):
            c = row * cols + col
            begin, end = first[c], first[c + 1]
            if begin == end:
                continue
            # Its height and its readings.
            for k in range(begin, end):
                one = candidate[k]
                found[k] = log_level[level[row, col], one]
                after = c
                while after >= 0:
                    for depth in range(DEPTHS):
                        if counts[after, depth] > 0:
                            found[k] += _TRUST[depth] * counts[after, depth] * log_read[depth, label[after], one]
                    after = following[after] if following[after] > 0 else -1
            # Each neighbour is of the same class for a reason, or of any. One logarithm is taken of all.
            odds_of[: end - begin] = 1.0
            for d in range(len(_AROUND) if field > 0.0 else 0):
                ahead = _AROUND[d][0] * cols + _AROUND[d][1]
                for start in (c, c - ahead):  # the step to the neighbour ahead, and that of the one behind to here
                    at = steps[start, d] if start >= 0 else -1
                    if at < 0:
                        continue
                    other = start + ahead if start == c else start
                    alike = odds[1 if d > 1 else 0, at]
                    for j in range(first[other], first[other + 1]):
                        if share[j] < _UNLIKELY:
                            continue
                        for k in range(begin, end):
                            if candidate[k] == candidate[j]:
                                odds_of[k - begin] *= 1.0 + alike * share[j] / share_of_class[candidate[k]]
            for k in range(begin, end):
                found[k] += field * math.log(odds_of[k - begin])
            # Logarithms to shares.
            most, total = found[begin], 0.0
            for k in range(begin, end):
                most = max(most, found[k])
            for k in range(begin, end):
                found[k] = math.exp(found[k] - most)
                total += found[k]
            for k in range(begin, end):
                found[k] /= total
    return found


@njit(cache=True, nogil=True)
def _likeliest(
    named: NDArray,  # int16 [rows, cols]
    first: NDArray,  # int64 [cells + 1]
    candidate: NDArray,  # int16 [n], as `named`
    share: NDArray,  # float64 [n]
) -> NDArray:
    """Return the likeliest class of every cell, the first of equal ones; int16 [rows, cols]."""
    found = named.copy()
    rows, cols = named.shape
    for row in range(rows):
        for col in range(cols):
            c = row * cols + col
            most = 0.0
            for k in range(first[c], first[c + 1]):
                if share[k] > most:
                    most = share[k]
                    found[row, col] = candidate[k]
    return found


_CANDIDATES = 32  # classes that can compete for one cell; more are left out

SPREAD = ((0.01, 8), (0.03, 8), (0.1, 2), (np.inf, 1))
"""A surface that only frames without masks have seen goes on while its cells differ by less than so many metres in
height, for at most so many cells: first those that surely go on, and in the end the borders, where depth is noisy."""


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

    Ring by ring, each takes the class of the named one of its 8 neighbours that is nearest in height, the first of
    equal ones, as long as they are as near as `SPREAD` asks.

    Args:
        label: int16 [rows, cols], 0 = none.
        height_m: float32 [rows, cols], NaN = never seen.
        unsegmented: bool [rows, cols].

    Returns:
        int16 [rows, cols].
    """
    named = np.where(unsegmented, 0, label).astype(np.int16)
    for step_m, rings in SPREAD:
        for _ in range(rings):
            further = _next_ring(named, height_m, unsegmented, np.float32(step_m))
            if np.array_equal(further, named):
                break
            named = further
    return named


@njit(cache=True, nogil=True)
def _next_ring(
    named: NDArray,  # int16 [rows, cols]
    height_m: NDArray,  # float32 [rows, cols], NaN = never seen
    unsegmented: NDArray,  # bool [rows, cols]
    step_m: np.float32,
) -> NDArray:
    """Return the labels after one more ring of cells was named."""
    rows, cols = named.shape
    further = named.copy()
    for row in range(rows):
        for col in range(cols):
            if not unsegmented[row, col] or named[row, col] > 0:
                continue
            nearest = step_m
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
