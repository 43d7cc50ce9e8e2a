"""`simaps share`: a map, its growth and a robot's drive as one file to send to somebody."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from simaps_viz.cli import NO, OK
from simaps_viz.errors import InputError

if TYPE_CHECKING:
    from simaps_viz.console.progress import StageProgress

ENDINGS = (".html", ".gif", ".png")


@dataclass(frozen=True)
class Share:
    """Write a map as one file to send: a page that opens offline, a film, or a picture.

    Example: simaps share cafe.npz -o cafe.html --command "go to the second chair"
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """File to write: .html (page: the map grows, the robot drives, to be turned and scrubbed), .gif (the same as a
    film) or .png (large picture of the map with its legend)."""
    command: str | None = None
    """Command that the robot carries out at the end: English or a program."""
    pose: tuple[float, float, float] | None = None
    """Where the robot starts: x and y in metres, heading in degrees clockwise from north. By default where the first
    camera stood that has free floor by it."""
    llm: str | None = None
    """Let a language model read the command, as in simaps query."""
    edits: bool = True
    """Include the edits made by hand (MAP.edits.json)."""
    json: bool = False
    """Print what was written as one JSON line."""

    def run(self) -> int:
        """Write the file; the answer is no when the command failed."""
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import report

        with stage_progress(quiet=self.json) as progress:
            written = self._write(progress)
        failed = written["done"] is False
        words = [f'"{self.command}" failed: {written["outcome"]}'] if failed else []
        report(written, f"{written['output']}: {written['bytes'] / 1e6:.1f} MB", *words, json=self.json)
        return NO if failed else OK

    def _write(self, progress: "StageProgress") -> dict[str, Any]:
        """Write the file and return a JSON-able summary of its contents."""
        from simaps_viz.app import workbench
        from simaps_viz.io.files import check_output, write_whole
        from simaps_viz.mapping.mending import load_mended
        from simaps_viz.navigation.agent import answer, start_pose
        from simaps_viz.structures import Pose2
        from simaps_viz.viewer.page.share import drive_of, share_bytes

        ending = self.output.suffix.lower()
        if ending not in ENDINGS:
            raise InputError(
                f"{self.output}: expected a name that ends in {', '.join(ENDINGS)}, found {ending or 'no ending'}"
            )
        check_output(self.output)
        simap = load_mended(self.map, edits=self.edits)
        drive = None
        if self.command is not None:
            pose = Pose2.from_heading(*self.pose) if self.pose else start_pose(simap)
            read = workbench.reader(self.llm, simap, pose)
            drive = drive_of(
                simap,
                self.command,
                pose,
                ask=lambda m, text, at: answer(m, text, at, reader=read),
            )
        look = None if ending == ".png" else partial(workbench.look_back(lambda: self.map), simap)
        made = share_bytes(ending, simap, drive=drive, look=look, progress=progress)
        write_whole(self.output, made, "the shared file")
        return {
            "output": str(self.output),
            "bytes": len(made),
            "instances": len(simap.instances),
            "outcome": drive.outcome if drive else None,
            "done": drive.done if drive else None,
        }
