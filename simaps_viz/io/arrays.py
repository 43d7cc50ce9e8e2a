"""Reads NumPy's .npy and .npz formats: sizes are checked before memory is asked for, pickles are never read."""

import io
import lzma
import math
import os
import struct
import threading
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import IO, cast

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_ARRAY_BYTES

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
    fault = _fault(where)
    shape, fortran, dtype = _read_head(where, file, size, check)
    count = math.prod(shape)
    flat = np.zeros(count, dtype)
    if count:
        _fill(file, flat.view(np.uint8).data, fault)
    if file.read(1):  # at the end an archive checks its checksum
        raise fault
    return flat.reshape(shape[::-1]).T if fortran else flat.reshape(shape)


def _fault(where: object) -> InputError:
    return InputError(f"{where}: expected a whole NumPy array, found a damaged or truncated file")


def _read_head(where: object, file: IO[bytes], size: int, check: Check) -> tuple[Shape, bool, np.dtype]:
    """Read what an array's file says of it, up to its first number; see `read_npy`."""
    fault = _fault(where)
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
    return shape, fortran, dtype


class PackedArray:
    """An array that stays packed as it lay in its archive; some rows of it are unpacked when asked for.

    It no longer needs the file, which may change or go. Rows that follow each other are read in one go. Threads may
    share it.
    """

    def __init__(self, where: object, packed: bytes, info: zipfile.ZipInfo, check: Check) -> None:
        """Read its shape and dtype; raises InputError, or one of `ARCHIVE_FAULTS`, for what is no such array."""
        self._where, self._lock = where, threading.Lock()
        self._file = cast(IO[bytes], zipfile.ZipExtFile(io.BytesIO(packed), "r", info))
        self.shape, self.by_columns, self.dtype = _read_head(where, self._file, info.file_size, check)
        self._start, self._row_bytes = self._file.tell(), math.prod(self.shape[1:]) * self.dtype.itemsize

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, part: slice) -> NDArray:
        """Unpack ``[first:stop]``; raises InputError where the archive is damaged."""
        first, stop, _ = part.indices(len(self))
        found = np.zeros((max(stop - first, 0), *self.shape[1:]), self.dtype)
        if found.size:
            with self._lock:
                try:
                    self._file.seek(self._start + first * self._row_bytes)
                    _fill(self._file, found.reshape(-1).view(np.uint8).data, _fault(self._where))
                except ARCHIVE_FAULTS as error:
                    raise _fault(self._where) from error
        return found

    def check_end(self) -> None:
        """Raise InputError unless the archive's checksum is right; all must have been read, part after part."""
        with self._lock:
            try:
                rest = self._file.read(1)
            except ARCHIVE_FAULTS as error:
                raise _fault(self._where) from error
        if rest:
            raise _fault(self._where)


def check_ends(arrays: Iterable["Rows"]) -> None:
    """Raise InputError unless the checksums of those that are packed are right; see `PackedArray.check_end`."""
    for array in arrays:
        if isinstance(array, PackedArray):
            array.check_end()


Rows = NDArray | PackedArray
"""An array, or one that is packed: some rows of either, ``[first:stop]``, are an array."""


def read_npz(
    path: Path, checks: Mapping[str, Check], *, what: str, packed: Collection[str] = ()
) -> tuple[dict[str, NDArray], dict[str, PackedArray]]:
    """Read some arrays of an archive; one that is not in it is left out.

    Args:
        path: of the archive.
        checks: of each array's shape and dtype.
        what: names the archive in an error.
        packed: names of arrays that stay packed where they can; `PackedArray.check_end` is the caller's.

    Returns:
        Those that are unpacked, and those that are not.

    Raises:
        InputError: the archive or an array is damaged, too large or something else.
    """
    try:
        with open(path, "rb") as whole, zipfile.ZipFile(whole) as archive:
            infos = {info.filename: info for info in archive.infolist()}
            data: dict[str, NDArray] = {}
            kept: dict[str, PackedArray] = {}
            for name, check in checks.items():
                info = infos.get(f"{name}.npy")
                if info is None:
                    continue
                if info.file_size > _DENSEST * info.compress_size + _BLOCK:
                    raise InputError(f"{path}: {name}: expected an array, found a size that its bytes cannot have")
                with archive.open(info) as file:
                    if name in packed:
                        array = PackedArray(f"{path}: {name}", _packed(whole, info), info, check)
                        if array.ndim == 1 or not array.by_columns:
                            kept[name] = array
                            continue
                    data[name] = read_npy(f"{path}: {name}", file, info.file_size, check)
            return data, kept
    except ARCHIVE_FAULTS as error:
        why = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path}: expected a whole {what}, found a damaged or foreign one ({why})") from error


def write_rows(file: IO[bytes], dtype: np.dtype, count: int, parts: Iterable[NDArray]) -> None:
    """Write an array with one axis as `numpy.save` does, part by part; ``count`` is its length."""
    head = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": (count,)}
    np.lib.format.write_array_header_1_0(file, head)
    for part in parts:
        file.write(np.ascontiguousarray(part, dtype).data)


def _packed(whole: IO[bytes], info: zipfile.ZipInfo) -> bytes:
    """Read an archive's member as it lies there; `zipfile` has checked its head."""
    if (
        info.file_size > MAX_ARRAY_BYTES + _BLOCK
        or info.compress_size > info.file_size + info.file_size // 100 + _BLOCK
    ):
        raise ValueError("a member that no array can be")
    whole.seek(info.header_offset)
    name, extra = struct.unpack("<26xHH", whole.read(30))
    at = info.header_offset + 30 + name + extra
    whole.seek(at)
    return whole.read(max(min(info.compress_size, os.fstat(whole.fileno()).st_size - at), 0))


def _fill(file: IO[bytes], view: memoryview, fault: InputError) -> None:
    at = 0
    while at < len(view):
        block = file.read(min(_BLOCK, len(view) - at))
        if not block:
            raise fault
        view[at : at + len(block)] = block
        at += len(block)
