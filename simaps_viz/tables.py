"""What the command line prints as tables."""

from typing import Any

from rich.table import Table

from simaps_viz.mapping.edit_log import people_in_words


def map_tables(facts: dict[str, Any]) -> list[Table]:
    """Lay out a map's facts, as `wiring.summary` gives them: the map, then its instances."""
    head = Table(show_header=False, box=None, title=f"{facts['name']}", title_justify="left")
    rows = {
        "method": _method(facts),
        "grid": f"{facts['rows']} x {facts['cols']} cells of {facts['cell_size_m']:g} m",
        "seen": f"{facts['seen_m2']:.1f} m² in {facts['frames']} frames",
        "segmentation": str(facts["provenance"].get("segmentation")),
        "from": str(facts["provenance"].get("sequence")),
    }
    if edits := people_in_words(facts["provenance"].get("edits", [])):
        rows["mended"] = edits
    for key, value in rows.items():
        head.add_row(key, value)
    body = Table("id", "class", "cells", "area m²", "x m", "y m", "frames", "score", title_justify="left")
    for one in facts["instances"]:
        x, y, _ = one["centroid_m"]
        area = one["cells"] * facts["cell_size_m"] ** 2
        body.add_row(str(one["id"]), one["label"], str(one["cells"]), f"{area:.2f}", f"{x:.2f}", f"{y:.2f}",
                     str(one["frames"]), f"{one['score']:.2f}")  # fmt: skip
    return [head, body]


def _method(facts: dict[str, Any]) -> str:
    parameters = facts["parameters"]
    if "k_percent" in parameters:
        return f"{facts['method']}, K = {parameters['k_percent']:g} %"
    if "affinity" in parameters:
        return f"{facts['method']}, joined above affinity {parameters['affinity']:g}"
    return str(facts["method"])
