"""Maps in the formats of other programs: one object a format; `formats.export_map` writes one.

This registry names the formats without loading their code, for the command line lists them before it loads one.
"""

from typing import TYPE_CHECKING, Final, Literal

REGISTRY: Final = {
    "ros": "simaps_viz.exports.ros:ROSMap",
    "nav2": "simaps_viz.exports.ros:Nav2Maps",
    "geojson": "simaps_viz.exports.records:GeoJSON",
    "csv": "simaps_viz.exports.records:CSV",
    "glb": "simaps_viz.exports.scene:GLB",
    "ply": "simaps_viz.exports.scene:PLY",
    "coco": "simaps_viz.exports.panoptic:COCOPanoptic",
    "graphml": "simaps_viz.exports.graphs:GraphML",
    "spark-dsg": "simaps_viz.exports.graphs:SparkDSG",
    "instances": "simaps_viz.exports.scene:Instances",
    "objects": "simaps_viz.exports.records:Objects",
    "tum": "simaps_viz.exports.trajectory:TUMTrajectory",
}
"""{name of a format: "module:class" of its `exporter.Exporter`}."""

if TYPE_CHECKING:
    FormatName = str
else:
    FormatName = Literal[tuple(REGISTRY)]
    """What ``--format`` takes."""
