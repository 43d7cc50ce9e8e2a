"""Pixels to cells: back-project every pixel, and let the highest one name its cell.

The kernels work on flat arrays of a *window* of the endless grid whose cell (0, 0) touches the map frame's origin;
`accumulator.py` owns the window and lets it grow.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

NO_CELL = -1


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
    """Give every pixel its cell of the window (row * cols + col) and its height over the floor.

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
            cells[v, u] = NO_CELL
            z = np.float64(depth_m[v, u])
            if not (z > near_m and z < far_m):
                continue
            a = (u - cx) / fx
            h = (r20 * a + z_row) * z + tz
            if h >= cut_m or h <= floor_m:
                continue
            col = math.floor(((r00 * a + x_row) * z + tx) * per_m) - col0
            row = math.floor(((r10 * a + y_row) * z + ty) * per_m) - row0
            if row < 0 or row >= rows or col < 0 or col >= cols:
                continue
            cells[v, u] = row * cols + col
            heights[v, u] = h


@njit(cache=True, nogil=True)
def raise_cells(
    cells: NDArray,  # int32 [H, W]
    heights: NDArray,  # float32 [H, W]
    ids: NDArray,  # int32 [H, W]
    label_of_id: NDArray,  # int16 [max id + 1]
    obstacle_m: float,
    label: NDArray,  # in/out int16 [n]
    top: NDArray,  # in/out float32 [n], -inf = never seen
    lowest: NDArray,  # in/out float32 [n], +inf = no pixel at obstacle height
    observations: NDArray,  # in/out int32 [n]
    frame_top: NDArray,  # work float32 [n]
    frame_segment: NDArray,  # out int32 [n], valid for the touched cells
    stamp: NDArray,  # in/out int32 [n], last frame that touched the cell
    frame_index: int,
    touched: NDArray,  # out int32 [>= n]
) -> int:
    """Let the highest pixel name its cell (ties: the earlier frame, then the earlier pixel); count the seen cells.

    Returns the number of cells this frame saw; they stand at the front of ``touched``, in the order met.
    """
    n_touched = 0
    height, width = cells.shape
    for v in range(height):
        for u in range(width):
            c = cells[v, u]
            if c < 0:
                continue
            h = heights[v, u]
            if stamp[c] != frame_index:
                stamp[c] = frame_index
                touched[n_touched] = c
                n_touched += 1
                frame_top[c] = h
                frame_segment[c] = ids[v, u]
            elif h > frame_top[c]:
                frame_top[c] = h
                frame_segment[c] = ids[v, u]
            if h >= obstacle_m and h < lowest[c]:
                lowest[c] = h
    # What the frame saw of a cell meets what earlier frames saw once a cell, not once a pixel.
    for i in range(n_touched):
        c = touched[i]
        observations[c] += 1
        if frame_top[c] > top[c]:
            top[c] = frame_top[c]
            label[c] = label_of_id[frame_segment[c]]
    return n_touched
