"""Counting cell pairs: an append-only table of (class, cell, cell) with a count, filled pixel pair by pixel pair."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

_RECENT = 1 << 12
_HALF = 1 << 15  # cells are addressed within +-32768 of the map's origin: 1.6 km at 5 cm


@njit(cache=True, nogil=True, inline="always")
def _slot_of(key: np.uint64, label: int, mask: int) -> int:
    mixed = (key ^ (np.uint64(label) << np.uint64(59))) * np.uint64(0x9E3779B97F4A7C15)
    return int(mixed >> np.uint64(20)) & mask


@njit(cache=True, nogil=True)
def _find_or_add(
    key,  # uint64
    label,  # int16
    slots: NDArray,  # in/out int32 [power of two]
    mask: int,
    keys: NDArray,  # in/out uint64 [room]
    labels: NDArray,  # in/out int16 [room]
    counts: NDArray,  # in/out int64 [room]
    size: int,
) -> int:
    """Return the entry of a key and class: ``size`` if it is new."""
    at = _slot_of(key, label, mask)
    while True:
        entry = slots[at]
        if entry < 0:
            slots[at] = size
            keys[size] = key
            labels[size] = label
            counts[size] = 0
            return size
        if keys[entry] == key and labels[entry] == label:
            return entry
        at = (at + 1) & mask


@njit(cache=True, nogil=True)
def _key_within(first, second, cols: int, row0: int, col0: int, reach: int) -> np.uint64:
    """Return the key of two cells (their numbers in a window), 0 where they lie farther apart than ``reach``."""
    row_a, row_b = first // cols, second // cols
    col_a, col_b = first - row_a * cols, second - row_b * cols
    if reach >= 0 and (row_b - row_a > reach or abs(col_b - col_a) > reach):
        return np.uint64(0)  # no pair's key: its cells would be one
    a = (np.uint64(row_a + row0 + _HALF) << np.uint64(16)) | np.uint64(col_a + col0 + _HALF)
    b = (np.uint64(row_b + row0 + _HALF) << np.uint64(16)) | np.uint64(col_b + col0 + _HALF)
    return (a << np.uint64(32)) | b


@njit(cache=True, nogil=True)
def count_links(  # noqa: C901, PLR0912 - one pass over the pixels, split up it would be slower
    cells: NDArray,  # int32 [H, W], -1 = none
    ids: NDArray,  # int32 [H, W]
    graph_label_of_id: NDArray,  # int16 [max id + 1], 0 where the segment gets no graph
    row0: int,  # of the window, in cells from the map's origin
    col0: int,
    cols: int,
    reach: int,
    slots: NDArray,  # in/out int32 [power of two], entry of a hash, -1 = none
    keys: NDArray,  # in/out uint64 [room], both cells of an entry, 16 bits a number
    labels: NDArray,  # in/out int16 [room], class of an entry
    counts: NDArray,  # in/out int64 [room]
    size: int,
    start_row: int,
) -> tuple[int, int]:
    """Add 1 to a cell pair for each pair of 4-neighbouring pixels of one segment that fall in its two cells.

    Pairs whose cells lie more than ``reach`` cells apart (the larger of rows and columns) are depth jumps and are
    dropped; ``reach`` < 0 keeps them all (the paper's literal reading).

    Returns the new number of entries and the first image row that was not done for lack of room (H = all done).
    """
    height, width = cells.shape
    mask = slots.shape[0] - 1
    # Row after row meets the same pairs along a cell's border: a small direct-mapped cache spares most look-ups.
    recent = np.full((_RECENT, 4), -1, dtype=np.int32)  # first cell, second cell, class, entry
    for v in range(start_row, height):
        if size + 2 * width > keys.shape[0]:
            return size, v
        for u in range(width):
            c, segment = cells[v, u], ids[v, u]
            label = graph_label_of_id[segment] if c >= 0 else 0
            if label == 0:
                continue
            # Its neighbours to the left and above, where they belong to the same segment but lie in another cell.
            for direction in range(2):
                if direction == 0:
                    if u == 0 or ids[v, u - 1] != segment:
                        continue
                    other = cells[v, u - 1]
                else:
                    if v == 0 or ids[v - 1, u] != segment:
                        continue
                    other = cells[v - 1, u]
                if other < 0 or other == c:
                    continue
                first, second = min(c, other), max(c, other)
                at = (first * 7 + second) & (_RECENT - 1)
                if recent[at, 0] == first and recent[at, 1] == second and recent[at, 2] == label:
                    counts[recent[at, 3]] += 1
                    continue
                # A pair that was not met lately is looked up in the table.
                key = _key_within(first, second, cols, row0, col0, reach)
                if key == 0:
                    continue
                entry = _find_or_add(key, label, slots, mask, keys, labels, counts, size)
                if entry == size:
                    size += 1
                counts[entry] += 1
                recent[at, 0], recent[at, 1], recent[at, 2], recent[at, 3] = first, second, label, entry
    return size, height


@njit(cache=True, nogil=True)
def _rehash(
    slots: NDArray,  # out int32 [power of two], all -1
    keys: NDArray,  # uint64 [room]
    labels: NDArray,  # int16 [room]
    size: int,
) -> None:
    """Find a slot for every entry."""
    mask = slots.shape[0] - 1
    for entry in range(size):
        at = _slot_of(keys[entry], labels[entry], mask)
        while slots[at] >= 0:
            at = (at + 1) & mask
        slots[at] = entry


@njit(cache=True, nogil=True)
def _add_entries(
    new_keys: NDArray,  # uint64 [n]
    new_labels: NDArray,  # int16 [n]
    new_counts: NDArray,  # int64 [n]
    slots: NDArray,  # in/out, as the four that follow
    keys: NDArray,
    labels: NDArray,
    counts: NDArray,
    size: int,
) -> int:
    """Add counted pairs to a table that has room for them; return the new number of entries."""
    mask = slots.shape[0] - 1
    for i in range(len(new_keys)):
        entry = _find_or_add(new_keys[i], new_labels[i], slots, mask, keys, labels, counts, size)
        if entry == size:
            size += 1
        counts[entry] += new_counts[i]
    return size


@dataclass(frozen=True, eq=False)
class Links:
    """Counted cell pairs. All arrays aligned."""

    cells: NDArray
    """int32 [n, 4]: (row_a, col_a, row_b, col_b) counted from the map's origin."""
    labels: NDArray
    """int16 [n], class index."""
    counts: NDArray
    """int64 [n]."""


class LinkTable:
    """Counts of cell pairs by class; entries keep the order in which they were first seen."""

    def __init__(self, *, room: int = 1 << 17, frame_room: int = 1 << 13) -> None:
        """Make an empty table with room for so many entries at first; it grows when needed."""
        self._all, self._frame = _Table(room), _Table(frame_room)

    @property
    def size(self) -> int:
        """Number of entries."""
        return self._all.size

    @property
    def nbytes(self) -> int:
        """Bytes of memory."""
        return self._all.nbytes + self._frame.nbytes

    def add_frame(
        self, cells: NDArray, ids: NDArray, graph_label_of_id: NDArray, *, row0: int, col0: int, cols: int, reach: int
    ) -> None:
        """Count the links of one frame.

        Args:
            cells: int32 [H, W], cell of each pixel in a window of ``cols`` columns (row * cols + col), -1 = none.
            ids: int32 [H, W], its segment.
            graph_label_of_id: int16 [max id + 1], the segment's class, 0 where it gets no graph.
            row0: the window's first row, in cells from the map's origin.
            col0: its first column.
            cols: its columns.
            reach: cells farther apart than this are a depth jump; < 0 = nothing is.
        """
        frame = self._frame  # counted apart: it fits the processor's cache, and `last_frame` returns it alone
        frame.clear()
        row = 0
        while True:
            frame.size, row = count_links(
                cells, ids, graph_label_of_id, row0, col0, cols, reach,
                frame.slots, frame.keys, frame.labels, frame.counts, frame.size, row,
            )  # fmt: skip
            if row == len(cells):
                break
            frame.grow(max(2 * len(frame.keys), frame.size + 4 * cells.shape[1]))
        self._all.add(frame.keys[: frame.size], frame.labels[: frame.size], frame.counts[: frame.size])

    def last_frame(self) -> Links:
        """Return the links of the frame added last, in the order it met them. Copies."""
        return _links(self._frame, 0)

    def add(self, links: Links) -> None:
        """Add links counted elsewhere."""
        halves = [
            ((row.astype(np.int64) + _HALF) << 16 | (col.astype(np.int64) + _HALF)).astype(np.uint64)
            for row, col in (links.cells[:, :2].T, links.cells[:, 2:].T)
        ]
        self._all.add(halves[0] << np.uint64(32) | halves[1], links.labels, links.counts)

    def merge(self, other: "LinkTable") -> None:
        """Add the counts of another table."""
        theirs = other._all
        self._all.add(theirs.keys[: theirs.size], theirs.labels[: theirs.size], theirs.counts[: theirs.size])

    def entries(self, start: int = 0) -> tuple[NDArray, NDArray, NDArray]:
        """Return the entries from ``start`` on.

        Returns:
            cells int32 [n, 4]: (row_a, col_a, row_b, col_b) counted from the map's origin; labels int16 [n];
            counts int64 [n]. Copies.
        """
        links = _links(self._all, start)
        return links.cells, links.labels, links.counts


class _Table:
    """Entries in the order they came, and slots to find them again; at most half of the slots are ever used."""

    def __init__(self, room: int) -> None:
        self.size = 0
        self.slots = np.full(2 * room, -1, dtype=np.int32)
        self.keys = np.zeros(room, dtype=np.uint64)
        self.labels = np.zeros(room, dtype=np.int16)
        self.counts = np.zeros(room, dtype=np.int64)

    @property
    def nbytes(self) -> int:
        return self.slots.nbytes + self.keys.nbytes + self.labels.nbytes + self.counts.nbytes

    def clear(self) -> None:
        self.size = 0
        self.slots.fill(-1)

    def grow(self, room: int) -> None:
        """Make room for that many entries."""
        for name in ("keys", "labels", "counts"):
            old = getattr(self, name)
            grown = np.zeros(room, dtype=old.dtype)
            grown[: self.size] = old[: self.size]
            setattr(self, name, grown)
        self.slots = np.full(1 << (2 * room - 1).bit_length(), -1, dtype=np.int32)
        _rehash(self.slots, self.keys, self.labels, self.size)

    def add(self, keys: NDArray, labels: NDArray, counts: NDArray) -> None:
        """Add counted pairs."""
        if self.size + len(keys) > len(self.keys):
            self.grow(max(2 * len(self.keys), self.size + len(keys)))
        self.size = _add_entries(keys, labels, counts, self.slots, self.keys, self.labels, self.counts, self.size)


def _links(table: _Table, start: int) -> Links:
    keys = table.keys[start : table.size]
    parts = [((keys >> np.uint64(shift)) & np.uint64(0xFFFF)).astype(np.int32) - _HALF for shift in (48, 32, 16, 0)]
    return Links(
        np.stack(parts, axis=1) if len(keys) else np.zeros((0, 4), np.int32),
        table.labels[start : table.size].copy(),
        table.counts[start : table.size].copy(),
    )
