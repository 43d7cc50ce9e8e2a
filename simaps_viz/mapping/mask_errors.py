"""What masks get wrong, learned from a map's own readings, and the classes that follow from it.

No constant says how often a network misses a plant or takes a cup for the table below it; the readings of a map do. As
Dawid and Skene (1979) did for patients seen by several doctors, two steps take turns: the classes of the cells say how
often each class was read as which other, and how often that happens says how likely each class of a cell is. A cell's
height speaks for its class, too (floors are low), and so do its neighbours, as much as neighbours with such a step
between them were found to agree. All of these tables are counted on the map itself. Where a network has no class for
floor, walls and half of the things, all of them are *nothing*; so that is three classes, by the height of the cell.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

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
    for done in range(rounds):
        field = _FIELD if done >= _ALONE else 0.0
        tables = _tables(*_count(first, candidate, share, following, label, counts, top, level, levels, len(classes)))
        share = _weigh(first, candidate, share, following, label, counts, top, level, *tables, field)
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
def _step_between(one: float, other: float) -> int:
    """Return the position of the step between two tops among those that are counted apart."""
    step = abs(one - other)
    at = 0
    while at < len(_STEP_EDGES_M) and step >= _STEP_EDGES_M[at]:
        at += 1
    return at


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
def _count(  # noqa: C901, PLR0912 - one loop over shared arrays
    first: NDArray,  # int64 [cells + 1]
    candidate: NDArray,  # int16 [n]
    share: NDArray,  # float64 [n], how likely
    following: NDArray,  # int32 [entries]
    label: NDArray,  # int16 [entries]
    counts: NDArray,  # int32 [entries, depths]
    top: NDArray,  # float32 [rows, cols]
    level: NDArray,  # int32 [rows, cols]
    levels: int,
    classes: int,
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Count what was read, at which height, and beside what, each as likely as it is.

    Returns:
        float64 [depths, read as, class]; float64 [levels, class]; and of neighbours side by side and across a corner,
        float64 [2, steps], those of one class and all.
    """
    rows, cols = top.shape
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
            for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
                if row + dr >= rows or col + dc >= cols or col + dc < 0:
                    continue
                other = c + dr * cols + dc
                if first[other] == first[other + 1]:
                    continue
                across = 1 if dr * dc != 0 else 0
                at = _step_between(top[row, col], top[row + dr, col + dc])
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
    top: NDArray,  # float32 [rows, cols]
    level: NDArray,  # int32 [rows, cols]
    log_read: NDArray,  # float64 [depths, read as, class]
    log_level: NDArray,  # float64 [levels, class]
    share_of_class: NDArray,  # float64 [class]
    odds: NDArray,  # float64 [2, steps]
    field: float,
) -> NDArray:
    """Return how likely each candidate of each cell is, by its readings, its height and its neighbours; float64 [n]."""
    rows, cols = top.shape
    found = np.zeros_like(share)
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
            # Each neighbour is of the same class for a reason, or of any.
            for dr in range(-1, 2):
                for dc in range(-1, 2):
                    if (dr == 0 and dc == 0) or not (0 <= row + dr < rows and 0 <= col + dc < cols):
                        continue
                    other = c + dr * cols + dc
                    if first[other] == first[other + 1]:
                        continue
                    alike = odds[1 if dr * dc != 0 else 0, _step_between(top[row, col], top[row + dr, col + dc])]
                    for j in range(first[other], first[other + 1]):
                        if share[j] < _UNLIKELY:
                            continue
                        for k in range(begin, end):
                            if candidate[k] == candidate[j]:
                                found[k] += field * math.log(1.0 + alike * share[j] / share_of_class[candidate[k]])
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
