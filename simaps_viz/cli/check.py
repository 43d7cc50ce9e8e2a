"""`simaps check`: find faults of a sequence and the corrections that remove them."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from simaps_viz.cli import NO, OK


@dataclass(frozen=True)
class Check:
    """Check whether a recording is usable; if not, report what is wrong with it and how to correct it.

    Neighbouring frames have to see the same surfaces in the same places. Inverted poses, other axes and depth units, a
    wrong camera matrix, shifted and dropped frames, up and the floor are tried. Exit status 1 means faults were found.

    Example: simaps check ../scans/breakroom --fix --picture evidence.png
    """

    sequence: tyro.conf.Positional[Path]
    """Folder or file of any format that is read (docs/FORMATS.md)."""
    fix: bool = False
    """Write the correction beside the sequence, which is not changed: sequence-fixed.json with its own poses and
    intrinsics where these change; for formats other than posed-frames/1 a complete folder, NAME-fixed."""
    picture: Path | None = None
    """Draw the evidence (.png): how well each explanation fits, and two frames laid over one another."""
    json: bool = False
    """Print the findings as one JSON line."""

    def run(self) -> int:
        """Print the findings; the answer is no when faults were found."""
        from simaps_viz.checking.run import check
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import emit, say

        with stage_progress(quiet=self.json) as progress:
            ok, text, record = check(self.sequence, fix=self.fix, picture=self.picture, progress=progress)
        if self.json:
            emit(record)
        else:
            say(text + "\n")
        return OK if ok else NO
