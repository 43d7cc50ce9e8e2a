"""Read NumPy's .npy and .npz formats: sizes are checked before memory is allocated, pickles are never read."""

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

from simaps_viz.errors import InputError, one_line
from simaps_viz.io.limits import MAX_ARRAY_BYTES

Shape = tuple[int, ...]
Check = Callable[[Shape, np.dtype], None]
"""Raises InputError for a shape or dtype that is not accepted."""
ARCHIVE_FAULTS = (OSError, EOFError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error, lzma.LZMAError,
                  struct.error, OverflowError, IndexError, MemoryError)  # fmt: skip
"""What `zipfile` raises for archives that are damaged, encrypted or compressed in a way it does not know."""
_BLOCK = 1 << 20
_MAX_RATIO = 1032
"""Deflate compresses at most so many bytes into one."""


def read_npy(where: object, file: IO[bytes], size: int, check: Check) -> NDArray:
    """Read one array.

    Args:
        where: names the array in an error.
        file: an open file at the start of the array.
        size: the bytes that follow; an array that claims another size is refused.
        check: checks shape and dtype before anything is read.

    Raises:
        InputError: the array is damaged, cut short, too large or something else. Errors of ``file`` itself pass.
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
    return InputError(f"{where}: expected a complete NumPy array, found a damaged or truncated file")


def _read_head(where: object, file: IO[bytes], size: int, check: Check) -> tuple[Shape, bool, np.dtype]:
    """Return (shape, whether by columns, dtype) of an array, and leave the file at its first number; see `read_npy`."""
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
    """An array that stays compressed in memory, as it was in its archive; its rows are unpacked when asked for.

    The archive itself is no longer needed. Reading rows in ascending order unpacks each byte once. Several threads may
    share it.
    """

    def __init__(self, where: object, packed: bytes, info: zipfile.ZipInfo, check: Check) -> None:
        """Read shape and dtype; raises InputError, or one of `ARCHIVE_FAULTS`, for anything else than an array."""
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
        """Raise InputError unless the archive's checksum is right, once all rows have been read in ascending order."""
        with self._lock:
            try:
                rest = self._file.read(1)
            except ARCHIVE_FAULTS as error:
                raise _fault(self._where) from error
        if rest:
            raise _fault(self._where)


def check_ends(arrays: Iterable["Rows"]) -> None:
    """Raise InputError unless the checksums of the packed arrays among these are right; see `PackedArray.check_end`."""
    for array in arrays:
        if isinstance(array, PackedArray):
            array.check_end()


Rows = NDArray | PackedArray
"""An array or a packed array: of either, ``[first:stop]`` is an array."""


def read_npz(
    path: Path, checks: Mapping[str, Check], *, what: str, packed: Collection[str] = ()
) -> tuple[dict[str, NDArray], dict[str, PackedArray]]:
    """Read some arrays of an archive; those that are not in it are left out.

    Args:
        path: the archive.
        checks: {name: check of shape and dtype} of the arrays.
        what: names the archive in an error.
        packed: names of arrays that stay packed if they are stored by rows; the caller calls `PackedArray.check_end`.

    Returns:
        The unpacked arrays and the packed ones, by name.

    Raises:
        InputError: the archive or an array is damaged, too large or something else.
    """
    try:
        with open(path, "rb") as raw, zipfile.ZipFile(raw) as archive:
            infos = {info.filename: info for info in archive.infolist()}
            data: dict[str, NDArray] = {}
            kept: dict[str, PackedArray] = {}
            for name, check in checks.items():
                info = infos.get(f"{name}.npy")
                if info is None:
                    continue
                if info.file_size > _MAX_RATIO * info.compress_size + _BLOCK:
                    raise InputError(f"{path}: {name}: expected an array, found a size that its bytes cannot have")
                with archive.open(info) as file:
                    if name in packed:
                        array = PackedArray(f"{path}: {name}", _packed(raw, info), info, check)
                        if array.ndim == 1 or not array.by_columns:
                            kept[name] = array
                            continue
                    data[name] = read_npy(f"{path}: {name}", file, info.file_size, check)
            return data, kept
    except ARCHIVE_FAULTS as error:
        why = one_line(error)
        raise InputError(f"{path}: expected a complete {what}, found a damaged or foreign one ({why})") from error


def write_rows(file: IO[bytes], dtype: np.dtype, count: int, parts: Iterable[NDArray]) -> None:
    """Write an array with one axis, of ``count`` numbers, as `numpy.save` does, but part by part."""
    head = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": (count,)}
    np.lib.format.write_array_header_1_0(file, head)
    for part in parts:
        file.write(np.ascontiguousarray(part, dtype).data)


def _packed(archive: IO[bytes], info: zipfile.ZipInfo) -> bytes:
    """Return the compressed bytes of an archive's member, whose local header `zipfile` has checked."""
    if (
        info.file_size > MAX_ARRAY_BYTES + _BLOCK
        or info.compress_size > info.file_size + info.file_size // 100 + _BLOCK
    ):
        raise ValueError("a member that no array can be")
    archive.seek(info.header_offset)
    name, extra = struct.unpack("<26xHH", archive.read(30))
    at = info.header_offset + 30 + name + extra
    archive.seek(at)
    return archive.read(max(min(info.compress_size, os.fstat(archive.fileno()).st_size - at), 0))


def _fill(file: IO[bytes], view: memoryview, fault: InputError) -> None:
    """Read exactly as many bytes as there is room for, in blocks; raises ``fault`` where the file ends before."""
    at = 0
    while at < len(view):
        block = file.read(min(_BLOCK, len(view) - at))
        if not block:
            raise fault
        view[at : at + len(block)] = block
        at += len(block)
