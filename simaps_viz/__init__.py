"""Semantic Instance Maps from posed RGB-D: build, question and drive on them; the page and recordings come on top.

Names are loaded when they are first asked for: whoever wants one does not wait for all.
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simaps_viz.api import ask, find, plan, to_pandas
    from simaps_viz.datasets.posed_frames import PosedFrames, open_sequence
    from simaps_viz.datasets.source import FrameSource
    from simaps_viz.errors import CommandError, InputError, PlanningError, SIMapsError
    from simaps_viz.events import Observer
    from simaps_viz.exports.formats import ExportOptions, export_map
    from simaps_viz.mapping.accumulator import ProjectionSettings
    from simaps_viz.mapping.evidence import EvidenceSettings
    from simaps_viz.mapping.graph import to_networkx
    from simaps_viz.mapping.mapfile import load_map, save_map
    from simaps_viz.mapping.pooling import PoolSettings
    from simaps_viz.mapping.simap import recommunity, repartition
    from simaps_viz.mapping.votes import VoteSettings
    from simaps_viz.navigation.agent import Answer
    from simaps_viz.navigation.planner import RobotShape
    from simaps_viz.navigation.robot import Goal
    from simaps_viz.pipeline import BuildCancelled, BuildConfig, build_map
    from simaps_viz.structures import Frame, Instance, Intrinsics, Path, Pose2, Segment, Segmentation, SIMap

__version__ = version("simaps-viz")

__all__ = [
    "Answer",
    "BuildCancelled",
    "BuildConfig",
    "CommandError",
    "EvidenceSettings",
    "ExportOptions",
    "Frame",
    "FrameSource",
    "Goal",
    "InputError",
    "Instance",
    "Intrinsics",
    "Observer",
    "Path",
    "PlanningError",
    "PoolSettings",
    "Pose2",
    "PosedFrames",
    "ProjectionSettings",
    "RobotShape",
    "SIMap",
    "SIMapsError",
    "Segment",
    "Segmentation",
    "VoteSettings",
    "ask",
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

_WHERE = {
    "simaps_viz.api": (
        "ask",
        "find",
        "plan",
        "to_pandas",
    ),
    "simaps_viz.datasets.posed_frames": (
        "PosedFrames",
        "open_sequence",
    ),
    "simaps_viz.datasets.source": ("FrameSource",),
    "simaps_viz.errors": (
        "CommandError",
        "InputError",
        "PlanningError",
        "SIMapsError",
    ),
    "simaps_viz.events": ("Observer",),
    "simaps_viz.exports.formats": (
        "ExportOptions",
        "export_map",
    ),
    "simaps_viz.mapping.accumulator": ("ProjectionSettings",),
    "simaps_viz.mapping.evidence": ("EvidenceSettings",),
    "simaps_viz.mapping.graph": ("to_networkx",),
    "simaps_viz.mapping.mapfile": (
        "load_map",
        "save_map",
    ),
    "simaps_viz.mapping.pooling": ("PoolSettings",),
    "simaps_viz.mapping.simap": (
        "recommunity",
        "repartition",
    ),
    "simaps_viz.mapping.votes": ("VoteSettings",),
    "simaps_viz.navigation.agent": ("Answer",),
    "simaps_viz.navigation.planner": ("RobotShape",),
    "simaps_viz.navigation.robot": ("Goal",),
    "simaps_viz.pipeline": (
        "BuildCancelled",
        "BuildConfig",
        "build_map",
    ),
    "simaps_viz.structures": (
        "Frame",
        "Instance",
        "Intrinsics",
        "Path",
        "Pose2",
        "Segment",
        "Segmentation",
        "SIMap",
    ),
}
_MODULE_OF = {name: module for module, names in _WHERE.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
