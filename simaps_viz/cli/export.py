"""`simaps export`: a map in the formats of other programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from simaps_viz.cli import OK
from simaps_viz.errors import InputError
from simaps_viz.exports import FormatName

if TYPE_CHECKING:
    from simaps_viz.datasets.source import FrameSource
    from simaps_viz.structures import SIMap


@dataclass(frozen=True)
class Export:
    """Write a map in the formats of other programs: all files of one format, or none.

    Example: simaps export cafe.npz -o cafe.geojson; simaps export cafe.npz -o cafe.tum --trajectory "go to the sofa"
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """File to write; formats of several files use its name. Its ending tells the format where only one fits."""
    format: FormatName | None = None
    """ros: occupancy map (.yaml, .pgm). nav2: the same, a keepout mask and an inflated costmap. geojson, csv: instances
    with their outlines. glb, ply: coloured scene with named instances. coco: panoptic top view (.json, .png).
    graphml: cell graph. spark-dsg: scene graph (.json). instances: surface voxels with class and instance (.ply).
    objects: boxes, and what stands on, under and in what (.json). tum: trajectory of a command."""
    trajectory: str | None = None
    """tum: the command, or program, to drive in simulation."""
    pose: tuple[float, float, float] | None = None
    """tum: where the robot starts: x and y in metres, heading in degrees clockwise from north. By default where the
    first camera stood that has free floor by it."""
    llm: str | None = None
    """tum: let a language model read the command, as in simaps query."""
    label: Annotated[str | None, tyro.conf.arg(name="class")] = None
    """graphml: the graph of this class only."""
    points: bool = False
    """glb, ply: the recording's points in their own colours, instead of columns; the sequence must still be there."""
    robot_radius: float = 0.2
    """ros, nav2, tum: radius of the robot, metres."""
    robot_height: float = 1.5
    """ros, nav2, tum: height of the robot, metres; what is higher does not block it."""
    edits: bool = True
    """Include the edits made by hand (MAP.edits.json)."""
    json: bool = False
    """Print the format and the files written as one JSON line."""

    def run(self) -> int:
        """Write the files and print their names."""
        from simaps_viz.app import workbench
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import report
        from simaps_viz.exports.exporter import ExportOptions
        from simaps_viz.exports.formats import choose_format, export_map
        from simaps_viz.language.commands import read_command
        from simaps_viz.mapping.mending import load_mended
        from simaps_viz.navigation.agent import start_pose
        from simaps_viz.navigation.planner import RobotShape
        from simaps_viz.structures import Pose2

        with stage_progress(quiet=self.json) as progress:
            simap = load_mended(self.map, edits=self.edits)
            name = choose_format(self.output, self.format, command=self.trajectory)
            pose = None
            if name == "tum":
                pose = Pose2.from_heading(*self.pose) if self.pose else start_pose(simap)
            options = ExportOptions(
                robot=RobotShape(self.robot_radius, self.robot_height),
                label=self.label,
                command=self.trajectory,
                pose=pose,
                reader=workbench.reader(self.llm, simap, pose) if pose else read_command,
                points_of=self._sequence(simap) if self.points else None,
                progress=progress,
            )
            files = export_map(simap, self.output, name, options)
        written = [str(path) for path in files]
        report({"format": name, "files": written}, f"{name}: wrote {', '.join(written)}", json=self.json)
        return OK

    def _sequence(self, simap: "SIMap") -> "FrameSource":
        from simaps_viz.app import workbench

        sequence = workbench.sequence_of(simap)
        if sequence is None:
            where = simap.provenance.get("sequence")
            raise InputError(f"{self.map}: --points: expected the sequence it was built from at {where}, found none")
        return sequence
