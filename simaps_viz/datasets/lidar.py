"""Read laser scans with a camera beside them: clouds (PLY, PCD), poses, pictures, and where the camera sits.

The folder has a ``lidar.json`` (format ``posed-clouds/1``, docs/FORMATS.md). Clouds are rendered into depth images of
the camera, and from there on are frames like any other.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import read_intrinsics, read_poses, rigid
from simaps_viz.datasets.cloud_files import read_pcd, read_ply
from simaps_viz.datasets.clouds import CloudSettings, camera_points, depth_of_cloud, gravity_of_clouds
from simaps_viz.datasets.images import read_color
from simaps_viz.datasets.manifest import KeyTable, read_json, segmentation_files, shown
from simaps_viz.datasets.posed_frames import read_segments
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, Segments
from simaps_viz.datasets.segment_tables import few
from simaps_viz.errors import InputError
from simaps_viz.geometry import invert_pose
from simaps_viz.structures import Intrinsics

FACTS = FormatFacts(
    title="LiDAR and camera",
    recognised_by="`lidar.json` (posed-clouds/1, below)",
    depth="points of `.ply`, `.pcd`",
    depth_unit_m=1.0,
    invalid="NaN, infinity",
    pose="LiDAR or camera to world: 4x4",
    camera_axes="OpenCV",
    up=None,
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


class LidarReader(Reader):
    """The reader of LiDAR and camera recordings."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder or file is in this format, from names alone."""
        return _file(path).is_file()

    def open(self, path: Path) -> Recording:
        """Open a folder or its lidar.json.

        Raises:
            InputError: Anything is not as the format wants it; the message names the file, what was expected and found.
        """
        scan = _Scan.read(_file(path))
        facts, floor_height_m = replace(FACTS, up=scan.up), scan.floor_height_m
        if scan.up is None or floor_height_m is None:
            picked = {int(i) for i in np.linspace(0, len(scan.names) - 1, min(len(scan.names), _SAMPLED_FOR_GRAVITY))}
            clouds = [(scan.cloud(i), scan.T_world_camera[i]) for i in sorted(picked)]
            up, found_m = gravity_of_clouds(scan.file, clouds, scan.camera, scan.up)
            facts, floor_height_m = replace(FACTS, up=up), found_m if floor_height_m is None else floor_height_m
        return Recording(
            facts=facts,
            path=path,
            name=scan.name,
            frame_names=scan.names,
            poses=scan.T_world_camera,
            intrinsics=scan.camera,
            depth=lambda i: depth_of_cloud(scan.cloud(i), scan.camera, scan.settings),
            color=lambda i: read_color(scan.color_file(i)),
            color_file=scan.color_file,
            stored=lambda i: (scan.color_file(i), scan.cloud_file(i)),
            segments=scan.segments,
            depth_unit_m=0.001,
            floor_height_m=floor_height_m,
            simulated=scan.simulated,
        )


def _file(path: Path) -> Path:
    return path if path.name.startswith("lidar") and path.suffix == ".json" else path / "lidar.json"


@dataclass(frozen=True, eq=False)
class _Scan:
    """A checked manifest and the files that it names."""

    file: Path
    name: str
    names: tuple[str, ...]
    T_world_camera: NDArray
    """float64 [n, 4, 4]."""
    T_camera_points: Callable[[int], NDArray]
    """Takes a frame's points, as stored, to its camera."""
    camera: Intrinsics
    clouds: str
    color: str
    settings: CloudSettings
    up: tuple[float, float, float] | None
    floor_height_m: float | None
    segments: Segments | None
    simulated: bool

    @classmethod
    def read(cls, file: Path) -> "_Scan":
        keys = KeyTable(str(file), read_json(file), _REQUIRED + _OPTIONAL, first="format")
        if keys.text("format") != FORMAT:
            raise InputError(f'{file}: format: expected "{FORMAT}", found {shown(keys.values["format"])}')
        keys.check_known()
        pose, points = _choice(keys, "pose", _POSES), _choice(keys, "points", _FRAMES)
        names, poses = read_poses(file.parent / keys.file("poses"))
        T_lidar_camera = _mounting(file, keys, needed=pose == _POSES[0] or points == _FRAMES[0])
        T_world_camera = poses @ T_lidar_camera if pose == _POSES[0] else poses
        color = keys.pattern("color")
        _check_files(file, keys, names)
        height, width = read_color(file.parent / color.replace("{frame}", names[0])).shape[:2]
        T_camera_lidar = invert_pose(T_lidar_camera)
        camera = read_intrinsics(file.parent / keys.file("intrinsics"), width=width, height=height)
        files = segmentation_files(file, keys.values["segmentation"]) if "segmentation" in keys.values else None
        return cls(
            file=file,
            name=keys.text("name", file.resolve().parent.name),
            names=names,
            T_world_camera=T_world_camera,
            T_camera_points=(lambda i: T_camera_lidar)
            if points == _FRAMES[0]
            else (lambda i: invert_pose(T_world_camera[i])),
            camera=camera,
            clouds=keys.file("clouds"),
            color=color,
            settings=CloudSettings(_pixels(keys, "hidden_pixels"), _pixels(keys, "fill_pixels") or 0),
            up=keys.direction("up"),
            floor_height_m=keys.number("floor_height_m") if "floor_height_m" in keys.values else None,
            segments=read_segments(file.parent, files, names, camera) if files else None,
            simulated=keys.flag("simulated", False) or bool(files and files.source.lower().startswith("simulated")),
        )

    def cloud(self, index: int) -> NDArray:
        """Read a frame's points in camera axes; a cloud that all frames share is read once."""
        file = self.cloud_file(index)
        points = _kept(file) if "{frame}" not in self.clouds else _read_cloud(file)
        return camera_points(points, self.T_camera_points(index))

    def cloud_file(self, index: int) -> Path:
        return self.file.parent / self.clouds.replace("{frame}", self.names[index])

    def color_file(self, index: int) -> Path:
        return self.file.parent / self.color.replace("{frame}", self.names[index])


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


def _check_files(file: Path, keys: KeyTable, names: tuple[str, ...]) -> None:
    clouds = keys.file("clouds")
    if Path(clouds).suffix.lower() not in CLOUD_READERS:
        raise InputError(f"{file}: clouds: expected files ending in {', '.join(CLOUD_READERS)}, found {shown(clouds)}")
    if "{frame}" not in clouds and keys.values.get("points") != _FRAMES[1]:
        raise InputError(f'{file}: clouds: expected {{frame}} in it, or "points": "world", found {shown(clouds)}')
    for pattern in (keys.pattern("color"), clouds):
        files = [file.parent / pattern.replace("{frame}", name) for name in names]
        missing = [one for one in files if not os.path.isfile(one)]  # False also for names that are too long
        if missing:
            raise InputError(
                f"{missing[0]}: expected a file for each of {len(names)} frames, found none for {len(missing)}: "
                f"{few([one.name for one in missing])}"
            )
