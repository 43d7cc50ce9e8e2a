"""The names of all export formats, without their code: the command line lists them before it loads one."""

from typing import Literal, get_args

FormatName = Literal["ros", "nav2", "geojson", "csv", "glb", "ply", "coco", "graphml", "spark-dsg", "tum"]
"""What ``--format`` takes."""
FORMATS: tuple[FormatName, ...] = get_args(FormatName)
