"""Reads the size of an OpenEXR picture from its header (openexr.com, "OpenEXR File Layout")."""

import struct
from pathlib import Path

from simaps_viz.errors import InputError
from simaps_viz.limits import check_picture

_MAGIC = b"\x76\x2f\x31\x01"
_LONGEST_HEADER = 1 << 16
_LONGEST_WORD = 256
_WINDOWS = ("dataWindow", "displayWindow")


def check_exr(path: Path) -> None:
    """Raise InputError unless a file starts as an EXR picture of a size that a camera's picture may have."""
    try:
        with path.open("rb") as file:
            data = file.read(_LONGEST_HEADER)
    except OSError as error:
        raise InputError(f"{path}: expected an EXR image, found {error.strerror or error}") from error
    try:
        found = dict(_attributes(data))
    except (ValueError, struct.error) as error:
        raise InputError(f"{path}: expected an EXR image, found a damaged or truncated file") from error
    for name in _WINDOWS:
        if len(found.get(name, b"")) != 16:
            raise InputError(f"{path}: expected an EXR image, found one without {name}")
        left, top, right, bottom = struct.unpack("<iiii", found[name])
        check_picture(path, right - left + 1, bottom - top + 1)


def _attributes(data: bytes) -> list[tuple[str, bytes]]:
    """Give the names and values of the header: each is name, type, size, value; an empty name ends it."""
    if data[:4] != _MAGIC:
        raise ValueError("no EXR file")
    at, found = 8, []
    while data[at] != 0 if at < len(data) else _cut():
        end = data.index(b"\0", at, at + _LONGEST_WORD)
        end_of_type = data.index(b"\0", end + 1, end + 1 + _LONGEST_WORD)
        (size,) = struct.unpack_from("<i", data, end_of_type + 1)
        start = end_of_type + 5
        if size < 0 or start + size > len(data):
            raise ValueError("an attribute that is cut short")
        found.append((data[at:end].decode("latin-1"), data[start : start + size]))
        at = start + size
    return found


def _cut() -> bool:
    raise ValueError("a header that does not end")
