"""Read point clouds, and render them as depth images of a camera, so that all later steps are the same for both.

A cloud is thinner than a picture: between the points of a near thing those of what lies behind it are seen. They would
take its class, so a point is left out where nearer ones surround it. What is left needs no neighbours: every point
counts for the cell it falls in.

Read are PLY (ASCII and binary) and PCD (ascii, binary and binary_compressed). Counts in a header are checked against
the file's size before anything is allocated. trimesh reads PLY as well, but its errors name neither the file nor what
was expected, and PCD it does not know.
"""

import struct
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import Lens, see_through
from simaps_viz.datasets.gravity import Gravity, find_gravity
from simaps_viz.errors import InputError
from simaps_viz.geometry import back_project, transform_points
from simaps_viz.io.limits import MAX_CLOUD_BYTES, MAX_CLOUD_POINTS, read_bytes
from simaps_viz.structures import Frame, Intrinsics

_MAX_HEADER_BYTES = 65_536


def whole_number(path: Path, what: str, word: str) -> int:
    """Read how many there are of something; raises InputError for what is no sensible number."""
    if not word.isascii() or not word.isdigit() or len(word) > 12 or int(word) > MAX_CLOUD_POINTS:
        raise InputError(f"{path}: {what}: expected a whole number up to {MAX_CLOUD_POINTS}, found {word[:30]!r}")
    return int(word)


def parse_rows(path: Path, data: bytes, count: int, columns: int, *, skip: int = 0) -> NDArray:
    """Read ``count`` lines of so many numbers as float64 [count, columns], after ``skip`` other lines.

    Raises:
        InputError: There are fewer lines, or something in them is no number.
    """
    lines = [line for line in data.split(b"\n") if line.strip()][skip : skip + count]
    words = b" ".join(lines).split()
    if len(lines) < count or len(words) != count * columns:
        raise InputError(
            f"{path}: expected {count} lines of {columns} numbers, found {len(words)} numbers in {len(lines)} lines"
        )
    try:
        return np.array(words, dtype="S").astype(np.float64).reshape(count, columns)
    except ValueError as error:
        raise InputError(f"{path}: expected points of numbers, found something else among them") from error


def finite_points(points: NDArray) -> NDArray:
    """Return the points [n, 3] that are finite; drivers write NaN for rays that met nothing."""
    return np.ascontiguousarray(points[np.isfinite(points).all(axis=1)], dtype=np.float64)


_SCALARS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
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
    data = read_bytes(path, MAX_CLOUD_BYTES, "a point cloud")
    form, elements, start = _ply_header(path, data)
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise InputError(f"{path}: expected an element vertex, found {', '.join(names) or 'none'}")
    number = names.index("vertex")
    return _vertices(path, data, start, form, elements[:number], elements[number])


def _ply_header(path: Path, data: bytes) -> tuple[str, list[_Element], int]:
    """Return the format's word, the elements and where the data begins."""
    end = data.find(b"end_header", 0, _MAX_HEADER_BYTES)
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
    """Return the number of bytes written, or -1 for what cannot have been packed.

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


_KINDS = {("F", 4): "<f4", ("F", 8): "<f8", ("I", 1): "i1", ("I", 2): "<i2", ("I", 4): "<i4", ("I", 8): "<i8",
          ("U", 1): "u1", ("U", 2): "<u2", ("U", 4): "<u4", ("U", 8): "<u8"}  # fmt: skip
_STORED = ("ascii", "binary", "binary_compressed")
_REPEATED = 4096
"""Most numbers one field may hold; histograms have some hundreds."""


def read_pcd(path: Path) -> NDArray:
    """Read the points of a PCD file as float64 [n, 3]; those that are not finite are left out. VIEWPOINT is not used.

    Raises:
        InputError: It is missing, damaged or cut short, or its points have no x, y and z.
    """
    data = read_bytes(path, MAX_CLOUD_BYTES, "a point cloud")
    header, body = _pcd_header(path, data)
    stored = header["DATA"][0] if header["DATA"] else ""
    if stored not in _STORED:
        raise InputError(f"{path}: DATA: expected one of {', '.join(_STORED)}, found {stored[:30]!r}")
    fields = _fields(path, header)
    count = _points(path, header)
    if stored == "ascii":
        return _from_text(path, body, fields, count)
    size = count * sum(np.dtype(kind).itemsize * repeats for _, kind, repeats in fields)
    if stored == "binary_compressed":
        return _by_columns(path, _unpacked(path, body, size), fields, count)
    if len(body) < size:
        raise InputError(f"{path}: expected {count} points in {size} bytes, found {len(body)} bytes")
    row = np.dtype({
        "names": [f"{i}" for i in range(len(fields))],
        "formats": [(kind, (repeats,)) for _, kind, repeats in fields],
    })  # fmt: skip
    table = np.frombuffer(body, row, count)
    columns = [table[str(_index(fields, axis))][:, 0].astype(np.float64) for axis in "xyz"]
    return finite_points(np.stack(columns, axis=1))


def _pcd_header(path: Path, data: bytes) -> tuple[dict[str, list[str]], bytes]:
    """Return {keyword: its words} and what follows the line DATA."""
    header: dict[str, list[str]] = {}
    start = 0
    while start < min(len(data), _MAX_HEADER_BYTES):
        end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        words = data[start:end].decode("latin-1").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            header[words[0].upper()] = words[1:]
            if words[0].upper() == "DATA":
                return header, data[start:]
    raise InputError(
        f"{path}: expected a PCD file with a header up to DATA, found another kind of file, or one cut short"
    )


def _fields(path: Path, header: dict[str, list[str]]) -> list[tuple[str, str, int]]:
    """Return (name, NumPy type, repeats) of each field."""
    names = header.get("FIELDS", header.get("COLUMNS", []))
    sizes, types = header.get("SIZE", []), header.get("TYPE", [])
    counts = header.get("COUNT", ["1"] * len(names))
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path}: FIELDS: expected x, y and z, found {', '.join(names) or 'none'}")
    if not len(names) == len(sizes) == len(types) == len(counts):
        found = f"{len(sizes)}, {len(types)} and {len(counts)}"
        raise InputError(f"{path}: SIZE, TYPE, COUNT: expected {len(names)} words each, found {found}")
    fields = []
    for name, size, kind, repeats in zip(names, sizes, types, counts, strict=True):
        dtype = _KINDS.get((kind, int(size) if size.isdecimal() and len(size) < 3 else 0))
        times = int(repeats) if repeats.isdecimal() and len(repeats) < 6 else 0
        if repeats == "0" and name not in ("x", "y", "z"):  # PCL pads its points with fields "_", some of no bytes
            continue
        if dtype is None or not 1 <= times <= _REPEATED:
            raise InputError(f"{path}: field {name}: expected a number type, found {kind} of {size} bytes, {repeats}")
        fields.append((name, dtype, times))
    return fields


def _points(path: Path, header: dict[str, list[str]]) -> int:
    if header.get("POINTS"):
        return whole_number(path, "POINTS", header["POINTS"][0])
    width, height = (header.get(key, ["1"])[:1] or ["1"] for key in ("WIDTH", "HEIGHT"))
    return whole_number(path, "WIDTH", width[0]) * whole_number(path, "HEIGHT", height[0])


def _index(fields: list[tuple[str, str, int]], axis: str) -> int:
    return [name for name, _, _ in fields].index(axis)


def _from_text(path: Path, body: bytes, fields: list[tuple[str, str, int]], count: int) -> NDArray:
    starts = np.cumsum([0, *(repeats for _, _, repeats in fields)])
    rows = parse_rows(path, body, count, int(starts[-1]))
    return finite_points(rows[:, [starts[_index(fields, axis)] for axis in "xyz"]])


def _unpacked(path: Path, body: bytes, size: int) -> bytes:
    packed, unpacked = struct.unpack_from("<II", body) if len(body) >= 8 else (0, 0)
    if unpacked != size or len(body) - 8 < packed:
        found = f"{len(body)} bytes that unpack to {unpacked}"
        raise InputError(f"{path}: expected points in {size} bytes, packed, found {found}")
    return lzf_unpack(path, body[8 : 8 + packed], size)


def _by_columns(path: Path, data: bytes, fields: list[tuple[str, str, int]], count: int) -> NDArray:
    """Read unpacked points: all values of the first field, then all of the second, and so on."""
    start, columns = 0, {}
    for name, kind, repeats in fields:
        if name in ("x", "y", "z"):
            columns[name] = np.frombuffer(data, kind, count * repeats, start)[::repeats].astype(np.float64)
        start += np.dtype(kind).itemsize * repeats * count
    return finite_points(np.stack([columns[axis] for axis in "xyz"], axis=1))


NEAREST_M = 0.05
HIDDEN_STEP = 0.1
"""What lies behind the points around it by more than this share of its depth is hidden."""
WIDEST_GAP = 8
"""Pixels; a cloud thinner than one point in (2 x 8)^2 pixels leaves gaps through which hidden points show."""
COARSEST = 32
_DENSE = 0.6
"""Share of pixels with a reading that surfaces can be found in."""
_FLOOR_REACH_M, _FLOOR_POINTS = 0.1, 50


@dataclass(frozen=True)
class CloudSettings:
    """How clouds become depth images."""

    hidden_pixels: int | None = None
    """Points are hidden by nearer ones that are no more than so many pixels away; None = as the cloud's gaps are."""
    fill_pixels: int = 0
    """Pixels without a point take the depth of the nearest one that is no more than so many pixels away. Method paper
    links neighbouring pixels and needs this; method evidence does not."""


def depth_of_cloud(points_camera: NDArray, k: Intrinsics, settings: CloudSettings) -> NDArray:
    """Render a cloud: every point falls in its nearest pixel, the nearest point of a pixel wins.

    Args:
        points_camera: float64 [n, 3], camera axes, metres.
        k: the camera.
        settings: which points are hidden, and which gaps are filled.

    Returns:
        float32 [H, W], metres along the optical axis, 0 = no point.
    """
    depth_m = _z_buffer(points_camera, k)
    hidden = gap_pixels(depth_m) if settings.hidden_pixels is None else settings.hidden_pixels
    if hidden > 0:
        depth_m[_hidden(depth_m, hidden)] = 0.0
    return _fill(depth_m, settings.fill_pixels) if settings.fill_pixels > 0 else depth_m


def register_depth(depth_m: NDArray, lens: Lens, T_camera_depth: NDArray, target: Intrinsics) -> NDArray:
    """Return the depth image that another camera beside the one that took it would have taken.

    Args:
        depth_m: float32 [H, W], metres, 0 = invalid.
        lens: the camera that took it.
        T_camera_depth: [4, 4], takes its points to the other camera's frame.
        target: the other camera, no finer than the first, or there are gaps wider than a pixel.

    Returns:
        float32 [H, W] of ``target``, metres, 0 = invalid.
    """
    k = lens.intrinsics
    straight = see_through(depth_m, lens, k, exact=True)
    points = back_project(straight, k.fx, k.fy, k.cx, k.cy)[straight > 0]
    share = max(k.fx / target.fx, 1.0)  # where several points fall in a pixel, its centre's counts, not the nearest
    fine = Lens(target).scaled(round(target.width * share), round(target.height * share)).intrinsics
    seen = depth_of_cloud(camera_points(points, T_camera_depth), fine, CloudSettings(fill_pixels=1))
    return see_through(seen, Lens(fine), target, exact=True)


def gap_pixels(depth_m: NDArray) -> int:
    """Return half the usual distance of a sparse depth image's readings, whole pixels; 0 for a full one."""
    share = _share(depth_m)
    return 0 if share is None else min(int(0.5 / np.sqrt(share) + 0.25), WIDEST_GAP)


def _share(depth_m: NDArray) -> float | None:
    """Return the share of pixels with a reading in the rectangle around all readings; None where there are none."""
    filled = depth_m > 0
    rows, cols = np.flatnonzero(filled.any(axis=1)), np.flatnonzero(filled.any(axis=0))
    return float(filled[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1].mean()) if len(rows) else None


def gravity_of_clouds(
    clouds: list[tuple[NDArray, NDArray]], k: Intrinsics, up: tuple[float, float, float] | None
) -> Gravity:
    """Estimate up and the floor's height from clouds, seen by a camera coarse enough to have no gaps.

    Args:
        clouds: (points in camera axes [n, 3], T_world_camera [4, 4]) of some forty frames.
        k: the camera.
        up: known already; only the floor is looked for.
    """
    divide = 1
    while divide < COARSEST and _fullness(clouds, _coarse(k, divide)) < _DENSE:
        divide *= 2
    camera = _coarse(k, divide)
    frames = [
        Frame(
            i, str(i), _z_buffer(points, camera) if divide == 1 else _averaged(points, camera), T_world_camera, camera
        )
        for i, (points, T_world_camera) in enumerate(clouds)
    ]
    found = find_gravity(frames, up=None if up is None else np.array(up))
    if divide == 1 or found.floor_note:
        return found
    return replace(found, floor_height_m=_sharper(clouds, found.up, found.floor_height_m))


def camera_points(points: NDArray, T_camera_points: NDArray) -> NDArray:
    """Move a cloud to the camera and drop what lies behind it."""
    moved = transform_points(T_camera_points, points)
    return moved[moved[:, 2] > NEAREST_M]


def _z_buffer(points_camera: NDArray, k: Intrinsics) -> NDArray:
    pixel, z = _pixels(points_camera, k)
    nearest = np.full(k.height * k.width, np.inf, np.float32)
    np.minimum.at(nearest, pixel, z.astype(np.float32))
    nearest[np.isinf(nearest)] = 0.0
    return nearest.reshape(k.height, k.width)


def _averaged(points_camera: NDArray, k: Intrinsics) -> NDArray:
    """The depth of each large pixel's front surface at its centre: on a plane, 1 / depth is linear in u and v."""
    pixel, z = _pixels(points_camera, k)
    front = z < _z_buffer(points_camera, k).ravel()[pixel] * (1.0 + 2 * HIDDEN_STEP)
    size = k.height * k.width
    points = np.bincount(pixel[front], minlength=size)
    inverse = np.bincount(pixel[front], weights=1.0 / z[front], minlength=size)
    return np.divide(points, inverse, out=np.zeros(size), where=points > 0).astype(np.float32).reshape(k.height, -1)


def _pixels(points_camera: NDArray, k: Intrinsics) -> tuple[NDArray, NDArray]:
    """Return the pixel (v * width + u) and the depth of every point that falls in the picture."""
    front = points_camera[points_camera[:, 2] > NEAREST_M]
    z = front[:, 2]
    u = np.rint(front[:, 0] / z * k.fx + k.cx)
    v = np.rint(front[:, 1] / z * k.fy + k.cy)
    inside = (u >= 0) & (u < k.width) & (v >= 0) & (v < k.height)
    return v[inside].astype(np.int64) * k.width + u[inside].astype(np.int64), z[inside]


def _sharper(clouds: list[tuple[NDArray, NDArray]], up: NDArray, floor_height_m: float) -> float:
    """Move a floor found by coarse pixels to where the points are densest around it, metres."""
    heights = np.concatenate([transform_points(T, points) @ up for points, T in clouds])
    near = heights[np.abs(heights - floor_height_m) < _FLOOR_REACH_M]
    if len(near) < _FLOOR_POINTS:
        return floor_height_m
    counts, edges = np.histogram(near, bins=25)
    window = np.convolve(counts, np.ones(5), mode="same")
    centre = (edges[np.argmax(window)] + edges[np.argmax(window) + 1]) / 2
    return float(np.median(near[np.abs(near - centre) < _FLOOR_REACH_M / 5]))


def _hidden(depth_m: NDArray, pixels: int) -> NDArray:
    """Return which readings lie well behind another one in the square around them, bool [H, W]."""
    far = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    surface = cv2.erode(far, np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8))
    return (depth_m > 0) & (surface < depth_m * np.float32(1.0 - HIDDEN_STEP))


def _fill(depth_m: NDArray, pixels: int) -> NDArray:
    if not (depth_m > 0).any():
        return depth_m
    empty = (depth_m <= 0).astype(np.uint8)
    distance, nearest = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    number = np.asarray(nearest, dtype=np.int64)
    depth_of = np.zeros(int(number.max()) + 1, np.float32)
    depth_of[number[empty == 0]] = depth_m[empty == 0]
    return np.where(np.asarray(distance) <= pixels, depth_of[number], np.float32(0.0))


def _coarse(k: Intrinsics, divide: int) -> Intrinsics:
    """Return the camera with pixels so many times larger."""
    if divide == 1:
        return k
    width, height = max(k.width // divide, 1), max(k.height // divide, 1)
    return Intrinsics(width, height, k.fx / divide, k.fy / divide, (k.cx + 0.5) / divide - 0.5,
                      (k.cy + 0.5) / divide - 0.5)  # fmt: skip


def _fullness(clouds: list[tuple[NDArray, NDArray]], k: Intrinsics) -> float:
    shares = [share for points, _ in clouds if (share := _share(_z_buffer(points, k))) is not None]
    return float(np.median(shares)) if shares else 0.0
