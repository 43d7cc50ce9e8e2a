"""GeoJSON of the instances, in local metres.

The coordinates are x (east) and y (north) of the map frame in metres. RFC 7946 knows longitude and latitude only, so a
reader that does not know better takes them for degrees; the foreign member ``coordinates_are`` says what they are.
"""

import json
from pathlib import Path
from typing import Any

from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import mask_polygons_m, origin, polygons_m, record
from simaps_viz.structures import Instance, Room, SIMap


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
