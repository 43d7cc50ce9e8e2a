"""Windows of one endless grid: where the cells of one lie in another. Only whole cells are ever moved."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.structures import Grid, GridSpec


def whole_cells(old: GridSpec, new: GridSpec) -> tuple[int, int]:
    """Return (rows, cols) to add to a cell of one window to find it in another.

    Raises:
        InputError: the cells have another size or do not coincide.
    """
    if abs(old.cell_size_m - new.cell_size_m) > 1e-9:
        raise InputError(f"windows: expected cells of one size, found {old.cell_size_m:g} and {new.cell_size_m:g} m")
    shift = np.array([old.y0_m - new.y0_m, old.x0_m - new.x0_m]) / new.cell_size_m
    whole = np.rint(shift)
    if np.abs(shift - whole).max() > 1e-3:
        raise InputError(
            f"windows: expected cells that coincide, found them {shift[0] - whole[0]:+.3f} rows and "
            f"{shift[1] - whole[1]:+.3f} columns off"
        )
    return int(whole[0]), int(whole[1])


def joint_window(one: GridSpec, other: GridSpec) -> GridSpec:
    """Return the smallest window that holds two windows of the same endless grid."""
    row, col = whole_cells(other, one)
    low = (min(0, row), min(0, col))
    high = (max(one.rows, row + other.rows), max(one.cols, col + other.cols))
    s = one.cell_size_m
    x0, y0 = one.x0_m + low[1] * s, one.y0_m + low[0] * s
    return GridSpec(high[0] - low[0], high[1] - low[1], s, round(x0, 9), round(y0, 9))


def moved(cells: NDArray, shift: tuple[int, int], shape: tuple[int, int], empty: float) -> NDArray:
    """Copy cells to where they lie in another window.

    Args:
        cells: any dtype [rows, cols], which the copy has too; given back itself when there is nothing to move.
        shift: from `whole_cells`.
        shape: of the other window; what lies outside is cut off.
        empty: value of cells that lie only in the other window.
    """
    if shift == (0, 0) and cells.shape == shape:
        return cells
    result = np.full(shape, empty, dtype=cells.dtype)
    low = [max(0, s) for s in shift]
    high = [min(n, s + m) for n, s, m in zip(shape, shift, cells.shape, strict=True)]
    if high[0] > low[0] and high[1] > low[1]:
        source = tuple(slice(a - s, b - s) for a, b, s in zip(low, high, shift, strict=True))
        result[low[0] : high[0], low[1] : high[1]] = cells[source]
    return result


def moved_grid(grid: Grid, spec: GridSpec) -> Grid:
    """Copy a grid to another window of the same endless grid; raises InputError if the cells do not coincide."""
    shift = whole_cells(grid.spec, spec)
    return replace(
        grid,
        spec=spec,
        label=moved(grid.label, shift, spec.shape, 0),
        height_m=moved(grid.height_m, shift, spec.shape, np.nan),
        lowest_m=moved(grid.lowest_m, shift, spec.shape, np.nan),
        observations=moved(grid.observations, shift, spec.shape, 0),
    )
