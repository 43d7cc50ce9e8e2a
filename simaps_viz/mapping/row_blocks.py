"""Layers of large maps in blocks of rows: NumPy needs 8 bytes a cell for what it looks up or counts."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

BLOCK_CELLS = 1 << 20
"""About how many cells are in a block."""


def row_blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield slices of rows that cover a layer of that shape."""
    rows, cols = shape
    step = max(BLOCK_CELLS // max(cols, 1), 1)
    for first in range(0, rows, step):
        yield slice(first, min(first + step, rows))


def look_up(table: NDArray, ids: NDArray) -> NDArray:
    """Return ``table[ids]``.

    Args:
        table: [k].
        ids: whole numbers from 0 to k - 1, [rows, cols].

    Returns:
        [rows, cols], the table's dtype.
    """
    found = np.zeros(ids.shape, dtype=table.dtype)
    for block in row_blocks(ids.shape):
        found[block] = table[ids[block]]
    return found


def count_ids(ids: NDArray, size: int) -> NDArray:
    """Count the cells of each id above 0, int64 [size]; entry 0 stays 0.

    Args:
        ids: whole numbers from 0 to size - 1, [rows, cols].
        size: length of the result.
    """
    there = [part[part > 0] for part in (ids[block] for block in row_blocks(ids.shape))]
    return np.bincount(np.concatenate([np.zeros(0, ids.dtype), *there]), minlength=size)
