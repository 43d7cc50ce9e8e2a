"""Mends the recording a killed build leaves: cut in its last message, without its end."""

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

from simaps_viz.errors import InputError
from simaps_viz.io.files import replacing


def unfinished_recordings(path: Path) -> list[Path]:
    """Find what killed builds have left of a recording: hidden files beside it, the newest last."""
    left = path.parent.glob(f".{path.stem}.*.partial.rrd")
    return sorted((p for p in left if not _is_running(p)), key=lambda p: p.stat().st_mtime)


def repair_recording(broken: Path, output: Path) -> int:
    """Write all whole messages of a recording as a finished one, with its end and its layout.

    Args:
        broken: a recording that ends anywhere; it stays as it is.
        output: where the mended one goes (.rrd); may be the same file.

    Returns:
        The number of frames it shows.

    Raises:
        InputError: there is no recording in it, or the output cannot be written.
    """
    if not broken.is_file():
        raise InputError(f"{broken}: expected a recording (.rrd), found nothing")
    with replacing(output, "the recording") as mended:
        merge = [sys.executable, "-m", "rerun", "rrd", "merge", "--continue-on-error", "-o", str(mended), str(broken)]
        done = subprocess.run(merge, capture_output=True, text=True, check=False)
        if unwritten := re.search(r"Failed to write: ([^(\n]+)", done.stderr):
            raise InputError(f"{output}: could not write the recording: {unwritten[1].strip()}")
        frames = _frames(mended) if done.returncode == 0 else 0
        if not frames:
            raise InputError(f"{broken}: expected the recording of a build, found no whole frame in it")
    return frames


def _frames(path: Path) -> int:
    """Count the frames a recording shows; 0 when it is none."""
    import rerun.chunk as rc  # noqa: PLC0415 - rerun is slow to import

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            chunks = rc.RrdReader(path).stream().filter(content="/world/camera").to_chunks()
    except (ValueError, RuntimeError, OSError, Warning):
        return 0
    seen: set[int] = set()
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if "frame" in batch.schema.names:
            seen |= set(batch.column("frame").to_pylist())
    return len(seen)


def _is_running(partial: Path) -> bool:
    """Return whether the program that writes a partial recording is still there."""
    try:
        os.kill(int(partial.name.split(".")[-3]), 0)
    except (ValueError, IndexError, ProcessLookupError):
        return False
    except PermissionError:
        return True
    return True
