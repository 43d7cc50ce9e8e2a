"""``rerun-importer-simaps``: lets rerun open map files (``rerun map.npz``, or dropped on its window).

rerun runs every program on the PATH whose name begins with ``rerun-importer-`` with the path of a file it does not know
itself, and reads a recording from its standard output. The exit status 66 means that the file is for somebody else.
"""

import argparse
import os
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path

NOT_MINE = 66
"""Exit status that rerun expects of a program that cannot open a file."""
FAILED = 1
NAME = "rerun-importer-simaps"
_MEMBERS = {"metadata.npy", "label.npy", "instance.npy"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Write a map as a recording to standard output; returns the exit status."""
    options = _parse(arguments)
    if not is_map(options.path):
        return NOT_MINE
    from simaps_viz.errors import SIMapsError  # noqa: PLC0415 - other programs' files are turned away before

    try:
        _write(options)
    except SIMapsError as error:
        sys.stderr.write(f"{NAME}: {error}\n")
        return FAILED
    except BrokenPipeError:  # rerun was closed
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    return 0


def is_map(path: Path) -> bool:
    """Determine from a file's table of contents whether it is a map of this program."""
    if path.suffix.lower() != ".npz" or not path.is_file():
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            return set(archive.namelist()) >= _MEMBERS
    except (zipfile.BadZipFile, OSError):
        return False


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog=NAME,
        description="Lets rerun open map files: rerun map.npz. Run by rerun itself; writes a recording to stdout.",
    )
    parser.add_argument("path", type=Path)
    parser.add_argument("--application-id")
    parser.add_argument("--opened-application-id")
    parser.add_argument("--recording-id")
    parser.add_argument("--opened-recording-id")
    parser.add_argument("--entity-path-prefix", default="")
    known, _ = parser.parse_known_args(arguments)  # rerun passes more, and later versions may yet more
    return known


def _write(options: argparse.Namespace) -> None:
    import rerun as rr  # noqa: PLC0415 - slow to import, and not needed for other programs' files

    from simaps_viz.mapping.file import load_map  # noqa: PLC0415 - as above
    from simaps_viz.recorder.whole_map import log_whole_map, whole_map_blueprint  # noqa: PLC0415 - as above

    simap = load_map(options.path)
    application = options.opened_application_id or options.application_id or "simaps"
    stream = rr.RecordingStream(application, recording_id=options.opened_recording_id or options.recording_id)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.stdout()
    if options.opened_application_id is None and not options.entity_path_prefix:
        stream.send_blueprint(whole_map_blueprint(simap))  # otherwise it is the window of another program
        stream.send_recording_name(str(simap.provenance.get("name", options.path.stem)))
    log_whole_map(stream, simap, prefix=options.entity_path_prefix)
    stream.flush()


if __name__ == "__main__":
    sys.exit(main())
