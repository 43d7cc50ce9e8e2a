"""`simaps convert`: a recording of another format as a sequence folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from simaps_viz.cli import OK


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
    json: bool = False
    """Print what was written as one JSON line."""

    def run(self) -> int:
        """Write the sequence and print how many frames it has."""
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import report
        from simaps_viz.datasets.convert import write_posed_frames
        from simaps_viz.datasets.open import open_sequence

        with stage_progress(quiet=self.json) as progress:
            sequence = open_sequence(self.source)
            manifest = write_posed_frames(
                sequence, self.output, every=self.every, progress=lambda done, total: progress("frames", done, total)
            )
        frames = len(range(0, len(sequence), self.every))
        record = {"event": "done", "manifest": str(manifest), "name": sequence.name, "frames": frames,
                  "segmentation": sequence.segmentation_source, "notes": list(sequence.notes)}  # fmt: skip
        written = f"{manifest}: {frames} frames, segmentation {sequence.segmentation_source}"
        report(record, *(f"{self.source}: {text}" for text in sequence.notes), written, json=self.json)
        return OK
