"""Writers of robots' recordings: a base that drives, a camera fixed on it, depth and colour at their own times."""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scans import (
    COLORS,
    FRAMES,
    INTERVAL_S,
    START_S,
    Z_UP,
    Sample,
    camera,
    look,
    map_pose,
    quaternion,
    steps,
    write_reference,
)

from simaps_viz.geometry import invert_pose

T_BASE_CAMERA = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0.0], [0, -1, 0, 0.9], [0, 0, 0, 1.0]])
"""An optical frame (x right, y down, z forward) on a robot whose x is forward and z up."""
DEPTH, COLOR = "/camera/aligned_depth_to_color", "/camera/color"


def rvl(depth: np.ndarray) -> bytes:
    """Pack as A. Wilson's paper says: runs of zeros and of others, differences, three bits a nibble."""
    numbers, flat, i = [], depth.ravel().astype(int), 0
    previous = 0
    while i < flat.size:
        start = i
        while i < flat.size and flat[i] == 0:
            i += 1
        numbers.append(i - start)
        start = i
        while i < flat.size and flat[i] != 0:
            i += 1
        numbers.append(i - start)
        for value in flat[start:i]:
            step, previous = value - previous, value
            numbers.append(2 * step if step >= 0 else -2 * step - 1)
    nibbles = []
    for number in numbers:
        digits = [int(digit) for digit in reversed(f"{number:o}")]
        nibbles += [digit | 8 for digit in digits[:-1]] + digits[-1:]
    nibbles += [0] * (-len(nibbles) % 8)
    words = [sum(n << (28 - 4 * j) for j, n in enumerate(nibbles[i : i + 8])) for i in range(0, len(nibbles), 8)]
    return struct.pack(f"<{len(words)}I", *words)


class Messages:
    """Makes messages of one ROS."""

    def __init__(self, store: Stores) -> None:
        self.store = get_typestore(store)
        self.ros1 = store == Stores.ROS1_NOETIC
        if self.ros1:
            self.store.register(
                get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
            )
        self.sequence = {"seq": 0} if self.ros1 else {}

    def make(self, name: str, /, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def header(self, time_s: float, frame: str) -> Any:
        sec, nanosec = divmod(round(time_s * 1e9), 10**9)
        stamp = self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **self.sequence)

    def image(self, time_s: float, pixels: np.ndarray, encoding: str, frame: str = "camera_optical") -> Any:
        """Rows are padded by eight bytes, as drivers may."""
        rows = pixels.reshape(len(pixels), -1).view(np.uint8)
        padded = np.pad(rows, ((0, 0), (0, 8)), constant_values=7)
        return self.make(
            "sensor_msgs/msg/Image", header=self.header(time_s, frame), height=pixels.shape[0], width=pixels.shape[1],
            encoding=encoding, is_bigendian=0, step=padded.shape[1], data=padded.ravel(),
        )  # fmt: skip

    def compressed(self, time_s: float, data: bytes, format: str) -> Any:
        return self.make(
            "sensor_msgs/msg/CompressedImage", header=self.header(time_s, "camera_optical"), format=format,
            data=np.frombuffer(data, np.uint8),
        )  # fmt: skip

    def camera_info(self, time_s: float) -> Any:
        k = camera()
        K, P = k.matrix(), np.hstack([k.matrix(), np.zeros((3, 1))])
        roi = self.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        named = {"D": np.zeros(5), "K": K.ravel(), "R": np.eye(3).ravel(), "P": P.ravel()}
        named = named if self.ros1 else {key.lower(): value for key, value in named.items()}
        return self.make(
            "sensor_msgs/msg/CameraInfo", header=self.header(time_s, "camera_optical"), height=k.height, width=k.width,
            distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=roi, **named,
        )  # fmt: skip

    def _parts(self, T: np.ndarray) -> tuple[dict[str, float], Any]:
        x, y, z, w = quaternion(T)
        return dict(zip("xyz", map(float, T[:3, 3]), strict=True)), self.make(
            "geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w
        )

    def transform(self, time_s: float, parent: str, child: str, T: np.ndarray) -> Any:
        position, rotation = self._parts(T)
        moved = self.make(
            "geometry_msgs/msg/Transform",
            translation=self.make("geometry_msgs/msg/Vector3", **position),
            rotation=rotation,
        )
        stamped = self.make("geometry_msgs/msg/TransformStamped", header=self.header(time_s, parent),
                            child_frame_id=child, transform=moved)  # fmt: skip
        return self.make("tf2_msgs/msg/TFMessage", transforms=[stamped])

    def odometry(self, time_s: float, T: np.ndarray) -> Any:
        position, rotation = self._parts(T)
        pose = self.make("geometry_msgs/msg/Pose", position=self.make("geometry_msgs/msg/Point", **position),
                         orientation=rotation)  # fmt: skip
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        return self.make(
            "nav_msgs/msg/Odometry", header=self.header(time_s, "odom"), child_frame_id="base_link",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )  # fmt: skip


def entries(make: Messages, *, odometry: bool = False, compressed: bool = False) -> list[tuple[float, str, Any]]:
    """(time logged, topic, message); pictures are logged 30 ms after they were taken, and late depth has no tf."""
    found: list[tuple[float, str, Any]] = [
        (START_S - 0.5, "/tf_static", make.transform(0.0, "base_link", "camera_optical", T_BASE_CAMERA)),
        (START_S - 0.4, f"{COLOR}/camera_info", make.camera_info(START_S)),
        (START_S - 0.4, f"{DEPTH}/camera_info", make.camera_info(START_S)),
        (START_S + 9, f"{DEPTH}/image_raw", make.image(START_S + 9, np.ones((48, 64), "<u2"), "16UC1")),
    ]
    for tick in range(-2, 2 * FRAMES + 1):
        time_s = START_S + tick * INTERVAL_S / 2
        T_world_base = Z_UP.pose(tick / 2) @ invert_pose(T_BASE_CAMERA)
        message = make.odometry(time_s, T_world_base) if odometry else make.transform(
            time_s, "odom", "base_link", T_world_base)  # fmt: skip
        found.append((time_s, "/odom" if odometry else "/tf", message))
    for i in range(FRAMES):
        depth_m, ids = look(camera(), map_pose(i))
        raw, rgb, time_s = steps(depth_m), COLORS[ids], START_S + i * INTERVAL_S
        depth = make.image(time_s, raw.astype("<u2"), "16UC1")
        color = make.image(time_s + 0.005, np.ascontiguousarray(rgb[..., ::-1]), "bgr8")
        if compressed:
            png = cv2.imencode(".png", raw)[1].tobytes()
            depth = make.compressed(time_s, bytes(12) + png, "16UC1; compressedDepth png")
            color = make.compressed(
                time_s + 0.005, cv2.imencode(".png", rgb[..., ::-1].copy())[1].tobytes(), "bgr8; png"
            )
        suffix = ("/image_raw/compressedDepth", "/image_raw/compressed") if compressed else ("/image_raw",) * 2
        found += [(time_s + 0.03, DEPTH + suffix[0], depth), (time_s + 0.03, COLOR + suffix[1], color)]
    if compressed:
        found = [entry for entry in found if entry[1] != f"{DEPTH}/image_raw"]
    return sorted(found, key=lambda entry: entry[0])


def _sample(folder: Path, path: Path) -> Sample:
    return Sample(path, write_reference(folder / "reference", camera(), Z_UP))


def write_bag1(path: Path, found: list[tuple[float, str, Any]], make: Messages) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    opened = rosbag1.Writer(path)
    opened.set_compression(opened.CompressionFormat.BZ2)
    with opened as writer:
        connections: dict[str, Any] = {}
        for time_s, topic, message in found:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=make.store)
            data = make.store.serialize_ros1(message, message.__msgtype__)
            writer.write(connections[topic], round(time_s * 1e9), data)


def write_bag2(path: Path, found: list[tuple[float, str, Any]], make: Messages, plugin: rosbag2.StoragePlugin) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for time_s, topic, message in found:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=make.store)
            data = make.store.serialize_cdr(message, message.__msgtype__)
            writer.write(connections[topic], round(time_s * 1e9), data)


def ros1_bag(folder: Path) -> Sample:
    make, path = Messages(Stores.ROS1_NOETIC), folder / "drive.bag"
    write_bag1(path, entries(make), make)
    return _sample(folder, path)


def ros2_sqlite(folder: Path) -> Sample:
    make, path = Messages(Stores.ROS2_HUMBLE), folder / "drive"
    write_bag2(path, entries(make, odometry=True), make, rosbag2.StoragePlugin.SQLITE3)
    return _sample(folder, path)


def ros2_mcap(folder: Path) -> Sample:
    """A single .mcap file, without its folder; pictures are compressed."""
    make, path = Messages(Stores.ROS2_HUMBLE), folder / "bag"
    write_bag2(path, entries(make, compressed=True), make, rosbag2.StoragePlugin.MCAP)
    alone = folder / "drive.mcap"
    next(path.glob("*.mcap")).rename(alone)
    return _sample(folder, alone)
