"""Kill builds at random moments, go on with each, and print how many maps were lost. See docs/RELIABILITY.md."""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro
from attacks.kills import kill_builds, table

from simaps_viz import open_sequence
from simaps_viz.app.workbench import cache_folder
from simaps_viz.cli.main import main as simaps
from simaps_viz.console.progress import stage_progress
from simaps_viz.datasets.convert import write_posed_frames
from simaps_viz.scenes.demo import ensure_demo


@dataclass(frozen=True)
class KillBuilds:
    """How often to kill what."""

    sequence: Path | None = None
    """What to build; by default every fifth frame of the embedded café."""
    every: int = 5
    """Take every so many frames of it."""
    kills: int = 100
    """Number of builds that are killed."""
    seed: int = 0
    """Of the moments."""


def main(config: KillBuilds) -> int:
    """Kill, go on, compare, print; the exit status is 0 when nothing was lost."""
    with stage_progress() as progress:
        path = config.sequence or ensure_demo(cache_dir=cache_folder(), progress=progress)
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch) / "work"
        work.mkdir()
        manifest = write_posed_frames(open_sequence(path), Path(scratch) / "frames", every=config.every)
        frames = len(open_sequence(manifest))
        done = list(kill_builds(simaps, manifest, work, frames=frames, kills=config.kills, seed=config.seed))
    sys.stdout.write(table(done) + "\n")
    return int(any(one.faults for one in done))


if __name__ == "__main__":
    sys.exit(main(tyro.cli(KillBuilds)))
