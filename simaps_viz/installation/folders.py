"""Checks of the folders the program writes to."""

import os
import shutil
from pathlib import Path

from simaps_viz.installation.finding import Finding

LITTLE_DISK_GB, TOO_LITTLE_DISK_GB = 2.0, 0.2
MOST_FILES = 200_000


def check_cache(folder: Path) -> Finding:
    """Check whether the cache can be written, and how much it holds."""
    if not _writable(folder):
        return Finding("cache", "fail", f"{folder} cannot be written",
                       "set SIMAPS_CACHE to a folder that can be")  # fmt: skip
    size, files = _size(folder)
    return Finding("cache", "ok", f"{folder}: {size / 1e6:.0f} MB in {files} files; may be deleted at any time")


def check_recordings() -> Finding:
    """Check the folder of the user's recorded builds."""
    from simaps_viz.recorder.library import RecordingLibrary  # noqa: PLC0415 - rerun is slow to import

    library = RecordingLibrary()
    entries = library.entries()
    broken = [entry.name for entry in entries if entry.fault]
    found = f"{len(entries)} in {', '.join(map(str, library.folders))}"
    if not _writable(library.folders[0]):
        return Finding("recordings", "warn", f"{found}; {library.folders[0]} cannot be written",
                       "set SIMAPS_RECORDINGS to a folder that can be")  # fmt: skip
    if broken:
        return Finding("recordings", "warn", f"{found}; cannot be opened: {', '.join(broken)}",
                       f"delete: simaps recordings delete {broken[0]} --yes")  # fmt: skip
    return Finding("recordings", "ok", found)


def check_disk(folder: Path) -> Finding:
    """Check how much room is left where the cache is."""
    there = _existing(folder)
    free_gb = shutil.disk_usage(there).free / 1e9
    found = f"{free_gb:.1f} GB free at {there}"
    if free_gb < TOO_LITTLE_DISK_GB:
        return Finding("disk", "fail", found, "make room, or set SIMAPS_CACHE to another disk")
    if free_gb < LITTLE_DISK_GB:
        return Finding("disk", "warn", found, "make room: the demo takes some 0.2 GB, a recorded build up to 0.1 GB")
    return Finding("disk", "ok", found)


def _existing(folder: Path) -> Path:
    """Give the folder, or the nearest above it that is there."""
    absolute = folder.absolute()
    return next(path for path in (absolute, *absolute.parents) if path.exists())


def _writable(folder: Path) -> bool:
    there = _existing(folder)
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def _size(folder: Path) -> tuple[int, int]:
    """Give the bytes and the number of the files in a folder; counting stops at a great many."""
    size = files = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            files += 1
            try:
                size += os.lstat(Path(parent) / name).st_size
            except OSError:  # removed meanwhile
                continue
        if files > MOST_FILES:
            break
    return size, files
