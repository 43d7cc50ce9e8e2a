"""The layers of a map that was opened: checked at once, unpacked only when somebody asks for one.

Few uses of a map need all of its layers, and those of a building of 500 m x 500 m take 0.4 GB each.
"""

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from simaps_viz.io.arrays import Rows, check_ends
from simaps_viz.structures import CellGraph, Grid, SIMap

EDGES = ("edge_first", "edge_step", "edge_count", "edge_different")
"""The arrays of a map file with an entry for each edge: flat cell, how many cells further the other end lies, counts
and different of `CellGraph`. Class by class."""
_TOGETHER = 1 << 20  # edges looked at


class StoredGraph(CellGraph):
    """A graph whose cells and edges are found when first asked for, and then kept. Threads may share it."""

    def __init__(self, grid: Grid, label: int, span: slice, rows: Mapping[str, Rows], *, evidence: bool) -> None:
        """Remember where the edges lie.

        Args:
            grid: the map.
            label: index of the class.
            span: of its edges in ``rows``.
            rows: `EDGES`, checked by `check_edges`.
            evidence: of method evidence.
        """
        vars(self).update(label=label, _grid=grid, _span=span, _rows=rows, _evidence=evidence, _lock=threading.RLock())

    def __getattr__(self, name: str) -> Any:
        """Find what is not there yet."""
        find = _PARTS.get(name)
        if find is None:
            raise AttributeError(name)
        with self._lock:
            if name not in vars(self):
                vars(self).update(find(self))
        return vars(self)[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return CellGraph, (self.label, self.cells, self.edges, self.counts, self.different, self.seen)

    def _find_cells(self) -> dict[str, Any]:
        cells = np.flatnonzero(self._grid.label.reshape(-1) == self.label)
        return {"cells": cells, "seen": None if self._evidence else self._grid.observations.reshape(-1)[cells]}

    def _find_edges(self) -> dict[str, NDArray]:
        first, stop = self._span.start, self._span.stop
        edges = np.zeros((stop - first, 2), dtype=np.int32)
        for block in _blocks(self._span):
            one = self._rows["edge_first"][block]
            here = edges[block.start - first : block.stop - first]
            here[:, 0] = np.searchsorted(self.cells, one)
            here[:, 1] = np.searchsorted(self.cells, one + self._rows["edge_step"][block])
        counts, different = (self._rows[name][self._span] for name in EDGES[2:])
        return {"edges": edges, "counts": counts, "different": different}


_PARTS = {
    "cells": StoredGraph._find_cells, "seen": StoredGraph._find_cells,
    "edges": StoredGraph._find_edges, "counts": StoredGraph._find_edges, "different": StoredGraph._find_edges,
}  # fmt: skip


def stored_graphs(
    grid: Grid, graph_label: NDArray, graph_edges: NDArray, rows: Mapping[str, Rows], *, evidence: bool
) -> tuple[StoredGraph, ...]:
    """Return the graphs of a map file.

    Raises:
        ValueError: edges leave the cells of their class, or lead backwards, or were counted less than never.
        InputError: what is packed is damaged.
    """
    ends = np.cumsum(graph_edges).tolist()
    spans = [slice(stop - edges, stop) for stop, edges in zip(ends, graph_edges.tolist(), strict=True)]
    for label, span in zip(graph_label.tolist(), spans, strict=True):
        for block in _blocks(span):
            _check_edges(grid.label.reshape(-1), label, *(rows[name][block] for name in EDGES))
    check_ends(rows[name] for name in EDGES)
    return tuple(
        StoredGraph(grid, label, span, rows, evidence=evidence)
        for label, span in zip(graph_label.tolist(), spans, strict=True)
    )


def edge_parts(graphs: Sequence[CellGraph], name: str) -> Iterator[NDArray]:
    """Return one of `EDGES` of some graphs, part by part."""
    for graph in graphs:
        for block in _blocks(slice(0, len(graph.edges))):
            first, second = graph.edges[block].T
            if name == "edge_first":
                yield graph.cells[first]
            elif name == "edge_step":
                yield graph.cells[second] - graph.cells[first]  # small numbers pack well
            else:
                yield (graph.counts if name == "edge_count" else graph.different)[block]


def _check_edges(
    of_cell: NDArray, label: int, first: NDArray, step: NDArray, counts: NDArray, different: NDArray
) -> None:
    second = first.astype(np.int64) + step
    if int(step.min()) <= 0:
        raise ValueError(f"edges of class {label} that lead backwards")
    inside = int(first.min()) >= 0 and int(second.max()) < len(of_cell)
    if not inside or (of_cell[first] != label).any() or (of_cell[second] != label).any():
        raise ValueError(f"edges of class {label} leave its cells")
    if int(counts.min()) < 0 or int(different.min()) < 0:
        raise ValueError("edge counts")


def _blocks(span: slice) -> list[slice]:
    return [slice(at, min(at + _TOGETHER, span.stop)) for at in range(span.start, span.stop, _TOGETHER)]


LAYERS = ("height", "lowest", "observations", "community")
"""The arrays of a map file that are such layers."""


class _Unpacking:
    """Fields that are found when first asked for, and then kept. Threads may share it."""

    @classmethod
    def of(cls, layers: Mapping[str, Rows], **known: Any) -> Self:
        """Make it of the fields that are there, and those that stay packed; both were checked."""
        made = cls.__new__(cls)
        vars(made).update(known, _layers=layers, _lock=threading.Lock())
        return made

    def __getattr__(self, name: str) -> Any:
        known = vars(self)
        if name not in known.get("_layers", ()):
            raise AttributeError(f"{type(self).__name__} has no {name}")
        with known["_lock"]:
            if name not in known:
                layer: NDArray = known["_layers"][name][:]
                known[name] = layer
        return known[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, one.name) for one in fields(self))  # pyright: ignore[reportArgumentType]


class StoredGrid(_Unpacking, Grid):
    """A grid with packed layers."""


class StoredMap(_Unpacking, SIMap):
    """A map with packed layers."""
