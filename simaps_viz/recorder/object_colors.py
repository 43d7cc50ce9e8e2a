"""Colours of the objects found on the way: each keeps the one it had, and at the end has that of the finished map."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.instances import Colored, colors_like, instance_colors
from simaps_viz.recorder.map_pictures import Entry, object_entries, recolored
from simaps_viz.structures import Grid, GridSpec, SIMap


@dataclass(frozen=True, eq=False)
class _Shown:
    """What was shown after a frame; its ids are packed, as a long build shows many."""

    frame: int
    spec: GridSpec
    packed: bytes
    entries: list[Entry]

    def ids(self) -> NDArray:
        return np.frombuffer(zlib.decompress(self.packed), np.int32).reshape(self.spec.shape)


class ObjectColors:
    """Remembers what the objects were, and their colours, each time they were found anew while building."""

    def __init__(self) -> None:
        self._last: Colored | None = None
        self._shown: list[_Shown] = []

    def find(self, frame: int, grid: Grid, ids: NDArray, colors: NDArray | None = None) -> list[Entry]:
        """Colour the objects found after a frame as those that were found before them.

        Args:
            frame: its index.
            grid: the map then.
            ids: int32 [rows, cols], 0 = none.
            colors: uint8 [n, 3], where they are known.
        """
        if colors is None:
            colors = colors_like(grid.spec, ids, self._last)
        entries = object_entries(grid, ids, colors)
        self._last = Colored(grid.spec, ids, colors)
        packed = zlib.compress(np.ascontiguousarray(ids, np.int32).tobytes(), level=1)
        self._shown.append(_Shown(frame, grid.spec, packed, entries))
        return entries

    def as_finished(self, simap: SIMap) -> Iterator[tuple[int, list[Entry]]]:
        """Return (frame, colours) where objects on the way looked other than what they are on the finished map."""
        finished = Colored(simap.spec, simap.instance, instance_colors(simap))
        for one in self._shown:
            entries = recolored(one.entries, colors_like(one.spec, one.ids(), finished))
            if entries != one.entries:
                yield one.frame, entries
        self._shown = []
