"""Maps as graphs: the cell graph as GraphML, and the objects and rooms as a scene graph of MIT's Spark-DSG (Hydra).

GraphML says which cells were seen as one object, and how often. It is written directly rather than through networkx,
whose writer takes tens of seconds for a whole house; `networkx.read_graphml` returns the graph of `to_networkx`.

In the scene graph every instance is an object, every room has the objects in it, and rooms with an opening between them
are joined by an edge. Field names, node numbers and layers are those version 1.1.3 of Spark-DSG's Python package writes
and reads; it opens what is written here.
"""

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import escape

import networkx as nx
import numpy as np

from simaps_viz.colors.instances import color_of_instance
from simaps_viz.colors.palette import Color, color_of_number
from simaps_viz.errors import InputError
from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import node_name, record, space_record
from simaps_viz.mapping.in_space import all_instances, has_voxels
from simaps_viz.structures import Box, CellGraph, Instance, Room, SIMap

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


VERSION: Final = {"major": 1, "minor": 1, "patch": 3}
OBJECTS: Final = 2
ROOMS: Final = 4
NO_LABEL: Final = 2**32 - 1
_LAYERS: Final = {"OBJECTS": OBJECTS, "PLACES": 3, "ROOMS": ROOMS, "BUILDINGS": 5}
_UPRIGHT: Final = {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}


def node_number(layer: str, index: int) -> int:
    """Return the number of a node: its layer's letter in the top byte, its index below (Spark-DSG's NodeSymbol)."""
    return ord(layer) << 56 | index


class SparkDSG(Exporter):
    """The map as a scene graph."""

    endings = (".json",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return the scene graph as JSON; metres, map frame; boxes round voxels, or columns from the floor."""
        objects = [_object(simap, instance) for instance in all_instances(simap)]
        rooms = [_room(simap, room) for room in simap.rooms]
        inside = [
            (node_number("R", room.id), node_number("O", i)) for room in simap.rooms for i in room.objects
        ]  # fmt: skip
        beside = sorted({(room.id, door.room) for room in simap.rooms for door in room.doors if room.id < door.room})
        graph = {
            "SPARK_DSG_header": {"project_name": "main", "version": VERSION},
            "directed": False,
            "multigraph": False,
            "metadata": {
                "labelspaces": {f"_l{OBJECTS}p0": [[i, name] for i, name in enumerate(simap.grid.labels)]},
            },
            "layer_keys": [{"layer": layer, "partition": 0} for layer in _LAYERS.values()],
            "layer_names": {name: {"layer": layer, "partition": 0} for name, layer in _LAYERS.items()},
            "nodes": [*objects, *rooms],
            "edges": [
                *(_joined(*pair) for pair in inside),
                *(_joined(node_number("R", a), node_number("R", b)) for a, b in beside),
            ],
        }
        return {path: json.dumps(graph, ensure_ascii=False, indent=1).encode()}


def _object(simap: SIMap, instance: Instance) -> dict[str, Any]:
    low, high = instance.aabb_m
    color = color_of_instance(simap, instance.id)
    box = instance.box if has_voxels(simap) else None
    attributes = {
        **_attributes("ObjectNodeAttributes", node_name(instance), instance.centroid_m, color),
        "bounding_box": _turned(box) if box is not None else _box((*low[:2], min(0.0, low[2])), high),
        "semantic_label": simap.grid.labels.index(instance.label),
        "metadata": {**record(simap, instance), **(space_record(instance) if box is not None else {})},
        "mesh_connections": [],
        "registered": False,
        "world_R_object": _UPRIGHT,
    }
    return {"id": node_number("O", instance.id), "layer": OBJECTS, "partition": 0, "attributes": attributes}


def _room(simap: SIMap, room: Room) -> dict[str, Any]:
    rows, cols = np.nonzero(simap.room_cells == room.id)
    spec, s = simap.spec, simap.spec.cell_size_m
    low = (spec.x0_m + int(cols.min()) * s, spec.y0_m + int(rows.min()) * s, 0.0)
    top = float(np.fmax.reduce(simap.grid.height_m[rows, cols], initial=np.float32(0.0)))
    high = (spec.x0_m + int(cols.max() + 1) * s, spec.y0_m + int(rows.max() + 1) * s, top)
    attributes = {
        **_attributes("RoomNodeAttributes", room.name, (*room.centre_m, top / 2), color_of_number(room.id)),
        "bounding_box": _box(low, high),
        "semantic_class_probabilities": {},
        "metadata": {"kind": room.kind, "area_m2": room.area_m2},
    }
    return {"id": node_number("R", room.id), "layer": ROOMS, "partition": 0, "attributes": attributes}


def _attributes(kind: str, name: str, position: tuple[float, ...], color: Color) -> dict[str, Any]:
    r, g, b = color
    return {
        "type": kind,
        "name": name,
        "position": list(position),
        "color": {"r": r, "g": g, "b": b, "a": 255},
        "semantic_label": NO_LABEL,
        "semantic_feature": {"rows": 0, "cols": 0, "data": None},
        "metadata": {},
        "is_active": False,
        "is_predicted": False,
        "last_update_time_ns": 0,
    }


def _box(low: tuple[float, ...], high: tuple[float, ...]) -> dict[str, Any]:
    return {
        "type": "AABB",
        "dimensions": [b - a for a, b in zip(low, high, strict=True)],
        "world_P_center": [(a + b) / 2 for a, b in zip(low, high, strict=True)],
        "world_R_center": _UPRIGHT,
    }


def _turned(box: Box) -> dict[str, Any]:
    half = box.yaw_rad / 2
    return {
        "type": "RAABB",
        "dimensions": list(box.size_m),
        "world_P_center": list(box.center_m),
        "world_R_center": {"w": math.cos(half), "x": 0.0, "y": 0.0, "z": math.sin(half)},
    }


def _joined(source: int, target: int) -> dict[str, Any]:
    info = {"type": "EdgeAttributes", "weight": 1.0, "weighted": False, "metadata": {}}
    return {"source": source, "target": target, "info": info}


def to_networkx(simap: SIMap, label: str) -> nx.Graph:
    """Return the graph of a class to hold.

    Nodes are (row, col) with ``height_m`` and ``instance``; edges have ``weight``, ``count`` and ``different``.

    Raises:
        InputError: the map has no cells of that class.
    """
    for graph in simap.graphs:
        if simap.grid.labels[graph.label] == label:
            break
    else:
        known = ", ".join(simap.grid.labels[g.label] for g in simap.graphs)
        raise InputError(f"class {label!r}: expected one with a graph on this map ({known})")
    cols = simap.spec.cols
    result = nx.Graph()
    nodes = [divmod(int(c), cols) for c in graph.cells]
    for node in nodes:
        result.add_node(node, height_m=float(simap.grid.height_m[node]), instance=int(simap.instance[node]))
    evidence = zip(graph.edges, graph.counts, graph.different, graph.weights, strict=True)
    for (a, b), count, different, weight in evidence:
        result.add_edge(nodes[a], nodes[b], count=int(count), different=int(different), weight=float(weight))
    return result
