"""Reads the size of a picture from the first bytes of its file, so that nobody decodes what is too large."""

from simaps_viz.errors import InputError
from simaps_viz.limits import check_picture

PNG_START = b"\x89PNG\r\n\x1a\n"
JPEG_START = b"\xff\xd8"
_ALONE = frozenset((0x01, *range(0xD0, 0xD9)))
"""JPEG markers that no length follows."""
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG markers that begin a frame's header (SOF), ITU T.81, table B.1."""


def check_header(where: object, data: bytes) -> None:
    """Raise InputError unless the bytes start as a PNG or JPEG of a size that a camera's picture may have."""
    if data.startswith(PNG_START):
        found = _png_size(data)
    elif data.startswith(JPEG_START):
        found = _jpeg_size(data)
    else:
        raise InputError(f"{where}: expected an image, found one that cannot be decoded (only PNG and JPEG are)")
    if found is None:
        raise InputError(f"{where}: expected an image, found one that cannot be decoded (it has no size)")
    check_picture(where, *found)


def _png_size(data: bytes) -> tuple[int, int] | None:
    """Give width and height; the header chunk comes first (PNG specification, section 5.6)."""
    if len(data) < 24 or data[12:16] != b"IHDR":
        return None
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Give width and height: walk the segments up to the frame's header (ITU T.81, B.2.2)."""
    at = 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:  # fill
            at += 1
        elif marker in _ALONE:
            at += 2
        elif marker in _FRAMES:
            if at + 9 > len(data):
                return None
            return int.from_bytes(data[at + 7 : at + 9], "big"), int.from_bytes(data[at + 5 : at + 7], "big")
        else:
            at += 2 + max(int.from_bytes(data[at + 2 : at + 4], "big"), 2)
    return None
