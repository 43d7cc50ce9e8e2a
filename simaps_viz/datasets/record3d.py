"""Read Record3D recordings: a ``.r3d`` file, the same unpacked, or the "EXR + JPG sequence" export."""

import re
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import match_frames
from simaps_viz.datasets.calibration import OPENCV_FROM_OPENGL, Lens, from_quaternion, pinhole, see_through
from simaps_viz.datasets.file_frames import (
    check_size,
    clean_depth,
    json_number,
    number_of,
    numbered,
)
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


_MAGIC = b"\x76\x2f\x31\x01"
_MAX_HEADER_BYTES = 1 << 16
_MAX_WORD_BYTES = 256
_WINDOWS = ("dataWindow", "displayWindow")


def check_exr(path: Path) -> None:
    """Raise InputError unless a file starts as an EXR picture of a size that a camera's picture may have."""
    try:
        with path.open("rb") as file:
            data = file.read(_MAX_HEADER_BYTES)
    except OSError as error:
        raise InputError(f"{path}: expected an EXR image, found {error.strerror or error}") from error
    try:
        found = dict(_attributes(data))
    except (ValueError, struct.error) as error:
        raise InputError(f"{path}: expected an EXR image, found a damaged or truncated file") from error
    for name in _WINDOWS:
        if len(found.get(name, b"")) != 16:
            raise InputError(f"{path}: expected an EXR image, found one without {name}")
        left, top, right, bottom = struct.unpack("<iiii", found[name])
        check_picture(path, right - left + 1, bottom - top + 1)


def _attributes(data: bytes) -> list[tuple[str, bytes]]:
    """Return the names and values of the header: each is name, type, size, value; an empty name ends it."""
    if data[:4] != _MAGIC:
        raise ValueError("no EXR file")
    at, found = 8, []
    while data[at : at + 1] != b"\0":
        if at >= len(data):
            raise ValueError("a header that does not end")
        end = data.index(b"\0", at, at + _MAX_WORD_BYTES)
        end_of_type = data.index(b"\0", end + 1, end + 1 + _MAX_WORD_BYTES)
        (size,) = struct.unpack_from("<i", data, end_of_type + 1)
        start = end_of_type + 5
        if size < 0 or start + size > len(data):
            raise ValueError("an attribute that is cut short")
        found.append((data[at:end].decode("latin-1"), data[start : start + size]))
        at = start + size
    return found


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
    pictures: dict[int, str]
    """Names by number."""
    depths: dict[int, str]
    color: Callable[[str], NDArray]
    raw_depth: Callable[[str], NDArray]
    """float32 [H, W] or [H * W], metres."""
    depth_where: Callable[[str], str]


class Record3DReader(Reader):
    """The reader of Record3D recordings."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder or file is in this format, from names alone."""
        if path.suffix == ".r3d":
            return path.is_file()
        return _is_unpacked(path) or _is_exr(_exr_folder(path))

    def open(self, path: Path) -> Recording:
        """Open a recording; raises InputError for anything that is not as the format wants it."""
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
        names, depths = ([part[i] for i in matched.frames] for part in images.values())
        first = first_readable(lambda i: parts.color(names[i]), len(names))
        lenses = _lenses(where, metadata, matched.frames, (first.shape[1], first.shape[0]))
        raw = first_readable(lambda i: parts.raw_depth(depths[i]), len(depths))
        width, height = _depth_size(metadata, raw, parts.depth_where(depths[0]), where)
        depth_lenses = [lens.scaled(width, height) for lens in lenses]
        target = depth_lenses[0].intrinsics

        def depth(index: int) -> NDArray:
            raw = parts.raw_depth(depths[index])
            if raw.size != width * height:
                raise InputError(
                    f"{parts.depth_where(depths[index])}: expected {width}x{height} depths, found {raw.size}"
                )
            return see_through(clean_depth(raw.reshape(height, width)), depth_lenses[index], target, exact=True)

        def color(index: int) -> NDArray:
            rgb = parts.color(names[index])
            check_size(f"{path}: picture {names[index]}", rgb, lenses[index].intrinsics)
            return see_through(rgb, lenses[index], target, exact=False)

        return Recording(
            facts=FACTS,
            path=path,
            name=path.resolve().parent.name if path.name == "EXR_RGBD" else path.resolve().stem,
            frame_names=tuple(Path(name).stem for name in names),
            poses=matched.poses,
            intrinsics=target,
            depth=depth,
            color=color,
            depth_unit_m=WRITTEN_UNIT_M,
            notes=matched.notes,
            faults=matched.faults,
        )


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


def _depth_size(metadata: dict[str, Any], first: NDArray, depth_where: str, where: str) -> tuple[int, int]:
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
    pictures, depths = (
        {int(found[1]): found[1] for name in files if (found := re.fullmatch(rf"rgbd/([0-9]{{1,9}})\.{kind}", name))}
        for kind in ("jpg", "depth")
    )
    if not pictures:
        raise InputError(f"{path}: expected pictures rgbd/0.jpg and so on, found none")

    def color(stem: str) -> NDArray:
        name = f"rgbd/{stem}.jpg"
        return decode_color(f"{path}: {name}", read(name))

    def raw_depth(stem: str) -> NDArray:
        liblzfse = _library("liblzfse", path)
        name = f"rgbd/{stem}.depth"
        packed = read(name)
        try:
            if lzfse_size(packed) > 4 * MAX_IMAGE_PIXELS:
                raise ValueError("larger than a picture")
            return np.frombuffer(liblzfse.decompress(packed), dtype=np.float32)
        except (liblzfse.error, ValueError) as error:
            raise InputError(f"{path}: {name}: expected LZFSE floats, found a damaged or truncated file") from error

    in_order = dict(sorted(pictures.items()))
    return _Parts(metadata, where, in_order, depths, color, raw_depth, lambda stem: f"{path}: rgbd/{stem}.depth")


def _exr_parts(folder: Path) -> _Parts:
    depth_files = {int(number_of(file)): file for file in numbered(folder / "depth", "*.exr")}
    color_files = {int(number_of(f)): f for f in numbered(folder / "rgb", "*.*") if f.suffix in (".jpg", ".png")}
    metadata = folder / "metadata.json"
    return _Parts(
        metadata=read_json(metadata),
        metadata_path=str(metadata),
        pictures={number: file.name for number, file in color_files.items()},
        depths={number: file.name for number, file in depth_files.items()},
        color=lambda name: read_color(folder / "rgb" / name),
        raw_depth=lambda name: read_exr(folder / "depth" / name),
        depth_where=lambda name: str(folder / "depth" / name),
    )


def read_exr(path: Path) -> NDArray:
    """Read the only channel of an EXR image, or the first of several equal ones, as float32 [H, W].

    Raises:
        InputError: It is damaged, or the package that reads it is not installed.
    """
    OpenEXR = _library("OpenEXR", path)
    check_file(path, MAX_IMAGE_BYTES, "an EXR image")
    check_exr(path)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            name = next((n for n in ("Z", "R", "Y", "V") if n in channels), next(iter(channels)))
            return np.array(channels[name].pixels, dtype=np.float32)
    except (RuntimeError, OSError, StopIteration, ValueError) as error:
        raise InputError(f"{path}: expected an EXR image, found a damaged or truncated file") from error


def _library(name: str, path: Path) -> Any:
    """Import a package that only Record3D's files need; raises InputError naming the extra to install."""
    with needs_extra("record3d", f"{path}: Record3D's depth"):
        return import_module(name)
