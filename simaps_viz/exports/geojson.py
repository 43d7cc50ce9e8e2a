"""GeoJSON of the instances, in local metres.

The coordinates are x (east) and y (north) of the map frame in metres. RFC 7946 knows longitude and latitude only, so a
reader that does not know better takes them for degrees; the foreign member ``coordinates_are`` says what they are.
"""

import json
from pathlib import Path
from typing import Any

from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import origin, polygons_m, record
from simaps_viz.structures import Instance, SIMap


class GeoJSON(Exporter):
    """The instances as polygons."""

    endings = (".geojson", ".json")
    own_endings = (".geojson",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return a FeatureCollection with one feature for each instance: its outline with holes, and its record."""
        collection = {
            "type": "FeatureCollection",
            "coordinates_are": {
                "frame": "map: x east, y north, floor at z = 0; no geographic reference system",
                "unit": "metre",
                "T_map_world": [list(map(float, row)) for row in simap.T_map_world],
            },
            "map": origin(simap),
            "bbox": [round(v, 9) for v in simap.spec.extent_m],
            "features": [_feature(simap, instance) for instance in simap.instances],
        }
        return {path: json.dumps(collection, ensure_ascii=False, indent=1).encode()}


def _feature(simap: SIMap, instance: Instance) -> dict[str, Any]:
    polygons = polygons_m(simap, instance)
    one = len(polygons) == 1
    geometry = {"type": "Polygon" if one else "MultiPolygon", "coordinates": polygons[0] if one else polygons}
    return {"type": "Feature", "id": instance.id, "geometry": geometry, "properties": record(simap, instance)}
