"""A scene graph that MIT's Spark-DSG (Hydra) opens: every instance an object, every room with the objects in it.

Field names, node numbers and layers are those version 1.1.3 of its Python package writes and reads; it opens what is
written here. Rooms with an opening between them are joined by an edge.
"""

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from simaps_viz.colors.instances import color_of_instance
from simaps_viz.colors.palette import Color, color_of_number
from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import node_name, record, space_record
from simaps_viz.mapping.in_space import all_instances, has_voxels
from simaps_viz.structures import Box, Instance, Room, SIMap

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
                *(_edge(*pair) for pair in inside),
                *(_edge(node_number("R", a), node_number("R", b)) for a, b in beside),
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


def _edge(source: int, target: int) -> dict[str, Any]:
    info = {"type": "EdgeAttributes", "weight": 1.0, "weighted": False, "metadata": {}}
    return {"source": source, "target": target, "info": info}
