"""Reads files out of zip archives, none larger unpacked than a reader wants to hold."""

import zipfile
from pathlib import Path

from simaps_viz.arrays import ARCHIVE_FAULTS
from simaps_viz.errors import InputError
from simaps_viz.limits import MAX_MEMBER_BYTES


def members(path: Path, what: str) -> list[str]:
    """Give the names of the files in an archive; raises InputError when it is none."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except ARCHIVE_FAULTS as error:
        raise InputError(f"{path}: expected {what}, found {_one_line(error)}") from error


def member(path: Path, name: str) -> bytes:
    """Unpack one file; the archive is opened anew, as threads read at once.

    Raises:
        InputError: it is missing, damaged, or larger than anything a frame has.
    """
    try:
        with zipfile.ZipFile(path) as archive, archive.open(name) as file:
            data = file.read(MAX_MEMBER_BYTES + 1)
    except (*ARCHIVE_FAULTS, KeyError) as error:
        raise InputError(f"{path}: expected {name} in the archive, found {_one_line(error)}") from error
    if len(data) > MAX_MEMBER_BYTES:
        raise InputError(f"{path}: {name}: expected at most {MAX_MEMBER_BYTES} bytes, found more")
    return data


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
