"""CSV of the instances, with their outlines as well-known text."""

import csv
import io

from simaps_viz.exports.outlines import polygons_m, wkt
from simaps_viz.exports.records import record
from simaps_viz.structures import SIMap

COLUMNS: tuple[str, ...] = (
    "id", "name", "label", "cells", "area_m2", "x_m", "y_m", "z_m", "x_min_m", "y_min_m", "z_min_m",
    "x_max_m", "y_max_m", "z_max_m", "frames", "score", "color", "outline_wkt",
)  # fmt: skip


def csv_bytes(simap: SIMap) -> bytes:
    """Give a CSV (RFC 4180, UTF-8) with a header line and a line an instance."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS)
    writer.writeheader()
    for instance in simap.instances:
        writer.writerow({**record(simap, instance), "outline_wkt": wkt(polygons_m(simap, instance))})
    return text.getvalue().encode()
