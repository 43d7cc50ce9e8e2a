"""Pixels to cells: back-project every pixel, and let the highest one name its cell.

The kernels work on flat arrays of a *window* of the endless grid: what one camera can reach. `accumulator.py` places
it; the map itself lies in tiles (`tiles.py`).
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.mapping.tiles import lowest_so_far

NO_CELL = -1
STEPS_PER_M = 20.0
"""Heights are kept in steps of 5 cm over the floor: step k is from 0.05 k to 0.05 (k + 1) metres."""
STEPS = 64
"""Steps of one column: 3.2 m from the lowest that a build looks at. What is higher is in no run."""
ON_A_STEP = 0.01
"""Of a step: heights are this much higher than they are, so that a floor at 0 but for rounding is in one step."""


def first_step(below_floor_m: float) -> int:
    """Return the lowest step of a column; pixels more than ``below_floor_m`` below the floor are left out."""
    return max(-math.ceil(below_floor_m * STEPS_PER_M - ON_A_STEP), -STEPS)


@njit(cache=True, nogil=True)
def project_pixels(
    depth_m: NDArray,  # float32 [H, W]
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    T_map_camera: NDArray,  # float64 [4, 4]
    near_m: float,
    far_m: float,
    floor_m: float,
    cut_m: float,
    cell_size_m: float,
    row0: int,
    col0: int,
    rows: int,
    cols: int,
    cells: NDArray,  # out int32 [H, W]
    heights: NDArray,  # out float32 [H, W]
) -> None:
    """Compute the cell of every pixel (row * cols + col of the window) and its height over the floor.

    Pixels with depth outside (near, far), height outside (floor, cut) or a cell outside the window get NO_CELL.
    Formula: ``p_map = R ((u - cx) / fx z, (v - cy) / fy z, z) + t``; cell = floor(p / cell size).
    """
    height, width = depth_m.shape
    r00, r01, r02, tx = T_map_camera[0, 0], T_map_camera[0, 1], T_map_camera[0, 2], T_map_camera[0, 3]
    r10, r11, r12, ty = T_map_camera[1, 0], T_map_camera[1, 1], T_map_camera[1, 2], T_map_camera[1, 3]
    r20, r21, r22, tz = T_map_camera[2, 0], T_map_camera[2, 1], T_map_camera[2, 2], T_map_camera[2, 3]
    per_m = 1.0 / cell_size_m
    for v in range(height):
        b = (v - cy) / fy
        # One pixel's ray is (a, b, 1): the part that does not change along the row is taken out of the loop.
        x_row, y_row, z_row = r01 * b + r02, r11 * b + r12, r21 * b + r22
        for u in range(width):
            # Depth that is missing, too near or too far.
            cells[v, u] = NO_CELL
            z = np.float64(depth_m[v, u])
            if not (z > near_m and z < far_m):
                continue
            # Back-project: the height first, which leaves out the ceiling and what is below the floor.
            a = (u - cx) / fx
            h = (r20 * a + z_row) * z + tz
            if h >= cut_m or h <= floor_m:
                continue
            # Then the cell, if the window holds it.
            col = math.floor(((r00 * a + x_row) * z + tx) * per_m) - col0
            row = math.floor(((r10 * a + y_row) * z + ty) * per_m) - row0
            if row < 0 or row >= rows or col < 0 or col >= cols:
                continue
            cells[v, u] = row * cols + col
            heights[v, u] = h


@njit(cache=True, nogil=True)
def see_cells(  # noqa: C901 - one loop over shared arrays
    cells: NDArray,  # int32 [H, W]
    heights: NDArray,  # float32 [H, W]
    ids: NDArray,  # int32 [H, W]
    cols: int,
    obstacle_m: float,
    lowest_step: int,
    slots: NDArray,  # int32 [tile rows, tile columns] of the window, -1 = no tile
    lowest: NDArray,  # float32, of the map's tiles
    wanted: NDArray,  # in/out bool [tile rows, tile columns]: those with a cell that is seen become True
    place: NDArray,  # int32 [window], scratch: all -1, and so again in the end
    seen: NDArray,  # out int32 [>= n], the cells that the frame saw, in the order met; the next six are aligned
    rows: NDArray,  # out int32 [>= n]
    columns: NDArray,  # out int32 [>= n]
    frame_top: NDArray,  # out float32 [>= n]
    frame_lowest: NDArray,  # out float32 [>= n], the map's or this frame's, whichever is lower
    frame_segment: NDArray,  # out int32 [>= n], of the highest pixel
    head: NDArray,  # out int32 [>= n], first column, -1 = none
    segment: NDArray,  # out int32 [>= H W], of each column
    steps: NDArray,  # out uint64 [>= H W], bit k: a pixel at step ``lowest_step`` + k
    following: NDArray,  # out int32 [>= H W], next column of the same cell, -1 = none
) -> tuple[int, int, int, int, int]:
    """Find what one frame saw of every cell: its highest pixel (ties: the earlier), its lowest obstacle, its columns.

    The lowest obstacle starts from the map's, which spares most cells the writing. A column is a cell and a segment:
    at which heights the frame saw its surface there.

    Returns the number n of cells this frame saw, and their first row, first column, last row + 1 and last column + 1.
    """
    n = n_columns = 0
    low_row, low_col, high_row, high_col = len(place), len(place), 0, 0
    height, width = cells.shape
    top, low, at_steps = -np.float32(np.inf), np.float32(np.inf), np.uint64(0)
    for v in range(height):
        for u in range(width):
            c, one = cells[v, u], ids[v, u]
            if c < 0:
                continue
            # Pixels side by side mostly share cell and segment: they are summed up before the cell is looked at.
            h = heights[v, u]
            top = max(top, h)
            if h >= obstacle_m and h < low:
                low = h
            k = math.floor(h * STEPS_PER_M + ON_A_STEP) - lowest_step
            if 0 <= k < STEPS:
                at_steps |= np.uint64(1) << np.uint64(k)
            if u + 1 < width and cells[v, u + 1] == c and ids[v, u + 1] == one:
                continue
            # The first pixels of this frame in the cell open it; later ones count if they are higher.
            at = place[c]
            if at < 0:
                at = place[c] = n
                n += 1
                row = c // cols
                col = c - row * cols
                seen[at], rows[at], columns[at] = c, row, col
                low_row, high_row = min(low_row, row), max(high_row, row + 1)
                low_col, high_col = min(low_col, col), max(high_col, col + 1)
                frame_top[at], frame_segment[at], head[at] = top, one, -1
                frame_lowest[at] = lowest_so_far(row, col, slots, lowest, wanted)
            elif top > frame_top[at]:
                frame_top[at], frame_segment[at] = top, one
            frame_lowest[at] = min(frame_lowest[at], low)
            # The cell's list is followed to the segment's column; a new one becomes its first.
            column = head[at]
            while column >= 0 and segment[column] != one:
                column = following[column]
            if column >= 0:
                steps[column] |= at_steps
            elif at_steps != 0:
                segment[n_columns], steps[n_columns], following[n_columns] = one, at_steps, head[at]
                head[at] = n_columns
                n_columns += 1
            top, low, at_steps = -np.float32(np.inf), np.float32(np.inf), np.uint64(0)
    for i in range(n):
        place[seen[i]] = -1
    return n, low_row, low_col, high_row, high_col


@njit(cache=True, nogil=True, inline="always")
def count_bits(steps):  # uint64 -> int
    """Return how many bits are set: sums of neighbouring bits, then of pairs, then of fours, then of all bytes."""
    steps = steps - ((steps >> np.uint64(1)) & np.uint64(0x5555555555555555))
    steps = (steps & np.uint64(0x3333333333333333)) + ((steps >> np.uint64(2)) & np.uint64(0x3333333333333333))
    steps = (steps + (steps >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((steps * np.uint64(0x0101010101010101)) >> np.uint64(56))


@njit(cache=True, nogil=True, inline="always")
def lowest_run(steps):  # uint64 -> uint64
    """Return the lowest bits without a gap: adding one to them clears them all."""
    return steps & ~(steps + (steps & (~steps + np.uint64(1))))


@njit(cache=True, nogil=True, inline="always")
def below_lowest(steps):  # uint64 -> uint64
    """Return all bits below the lowest that is set."""
    return (steps & (~steps + np.uint64(1))) - np.uint64(1)


@njit(cache=True, nogil=True)
def runs_of_columns(
    lowest_step: int,
    head: NDArray,  # int32 [n], as `see_cells` leaves it, with the three that follow
    segment: NDArray,
    steps: NDArray,
    following: NDArray,
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Cut columns into runs of steps without a gap.

    Returns:
        place in ``head`` int32, ascending; segment int32; first and last step int8.
    """
    size = 0
    for i in range(len(head)):
        column = head[i]
        while column >= 0:
            size += count_bits(steps[column] & ~(steps[column] << np.uint64(1)))
            column = following[column]
    place, of_segment = np.zeros(size, np.int32), np.zeros(size, np.int32)
    low, high = np.zeros(size, np.int8), np.zeros(size, np.int8)
    n = 0
    for i in range(len(head)):
        column = head[i]
        while column >= 0:
            left = steps[column]
            while left:
                run, first = lowest_run(left), lowest_step + count_bits(below_lowest(left))
                place[n], of_segment[n], low[n], high[n] = i, segment[column], first, first + count_bits(run) - 1
                left &= ~run
                n += 1
            column = following[column]
    return place, of_segment, low, high
