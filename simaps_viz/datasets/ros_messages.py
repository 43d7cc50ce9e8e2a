"""Decodes ROS messages: images, cameras and poses, as rosbags gives them (ROS 1 and 2 alike)."""

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.cloud_files import finite_points
from simaps_viz.datasets.file_frames import clean_depth
from simaps_viz.datasets.images import decode_image
from simaps_viz.datasets.lens import Lens, pinhole
from simaps_viz.datasets.rows import from_quaternion
from simaps_viz.errors import InputError

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CLOUD = "sensor_msgs/msg/PointCloud2"
MILLIMETRES, METRES = ("16UC1", "mono16"), ("32FC1",)
"""Encodings of depth images (REP 118)."""
DEPTH_UNIT_M = 0.001
_COLORS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "8UC3": 3, "mono8": 1}
"""{encoding: channels}; 8UC3 is taken as BGR."""
_FLOATS = {7: "f4", 8: "f8"}
"""PointField's numbers for floats, as NumPy writes them."""
_COMPRESSED_DEPTH_HEADER = struct.Struct("<iff")
"""Before the PNG of a compressed depth image: a kind, and the two numbers a and b that metres are packed with."""


def is_depth(message: Any) -> bool:
    """Return whether an image message holds depth."""
    if message.__msgtype__ == IMAGE:
        return message.encoding in MILLIMETRES + METRES
    return "compressedDepth" in message.format or _encoding(message) in MILLIMETRES


def depth_m(where: str, message: Any) -> NDArray:
    """Decode a depth image: float32 [H, W], metres, 0 = invalid.

    Raises:
        InputError: Its encoding is not supported, or it is cut short.
    """
    if message.__msgtype__ == IMAGE:
        kind = "u2" if message.encoding in MILLIMETRES else "f4"
        pixels = _pixels(where, message, np.dtype(kind), 1)[..., 0]
        return clean_depth(pixels * np.float32(DEPTH_UNIT_M) if kind == "u2" else pixels)
    encoding, data = _encoding(message), bytes(message.data)
    if encoding not in MILLIMETRES + METRES or message.format.rstrip().endswith("rvl"):
        raise InputError(f"{where}: expected compressed depth, 16UC1 or 32FC1, as PNG, found {message.format!r}")
    if "compressedDepth" not in message.format:  # image_transport's own, a PNG and nothing else
        return _sixteen_bits(where, data) * np.float32(DEPTH_UNIT_M)
    if len(data) < _COMPRESSED_DEPTH_HEADER.size:
        raise InputError(f"{where}: expected compressed depth, found {len(data)} bytes")
    _, a, b = _COMPRESSED_DEPTH_HEADER.unpack_from(data)
    steps = _sixteen_bits(where, data[_COMPRESSED_DEPTH_HEADER.size :])
    if encoding in MILLIMETRES:
        return steps * np.float32(DEPTH_UNIT_M)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return clean_depth(np.where(steps > 0, np.float32(a) / (steps - np.float32(b)), 0))


def _encoding(message: Any) -> str:
    return message.format.partition(";")[0].strip()


def _sixteen_bits(where: str, png: bytes) -> NDArray:
    """Decode a picture of one channel of 16 bits, as float32 [H, W]."""
    image = decode_image(where, png, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise InputError(f"{where}: expected a PNG of one channel of 16 bits, found {image.dtype} {list(image.shape)}")
    return image.astype(np.float32)


def color(where: str, message: Any) -> NDArray:
    """Decode a colour image: uint8 [H, W, 3], RGB; raises InputError like ``depth_m``."""
    if message.__msgtype__ == COMPRESSED:
        bgr = decode_image(where, bytes(message.data), cv2.IMREAD_COLOR)
        return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
    if message.encoding not in _COLORS:
        raise InputError(f"{where}: expected colour as {', '.join(_COLORS)}, found {message.encoding!r}")
    pixels = _pixels(where, message, np.dtype("u1"), _COLORS[message.encoding])
    if pixels.shape[2] == 1:
        return np.repeat(pixels, 3, axis=2)
    rgb = pixels[..., :3] if message.encoding.startswith("rgb") else pixels[..., 2::-1]
    return np.ascontiguousarray(rgb)


def points(where: str, message: Any) -> NDArray:
    """Decode a cloud: float64 [n, 3], in the frame of its header; points that are not finite are left out.

    Raises:
        InputError: It has no x, y and z as floats, or is cut short.
    """
    fields = {field.name: field for field in message.fields}
    kinds = {axis: _FLOATS.get(fields[axis].datatype) for axis in "xyz" if axis in fields}
    if len(kinds) != 3 or None in kinds.values():
        raise InputError(
            f"{where}: expected a cloud with x, y and z as floats, found {', '.join(fields) or 'no fields'}"
        )
    order = ">" if message.is_bigendian else "<"
    step, size = message.point_step, message.row_step * message.height
    data = np.frombuffer(bytes(message.data), np.uint8)
    ends = [fields[axis].offset + np.dtype(kind).itemsize for axis, kind in kinds.items()]
    if max(ends) > step or step * message.width > message.row_step or data.size < size:
        expected = f"{message.width}x{message.height} points of {step} bytes"
        raise InputError(f"{where}: expected {expected}, found {data.size} bytes in rows of {message.row_step}")
    rows = data[:size].reshape(message.height, message.row_step)[:, : step * message.width]
    table = np.ascontiguousarray(rows).view(
        np.dtype({"names": list(kinds), "formats": [order + str(kind) for kind in kinds.values()],
                  "offsets": [fields[axis].offset for axis in kinds], "itemsize": step})
    )  # fmt: skip
    return finite_points(np.stack([table[axis].ravel().astype(np.float64) for axis in "xyz"], axis=1))


def lens(where: str, message: Any, *, rectified: bool) -> Lens:
    """Return the camera of a CameraInfo message: of rectified images P says it, of raw ones K and D.

    Raises:
        InputError: It is no pinhole, or its distortion is not Brown-Conrady ("plumb_bob").
    """
    K, P, D = (np.ravel(getattr(message, n, getattr(message, n.lower(), []))) for n in ("K", "P", "D"))
    fx, fy, cx, cy = (P[0], P[5], P[2], P[6]) if rectified and len(P) == 12 and P[0] > 0 else (K[0], K[4], K[2], K[5])
    bent = not rectified and bool(np.any(D))
    if bent and (message.distortion_model not in ("plumb_bob", "") or len(D) not in (4, 5)):
        raise InputError(f"{where}: expected distortion model plumb_bob, found {message.distortion_model!r}")
    camera = pinhole(where, message.width, message.height, float(fx), float(fy), float(cx), float(cy))
    return Lens(camera, tuple(float(x) for x in D) if bent else ())


def pose(where: str, message: Any) -> NDArray:
    """Return the pose [4, 4] of a Pose or Transform message."""
    t = message.position if hasattr(message, "position") else message.translation
    q = message.orientation if hasattr(message, "orientation") else message.rotation
    return from_quaternion(where, (t.x, t.y, t.z), (q.x, q.y, q.z, q.w))


def stamp_ns(header: Any) -> int:
    """Return the time of a header, nanoseconds."""
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def raw_stamp_ns(data: bytes, *, ros2: bool) -> int:
    """Read the time of a message that starts with a header, without decoding its picture, nanoseconds."""
    if ros2:  # four bytes say how numbers are written, then come seconds and nanoseconds
        sec, nanosec = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    else:  # a counter comes first
        sec, nanosec = struct.unpack_from("<II", data, 4)
    return sec * 1_000_000_000 + nanosec


def _pixels(where: str, message: Any, dtype: np.dtype, channels: int) -> NDArray:
    """Return [H, W, channels]; rows may be padded."""
    dtype = dtype.newbyteorder(">" if message.is_bigendian else "<")
    width = message.width * channels * dtype.itemsize
    data = np.frombuffer(bytes(message.data), np.uint8)
    if message.step < width or data.size < message.step * message.height:
        expected = f"{message.width}x{message.height} {message.encoding}"
        raise InputError(f"{where}: expected {expected}, found {data.size} bytes in rows of {message.step}")
    rows = data[: message.step * message.height].reshape(message.height, message.step)[:, :width]
    return np.ascontiguousarray(rows).view(dtype).reshape(message.height, message.width, channels)
