"""`simaps convert`: a recording of another format as a sequence folder."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from simaps_viz.cli import OK
from simaps_viz.cli.options import WorldFrame

if TYPE_CHECKING:
    from simaps_viz.datasets.source import Unreadable


@dataclass(frozen=True)
class Convert:
    """Write a recording in another format as a sequence folder (posed-frames/1); docs/FORMATS.md lists the formats.

    Example: simaps convert rgbd_dataset_freiburg3_long_office_household -o office --every 5
    """

    source: tyro.conf.Positional[Path]
    """Folder or file of the recording."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder to write; new or empty."""
    every: int = 1
    """Take the first of every so many frames."""
    world: Annotated[WorldFrame, tyro.conf.arg(name="")] = field(default_factory=WorldFrame)
    strict: bool = False
    """Stop at a frame that lacks something or cannot be read; otherwise it is left out and counted."""
    json: bool = False
    """Print what was written as one JSON line."""

    def run(self) -> int:
        """Write the sequence and print how many frames it has."""
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import report
        from simaps_viz.datasets.convert import write_posed_frames
        from simaps_viz.datasets.open import open_sequence
        from simaps_viz.datasets.recording import left_out

        with stage_progress(quiet=self.json) as progress:
            sequence = open_sequence(self.source, strict=self.strict, **self.world.stated())
            lost: list[Unreadable] = []
            manifest = write_posed_frames(
                sequence, self.output, every=self.every, unreadable=None if self.strict else lost.append,
                progress=lambda done, total: progress("frames", done, total),
            )  # fmt: skip
        wanted = len(range(0, len(sequence), self.every))
        unread = f"frames cannot be read ({lost[0].error})" if lost else ""
        notes = [*sequence.notes, *left_out(len(lost), wanted, unread)]
        frames = wanted - len(lost)
        record = {"event": "done", "manifest": str(manifest), "name": sequence.name, "frames": frames,
                  "segmentation": sequence.segmentation_source, "notes": notes}  # fmt: skip
        words = f"{manifest}: {frames} frames, segmentation {sequence.segmentation_source}"
        report(record, *(f"{self.source}: {text}" for text in notes), words, json=self.json)
        return OK
