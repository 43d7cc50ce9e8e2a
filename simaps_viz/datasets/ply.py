"""Reads the points of PLY files: ASCII and binary of either byte order."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.cloud_files import finite_points, parse_rows, read_cloud, whole_number
from simaps_viz.errors import InputError

_SCALARS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 65_536
_LIST = "list"


@dataclass
class _Element:
    """One kind of thing a PLY file lists."""

    name: str
    count: int
    properties: list[tuple[str, str]]
    """(name, NumPy type or "list")."""


def read_ply(path: Path) -> NDArray:
    """Read the vertices of a PLY file as float64 [n, 3]; those that are not finite are left out.

    Raises:
        InputError: It is missing, damaged or cut short, or its vertices have no x, y and z.
    """
    data = read_cloud(path)
    form, elements, start = _header(path, data)
    before = []
    for element in elements:
        if element.name == "vertex":
            return _vertices(path, data, start, form, before, element)
        before.append(element)
    raise InputError(f"{path}: expected an element vertex, found {', '.join(e.name for e in elements) or 'none'}")


def _header(path: Path, data: bytes) -> tuple[str, list[_Element], int]:
    """Return the format's word, the elements and where the data begins."""
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    if not data.startswith(b"ply") or end < 0:
        raise InputError(f"{path}: expected a PLY file with a header, found another kind of file, or one cut short")
    form, elements = "", []
    for line in data[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        if words[:1] == ["format"] and len(words) == 3:
            form = words[1]
        elif words[:1] == ["element"] and len(words) == 3:
            elements.append(_Element(words[1], whole_number(path, f"element {words[1]}", words[2]), []))
        elif words[:1] == ["property"] and len(words) >= 3 and elements:
            kind = _LIST if words[1] == _LIST else _SCALARS.get(words[1])
            if kind is None:
                raise InputError(f"{path}: expected properties of {', '.join(_SCALARS)}, found {words[1][:30]!r}")
            elements[-1].properties.append((words[-1], kind))
    if form != "ascii" and form not in _ORDERS:
        raise InputError(f"{path}: expected format ascii, {', '.join(_ORDERS)}, found {form[:30]!r}")
    newline = data.find(b"\n", end)
    return form, elements, newline + 1 if newline >= 0 else len(data)


def _vertices(path: Path, data: bytes, start: int, form: str, before: list[_Element], vertex: _Element) -> NDArray:
    names = [name for name, _ in vertex.properties]
    if not {"x", "y", "z"} <= set(names) or len(set(names)) != len(names):
        raise InputError(f"{path}: expected vertices with x, y and z, each once, found {', '.join(names) or 'nothing'}")
    if any(kind == _LIST for element in (*before, vertex) for _, kind in element.properties):
        raise InputError(
            f"{path}: expected vertices of plain numbers that come first, found a list among or before them"
        )
    if form == "ascii":
        skipped = sum(element.count for element in before)
        rows = parse_rows(path, data[start:], vertex.count, len(names), skip=skipped)
        return finite_points(rows[:, [names.index(axis) for axis in "xyz"]])
    order = _ORDERS[form]
    offset = start + sum(e.count * _row_type(e, order).itemsize for e in before)
    row = _row_type(vertex, order)
    if len(data) - offset < vertex.count * row.itemsize:
        found = f"{max(len(data) - offset, 0)} bytes"
        raise InputError(f"{path}: expected {vertex.count} vertices of {row.itemsize} bytes, found {found}")
    table = np.frombuffer(data, row, vertex.count, offset)
    return finite_points(np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1))


def _row_type(element: _Element, order: str) -> np.dtype:
    return np.dtype([(f"{i}" if element.name != "vertex" else name, order + kind)
                     for i, (name, kind) in enumerate(element.properties)])  # fmt: skip
