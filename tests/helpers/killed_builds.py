"""Shared by the tests of process and others."""

from build_logs import read_log
from sequences import frame_name

from simaps_viz import open_sequence
from simaps_viz.build.build_log import BuildLog, log_path
from simaps_viz.build.pipeline import BuildConfig, build_map

FRAMES = 60


SMALL_DISK = (
    "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, ({bytes},) * 2);"
    "from simaps_viz.cli.main import main; sys.exit(main(sys.argv[1:]))"
)
"""Runs a command whose files cannot be larger than so many bytes."""


def damage(sequence, *indices):
    for index in indices:
        path = sequence / "depth" / f"{frame_name(index)}.png"
        path.write_bytes(path.read_bytes()[:70])


def unfinished(sequence, output, frames):
    """Leave what a build leaves that is killed after so many frames."""
    log, opened = log_path(output), open_sequence(sequence)
    build_map(opened, BuildConfig(), log=log)
    with BuildLog(log, read_log(log)[0], resume=True) as steps:
        steps.cut(frames)
