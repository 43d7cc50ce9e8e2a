"""The interface of every export format, and the options that some of them take."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from simaps_viz.datasets.source import FrameSource
from simaps_viz.events import Progress
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Pose2, SIMap

if TYPE_CHECKING:
    from simaps_viz.navigation.agent import CommandReader  # the tables of words take long to load


@dataclass(frozen=True, eq=False)
class ExportOptions:
    """Options of some formats."""

    robot: RobotShape = field(default_factory=RobotShape)
    """ros, nav2, tum: for whom cells are blocked and free."""
    label: str | None = None
    """graphml: one class only."""
    command: str | None = None
    """tum: the command to drive."""
    pose: Pose2 | None = None
    """tum: where the drive starts."""
    reader: "CommandReader | None" = None
    """tum: reads the command; None = the grammar."""
    points_of: FrameSource | None = None
    """glb, ply: the points of this sequence, instead of columns."""
    progress: Progress | None = None
    """glb, ply: notified while points are read."""


class Exporter(Protocol):
    """One format. A new one is a file with a class of this kind, and one line in ``exports.REGISTRY``."""

    endings: tuple[str, ...]
    """Endings of its main file; the first is added to a name without an ending."""
    own_endings: tuple[str, ...] = ()
    """Those of ``endings`` that mean this format where none is asked for."""
    options: tuple[str, ...] = ()
    """Which of "class", "command" and "points" it takes; the others are refused."""

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return the content of all files to write, named after ``path``, the main one first.

        Raises:
            InputError, CommandError, PlanningError: the map or the options do not allow it.
        """
        ...
