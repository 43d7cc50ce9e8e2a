"""Grouping what communities were seen as: rows that agree in community, frame and segment."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Groups:
    """Rows sorted by community, then frame, then segment, those that agree in all three side by side."""

    order: NDArray
    """int64 [n], the rows so sorted; equal ones as they came."""
    start: NDArray
    """int64 [g], where in ``order`` each group starts."""

    @property
    def first(self) -> NDArray:
        """int64 [g], the first row of each group."""
        return self.order[self.start]

    @property
    def size(self) -> NDArray:
        """int64 [g], rows of each group."""
        return np.diff(self.start, append=len(self.order))

    @property
    def of_row(self) -> NDArray:
        """int64 [n], the group of each row."""
        group = np.empty(len(self.order), np.int64)
        group[self.order] = np.repeat(np.arange(len(self.start)), self.size)
        return group


def group_views(community: NDArray, frame: NDArray, segment: NDArray) -> Groups:
    """Group rows of views or readings; all numbers are whole and from 0, [n] each."""
    columns = [column.astype(np.int64, copy=False) for column in (community, frame, segment)]
    widths = [int(column.max(initial=0)).bit_length() for column in columns]
    if sum(widths) < 64:  # one key is sorted faster than three
        key = (columns[0] << widths[1] | columns[1]) << widths[2] | columns[2]
        order = np.argsort(key, kind="stable")
        keys = [key[order]]
    else:
        order = np.lexsort(columns[::-1])
        keys = [column[order] for column in columns]
    starts = np.ones(len(order), bool)
    starts[1:] = np.logical_or.reduce([key[1:] != key[:-1] for key in keys])
    return Groups(order, np.flatnonzero(starts))
