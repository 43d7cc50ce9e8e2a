"""Objects in space: their surface voxels as PLY, and their boxes and relations as JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import origin, space_record
from simaps_viz.mapping.in_space import all_instances, has_voxels, space_points
from simaps_viz.structures import SIMap

_VERTEX = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1"),
     ("class", "<i4"), ("instance", "<i4")]
)  # fmt: skip
_TYPES = {"<f4": "float", "|u1": "uchar", "<i4": "int"}


class Instances(Exporter):
    """The surface voxels with class and instance, as binary PLY."""

    endings = (".ply",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return one vertex for each surface voxel: x, y, z, red, green, blue, class (-1 none), instance (0 none)."""
        points = space_points(simap)
        vertices = np.zeros(len(points.positions), _VERTEX)
        columns: tuple[NDArray, ...] = (*points.positions.T, *points.colors.T, points.classes, points.instances)
        for name, column in zip(_VERTEX.names or (), columns, strict=True):
            vertices[name] = column
        made_of = "observed surface voxels" if has_voxels(simap) else "filled columns: the map has no voxels"
        header = [
            "ply", "format binary_little_endian 1.0", "comment map frame: metres, x east, y north, z up",
            f"comment {made_of}",
            *(f"comment class {i} {' '.join(name.split())}" for i, name in enumerate(simap.grid.labels) if i),
            f"element vertex {len(vertices)}",
            *(f"property {_TYPES[_VERTEX[name].str]} {name}" for name in _VERTEX.names or ()), "end_header",
        ]  # fmt: skip
        return {path: ("\n".join(header) + "\n").encode() + vertices.tobytes()}


class Objects(Exporter):
    """The objects with their boxes, and what they stand on, under and in, as JSON."""

    endings = (".json",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return {"objects": [...]}; lengths in metres of the map frame, see `records.space_record`."""
        room_of = {number: room.id for room in simap.rooms for number in room.objects}
        objects: list[dict[str, Any]] = []
        for one in all_instances(simap):
            if one.box is not None:
                facts = space_record(one)
                objects.append({"id": one.id, "label": one.label, **facts, "room": room_of.get(one.id)})
        about = {
            "frame": "map: x east, y north, z up, floor at z = 0", "unit": "metre", "map": origin(simap),
            "boxes_from": "surface voxels" if has_voxels(simap) else "columns",
        }  # fmt: skip
        return {path: json.dumps({**about, "objects": objects}, ensure_ascii=False, indent=1).encode()}
