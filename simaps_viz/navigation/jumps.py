"""How far a straight move goes before it can be worth turning, for every free cell, compiled; made once for a map.

Going straight over free cells, a shortest way that goes diagonally first has no reason to turn until an obstacle
beside it ends (see ``astar``). The cell where one ends is a *jump point*.
"""

import numba
import numpy as np
from numpy.typing import NDArray

EAST, WEST, NORTH, SOUTH = 0, 1, 2, 3
"""The last index of the table; east is the next column, north the next row."""


@numba.njit(cache=True)
def straight_jumps(free: NDArray) -> NDArray:
    """Give the table of straight jumps.

    Args:
        free: bool [rows, cols].

    Returns:
        int32 [rows, cols, 4]: a number n > 0 when the next jump point is n cells away; -n when there is none on the
        n free cells before the next obstacle or the map's edge. Of cells that are not free: 0.
    """
    rows, cols = free.shape
    jumps = np.zeros((rows, cols, 4), np.int32)
    for i in range(rows):
        row, back = i, rows - 1 - i
        for j in range(cols):
            col, left = j, cols - 1 - j
            _extend(jumps, free, row, left, 0, 1, EAST)
            _extend(jumps, free, row, col, 0, -1, WEST)
            _extend(jumps, free, back, col, 1, 0, NORTH)
            _extend(jumps, free, row, col, -1, 0, SOUTH)
    return jumps


@numba.njit(cache=True)
def _extend(jumps: NDArray, free: NDArray, row: int, col: int, dr: int, dc: int, side: int) -> None:
    """Fill in one cell from the next cell in that direction, which is known."""
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
    """Tell whether, at a cell come to in a direction, the cell on one hand is free but the one before that was not."""
    r, c = row + hand * dc, col + hand * dr
    return 0 <= r < free.shape[0] and 0 <= c < free.shape[1] and free[r, c] and not free[r - dr, c - dc]
