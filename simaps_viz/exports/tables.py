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


FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
"""A spreadsheet would compute a text that starts so; a quote before it makes it text."""


def csv_bytes(simap: SIMap) -> bytes:
    """Return a CSV (RFC 4180, UTF-8) with a header line and a line an instance."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS)
    writer.writeheader()
    for instance in simap.instances:
        row = {**record(simap, instance), "outline_wkt": wkt(polygons_m(simap, instance))}
        writer.writerow({key: _as_text(value) if isinstance(value, str) else value for key, value in row.items()})
    return text.getvalue().encode()


def _as_text(value: str) -> str:
    return f"'{value}" if value.startswith(FORMULA_STARTS) else value
