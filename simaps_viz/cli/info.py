"""`simaps info`: print the contents of a map."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from simaps_viz.cli import OK

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from simaps_viz.mapping.building import Building
    from simaps_viz.structures import SIMap


@dataclass(frozen=True)
class Info:
    """Describe what is on a map, or on all floors of a building.

    Example: simaps info cafe.npz
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz), or building file (.json)."""
    edits: bool = True
    """Include the edits made by hand (MAP.edits.json)."""
    json: bool = False
    """Print it as one JSON line."""

    def run(self) -> int:
        """Print the map's facts as tables, or as JSON."""
        from simaps_viz.console.terminal import emit, show
        from simaps_viz.mapping.building import is_building, load_building
        from simaps_viz.mapping.mending import load_mended

        if is_building(self.map):
            building = load_building(self.map)
            facts = building_summary(building, [load_mended(f.map, edits=self.edits) for f in building.floors])
            tables = building_tables(facts)
        else:
            facts = summary(load_mended(self.map, edits=self.edits))
            tables = map_tables(facts)
        if self.json:
            emit(facts)
        else:
            show(*tables)
        return OK


def building_summary(building: "Building", maps: "Sequence[SIMap]") -> dict[str, Any]:
    """Return a building's facts, JSON-able; ``maps`` are those of its floors."""
    floors = []
    for floor, simap in zip(building.floors, maps, strict=True):
        facts = summary(simap)
        kept = {name: facts[name] for name in ("seen_m2", "frames", "counts", "rooms")}
        floors.append({"number": floor.number, "map": str(floor.map), "height_m": floor.height_m, **kept})
    return {"name": building.name, "floors": floors, "stairs": [asdict(one) for one in building.stairs]}


def building_tables(facts: dict[str, Any]) -> "list[Table]":
    """Lay out a building's facts, see `building_summary`: a table of its floors, then one of its stairs."""
    from rich.table import Table

    from simaps_viz.colors.classes import plural

    floors = Table("floor", "height m", "seen m²", "frames", "objects", "map", title=f"{facts['name']}",
                   title_justify="left")  # fmt: skip
    for one in facts["floors"]:
        objects = ", ".join(plural(n, label) for label, n in one["counts"].items())
        floors.add_row(str(one["number"]), f"{one['height_m']:.2f}", f"{one['seen_m2']:.1f}", str(one["frames"]),
                       objects, one["map"])  # fmt: skip
    stairs = Table("stairs", "from x, y m", "to x, y m", title_justify="left")
    for one in facts["stairs"]:
        ends = (", ".join(f"{v:.2f}" for v in one[end]) for end in ("foot_m", "head_m"))
        stairs.add_row(f"floor {one['lower']} to {one['lower'] + 1}", *ends)
    return [floors, stairs]


def summary(simap: "SIMap") -> dict[str, Any]:
    """Return a map's facts, JSON-able."""
    import numpy as np

    from simaps_viz.drawing.legend import counted, not_counted
    from simaps_viz.exports.records import space_record
    from simaps_viz.mapping.changes import as_json, changes_in
    from simaps_viz.mapping.in_space import all_instances, has_voxels

    spec, uncounted = simap.spec, not_counted(simap, simap.doubtful)
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
        "counts": counted(simap),
        "colored": sum(simap.color_of(one) is not None for one in simap.instances),
        "described": simap.described,
        "boxes_from": "surface voxels" if has_voxels(simap) else "columns",
        "instances": [
            {**asdict(one), **space_record(one), "not_counted": uncounted.get(one.id, "")}
            for one in all_instances(simap)
        ],
        "changes": as_json(changes_in(simap)),
        "rooms": [
            {name: getattr(room, name) for name in ("id", "name", "polygon_m", "area_m2", "objects")}
            for room in simap.rooms
        ],
    }


def map_tables(facts: dict[str, Any]) -> "list[Table]":
    """Lay out a map's facts, see `summary`: a table of the map, then one of its instances."""
    from rich.table import Table

    from simaps_viz.colors.classes import plural
    from simaps_viz.mapping.mending import people_in_words

    head = Table(show_header=False, box=None, title=f"{facts['name']}", title_justify="left")
    rows = {
        "method": _method(facts),
        "grid": f"{facts['rows']} x {facts['cols']} cells of {facts['cell_size_m']:g} m",
        "seen": f"{facts['seen_m2']:.1f} m² in {facts['frames']} frames",
        "segmentation": str(facts["provenance"].get("segmentation")),
    }
    faint = sum(one["not_counted"] == "doubtful" for one in facts["instances"])
    counts = [plural(n, label) for label, n in facts["counts"].items()]
    rows["objects"] = ", ".join([*counts, *[f"{faint} more doubtful"] * (faint > 0)]) or "none"
    if sequence := facts["provenance"].get("sequence"):
        rows["from"] = str(sequence)
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
        label = ", ".join(filter(None, (one["label"], one["not_counted"])))
        body.add_row(str(one["id"]), label, str(one["cells"]), f"{area:.2f}", f"{x:.2f}", f"{y:.2f}",
                     str(one["frames"]), f"{one['score']:.2f}")  # fmt: skip
    return [head, body]


def _method(facts: dict[str, Any]) -> str:
    parameters = facts["parameters"]
    if "k_percent" in parameters:
        return f"{facts['method']}, K = {parameters['k_percent']:g} %"
    if "affinity" in parameters:
        return f"{facts['method']}, joined above affinity {parameters['affinity']:g}"
    return str(facts["method"])
