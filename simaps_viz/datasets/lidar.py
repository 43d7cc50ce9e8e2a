"""Read laser scans with a camera beside them: clouds (PLY, PCD), poses, pictures, and where the camera sits.

The folder has a ``lidar.json`` (format ``posed-clouds/1``, docs/FORMATS.md). Clouds are rendered into depth images of
the camera, and from there on are frames like any other.
"""

import operator
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import match_posed_files
from simaps_viz.datasets.calibration import Lens, read_intrinsics, rigid
from simaps_viz.datasets.clouds import (
    CloudSettings,
    camera_points,
    depth_of_cloud,
    gravity_of_clouds,
    read_pcd,
    read_ply,
)
from simaps_viz.datasets.file_frames import FileFrames, Stored, first_size
from simaps_viz.datasets.manifest import KeyTable, read_json, segmentation_files, shown
from simaps_viz.datasets.posed_frames import read_segments
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording
from simaps_viz.errors import InputError
from simaps_viz.geometry import invert_pose, spread
from simaps_viz.structures import Intrinsics

FACTS = FormatFacts(
    title="LiDAR and camera",
    recognised_by="`lidar.json` (posed-clouds/1)",
    depth="points of `.ply`, `.pcd`",
    depth_unit_m=1.0,
    invalid="NaN, infinity",
    pose="LiDAR or camera to world: 4x4",
    segmentation="as in posed-frames/1",
)
FORMAT = "posed-clouds/1"
CLOUD_READERS: dict[str, Callable[[Path], NDArray]] = {".ply": read_ply, ".pcd": read_pcd}

_REQUIRED = ("format", "clouds", "color", "intrinsics", "poses")
_OPTIONAL = ("name", "description", "simulated", "pose", "points", "T_lidar_camera", "up", "floor_height_m",
             "hidden_pixels", "fill_pixels", "segmentation")  # fmt: skip
_POSES = ("T_world_lidar", "T_world_camera")
_FRAMES = ("lidar", "world")
_SAMPLED_FOR_GRAVITY = 40


def _recognise(path: Path) -> bool:
    return _file(path).is_file()


def _open(path: Path) -> Recording:
    """Open a folder or its lidar.json.

    Raises:
        InputError: Anything is not as the format wants it; the message names the file, what was expected and found.
    """
    file = _file(path)
    keys = KeyTable(str(file), read_json(file), _REQUIRED + _OPTIONAL, first="format")
    if keys.text("format") != FORMAT:
        raise InputError(f'{file}: format: expected "{FORMAT}", found {shown(keys.values["format"])}')
    keys.check_known()
    pose, points = _choice(keys, "pose", _POSES), _choice(keys, "points", _FRAMES)
    matched, (color_files, cloud_files) = match_posed_files(
        file.parent / keys.file("poses"),
        {"picture": _of_frame(file, keys.pattern("color")), "cloud": _clouds(file, keys)},
    )
    names, poses = tuple(matched.frames), matched.poses
    T_lidar_camera = _mounting(file, keys, needed=pose == _POSES[0] or points == _FRAMES[0])
    T_world_camera = poses @ T_lidar_camera if pose == _POSES[0] else poses
    T_camera_lidar = invert_pose(T_lidar_camera)
    width, height = first_size(color_files)
    camera = read_intrinsics(file.parent / keys.file("intrinsics"), width=width, height=height)
    files = segmentation_files(file, keys.values["segmentation"]) if "segmentation" in keys.values else None
    settings = CloudSettings(_pixels(keys, "hidden_pixels"), _pixels(keys, "fill_pixels") or 0)
    read_cloud = _kept if "{frame}" not in keys.file("clouds") else _read_cloud  # one that all frames share, once

    def cloud(index: int) -> NDArray:
        T_camera_points = T_camera_lidar if points == _FRAMES[0] else invert_pose(T_world_camera[index])
        return camera_points(read_cloud(cloud_files[index]), T_camera_points)

    facts, notes = replace(FACTS, up=keys.direction("up")), []
    floor_height_m = keys.number("floor_height_m") if "floor_height_m" in keys.values else None
    if facts.up is None or floor_height_m is None:
        clouds = [(cloud(i), T_world_camera[i]) for i in spread(len(names), _SAMPLED_FOR_GRAVITY)]
        found = gravity_of_clouds(clouds, camera, facts.up)
        x, y, z = map(float, found.up)
        facts, notes = replace(FACTS, up=(x, y, z)), [found.up_note]
        if floor_height_m is None:
            floor_height_m, notes = found.floor_height_m, [found.up_note, found.floor_note]
    return cloud_frames(color_files, cloud_files, camera, cloud, settings).recording(
        facts,
        path,
        name=keys.text("name", file.resolve().parent.name),
        frame_names=names,
        segments=read_segments(file.parent, files, names, camera) if files else None,
        depth_unit_m=0.001,
        **matched.members(*filter(None, notes)) | {"poses": T_world_camera},
        floor_height_m=floor_height_m,
        simulated=keys.flag("simulated", False) or bool(files and files.source.lower().startswith("simulated")),
    )


READER = Reader(FACTS, _recognise, _open)


def cloud_frames(
    color_files: list[Path], cloud_files: list[Path], camera: Intrinsics, cloud: Callable, settings: CloudSettings
) -> FileFrames:
    """Return frames whose depth is rendered from clouds: ``cloud(i)`` returns a frame's points [n, 3] in the camera."""

    def depth(i: int) -> NDArray:
        return depth_of_cloud(cloud(i), camera, settings)

    stored = [Stored(str(file), partial(depth, i), file) for i, file in enumerate(cloud_files)]
    return FileFrames(color_files, stored, [Lens(camera)], [Lens(camera)], operator.call)


def _file(path: Path) -> Path:
    return path if path.name.startswith("lidar") and path.suffix == ".json" else path / "lidar.json"


def _read_cloud(file: Path) -> NDArray:
    return CLOUD_READERS[file.suffix.lower()](file)


_kept = lru_cache(maxsize=1)(_read_cloud)


def _choice(keys: KeyTable, key: str, choices: tuple[str, ...]) -> str:
    value = keys.text(key, choices[0])
    if value not in choices:
        raise InputError(f"{keys.where}: {key}: expected one of {', '.join(choices)}, found {shown(value)}")
    return value


def _pixels(keys: KeyTable, key: str) -> int | None:
    if key not in keys.values:
        return None
    value = keys.values[key]
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= 64:
        raise InputError(f"{keys.where}: {key}: expected a whole number from 0 to 64, found {shown(value)}")
    return value


def _mounting(file: Path, keys: KeyTable, *, needed: bool) -> NDArray:
    """Read where the camera sits: T_lidar_camera, camera points (OpenCV axes) to the LiDAR's frame."""
    value: Any = keys.values.get("T_lidar_camera")
    if value is None and not needed:
        return np.eye(4)
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4):
        raise InputError(f"{file}: T_lidar_camera: expected 4x4 numbers, found {shown(value)}")
    return rigid(f"{file}: T_lidar_camera", matrix)


def _of_frame(file: Path, pattern: str) -> Callable[[str], Path]:
    return lambda name: file.parent / pattern.replace("{frame}", name)


def _clouds(file: Path, keys: KeyTable) -> Callable[[str], Path]:
    """Return where the cloud of a frame is."""
    clouds = keys.file("clouds")
    if Path(clouds).suffix.lower() not in CLOUD_READERS:
        raise InputError(f"{file}: clouds: expected files ending in {', '.join(CLOUD_READERS)}, found {shown(clouds)}")
    if "{frame}" not in clouds and keys.values.get("points") != _FRAMES[1]:
        raise InputError(f'{file}: clouds: expected {{frame}} in it, or "points": "world", found {shown(clouds)}')
    return _of_frame(file, clouds)
