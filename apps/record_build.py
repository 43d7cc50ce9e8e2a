"""Record a build of the embedded scene, with its map beside it. `make recordings` renews those of `recordings/`."""

import os
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from simaps_viz import BuildConfig, open_sequence, save_map
from simaps_viz.app.workbench import cache_folder, truth_beside
from simaps_viz.build.to_file import BuildRequest, build_to_file
from simaps_viz.console.progress import stage_progress
from simaps_viz.evaluation.truth import find_truth, truth_as_map, truth_of
from simaps_viz.recorder.settings import RecorderSettings
from simaps_viz.scenes.demo import ensure_demo

# A little less than the default, so that the repository stays small.
SHIPPED = RecorderSettings(color_every=2, depth_every=4, map_every=2, points=800, edges=400)
BUILD = Path(__file__).parents[1] / "build"


@dataclass(frozen=True)
class Record:
    """Which build to record, and where to."""

    output: Path = BUILD / "cafe-evidence.rrd"
    """The recording to write."""
    method: str = "evidence"
    """Of the build."""


def main(config: Record) -> None:
    """Render the scene if need be, build it, and keep the recording and the map, which the demo shows at once."""
    config.output.parent.mkdir(exist_ok=True)
    # Rerun packs what it was given every 0.2 s: in few large parts the file is smaller, on a busy machine by a third.
    os.environ.setdefault("RERUN_FLUSH_TICK_SECS", "4")
    with stage_progress() as progress, tempfile.TemporaryDirectory() as scratch:
        sequence = open_sequence(ensure_demo(cache_dir=cache_folder(), progress=progress))
        output = Path(scratch) / "cafe.npz"
        request = BuildRequest(config.method, BuildConfig(), output, config.output, recorder_settings=SHIPPED)
        simap = build_to_file(sequence, request, progress)
        # Where the frames lay on this machine means nothing on others.
        shipped = replace(simap, provenance={**simap.provenance, "sequence": ""})
        save_map(shipped, config.output.with_suffix(".npz"))
        save_map(truth_as_map(truth_of(simap, find_truth(sequence))), truth_beside(config.output.with_suffix(".npz")))
    sys.stdout.write(f"{config.output}: {config.output.stat().st_size / 2**20:.1f} MiB\n")


if __name__ == "__main__":
    main(tyro.cli(Record))
