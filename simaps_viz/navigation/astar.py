"""A* over grid cells and the line-of-sight test, compiled.

Steps go to the 8 neighbours and cost 1 or sqrt(2) cells; a diagonal step needs both cells beside it free, so no corner
is cut. The heuristic is the octile distance to the bounding box of the goal cells: it never overestimates and never
drops by more than a step costs, so a cell is final when it leaves the heap (Hart, Nilsson and Raphael, 1968).
Among equal estimates the smaller cell number leaves the heap first, so the answer does not depend on chance.
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray

_SQRT2 = math.sqrt(2.0)


@numba.njit(cache=True)
def _before(keys: NDArray, cells: NDArray, a: int, b: int) -> bool:
    return keys[a] < keys[b] or (keys[a] == keys[b] and cells[a] < cells[b])


@numba.njit(cache=True)
def _push(keys: NDArray, cells: NDArray, size: int, key: float, cell: int) -> int:
    """Add to the binary heap; gives its new size."""
    i = size
    keys[i], cells[i] = key, cell
    while i > 0:
        parent = (i - 1) >> 1
        if not _before(keys, cells, i, parent):
            break
        keys[i], keys[parent] = keys[parent], keys[i]
        cells[i], cells[parent] = cells[parent], cells[i]
        i = parent
    return size + 1


@numba.njit(cache=True)
def _pop(keys: NDArray, cells: NDArray, size: int) -> int:
    """Take the first off the binary heap (the caller has read it); gives its new size."""
    size -= 1
    keys[0], cells[0] = keys[size], cells[size]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= size:
            break
        if child + 1 < size and _before(keys, cells, child + 1, child):
            child += 1
        if not _before(keys, cells, child, i):
            break
        keys[i], keys[child] = keys[child], keys[i]
        cells[i], cells[child] = cells[child], cells[i]
        i = child
    return size


@numba.njit(cache=True)
def _octile_to_box(row: int, col: int, box: NDArray) -> float:
    dr = max(box[0] - row, 0, row - box[1])
    dc = max(box[2] - col, 0, col - box[3])
    return max(dr, dc) + (_SQRT2 - 1.0) * min(dr, dc)


@numba.njit(cache=True)
def search(free: NDArray, start: tuple[int, int], goal: NDArray, box: NDArray) -> tuple[NDArray, float]:
    """Find a cheapest way from a cell to the nearest of the goal cells.

    Args:
        free: bool [rows, cols].
        start: (row, col), a free cell.
        goal: bool [rows, cols].
        box: int64 [4], (first row, last row, first col, last col) of the goal cells.

    Returns:
        int64 [n, 2] cells from start to goal, and the cost in cells; empty and infinity when there is no way.
    """
    rows, cols = free.shape
    cost = np.full(rows * cols, np.inf)
    parent = np.full(rows * cols, -1, np.int32)
    closed = np.zeros(rows * cols, np.bool_)
    keys = np.zeros(1024)
    cells = np.zeros(1024, np.int64)
    cost[start[0] * cols + start[1]] = 0.0
    size = _push(keys, cells, 0, _octile_to_box(start[0], start[1], box), start[0] * cols + start[1])
    while size > 0:
        here = cells[0]
        size = _pop(keys, cells, size)
        if closed[here]:
            continue
        closed[here] = True
        row, col = here // cols, here % cols
        if goal[row, col]:
            return _way_back(parent, here, cols), float(cost[here])
        if size + 8 > len(keys):
            keys = np.concatenate((keys, np.zeros_like(keys)))
            cells = np.concatenate((cells, np.zeros_like(cells)))
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                r, c = row + dr, col + dc
                if (dr == 0 and dc == 0) or r < 0 or c < 0 or r >= rows or c >= cols or not free[r, c]:
                    continue
                if dr != 0 and dc != 0 and not (free[row, c] and free[r, col]):
                    continue
                there = r * cols + c
                along = cost[here] + (_SQRT2 if dr != 0 and dc != 0 else 1.0)
                if not closed[there] and along < cost[there]:
                    cost[there] = along
                    parent[there] = here
                    size = _push(keys, cells, size, along + _octile_to_box(r, c, box), there)
    return np.zeros((0, 2), np.int64), np.inf


@numba.njit(cache=True)
def _way_back(parent: NDArray, goal: int, cols: int) -> NDArray:
    n, cell = 0, goal
    while cell >= 0:
        n += 1
        cell = parent[cell]
    way = np.zeros((n, 2), np.int64)
    cell = goal
    for i in range(n - 1, -1, -1):
        way[i, 0], way[i, 1] = cell // cols, cell % cols
        cell = parent[cell]
    return way


@numba.njit(cache=True)
def clear_length(free: NDArray, x0: float, y0: float, x1: float, y1: float) -> float:
    """Give the share (0 to 1) of a segment before it first enters a cell that is not free; 1 = the whole is clear.

    Every cell the segment passes through counts; where it passes exactly through a corner, the two cells beside it
    count as well. Coordinates are in cells: cell (row, col) covers x in [col, col + 1), y in [row, row + 1).
    """
    rows, cols = free.shape
    row, col = math.floor(y0), math.floor(x0)
    last_row, last_col = math.floor(y1), math.floor(x1)
    dx, dy = x1 - x0, y1 - y0
    step_c, step_r = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    t_c = ((col + (step_c > 0)) - x0) / dx if dx != 0 else np.inf
    t_r = ((row + (step_r > 0)) - y0) / dy if dy != 0 else np.inf
    entered = 0.0
    for _ in range(abs(last_row - row) + abs(last_col - col) + 2):
        if row < 0 or col < 0 or row >= rows or col >= cols or not free[row, col]:
            return entered
        if row == last_row and col == last_col:
            return 1.0
        if abs(t_c - t_r) < 1e-9:
            beside = 0 <= row + step_r < rows and 0 <= col + step_c < cols
            if not beside or not free[row + step_r, col] or not free[row, col + step_c]:
                return min(t_c, 1.0)
            row, col, entered = row + step_r, col + step_c, t_c
            t_c, t_r = t_c + abs(1.0 / dx), t_r + abs(1.0 / dy)
        elif t_c < t_r:
            col, entered, t_c = col + step_c, t_c, t_c + abs(1.0 / dx)
        else:
            row, entered, t_r = row + step_r, t_r, t_r + abs(1.0 / dy)
    return 1.0


@numba.njit(cache=True)
def pull_straight(free: NDArray, points: NDArray) -> NDArray:
    """Drop the points of a way that a clear straight line can skip; float64 [n, 2] (x, y) in cells, both ends stay."""
    keep = np.zeros(len(points), np.bool_)
    keep[0] = keep[-1] = True
    anchor = 0
    for i in range(1, len(points) - 1):
        if not _is_clear(free, points, anchor, i + 1):
            keep[i] = True
            anchor = i
    kept = np.flatnonzero(keep)
    shorter = [kept[0]]
    at = 0
    while at < len(kept) - 1:  # the first pass stops at every hidden point, even if a later one is in sight
        ahead = len(kept) - 1
        while ahead > at + 1 and not _is_clear(free, points, kept[at], kept[ahead]):
            ahead -= 1
        at = ahead
        shorter.append(kept[at])
    return points[np.array(shorter)]


@numba.njit(cache=True)
def _is_clear(free: NDArray, points: NDArray, a: int, b: int) -> bool:
    return clear_length(free, points[a, 0], points[a, 1], points[b, 0], points[b, 1]) >= 1.0
