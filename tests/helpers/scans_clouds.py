"""Writers of laser scans with a camera beside them: clouds of the same scene as in `scans`, one point a pixel."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags import rosbag2
from rosbags.typesys import Stores
from scans import (
    COLORS,
    FRAMES,
    Z_UP,
    Sample,
    camera,
    look,
    map_pose,
    row,
    steps,
    write_depth,
    write_image,
    write_reference,
)
from scans_bags import COLOR, DEPTH, Messages, entries, write_bag2
from scipy.spatial.transform import Rotation

from simaps_viz.geometry import back_project, invert_pose, transform_points

T_LIDAR_CAMERA = np.array([[0, 0, 1, 0.08], [-1, 0, 0, 0.02], [0, -1, 0, -0.11], [0, 0, 0, 1.0]])
"""A LiDAR over a camera: x forward, y left, z up."""
LIDAR = "/velodyne_points"


def cloud_of(index: int) -> NDArray:
    """Return a frame's points in camera axes, float64 [n, 3]; depth in whole millimetres, as in other formats."""
    depth_m = steps(look(camera(), map_pose(index))[0]) * np.float32(0.001)
    k = camera()
    points = back_project(depth_m, k.fx, k.fy, k.cx, k.cy).reshape(-1, 3)
    return points[points[:, 2] > 0]


def ply(points: NDArray, form: str = "binary_little_endian", kind: str = "double") -> bytes:
    """A PLY file with a colour and an element before the points."""
    order = ">" if form == "binary_big_endian" else "<"
    code = order + {"double": "f8", "float": "f4"}[kind]
    header = (
        f"ply\nformat {form} 1.0\ncomment made by a test\nelement camera 1\nproperty float fov\n"
        f"element vertex {len(points)}\nproperty {kind} x\nproperty {kind} y\nproperty uchar red\n"
        f"property {kind} z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        lines = ["60.0"] + [f"{x!r} {y!r} 7 {z!r}" for x, y, z in points.tolist()]
        return header + "\n".join(lines).encode() + b"\n"
    table = np.zeros(len(points), np.dtype([("x", code), ("y", code), ("red", "u1"), ("z", code)]))
    for i, axis in enumerate("xyz"):
        table[axis] = points[:, i]
    return header + np.array([60.0], order + "f4").tobytes() + table.tobytes()


def pcd(points: NDArray, stored: str = "binary", size: int = 4) -> bytes:
    """A PCD file whose points have an intensity in front and three more numbers behind; the last point is NaN."""
    points = np.vstack([points, np.full((1, 3), np.nan)])
    n, code = len(points), f"<f{size}"
    header = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS intensity x y z normal\n"
        f"SIZE 2 {size} {size} {size} 4\nTYPE U F F F F\nCOUNT 1 1 1 1 3\nWIDTH {n}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {stored}\n"
    ).encode()
    if stored == "ascii":
        lines = [f"5 {x!r} {y!r} {z!r} 0 0 1" for x, y, z in points.tolist()]
        return header + "\n".join(lines).encode() + b"\n"
    columns = [np.full(n, 5, "<u2"), *(points[:, i].astype(code) for i in range(3)), np.zeros((n, 3), "<f4")]
    if stored == "binary":
        return header + b"".join(c[i].tobytes() for i in range(n) for c in columns)
    data = b"".join(c.tobytes() for c in columns)
    packed = lzf_pack(data)
    return header + struct.pack("<II", len(packed), len(data)) + packed


def lzf_pack(data: bytes) -> bytes:
    """Pack as liblzf does: literal runs of up to 32 bytes, repeats of 3 to 264 bytes up to 8191 bytes back."""
    out, literal, at, seen = bytearray(), bytearray(), 0, {}

    def flush() -> None:
        for i in range(0, len(literal), 32):
            part = literal[i : i + 32]
            out.extend([len(part) - 1, *part])
        literal.clear()

    while at < len(data):
        key = data[at : at + 3]
        back = at - seen.get(key, -10_000)
        seen[key] = at
        length = 3
        while (
            back <= 8191 and length < 264 and at + length < len(data) and data[at + length] == data[at + length - back]
        ):
            length += 1
        if back > 8191 or len(key) < 3:
            literal.append(data[at])
            at += 1
            continue
        flush()
        far, more = back - 1, length - 2
        out.extend([(min(more, 7) << 5) | (far >> 8), *([more - 7] if more >= 7 else []), far & 255])
        at += length
    flush()
    return bytes(out)


def write_scan(folder: Path, reference: Path, files: dict[str, bytes], poses: list[NDArray], **keys: Any) -> Path:
    """Write a posed-clouds/1 folder whose pictures, camera and masks are those of a reference."""
    folder.mkdir(parents=True)
    for name, data in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    for i in range(FRAMES):
        write_image(folder / f"color/{i}.png", COLORS[look(camera(), map_pose(i))[1]])
    (folder / "ids").symlink_to((reference / "ids").resolve())
    for name in ("intrinsics.txt", "scene.json"):
        (folder / name).write_text((reference / name).read_text())
    (folder / "poses.txt").write_text("\n".join(f"{i} {row(T)}" for i, T in enumerate(poses)))
    content = {
        "format": "posed-clouds/1", "clouds": "clouds/{frame}.ply", "color": "color/{frame}.png",
        "intrinsics": "intrinsics.txt", "poses": "poses.txt", "T_lidar_camera": T_LIDAR_CAMERA.tolist(),
        "up": [0, 0, 1], "segmentation": {"ids": "ids/{frame}.png", "instances": "scene.json"},
    } | keys  # fmt: skip
    (folder / "lidar.json").write_text(json.dumps({k: v for k, v in content.items() if v is not None}))
    return folder


def lidar_poses() -> list[NDArray]:
    """T_world_lidar of each frame."""
    return [Z_UP.pose(i) @ invert_pose(T_LIDAR_CAMERA) for i in range(FRAMES)]


def lidar(folder: Path) -> Sample:
    """Clouds in the LiDAR's frame, poses of the LiDAR."""
    reference = write_reference(folder / "reference", camera(), Z_UP)
    clouds = {f"clouds/{i}.ply": ply(transform_points(T_LIDAR_CAMERA, cloud_of(i))) for i in range(FRAMES)}
    return Sample(write_scan(folder / "scan", reference, clouds, lidar_poses()), reference)


T_VELO_CAMERA = T_LIDAR_CAMERA
DRIVE = "2013_05_28_drive_0000_sync"
R_RECT = Rotation.from_rotvec([0.01, -0.02, 0.005]).as_matrix()
T_IMU_CAMERA = np.array([[0, 0, 1, 1.6], [1, 0, 0, 0.0], [0, 1, 0, -0.7], [0, 0, 0, 1.0]])
"""An IMU's axes are x forward, y right, z down."""


def kitti360(folder: Path, *, of_imu: bool = False) -> Sample:
    """A drive with frames 5, 6, 7, 8; a frame without pose; masks of all frames but the last."""
    reference, root, k = write_reference(folder / "reference", camera(), Z_UP), folder / "KITTI-360", camera()
    rectify = np.eye(4)
    rectify[:3, :3] = R_RECT
    lines = {
        "S_rect_00": (k.width, k.height), "R_rect_00": R_RECT.ravel(), "K_00": np.zeros(9),
        "P_rect_00": (k.fx, 0, k.cx, 0, 0, k.fy, k.cy, 0, 0, 0, 1, 0),
    }  # fmt: skip
    texts = {
        "calibration/perspective.txt": "calib_time: 02-May-2013 16:00:00\n"
        + "".join(f"{key}: {' '.join(f'{x:.9e}' for x in values)}\n" for key, values in lines.items()),
        "calibration/calib_cam_to_velo.txt": " ".join(map(repr, (T_VELO_CAMERA @ rectify)[:3].ravel().tolist())),
        "calibration/calib_cam_to_pose.txt": f"image_00: {' '.join(map(repr, T_IMU_CAMERA[:3].ravel().tolist()))}\n",
    }
    poses = [Z_UP.pose(i) @ (rectify @ invert_pose(T_IMU_CAMERA) if of_imu else np.eye(4)) for i in range(FRAMES)]
    numbers = [" ".join(map(repr, T[: 3 if of_imu else 4].ravel().tolist())) for T in poses]
    name = "poses.txt" if of_imu else "cam0_to_world.txt"
    texts[f"data_poses/{DRIVE}/{name}"] = "".join(f"{5 + i} {line} \n" for i, line in enumerate(numbers))
    for path, content in texts.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(content)
    scans = root / f"data_3d_raw/{DRIVE}/velodyne_points/data"
    scans.mkdir(parents=True)
    for i in range(FRAMES + 1):
        drawn = min(i, FRAMES - 1)
        ids = look(k, map_pose(drawn))[1]
        write_image(root / f"data_2d_raw/{DRIVE}/image_00/data_rect/{5 + i:010d}.png", COLORS[ids])
        if i < FRAMES - 1:
            masks = np.array([0, 26001, 26002, 7000], np.uint16)[ids]
            masks[0, :2] = 1000, 26000  # the car that drives; cars nobody told apart
            write_depth(root / f"data_2d_semantics/train/{DRIVE}/image_00/instance/{5 + i:010d}.png", masks)
        points = np.ones((len(cloud_of(drawn)), 4), "<f4")
        points[:, :3] = transform_points(T_VELO_CAMERA, cloud_of(drawn))
        (scans / f"{5 + i:010d}.bin").write_bytes(points.tobytes())
    return Sample(root, reference)


def cloud_message(make: Messages, time_s: float, points: NDArray) -> Any:
    """A PointCloud2 with gaps between its fields and padded rows."""
    fields = [make.make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=kind, count=1)
              for name, offset, kind in (("intensity", 0, 7), ("x", 8, 8), ("y", 16, 8), ("z", 24, 8))]  # fmt: skip
    table = np.zeros((len(points), 4), "<f8")
    table[:, 1:] = points
    return make.make(
        "sensor_msgs/msg/PointCloud2", header=make.header(time_s, "velodyne"), height=1, width=len(points),
        fields=fields, is_bigendian=False, point_step=32, row_step=32 * len(points) + 16, is_dense=True,
        data=np.concatenate([table.view(np.uint8).ravel(), np.full(16, 9, np.uint8)]),
    )  # fmt: skip


def cloud_entries(make: Messages, *, odometry: bool = False) -> list[tuple[float, str, Any]]:
    """What a robot with a LiDAR logs; its clouds are taken when depth images were, and there are none of these."""
    found = []
    for time_s, topic, message in entries(make, odometry=odometry):
        if not topic.startswith(DEPTH):
            found.append((time_s, topic, message))
        elif topic.endswith("image_raw") and message.height == camera().height and message.header.stamp.sec < 109:
            index = sum(name == LIDAR for _, name, _ in found)
            stamp_s = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
            points = transform_points(T_LIDAR_CAMERA, cloud_of(index))
            found.append((time_s, LIDAR, cloud_message(make, stamp_s, points)))
    mount = make.transform(0.0, "camera_optical", "velodyne", invert_pose(T_LIDAR_CAMERA))
    return [(found[0][0] - 0.1, "/tf_static", mount), *found]


def cloud_bag(folder: Path) -> Sample:
    make, path = Messages(Stores.ROS2_HUMBLE), folder / "drive"
    shifted = [(t, topic, _at_cloud_time(make, topic, message)) for t, topic, message in cloud_entries(make)]
    write_bag2(path, shifted, make, rosbag2.StoragePlugin.SQLITE3)
    return Sample(path, write_reference(folder / "reference", camera(), Z_UP))


def _at_cloud_time(make: Messages, topic: str, message: Any) -> Any:
    """Colour is stamped 5 ms after depth; here both are of one moment, so that poses are those of the reference."""
    if topic.startswith(COLOR) and topic.endswith("image_raw"):
        stamp = message.header.stamp
        time_s = stamp.sec + stamp.nanosec / 1e9 - 0.005
        pixels = np.asarray(message.data).reshape(message.height, message.step)[:, : message.width * 3]
        return make.image(time_s, np.ascontiguousarray(pixels).reshape(message.height, message.width, 3), "bgr8")
    return message
