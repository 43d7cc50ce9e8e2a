"""All export formats by name, and the one function that writes them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.exports.geojson import geojson_bytes
from simaps_viz.exports.glb import glb_bytes, glb_points_bytes
from simaps_viz.exports.graphml import graphml_bytes
from simaps_viz.exports.names import FORMATS, FormatName
from simaps_viz.exports.nav2 import nav2_files
from simaps_viz.exports.panoptic import coco_files
from simaps_viz.exports.ply import ply_bytes, ply_points_bytes
from simaps_viz.exports.points import Cloud, gather_points
from simaps_viz.exports.ros import ros_files
from simaps_viz.exports.scene_graph import scene_graph_bytes
from simaps_viz.exports.tables import csv_bytes
from simaps_viz.exports.trajectory import driven_poses, tum_bytes
from simaps_viz.io.files import write_all
from simaps_viz.language.commands import read_command
from simaps_viz.navigation.agent import Reader, planner_of
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Pose2, SIMap

ENDINGS: dict[FormatName, tuple[str, ...]] = {
    "ros": (".yaml", ".pgm"),
    "nav2": (".yaml", ".pgm"),
    "geojson": (".geojson", ".json"),
    "csv": (".csv",),
    "glb": (".glb",),
    "ply": (".ply",),
    "coco": (".json", ".png"),
    "graphml": (".graphml",),
    "spark-dsg": (".json",),
    "tum": (".tum", ".txt"),
}
"""What a format's file may end in; the first is added to a name without an ending."""

_GUESSED: dict[str, FormatName] = {
    ".yaml": "ros", ".pgm": "ros", ".geojson": "geojson", ".csv": "csv", ".glb": "glb", ".ply": "ply",
    ".graphml": "graphml", ".tum": "tum",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ExportOptions:
    """What some formats want to know beside the map."""

    robot: RobotShape = field(default_factory=RobotShape)
    """ros, nav2, tum: for whom cells are blocked and free."""
    label: str | None = None
    """graphml: one class only."""
    command: str | None = None
    """tum: what to drive."""
    pose: Pose2 | None = None
    """tum: where the drive starts."""
    reader: Reader = read_command
    """tum: reads the command."""
    points_of: FrameSource | None = None
    """glb, ply: the points of this sequence, instead of columns."""
    progress: Progress | None = None
    """glb, ply: told how far the reading of points is."""


def choose_format(path: Path, format: str | None = None, *, command: str | None = None) -> FormatName:
    """Return the format asked for, or tell it from a file's ending (.yaml means ros; with a command, .txt means tum).

    Raises:
        InputError: there is no such format, or the ending says nothing, or several things; or another ending fits.
    """
    name = _known(format) if format is not None else _guess(path, command)
    if path.suffix and path.suffix not in ENDINGS[name]:
        raise InputError(
            f"{path}: expected a name ending in {' or '.join(ENDINGS[name])} for {name}, found {path.suffix}"
        )
    return name


def _known(format: str) -> FormatName:
    for name in FORMATS:
        if name == format:
            return name
    raise InputError(f"format: expected one of {', '.join(FORMATS)}, found {format!r}")


def _guess(path: Path, command: str | None) -> FormatName:
    if command is not None and path.suffix in ("", *ENDINGS["tum"]):
        return "tum"
    if path.suffix in _GUESSED:
        return _GUESSED[path.suffix]
    several = [name for name in FORMATS if path.suffix in ENDINGS[name]]
    found = f"{path.suffix}, which may be {' or '.join(several)}" if several else path.suffix or "no ending"
    raise InputError(
        f"{path}: expected an ending that tells the format, or --format {'|'.join(FORMATS)}; found {found}"
    )


def export_map(simap: SIMap, path: Path, format: str | None = None, options: ExportOptions | None = None) -> list[Path]:
    """Write a map in another program's format: all its files, or none.

    Args:
        simap: the map.
        path: where to; ros, nav2 and coco write several files of this name.
        format: one of ``FORMATS``; left out, the path's ending tells.
        options: what some formats want to know beside the map.

    Returns:
        The files written, the main one first.

    Raises:
        InputError: no such format or ending, or a file cannot be written.
        CommandError: tum: the command is refused.
        PlanningError: tum: there is no way.
    """
    path, options = Path(path), options or ExportOptions()
    name = choose_format(path, format, command=options.command)
    _check_options(name, options)
    path = path if path.suffix else path.with_name(path.name + ENDINGS[name][0])
    if not path.parent.is_dir():
        raise InputError(f"{path}: expected a folder to write in, found none at {path.parent}")
    files = _several(name, simap, path, options) or {path: _SINGLE[name](simap, options)}
    write_all(files, f"the map as {name}")
    return list(files)


def _check_options(name: FormatName, options: ExportOptions) -> None:
    """Refuse an option that this format would ignore."""
    given = {
        "class": (options.label, ("graphml",)),
        "command": (options.command, ("tum",)),
        "points": (options.points_of, ("glb", "ply")),
    }
    for what, (value, takers) in given.items():
        if value is not None and name not in takers:
            raise InputError(f"{name}: expected no {what} (only {' and '.join(takers)} take it), found one")


def _several(name: FormatName, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes] | None:
    """Return the files of a format that has more than one, the main one first."""
    stem = path.with_suffix("")
    if name == "ros":
        return ros_files(planner_of(simap, options.robot), stem)
    if name == "nav2":
        return nav2_files(simap, planner_of(simap, options.robot), stem)
    return coco_files(simap, stem) if name == "coco" else None


def _cloud(simap: SIMap, sequence: FrameSource, progress: Progress | None) -> Cloud:
    cut_height_m = float(simap.parameters.get("cut_height_m", 2.0))
    return gather_points(simap, sequence, cut_height_m=cut_height_m, progress=progress)


def _glb(simap: SIMap, options: ExportOptions) -> bytes:
    if options.points_of is None:
        return glb_bytes(simap)
    return glb_points_bytes(simap, _cloud(simap, options.points_of, options.progress))


def _ply(simap: SIMap, options: ExportOptions) -> bytes:
    if options.points_of is None:
        return ply_bytes(simap)
    return ply_points_bytes(simap, _cloud(simap, options.points_of, options.progress))


def _tum(simap: SIMap, options: ExportOptions) -> bytes:
    if options.command is None or options.pose is None:
        raise InputError('tum: expected a command to drive, such as --trajectory "go to the sofa", found none')
    return tum_bytes(driven_poses(simap, options.command, options.pose, robot=options.robot, reader=options.reader))


_SINGLE: dict[FormatName, Callable[[SIMap, ExportOptions], bytes]] = {
    "geojson": lambda simap, options: geojson_bytes(simap),
    "csv": lambda simap, options: csv_bytes(simap),
    "glb": _glb,
    "ply": _ply,
    "graphml": lambda simap, options: graphml_bytes(simap, options.label),
    "spark-dsg": lambda simap, options: scene_graph_bytes(simap),
    "tum": _tum,
}
