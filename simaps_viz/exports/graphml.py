"""GraphML of the cell graph: which cells were seen as one object, and how often.

Written directly rather than through networkx, whose writer takes tens of seconds for a whole house;
`networkx.read_graphml` returns the graph of `to_networkx`.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import escape

from simaps_viz.errors import InputError
from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.structures import CellGraph, SIMap

_KEYS: Final = {
    "graph": {"name": "string", "method": "string", "cell_size_m": "double", "x0_m": "double", "y0_m": "double"},
    "node": {"row": "int", "col": "int", "x_m": "double", "y_m": "double", "height_m": "double", "label": "string",
             "instance": "int"},
    "edge": {"count": "int", "different": "int", "weight": "double"},
}  # fmt: skip

_ILLEGAL: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, escaped or not."""


class GraphML(Exporter):
    """The cell graph."""

    endings = own_endings = (".graphml",)
    options = ("class",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return the cell graph of a class, or of all classes side by side (no edge joins two).

        Nodes are named "row,col" and carry ``row``, ``col``, ``x_m``, ``y_m``, ``height_m``, ``label``, ``instance``;
        edges ``count``, ``different`` and ``weight``.

        Raises:
            InputError: the map has no cells of that class.
        """
        labels, label = simap.grid.labels, options.label
        graphs = [graph for graph in simap.graphs if label in (None, labels[graph.label])]
        if label is not None and not graphs:
            known = ", ".join(labels[graph.label] for graph in simap.graphs)
            raise InputError(f"class {label!r}: expected one with a graph on this map ({known})")
        lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">']
        for owner, keys in _KEYS.items():
            lines += [
                f'<key id="{owner}.{name}" for="{owner}" attr.name="{name}" attr.type="{kind}"/>'
                for name, kind in keys.items()
            ]
        spec = simap.spec
        about = {
            "name": str(simap.provenance.get("name") or ""), "method": simap.method, "cell_size_m": spec.cell_size_m,
            "x0_m": spec.x0_m, "y0_m": spec.y0_m,
        }  # fmt: skip
        lines += ['<graph edgedefault="undirected">', _data("graph", about)]
        for graph in graphs:
            lines += _nodes(simap, graph)
        for graph in graphs:
            lines += _edges(simap, graph)
        return {path: "\n".join([*lines, "</graph>", "</graphml>", ""]).encode()}


def _nodes(simap: SIMap, graph: CellGraph) -> Iterator[str]:
    label = simap.grid.labels[graph.label]
    heights = simap.grid.height_m.reshape(-1)[graph.cells].tolist()
    instances = simap.instance.reshape(-1)[graph.cells].tolist()
    for (row, col), height, instance in zip(_cells(simap, graph), heights, instances, strict=True):
        x, y = simap.spec.centre_of(row, col)
        known = {"row": row, "col": col, "x_m": round(x, 9), "y_m": round(y, 9), "height_m": height, "label": label,
                 "instance": instance}  # fmt: skip
        yield f'<node id="{row},{col}">{_data("node", known)}</node>'


def _edges(simap: SIMap, graph: CellGraph) -> Iterator[str]:
    names = [f"{row},{col}" for row, col in _cells(simap, graph)]
    columns = (graph.edges.tolist(), graph.counts.tolist(), graph.different.tolist(), graph.weights.tolist())
    for (a, b), count, different, weight in zip(*columns, strict=True):
        known = {"count": count, "different": different, "weight": weight}
        yield f'<edge source="{names[a]}" target="{names[b]}">{_data("edge", known)}</edge>'


def _cells(simap: SIMap, graph: CellGraph) -> list[tuple[int, int]]:
    return [divmod(cell, simap.spec.cols) for cell in graph.cells.tolist()]


def _data(owner: str, known: dict[str, Any]) -> str:
    return "".join(
        f'<data key="{owner}.{name}">{escape(_ILLEGAL.sub(" ", str(value)))}</data>' for name, value in known.items()
    )
