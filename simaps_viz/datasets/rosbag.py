"""Read recordings of robots: ROS 1 bags, ROS 2 bags (SQLite or MCAP) and ROS 2 MCAP files.

Topics are chosen by what they hold: the depth images registered to colour if there are such, the colour images of the
same camera, their CameraInfo, and poses from tf, or else from an Odometry or PoseStamped topic. Where there are no
depth images, a LiDAR's clouds (PointCloud2) take their place.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import associate
from simaps_viz.datasets.calibration import Lens, see_through
from simaps_viz.datasets.clouds import CloudSettings, camera_points, depth_of_cloud, gravity_of_clouds
from simaps_viz.datasets.file_frames import check_size
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, complete, left_out
from simaps_viz.datasets.ros_messages import (
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    DEPTH_UNIT_M,
    IMAGE,
    POSE_TYPES,
    TF_TYPES,
    Link,
    Transforms,
    decode_color,
    decode_depth,
    decode_lens,
    decode_points,
    decode_pose,
    is_depth,
    raw_stamp_ns,
    stamp_ns,
)
from simaps_viz.errors import InputError, one_line
from simaps_viz.geometry import invert_pose, spread

CLOUD_TOLERANCE_S = 0.05
"""A cloud takes the picture nearest to it, within this: half a turn of a LiDAR that turns ten times a second."""
_SAMPLED_FOR_FLOOR = 40

FACTS = FormatFacts(
    title="ROS bag",
    recognised_by="`*.bag` (ROS 1), a folder with `metadata.yaml` (ROS 2), `*.db3`, `*.mcap` (ROS 2 profile)",
    depth="Image or CompressedImage, 16UC1 or 32FC1; PointCloud2",
    depth_unit_m=DEPTH_UNIT_M,
    invalid="0, NaN, infinity",
    pose="tf to the camera's optical frame; or Odometry, PoseStamped",
    up=(0.0, 0.0, 1.0),
)

COLOR_TOLERANCE_S = 0.02


class RosbagReader(Reader):
    """The reader of ROS bag recordings."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder or file is in this format, from names alone."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.suffix in (".bag", ".mcap", ".db3") and path.is_file()

    def open(self, path: Path) -> Recording:
        """Open a recording: it is read through once for the times of its pictures and for all poses.

        Raises:
            InputError: It is damaged, or lacks depth, colour, a camera or poses that belong together.
        """
        bag = Bag(path)
        with complete(path, FACTS.title):
            return _open(path, bag)


def _open(path: Path, bag: "Bag") -> Recording:
    """Pair depth images, or clouds where there are none, with colour images, and find the pose of each pair."""
    of_clouds = bool(bag.of_type(CLOUD)) and not any(is_depth(bag.first(t)) for t in bag.of_type(IMAGE, COMPRESSED))
    what, tolerance_s = ("clouds", CLOUD_TOLERANCE_S) if of_clouds else ("depth images", COLOR_TOLERANCE_S)
    source, color = _cloud_topics(bag) if of_clouds else _image_topics(bag)
    lens = lens_of(bag, color if of_clouds else source)
    color_lens, target = lens if of_clouds else lens_of(bag, color, otherwise=lens), lens.intrinsics
    index = bag.index((source, color))
    times, color_times = (np.array([e.stamp_ns for e in index[t]]) for t in (source, color))
    if not len(times) or not len(color_times):
        raise InputError(f"{path}: expected pictures on {source} and {color}, found none on one of them")
    pairs = associate(*((t - times[0]) / 1e9 for t in (times, color_times)), tolerance_s=tolerance_s)
    # A cloud and its picture are of different times, so each has its own pose; depth is registered to colour.
    frame = bag.first(source).header.frame_id
    wanted = [(frame, times[pairs[:, 0]])]
    if of_clouds:
        wanted.insert(0, (bag.first(color).header.frame_id, color_times[pairs[:, 1]]))
    found = poses_of(bag, wanted)
    known = np.logical_and.reduce([here for _, here in found])
    if not known.any():
        raise InputError(
            f"{path}: expected {what}, colour and poses of about the same time, found none among {len(times)} {what} "
            f"({source}) and {len(color_times)} colour images ({color})"
        )
    pairs, T_world_camera, T_world_source = pairs[known], found[0][0][known], found[-1][0][known]

    def read_depth(i: int) -> NDArray:
        with complete(path, FACTS.title):
            image = decode_depth(f"{path}: {source}", bag.read(source, index[source][pairs[i, 0]]))
        check_size(f"{path}: {source}", image, target)
        return see_through(image, lens, target, exact=True)

    def read_cloud(i: int) -> NDArray:
        with complete(path, FACTS.title):
            stored = decode_points(f"{path}: {source}", bag.read(source, index[source][pairs[i, 0]]))
        return camera_points(stored, invert_pose(T_world_camera[i]) @ T_world_source[i])

    def read_color(i: int) -> NDArray:
        with complete(path, FACTS.title):
            image = decode_color(f"{path}: {color}", bag.read(color, index[color][pairs[i, 1]]))
        return see_through(image, color_lens.scaled(image.shape[1], image.shape[0]), target, exact=False)

    floor_height_m = None
    if of_clouds:
        sampled = [(read_cloud(i), T_world_camera[i]) for i in spread(len(pairs), _SAMPLED_FOR_FLOOR)]
        _, floor_height_m = gravity_of_clouds(path, sampled, target, FACTS.up)
    return Recording(
        facts=FACTS,
        path=path,
        name=path.resolve().stem,
        frame_names=tuple(time_name(int(times[i])) for i in pairs[:, 0]),
        poses=T_world_camera,
        intrinsics=target,
        depth=(lambda i: depth_of_cloud(read_cloud(i), target, CloudSettings())) if of_clouds else read_depth,
        color=read_color,
        floor_height_m=floor_height_m,
        notes=left_out(len(times) - len(pairs), len(times), f"{what} have no colour or pose of their time"),
    )


def time_name(stamp_ns: int) -> str:
    """Return a frame's name: its time, seconds."""
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}"


@dataclass(frozen=True)
class Entry:
    """Position of a message in its file."""

    logged_ns: int
    stamp_ns: int


class Bag:
    """An open bag; reading is one thread at a time, decoding is not."""

    def __init__(self, path: Path) -> None:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 - only robots' recordings need it

        self.path, self._lock = path, threading.Lock()
        self._errors = (Exception,)  # rosbags, sqlite and the unpackers may raise anything on damaged bags
        self._reader = None
        try:
            self._reader = AnyReader([path])
            self._reader.open()
            self.topics = self._reader.topics
        except self._errors as error:
            self._reader = None
            raise InputError(f"{path}: expected a ROS bag, found {one_line(error)}") from error

    def __del__(self) -> None:
        reader = getattr(self, "_reader", None)
        if reader is not None:
            reader.close()

    def of_type(self, *types: str) -> list[str]:
        """Return the topics of these types that have messages, sorted."""
        return sorted(name for name, topic in self.topics.items() if topic.msgtype in types and topic.msgcount)

    def messages(self, topics: list[str]) -> Any:
        """Return (topic, time logged, bytes, type) of every message on these topics, in order."""
        assert self._reader is not None
        connections = [c for topic in topics for c in self.topics[topic].connections]
        try:
            for connection, logged_ns, data in self._reader.messages(connections) if connections else ():
                yield connection.topic, logged_ns, data, connection.msgtype
        except self._errors as error:
            raise InputError(f"{self.path}: expected a whole bag, found {one_line(error)}") from error

    def decoded(self, topics: list[str]) -> Any:
        """Return (topic, message) of every message on these topics."""
        for topic, _, data, msgtype in self.messages(topics):
            yield topic, self.decode(data, msgtype)

    def first(self, topic: str) -> Any:
        """Decode the first message of a topic."""
        for _, message in self.decoded([topic]):
            return message
        raise InputError(f"{self.path}: {topic}: expected a message, found none")

    def decode(self, data: bytes, msgtype: str) -> Any:
        """Decode a message."""
        assert self._reader is not None
        try:
            return self._reader.deserialize(data, msgtype)
        except self._errors as error:
            raise InputError(f"{self.path}: expected a whole {msgtype}, found {one_line(error)}") from error

    def index(self, topics: tuple[str, ...]) -> dict[str, list[Entry]]:
        """Return the positions of the messages of topics, ordered by the time in their headers."""
        assert self._reader is not None
        found: dict[str, list[Entry]] = {topic: [] for topic in topics}
        for topic, logged_ns, data, _ in self.messages(list(topics)):
            found[topic].append(Entry(logged_ns, raw_stamp_ns(data, ros2=self._reader.is2)))
        return {topic: sorted(entries, key=lambda e: e.stamp_ns) for topic, entries in found.items()}

    def read(self, topic: str, entry: Entry) -> Any:
        """Read and decode one message."""
        assert self._reader is not None
        connections = self.topics[topic].connections
        with self._lock:
            try:
                near = self._reader.messages(connections, start=entry.logged_ns, stop=entry.logged_ns + 1)
                found = [(data, c.msgtype) for c, _, data in near]
            except self._errors as error:
                raise InputError(f"{self.path}: expected a whole bag, found {one_line(error)}") from error
        for data, msgtype in found:
            if raw_stamp_ns(data, ros2=self._reader.is2) == entry.stamp_ns:
                return self.decode(data, msgtype)
        raise InputError(f"{self.path}: {topic}: expected the message of {entry.stamp_ns} ns, found it no more")


def _image_topics(bag: Bag) -> tuple[str, str]:
    """Choose depth images, registered to colour if there are such, and the colour images of the same camera."""
    found = {topic: bag.first(topic) for topic in bag.of_type(IMAGE, COMPRESSED)}
    depths = [topic for topic, message in found.items() if is_depth(message)]
    colors = [topic for topic in found if topic not in depths and not _has(topic, "infra", "confidence", "depth")]
    if not depths or not colors:
        what = "depth images (16UC1, 32FC1) or clouds (PointCloud2)" if not depths else "colour images"
        raise InputError(f"{bag.path}: expected a topic with {what}, found {', '.join(found) or 'no images'}")
    depth = min(depths, key=lambda t: (not _has(t, "aligned", "registered"), bag.topics[t].msgtype == COMPRESSED, t))
    return depth, min(colors, key=lambda t: (not _has(t, "color", "rgb"), -len(_shared(t, depth)), "raw" in t, t))


def _cloud_topics(bag: Bag) -> tuple[str, str]:
    """Choose the clouds with the most messages, and colour images."""
    clouds = max(bag.of_type(CLOUD), key=lambda topic: (bag.topics[topic].msgcount, topic))
    pictures = bag.of_type(IMAGE, COMPRESSED)
    if not pictures:
        raise InputError(f"{bag.path}: expected colour images beside the clouds ({clouds}), found none")
    named = [t for t in pictures if _has(t, "color", "rgb")] or pictures
    return clouds, min(named, key=lambda topic: ("raw" in topic, topic))


def lens_of(bag: Bag, topic: str, otherwise: Lens | None = None) -> Lens:
    """Read the CameraInfo that shares the most of the topic's name, and at least its first part."""
    infos = [info for info in bag.of_type(CAMERA_INFO) if _shared(info, topic)]
    if not infos and otherwise is not None:
        return otherwise
    if not infos:
        raise InputError(f"{bag.path}: expected a CameraInfo topic beside {topic}, found none")
    info = max(infos, key=lambda name: (len(_shared(name, topic)), -len(name)))
    return decode_lens(f"{bag.path}: {info}", bag.first(info), rectified=_has(topic, "rect", "aligned", "registered"))


def poses_of(bag: Bag, wanted: Sequence[tuple[str, NDArray]]) -> list[tuple[NDArray, NDArray]]:
    """Return for each (frame, times in ns) T_world_frame [n, 4, 4] at those times, and where it is known.

    The first frame is the camera's; what moves it decides where all poses come from.

    Raises:
        InputError: Nothing in the bag moves the camera, or a frame is in another world.
    """
    camera, first = wanted[0]
    start = int(first[0]) if len(first) else 0
    transforms = _transforms(bag, start)
    if transforms.moves(camera):
        roots = {transforms.chain(frame)[-1]: frame for frame, _ in wanted}
        if len(roots) > 1:
            frames = " and ".join(f"{frame!r} (in {root!r})" for root, frame in roots.items())
            raise InputError(f"{bag.path}: expected transforms (/tf) between all frames, found {frames} apart")
        return [transforms.poses(frame, (times_ns - start) / 1e9) for frame, times_ns in wanted]
    candidates = bag.of_type(*POSE_TYPES)
    if not candidates:
        raise InputError(
            f"{bag.path}: expected transforms (/tf) that move {camera!r}, or poses, found neither among "
            f"{len(bag.topics)} topics"
        )
    topic = min(candidates, key=lambda t: (not _has(t, "camera", "slam", "ground"), t))
    return [_from_poses(bag, topic, frame, transforms, start, (times - start) / 1e9) for frame, times in wanted]


def _transforms(bag: Bag, start_ns: int) -> Transforms:
    transforms = Transforms()
    topics = [t for t in bag.of_type(*TF_TYPES) if t.rpartition("/")[2] in ("tf", "tf_static")]  # of any namespace
    for topic, message in bag.decoded(topics):
        for entry in message.transforms:
            where = f"{bag.path}: {topic}: {entry.child_frame_id}"
            transforms.add(
                entry.header.frame_id, entry.child_frame_id, (stamp_ns(entry.header) - start_ns) / 1e9,
                decode_pose(where, entry.transform), fixed=topic.endswith("tf_static"),
            )  # fmt: skip
    return transforms


def _from_poses(
    bag: Bag, topic: str, frame: str, transforms: Transforms, start: int, times_s: NDArray
) -> tuple[NDArray, NDArray]:
    """Take poses of the robot's base (Odometry) through fixed links to the camera, or of the camera itself."""
    moving, child = Link("world", fixed=False), frame
    for _, message in bag.decoded([topic]):
        inner = getattr(message.pose, "pose", message.pose)
        if message.header.frame_id.lstrip("/") == frame.lstrip("/"):
            return np.repeat(np.eye(4)[None], len(times_s), axis=0), np.ones(len(times_s), dtype=bool)
        moving.times_s.append((stamp_ns(message.header) - start) / 1e9)
        moving.poses.append(decode_pose(f"{bag.path}: {topic}", inner))
        child = getattr(message, "child_frame_id", "") or frame
    T, known = moving.at(times_s)
    chain, child = transforms.chain(frame), child.lstrip("/")
    if child in chain:
        T_child_camera, fixed = transforms.compose(chain[: chain.index(child)], times_s)
        return T @ T_child_camera, known & fixed
    raise InputError(
        f"{bag.path}: {topic}: expected transforms from {child!r} to the camera {frame!r}, found {', '.join(chain)}"
    )


def _has(topic: str, *parts: str) -> bool:
    return any(part in topic.lower() for part in parts)


def _shared(a: str, b: str) -> list[str]:
    """Return the leading parts that two topics' names share."""
    parts = []
    for one, other in zip(a.strip("/").split("/"), b.strip("/").split("/"), strict=False):
        if one != other:
            break
        parts.append(one)
    return parts
