"""Read MCAP files that rosbags does not: of ROS 1, of Foxglove's own messages (protobuf, JSON), and unfinished ones.

A file is read through once for where its messages are; chunks are unpacked again when a message is wanted. Foxglove's
messages become ROS's, which have the same contents under other names.
"""

import base64
import json
import re
import struct
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np
from rosbags.rosbag2.storage_mcap import decompress
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from simaps_viz.datasets.images import PNG_START
from simaps_viz.datasets.ros_messages import CAMERA_INFO, COMPRESSED, IMAGE, TF_TYPES, raw_stamp_ns
from simaps_viz.io.limits import MAX_MEMBER_BYTES

MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_CHUNKS_KEPT = 4
ROS_TYPES = {
    "foxglove.RawImage": IMAGE, "foxglove.CompressedImage": COMPRESSED, "foxglove.CameraCalibration": CAMERA_INFO,
    "foxglove.FrameTransform": TF_TYPES[0], "foxglove.FrameTransforms": TF_TYPES[0],
    "foxglove.PoseInFrame": "geometry_msgs/msg/PoseStamped",
}  # fmt: skip
_XYZ = {1: ("x", "f8"), 2: ("y", "f8"), 3: ("z", "f8")}
_TIME = {1: ("sec", "int"), 2: ("nsec", "int")}
_POSE: dict[int, tuple[str, Any]] = {1: ("position", _XYZ), 2: ("orientation", _XYZ | {4: ("w", "f8")})}
_MOVED: dict[int, tuple[str, Any]] = {
    1: ("timestamp", _TIME), 2: ("parent_frame_id", "str"), 3: ("child_frame_id", "str"), 4: ("translation", _XYZ),
    5: ("rotation", _XYZ | {4: ("w", "f8")}),
}  # fmt: skip
FIELDS: dict[str, dict[int, tuple[str, Any]]] = {
    "foxglove.RawImage": {1: ("timestamp", _TIME), 2: ("width", "u4"), 3: ("height", "u4"), 4: ("encoding", "str"),
                          5: ("step", "u4"), 6: ("data", "bytes"), 7: ("frame_id", "str")},
    "foxglove.CompressedImage": {1: ("timestamp", _TIME), 2: ("data", "bytes"), 3: ("format", "str"),
                                 4: ("frame_id", "str")},
    "foxglove.CameraCalibration": {1: ("timestamp", _TIME), 2: ("width", "u4"), 3: ("height", "u4"),
                                   4: ("distortion_model", "str"), 5: ("D", "list"), 6: ("K", "list"),
                                   7: ("R", "list"), 8: ("P", "list"), 9: ("frame_id", "str")},
    "foxglove.FrameTransform": _MOVED,
    "foxglove.FrameTransforms": {1: ("transforms", [_MOVED])},
    "foxglove.PoseInFrame": {1: ("timestamp", _TIME), 2: ("frame_id", "str"), 3: ("pose", _POSE)},
}  # fmt: skip
"""Fields of Foxglove's protobuf messages by number: name and kind; a list of fields is a repeated message."""


@dataclass(frozen=True)
class Channel:
    """A topic of a file, as rosbags calls a connection."""

    topic: str
    msgtype: str
    """ROS's name of its messages."""
    schema: str
    """Its own name of them."""
    encoding: str
    """Of the messages: ros1, cdr, protobuf or json."""


class Data(bytes):
    """A message as it is stored, with its channel."""

    channel: Channel


@dataclass
class Topic:
    """The messages of a topic, as rosbags describes them."""

    msgtype: str
    connections: list[Channel] = field(default_factory=list)
    entries: list[tuple[int, int, int, int]] = field(default_factory=list)
    """Of each message: when it was logged (ns), where its chunk starts (-1: none), where it starts in it, its size."""

    @property
    def msgcount(self) -> int:
        """Number of messages."""
        return len(self.entries)


class McapReader:
    """An MCAP file, with the members of rosbags' reader that `Bag` uses.

    Raises:
        ValueError: It is no MCAP file, or its contents are not as they should be.
    """

    def __init__(self, path: Path) -> None:
        self.topics: dict[str, Topic] = {}
        self.finished = False
        """The file has its end; else what was written before it was cut is read."""
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._channels: dict[int, Channel] = {}
        self._stores: dict[tuple[str, str], Any] = {}
        self._file: BinaryIO = path.open("rb")
        self._size = path.stat().st_size
        self._chunk: Callable[[int], bytes] = lru_cache(maxsize=_CHUNKS_KEPT)(self._unpacked)
        try:
            if self._file.read(len(MAGIC)) != MAGIC:
                raise ValueError("a file that does not start as MCAP does")
            self._scan(self._file, -1, self._size)
        except BaseException:
            self._file.close()
            raise
        for topic in self.topics.values():
            topic.entries.sort()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def messages(self, connections: Collection[Channel], start: int = 0, stop: int = 1 << 63) -> Iterator[Any]:
        """Yield (channel, time logged, `Data`) of the messages of these channels, in order."""
        found = []
        for channel in connections:
            entries = self.topics[channel.topic].entries
            first, last = (bisect_left(entries, (time, -2)) for time in (start, stop))
            found += [(*entry, channel) for entry in entries[first:last]]
        for logged_ns, chunk, at, size, channel in sorted(found, key=lambda item: item[:3]):
            if chunk < 0:
                self._file.seek(at)
                data = Data(self._file.read(size))
            else:
                data = Data(self._chunk(chunk)[at : at + size])
            data.channel = channel
            yield channel, logged_ns, data

    def stamp_ns(self, data: Data) -> int:
        """Read the time of a message without decoding its picture, nanoseconds."""
        channel = data.channel
        if channel.encoding == "protobuf":
            stamp = _decoded(_first_field(data), _TIME)
            return int(stamp["sec"]) * 1_000_000_000 + int(stamp["nsec"])
        if channel.encoding == "json":
            found = re.search(rb'"timestamp"\s*:\s*\{([^{}]*)\}', data)
            stamp = json.loads(b"{" + found[1] + b"}") if found else {}
            return int(stamp["sec"]) * 1_000_000_000 + int(stamp.get("nsec", stamp.get("nanosec", 0)))
        return raw_stamp_ns(data, ros2=channel.encoding == "cdr")

    def deserialize(self, data: Data, msgtype: str) -> Any:
        """Decode a message."""
        channel = data.channel
        if channel.schema in FIELDS:
            if channel.encoding == "json":
                return _as_ros(channel.schema, json.loads(data))
            return _as_ros(channel.schema, _decoded(bytes(data), FIELDS[channel.schema]))
        store = self._stores[channel.schema, channel.encoding]
        if channel.encoding == "cdr":
            return store.deserialize_cdr(bytes(data), msgtype)
        return store.deserialize_ros1(bytes(data), msgtype)

    def _scan(self, file: BinaryIO, chunk: int, end: int) -> None:
        """Note where messages are; ``chunk`` says where the chunk starts that ``file`` was unpacked from."""
        while not self.finished and file.tell() + 9 <= end:
            at = file.tell()
            code, size = struct.unpack("<BQ", file.read(9))
            if at + 9 + size > end:
                return  # cut short
            if code in (_FOOTER, _DATA_END):
                self.finished = True
            elif code == _SCHEMA:
                body = BytesIO(file.read(size))
                (number,) = struct.unpack("<H", body.read(2))
                self._schemas[number] = (_text(body), _text(body), _text(body))
            elif code == _CHANNEL:
                self._add_channel(BytesIO(file.read(size)))
            elif code == _MESSAGE and size >= 22:
                number, _, logged_ns, _ = struct.unpack("<HIQQ", file.read(22))
                channel = self._channels.get(number)
                if channel is not None:
                    self.topics[channel.topic].entries.append((logged_ns, chunk, at + 31, size - 22))
            elif code == _CHUNK and chunk < 0:
                inside = self._unpacked(at)
                self._scan(BytesIO(inside), at, len(inside))
            file.seek(at + 9 + size)

    def _add_channel(self, body: BytesIO) -> None:
        number, schema = struct.unpack("<HH", body.read(4))
        topic, encoding = _text(body), _text(body)
        name, kind, text = self._schemas.get(schema, ("", "", ""))
        msgtype = ROS_TYPES.get(name, name)
        if name not in ROS_TYPES and encoding in ("ros1", "cdr") and kind in ("ros1msg", "ros2msg", "ros2idl"):
            package, _, plain = name.rpartition("/")
            msgtype = f"{package.partition('/')[0]}/msg/{plain}"
            if (name, encoding) not in self._stores:
                store = get_typestore(Stores.EMPTY)
                store.register(get_types_from_idl(text) if kind == "ros2idl" else get_types_from_msg(text, msgtype))
                self._stores[name, encoding] = store
        elif name not in ROS_TYPES or encoding not in ("protobuf", "json"):
            return  # of no use for a map
        channel = Channel(topic, msgtype, name, encoding)
        self._channels[number] = channel
        found = self.topics.setdefault(topic, Topic(msgtype))
        if channel not in found.connections:
            found.connections.append(channel)

    def _unpacked(self, at: int) -> bytes:
        """Unpack the chunk whose record starts there."""
        self._file.seek(at + 9 + 16)
        size, crc = struct.unpack("<QI", self._file.read(12))
        if size > MAX_MEMBER_BYTES:
            raise ValueError(f"a chunk of {size} bytes")
        how = _text(self._file)
        (packed,) = struct.unpack("<Q", self._file.read(8))
        return decompress(self._file.read(min(packed, self._size)), how, size, crc)


def _text(file: Any) -> str:
    (size,) = struct.unpack("<I", file.read(4))
    return file.read(min(size, MAX_MEMBER_BYTES)).decode("utf-8", errors="replace")


def _number(data: bytes, at: int) -> tuple[int, int]:
    """Return the whole number that starts there, seven bits a byte, and where it ends."""
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        at, shift, more = at + 1, shift + 7, data[at] > 127
        if not more or shift > 63:
            return value, at


def _wire(data: bytes) -> Iterator[tuple[int, Any]]:
    """Yield (number, value) of the fields of a protobuf message: whole numbers, or bytes."""
    at = 0
    while at < len(data):
        key, at = _number(data, at)
        kind = key & 7
        if kind == 0:
            value, at = _number(data, at)
        elif kind in (1, 2, 5):
            size, at = _number(data, at) if kind == 2 else ({1: 8, 5: 4}[kind], at)
            if at + size > len(data):
                raise ValueError("a message that is cut short")
            value, at = data[at : at + size], at + size
        else:
            raise ValueError("a field of another kind")
        yield key >> 3, value


def _first_field(data: bytes) -> bytes:
    return next((value for number, value in _wire(data) if number == 1), b"")


def _decoded(data: bytes, fields: dict[int, tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields of a protobuf message by name; what is not stored is 0 or empty."""
    empty = {"int": 0, "u4": 0, "f8": 0.0, "str": "", "bytes": b""}
    found: dict[str, Any] = {
        name: ([] if isinstance(kind, list) or kind == "list" else empty[kind] if isinstance(kind, str) else None)
        for name, kind in fields.values()
    }
    for number, value in _wire(data):
        if number not in fields:
            continue
        name, kind = fields[number]
        if isinstance(kind, dict):
            found[name] = _decoded(value, kind)
        elif isinstance(kind, list):
            found[name].append(_decoded(value, kind[0]))
        elif kind == "list":
            found[name].extend(np.frombuffer(value, "<f8").tolist())
        elif kind in ("u4", "f8"):
            found[name] = np.frombuffer(value, f"<{kind}")[0].item()
        else:
            found[name] = value.decode("utf-8", errors="replace") if kind == "str" else value
    for name, kind in fields.values():
        if isinstance(kind, dict) and found[name] is None:
            found[name] = _decoded(b"", kind)
    return found


def _as_ros(schema: str, found: dict[str, Any]) -> Any:
    """Return one of Foxglove's messages as ROS's."""
    kind = ROS_TYPES[schema]
    if kind == TF_TYPES[0]:
        moved = found["transforms"] if schema.endswith("s") else [found]
        return SimpleNamespace(__msgtype__=kind, transforms=[_transform(one) for one in moved])
    header = _header(found["timestamp"], found["frame_id"])
    if schema == "foxglove.PoseInFrame":
        pose = SimpleNamespace(**{key: SimpleNamespace(**value) for key, value in found["pose"].items()})
        return SimpleNamespace(__msgtype__=kind, header=header, pose=pose)
    rest = {key: value for key, value in found.items() if key not in ("timestamp", "frame_id")}
    if "data" in rest:
        data = rest["data"]
        rest["data"] = base64.b64decode(data) if isinstance(data, str) else data
    if schema == "foxglove.RawImage":
        rest["is_bigendian"] = 0
    if schema == "foxglove.CompressedImage" and rest["data"].startswith(PNG_START) and rest["data"][24:26] == b"\x10\0":
        rest["format"] = "16UC1; png compressed"  # one channel of 16 bits: depth
    return SimpleNamespace(__msgtype__=kind, header=header, **rest)


def _header(stamp: dict[str, Any], frame: str) -> Any:
    nanosec = int(stamp.get("nsec", stamp.get("nanosec", 0)))
    return SimpleNamespace(stamp=SimpleNamespace(sec=int(stamp["sec"]), nanosec=nanosec), frame_id=frame)


def _transform(found: dict[str, Any]) -> Any:
    parts = {key: SimpleNamespace(**found[key]) for key in ("translation", "rotation")}
    header = _header(found["timestamp"], found["parent_frame_id"])
    return SimpleNamespace(header=header, child_frame_id=found["child_frame_id"], transform=SimpleNamespace(**parts))
