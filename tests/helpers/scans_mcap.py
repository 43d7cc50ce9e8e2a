"""Writers of MCAP files as others write them: ROS 1's messages, and Foxglove's in protobuf and JSON."""

import base64
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import zstandard
from lz4 import frame as lz4
from rosbags.typesys import Stores
from scans import COLORS, FRAMES, INTERVAL_S, START_S, Z_UP, Sample, camera, look, map_pose, quaternion, steps
from scans import write_reference as reference_of
from scans_bags import T_BASE_CAMERA, Messages, entries

from simaps_viz.geometry import invert_pose

Message = tuple[float, str, str, str, str, bytes, bytes]
"""Time, topic, encoding, schema's name, its encoding, its text, the message."""
PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "": bytes, "zstd": zstandard.ZstdCompressor().compress, "lz4": lz4.compress,
}  # fmt: skip


def record(code: int, body: bytes) -> bytes:
    return struct.pack("<BQ", code, len(body)) + body


def text(value: str | bytes) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return struct.pack("<I", len(data)) + data


def mcap(messages: list[Message], packed: str | None = None, *, per_chunk: int = 7) -> bytes:
    """Write a file as the specification (mcap.dev/spec) says; ``packed`` None: without chunks."""
    head = b"\x89MCAP0\r\n" + record(1, text("") + text("test"))
    topics = sorted({m[1:6] for m in messages})
    for number, (topic, encoding, name, kind, definition) in enumerate(topics, 1):
        head += record(3, struct.pack("<H", number) + text(name) + text(kind) + text(definition))
        head += record(4, struct.pack("<HH", number, number) + text(topic) + text(encoding) + struct.pack("<I", 0))
    records = []
    for sequence, message in enumerate(sorted(messages, key=lambda m: m[0])):
        ns = round(message[0] * 1e9)
        header = struct.pack("<HIQQ", topics.index(message[1:6]) + 1, sequence, ns, ns)
        records.append((ns, record(5, header + message[6])))
    body = b"".join(data for _, data in records)
    if packed is not None:
        body = b""
        for start in range(0, len(records), per_chunk):
            part = records[start : start + per_chunk]
            whole = b"".join(data for _, data in part)
            small = PACKERS[packed](whole)
            times = struct.pack("<QQQI", part[0][0], part[-1][0], len(whole), 0)
            body += record(6, times + text(packed) + struct.pack("<Q", len(small)) + small)
    return head + body + record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n"


def of_ros1() -> list[Message]:
    make, found = Messages(Stores.ROS1_NOETIC), []
    for time_s, topic, message in entries(make):
        package, _, plain = message.__msgtype__.split("/")
        definition = make.store.generate_msgdef(message.__msgtype__)[0]
        data = bytes(make.store.serialize_ros1(message, message.__msgtype__))
        found.append((time_s, topic, "ros1", f"{package}/{plain}", "ros1msg", definition.encode(), data))
    return found


def varint(value: int) -> bytes:
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def protobuf(fields: dict[int, Any]) -> bytes:
    """Pack a message: bytes and text with their length, floats as doubles, ("u4", n) as fixed32, others as varints."""
    out = b""
    for number, value in fields.items():
        if isinstance(value, float):
            out += varint(number << 3 | 1) + struct.pack("<d", value)
        elif isinstance(value, tuple):
            out += varint(number << 3 | 5) + struct.pack("<I", value[1])
        elif isinstance(value, int):
            out += varint(number << 3) + varint(value)
        else:
            data = value.encode() if isinstance(value, str) else value
            out += varint(number << 3 | 2) + varint(len(data)) + data
    return out


def foxglove(kind: str, picture: str = "png") -> list[Message]:
    """Depth as RawImage in millimetres, colour as PNG or WebP, a calibration, transforms; nothing is on /tf."""
    k, found = camera(), []

    def add(topic: str, name: str, fields: list[tuple[str, int, Any]], time_s: float) -> None:
        if kind == "json":
            plain = {
                key: base64.b64encode(v).decode() if isinstance(v, bytes) else v[1] if isinstance(v, tuple) else v
                for key, _, v in fields
            }
            sec, nsec = divmod(round(time_s * 1e9), 10**9)
            data = json.dumps({"timestamp": {"sec": sec, "nsec": nsec}} | plain).encode()
        else:
            sec, nsec = divmod(round(time_s * 1e9), 10**9)
            numbered = {1: protobuf({1: sec, 2: nsec})}
            for _, number, value in fields:
                numbered[number] = packed(value)
            data = protobuf(numbered)
        schema_kind = "jsonschema" if kind == "json" else "protobuf"
        found.append((time_s, topic, kind, f"foxglove.{name}", schema_kind, b"", data))

    def packed(value: Any) -> Any:
        if isinstance(value, dict):
            return protobuf({i: float(v) for i, v in enumerate(value.values(), 1)})
        return b"".join(struct.pack("<d", v) for v in value) if isinstance(value, list) else value

    def moved(time_s: float, topic: str, parent: str, child: str, T: np.ndarray) -> None:
        xyz = dict(zip("xyz", map(float, T[:3, 3]), strict=True))
        xyzw = dict(zip("xyzw", quaternion(T), strict=True))
        add(topic, "FrameTransform", [("parent_frame_id", 2, parent), ("child_frame_id", 3, child),
                                      ("translation", 4, xyz), ("rotation", 5, xyzw)], time_s)  # fmt: skip

    moved(START_S - 1, "/mounting", "base_link", "camera_optical", T_BASE_CAMERA)
    K = k.matrix()
    P = np.hstack([K, np.zeros((3, 1))])
    for name in ("depth", "color"):
        add(f"/camera/{name}/calibration", "CameraCalibration", [
            ("width", 2, ("u4", k.width)), ("height", 3, ("u4", k.height)), ("distortion_model", 4, "plumb_bob"),
            ("D", 5, [0.0] * 5), ("K", 6, K.ravel().tolist()), ("R", 7, np.eye(3).ravel().tolist()),
            ("P", 8, P.ravel().tolist()), ("frame_id", 9, "camera_optical")], START_S - 1)  # fmt: skip
    for tick in range(-2, 2 * FRAMES + 1):
        T = Z_UP.pose(tick / 2) @ invert_pose(T_BASE_CAMERA)
        moved(START_S + tick * INTERVAL_S / 2, "/pose", "odom", "base_link", T)
    for i in range(FRAMES):
        time_s = START_S + i * INTERVAL_S
        depth_m, ids = look(k, map_pose(i))
        raw = steps(depth_m).astype("<u2")
        if i == 2:  # as a picture of 16 bits
            add("/camera/depth/png", "CompressedImage", [("data", 2, cv2.imencode(".png", raw)[1].tobytes()),
                ("format", 3, "png"), ("frame_id", 4, "camera_optical")], time_s)  # fmt: skip
        add("/camera/depth/image", "RawImage", [("width", 2, ("u4", k.width)), ("height", 3, ("u4", k.height)),
            ("encoding", 4, "16UC1"), ("step", 5, ("u4", 2 * k.width)), ("data", 6, raw.tobytes()),
            ("frame_id", 7, "camera_optical")], time_s)  # fmt: skip
        whole = [cv2.IMWRITE_WEBP_QUALITY, 101] if picture == "webp" else []
        data = cv2.imencode(f".{picture}", np.ascontiguousarray(COLORS[ids][..., ::-1]), whole)[1].tobytes()
        add("/camera/color/image", "CompressedImage",
            [("data", 2, data), ("format", 3, picture), ("frame_id", 4, "camera_optical")], time_s + 0.005)  # fmt: skip
    found.append((START_S, "/imu", kind, "foxglove.LocationFix", "protobuf", b"", b"\x08\x01"))
    return found


def foxglove_mcap(folder: Path) -> Sample:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "drive.mcap").write_bytes(mcap(foxglove("protobuf", "webp"), "zstd"))
    return Sample(folder / "drive.mcap", reference_of(folder / "reference", camera(), Z_UP))


def ros1_mcap(folder: Path) -> Sample:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "drive.mcap").write_bytes(mcap(of_ros1(), "lz4"))
    return Sample(folder / "drive.mcap", reference_of(folder / "reference", camera(), Z_UP))
