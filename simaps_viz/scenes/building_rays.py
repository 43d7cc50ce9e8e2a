"""Depth and masks of a height field: every ray walks from cell to cell until it meets one that is high enough."""

import math

from numba import njit
from numpy.typing import NDArray

_INSIDE_M = 0.004  # a ray that meets a side ends this far inside, so that the point lies in the cell it met


@njit(cache=True, nogil=True)
def cast_rays(
    T_world_camera: NDArray,  # float64 [4, 4]
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    height_m: NDArray,  # float32 [rows, cols]
    cell_ids: NDArray,  # int32 [rows, cols]
    origin_m: tuple[float, float],  # x, y of the corner of cell (0, 0)
    cell_m: float,
    far_m: float,
    depth_m: NDArray,  # out float32 [H, W]
    ids: NDArray,  # out int32 [H, W]
) -> None:
    """Render a height field; what lies farther than ``far_m`` along the optical axis stays 0 in both pictures.

    A. Amanatides and A. Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987, in two dimensions.
    """
    T = T_world_camera
    rows, cols = height_m.shape
    x0, y0, z0 = (T[0, 3] - origin_m[0]) / cell_m, (T[1, 3] - origin_m[1]) / cell_m, T[2, 3]
    for v in range(depth_m.shape[0]):
        b = (v - cy) / fy
        for u in range(depth_m.shape[1]):
            a = (u - cx) / fx
            dx = (T[0, 0] * a + T[0, 1] * b + T[0, 2]) / cell_m
            dy = (T[1, 0] * a + T[1, 1] * b + T[1, 2]) / cell_m
            dz = T[2, 0] * a + T[2, 1] * b + T[2, 2]
            inside = _INSIDE_M / (cell_m * math.sqrt(dx * dx + dy * dy) + 1e-12)
            col, row = math.floor(x0), math.floor(y0)
            step_col, step_row = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
            next_x = ((col + (1 if dx > 0 else 0)) - x0) / dx if dx != 0.0 else math.inf
            next_y = ((row + (1 if dy > 0 else 0)) - y0) / dy if dy != 0.0 else math.inf
            apart_x = abs(1.0 / dx) if dx != 0.0 else math.inf
            apart_y = abs(1.0 / dy) if dy != 0.0 else math.inf
            t = 0.0
            while t < far_m and 0 <= row < rows and 0 <= col < cols:
                top = height_m[row, col]
                leaves = min(next_x, next_y)
                if z0 + dz * t < top:  # meets its side
                    depth_m[v, u], ids[v, u] = t + inside, cell_ids[row, col]
                    break
                if z0 + dz * leaves <= top:  # meets its top
                    at = (top - z0) / dz
                    if at < far_m:
                        depth_m[v, u], ids[v, u] = at, cell_ids[row, col]
                    break
                t = leaves
                if next_x < next_y:
                    col, next_x = col + step_col, next_x + apart_x
                else:
                    row, next_y = row + step_row, next_y + apart_y
