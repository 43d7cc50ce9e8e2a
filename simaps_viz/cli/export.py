"""Puts together what `simaps export` needs: the map, its sequence where points are wanted, who reads the command."""

from pathlib import Path

from simaps_viz.app import workbench
from simaps_viz.cli.options import Export
from simaps_viz.console.progress import StageProgress
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.exports.formats import ExportOptions, FormatName, choose_format, export_map
from simaps_viz.language.commands import read_command
from simaps_viz.mapping.mending import load_mended
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Pose2, SIMap


def export(settings: Export, progress: StageProgress) -> tuple[FormatName, list[Path]]:
    """Write a map in another program's format; returns the format and the files.

    Raises:
        SIMapsError: as for `export_map`; or the map's sequence is gone, and points were asked for.
    """
    simap = load_mended(settings.map, edits=settings.edits)
    name = choose_format(settings.output, settings.format, command=settings.trajectory)
    pose = None
    if name == "tum":
        pose = Pose2.from_heading(*settings.pose) if settings.pose else workbench.start_pose(simap)
    options = ExportOptions(
        robot=RobotShape(settings.robot_radius, settings.robot_height),
        label=settings.label,
        command=settings.trajectory,
        pose=pose,
        reader=workbench.reader(settings.llm, simap, pose) if pose else read_command,
        points_of=_sequence(settings.map, simap) if settings.points else None,
        progress=progress,
    )
    return name, export_map(simap, settings.output, name, options)


def _sequence(path: Path, simap: SIMap) -> FrameSource:
    sequence = workbench.sequence_of(simap)
    if sequence is None:
        where = simap.provenance.get("sequence")
        raise InputError(f"{path}: --points: expected the sequence it was built from at {where}, found none")
    return sequence
