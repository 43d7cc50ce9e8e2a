"""A* over grid cells and the line-of-sight test, compiled.

Steps go to the 8 neighbours and cost 1 or sqrt(2) cells; a diagonal step needs both cells beside it free, so no corner
is cut. The heuristic is the octile distance to the bounding box of the goal cells: it never overestimates and never
drops by more than a step costs, so a cell is final when it leaves the heap (Hart, Nilsson and Raphael, 1968).
Among equal estimates the smaller cell number leaves the heap first, so the answer does not depend on chance.

Only *jump points* enter the heap: of all equally short paths the search follows the one that goes diagonally first, and
such a path turns only beside the end of an obstacle (Harabor and Grastien, 2011; without cutting corners: 2012).
"""

import math
from heapq import heappop, heappush

import numba
import numpy as np
from numpy.typing import NDArray

EAST, WEST, NORTH, SOUTH = 0, 1, 2, 3
"""The last index of the table; east is the next column, north the next row."""


@numba.njit(cache=True)
def straight_jumps(free: NDArray) -> NDArray:
    """Compute the table of straight jumps.

    Args:
        free: bool [rows, cols].

    Returns:
        int32 [rows, cols, 4]: a number n > 0 when the next jump point is n cells away; -n when there is none on the
        n free cells before the next obstacle or the map's edge. 0 for cells that are not free.
    """
    rows, cols = free.shape
    jumps = np.zeros((rows, cols, 4), np.int32)
    for i in range(rows):
        row, back = i, rows - 1 - i
        for j in range(cols):
            col, left = j, cols - 1 - j
            # Each direction runs against its own sense, so that the next cell is always known.
            _extend(jumps, free, row, left, 0, 1, EAST)
            _extend(jumps, free, row, col, 0, -1, WEST)
            _extend(jumps, free, back, col, 1, 0, NORTH)
            _extend(jumps, free, row, col, -1, 0, SOUTH)
    return jumps


@numba.njit(cache=True)
def _extend(jumps: NDArray, free: NDArray, row: int, col: int, dr: int, dc: int, side: int) -> None:
    """Fill in one cell of the table from the next cell in that direction, which is filled in already."""
    rows, cols = free.shape
    r, c = row + dr, col + dc
    if not free[row, col] or r < 0 or c < 0 or r >= rows or c >= cols or not free[r, c]:
        return
    if _obstacle_ends(free, r, c, dr, dc, 1) or _obstacle_ends(free, r, c, dr, dc, -1):
        jumps[row, col, side] = 1
    else:
        beyond = jumps[r, c, side]
        jumps[row, col, side] = beyond + 1 if beyond > 0 else beyond - 1


@numba.njit(cache=True)
def _obstacle_ends(free: NDArray, row: int, col: int, dr: int, dc: int, hand: int) -> bool:
    """Whether, at a cell come to in a direction, the cell on one hand is free but the one before that was not."""
    r, c = row + hand * dc, col + hand * dr
    return 0 <= r < free.shape[0] and 0 <= c < free.shape[1] and free[r, c] and not free[r - dr, c - dc]


_SQRT2 = math.sqrt(2.0)


@numba.njit(cache=True)
def _octile_to_box(row: int, col: int, box: NDArray) -> float:
    dr = max(box[0] - row, 0, row - box[1])
    dc = max(box[2] - col, 0, col - box[3])
    return max(dr, dc) + (_SQRT2 - 1.0) * min(dr, dc)


@numba.njit(cache=True)
def _straight_jump(jumps: NDArray, goal: NDArray, lines: NDArray, row: int, col: int, dr: int, dc: int) -> int:
    """Return how many cells a straight jump goes: to the next goal, or else jump point; 0 when there is neither."""
    side = (EAST if dc > 0 else WEST) if dr == 0 else (NORTH if dr > 0 else SOUTH)
    jump = jumps[row, col, side]
    if lines[0, row] if dr == 0 else lines[1, col]:
        for step in range(1, abs(jump) + 1):
            if goal[row + step * dr, col + step * dc]:
                return step
    return max(jump, 0)


@numba.njit(cache=True)
def _diagonal_jump(
    free: NDArray, jumps: NDArray, goal: NDArray, lines: NDArray, row: int, col: int, dr: int, dc: int
) -> int:
    """Return how many steps a diagonal jump goes: to a goal or a cell from which a straight jump continues, else 0."""
    rows, cols = free.shape
    step = 0
    while True:
        r, c = row + dr, col + dc
        if r < 0 or c < 0 or r >= rows or c >= cols:
            return 0
        if not (free[r, c] and free[row, c] and free[r, col]):
            return 0
        row, col, step = r, c, step + 1
        if (
            goal[r, c]
            or _straight_jump(jumps, goal, lines, r, c, 0, dc) > 0
            or _straight_jump(jumps, goal, lines, r, c, dr, 0) > 0
        ):
            return step


@numba.njit(cache=True)
def _may_continue(free: NDArray, row: int, col: int, came: tuple[int, int], dr: int, dc: int) -> bool:
    """Return whether a path that came to a cell in one direction may continue in another.

    After a diagonal: in the same direction, or in either of its two straight parts. After a straight: straight on; to a
    side, or diagonally towards it, only where the cell beside the previous one is not free, since otherwise the path
    would have gone there first.
    """
    came_r, came_c = came
    if came_r == 0 and came_c == 0:
        return True
    if came_r != 0 and came_c != 0:
        return dr in (0, came_r) and dc in (0, came_c)
    if came_r == 0:
        if dr == 0:
            return dc == came_c
        return dc != -came_c and 0 <= row + dr < free.shape[0] and not free[row + dr, col - came_c]
    if dc == 0:
        return dr == came_r
    return dr != -came_r and 0 <= col + dc < free.shape[1] and not free[row - came_r, col + dc]


@numba.njit(cache=True)
def search(free: NDArray, jumps: NDArray, start: tuple[int, int], goal: NDArray, box: NDArray) -> tuple[NDArray, float]:
    """Find a cheapest path from a cell to the nearest of the goal cells.

    Args:
        free: bool [rows, cols].
        jumps: int32 [rows, cols, 4], ``straight_jumps(free)``.
        start: (row, col), a free cell.
        goal: bool [rows, cols].
        box: int64 [4], (first row, last row, first col, last col) of the goal cells.

    Returns:
        int64 [n, 2] cells from start to goal, and the cost in cells; empty and infinity when there is no path.
    """
    rows, cols = free.shape
    lines = _lines_with_goals(goal, box)
    cost = np.full(rows * cols, np.inf)
    parent = np.full(rows * cols, -1, np.int32)
    first = start[0] * cols + start[1]
    cost[first] = 0.0
    heap = [(_octile_to_box(start[0], start[1], box), first)]
    while heap:
        estimate, here = heappop(heap)
        row, col = here // cols, here % cols
        if estimate > cost[here] + _octile_to_box(row, col, box):
            continue  # a cheaper path to this cell has been found since
        if goal[row, col]:
            return _path_back(parent, here, cols), float(cost[here])
        # Expand: jump in every direction in which a path that came this way may continue.
        came = _direction(int(parent[here]), here, cols)
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                if (dr == 0 and dc == 0) or not _may_continue(free, row, col, came, dr, dc):
                    continue
                if dr == 0 or dc == 0:
                    steps = _straight_jump(jumps, goal, lines, row, col, dr, dc)
                else:
                    steps = _diagonal_jump(free, jumps, goal, lines, row, col, dr, dc)
                # Relax: keep the jump point if this is the cheapest path to it until now.
                there = here + steps * (dr * cols + dc)
                along = float(cost[here]) + steps * (_SQRT2 if dr != 0 and dc != 0 else 1.0)
                if steps > 0 and along < cost[there]:
                    cost[there] = along
                    parent[there] = here
                    heappush(heap, (along + _octile_to_box(there // cols, there % cols, box), there))
    return np.zeros((0, 2), np.int64), np.inf


@numba.njit(cache=True)
def _lines_with_goals(goal: NDArray, box: NDArray) -> NDArray:
    """Mark the rows ([0]) and columns ([1]) that hold a goal: only along those a straight jump looks for one."""
    lines = np.zeros((2, max(goal.shape)), np.bool_)
    for row in range(box[0], box[1] + 1):
        for col in range(box[2], box[3] + 1):
            if goal[row, col]:
                lines[0, row] = lines[1, col] = True
    return lines


@numba.njit(cache=True)
def _direction(before: int, cell: int, cols: int) -> tuple[int, int]:
    """Return the direction from one cell to another as signs, (0, 0) when there is no previous cell."""
    if before < 0:
        return 0, 0
    dr, dc = cell // cols - before // cols, cell % cols - before % cols
    return (dr > 0) - (dr < 0), (dc > 0) - (dc < 0)


@numba.njit(cache=True)
def _path_back(parent: NDArray, goal: int, cols: int) -> NDArray:
    """Follow the parents from the goal to the start, filling in the cells between jump points."""
    n, cell = 1, goal
    while parent[cell] >= 0:
        before = parent[cell]
        n += max(abs(cell // cols - before // cols), abs(cell % cols - before % cols))
        cell = before
    path = np.zeros((n, 2), np.int64)
    row, col, cell = goal // cols, goal % cols, goal
    for i in range(n - 1, -1, -1):
        path[i, 0], path[i, 1] = row, col
        if row * cols + col == parent[cell]:
            cell = parent[cell]
        dr, dc = _direction(parent[cell], cell, cols)
        row, col = row - dr, col - dc
    return path


@numba.njit(cache=True)
def clear_length(free: NDArray, x0: float, y0: float, x1: float, y1: float) -> float:
    """Return the share (0 to 1) of a segment before it first enters a cell that is not free; 1 = all of it is clear.

    Every cell the segment passes through counts; where it passes exactly through a corner, the two cells beside it
    count as well. Coordinates are in cells: cell (row, col) covers x in [col, col + 1), y in [row, row + 1).
    ``free`` is bool [rows, cols].
    """
    rows, cols = free.shape
    row, col = math.floor(y0), math.floor(x0)
    last_row, last_col = math.floor(y1), math.floor(x1)
    dx, dy = x1 - x0, y1 - y0
    step_c, step_r = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    t_c = ((col + (step_c > 0)) - x0) / dx if dx != 0 else np.inf
    t_r = ((row + (step_r > 0)) - y0) / dy if dy != 0 else np.inf
    entered = 0.0
    # Amanatides and Woo (1987): step to the next column or row, whichever the segment crosses first.
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
    """Drop the points of a path that a clear straight line can skip.

    ``points`` is float64 [n, 2], (x, y) in cells; both ends stay.
    """
    keep = np.zeros(len(points), np.bool_)
    keep[0] = keep[-1] = True
    # First pass: keep the last point in sight of the previous kept one.
    anchor = 0
    for i in range(1, len(points) - 1):
        if not _is_clear(free, points, anchor, i + 1):
            keep[i] = True
            anchor = i
    kept = np.flatnonzero(keep)
    shorter = [kept[0]]
    at = 0
    # Second pass: the first stops at every hidden point, even if a later one is in sight again.
    while at < len(kept) - 1:
        ahead = len(kept) - 1
        while ahead > at + 1 and not _is_clear(free, points, kept[at], kept[ahead]):
            ahead -= 1
        at = ahead
        shorter.append(kept[at])
    return points[np.array(shorter)]


@numba.njit(cache=True)
def _is_clear(free: NDArray, points: NDArray, a: int, b: int) -> bool:
    return clear_length(free, points[a, 0], points[a, 1], points[b, 0], points[b, 1]) >= 1.0
