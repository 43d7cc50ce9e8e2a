"""Read image files, and refuse damaged ones: a decoder left alone turns half a file into a grey or black rest."""

import re
import zlib
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.PpmImagePlugin import PpmImageFile

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_IMAGE_BYTES, check_picture, read_bytes

PNG_START = b"\x89PNG\r\n\x1a\n"
PGM_START = b"P5"
JPEG_START = b"\xff\xd8"
_WEBP = re.compile(rb"RIFF....WEBP", re.DOTALL)
MAX_ID = 65535
"""Id images have 16 bits at most."""


def check_header(where: object, data: bytes) -> tuple[int, int]:
    """Return width and height; raise InputError unless it is a PNG, PGM, JPEG or WebP of a size cameras may have.

    Pillow reads the header alone (but not that of WebP, where it allocates the picture); of images this large OpenCV
    would allocate all before it finds them damaged.
    """
    if _WEBP.match(data):
        found = _webp_size(where, data)
        check_picture(where, *found)
        return found
    kinds = {PNG_START: PngImageFile, JPEG_START: JpegImageFile, PGM_START: PpmImageFile}
    kind = next((kind for start, kind in kinds.items() if data.startswith(start)), None)
    if kind is None:
        raise InputError(
            f"{where}: expected an image, found one that cannot be decoded (only PNG, PGM, JPEG and WebP are)"
        )
    try:
        with kind(BytesIO(data)) as image:  # not Image.open, which judges the size by its own limits
            found = image.size
    except Exception as error:  # Pillow may raise anything on damaged headers
        raise InputError(f"{where}: expected an image, found one that cannot be decoded (it has no size)") from error
    check_picture(where, *found)
    return found


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
    return decode_color(path, read_bytes(path, MAX_IMAGE_BYTES, "an image"))


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


def image_size(path: Path) -> tuple[int, int]:
    """Return width and height of an image without decoding it; raises InputError as reading it would."""
    data = read_bytes(path, MAX_IMAGE_BYTES, "an image")
    _check_complete(path, data)
    return check_header(path, data)


def _decode(path: Path, flags: int, *, lossless: bool = False) -> NDArray:
    return decode_image(path, read_bytes(path, MAX_IMAGE_BYTES, "an image"), flags, lossless=lossless)


def decode_image(where: Path | str, data: bytes, flags: int, *, lossless: bool = False) -> NDArray:
    """Decode the bytes of an image file with OpenCV's flags; colours come as BGR.

    Raises:
        InputError: It is damaged, too large or no image, or a JPEG where pixel values matter (``lossless``).
    """
    if lossless and data.startswith(JPEG_START):
        raise InputError(f"{where}: expected a whole image, found a JPEG, which does not keep pixel values (use PNG)")
    _check_complete(where, data)
    check_header(where, data)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise InputError(f"{where}: expected an image, found one that cannot be decoded") from error
    if image is None:
        raise InputError(f"{where}: expected an image, found one that cannot be decoded")
    return image


def decode_color(where: Path | str, data: bytes) -> NDArray:
    """Decode the bytes of a colour image as uint8 [H, W, 3], RGB; raises InputError like ``decode_image``."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return cv2.cvtColor(decode_image(where, data, flags), cv2.COLOR_BGR2RGB)


def encode_ids(ids: NDArray, options: Sequence[int] = ()) -> NDArray:
    """Encode segment ids [H, W] as a PNG of 8 bits, or of 16; uint8 [bytes]. Raises InputError for larger ones."""
    highest = int(ids.max(initial=0))
    if highest > MAX_ID:
        raise InputError(f"segment ids: expected at most {MAX_ID}, found {highest}")
    narrow = ids.astype(np.uint8 if highest < 256 else np.uint16)
    return cv2.imencode(".png", narrow, list(options))[1]


def _check_complete(where: Path | str, data: bytes) -> None:
    """Raise InputError for an image that is cut short; costs about 1 % of decoding a PNG, 5 % of a JPEG."""
    fault = None if data else "an empty file"
    if data.startswith(PNG_START):
        fault = _png_fault(data)
    elif data.startswith(JPEG_START):
        fault = _jpeg_fault(data)
    elif data.startswith(PGM_START):
        fault = _pgm_fault(data)
    elif _WEBP.match(data) and len(data) < (whole := int.from_bytes(data[4:8], "little") + 8):
        fault = f"a truncated WebP ({len(data)} of {whole} bytes)"
    if fault:
        raise InputError(f"{where}: expected a whole image, found {fault}")


def _webp_size(where: object, data: bytes) -> tuple[int, int]:
    """Return width and height of a WebP (RFC 9649): of its canvas, or of its only picture; raise for an animation."""
    kind, first = data[12:16], data[20:30]
    if kind == b"VP8X" and len(first) == 10 and not first[0] & 2:
        return int.from_bytes(first[4:7], "little") + 1, int.from_bytes(first[7:10], "little") + 1
    if kind == b"VP8L" and first[:1] == b"\x2f":
        bits = int.from_bytes(first[1:5], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 " and first[3:6] == b"\x9d\x01\x2a":
        return int.from_bytes(first[6:8], "little") & 0x3FFF, int.from_bytes(first[8:10], "little") & 0x3FFF
    raise InputError(f"{where}: expected an image, found one that cannot be decoded (a WebP that moves or has no size)")


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


def _pgm_fault(data: bytes) -> str | None:
    """Compare the length with the header's width, height and largest value (binary PGM: one byte or two a pixel)."""
    found = re.match(rb"P5" + 2 * rb"(?:\s|#[^\n]*\n)+(\d{1,6})" + rb"(?:\s|#[^\n]*\n)+(\d{1,5})\s", data)
    if found is None:
        return "a damaged PGM (its header has no size)"
    width, height, highest = (int(number) for number in found.groups())
    expected = width * height * (2 if highest > 255 else 1)
    have = len(data) - found.end()
    return f"a truncated PGM ({have} of {expected} bytes of pixels)" if have < expected else None


def _jpeg_fault(data: bytes) -> str | None:
    """Look for the end marker behind the last scan; inside a scan it cannot occur (ITU T.81, B.1.1.5)."""
    scan = data.rfind(b"\xff\xda")
    if scan < 0 or data.find(b"\xff\xd9", scan) < 0:
        return f"a truncated JPEG ({len(data)} bytes, its end is missing)"
    return None


def _kind(image: NDArray) -> str:
    channels = 1 if image.ndim == 2 else image.shape[2]
    return f"{image.dtype.itemsize * 8} bits and {channels} channel{'s' if channels > 1 else ''}"
