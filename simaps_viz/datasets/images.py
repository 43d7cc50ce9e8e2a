"""Reads image files, and refuses damaged ones: a decoder left alone turns half a file into a grey or black rest."""

import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_IMAGE_BYTES, check_file, check_picture

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
    """Return width and height; the header chunk comes first (PNG specification, section 5.6)."""
    if len(data) < 24 or data[12:16] != b"IHDR":
        return None
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height: walk the segments up to the frame's header (ITU T.81, B.2.2)."""
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


def read_depth(path: Path, depth_unit_m: float) -> NDArray:
    """Read a 16-bit depth image.

    Returns:
        float32 [H, W], metres, 0 = invalid.

    Raises:
        InputError: The file is missing, damaged, or not a single-channel 16-bit image.
    """
    raw = _decode(path, cv2.IMREAD_UNCHANGED)
    if raw.dtype != np.uint16 or raw.ndim != 2:
        raise InputError(f"{path}: expected a 16-bit depth image with one channel, found {_kind(raw)}")
    return np.multiply(raw, np.float32(depth_unit_m), dtype=np.float32)


def read_color(path: Path) -> NDArray:
    """Read a colour image as uint8 [H, W, 3], RGB; raises InputError when it is missing or damaged."""
    return cv2.cvtColor(_decode(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION), cv2.COLOR_BGR2RGB)


def read_ids(path: Path) -> NDArray:
    """Read a segment id image as it is stored.

    Returns:
        uint8 or uint16 [H, W], 0 = nothing.

    Raises:
        InputError: The file is missing, damaged, or has another depth or more channels; also a JPEG, whose
            compression makes up ids.
    """
    raw = _decode(path, cv2.IMREAD_UNCHANGED, lossless=True)
    if raw.dtype not in (np.uint8, np.uint16) or raw.ndim != 2:
        raise InputError(f"{path}: expected 8- or 16-bit segment ids in one channel, found {_kind(raw)}")
    return raw


def _decode(path: Path, flags: int, *, lossless: bool = False) -> NDArray:
    check_file(path, MAX_IMAGE_BYTES, "an image")
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        found = error.strerror if isinstance(error, OSError) else None
        raise InputError(f"{path}: expected an image, found {found or error}") from error
    return decode_image(path, data, flags, lossless=lossless)


def decode_image(where: Path | str, data: bytes, flags: int, *, lossless: bool = False) -> NDArray:
    """Decode the bytes of an image file with OpenCV's flags; colours come as BGR.

    Raises:
        InputError: It is damaged, too large or no image, or a JPEG where pixel values matter (``lossless``).
    """
    fault = _fault(data)
    if lossless and data.startswith(JPEG_START):
        fault = "a JPEG, which does not keep pixel values (use PNG)"
    if fault:
        raise InputError(f"{where}: expected a whole image, found {fault}")
    check_header(where, data)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise InputError(f"{where}: expected an image, found one that cannot be decoded") from error
    if image is None:
        raise InputError(f"{where}: expected an image, found one that cannot be decoded")
    return image


def _fault(data: bytes) -> str | None:
    """What is wrong with the bytes of an image file, or None. Costs about 1 % of decoding a PNG, 5 % of a JPEG."""
    if not data:
        return "an empty file"
    if data.startswith(PNG_START):
        return _png_fault(data)
    if data.startswith(JPEG_START):
        return _jpeg_fault(data)
    return None


def _png_fault(data: bytes) -> str | None:
    """Walk the chunks (PNG specification, section 5.3): length, type, content, CRC of type and content."""
    view = memoryview(data)
    start = len(PNG_START)
    while start + 12 <= len(data):
        end = start + 8 + int.from_bytes(view[start : start + 4], "big")
        if end + 4 > len(data):
            break
        if zlib.crc32(view[start + 4 : end]) != int.from_bytes(view[end : end + 4], "big"):
            return "a damaged PNG (a checksum is wrong)"
        if view[start + 4 : start + 8] == b"IEND":
            return None
        start = end + 4
    return f"a truncated PNG ({len(data)} bytes, its end is missing)"


def _jpeg_fault(data: bytes) -> str | None:
    """Look for the end marker behind the last scan; inside a scan it cannot occur (ITU T.81, B.1.1.5)."""
    scan = data.rfind(b"\xff\xda")
    if scan < 0 or data.find(b"\xff\xd9", scan) < 0:
        return f"a truncated JPEG ({len(data)} bytes, its end is missing)"
    return None


def _kind(image: NDArray) -> str:
    channels = 1 if image.ndim == 2 else image.shape[2]
    return f"{image.dtype.itemsize * 8} bits and {channels} channel{'s' if channels > 1 else ''}"
