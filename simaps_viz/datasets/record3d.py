"""Read Record3D recordings: a ``.r3d`` file, the same unpacked, or the "EXR + JPG sequence" export."""

import operator
import re
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import match_frames
from simaps_viz.datasets.calibration import OPENCV_FROM_OPENGL, Lens, from_quaternion, pinhole
from simaps_viz.datasets.file_frames import FileFrames, Stored, clean_depth, json_number, number_of, numbered
from simaps_viz.datasets.images import decode_color, read_color
from simaps_viz.datasets.manifest import is_finite_number, parse_json, read_json, shown
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, first_readable
from simaps_viz.errors import InputError, needs_extra, one_line
from simaps_viz.io import limits
from simaps_viz.io.arrays import ARCHIVE_FAULTS
from simaps_viz.io.limits import (
    MAX_IMAGE_BYTES,
    MAX_IMAGE_PIXELS,
    MAX_MEMBER_BYTES,
    check_file,
    check_picture,
)


def members(path: Path, what: str) -> list[str]:
    """Return the names of the files in an archive; raises InputError when it is none."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except ARCHIVE_FAULTS as error:
        raise InputError(f"{path}: expected {what}, found {one_line(error)}") from error


def member(path: Path, name: str) -> bytes:
    """Unpack one file; the archive is opened anew, as threads read at once.

    Raises:
        InputError: it is missing, damaged, or larger than anything a frame has.
    """
    try:
        with zipfile.ZipFile(path) as archive, archive.open(name) as file:
            data = file.read(MAX_MEMBER_BYTES + 1)
    except (*ARCHIVE_FAULTS, KeyError) as error:
        raise InputError(f"{path}: expected {name} in the archive, found {one_line(error)}") from error
    if len(data) > MAX_MEMBER_BYTES:
        raise InputError(f"{path}: {name}: expected at most {MAX_MEMBER_BYTES} bytes, found more")
    return data


_END, _RAW, _LZVN, _V1, _V2 = b"bvx$", b"bvx-", b"bvxn", b"bvx1", b"bvx2"
_V1_HEADER = 772
"""Bytes; it holds its tables of frequencies as they are."""


def lzfse_size(data: bytes) -> int:
    """Return the number of bytes that the blocks say they hold; raises ValueError for what is no LZFSE data."""
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


FACTS = FormatFacts(
    title="Record3D",
    recognised_by="`*.r3d`; or `metadata`, `rgbd/`; or `metadata.json`, `rgb/`, `depth/*.exr` (also in `EXR_RGBD/`)",
    depth="32-bit float, LZFSE or EXR",
    depth_unit_m=1.0,
    invalid="0, NaN",
    pose="camera to world: quaternion x y z w, position",
    camera_axes="OpenGL",
    up=(0.0, 1.0, 0.0),
)

WRITTEN_UNIT_M = 0.001
"""Unit of the 16-bit images that float depths are converted to."""
SENSORS = {256 * 192: (192, 256), 640 * 480: (480, 640)}
"""{pixels: (width, height)} of the upright LiDAR and face camera, where the metadata does not say."""


@dataclass(frozen=True, eq=False)
class _Parts:
    """One interface for the three ways of storing a recording."""

    metadata: Any
    metadata_path: str
    pictures: dict[int, Stored]
    """By number."""
    depths: dict[int, Stored]
    """float32 [H, W] or [H * W], metres."""
    names: dict[int, str]
    """Of the frames."""


def _recognise(path: Path) -> bool:
    if path.suffix == ".r3d":
        return path.is_file()
    return _is_unpacked(path) or _is_exr(_exr_folder(path))


def _open(path: Path) -> Recording:
    if path.suffix == ".r3d":
        parts = _zip_parts(path)
    else:
        parts = _folder_parts(path) if _is_unpacked(path) else _exr_parts(_exr_folder(path))
    where, metadata = parts.metadata_path, parts.metadata
    if not isinstance(metadata, dict) or not isinstance(metadata.get("poses"), list):
        raise InputError(f'{where}: expected an object with a list "poses", found {shown(metadata)}')
    # Pictures go by their number: the app leaves some out, but not their poses.
    images = {"picture": parts.pictures, "depth image": parts.depths}
    poses = {i: (f"{where}: poses[{i}]", row) for i, row in enumerate(metadata["poses"])}
    matched = match_frames(where, images, poses, lambda pose: _pose(*pose), place=lambda pose: pose[0])
    pictures, depths = matched.of_each(*images.values())
    first = first_readable(lambda i: pictures[i](), len(pictures))
    lenses = _lenses(where, metadata, matched.frames, (first.shape[1], first.shape[0]))
    width, height = _depth_size(metadata, first_readable(lambda i: depths[i](), len(depths)), depths[0], where)

    def depth(stored: Stored) -> NDArray:
        raw = stored()
        if raw.size != width * height:
            raise InputError(f"{stored}: expected {width}x{height} depths, found {raw.size}")
        return clean_depth(raw.reshape(height, width))

    files = FileFrames.of_one_view(pictures, depths, lenses, depth, read_color=operator.call)
    # Where poses start at none the world is the first camera's, and its y is not up.
    starts_at_none = np.allclose(_pose(*poses[0]), OPENCV_FROM_OPENGL, atol=1e-6) if 0 in matched.frames else False
    return files.recording(
        replace(FACTS, up=None) if starts_at_none else FACTS,
        path,
        name=path.resolve().parent.name if path.name == "EXR_RGBD" else path.resolve().stem,
        frame_names=tuple(parts.names[i] for i in matched.frames),
        depth_unit_m=WRITTEN_UNIT_M,
        **matched.members(),
    )


READER = Reader(FACTS, _recognise, _open)


def _is_unpacked(path: Path) -> bool:
    return (path / "metadata").is_file() and (path / "rgbd").is_dir()


def _exr_folder(path: Path) -> Path:
    return path / "EXR_RGBD" if (path / "EXR_RGBD").is_dir() else path


def _is_exr(folder: Path) -> bool:
    exr = next((folder / "depth").glob("*.exr"), None)
    return exr is not None and (folder / "metadata.json").is_file() and (folder / "rgb").is_dir()


def _pose(where: str, row: Any) -> NDArray:
    if not isinstance(row, list) or len(row) != 7 or not all(map(is_finite_number, row)):
        raise InputError(f"{where}: expected seven numbers, found {shown(row)}")
    return from_quaternion(where, row[4:], row[:4]) @ OPENCV_FROM_OPENGL


def _lenses(where: str, metadata: dict[str, Any], frames: list[int], size: tuple[int, int]) -> list[Lens]:
    """Read the camera of each of these frames, or the one for all (K, column by column); both for pictures of w x h."""
    told = {"w": size[0], "h": size[1]} | metadata
    width, height = (int(json_number(where, told, key)) for key in ("w", "h"))
    rows = metadata.get("perFrameIntrinsicCoeffs")
    if not isinstance(rows, list) or not rows:
        K = metadata.get("K")
        if not isinstance(K, list) or len(K) != 9:
            raise InputError(f"{where}: K: expected nine numbers, found {shown(K)}")
        rows = [[K[0], K[4], K[6], K[7]]] * (max(frames) + 1)
    lenses = []
    for i in frames:
        row = rows[i] if i < len(rows) else None
        if not isinstance(row, list) or len(row) < 4 or not all(map(is_finite_number, row)):
            raise InputError(f"{where}: perFrameIntrinsicCoeffs[{i}]: expected four numbers, found {shown(row)}")
        lenses.append(Lens(pinhole(where, width, height, row[0], row[1], row[2], row[3])).scaled(*size))
    return lenses


def _depth_size(metadata: dict[str, Any], first: NDArray, depth_where: object, where: str) -> tuple[int, int]:
    if first.ndim == 2:
        return first.shape[1], first.shape[0]
    if type(metadata.get("dw")) is int and type(metadata.get("dh")) is int:
        check_picture(where, metadata["dw"], metadata["dh"])
        return metadata["dw"], metadata["dh"]
    if first.size not in SENSORS:
        known = " or ".join(map(str, SENSORS))
        raise InputError(f"{depth_where}: expected {known} depths or dw and dh in the metadata, found {first.size}")
    return SENSORS[first.size]


def _zip_parts(path: Path) -> _Parts:
    names = members(path, "a Record3D archive")
    metadata = parse_json(f"{path}: metadata", member(path, "metadata"))
    return _lzfse_parts(path, metadata, f"{path}: metadata", names, lambda name: member(path, name))


def _folder_parts(path: Path) -> _Parts:
    names = [f"rgbd/{file.name}" for file in (path / "rgbd").iterdir()]
    metadata = path / "metadata"
    return _lzfse_parts(path, read_json(metadata), str(metadata), names,
                        lambda name: limits.read_bytes(path / name, MAX_MEMBER_BYTES, "a file a frame"))  # fmt: skip


def _lzfse_parts(path: Path, metadata: Any, where: str, files: list[str], read: Callable[[str], bytes]) -> _Parts:
    def stored(kind: str, decode: Callable[[str, bytes], NDArray]) -> dict[int, Stored]:
        found = (re.fullmatch(rf"rgbd/([0-9]{{1,9}})\.{kind}", name) for name in files)
        names = sorted((int(name[1]), name[0]) for name in found if name)
        return {
            n: Stored(f"{path}: {name}", partial(lambda k: decode(f"{path}: {k}", read(k)), name)) for n, name in names
        }

    def raw_depth(name: str, packed: bytes) -> NDArray:
        liblzfse = _library("liblzfse", path)
        try:
            if lzfse_size(packed) > 4 * MAX_IMAGE_PIXELS:
                raise ValueError("larger than a picture")
            return np.frombuffer(liblzfse.decompress(packed), dtype=np.float32)
        except (liblzfse.error, ValueError) as error:
            raise InputError(f"{name}: expected LZFSE floats, found a damaged or truncated file") from error

    pictures = stored("jpg", decode_color)
    if not pictures:
        raise InputError(f"{path}: expected pictures rgbd/0.jpg and so on, found none")
    return _Parts(metadata, where, pictures, stored("depth", raw_depth), {n: f"{n}" for n in pictures})


def _exr_parts(folder: Path) -> _Parts:
    depths = {int(number_of(file)): file for file in numbered(folder / "depth", "*.exr")}
    pictures = {int(number_of(f)): f for f in numbered(folder / "rgb", "*.*") if f.suffix in (".jpg", ".png")}
    metadata = folder / "metadata.json"
    return _Parts(
        metadata=read_json(metadata),
        metadata_path=str(metadata),
        pictures={number: Stored(str(file), partial(read_color, file)) for number, file in pictures.items()},
        depths={number: Stored(str(file), partial(read_exr, file)) for number, file in depths.items()},
        names={number: file.stem for number, file in pictures.items()},
    )


def read_exr(path: Path) -> NDArray:
    """Read the only channel of an EXR image, or the first of several equal ones, as float32 [H, W].

    Raises:
        InputError: It is damaged, or the package that reads it is not installed.
    """
    OpenEXR = _library("OpenEXR", path)
    check_file(path, MAX_IMAGE_BYTES, "an EXR image")
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            for name in ("dataWindow", "displayWindow"):  # before what they say is allocated
                (left, top), (right, bottom) = ((int(x) for x in corner) for corner in file.header()[name])
                check_picture(path, right - left + 1, bottom - top + 1)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            name = next((n for n in ("Z", "R", "Y", "V") if n in channels), next(iter(channels)))
            return np.array(channels[name].pixels, dtype=np.float32)
    except (RuntimeError, OSError, StopIteration, ValueError, KeyError) as error:
        raise InputError(f"{path}: expected an EXR image, found a damaged or truncated file") from error


def _library(name: str, path: Path) -> Any:
    """Import a package that only Record3D's files need; raises InputError naming the extra to install."""
    with needs_extra("record3d", f"{path}: Record3D's depth"):
        return import_module(name)
