"""Read KITTI-360 drives: the rectified left camera, and laser scans rendered into it, as there are no depth images."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import match_frames
from simaps_viz.datasets.calibration import number_rows, numbers, pinhole, rigid, words
from simaps_viz.datasets.clouds import CloudSettings, camera_points, finite_points, gravity_of_clouds
from simaps_viz.datasets.file_frames import check_size, numbered
from simaps_viz.datasets.images import read_ids
from simaps_viz.datasets.lidar import cloud_frames
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, Segments
from simaps_viz.errors import InputError
from simaps_viz.geometry import invert_pose, spread
from simaps_viz.io.limits import MAX_CLOUD_BYTES, read_bytes
from simaps_viz.structures import Intrinsics, Segment, Segmentation

FACTS = FormatFacts(
    title="KITTI-360",
    recognised_by="`calibration/perspective.txt`, `data_2d_raw/`, `data_3d_raw/`, `data_poses/`",
    depth="points of `velodyne_points/data/*.bin`",
    depth_unit_m=1.0,
    invalid="NaN, infinity",
    pose="left camera to world: frame, 4x4; or IMU to world: frame, 3x4",
    up=(0.0, 0.0, 1.0),
    segmentation="`data_2d_semantics/train/*/image_00/instance/*.png`: class number times 1000, plus instance",
)
CLASSES = (
    "unlabeled", "ego vehicle", "rectification border", "out of roi", "static", "dynamic", "ground", "road",
    "sidewalk", "parking", "rail track", "building", "wall", "fence", "guard rail", "bridge", "tunnel", "pole",
    "polegroup", "traffic light", "traffic sign", "vegetation", "terrain", "sky", "person", "rider", "car", "truck",
    "bus", "caravan", "trailer", "train", "motorcycle", "bicycle", "garage", "gate", "stop", "smallpole", "lamp",
    "trash bin", "vending machine", "box", "unknown construction", "unknown vehicle", "unknown object",
)  # fmt: skip
NAMED = 6
"""The first class that names something."""
THINGS = frozenset((11, 17, 19, 20, *range(24, 35), *range(36, 42)))
"""Classes that have instances."""
_SAMPLED_FOR_FLOOR = 40


def _recognise(path: Path) -> bool:
    root = _root(path)
    return (root / "calibration" / "perspective.txt").is_file() and (root / "data_2d_raw").is_dir()


def _open(path: Path) -> Recording:
    root, drive = _root(path), _drive(path)
    camera, R_rect = _camera(root / "calibration" / "perspective.txt")
    scans = root / "data_3d_raw" / drive / "velodyne_points" / "data"
    clouds = {int(file.stem): file for file in numbered(scans, "[0-9]*.bin") if file.stem.isdecimal()}
    if not clouds:
        raise InputError(f"{scans}: expected laser scans (*.bin), as KITTI-360 has no depth images, found none")
    pictures = root / "data_2d_raw" / drive / "image_00" / "data_rect"
    images = {int(file.stem): file for file in numbered(pictures, "[0-9]*.png") if file.stem.isdecimal()}
    rows, columns, T_pose_camera = _poses(root, drive, R_rect)
    matched = match_frames(
        root / "data_2d_raw" / drive,
        {"picture": images, "laser scan": clouds},
        {frame: row for row in rows if (frame := _frame(*row)) is not None},
        lambda row: _three_rows(numbers(*row, count=columns)[1:]),
        place=lambda row: row[0],
    )
    color_files, cloud_files = matched.of_each(images, clouds)
    T_world_camera = matched.poses @ T_pose_camera
    T_camera_velo = R_rect @ invert_pose(_rigid_file(root / "calibration" / "calib_cam_to_velo.txt"))

    def cloud(index: int) -> NDArray:
        return camera_points(_scan(cloud_files[index]), T_camera_velo)

    floor = gravity_of_clouds(
        [(cloud(i), T_world_camera[i]) for i in spread(len(color_files), _SAMPLED_FOR_FLOOR)], camera, FACTS.up
    )
    masks = root / "data_2d_semantics" / "train" / drive / "image_00" / "instance"
    return cloud_frames(color_files, cloud_files, camera, cloud, CloudSettings()).recording(
        FACTS,
        path,
        name=drive,
        frame_names=tuple(file.stem for file in color_files),
        segments=_segments([masks / file.name for file in color_files], camera) if masks.is_dir() else None,
        depth_unit_m=0.002,  # of 16-bit images written from it: 131 m
        **matched.members(*filter(None, [floor.floor_note])) | {"poses": T_world_camera},
        floor_height_m=floor.floor_height_m,
    )


READER = Reader(FACTS, _recognise, _open)


def _root(path: Path) -> Path:
    resolved = path.resolve()
    return resolved.parents[1] if resolved.parent.name == "data_2d_raw" else path


def _drive(path: Path) -> str:
    if _root(path) != path:
        return path.resolve().name
    drives = sorted(folder.name for folder in (path / "data_2d_raw").iterdir() if folder.is_dir())
    if len(drives) != 1:
        named = f"; name one, such as {path / 'data_2d_raw' / drives[0]}" if drives else ""
        raise InputError(f"{path / 'data_2d_raw'}: expected one drive, found {len(drives)}{named}")
    return drives[0]


def _camera(file: Path) -> tuple[Intrinsics, NDArray]:
    """Return the rectified left camera, and what takes points of the unrectified one to it [4, 4]."""
    P, R, size = (_values(file, f"{key}_rect_00", n) for key, n in (("P", 12), ("R", 9), ("S", 2)))
    P = P.reshape(3, 4)
    R_rect = np.eye(4)
    R_rect[:3, :3] = R.reshape(3, 3)
    if not np.isfinite(size).all() or not ((size > 0) & (size < 1e5)).all():
        raise InputError(f"{file}: S_rect_00: expected a width and height, found {size[0]:g} and {size[1]:g}")
    camera = pinhole(f"{file}: P_rect_00", int(size[0]), int(size[1]), P[0, 0], P[1, 1], P[0, 2], P[1, 2])
    return camera, rigid(f"{file}: R_rect_00", R_rect)


def _values(file: Path, key: str, count: int) -> NDArray:
    """Return the numbers of a line ``key: ...``."""
    for line, (first, *rest) in words(file):
        if first == f"{key}:":
            found = numbers(f"{file}, line {line}", rest, finite=True)
            if len(found) != count:
                raise InputError(f"{file}, line {line}: expected {count} numbers, found {len(found)}")
            return np.asarray(found)
    raise InputError(f"{file}: expected a line {key}:, found none")


def _rigid_file(file: Path) -> NDArray:
    where, found = number_rows(file, 12)[0]
    return rigid(where, _three_rows(numbers(where, found, count=12)))


def _three_rows(values: NDArray) -> NDArray:
    return np.vstack([values[:12].reshape(3, 4), [0, 0, 0, 1]])


def _frame(where: str, line: list[str]) -> int | None:
    """Return the frame whose pose a line is; None where its first word is no number."""
    try:
        return int(numbers(where, line[:1], finite=True)[0])
    except InputError:
        return None


def _poses(root: Path, drive: str, R_rect: NDArray) -> tuple[list[tuple[str, list[str]]], int, NDArray]:
    """Return the lines of a drive's poses, how many numbers each has, and what takes the camera to them."""
    of_camera, of_imu = (root / "data_poses" / drive / name for name in ("cam0_to_world.txt", "poses.txt"))
    if of_camera.is_file():
        return number_rows(of_camera, 17), 17, np.eye(4)
    T_imu_camera = _three_rows(_values(root / "calibration" / "calib_cam_to_pose.txt", "image_00", 12))
    return number_rows(of_imu, 13), 13, rigid("calib_cam_to_pose.txt: image_00", T_imu_camera) @ invert_pose(R_rect)


def _scan(file: Path) -> NDArray:
    """Read the points of a scan, float64 [n, 3]: little-endian x, y, z, reflectance of 32 bits each."""
    data = read_bytes(file, MAX_CLOUD_BYTES, "a laser scan")
    if len(data) % 16:
        raise InputError(f"{file}: expected points of 16 bytes, found {len(data)} bytes")
    return finite_points(np.frombuffer(data, "<f4").reshape(-1, 4)[:, :3])


def _segments(files: list[Path], camera: Intrinsics) -> Segments:
    def read(index: int) -> Segmentation:
        file = files[index]
        if not file.is_file():  # not all frames are annotated
            return Segmentation(np.zeros((camera.height, camera.width), np.int32), (), segmented=False)
        ids = read_ids(file).astype(np.int32)
        check_size(file, ids, camera)
        if ids.max() >= 1000 * len(CLASSES):
            raise InputError(f"{file}: expected class numbers under {len(CLASSES)}, found {ids.max() // 1000}")
        number, instance = np.divmod(ids, 1000)
        thing = np.isin(number, list(THINGS))
        ids[(number < NAMED) | (thing & (instance == 0))] = 0  # void, and things nobody told apart
        found = [int(i) for i in np.unique(ids) if i]
        return Segmentation(ids, tuple(Segment(i, CLASSES[i // 1000], 1.0, i // 1000 in THINGS) for i in found))

    classes = {name: number in THINGS for number, name in enumerate(CLASSES) if number >= NAMED}
    return Segments(classes, read, "KITTI-360 annotation")
