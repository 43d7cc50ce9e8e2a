"""Reads NumPy's .npy and .npz formats: sizes are checked before memory is asked for, pickles are never read."""

import lzma
import math
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.limits import MAX_ARRAY_BYTES

Shape = tuple[int, ...]
Check = Callable[[Shape, np.dtype], None]
"""Raises InputError for a shape or dtype that is not wanted."""
ARCHIVE_FAULTS = (OSError, EOFError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error, lzma.LZMAError,
                  struct.error, OverflowError, IndexError, MemoryError)  # fmt: skip
"""What `zipfile` raises for archives that are damaged, encrypted or packed in ways it does not know."""
_BLOCK = 1 << 20
_DENSEST = 1032
"""Deflate packs no better than so many bytes into one."""


def read_npy(where: object, file: IO[bytes], size: int, check: Check) -> NDArray:
    """Read one array.

    Args:
        where: names it in an error.
        file: at its start.
        size: bytes that follow; an array that claims more is refused.
        check: of its shape and dtype, before anything is read.

    Raises:
        InputError: it is damaged, cut short, too large or something else. Errors of ``file`` itself come through.
    """
    fault = InputError(f"{where}: expected a whole NumPy array, found a damaged or truncated file")
    try:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(file)
        start = file.tell()
    except Exception as error:  # the header is a Python literal, and NumPy raises whatever reading it raises
        raise fault from error
    if dtype.kind not in "biufU" or dtype.itemsize == 0 or any(n < 0 for n in shape) or len(shape) > 8:
        raise fault
    check(shape, dtype)
    count = math.prod(shape)
    if count * dtype.itemsize > MAX_ARRAY_BYTES:
        raise InputError(f"{where}: expected an array of at most {MAX_ARRAY_BYTES} bytes, found {dtype} {list(shape)}")
    if start + count * dtype.itemsize != size:
        raise fault
    flat = np.zeros(count, dtype)
    if count:
        _fill(file, flat.view(np.uint8).data, fault)
    if file.read(1):  # at the end an archive checks its checksum
        raise fault
    return flat.reshape(shape[::-1]).T if fortran else flat.reshape(shape)


def read_npz(path: Path, checks: Mapping[str, Check], *, what: str) -> dict[str, NDArray]:
    """Read some arrays of an archive; one that is not in it is left out. ``what`` names the archive in an error.

    Raises:
        InputError: the archive or an array is damaged, too large or something else.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            infos = {info.filename: info for info in archive.infolist()}
            data = {}
            for name, check in checks.items():
                info = infos.get(f"{name}.npy")
                if info is None:
                    continue
                if info.file_size > _DENSEST * info.compress_size + _BLOCK:
                    raise InputError(f"{path}: {name}: expected an array, found a size that its bytes cannot have")
                with archive.open(info) as file:
                    data[name] = read_npy(f"{path}: {name}", file, info.file_size, check)
            return data
    except ARCHIVE_FAULTS as error:
        why = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path}: expected a whole {what}, found a damaged or foreign one ({why})") from error


def _fill(file: IO[bytes], view: memoryview, fault: InputError) -> None:
    at = 0
    while at < len(view):
        block = file.read(min(_BLOCK, len(view) - at))
        if not block:
            raise fault
        view[at : at + len(block)] = block
        at += len(block)
