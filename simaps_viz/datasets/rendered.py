"""Read rooms that were rendered: Replica as NICE-SLAM has it, and Matterport3D as VLMaps rendered it with Habitat-Sim.

Replica's have clean depth, a smooth camera path and no labels. In VLMaps' folders ``poses.txt`` says where the robot's
base stood; the camera looks level from 1.5 m above it, with a field of view of 90 degrees. Semantic arrays hold class
numbers, so an object is a connected patch of a class in a picture; with an ``obj2cls_dict.txt`` beside them they hold
object numbers, which are the truth.
"""

from importlib.resources import files as package_files
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import is_thing
from simaps_viz.datasets.association import match_frames
from simaps_viz.datasets.calibration import (
    OPENCV_FROM_OPENGL,
    Lens,
    from_quaternion,
    matrix16,
    number_rows,
    numbers,
    pinhole,
)
from simaps_viz.datasets.file_frames import (
    FileFrames,
    by_line,
    check_size,
    depth_npy,
    depth_png,
    first_size,
    json_number,
    numbered,
    read_array,
)
from simaps_viz.datasets.manifest import read_json
from simaps_viz.datasets.posed_frames import WorldSegments
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, Segments
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_TEXT_BYTES, read_bytes
from simaps_viz.structures import Intrinsics, Segment, Segmentation

REPLICA = FormatFacts(
    title="Replica (NICE-SLAM)",
    recognised_by="`results/depth*.png`, `results/frame*.jpg`, `traj.txt`",
    depth_unit_m=1 / 6553.5,
    pose="camera to world: 16 numbers a line",
    up=(0.0, 0.0, 1.0),
)

REPLICA_CAMERA = (1200, 680, 600.0, 600.0, 599.5, 339.5)
"""Width, height, fx, fy, cx, cy where ``cam_params.json`` is not there."""


def _is_replica(path: Path) -> bool:
    return (path / "traj.txt").is_file() and (path / "results").is_dir()


def _open_replica(path: Path) -> Recording:
    depth_files = numbered(path / "results", "depth*.png")
    color_files = numbered(path / "results", "frame*.jpg") or numbered(path / "results", "frame*.png")
    if not depth_files:
        raise InputError(f"{path / 'results'}: expected depth*.png, found none")
    rows = dict(enumerate(number_rows(path / "traj.txt", 16)))
    depth, color = by_line(depth_files, len(rows)), by_line(color_files, len(rows))
    matched = match_frames(
        path,
        {"depth image": depth, "colour image": color},
        rows,
        lambda row: matrix16(*row),
        place=lambda row: row[0],
    )
    depth_files, color_files = matched.of_each(depth, color)
    lens, unit_m = _replica_camera(path)
    files = FileFrames(color_files, depth_files, [lens], [lens], depth_png(unit_m))
    return files.recording(
        REPLICA,
        path,
        frame_names=tuple(file.stem.removeprefix("depth") for file in depth_files),
        **matched.members(),
        depth_unit_m=unit_m,
        simulated=True,
    )


REPLICA_READER = Reader(REPLICA, _is_replica, _open_replica)


def _replica_camera(path: Path) -> tuple[Lens, float]:
    """Read ``cam_params.json``, which lies beside the rooms, or take the one that all of them have."""
    file = next((f for f in (path / "cam_params.json", path.parent / "cam_params.json") if f.is_file()), None)
    if file is None:
        return Lens(pinhole(str(path), *REPLICA_CAMERA)), REPLICA.depth_unit_m
    content = read_json(file)
    values = content.get("camera") if isinstance(content, dict) else None
    where = f"{file}: camera"
    stated = {key: json_number(where, values, key) for key in ("w", "h", "fx", "fy", "cx", "cy", "scale")}
    scale = stated.pop("scale")
    if scale <= 0:
        raise InputError(f"{where}: scale: expected steps a metre, more than 0, found {scale:g}")
    width, height = int(stated.pop("w")), int(stated.pop("h"))
    return Lens(pinhole(where, width, height, **stated)), 1 / scale


HABITAT = FormatFacts(
    title="VLMaps / Habitat-Matterport",
    recognised_by="`rgb/*.png` (or `.jpg`), `depth/*.npy`, `poses.txt`",
    depth="`.npy`, 32-bit float",
    depth_unit_m=1.0,
    invalid="0, NaN, infinity",
    pose="robot base to world: position, quaternion x y z w; the camera stands 1.5 m above",
    camera_axes="OpenGL",
    up=(0.0, 1.0, 0.0),
    segmentation="`semantic/*.npy`: class numbers, or with `obj2cls_dict.txt` object numbers: the truth",
)

CAMERA_HEIGHT_M = 1.5
WRITTEN_UNIT_M = 0.001
"""Unit of the 16-bit images that float depths are converted to."""
MP3D_CLASSES = tuple(package_files("simaps_viz.datasets").joinpath("mp3d_classes.txt").read_text("utf-8").splitlines())
"""Matterport3D's 40 classes by number."""
MIN_PATCH_PIXELS = 4
"""A smaller patch of a thing class is a seam of the rendering."""


def _is_habitat(path: Path) -> bool:
    depth = path / "depth"
    return (path / "poses.txt").is_file() and (path / "rgb").is_dir() and next(depth.glob("*.npy"), None) is not None


def _open_habitat(path: Path) -> Recording:
    depth_files, color_files = numbered(path / "depth", "*.npy"), numbered(path / "rgb", "*.png")
    color_files = color_files or numbered(path / "rgb", "*.jpg")
    rows = dict(enumerate(number_rows(path / "poses.txt", 7)))
    images = {"depth array": by_line(depth_files, len(rows)), "colour image": by_line(color_files, len(rows))}
    if (path / "semantic").is_dir():
        images["semantic array"] = by_line(numbered(path / "semantic", "*.npy"), len(rows))
    matched = match_frames(path, images, rows, lambda row: _camera_pose(*row), place=lambda row: row[0])
    depth_files, color_files, *semantic = matched.of_each(*images.values())
    width, height = first_size(color_files)
    lens = Lens(pinhole(str(path), width, height, width / 2, width / 2, (width - 1) / 2, (height - 1) / 2))
    files = FileFrames(color_files, depth_files, [lens], [lens], depth_npy(HABITAT.depth_unit_m))
    return files.recording(
        HABITAT,
        path,
        segments=_segments(path, semantic[0], lens.intrinsics) if semantic else None,
        **matched.members(),
        depth_unit_m=WRITTEN_UNIT_M,
        simulated=True,
    )


HABITAT_READER = Reader(HABITAT, _is_habitat, _open_habitat)


def _camera_pose(where: str, found: list[str]) -> NDArray:
    row = numbers(where, found, count=7)
    if not np.isfinite(row).all():
        return np.full((4, 4), row.sum())  # infinite or NaN, as the row is
    T_world_base = from_quaternion(where, row[:3], row[3:])
    T_base_camera = OPENCV_FROM_OPENGL.copy()
    T_base_camera[1, 3] = CAMERA_HEIGHT_M
    return T_world_base @ T_base_camera


def _segments(path: Path, files: list[Path], camera: Intrinsics) -> Segments:
    table = path / "obj2cls_dict.txt"
    if table.is_file():
        world = WorldSegments(table, _objects(table))
        return Segments(
            world.classes(),
            lambda i: world.segmentation(files[i].stem, files[i], _numbers(files[i], camera).astype(np.uint16)),
            "Habitat object numbers",
            world.by_id,
            ground_truth=True,
        )
    classes = {name: is_thing(name) for name in MP3D_CLASSES[1:]}
    return Segments(classes, lambda i: patches(files[i], _numbers(files[i], camera)), "Habitat class numbers")


def _numbers(path: Path, camera: Intrinsics) -> NDArray:
    """Read numbers from 0 to 65535, int32 [H, W]."""
    values = read_array(path)
    if values.ndim != 2 or values.dtype.kind not in "iu" or not 0 <= values.min() <= values.max() <= 65535:
        found = f"{values.dtype.name} {list(values.shape)}"
        raise InputError(f"{path}: expected [H, W] whole numbers from 0 to 65535, found {found}")
    check_size(path, values, camera)
    return values.astype(np.int32)


def patches(path: Path, classes: NDArray) -> Segmentation:
    """Turn class numbers int32 [H, W] into segments: one for each connected patch (8-neighbours) of a thing class.

    Raises:
        InputError: There is a number that is no class.
    """
    ids, segments = np.zeros(classes.shape, np.int32), []
    for number in np.unique(classes):
        if number >= len(MP3D_CLASSES):
            raise InputError(f"{path}: expected class numbers under {len(MP3D_CLASSES)}, found {number}")
        if number == 0:
            continue
        label, mask = MP3D_CLASSES[number], classes == number
        count, patch = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
        if not is_thing(label):
            count, patch = 2, mask.astype(np.int32)
        for part in range(1, count):
            here = patch == part
            if is_thing(label) and here.sum() < MIN_PATCH_PIXELS:
                continue
            segments.append(Segment(len(segments) + 1, label, 1.0, is_thing(label)))
            ids[here] = len(segments)
    return Segmentation(ids, tuple(segments))


def _objects(path: Path) -> dict[int, Segment]:
    """Read lines of ``object:class,name``; object 0 is kept out, as 0 means nothing."""
    objects = {}
    content = read_bytes(path, MAX_TEXT_BYTES, "a text file").decode("utf-8-sig", errors="replace")
    for line, text in enumerate(content.splitlines(), start=1):
        number, _, rest = text.partition(":")
        name = rest.partition(",")[2].strip()
        if not text.strip():
            continue
        if not number.strip().isdecimal() or len(number) > 9 or not name or name == "none" or not name.isprintable():
            raise InputError(f"{path}, line {line}: expected object:class,name, found {text[:40]!r}")
        if int(number) > 0:
            objects[int(number)] = Segment(int(number), name, 1.0, is_thing(name))
    return objects
