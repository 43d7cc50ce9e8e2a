"""`simaps info`: print the contents of a map."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from simaps_viz.cli import OK

if TYPE_CHECKING:
    from rich.table import Table

    from simaps_viz.structures import SIMap


@dataclass(frozen=True)
class Info:
    """Describe what is on a map.

    Example: simaps info cafe.npz
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    edits: bool = True
    """Include the edits made by hand (MAP.edits.json)."""
    json: bool = False
    """Print it as one JSON line."""

    def run(self) -> int:
        """Print the map's facts as tables, or as JSON."""
        from simaps_viz.console.terminal import emit, show
        from simaps_viz.mapping.mending import load_mended

        facts = summary(load_mended(self.map, edits=self.edits))
        if self.json:
            emit(facts)
        else:
            show(*map_tables(facts))
        return OK


def summary(simap: "SIMap") -> dict[str, Any]:
    """Return a map's facts, JSON-able."""
    import numpy as np

    from simaps_viz.exports.records import space_record
    from simaps_viz.mapping.changes import as_json, changes_in
    from simaps_viz.mapping.in_space import all_instances, has_voxels

    spec = simap.spec
    return {
        "name": simap.provenance.get("name"),
        "method": simap.method,
        "parameters": dict(simap.parameters),
        "provenance": dict(simap.provenance),
        "rows": spec.rows,
        "cols": spec.cols,
        "cell_size_m": spec.cell_size_m,
        "extent_m": [round(v, 3) for v in spec.extent_m],
        "seen_m2": round(float(np.count_nonzero(simap.grid.observations)) * spec.cell_size_m**2, 2),
        "frames": len(simap.frame_names),
        "counts": simap.counts(),
        "colored": sum(simap.color_of(one) is not None for one in simap.instances),
        "described": simap.described,
        "boxes_from": "surface voxels" if has_voxels(simap) else "columns",
        "instances": [{**asdict(one), **space_record(one)} for one in all_instances(simap)],
        "changes": as_json(changes_in(simap)),
        "rooms": [
            {name: getattr(room, name) for name in ("id", "name", "polygon_m", "area_m2", "objects")}
            for room in simap.rooms
        ],
    }


def map_tables(facts: dict[str, Any]) -> "list[Table]":
    """Lay out a map's facts, see `summary`: a table of the map, then one of its instances."""
    from rich.table import Table

    from simaps_viz.mapping.edit_log import people_in_words

    head = Table(show_header=False, box=None, title=f"{facts['name']}", title_justify="left")
    rows = {
        "method": _method(facts),
        "grid": f"{facts['rows']} x {facts['cols']} cells of {facts['cell_size_m']:g} m",
        "seen": f"{facts['seen_m2']:.1f} m² in {facts['frames']} frames",
        "segmentation": str(facts["provenance"].get("segmentation")),
        "from": str(facts["provenance"].get("sequence")),
    }
    if facts["described"]:
        rows["described"] = "free words are understood, see simaps describe"
    if facts["rooms"]:
        rows["rooms"] = ", ".join(f"{room['name']} ({room['area_m2']:.1f} m²)" for room in facts["rooms"])
    if edits := people_in_words(facts["provenance"].get("edits", [])):
        rows["mended"] = edits
    if facts["changes"]:
        rows["changed"] = ", ".join(f"{one['label']} {one['kind']}" for one in facts["changes"])
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
