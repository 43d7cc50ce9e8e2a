"""Maps in the formats of other programs: one object a format; `formats.export_map` writes one.

This registry names the formats without loading their code, for the command line lists them before it loads one.
"""

from typing import TYPE_CHECKING, Final, Literal

REGISTRY: Final = {
    "ros": "ros.ROSMap",
    "nav2": "ros.Nav2Maps",
    "geojson": "geojson.GeoJSON",
    "csv": "records.CSV",
    "glb": "glb.GLB",
    "ply": "ply.PLY",
    "coco": "panoptic.COCOPanoptic",
    "graphml": "graphml.GraphML",
    "spark-dsg": "scene_graph.SparkDSG",
    "instances": "space.Instances",
    "objects": "space.Objects",
    "tum": "trajectory.TUMTrajectory",
}
"""{name of a format: module of this folder and class of its `exporter.Exporter`}."""

if TYPE_CHECKING:
    FormatName = str
else:
    FormatName = Literal[tuple(REGISTRY)]
    """What ``--format`` takes."""
