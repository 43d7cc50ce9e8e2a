"""The 3-D view: everything that stands on the floor as solid blocks, one mesh for each colour."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import SIMap
from simaps_viz.viewer.texture import FURNITURE_FROM_M, STRUCTURE, is_ground_class

WALL_CUT_M = 0.6
"""Walls are cut off here, as in a doll's house, or one could not look in."""
COLOR_STEP = 8
"""Colours closer than this share a mesh."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh of one colour."""

    color: tuple[int, int, int]
    vertices: NDArray
    """float32 [n, 3], map frame, metres."""
    faces: NDArray
    """uint32 [m, 3], counter-clockwise from outside."""


def block_heights(simap: SIMap) -> NDArray:
    """Give float32 [rows, cols]: how high each cell stands in the 3-D view, metres; 0 = floor or unseen."""
    height = np.nan_to_num(simap.grid.height_m, nan=0.0)
    height = np.where(height >= FURNITURE_FROM_M, height, 0.0)
    walls = is_ground_class(simap, *STRUCTURE) | (simap.grid.label == 0)
    return np.where(walls, np.minimum(height, WALL_CUT_M), height).astype(np.float32)


def solids(simap: SIMap, colors: NDArray) -> list[Solid]:
    """Give the blocks, only their faces that can be seen.

    Args:
        simap: the map.
        colors: uint8 [rows, cols, 3], from ``cell_colors``.
    """
    height = np.pad(block_heights(simap), 1)
    rounded = (colors // COLOR_STEP).astype(np.int64)
    key = np.pad(rounded[..., 0] << 16 | rounded[..., 1] << 8 | rounded[..., 2], 1)
    row, col = np.nonzero(height > 0)
    top = height[row, col]
    quads = [_tops(row, col, top)]
    owners = [key[row, col]]
    for d_row, d_col in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        foot = height[row + d_row, col + d_col]
        bare = foot < top
        quads.append(_sides(row[bare], col[bare], foot[bare], top[bare], (d_row, d_col)))
        owners.append(key[row, col][bare])
    corners, owner = np.concatenate(quads), np.concatenate(owners)
    spec = simap.spec
    corners[..., 0] = spec.x0_m + (corners[..., 0] - 1) * spec.cell_size_m
    corners[..., 1] = spec.y0_m + (corners[..., 1] - 1) * spec.cell_size_m
    found = []
    for value in np.unique(owner):
        mine = corners[owner == value].astype(np.float32)
        first = np.arange(len(mine), dtype=np.uint32)[:, None] * 4
        faces = np.concatenate([first + np.array(corner) for corner in ((0, 1, 2), (0, 2, 3))]).astype(np.uint32)
        inner = np.argwhere(key[1:-1, 1:-1] == value)[0]
        r, g, b = (int(v) for v in colors[inner[0], inner[1]])
        found.append(Solid((r, g, b), mine.reshape(-1, 3), faces))
    return found


def _tops(row: NDArray, col: NDArray, top: NDArray) -> NDArray:
    """Corners [n, 4, 3] of the lids, in cells and metres of height."""
    around = ((0, 0), (1, 0), (1, 1), (0, 1))
    return np.stack([np.column_stack([col + dx, row + dy, top]) for dx, dy in around], axis=1).astype(np.float64)


def _sides(row: NDArray, col: NDArray, foot: NDArray, top: NDArray, towards: tuple[int, int]) -> NDArray:
    """Corners [n, 4, 3] of the sides that face one neighbour, from that neighbour's lid up."""
    (ax, ay), (bx, by) = {
        (0, 1): ((1, 0), (1, 1)),
        (1, 0): ((1, 1), (0, 1)),
        (0, -1): ((0, 1), (0, 0)),
        (-1, 0): ((0, 0), (1, 0)),
    }[towards]
    ring = ((ax, ay, foot), (bx, by, foot), (bx, by, top), (ax, ay, top))
    return np.stack([np.column_stack([col + x, row + y, z]) for x, y, z in ring], axis=1).astype(np.float64)
