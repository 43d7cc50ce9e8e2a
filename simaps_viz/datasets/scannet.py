"""Read ScanNet scans, extracted (colour, depth, poses, and instances where they are there) or as a ``.sens`` file.

A ``.sens`` file of version 4 has all frames of a scan. Layout, little-endian: a header (version, sensor name, four 4x4
matrices, compressions, sizes, steps a metre, number of frames), then for each frame its 4x4 pose, two times, two
lengths and the compressed colour and depth.
"""

import operator
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import is_thing
from simaps_viz.datasets.association import match_frames
from simaps_viz.datasets.calibration import Lens, matrix4, matrix_lens, see_through
from simaps_viz.datasets.file_frames import FileFrames, Stored, by_stem, check_size, depth_png, first_size, numbered
from simaps_viz.datasets.images import decode_color, read_ids
from simaps_viz.datasets.manifest import read_json, shown
from simaps_viz.datasets.posed_frames import WorldSegments
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, Segments, first_readable
from simaps_viz.errors import InputError
from simaps_viz.io.limits import LFS_POINTER, MAX_FRAMES, MAX_MEMBER_BYTES, is_lfs_pointer
from simaps_viz.structures import Intrinsics, Segment

EXTRACTED = FormatFacts(
    title="ScanNet (extracted)",
    recognised_by="`color/*.jpg`, `depth/*.png`, `pose/*.txt`, `intrinsic/intrinsic_depth.txt` (also in `frames/`) "
    "or `intrinsics_depth.txt`",
    pose="camera to world: 4x4; -inf where tracking was lost, left out",
    up=(0.0, 0.0, 1.0),
    segmentation="`instance-filt/*.png` or `instance/*.png` (objectId + 1) named by `*.aggregation.json`: the truth",
)


RECORDED, OFF_MIDDLE = (1296, 968), 0.05
"""Size of ScanNet's colour as recorded, and how far a principal point may be off the middle, as a share."""


def _is_extracted(path: Path) -> bool:
    return _camera_file(_frames_folder(path), "depth").is_file()


def _open_extracted(path: Path) -> Recording:
    folder = _frames_folder(path)
    depth_files = numbered(folder / "depth", "*.png")
    if not depth_files:
        raise InputError(f"{folder / 'depth'}: expected *.png, found none")
    depth, pose_files = by_stem(depth_files), by_stem(numbered(folder / "pose", "*.txt"))
    color = by_stem(numbered(folder / "color", "*.jpg")) | by_stem(numbered(folder / "color", "*.png"))
    matched = match_frames(folder, {"depth image": depth, "colour image": color}, pose_files, matrix4)
    names, (depth_files, color_files) = tuple(matched.frames), matched.of_each(depth, color)
    read = depth_png(EXTRACTED.depth_unit_m)
    height, width = first_readable(lambda i: read(depth_files[i]), len(names)).shape
    depth_lens = _lens(_camera_file(folder, "depth"), width, height)
    color_lens, note = _color_lens(_camera_file(folder, "color"), *first_size(color_files))
    files = FileFrames(color_files, depth_files, [color_lens], [depth_lens], read)
    return files.recording(
        EXTRACTED,
        path,
        frame_names=names,
        segments=_segments(path, folder, names, color_lens, depth_lens.intrinsics),
        **matched.members(first=note),
    )


SCANNET_READER = Reader(EXTRACTED, _is_extracted, _open_extracted)


def _frames_folder(path: Path) -> Path:
    return path / "frames" if (path / "frames" / "intrinsic").is_dir() else path


def _camera_file(folder: Path, which: str) -> Path:
    """Name a camera's file; the smaller copy of the dataset (scannet_frames_25k) has no folder for it."""
    alone = folder / f"intrinsics_{which}.txt"
    return alone if alone.is_file() else folder / "intrinsic" / f"intrinsic_{which}.txt"


def _lens(path: Path, width: int, height: int) -> Lens:
    return matrix_lens(str(path), width, height, matrix4(path))


def _color_lens(path: Path, width: int, height: int) -> tuple[Lens, tuple[str, ...]]:
    """Return the colour camera, and a note where it is scaled: ScanNet's own exporter may shrink the pictures alone."""
    matrix = matrix4(path)
    middles = 2.0 * matrix[0, 2], 2.0 * matrix[1, 2]
    recorded = all(abs(m / size - 1.0) < OFF_MIDDLE for m, size in zip(middles, RECORDED, strict=True))
    if not recorded or abs(middles[0] / width - 1.0) < 2.0 * OFF_MIDDLE:
        return matrix_lens(str(path), width, height, matrix), ()
    sizes = f"pictures of {width}x{height} pixels, {path.name} is of {RECORDED[0]}x{RECORDED[1]}"
    return matrix_lens(str(path), *RECORDED, matrix).scaled(width, height), (f"{sizes}: scaled",)


def _segments(
    path: Path, folder: Path, names: tuple[str, ...], color_lens: Lens, target: Intrinsics
) -> Segments | None:
    """Read which objects there are; instance images have the size of the colour images, or of the depth images."""
    places = [base / name for base in (path, folder) for name in ("instance-filt", "instance")]
    images = next((place for place in places if place.is_dir()), None)
    tables = [f for f in sorted(path.glob("*.aggregation.json")) if not f.name.endswith("_vh_clean.aggregation.json")]
    if images is None or not tables:
        return None
    table = WorldSegments(tables[0], _objects(tables[0]))

    def read(index: int) -> Any:
        file = images / f"{names[index]}.png"
        ids = read_ids(file)
        if ids.shape != (target.height, target.width):
            check_size(file, ids, color_lens.intrinsics)
            ids = see_through(ids, color_lens, target, exact=True)
        return table.segmentation(names[index], file, ids)

    return Segments(table.classes(), read, f"ScanNet annotation ({images.name})", table.by_id, ground_truth=True)


def _objects(path: Path) -> dict[int, Segment]:
    """Read ``segGroups``: what each object id is called; images hold the id plus one."""
    content = read_json(path)
    groups = content.get("segGroups") if isinstance(content, dict) else None
    if not isinstance(groups, list) or not groups:
        raise InputError(f'{path}: expected an object with a list "segGroups", found {shown(content)}')
    objects: dict[int, Segment] = {}
    for group in groups:
        number, label = (group.get("objectId"), group.get("label")) if isinstance(group, dict) else (None, None)
        if not isinstance(number, int) or number < 0 or not isinstance(label, str) or not label.strip():
            raise InputError(f"{path}: segGroups: expected objectId and label, found {shown(group)}")
        objects[number + 1] = Segment(number + 1, label.strip(), 1.0, is_thing(label.strip()))
    return objects


SENS = replace(
    EXTRACTED,
    title="ScanNet (.sens)",
    recognised_by="`*.sens`, or a folder with one",
    depth="16 bit, zlib or raw",
    segmentation="none",
)

VERSION = 4
COLOR_CODED = (1, 2)
"""PNG, JPEG."""
DEPTH_RAW, DEPTH_ZLIB = 0, 1


@dataclass(frozen=True, eq=False)
class _Header:
    color: Lens
    depth: Lens
    color_compression: int
    depth_compression: int
    depth_unit_m: float
    frames: int


@dataclass(frozen=True, eq=False)
class _Entry:
    """Position of a frame in the file."""

    T_world_camera: NDArray
    color_at: int
    color_bytes: int
    depth_at: int
    depth_bytes: int


def _is_sens(path: Path) -> bool:
    return _sens_file(path).suffix == ".sens" and _sens_file(path).is_file()


def _open_sens(path: Path) -> Recording:
    """Open a file: its header and where each frame lies are read, its pictures when they are wanted.

    Raises:
        InputError: It is no .sens file of version 4, is cut short, or has a compression that only ScanNet's own
            program reads.
    """
    path = _sens_file(path)
    if is_lfs_pointer(path):
        raise InputError(f"{path}: expected a .sens file, found {LFS_POINTER}")
    try:
        with path.open("rb") as file:
            header = _read_header(path, file)
            entries = [_read_entry(path, file, i, header.frames) for i in range(header.frames)]
    except OSError as error:
        raise InputError(f"{path}: expected a .sens file, found {error.strerror or error}") from error
    if not entries:
        raise InputError(f"{path}: expected frames, found none")
    matched = match_frames(
        path, {}, dict(enumerate(entries)), lambda entry: entry.T_world_camera, place=lambda _: str(path)
    )

    def depth(where: str, entry: _Entry) -> NDArray:
        raw = _depth_steps(where, _read_at(path, entry.depth_at, entry.depth_bytes), header)
        return np.multiply(raw, np.float32(header.depth_unit_m), dtype=np.float32)

    def color(where: str, entry: _Entry) -> NDArray:
        data, k = _read_at(path, entry.color_at, entry.color_bytes), header.color.intrinsics
        coded = header.color_compression in COLOR_CODED
        rgb = decode_color(where, data) if coded else np.frombuffer(data, np.uint8)
        if rgb.size != k.width * k.height * 3:
            raise InputError(f"{where}: expected {k.width}x{k.height} pixels, found {rgb.size // 3} pixels in all")
        return rgb.reshape(k.height, k.width, 3)

    def stored(what: str, decode: Callable[[str, _Entry], NDArray]) -> list[Stored]:
        wheres = {i: f"{path}: frame {i}{what}" for i in matched.frames}
        return [Stored(where, partial(decode, where, entries[i])) for i, where in wheres.items()]

    files = FileFrames(
        stored(": colour", color), stored("", depth), [header.color], [header.depth], operator.call, operator.call
    )
    anywhere = np.allclose(entries[0].T_world_camera, np.eye(4), atol=1e-4)  # BundleFusion's; ScanNet's are levelled
    return files.recording(
        replace(SENS, up=None) if anywhere else SENS,
        path,
        name=path.stem,
        frame_names=tuple(str(i) for i in matched.frames),
        depth_unit_m=header.depth_unit_m,
        **matched.members(),
    )


SENS_READER = Reader(SENS, _is_sens, _open_sens)


def _sens_file(path: Path) -> Path:
    inside = list(path.glob("*.sens")) if path.is_dir() else []
    return inside[0] if len(inside) == 1 else path


def _read_header(path: Path, file: BinaryIO) -> _Header:
    (version,) = _unpack(path, file, "<I")
    if version != VERSION:
        raise InputError(f"{path}: expected a .sens file of version {VERSION}, found version {version}")
    (length,) = _unpack(path, file, "<Q")
    if length > 4096:
        raise InputError(f"{path}: expected a sensor's name, found one of {length} bytes")
    _unpack(path, file, f"<{length}s")
    K_color, _, K_depth, _ = (_matrix(path, file) for _ in range(4))  # between them: extrinsics, which are identities
    color_compression, depth_compression = _unpack(path, file, "<ii")
    color_width, color_height, depth_width, depth_height = _unpack(path, file, "<IIII")
    (steps_a_metre,) = _unpack(path, file, "<f")
    (frames,) = _unpack(path, file, "<Q")
    if frames > MAX_FRAMES:
        raise InputError(f"{path}: expected at most {MAX_FRAMES} frames, found {frames}")
    if color_compression not in (0, *COLOR_CODED) or depth_compression not in (DEPTH_RAW, DEPTH_ZLIB):
        raise InputError(
            f"{path}: expected colour as raw, PNG or JPEG (0-2) and depth as raw or zlib (0, 1), found "
            f"{color_compression} and {depth_compression}"
        )
    if not steps_a_metre > 0:
        raise InputError(f"{path}: expected depth steps a metre over 0, found {steps_a_metre:g}")
    return _Header(
        color=matrix_lens(f"{path}: colour camera", color_width, color_height, K_color),
        depth=matrix_lens(f"{path}: depth camera", depth_width, depth_height, K_depth),
        color_compression=color_compression,
        depth_compression=depth_compression,
        depth_unit_m=1.0 / steps_a_metre,
        frames=frames,
    )


def _read_entry(path: Path, file: BinaryIO, index: int, frames: int) -> _Entry:
    try:
        T = _matrix(path, file)
        _, _, color_bytes, depth_bytes = _unpack(path, file, "<QQQQ")
        start = file.tell()
        end = start + color_bytes + depth_bytes
        if end > file.seek(0, 2) or max(color_bytes, depth_bytes) > MAX_MEMBER_BYTES:
            raise InputError("")
        file.seek(end)
    except InputError as error:
        raise InputError(f"{path}: expected {frames} frames, found a file cut short in frame {index}") from error
    return _Entry(T, start, color_bytes, start + color_bytes, depth_bytes)


def _depth_steps(where: str, data: bytes, header: _Header) -> NDArray:
    k = header.depth.intrinsics
    if header.depth_compression == DEPTH_ZLIB:
        try:
            machine = zlib.decompressobj()
            data = machine.decompress(data, 2 * k.width * k.height + 1)
            if not machine.eof:
                raise zlib.error("cut short, or larger than a picture")
        except zlib.error as error:
            raise InputError(f"{where}: expected zlib-compressed depth, found damaged data") from error
    if len(data) != 2 * k.width * k.height:
        raise InputError(f"{where}: expected {k.width}x{k.height} depths of 16 bits, found {len(data)} bytes")
    return np.frombuffer(data, "<u2").reshape(k.height, k.width)


def _matrix(path: Path, file: BinaryIO) -> NDArray:
    return np.array(_unpack(path, file, "<16f"), dtype=np.float64).reshape(4, 4)


def _unpack(path: Path, file: BinaryIO, layout: str) -> tuple:
    size = struct.calcsize(layout)
    data = file.read(size)
    if len(data) != size:
        raise InputError(f"{path}: expected a whole .sens file, found one that ends after {file.tell()} bytes")
    return struct.unpack(layout, data)


def _read_at(path: Path, start: int, size: int) -> bytes:
    try:
        with path.open("rb") as file:  # opened anew: threads read at once
            file.seek(start)
            return file.read(size)
    except OSError as error:
        raise InputError(f"{path}: expected a .sens file, found {error.strerror or error}") from error
