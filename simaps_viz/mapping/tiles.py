"""Sparse layers of the endless grid: square tiles of cells that exist only where something was seen.

A tile is named by its row and column: (0, 0) touches the map's origin, negative ones are south and west of it. The
tiles of a layer are one array, one after the other, so that a kernel finds a cell by its tile's slot. Memory follows
what was seen: room that is not used yet costs address space only.
"""

from copy import copy

import numpy as np
from numba import njit
from numpy.typing import NDArray

SIDE = 64
"""Cells along a tile's side: 3.2 m with cells of 0.05 m."""
AREA = SIDE * SIDE
_BITS = 6
_LAYERS: dict[str, tuple[type, float]] = {
    "label": (np.int16, 0),
    "top": (np.float32, -np.inf),
    "lowest": (np.float32, np.inf),
    "observations": (np.int32, 0),
}
CELL_BYTES = sum(np.dtype(dtype).itemsize for dtype, _ in _LAYERS.values())
"""Bytes of memory for each cell of a tile."""


class TileStore:
    """The layers of a map under construction, flat: cell (row, col) of slot s is s * AREA + row * SIDE + col."""

    label: NDArray
    """int16, class index, 0 = none."""
    top: NDArray
    """float32, metres, -inf = never seen."""
    lowest: NDArray
    """float32, metres, +inf = no pixel at obstacle height."""
    observations: NDArray
    """int32, frames that saw the cell."""

    def __init__(self) -> None:
        """Make a store without tiles."""
        self.slot_of: dict[tuple[int, int], int] = {}
        """By (tile row, tile column)."""
        for name, (dtype, _) in _LAYERS.items():
            setattr(self, name, np.zeros(0, dtype))

    def __len__(self) -> int:
        """Number of tiles."""
        return len(self.slot_of)

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        return len(self) * AREA * CELL_BYTES

    def copy(self) -> "TileStore":
        """Return a deep copy."""
        twin = copy(self)
        twin.slot_of = dict(self.slot_of)
        for name in _LAYERS:
            setattr(twin, name, getattr(self, name)[: len(self) * AREA].copy())
        return twin

    def known(self, first: tuple[int, int], side: int) -> NDArray:
        """Return the slots of ``side`` x ``side`` tiles from ``first`` on, int32, -1 where there is none."""
        at = self.slot_of.get
        rows, cols = range(first[0], first[0] + side), range(first[1], first[1] + side)
        return np.array([[at((row, col), -1) for col in cols] for row in rows], dtype=np.int32)

    def slots(self, first: tuple[int, int], wanted: NDArray) -> NDArray:
        """Return the slots of some tiles, and make those that are not there yet.

        Args:
            first: (tile row, tile column) of ``wanted[0, 0]``.
            wanted: bool [r, c].

        Returns:
            int32 [r, c], -1 where not wanted.
        """
        found = np.full(wanted.shape, -1, dtype=np.int32)
        for r, c in np.argwhere(wanted).tolist():
            name = (first[0] + r, first[1] + c)
            slot = self.slot_of.get(name)
            found[r, c] = self._add(name) if slot is None else slot
        return found

    def locate(self, rows: NDArray, cols: NDArray) -> NDArray:
        """Return the position of some cells in the flat layers, int64 [n]; makes the tiles that are not there yet.

        Args:
            rows: int32 [n], counted from the map's origin; they must lie within one map (`limits.check_cells`).
            cols: int32 [n].
        """
        if len(rows) == 0:
            return np.zeros(0, dtype=np.int64)
        low, high = (int(rows.min()) >> _BITS, int(cols.min()) >> _BITS), (int(rows.max()), int(cols.max()))
        wanted = np.zeros(((high[0] >> _BITS) - low[0] + 1, (high[1] >> _BITS) - low[1] + 1), dtype=np.bool_)
        _mark(rows, cols, low[0], low[1], wanted)
        return _places(rows, cols, low[0], low[1], self.slots(low, wanted))

    def find(self, rows: NDArray, cols: NDArray) -> NDArray:
        """Return the position of some cells like `locate`, -1 where there is no tile; makes none."""
        tile = np.stack([rows >> _BITS, cols >> _BITS], axis=1)
        known, which = np.unique(tile, axis=0, return_inverse=True)
        slots = np.array([self.slot_of.get((r, c), -1) for r, c in known.tolist()], dtype=np.int64)
        slot = slots[which.reshape(-1)] if len(slots) else np.zeros(0, np.int64)
        place = slot * AREA + (rows & (SIDE - 1)) * SIDE + (cols & (SIDE - 1))
        return np.where(slot < 0, -1, place)

    def empty(self, at: NDArray) -> None:
        """Forget what was seen of some cells, int64 [n], places in the flat layers."""
        for name, (_, nothing) in _LAYERS.items():
            getattr(self, name)[at] = nothing

    def cut(self, name: str, row0: int, col0: int, shape: tuple[int, int], empty: float) -> NDArray:
        """Copy a layer of a rectangle of the grid: ``shape``, the layer's dtype; ``empty`` where there is no tile."""
        result = np.full(shape, empty, dtype=_LAYERS[name][0])
        for (row, col), slot in self.slot_of.items():
            tile = self.tile(name, slot)
            top, left = row * SIDE - row0, col * SIDE - col0
            low, high = (max(top, 0), max(left, 0)), (min(top + SIDE, shape[0]), min(left + SIDE, shape[1]))
            if low[0] < high[0] and low[1] < high[1]:
                inner = tile[low[0] - top : high[0] - top, low[1] - left : high[1] - left]
                result[low[0] : high[0], low[1] : high[1]] = inner
        return result

    def tile(self, name: str, slot: int) -> NDArray:
        """Return a layer of one tile, [SIDE, SIDE], the layer's dtype; writing into it changes the map."""
        return getattr(self, name)[slot * AREA : (slot + 1) * AREA].reshape(SIDE, SIDE)

    def _add(self, place: tuple[int, int]) -> int:
        slot = self.slot_of[place] = len(self.slot_of)
        needed = (slot + 1) * AREA
        for name, (dtype, empty) in _LAYERS.items():
            layer = getattr(self, name)
            if needed > len(layer):  # one layer after the other, so that only one is held twice
                grown = np.zeros(max(needed * 3 // 2, 16 * AREA), dtype)
                grown[: len(layer)] = layer
                setattr(self, name, grown)
                layer = grown
            layer[slot * AREA : needed] = empty
        return slot


@njit(cache=True, nogil=True, inline="always")
def lowest_so_far(row: int, col: int, slots: NDArray, lowest: NDArray, wanted: NDArray) -> np.float32:
    """Return the lowest obstacle of a cell of a window, metres, +inf where there is no tile; mark its tile as wanted.

    ``slots`` int32 and ``wanted`` bool are [tile rows, tile columns] of the window, ``lowest`` float32 [tiles * AREA].
    """
    wanted[row >> _BITS, col >> _BITS] = True
    slot = np.int64(slots[row >> _BITS, col >> _BITS])
    if slot < 0:
        return np.float32(np.inf)
    return lowest[slot * AREA + (row & (SIDE - 1)) * SIDE + (col & (SIDE - 1))]


@njit(cache=True, nogil=True)
def _mark(rows: NDArray, cols: NDArray, row0: int, col0: int, wanted: NDArray) -> None:
    for i in range(len(rows)):
        wanted[(rows[i] >> _BITS) - row0, (cols[i] >> _BITS) - col0] = True


@njit(cache=True, nogil=True)
def _places(rows: NDArray, cols: NDArray, row0: int, col0: int, slots: NDArray) -> NDArray:
    places = np.zeros(len(rows), dtype=np.int64)
    for i in range(len(rows)):
        slot = np.int64(slots[(rows[i] >> _BITS) - row0, (cols[i] >> _BITS) - col0])
        places[i] = slot * AREA + (rows[i] & (SIDE - 1)) * SIDE + (cols[i] & (SIDE - 1))
    return places


@njit(cache=True, nogil=True)
def raise_tiles(
    rows: NDArray,  # int32 [n], of cells of a window whose corner is a tile's corner
    cols: NDArray,  # int32 [n]
    slots: NDArray,  # int32 [tile rows, tile columns] of the window
    frame_top: NDArray,  # float32 [n]
    frame_lowest: NDArray,  # float32 [n], as low as the map or lower
    frame_segment: NDArray,  # int32 [n]
    label_of_id: NDArray,  # int16 [max id + 1]
    label: NDArray,  # in/out int16 [tiles * AREA], as all four layers of a `TileStore`
    top: NDArray,  # in/out float32, metres over the floor
    lowest: NDArray,  # in/out float32, metres over the floor, of its lowest obstacle
    observations: NDArray,  # in/out int32
    lowered: NDArray,  # out bool [n], this frame's lowest pixel is the lowest so far
) -> None:
    """Put what one frame saw of its cells on the map; ties go to the earlier frame."""
    for i in range(len(rows)):
        slot = np.int64(slots[rows[i] >> _BITS, cols[i] >> _BITS])
        at = slot * AREA + (rows[i] & (SIDE - 1)) * SIDE + (cols[i] & (SIDE - 1))
        observations[at] += 1
        if frame_top[i] > top[at]:
            top[at] = frame_top[i]
            label[at] = label_of_id[frame_segment[i]]
        lowered[i] = frame_lowest[i] < lowest[at]
        if lowered[i]:
            lowest[at] = frame_lowest[i]
