"""Writes tiny ONNX files byte by byte, no package is needed for it: most answer every picture with the same numbers.

Field numbers are those of onnx.proto3; a message is a row of (number, wire type) keys and values.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FLOAT, INT32, INT64 = 1, 6, 7
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


def node(kind: str, inputs: Sequence[str], output: str, **whole: int | Sequence[int]) -> bytes:
    """Return an operation with attributes that are whole numbers."""
    found = b"".join(_bytes(1, name) for name in inputs) + _bytes(2, output) + _bytes(4, kind)
    for name, value in whole.items():
        if isinstance(value, int):
            kept = _number(3, value) + _number(20, 2)
        else:
            kept = b"".join(_number(8, one) for one in value) + _number(20, 7)
        found += _bytes(5, _bytes(1, name) + kept)
    return found


def write_graph(
    path: Path,
    nodes: Sequence[bytes],
    inputs: Mapping[str, tuple[Shape, int]],
    outputs: Mapping[str, Shape],
    constants: Mapping[str, NDArray],
) -> Path:
    """Write a network of operations on inputs (shape, kind of elements) and constants, which are floats."""
    graph = b"".join(_bytes(1, one) for one in nodes) + _bytes(2, "tiny")
    graph += b"".join(_bytes(5, _tensor(name, array)) for name, array in constants.items())
    graph += b"".join(_bytes(11, _value(name, shape, kind)) for name, (shape, kind) in inputs.items())
    graph += b"".join(_bytes(12, _value(name, shape)) for name, shape in outputs.items())
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, "") + _number(2, 13)))
    return path
