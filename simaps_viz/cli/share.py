"""`simaps share`: a map, its growth and a robot's ride as one file to send to somebody."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from simaps_viz.app import workbench
from simaps_viz.app.share import look_back
from simaps_viz.console.progress import StageProgress
from simaps_viz.errors import InputError
from simaps_viz.io.files import check_output, write_whole
from simaps_viz.mapping.mending import load_mended
from simaps_viz.navigation.agent import Agent, answer
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Pose2, SIMap

ENDINGS = (".html", ".gif", ".png")


@dataclass(frozen=True)
class Share:
    """Write a map as one file to send to somebody: a page that opens without a network, a film, or a picture.

    Example: simaps share cafe.npz -o cafe.html --command "go to the second chair"
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """File to write: .html (page: the map grows, the robot drives, to be turned and scrubbed), .gif (the same as a
    film) or .png (large picture of the map with its legend)."""
    command: str | None = None
    """What the robot is told at the end: English or a program."""
    pose: tuple[float, float, float] | None = None
    """Where the robot starts: x and y in metres, heading in degrees clockwise from north. By default where the first
    camera stood that has free floor by it."""
    llm: str | None = None
    """Let a language model read the command, as in simaps query."""
    edits: bool = True
    """Of the map with the edits made by hand (MAP.edits.json)."""
    json: bool = False
    """Print what was written as one JSON line."""


def share(settings: Share, progress: StageProgress) -> dict[str, Any]:
    """Write the file; returns what is worth saying of it.

    Raises:
        SIMapsError: the map or the place to write is no good, or the command was refused.
    """
    from simaps_viz.viewer.share.files import MAKERS, share_bytes  # noqa: PLC0415 - viser is slow to import
    from simaps_viz.viewer.share.story import ride_of  # noqa: PLC0415 - as above

    ending = settings.output.suffix.lower()
    if ending not in MAKERS:
        raise InputError(
            f"{settings.output}: expected a name that ends in {', '.join(ENDINGS)}, found {ending or 'no ending'}"
        )
    check_output(settings.output)
    simap = load_mended(settings.map, edits=settings.edits)
    ride = None
    if settings.command is not None:
        pose = Pose2.from_heading(*settings.pose) if settings.pose else workbench.start_pose(simap)
        read = workbench.reader(settings.llm, simap, pose)
        ride = ride_of(
            simap, settings.command, pose, ask=lambda m, text, at: answer(m, text, at, reader=read), steps=_steps
        )
    look = None if ending == ".png" else look_back(settings.map, simap)
    made = share_bytes(ending, simap, ride=ride, look=look, radius_m=RobotShape().radius_m, tell=progress)
    write_whole(settings.output, made, "the shared file")
    return {
        "output": str(settings.output),
        "bytes": len(made),
        "instances": len(simap.instances),
        "outcome": ride.outcome if ride else None,
        "done": ride.done if ride else None,
    }


def _steps(simap: SIMap, program: str, pose: Pose2) -> Any:
    return Agent(simap, pose).steps(program)
