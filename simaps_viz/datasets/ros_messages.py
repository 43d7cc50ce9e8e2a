"""Decode the messages of ROS that a map needs: images, compressed images, cameras, clouds, poses and transforms.

Messages are objects with ROS's fields and ``__msgtype__``, as rosbags deserialises them, of a bag or of a live topic.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.datasets import images
from simaps_viz.datasets.association import interpolate_poses
from simaps_viz.datasets.calibration import Lens, from_quaternion, pinhole
from simaps_viz.datasets.clouds import finite_points
from simaps_viz.datasets.file_frames import clean_depth
from simaps_viz.errors import InputError
from simaps_viz.io.limits import check_picture

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CLOUD, CAMERA_INFO = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/CameraInfo"
STAMPED = "geometry_msgs/msg/TransformStamped"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
POSE_TYPES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
MILLIMETRES, METRES = ("16UC1", "mono16"), ("32FC1",)
"""Encodings of depth images (REP 118)."""
DEPTH_UNIT_M = 0.001
_COLORS = {
    "rgb8": (3, None), "bgr8": (3, cv2.COLOR_BGR2RGB), "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB), "8UC3": (3, cv2.COLOR_BGR2RGB), "8UC4": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB), "8UC1": (1, cv2.COLOR_GRAY2RGB),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2RGB), "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2RGB), "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2RGB),
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY), "uyvy": (2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUYV), "yuyv": (2, cv2.COLOR_YUV2RGB_YUYV),
    "nv12": (1, cv2.COLOR_YUV2RGB_NV12), "nv21": (1, cv2.COLOR_YUV2RGB_NV21),
}  # fmt: skip
"""{encoding: (channels, OpenCV's code to RGB)}; 8UC3 and 8UC4 are taken as BGR, as OpenCV has them."""
_IDS = {"mono16": "u2", "16UC1": "u2", "32SC1": "i4", "mono8": "u1", "8UC1": "u1"}
"""{encoding of an image of ids: NumPy's type}."""
_HALF_COLOR = ("nv12", "nv21")
"""Two colours for four pixels, in half as many rows again below the picture."""
_FLOATS = {7: "f4", 8: "f8"}
"""PointField's numbers for floats, as NumPy writes them."""
_COMPRESSED_DEPTH_HEADER = struct.Struct("<iff")
"""Before compressed depth: a kind, and the two numbers a and b that metres are packed with."""
_RVL_SIZE = struct.Struct("<ii")
_PINHOLES = {"": (4, 5, 8), "none": (4, 5, 8), "pinhole": (4, 5, 8), "plumb_bob": (4, 5), "rational_polynomial": (8,)}
"""{distortion model: numbers of coefficients, without zeros at the end}."""
_FISHEYES = ("equidistant", "fisheye", "kannala_brandt")

MAX_GAP_S = 0.5
"""No pose is made up where a transform was silent for longer, unless it corrects another one."""
MAX_CORRECTION_GAP_S = 10.0
"""The same for a transform that comes rarely and changes little, as map to odom: the odometry goes on meanwhile."""
RARE = 4
"""A transform is such a correction when its messages are so many times farther apart than the fastest one's."""


def is_depth(message: Any) -> bool:
    """Return whether an image message holds depth."""
    if message.__msgtype__ == IMAGE:
        return message.encoding in MILLIMETRES + METRES
    return "compressedDepth" in message.format or encoding_of(message) in MILLIMETRES


def decode_depth(where: str, message: Any) -> NDArray:
    """Decode a depth image: float32 [H, W], metres, 0 = invalid.

    Raises:
        InputError: Its encoding is not supported, or it is cut short.
    """
    if message.__msgtype__ == IMAGE:
        kind = "u2" if message.encoding in MILLIMETRES else "f4"
        pixels = _pixels(where, message, np.dtype(kind), 1)[..., 0]
        return clean_depth(pixels * np.float32(DEPTH_UNIT_M) if kind == "u2" else pixels)
    encoding, data = encoding_of(message), bytes(message.data)
    if encoding not in MILLIMETRES + METRES:
        raise InputError(f"{where}: expected compressed depth, 16UC1 or 32FC1, found {message.format!r}")
    if "compressedDepth" not in message.format:  # image_transport's own, a PNG and nothing else
        return sixteen_bits(where, data) * np.float32(DEPTH_UNIT_M)
    rvl = message.format.rstrip().endswith("rvl")
    steps, metres = unpack_depth(where, data, rvl=rvl, quantised=encoding in METRES)
    return metres if metres is not None else steps * np.float32(DEPTH_UNIT_M)


def unpack_depth(
    where: str, data: bytes, *, rvl: bool, quantised: bool | None = None
) -> tuple[NDArray, NDArray | None]:
    """Unpack what compressed_depth_image_transport packs: a header, then a PNG or RVL.

    Args:
        where: names it in an error.
        data: the bytes.
        rvl: it is RVL, else PNG.
        quantised: it was metres, packed by the two numbers of the header; None = if they are not 0.

    Returns:
        The stored steps, float32 [H, W], and metres, float32 [H, W], 0 = invalid, where it was metres, else None.

    Raises:
        InputError: It is cut short, or no picture of 16 bits.
    """
    if len(data) < _COMPRESSED_DEPTH_HEADER.size:
        raise InputError(f"{where}: expected compressed depth, found {len(data)} bytes")
    _, a, b = _COMPRESSED_DEPTH_HEADER.unpack_from(data)
    packed = data[_COMPRESSED_DEPTH_HEADER.size :]
    if rvl:
        if len(packed) < _RVL_SIZE.size:
            raise InputError(f"{where}: expected compressed depth (RVL), found {len(data)} bytes")
        width, height = _RVL_SIZE.unpack_from(packed)
        steps = unpack_rvl(where, packed[_RVL_SIZE.size :], width, height).astype(np.float32)
    else:
        steps = sixteen_bits(where, packed)
    if not (a != 0 if quantised is None else quantised):
        return steps, None
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return steps, clean_depth(np.where(steps > 0, np.float32(a) / (steps - np.float32(b)), 0))


def unpack_rvl(where: object, packed: bytes, width: int, height: int) -> NDArray:
    """Unpack a depth image of A. Wilson's RVL (Fast Lossless Depth Image Compression, 2017): uint16 [height, width].

    Raises:
        InputError: There are fewer pixels than the picture has, or no camera has such a picture.
    """
    check_picture(where, width, height)
    words = np.frombuffer(packed[: len(packed) // 4 * 4], "<u4").astype(np.uint32)
    out = np.zeros(width * height, np.uint16)
    if not _unpack_rvl(words, out):
        raise InputError(f"{where}: expected a depth image of {width}x{height} pixels (RVL), found one cut short")
    return out.reshape(height, width)


@njit("boolean(uint32[::1], uint16[::1])", cache=True, nogil=True)
def _unpack_rvl(words: NDArray, out: NDArray) -> bool:
    """Fill pixels from numbers of three bits a nibble, lowest first; the upper bit of a nibble says that more follow.

    In turn come how many pixels are 0, how many are not, and of each of those the difference to the one before, which
    is stored times two, or, where it is negative, times minus two less one.
    """
    nibbles = 8 * words.size
    at = written = 0
    previous = remaining = 0
    zeros = True
    while written < out.size:
        number, shift, more = 0, 0, True
        while more:
            if at == nibbles or shift > 30:
                return False
            nibble = int(words[at >> 3] >> np.uint32(28 - 4 * (at & 7))) & 15
            number |= (nibble & 7) << shift
            more = nibble > 7
            shift += 3
            at += 1
        if remaining > 0:
            previous += (number >> 1) ^ -(number & 1)
            out[written] = previous & 0xFFFF
            written += 1
            remaining -= 1
            zeros = remaining == 0
        elif zeros:
            written += number
            zeros = False
        else:
            remaining = number
            zeros = number == 0
    return written == out.size


def encoding_of(message: Any) -> str:
    """Return the encoding that a CompressedImage had before."""
    return message.format.partition(";")[0].strip()


def sixteen_bits(where: str, png: bytes) -> NDArray:
    """Decode a picture of one channel of 16 bits, as float32 [H, W]; raises InputError for any other."""
    image = images.decode_image(where, png, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise InputError(f"{where}: expected a PNG of one channel of 16 bits, found {image.dtype} {list(image.shape)}")
    return image.astype(np.float32)


def decode_color(where: str, message: Any) -> NDArray:
    """Decode a colour image: uint8 [H, W, 3], RGB; raises InputError like ``decode_depth``."""
    if message.__msgtype__ == COMPRESSED:
        rgb, encoding = images.decode_color(where, bytes(message.data)), encoding_of(message)
        # image_transport compresses a sensor's mosaic as a grey picture, and then names no encoding after "compressed".
        mosaic = encoding.startswith("bayer") and encoding in _COLORS and message.format.rstrip().endswith("compressed")
        return cv2.cvtColor(np.ascontiguousarray(rgb[..., 0]), _COLORS[encoding][1]) if mosaic else rgb
    if message.encoding not in _COLORS:
        raise InputError(f"{where}: expected colour as {', '.join(_COLORS)}, found {message.encoding!r}")
    channels, code = _COLORS[message.encoding]
    rows = message.height * 3 // 2 if message.encoding in _HALF_COLOR else message.height
    pixels = _pixels(where, message, np.dtype("u1"), channels, rows=rows)
    try:
        return pixels if code is None else cv2.cvtColor(pixels, code)
    except cv2.error as error:  # a size that has no pairs of pixels
        size = f"{message.width}x{message.height}"
        raise InputError(f"{where}: expected a picture in {message.encoding}, found one of {size} pixels") from error


def decode_ids(where: str, message: Any) -> NDArray:
    """Decode an image of ids: int32 [H, W], 0 = nothing.

    Raises:
        InputError: It is not of one channel of whole numbers, holds an id below 0, or is cut short.
    """
    if message.__msgtype__ != IMAGE or message.encoding not in _IDS:
        found = repr(message.encoding) if message.__msgtype__ == IMAGE else message.__msgtype__
        raise InputError(f"{where}: expected an image of ids as {', '.join(_IDS)}, found {found}")
    ids = _pixels(where, message, np.dtype(_IDS[message.encoding]), 1)[..., 0].astype(np.int32)
    if ids.size and ids.min() < 0:
        raise InputError(f"{where}: expected ids from 0, found {ids.min()}")
    return ids


def decode_points(where: str, message: Any) -> NDArray:
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


def decode_lens(where: str, message: Any, *, rectified: bool) -> Lens:
    """Return the camera of a CameraInfo message: of rectified images P says it, of raw ones K and D.

    Binning and the region of interest are applied: the camera is that of the pictures as they are published.

    Args:
        where: names the message in an error.
        message: the CameraInfo.
        rectified: its pictures are (``image_rect``); where P is not given they are taken as raw.

    Raises:
        InputError: It is no pinhole or fisheye camera, or its distortion is of another model.
    """
    K, P, D = (np.ravel(getattr(message, n, getattr(message, n.lower(), []))) for n in ("K", "P", "D"))
    rectified = rectified and len(P) == 12 and bool(P[0] > 0)
    fx, fy, cx, cy = (float(x) for x in ((P[0], P[5], P[2], P[6]) if rectified else (K[0], K[4], K[2], K[5])))
    width, height = int(message.width), int(message.height)
    roi = getattr(message, "roi", None)
    if roi is not None and roi.width and roi.height:
        width, height, cx, cy = int(roi.width), int(roi.height), cx - roi.x_offset, cy - roi.y_offset
    across, down = (max(int(getattr(message, f"binning_{axis}", 1) or 1), 1) for axis in "xy")
    if across > 1 or down > 1:
        width, height, fx, fy, cx, cy = width // across, height // down, fx / across, fy / down, cx / across, cy / down
    camera = pinhole(where, width, height, fx, fy, cx, cy)
    if rectified:
        return Lens(camera)
    model = message.distortion_model.strip().lower()
    D = np.trim_zeros(D, "b")
    if model in _FISHEYES and len(D) <= 4:
        return Lens(camera, tuple(float(x) for x in D), fisheye=True)
    if len(D) and (model not in _PINHOLES or len(D) > max(_PINHOLES[model]) or not np.isfinite(D).all()):
        found = f"{message.distortion_model!r} of {len(D)} numbers"
        models = ", ".join(name for name in (*_PINHOLES, *_FISHEYES) if name)
        raise InputError(f"{where}: expected distortion model {models}, found {found}")
    return Lens(camera, tuple(float(x) for x in D))


def decode_pose(where: str, message: Any) -> NDArray:
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


def _pixels(where: str, message: Any, dtype: np.dtype, channels: int, *, rows: int | None = None) -> NDArray:
    """Return [H, W, channels]; rows may be padded."""
    count: int = message.height if rows is None else rows
    dtype = dtype.newbyteorder(">" if message.is_bigendian else "<")
    width = message.width * channels * dtype.itemsize
    data = np.frombuffer(bytes(message.data), np.uint8)
    check_picture(where, message.width, message.height)
    if message.step < width or data.size < message.step * count:
        expected = f"{message.width}x{message.height} {message.encoding}"
        raise InputError(f"{where}: expected {expected}, found {data.size} bytes in rows of {message.step}")
    found = data[: message.step * count].reshape(count, message.step)[:, :width]
    return np.ascontiguousarray(found).view(dtype).reshape(count, message.width, channels)


@dataclass(eq=False)
class Link:
    """The pose of one frame in its parent frame over time."""

    parent: str
    fixed: bool
    times_s: list[float] = field(default_factory=list)
    poses: list[NDArray] = field(default_factory=list)

    def interval_s(self) -> float:
        """Return the usual time between its messages; infinite for a single one."""
        times = np.unique(self.times_s)
        return float(np.median(np.diff(times))) if len(times) > 1 else np.inf

    def still(self) -> bool:
        """Return whether it never changed: static, or said again and again on /tf, as ROS 1 does."""
        return self.fixed or (len(self.poses) > 1 and float(np.ptp(np.stack(self.poses), axis=0).max()) < 1e-6)

    def at(self, times_s: NDArray, *, max_gap_s: float = MAX_GAP_S) -> tuple[NDArray, NDArray]:
        """Return T_parent_child [n, 4, 4] and where it is known, bool [n]."""
        if self.still():
            return np.repeat(self.poses[-1][None], len(times_s), axis=0), np.ones(len(times_s), dtype=bool)
        times, first = np.unique(self.times_s, return_index=True)
        poses = np.stack([self.poses[i] for i in first])
        beyond_s = max_gap_s / 10 if max_gap_s == MAX_GAP_S else max_gap_s
        return interpolate_poses(times, poses, times_s, max_gap_s=max_gap_s, beyond_s=beyond_s)


class Transforms:
    """The tree of frames, as /tf and /tf_static build it up."""

    def __init__(self) -> None:
        self.links: dict[str, Link] = {}

    def add(self, parent: str, child: str, time_s: float, T_parent_child: NDArray, *, fixed: bool) -> None:
        """Add the transforms of a message; a frame keeps its first parent."""
        child, parent = child.lstrip("/"), parent.lstrip("/")
        link = self.links.setdefault(child, Link(parent, fixed))
        if link.parent == parent:
            link.times_s.append(time_s)
            link.poses.append(T_parent_child)

    def chain(self, frame: str) -> list[str]:
        """Return the frames from this one up to the world's, both included.

        Raises:
            InputError: The frames go round in a circle.
        """
        found = [frame.lstrip("/")]
        while found[-1] in self.links:
            parent = self.links[found[-1]].parent
            if parent in found:
                raise InputError(f"transforms: expected a tree, found a circle at frame {parent!r}")
            found.append(parent)
        return found

    def moves(self, frame: str) -> bool:
        """Return whether a frame moves in its world."""
        return any(not self.links[name].still() for name in self.chain(frame)[:-1])

    def between(self, target: str, source: str) -> NDArray | None:
        """Return T_target_source [4, 4] of two frames fixed to each other, or None when they are not, or not known."""
        up, down = self.chain(source), self.chain(target)
        shared = next((name for name in up if name in down), None)
        if shared is None:
            return None
        T = np.eye(4)
        for names, invert in ((up[: up.index(shared)], False), (down[: down.index(shared)], True)):
            if not all(self.links[name].still() for name in names):
                return None
            T_shared, _ = self.compose(names, np.zeros(1))
            T = np.linalg.inv(T_shared[0]) @ T if invert else T_shared[0]
        return T

    def poses(self, frame: str, times_s: NDArray) -> tuple[NDArray, NDArray]:
        """Return T_world_frame [n, 4, 4] and where it is known, bool [n]."""
        return self.compose(self.chain(frame)[:-1], times_s)

    def compose(self, frames: Iterable[str], times_s: NDArray) -> tuple[NDArray, NDArray]:
        """Multiply the links of frames, innermost first.

        Where one link comes much less often than another, it corrects that one's drift (map to odom), and holds for
        longer.
        """
        links = [self.links[name] for name in frames]
        fastest_s = min((link.interval_s() for link in links if not link.still()), default=np.inf)
        T, known = np.repeat(np.eye(4)[None], len(times_s), axis=0), np.ones(len(times_s), dtype=bool)
        for link in links:
            rare = link.interval_s() > max(RARE * fastest_s, MAX_GAP_S / 2)
            T_parent_child, here = link.at(times_s, max_gap_s=MAX_CORRECTION_GAP_S if rare else MAX_GAP_S)
            T, known = T_parent_child @ T, known & here
        return T, known
