"""Read RTAB-Map's databases (``rtabmap.db``): pictures, depth and the poses of its optimised graph.

A database is SQLite. Poses are the robot base's; each picture's calibration has the camera's place on it. Pictures are
rectified, so P is their camera and the distortion beside it is not applied.
"""

import math
import operator
import sqlite3
import struct
import threading
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import Lens, pinhole, rigid
from simaps_viz.datasets.file_frames import FileFrames, Stored, clean_depth
from simaps_viz.datasets.images import decode_color, decode_image
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, complete, left_out
from simaps_viz.datasets.ros_messages import unpack_rvl
from simaps_viz.errors import InputError, one_line
from simaps_viz.io.limits import MAX_FRAMES, MAX_IMAGE_BYTES, MAX_TEXT_BYTES

FACTS = FormatFacts(
    title="RTAB-Map",
    recognised_by="`*.db`",
    depth="16-bit PNG or RVL, 32-bit float as PNG",
    pose="base to map: 3x4, times base to camera",
    up=(0.0, 0.0, 1.0),
)
_RVL_MAGIC, _RVL_SIZE = b"DEPTHRVL", struct.Struct("<II")
_CALIBRATION = struct.Struct("<11i")
"""Version (three numbers), kind (0: one camera, 1: stereo), width, height, and how many numbers K, D, R, P and the
camera's place have."""
_MAX_VERSION = 1000
"""Versions are smaller; read as one, the focal length that older calibrations begin with is larger."""
_PLACE = 12
_MAT = struct.Struct("<3i")
"""Rows, columns and OpenCV's type, behind zipped numbers."""


def _recognise(path: Path) -> bool:
    return path.suffix == ".db" and path.is_file()


def _open_path(path: Path) -> Recording:
    with complete(path, FACTS.title):
        return _open(path, Database(path))


READER = Reader(FACTS, _recognise, _open_path)


class Database:
    """An open database; reading is one thread at a time, decoding is not."""

    def __init__(self, path: Path) -> None:
        self.path, self._lock = path, threading.Lock()
        self._connection: sqlite3.Connection | None = None
        try:
            self._connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, check_same_thread=False)
            self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_IMAGE_BYTES)
        except (sqlite3.Error, ValueError) as error:
            raise InputError(f"{path}: expected an RTAB-Map database, found {one_line(error)}") from error

    def __del__(self) -> None:
        if self._connection is not None:
            self._connection.close()

    def rows(self, query: str, *values: Any) -> list[tuple]:
        """Return the rows of a query; raises InputError when the database is damaged or lacks what is asked for."""
        assert self._connection is not None
        try:
            with self._lock:
                return self._connection.execute(query, values).fetchmany(MAX_FRAMES + 1)
        except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
            raise InputError(f"{self.path}: expected an RTAB-Map database, found {one_line(error)}") from error

    def picture(self, column: str, node: int) -> bytes:
        """Return the stored bytes of a node's image or depth."""
        found = self.rows(f"SELECT {column} FROM Data WHERE id = ?", node)
        return bytes(found[0][0]) if found and isinstance(found[0][0], bytes) else b""


def _open(path: Path, database: Database) -> Recording:
    nodes = database.rows(
        "SELECT Node.id, Node.pose, Data.calibration FROM Node JOIN Data ON Node.id = Data.id "
        "WHERE length(Data.image) > 0 AND length(Data.depth) > 0 ORDER BY Node.stamp, Node.id"
    )
    if not nodes:
        stored = database.rows("SELECT count(*) FROM Node")[0][0]
        raise InputError(
            f"{path}: expected nodes with a picture and depth, found none in {stored} nodes; RTAB-Map keeps them where "
            "Mem/BinDataKept is true, in mapping mode"
        )
    optimised = _optimised(database)
    posed = {
        node: optimised[node] if optimised else _matrix(f"{path}: node {node}", pose)
        for node, pose, _ in nodes
        if (node in optimised if optimised else pose)
    }
    notes = left_out(len(nodes) - len(posed), len(nodes), "nodes have no pose in the optimised graph")
    if not posed:
        raise InputError(f"{path}: expected poses, found none for {len(nodes)} nodes with pictures")
    if not optimised:
        notes = (*notes, "poses are odometry's: the database has no optimised ones (Admin.opt_poses)")
    kept = [node for node, _, _ in nodes if node in posed]
    calibrations = {node: bytes(data or b"") for node, _, data in nodes if node in posed}
    size = decode_color(f"{path}: node {kept[0]}", database.picture("image", kept[0])).shape[:2]
    cameras = [_camera(f"{path}: node {node}: calibration", calibrations[node], size) for node in kept]

    def stored(column: str, decode: Callable[[str, bytes], NDArray]) -> list[Stored]:
        def of(node: int) -> Stored:
            where = f"{path}: node {node}: {column}"
            return Stored(where, lambda: decode(where, database.picture(column, node)))

        return [of(node) for node in kept]

    files = FileFrames.of_one_view(
        stored("image", decode_color), stored("depth", _depth), [lens for lens, _ in cameras], operator.call,
        read_color=operator.call,
    )  # fmt: skip
    return files.recording(
        FACTS,
        path,
        name=path.resolve().stem,
        frame_names=tuple(f"{node:06d}" for node in kept),
        poses=np.stack([posed[node] @ T for node, (_, T) in zip(kept, cameras, strict=True)]),
        notes=notes,
    )


def _optimised(database: Database) -> dict[int, NDArray]:
    """Return {node: its pose after loop closures}; empty where the database has none, as before version 0.17."""
    columns = [row[1] for row in database.rows("PRAGMA table_info(Admin)")]
    if not {"opt_ids", "opt_poses"} <= set(columns):
        return {}
    for ids, poses in database.rows("SELECT opt_ids, opt_poses FROM Admin"):
        if ids and poses:
            where = f"{database.path}: Admin.opt_poses"
            numbers = _unzipped(where, ids, "<i4")
            matrices = _unzipped(where, poses, "<f4")
            if matrices.size != _PLACE * numbers.size:
                raise InputError(f"{where}: expected {numbers.size} poses, found {matrices.size} numbers")
            rows = matrices.reshape(-1, _PLACE)
            return {int(n): _matrix(f"{where}: node {n}", row.tobytes()) for n, row in zip(numbers, rows, strict=True)}
    return {}


def _unzipped(where: str, data: bytes, dtype: str) -> NDArray:
    if len(data) <= _MAT.size:
        raise InputError(f"{where}: expected packed numbers, found {len(data)} bytes")
    try:
        raw = zlib.decompressobj().decompress(data[: -_MAT.size], MAX_TEXT_BYTES)
    except zlib.error as error:
        raise InputError(f"{where}: expected packed numbers, found {one_line(error)}") from error
    return np.frombuffer(raw[: len(raw) // 4 * 4], dtype)


def _matrix(where: str, data: bytes) -> NDArray:
    """Return the pose [4, 4] of twelve floats, row by row."""
    if len(data) != 4 * _PLACE:
        raise InputError(f"{where}: expected a pose of twelve floats, found {len(data)} bytes")
    return rigid(where, np.vstack([np.frombuffer(data, "<f4").reshape(3, 4), [0, 0, 0, 1]]))


def _camera(where: str, data: bytes, size: tuple[int, int]) -> tuple[Lens, NDArray]:
    """Return the camera of rectified pictures [height, width], and its place on the base."""
    if len(data) < _CALIBRATION.size:
        raise InputError(f"{where}: expected one as of RTAB-Map 0.10 or later, found {len(data)} bytes")
    version, _, _, kind, width, height, *counts = _CALIBRATION.unpack_from(data)
    if version > _MAX_VERSION:
        return _old_camera(where, data, size)
    if kind != 0:
        raise InputError(f"{where}: expected one camera with depth, found stereo or another kind ({kind})")
    length = _CALIBRATION.size + 8 * sum(counts[:4]) + 4 * counts[4]
    if min(counts) < 0 or counts[0] != 9 or counts[4] != _PLACE or len(data) < length:
        raise InputError(f"{where}: expected a camera of {length} bytes, found {len(data)}")
    if len(data) > length:
        raise InputError(f"{where}: expected one camera, found {len(data)} bytes for several")
    values = np.frombuffer(data, "<f8", sum(counts[:4]), _CALIBRATION.size)
    K, P = values[:9], values[sum(counts[:3]) :]
    fx, fy, cx, cy = (P[0], P[5], P[2], P[6]) if len(P) == 12 and P[0] > 0 else (K[0], K[4], K[2], K[5])
    if width <= 0 or height <= 0:
        height, width = size
    lens = Lens(pinhole(where, width, height, float(fx), float(fy), float(cx), float(cy)))
    return lens.scaled(size[1], size[0]), _matrix(where, data[length - 4 * _PLACE : length])


def _old_camera(where: str, data: bytes, size: tuple[int, int]) -> tuple[Lens, NDArray]:
    """Return the camera as stored before version 0.18, in floats: fx, fy, cx, cy, since 0.11.2 the size, the place."""
    if len(data) not in (4 * (4 + _PLACE), 4 * (6 + _PLACE)):
        raise InputError(f"{where}: expected one camera with depth, found {len(data)} bytes for stereo or several")
    fx, fy, cx, cy, *stated = np.frombuffer(data, "<f4").tolist()[:-_PLACE]
    width, height = stated if stated and all(1 <= length < math.inf for length in stated) else (size[1], size[0])
    lens = Lens(pinhole(where, int(width), int(height), fx, fy, cx, cy))
    return lens.scaled(size[1], size[0]), _matrix(where, data[-4 * _PLACE :])


def _depth(where: str, data: bytes) -> NDArray:
    """Return depth, float32 [H, W], metres, 0 = invalid."""
    if data.startswith(_RVL_MAGIC):
        start = len(_RVL_MAGIC) + _RVL_SIZE.size
        if len(data) < start:
            raise InputError(f"{where}: expected depth (RVL), found {len(data)} bytes")
        width, height = _RVL_SIZE.unpack_from(data, len(_RVL_MAGIC))
        return clean_depth(unpack_rvl(where, data[start:], width, height) * np.float32(FACTS.depth_unit_m))
    image = decode_image(where, data, cv2.IMREAD_UNCHANGED)
    if image.dtype == np.uint16 and image.ndim == 2:
        return clean_depth(image * np.float32(FACTS.depth_unit_m))
    if image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 4:  # floats, in the four bytes of a pixel
        return clean_depth(np.ascontiguousarray(image).view("<f4")[..., 0])
    raise InputError(f"{where}: expected one channel of 16 bits, found {image.dtype} {list(image.shape)}")
