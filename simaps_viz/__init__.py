"""Semantic Instance Maps from posed RGB-D: build, question and drive on them; the page and recordings come on top."""

from importlib.metadata import version

from simaps_viz.api import find, plan, to_pandas
from simaps_viz.datasets.posed_frames import PosedFrames, open_sequence
from simaps_viz.errors import CommandError, InputError, PlanningError, SIMapsError
from simaps_viz.exports.formats import ExportOptions, export_map
from simaps_viz.mapping.graph import to_networkx
from simaps_viz.mapping.mapfile import load_map, save_map
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.pipeline import BuildConfig, build_map
from simaps_viz.structures import Frame, Instance, Pose2, Segmentation, SIMap

__version__ = version("simaps-viz")

__all__ = [
    "BuildConfig",
    "CommandError",
    "ExportOptions",
    "Frame",
    "InputError",
    "Instance",
    "PlanningError",
    "Pose2",
    "PosedFrames",
    "RobotShape",
    "SIMap",
    "SIMapsError",
    "Segmentation",
    "build_map",
    "export_map",
    "find",
    "load_map",
    "open_sequence",
    "plan",
    "recommunity",
    "repartition",
    "save_map",
    "to_networkx",
    "to_pandas",
]
