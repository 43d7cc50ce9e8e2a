"""Writes ONNX files that answer every picture with the same numbers, byte by byte: no package is needed for it.

Field numbers are those of onnx.proto3; a message is a row of (number, wire type) keys and values.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FLOAT, INT64 = 1, 7
Shape = Sequence[int | str]


def _varint(value: int) -> bytes:
    out = bytearray()
    while True:
        value, low = value >> 7, value & 127
        out.append(low | (128 if value else 0))
        if not value:
            return bytes(out)


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, value: bytes | str) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _value(name: str, shape: Shape, kind: int = FLOAT) -> bytes:
    dims = b"".join(_bytes(1, _number(1, n) if isinstance(n, int) else _bytes(2, n)) for n in shape)
    return _bytes(1, name) + _bytes(2, _bytes(1, _number(1, kind) + _bytes(2, dims)))


def _tensor(name: str, array: NDArray) -> bytes:
    dims = b"".join(_number(1, n) for n in array.shape)
    return dims + _number(2, FLOAT) + _bytes(8, name) + _bytes(9, array.astype("<f4").tobytes())


def write_onnx(
    path: Path,
    outputs: Mapping[str, NDArray],
    *,
    image: Shape = (1, 3, 32, 32),
    metadata: Mapping[str, str] | None = None,
    shapes: Mapping[str, Shape] | None = None,
    inputs: Mapping[str, Shape] | None = None,
    kind: int = FLOAT,
) -> Path:
    """Write a network.

    Args:
        path: the file.
        outputs: what it answers, by name.
        image: the shape of its input "images"; words are sizes left open.
        metadata: its metadata.
        shapes: of the outputs as the file declares them, where not the real ones.
        inputs: by name, in place of "images".
        kind: of the inputs' elements.
    """
    graph = b""
    for name, array in outputs.items():
        graph += _bytes(1, _bytes(1, f"{name}_value") + _bytes(2, name) + _bytes(4, "Identity"))
        graph += _bytes(5, _tensor(f"{name}_value", np.asarray(array)))
        graph += _bytes(12, _value(name, (shapes or {}).get(name, np.asarray(array).shape)))
    for name, shape in (inputs or {"images": image}).items():
        graph += _bytes(11, _value(name, shape, kind))
    model = _number(1, 8) + _bytes(7, graph + _bytes(2, "tiny")) + _bytes(8, _bytes(1, "") + _number(2, 17))
    for key, text in (metadata or {}).items():
        model += _bytes(14, _bytes(1, key) + _bytes(2, text))
    path.write_bytes(model)
    return path
