"""Tells how large LZFSE data is when unpacked, from the headers of its blocks (Apple's lzfse_internal.h)."""

import struct

_END, _RAW, _LZVN, _V1, _V2 = b"bvx$", b"bvx-", b"bvxn", b"bvx1", b"bvx2"
_V1_HEADER = 772
"""Bytes; it holds its tables of frequencies as they are."""


def lzfse_size(data: bytes) -> int:
    """Give the number of bytes that the blocks say they hold; raises ValueError for what is no LZFSE data."""
    at, size = 0, 0
    try:
        while data[at : at + 4] != _END:
            magic = data[at : at + 4]
            (unpacked,) = struct.unpack_from("<I", data, at + 4)
            size += unpacked
            if magic == _RAW:
                at += 8 + unpacked
            elif magic == _LZVN:
                at += 12 + struct.unpack_from("<I", data, at + 8)[0]
            elif magic == _V1:
                literals, matches = struct.unpack_from("<II", data, at + 20)
                at += _V1_HEADER + literals + matches
            elif magic == _V2:
                first, second, third = struct.unpack_from("<QQQ", data, at + 8)
                header = third & 0xFFFFFFFF
                if header < 32:
                    raise ValueError("a block without a header")
                at += header + ((first >> 20) & 0xFFFFF) + ((second >> 40) & 0xFFFFF)
            else:
                raise ValueError("another kind of block")
    except struct.error as error:
        raise ValueError("data that is cut short") from error
    return size
