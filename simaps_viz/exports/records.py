"""The instances as records: names, colours, numbers, exact outlines; and the files made of them: CSV, GeoJSON, JSON.

GeoJSON is in local metres: x (east) and y (north) of the map frame. RFC 7946 knows longitude and latitude only, so a
reader that does not know better takes them for degrees; the foreign member ``coordinates_are`` says what they are.
"""

import csv
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from simaps_viz.colors.classes import class_color
from simaps_viz.colors.instances import class_colors, color_of_instance
from simaps_viz.colors.palette import Color
from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.mapping.in_space import all_instances, has_voxels
from simaps_viz.structures import GridSpec, Instance, Room, SIMap

COLUMNS: tuple[str, ...] = (
    "id", "name", "label", "cells", "area_m2", "x_m", "y_m", "z_m", "x_min_m", "y_min_m", "z_min_m",
    "x_max_m", "y_max_m", "z_max_m", "frames", "score", "color", "outline_wkt",
)  # fmt: skip
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
"""A spreadsheet would compute a text that starts so; a quote before it makes it text."""

Ring = list[tuple[int, int]]
"""Grid corners (col, row), not closed: the last is joined to the first."""


class CSV(Exporter):
    """The instances as a table, with their outlines as well-known text."""

    endings = own_endings = (".csv",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return a CSV (RFC 4180, UTF-8) with a header line and a line for each instance."""
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, COLUMNS)
        writer.writeheader()
        for instance in simap.instances:
            row = {**record(simap, instance), "outline_wkt": wkt(polygons_m(simap, instance))}
            formulas = {k: f"'{v}" for k, v in row.items() if isinstance(v, str) and v.startswith(FORMULA_STARTS)}
            writer.writerow(row | formulas)
        return {path: text.getvalue().encode()}


class GeoJSON(Exporter):
    """The instances and the rooms as polygons."""

    endings = (".geojson", ".json")
    own_endings = (".geojson",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return a FeatureCollection of the instances, then the rooms: their outlines with holes, and facts."""
        collection = {
            "type": "FeatureCollection",
            "coordinates_are": {
                "frame": "map: x east, y north, floor at z = 0; no geographic reference system",
                "unit": "metre",
                "T_map_world": [list(map(float, row)) for row in simap.T_map_world],
            },
            "map": origin(simap),
            "bbox": [round(v, 9) for v in simap.spec.extent_m],
            "features": [
                *(_feature(simap, instance) for instance in simap.instances),
                *(_room_feature(simap, room) for room in simap.rooms),
            ],
        }
        return {path: json.dumps(collection, ensure_ascii=False, indent=1).encode()}


def _feature(simap: SIMap, instance: Instance) -> dict[str, Any]:
    geometry = _geometry(polygons_m(simap, instance))
    return {"type": "Feature", "id": instance.id, "geometry": geometry, "properties": record(simap, instance)}


def _room_feature(simap: SIMap, room: Room) -> dict[str, Any]:
    facts = {"name": room.name, "label": "room", "kind": room.kind, "area_m2": room.area_m2, "objects": room.objects}
    geometry = _geometry(mask_polygons_m(simap.spec, simap.room_cells == room.id))
    return {"type": "Feature", "id": f"room-{room.id}", "geometry": geometry, "properties": facts}


def _geometry(polygons: list[list[list[tuple[float, float]]]]) -> dict[str, Any]:
    one = len(polygons) == 1
    return {"type": "Polygon" if one else "MultiPolygon", "coordinates": polygons[0] if one else polygons}


class Objects(Exporter):
    """The objects with their boxes, and what they stand on, under and in, as JSON."""

    endings = (".json",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return {"objects": [...]}; lengths in metres of the map frame, see `space_record`."""
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


def node_name(instance: Instance) -> str:
    """Name an instance as it is called in every export, e.g. "chair-7": its class and id."""
    return f"{instance.label}-{instance.id}"


def label_colors(simap: SIMap) -> list[Color]:
    """Return the colour on the page of every class of ``simap.grid.labels``, RGB, 0-255."""
    things = class_colors(simap)
    return [things.get(name, class_color(name)) for name in simap.grid.labels]


def record(simap: SIMap, instance: Instance) -> dict[str, Any]:
    """Return an instance flat and JSON-able; lengths in metres of the map frame."""
    (x_min, y_min, z_min), (x_max, y_max, z_max) = instance.aabb_m
    x, y, z = instance.centroid_m
    metres = {
        "x_m": x, "y_m": y, "z_m": z, "x_min_m": x_min, "y_min_m": y_min, "z_min_m": z_min,
        "x_max_m": x_max, "y_max_m": y_max, "z_max_m": z_max,
    }  # fmt: skip
    return {
        "id": instance.id,
        "name": node_name(instance),
        "label": instance.label,
        "cells": instance.cells,
        "area_m2": round(instance.area_m2(simap.spec.cell_size_m), 6),
        **{key: round(value, 6) for key, value in metres.items()},
        "frames": instance.frames,
        "score": round(instance.score, 6),
        "color": "#{:02x}{:02x}{:02x}".format(*color_of_instance(simap, instance.id)),
    }


def space_record(instance: Instance) -> dict[str, Any]:
    """Return where an instance is in space, JSON-able; lengths in metres of the map frame.

    Keys: ``center_m``, ``size_m`` (length, width, height) and ``yaw_rad`` (of the length, counter-clockwise from x) of
    its box; ``on``, the object it stands on, or null; ``under`` and ``in``, lists of objects; ``shares`` {"on",
    "under", "in": {object: share of the instance's cells}}; ``voxels`` of 5 cm; ``color``, the median of its surface.
    All null or empty for an instance without a voxel, or a sliver.
    """
    space = instance.in_space
    box = None if space is None else space.box
    relations = {"on": instance.on, "under": instance.under, "in": instance.inside}
    return {
        "center_m": None if box is None else [round(v, 4) for v in box.center_m],
        "size_m": None if box is None else [round(v, 4) for v in box.size_m],
        "yaw_rad": None if box is None else round(box.yaw_rad, 5),
        "on": next(iter(instance.on), None),
        "under": list(instance.under),
        "in": list(instance.inside),
        "shares": {name: {str(i): round(v, 3) for i, v in found.items()} for name, found in relations.items()},
        "voxels": 0 if space is None else space.voxels,
        "color": None if space is None else "#{:02x}{:02x}{:02x}".format(*space.color),
    }


def origin(simap: SIMap) -> dict[str, Any]:
    """Describe where an export comes from, JSON-able."""
    return {
        "name": simap.provenance.get("name"),
        "method": simap.method,
        "segmentation": simap.provenance.get("segmentation"),
        "simulated": bool(simap.provenance.get("simulated", False)),
    }


def outlines(mask: NDArray) -> list[list[Ring]]:
    """Return the polygons that cover exactly the cells of a mask.

    One polygon for each 4-connected patch: its outer ring counter-clockwise (x right, y up), then its holes clockwise.
    Rings are simple: patches and holes that touch at a corner only are kept apart, as OGC simple features want it.

    Args:
        mask: bool [rows, cols].
    """
    patches, count = ndimage.label(mask)  # pyright: ignore[reportGeneralTypeIssues]
    polygons = []
    for number, where in enumerate(ndimage.find_objects(patches, count), start=1):
        offset = (where[1].start, where[0].start)
        rings = [_corners(ring) for ring in _rings(np.asarray(patches)[where] == number)]
        rings.sort(key=_signed_area, reverse=True)  # the outer ring alone is positive
        polygons.append([[(x + offset[0], y + offset[1]) for x, y in ring] for ring in rings])
    return polygons


def polygons_m(simap: SIMap, instance: Instance) -> list[list[list[tuple[float, float]]]]:
    """Return an instance's polygons in metres, map frame; the last point of every ring is its first."""
    (x_low, y_low, _), (x_high, y_high, _) = instance.aabb_m
    spec, half = simap.spec, simap.spec.cell_size_m / 2
    row, col = np.maximum(spec.cell_of(x_low + half, y_low + half), 1) - np.int64(1)  # a cell more, against rounding
    row_end, col_end = np.array(spec.cell_of(x_high - half, y_high - half)) + 2
    mask = simap.instance[row:row_end, col:col_end] == instance.id
    return [[_in_metres(spec, ring, int(col), int(row)) for ring in rings] for rings in outlines(mask)]


def mask_polygons_m(spec: GridSpec, mask: NDArray) -> list[list[list[tuple[float, float]]]]:
    """Return the polygons of a mask, bool [rows, cols], in metres, map frame; rings are closed."""
    return [[_in_metres(spec, ring, 0, 0) for ring in rings] for rings in outlines(mask)]


def wkt(polygons: list[list[list[tuple[float, float]]]]) -> str:
    """Write polygons as well-known text, always a MULTIPOLYGON."""
    rings = [[", ".join(f"{x:.10g} {y:.10g}" for x, y in ring) for ring in polygon] for polygon in polygons]
    return "MULTIPOLYGON (" + ", ".join("(" + ", ".join(f"({r})" for r in p) + ")" for p in rings) + ")"


def _in_metres(spec: GridSpec, ring: Ring, col: int, row: int) -> list[tuple[float, float]]:
    s = spec.cell_size_m
    points = [(round(spec.x0_m + (x + col) * s, 9), round(spec.y0_m + (y + row) * s, 9)) for x, y in ring]
    return [*points, points[0]]


def _rings(patch: NDArray) -> Iterator[Ring]:
    """Walk along the borders of one 4-connected patch, the patch on the left; cut the walk where it meets itself."""
    leaving = _border_steps(patch)
    while leaving:
        walk: Ring = [next(iter(leaving))]
        at = {walk[0]: 0}
        while True:
            ends = leaving[walk[-1]]
            corner = ends.pop()
            if not ends:
                del leaving[walk[-1]]
            if corner not in at:
                at[corner] = len(walk)
                walk.append(corner)
                continue
            start = at[corner]
            yield walk[start:]
            for left in walk[start + 1 :]:
                del at[left]
            del walk[start + 1 :]
            if start == 0 and corner not in leaving:
                break


def _border_steps(patch: NDArray) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Return {corner: corners one edge further} for all cell edges with the patch on the left and none on the right."""
    padded = np.pad(patch, 1)
    sides = (  # of a cell: its neighbour there, then where the edge starts and ends
        ((-1, 0), (0, 0), (1, 0)),
        ((0, 1), (1, 0), (1, 1)),
        ((1, 0), (1, 1), (0, 1)),
        ((0, -1), (0, 1), (0, 0)),
    )
    rows, cols = patch.shape
    leaving: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for (dr, dc), (ax, ay), (bx, by) in sides:
        bare = patch & ~padded[1 + dr : 1 + dr + rows, 1 + dc : 1 + dc + cols]
        for row, col in np.argwhere(bare).tolist():
            leaving.setdefault((col + ax, row + ay), []).append((col + bx, row + by))
    return leaving


def _corners(ring: Ring) -> Ring:
    """Leave out the points at which a ring does not turn."""
    around = zip(ring[-1:] + ring[:-1], ring, ring[1:] + ring[:1], strict=True)
    return [b for a, b, c in around if not (a[0] == b[0] == c[0] or a[1] == b[1] == c[1])]


def _signed_area(ring: Ring) -> float:
    """Compute the area by the shoelace formula, cells; positive when counter-clockwise."""
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(ring, ring[1:] + ring[:1], strict=True)) / 2.0
