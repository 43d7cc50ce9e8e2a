"""Unpacks LZF, the compression inside binary_compressed PCD files (format of Marc Lehmann's liblzf)."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.errors import InputError


def lzf_unpack(where: object, packed: bytes, size: int) -> bytes:
    """Unpack bytes that are ``size`` long when unpacked; raises InputError when they are not."""
    if size > 264 * len(packed):  # nothing packs better than 264 bytes into 3
        raise InputError(f"{where}: expected {size} bytes when unpacked, found {len(packed)} packed ones")
    out = np.zeros(size, np.uint8)
    written = _unpack(np.frombuffer(packed, np.uint8), out)
    if written != size:
        raise InputError(f"{where}: expected {size} bytes when unpacked, found damaged or missing ones")
    return out.tobytes()


@njit(cache=True, nogil=True)
def _unpack(packed: NDArray, out: NDArray) -> int:
    """Give the number of bytes written, or -1 for what cannot have been packed.

    A control byte under 32 is followed by one byte more than it says, as they are; any other has the length of a
    repeat in its upper 3 bits (7: one more byte of length follows) and the distance back in the other 5 and the next 8.
    """
    read = written = 0
    while read < packed.size:
        control = int(packed[read])
        read += 1
        if control < 32:
            length = control + 1
            if read + length > packed.size or written + length > out.size:
                return -1
            for _ in range(length):
                out[written] = packed[read]
                written += 1
                read += 1
            continue
        length = control >> 5
        if length == 7:
            if read >= packed.size:
                return -1
            length += int(packed[read])
            read += 1
        if read >= packed.size:
            return -1
        back = written - ((control & 31) << 8) - int(packed[read]) - 1
        read += 1
        length += 2
        if back < 0 or written + length > out.size:
            return -1
        for _ in range(length):
            out[written] = out[back]
            written += 1
            back += 1
    return written
