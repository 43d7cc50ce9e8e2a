"""Read recordings of robots: ROS 1 bags, ROS 2 bags (SQLite or MCAP), MCAP files of ROS and of Foxglove.

Topics are chosen by what they hold: the depth images registered to colour if there are such, the colour images of the
same camera, their CameraInfo, and poses from tf, or else from an Odometry or PoseStamped topic. Depth of another camera
than colour's is registered to it where transforms say how they are mounted. Where there are no depth images, a LiDAR's
clouds (PointCloud2) take their place.
"""

import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product, takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import associate, nearest
from simaps_viz.datasets.calibration import Lens, see_through
from simaps_viz.datasets.clouds import CloudSettings, camera_points, depth_of_cloud, gravity_of_clouds, register_depth
from simaps_viz.datasets.file_frames import check_size
from simaps_viz.datasets.gravity import estimate_gravity
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, complete, left_out
from simaps_viz.datasets.ros_messages import (
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    DEPTH_UNIT_M,
    IMAGE,
    MAX_GAP_S,
    POSE_TYPES,
    STAMPED,
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
from simaps_viz.io.limits import LFS_POINTER, is_lfs_pointer
from simaps_viz.structures import Frame, Intrinsics

CLOUD_TOLERANCE_S = 0.05
"""A cloud takes the picture nearest to it, within this: half a turn of a LiDAR that turns ten times a second."""
_SAMPLED_FOR_FLOOR, _SAMPLED_FOR_AXES = 40, 20
_REGISTERED = ("aligned", "registered", "depth_to_rgb", "depth_to_color")
"""In the names of topics whose depth is brought to the colour camera, whatever frame their headers name."""
_RECTIFIED, _INFRARED = re.compile(r"(^|_)rect(_|$)"), re.compile(r"[/_]ir([/_]|$)")
"""Parts of topics' names: image_rect_color, image_color_rect; ir/image_raw, image_ir."""
_TRANSPORTS = ("/compressed", "/compressedDepth", "/zstd")
"""What image_transport adds to the name of a topic."""
_SAME_PLACE = 0.002
"""Metres or radians that two cameras may be apart and still be one."""
_UPWARDS = 0.7
T_BODY_OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
"""A camera's axes (x right, y down, z forward) in its body's (x forward, y left, z up)."""

FACTS = FormatFacts(
    title="ROS bag",
    recognised_by="`*.bag` (ROS 1), a folder with `metadata.yaml` (ROS 2), `*.db3`, `*.mcap` (ROS 1 and 2, Foxglove)",
    depth="Image or CompressedImage, 16UC1 or 32FC1; PointCloud2",
    depth_unit_m=DEPTH_UNIT_M,
    invalid="0, NaN, infinity",
    pose="tf or TransformStamped to the camera's optical frame; or Odometry, PoseStamped",
    up=(0.0, 0.0, 1.0),
)

COLOR_TOLERANCE_S = 0.02


def _recognise(path: Path) -> bool:
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    return path.suffix in (".bag", ".mcap", ".db3") and path.is_file()


def _open_path(path: Path) -> Recording:
    """Open a recording: it is read through once for the times of its pictures and for all poses.

    Raises:
        InputError: It is damaged, or lacks depth, colour, a camera or poses that belong together.
    """
    bag = Bag(path)
    with complete(path, FACTS.title):
        return _open(path, bag)


READER = Reader(FACTS, _recognise, _open_path)


@dataclass(frozen=True, eq=False)
class _Source:
    """Depth images or clouds of one topic, the colour images beside them, and how both become frames."""

    topic: str
    color: str
    of_clouds: bool
    frame: str
    """The frame that depth or points are in."""
    camera: str
    """The frame of the camera that frames are shown by."""
    lens: Lens
    """Camera of the depth images; of clouds, colour's."""
    color_lens: Lens
    target: Intrinsics
    T_camera_source: NDArray | None
    """Where depth has to be registered: from the depth camera to colour's; None = it is there already."""
    notes: tuple[str, ...]

    @property
    def what(self) -> str:
        """What it holds, in words."""
        return "clouds" if self.of_clouds else "depth images"


def _open(path: Path, bag: "Bag") -> Recording:
    """Pair depth images, or clouds where there are none, with colour images, and find the pose of each pair."""
    of_clouds = bool(bag.of_type(CLOUD)) and not any(is_depth(bag.first(t)) for t in bag.of_type(IMAGE, COMPRESSED))
    topics = _cloud_topics(bag) if of_clouds else _image_topics(bag)
    index = bag.index(topics)
    times, color_times = (np.array([e.stamp_ns for e in index[t]]) for t in topics)
    if not len(times) or not len(color_times):
        raise InputError(f"{path}: expected pictures on {topics[0]} and {topics[1]}, found none on one of them")
    transforms = _transforms(bag, start := int(times[0]))
    use = _cloud_source(bag, *topics) if of_clouds else _image_source(bag, *topics, transforms)
    source, color, target = use.topic, use.color, use.target
    stamped = () if transforms.moves(use.camera) else _add_stamped(bag, transforms, start, use.camera)

    # Each depth image takes the colour nearest to it, and the pose of its own time. A cloud and its picture may be of
    # different times, so each has its own pose.
    tolerance_s = CLOUD_TOLERANCE_S if of_clouds else COLOR_TOLERANCE_S
    pairs = associate(*((t - start) / 1e9 for t in (times, color_times)), tolerance_s=tolerance_s)
    late = _lateness(np.delete(times, pairs[:, 0]), color_times, tolerance_s)
    wanted = [(use.camera, color_times[pairs[:, 1]] if of_clouds else times[pairs[:, 0]])]
    topic = pose_topic(bag, transforms, use.camera)
    # What says where the camera itself is may have the first camera's axes for the world's, as visual SLAM does.
    level = topic is None or bag.topics[topic].msgtype == POSE_TYPES[0]
    found = poses_of(bag, transforms, topic, start, [*wanted, (use.frame, times[pairs[:, 0]])] if of_clouds else wanted)
    known = np.logical_and.reduce([here for _, here in found])
    if not known.any():
        poses = late if not len(pairs) else f"transforms are silent for longer than {MAX_GAP_S:g} s at their times"
        raise InputError(
            f"{path}: expected {use.what}, colour and poses of about the same time, found none among {len(times)} "
            f"{use.what} ({source}) and {len(color_times)} colour images ({color}): {poses}"
        )
    notes = (
        *bag.notes,
        *use.notes,
        *stamped,
        *left_out(len(times) - len(pairs), len(times), f"{use.what} have no colour of their time ({late})"),
        *left_out(int((~known).sum()), len(times), f"{use.what} have no pose of their time"),
    )
    pairs, T_world_camera, T_world_source = pairs[known], found[0][0][known], found[-1][0][known]

    def read_depth(i: int) -> NDArray:
        with complete(path, FACTS.title):
            image = decode_depth(f"{path}: {source}", bag.read(source, index[source][pairs[i, 0]]))
        check_size(f"{path}: {source}", image, use.lens.intrinsics)
        if use.T_camera_source is None:
            return see_through(image, use.lens, target, exact=True)
        return register_depth(image, use.lens, use.T_camera_source, target)

    def read_cloud(i: int) -> NDArray:
        with complete(path, FACTS.title):
            stored = decode_points(f"{path}: {source}", bag.read(source, index[source][pairs[i, 0]]))
        return camera_points(stored, invert_pose(T_world_camera[i]) @ T_world_source[i])

    def read_color(i: int) -> NDArray:
        with complete(path, FACTS.title):
            image = decode_color(f"{path}: {color}", bag.read(color, index[color][pairs[i, 1]]))
        return see_through(image, use.color_lens.scaled(image.shape[1], image.shape[0]), target, exact=False)

    floor_height_m = None
    if of_clouds:
        sampled = [(read_cloud(i), T_world_camera[i]) for i in spread(len(pairs), _SAMPLED_FOR_FLOOR)]
        found = gravity_of_clouds(sampled, target, FACTS.up)
        floor_height_m, notes = found.floor_height_m, (*notes, *filter(None, [found.floor_note]))
    elif level and has_body_axes(use.camera, T_world_camera, target, read_depth):
        T_world_camera = T_world_camera @ T_BODY_OPTICAL
        notes = (*notes, f"frame {use.camera!r} has a body's axes (x forward, z up), not a camera's: turned")
    return Recording(
        facts=FACTS if level or of_clouds else replace(FACTS, up=None),
        path=path,
        name=path.resolve().stem,
        frame_names=tuple(time_name(int(times[i])) for i in pairs[:, 0]),
        poses=T_world_camera,
        intrinsics=target,
        depth=(lambda i: depth_of_cloud(read_cloud(i), target, CloudSettings())) if of_clouds else read_depth,
        color=read_color,
        floor_height_m=floor_height_m,
        notes=notes,
    )


def _cloud_source(bag: "Bag", clouds: str, color: str) -> _Source:
    lens = lens_of(bag, color)
    frame, camera = (bag.first(topic).header.frame_id.lstrip("/") for topic in (clouds, color))
    return _Source(clouds, color, True, frame, camera, lens, lens, lens.intrinsics, None, ())


def _image_source(bag: "Bag", depth: str, color: str, transforms: Transforms) -> _Source:
    """Find the cameras of depth and colour, and whether one has to be brought to the other."""
    lens, others = lens_of(bag, depth), _other_cameras(bag, depth, color)
    color_lens = lens_of(bag, color, otherwise=lens)
    frame, camera = (bag.first(topic).header.frame_id.lstrip("/") for topic in (depth, color))
    registered = frame == camera or not camera or _has(depth, *_REGISTERED)
    for topic, other in () if registered or not frame else ((depth, color), (color, depth)):
        _check_own_info(bag, topic, other)
    T = None if registered else transforms.between(camera, frame)
    if T is not None and np.abs(T - np.eye(4)).max() > _SAME_PLACE:
        share = min(1.0, lens.intrinsics.fx / color_lens.intrinsics.fx)  # no finer than depth is, or it has gaps
        k = color_lens.intrinsics
        target = color_lens.scaled(max(round(k.width * share), 1), max(round(k.height * share), 1)).intrinsics
        note = f"depth ({depth}) is registered to colour ({color}) by the transforms between {frame!r} and {camera!r}"
        return _Source(depth, color, False, frame, camera, lens, color_lens, target, T, (note, *others))
    apart = f"no transforms between {frame!r} ({depth}) and {camera!r} ({color}): taken as one camera's"
    notes = others if registered or T is not None else (apart, *others)
    return _Source(depth, color, False, frame, frame, lens, color_lens, lens.intrinsics, None, notes)


def has_body_axes(frame: str, T_world_camera: NDArray, k: Intrinsics, read_depth: Callable[[int], NDArray]) -> bool:
    """Return whether the pictures' frame is a body's (x forward, z up: REP 103), as simulators and old drivers have it.

    Its name lacks "optical", as some cameras' frames do; taken for a camera's it would look at the sky all the time,
    and the floor seen in depth lies level only after the turn.
    """
    if "optical" in frame or np.median(T_world_camera[:, 2, 2]) < _UPWARDS:
        return False
    chosen = spread(len(T_world_camera), _SAMPLED_FOR_AXES)
    depths = [read_depth(i) for i in chosen]
    tilts = []
    for turn in (np.eye(4), T_BODY_OPTICAL):
        try:
            frames = [Frame(i, str(i), d, T_world_camera[i] @ turn, k) for i, d in zip(chosen, depths, strict=True)]
            tilts.append(float(estimate_gravity(frames)[0][2]))
        except InputError:
            tilts.append(-1.0)
    return tilts[1] > _UPWARDS and tilts[1] > tilts[0]


def _lateness(times: NDArray, color_times: NDArray, tolerance_s: float) -> str:
    """Return in words how far away the nearest colour of each of these times is, and what is allowed."""
    if not len(times):
        return ""
    off_ms = np.abs(color_times[nearest(color_times, times)] - times) / 1e6
    return f"the nearest is {off_ms.min():.0f} to {off_ms.max():.0f} ms away, {tolerance_s * 1000:.0f} ms are allowed"


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
        self._first: dict[str, Any] = {}
        self._errors = (Exception,)  # rosbags, sqlite and the unpackers may raise anything on damaged bags
        self.notes: tuple[str, ...] = ()
        self._reader: Any = None
        try:
            self._reader = AnyReader([path])
            self._reader.open()
            self.topics: dict[str, Any] = self._reader.topics
        except self._errors as error:
            self._reader = None
            found = LFS_POINTER if any(map(is_lfs_pointer, path.glob("*"))) else one_line(error)
            if path.suffix == ".mcap":  # of ROS 1, of Foxglove's messages, or unfinished
                found = self._open_mcap() or found
            if self._reader is None:
                raise InputError(f"{path}: expected a ROS bag, found {found}") from error

    def _open_mcap(self) -> str:
        """Open an MCAP file that rosbags does not read; return what is wrong with it, "" where its error says so."""
        from simaps_viz.datasets.mcap import McapReader  # noqa: PLC0415 - as above

        try:
            reader = McapReader(self.path)
        except self._errors as error:
            return one_line(error) if isinstance(error, MemoryError) else ""
        if not any(topic.msgcount for topic in reader.topics.values()):
            reader.close()
            return "no messages of ROS or of Foxglove's schemas"
        self._reader, self.topics = reader, reader.topics
        self.notes = () if reader.finished else ("the file has no end: it was cut short, and is read up to there",)
        return ""

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
        if topic in self._first:
            return self._first[topic]
        for _, message in self.decoded([topic]):
            return self._first.setdefault(topic, message)
        raise InputError(f"{self.path}: {topic}: expected a message, found none")

    def decode(self, data: bytes, msgtype: str) -> Any:
        """Decode a message."""
        assert self._reader is not None
        try:
            return self._reader.deserialize(data, msgtype)
        except self._errors as error:
            raise InputError(f"{self.path}: expected a whole {msgtype}, found {one_line(error)}") from error

    def _stamp_ns(self, data: bytes) -> int:
        if hasattr(self._reader, "stamp_ns"):
            return self._reader.stamp_ns(data)
        return raw_stamp_ns(data, ros2=self._reader.is2)

    def index(self, topics: tuple[str, ...]) -> dict[str, list[Entry]]:
        """Return the positions of the messages of topics, ordered by the time in their headers."""
        assert self._reader is not None
        found: dict[str, list[Entry]] = {topic: [] for topic in topics}
        for topic, logged_ns, data, _ in self.messages(list(topics)):
            found[topic].append(Entry(logged_ns, self._stamp_ns(data)))
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
            if self._stamp_ns(data) == entry.stamp_ns:
                return self.decode(data, msgtype)
        raise InputError(f"{self.path}: {topic}: expected the message of {entry.stamp_ns} ns, found it no more")


def _image_topics(bag: Bag, depth: str | None = None) -> tuple[str, str]:
    """Choose depth images, registered to colour if there are such, and the colour images of the same camera.

    Args:
        bag: where they are.
        depth: the depth images, where they are chosen already.
    """
    found = {topic: bag.first(topic) for topic in bag.of_type(IMAGE, COMPRESSED)}
    usable = [topic for topic in found if not _no_picture(topic)]
    depths = [topic for topic in usable if is_depth(found[topic])]
    colors = [topic for topic in usable if topic not in depths and not _has(topic.replace("rgb_to_depth", ""), "depth")]
    if not depths or not colors:
        what = "depth images (16UC1, 32FC1) or clouds (PointCloud2)" if not depths else "colour images"
        raise InputError(f"{bag.path}: expected a topic with {what}, found {', '.join(found) or 'no images'}")

    def order(pair: tuple[str, str]) -> tuple:
        depth, color = pair
        apart = found[depth].header.frame_id != found[color].header.frame_id
        packed = bag.topics[depth].msgtype == COMPRESSED
        chosen = (not _has(color, "color", "rgb"), -len(_shared(color, depth)), "raw" in color, color)
        return (not _has(depth, *_REGISTERED), apart, packed, depth, *chosen)

    return min(product([depth] if depth else depths, colors), key=order)


def _other_cameras(bag: Bag, depth: str, color: str) -> tuple[str, ...]:
    """Return a note of depth images whose own colour images are in another frame than the chosen ones, or nothing."""
    frame = bag.first(color).header.frame_id
    others = [
        topic
        for topic in bag.of_type(IMAGE, COMPRESSED)
        if topic != depth and is_depth(bag.first(topic)) and not _no_picture(topic)
        and bag.first(_image_topics(bag, topic)[1]).header.frame_id != frame
    ]  # fmt: skip
    return (f"depth of one camera ({depth}) is read, not that of others ({', '.join(others)})",) if others else ()


def _cloud_topics(bag: Bag) -> tuple[str, str]:
    """Choose the clouds with the most messages, and colour images."""
    clouds = max(bag.of_type(CLOUD), key=lambda topic: (bag.topics[topic].msgcount, topic))
    pictures = bag.of_type(IMAGE, COMPRESSED)
    if not pictures:
        raise InputError(f"{bag.path}: expected colour images beside the clouds ({clouds}), found none")
    named = [t for t in pictures if _has(t, "color", "rgb")] or pictures
    return clouds, min(named, key=lambda topic: ("raw" in topic, topic))


def lens_of(bag: Bag, topic: str, otherwise: Lens | None = None) -> Lens:
    """Read the CameraInfo of a topic: its own, of the same name but for the last part, or the nearest one.

    The nearest shares the most of the name; among several the one goes first that is of the pictures' frame and size.
    Only pictures whose topic is named as rectified (``image_rect``) are, where the CameraInfo has their camera.
    """
    message = bag.first(topic)
    frame, size = message.header.frame_id, (getattr(message, "width", None), getattr(message, "height", None))
    named = bag.of_type(CAMERA_INFO)
    infos = [info for info in named if _shared(info, topic) or bag.first(info).header.frame_id == frame]
    if not infos and otherwise is not None:
        return otherwise
    if not infos:
        raise InputError(f"{bag.path}: expected a CameraInfo topic beside {topic}, found none")

    def order(name: str) -> tuple:
        info = bag.first(name)
        fits = info.header.frame_id == frame, size == (info.width, info.height)
        return _beside(name, topic), *fits, len(_shared(name, topic)), -len(name)

    info = max(infos, key=order)
    rectified = any(_RECTIFIED.search(part) for part in topic.split("/"))
    return decode_lens(f"{bag.path}: {info}", bag.first(info), rectified=rectified)


def _check_own_info(bag: Bag, topic: str, other: str) -> None:
    """Raise InputError where no CameraInfo is of these pictures, and so the one of the other camera would be taken."""
    frame = bag.first(topic).header.frame_id
    infos = bag.of_type(CAMERA_INFO)
    if any(_beside(info, topic) or bag.first(info).header.frame_id == frame for info in infos):
        return
    image = topic.rpartition("/")[0] if topic.endswith(_TRANSPORTS) else topic
    raise InputError(
        f"{bag.path}: expected {image.rpartition('/')[0]}/camera_info, as {topic} is in another frame ({frame!r}) than "
        f"{other}, found {', '.join(infos) or 'no CameraInfo'}"
    )


def pose_topic(bag: Bag, transforms: Transforms, camera: str) -> str | None:
    """Return the topic that says where a camera is, or None where /tf moves it.

    Raises:
        InputError: Nothing in the bag moves it.
    """
    if transforms.moves(camera):
        return None
    candidates = bag.of_type(*POSE_TYPES)
    if candidates:
        return min(candidates, key=lambda t: (not _has(t, "camera", "slam", "ground"), t))
    if any(not transforms.links[name].fixed for name in transforms.chain(camera)[:-1]):
        return None  # a robot that stood still
    moved = sorted(name for name, link in transforms.links.items() if not link.still())
    fixed = any(topic.endswith("tf_static") for topic in bag.of_type(*TF_TYPES))
    hint = "it has no poses at all, and a SLAM program (as RTAB-Map) has to add them"
    if moved:
        hint = f"/tf moves {', '.join(map(repr, moved[:8]))}, but no transform leads from there to the camera"
        hint += "" if fixed else " (there is no /tf_static)"
    raise InputError(
        f"{bag.path}: expected transforms (/tf) that move {camera!r}, or poses, found neither among {len(bag.topics)} "
        f"topics: {hint}"
    )


def poses_of(
    bag: Bag, transforms: Transforms, topic: str | None, start: int, wanted: Sequence[tuple[str, NDArray]]
) -> list[tuple[NDArray, NDArray]]:
    """Return for each (frame, times in ns) T_world_frame [n, 4, 4] at those times, and where it is known.

    Args:
        bag: where poses are.
        transforms: its /tf.
        topic: the topic that poses come from; None = /tf.
        start: the time (ns) that those of the transforms count from.
        wanted: frames and times.

    Raises:
        InputError: A frame is in another world.
    """
    if topic is not None:
        return [_from_poses(bag, topic, frame, transforms, start, (times - start) / 1e9) for frame, times in wanted]
    roots = {transforms.chain(frame)[-1]: frame for frame, _ in wanted}
    if len(roots) > 1:
        frames = " and ".join(f"{frame!r} (in {root!r})" for root, frame in roots.items())
        raise InputError(f"{bag.path}: expected transforms (/tf) between all frames, found {frames} apart")
    return [transforms.poses(frame, (times_ns - start) / 1e9) for frame, times_ns in wanted]


def _transforms(bag: Bag, start_ns: int) -> Transforms:
    transforms = Transforms()
    named = bag.of_type(*TF_TYPES)
    topics = [t for t in named if t.rpartition("/")[2] in ("tf", "tf_static")] or named  # of any namespace
    _add_transforms(bag, topics, transforms, start_ns)
    return transforms


def _add_transforms(bag: Bag, topics: list[str], transforms: Transforms, start_ns: int) -> None:
    for topic, message in bag.decoded(topics):
        for entry in getattr(message, "transforms", [message]):
            where = f"{bag.path}: {topic}: {entry.child_frame_id}"
            transforms.add(
                entry.header.frame_id, entry.child_frame_id, (stamp_ns(entry.header) - start_ns) / 1e9,
                decode_pose(where, entry.transform), fixed=topic.endswith("tf_static"),
            )  # fmt: skip
    if not any(topic.endswith("tf_static") for topic in topics):  # Foxglove has no other way to say what is fixed
        for link in transforms.links.values():
            link.fixed = link.fixed or len(link.poses) == 1


def _add_stamped(bag: Bag, transforms: Transforms, start_ns: int, camera: str) -> tuple[str, ...]:
    """Add transforms on topics of their own, as motion capture says them; return a note where they move the camera."""
    topics = bag.of_type(STAMPED)
    _add_transforms(bag, topics, transforms, start_ns)
    note = f"no /tf moves the camera: poses are of {', '.join(topics)} (TransformStamped)"
    return (note,) if transforms.moves(camera) else ()


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


def _no_picture(topic: str) -> bool:
    """Return whether images are infrared or confidence, by their topic's name."""
    return _has(topic, "infra", "confidence") or bool(_INFRARED.search(topic))


def _beside(info: str, topic: str) -> bool:
    """Return whether a CameraInfo lies in the folder of a topic, or in one above it."""
    return topic.startswith(info.rpartition("/")[0] + "/")


def _has(topic: str, *parts: str) -> bool:
    return any(part in topic.lower() for part in parts)


def _shared(a: str, b: str) -> list[str]:
    """Return the leading parts that two topics' names share."""
    pairs = zip(a.strip("/").split("/"), b.strip("/").split("/"), strict=False)
    return [part for part, _ in takewhile(lambda pair: pair[0] == pair[1], pairs)]
