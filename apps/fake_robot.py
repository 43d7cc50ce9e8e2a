"""A robot that is not there: it plays a sequence as a robot with a foxglove_bridge would send it. `make demo-live`.

    python apps/fake_robot.py ../scans/breakroom --drop 0.1 --restart-s 10
    simaps live foxglove://127.0.0.1:8765 -o map.npz --view

It listens on this machine only. Its pictures are simulated to be live; nothing else about them is. Sent a goal, it
stops playing, and goes there in a straight line, through whatever stands there: also that is simulated.
"""

import contextlib
import importlib
import json
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from websockets.exceptions import WebSocketException
from websockets.sync.server import ServerConnection, serve

from simaps_viz import open_sequence
from simaps_viz.datasets.association import interpolate_poses
from simaps_viz.datasets.source import FrameSource
from simaps_viz.geometry import invert_pose
from simaps_viz.live import drive
from simaps_viz.live.drive import GOAL, GOAL_TYPE
from simaps_viz.live.links import PROTOCOLS, dds_name, message_types
from simaps_viz.structures import Intrinsics

COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
INFO, MASKS, LABELS = "/camera/aligned_depth_to_color/camera_info", "/camera/masks", "/camera/labels"
TOPICS = {
    COLOR: "sensor_msgs/msg/Image", DEPTH: "sensor_msgs/msg/Image", INFO: "sensor_msgs/msg/CameraInfo",
    MASKS: "sensor_msgs/msg/Image", LABELS: "std_msgs/msg/String",
    "/tf": "tf2_msgs/msg/TFMessage", "/tf_static": "tf2_msgs/msg/TFMessage",
}  # fmt: skip
LATCHED = ("/tf_static", LABELS, INFO)
"""Sent again to whoever comes."""
OPTICAL, BASE = "camera_optical", "base_link"
T_BASE_OPTICAL = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0.0], [0, -1, 0, 0.9], [0, 0, 0, 1.0]])
TF_HZ = 90.0
"""At times between those of pictures, which come at 30 Hz."""
OUTAGE_S = 3.0
DRIVE_HZ, MPS = 30.0, 0.5
"""Transforms a second of a robot that drives, and its speed, m/s."""
RECEIVED = 200
"""Messages of clients that are kept to be looked at."""
A_CLASS = 100
"""Ids of masks: so many times the class, and a number of the segment in its frame, so that an id keeps its label."""


@dataclass(frozen=True)
class Faults:
    """What goes wrong."""

    drop: float = 0.0
    """Share of messages that are lost."""
    restart_s: float = 0.0
    """The server goes away for a second every so often; 0 = never."""
    drift_m: float = 0.0
    """The odometry drifts by so much, and turns by a twentieth of a radian a metre, until map to odom corrects it."""
    correct_s: float = 5.0
    """How often it does."""
    tf_late_s: float = 0.0
    """Transforms come so much later than pictures of their time."""
    tf_stops_s: float = 0.0
    """After so long there are no transforms for three seconds; 0 = never."""
    map_stops_s: float = 0.0
    """After so long there is no map to odom for three seconds, as while a robot is lost; 0 = never."""
    masks_late_s: float = 0.05
    """Masks come so much later than pictures of their time."""


class Server(Protocol):
    """Where the robot publishes."""

    received: list[tuple[str, bytes]]
    """(topic, CDR) of the last that clients have published."""
    on_receive: Callable[[str, bytes], None]
    """Called with each of them."""

    @property
    def address(self) -> str:
        """Where `simaps live` finds it."""
        ...

    def publish(self, topic: str, data: bytes) -> None:
        """Send to all that have subscribed."""
        ...

    def restart(self, away_s: float) -> None:
        """Go away, and come back."""
        ...

    def close(self) -> None:
        """Stop serving."""
        ...


class FoxgloveServer:
    """The server's side of the Foxglove WebSocket protocol, as far as a bridge with publishing clients has it."""

    def __init__(self, port: int = 0) -> None:
        """Serve on this machine; port 0 = any free one."""
        self.received: list[tuple[str, bytes]] = []
        self.on_receive: Callable[[str, bytes], None] = lambda topic, data: None
        self._latched: dict[str, bytes] = {}
        self._numbers = {topic: i + 1 for i, topic in enumerate(TOPICS)}
        self._clients: dict[ServerConnection, dict[int, int]] = {}
        self._lock = threading.Lock()
        self.port = port
        self._start()

    @property
    def address(self) -> str:
        """Where `simaps live` finds it."""
        return f"foxglove://127.0.0.1:{self.port}"

    def publish(self, topic: str, data: bytes) -> None:
        """Send to all that have subscribed."""
        if topic in LATCHED:
            self._latched[topic] = data
        with self._lock:
            clients = list(self._clients.items())
        for client, subscribed in clients:
            if (number := subscribed.get(self._numbers[topic])) is not None:
                self._send(client, number, data)

    def is_heard(self, topic: str) -> bool:
        """Whether somebody has subscribed."""
        with self._lock:
            return any(self._numbers[topic] in subscribed for subscribed in self._clients.values())

    def restart(self, away_s: float) -> None:
        """Go away, and come back."""
        self.close()
        time.sleep(away_s)
        self._start()

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        with self._lock:
            clients = list(self._clients)
        for client in clients:
            client.close()
        self._thread.join()

    def _start(self) -> None:
        for attempt in range(50):
            try:
                self._server = serve(
                    self._serve, "127.0.0.1", self.port, subprotocols=PROTOCOLS, compression=None, max_size=None
                )
                break
            except OSError:  # the port is not free again yet
                if attempt == 49:
                    raise
                time.sleep(0.1)
        self.port = self._server.socket.getsockname()[1]
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def _serve(self, client: ServerConnection) -> None:
        subscribed: dict[int, int] = {}
        published: dict[int, str] = {}
        with contextlib.suppress(WebSocketException, OSError):
            client.send(json.dumps({"op": "serverInfo", "name": "fake robot", "capabilities": ["clientPublish"],
                                    "supportedEncodings": ["cdr"], "sessionId": str(id(client))}))  # fmt: skip
            channels = [{"id": self._numbers[topic], "topic": topic, "encoding": "cdr", "schemaName": kind,
                         "schemaEncoding": "ros2msg", "schema": ""} for topic, kind in TOPICS.items()]  # fmt: skip
            client.send(json.dumps({"op": "advertise", "channels": channels}))
            with self._lock:
                self._clients[client] = subscribed
            for message in client:
                if isinstance(message, bytes):
                    self._receive(published[int.from_bytes(message[1:5], "little")], message[5:])
                    continue
                said = json.loads(message)
                if said["op"] == "subscribe":
                    for one in said["subscriptions"]:
                        subscribed[one["channelId"]] = one["id"]
                        topic = next(t for t, number in self._numbers.items() if number == one["channelId"])
                        if topic in self._latched:
                            self._send(client, one["id"], self._latched[topic])
                elif said["op"] == "advertise":
                    published |= {one["id"]: one["topic"] for one in said["channels"]}
        with self._lock:
            self._clients.pop(client, None)

    def _receive(self, topic: str, data: bytes) -> None:
        _keep(self.received, topic, data)
        self.on_receive(topic, data)

    def _send(self, client: ServerConnection, number: int, data: bytes) -> None:
        with contextlib.suppress(WebSocketException, OSError):
            head = b"\x01" + number.to_bytes(4, "little") + time.time_ns().to_bytes(8, "little")
            client.send(head + data)


def _keep(received: list[tuple[str, bytes]], topic: str, data: bytes) -> None:
    received.append((topic, data))
    del received[:-RECEIVED]


class ZenohServer:
    """A robot on rmw_zenoh: a router, and a node behind it that publishes as rmw_zenoh does (extra "ros2")."""

    def __init__(self, port: int = 0, *, humble: bool = False, nav2: bool = False) -> None:
        """Serve on this machine.

        Args:
            port: 0 = any free one.
            humble: keys without hashes, as of that version.
            nav2: it also serves the action NavigateToPose.
        """
        self.received: list[tuple[str, bytes]] = []
        self.on_receive: Callable[[str, bytes], None] = lambda topic, data: None
        self.port = port or _free_port()
        self._humble = humble
        self.nav2 = FakeNav2() if nav2 else None
        self._start()

    @property
    def address(self) -> str:
        """Where `simaps live` finds it."""
        return f"zenoh://127.0.0.1:{self.port}"

    def publish(self, topic: str, data: bytes) -> None:
        """Send to all that have subscribed."""
        self._sent += 1
        self._publishers[topic].put(data, attachment=struct.pack("<qqB", self._sent, time.time_ns(), 16) + b"r" * 16)

    def restart(self, away_s: float) -> None:
        """Go away, and come back."""
        self.close()
        time.sleep(away_s)
        self._start()

    def close(self) -> None:
        """Stop serving."""
        if self.nav2 is not None:
            self.nav2.detach()
        self._node.close()
        self._router.close()

    def _start(self) -> None:
        zenoh: Any = importlib.import_module("zenoh")
        importlib.import_module("zenoh.ext")
        endpoint = f"tcp/127.0.0.1:{self.port}"
        self._router = self._open("router", "listen", endpoint)
        self._node = self._open("client", "connect", endpoint)
        types, self._sent, self._publishers, self._kept = message_types(), 0, {}, []
        for number, (topic, kind) in enumerate(TOPICS.items()):
            dds = dds_name(kind)
            hashed = "TypeHashNotSupported" if self._humble else types.hash_rihs01(kind)
            node = f"@ros2_lv/0/{self._node.info.zid()}/0/{number + 10}/MP/%/%/camera"
            token = f"{node}/{topic.replace('/', '%')}/{dds}/{hashed}"
            key = f"0{topic}/{dds}/{hashed}"
            latched = topic in LATCHED
            self._kept.append(self._node.liveliness().declare_token(f"{token}/{':1:' if latched else '2::'},5:,:,:,,"))
            self._publishers[topic] = self._node.declare_publisher(key) if not latched else (
                zenoh.ext.declare_advanced_publisher(
                    self._node, key, cache=zenoh.ext.CacheConfig(1), publisher_detection=True,
                    sample_miss_detection=zenoh.ext.MissDetectionConfig(sporadic_heartbeat=0.5),
                )
            )  # fmt: skip

        def take(sample: Any) -> None:
            topic = "/" + "/".join(str(sample.key_expr).split("/")[1:-2])
            _keep(self.received, topic, bytes(sample.payload))
            self.on_receive(topic, bytes(sample.payload))

        self._kept.append(self._node.declare_subscriber("0/**", take, allowed_origin=zenoh.Locality.REMOTE))
        if self.nav2 is not None:
            self.nav2.attach(zenoh, self._node, humble=self._humble)

    def _open(self, mode: str, how: str, endpoint: str) -> Any:
        zenoh: Any = importlib.import_module("zenoh")
        config = zenoh.Config()
        for key, value in {"mode": mode, "scouting/multicast/enabled": False, f"{how}/endpoints": [endpoint],
                           **({"listen/endpoints": []} if how == "connect" else {})}.items():  # fmt: skip
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)


HASHES = {
    drive.SEND: (drive.SEND_TYPE, drive.SEND_HASHES[0]),
    drive.CANCEL: ("action_msgs::srv::dds_::CancelGoal_",
                  "RIHS01_573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a"),
    drive.RESULT: ("nav2_msgs::action::dds_::NavigateToPose_GetResult_",
                  "RIHS01_c407920357d566771e8882b4ef4d1f1a84ee922d609920ccd57faa6d6e391dc5"),
    drive.STATUS: ("action_msgs::msg::dds_::GoalStatusArray_",
                  "RIHS01_6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e"),
    drive.FEEDBACK: ("nav2_msgs::action::dds_::NavigateToPose_FeedbackMessage_",
                    "RIHS01_9d1f6fa2eb975ce733b419ac2e97b134d8ff92b6478b6559feed9a50bdfd82b3"),
}  # fmt: skip
"""Types of the action's services and topics, and their hashes as of Jazzy."""


class FakeNav2:
    """Serves NavigateToPose as Nav2 does on rmw_zenoh: a new goal ends the one before as aborted."""

    def __init__(self) -> None:
        """Serve nothing yet."""
        self.asked: list[bytes] = []
        """Ids of the goals of all SendGoal requests, as they came,"""
        self.cancels: list[bytes] = []
        """and of all CancelGoal requests."""
        self.states: dict[bytes, int] = {}
        self.faults: list[str] = []
        """What a server of ROS would not have understood."""
        self.accepts, self.cancelable = True, True
        self.answers = threading.Event()
        """Goals are answered only while it is set."""
        self.answers.set()
        self.on_goal: Callable[[bytes], None] = lambda pose: None
        """Called with the PoseStamped of each goal that is accepted,"""
        self.came_ns = 0
        """which came at this time."""
        self._lock, self._numbers, self._sent = threading.RLock(), set(), 0
        self._kept: list[Any] = []

    def attach(self, zenoh: Any, node: Any, *, humble: bool) -> None:
        """Announce the services and topics of the action."""
        self._humble, self._types, self._zenoh = humble, message_types(), zenoh
        answer = {drive.SEND: self._send_goal, drive.CANCEL: self._cancel_goal, drive.RESULT: self._get_result}
        self._publishers: dict[str, Any] = {}
        for number, (name, (dds, hashed)) in enumerate(HASHES.items()):
            end = f"{dds}/{'TypeHashNotSupported' if humble else hashed}"
            kind = "SS" if name in answer else "MP"
            entity = f"@ros2_lv/0/{node.info.zid()}/1/{number + 40}/{kind}/%/%/bt_navigator"
            key = f"0{name}/{end}"
            if name in answer:
                served = lambda query, reply=answer[name]: self._serve(query, reply)  # noqa: E731
                self._kept.append(node.declare_queryable(key, served, complete=True))
            else:
                self._publishers[name] = zenoh.ext.declare_advanced_publisher(
                    node, key, cache=zenoh.ext.CacheConfig(1), publisher_detection=True,
                    sample_miss_detection=zenoh.ext.MissDetectionConfig(sporadic_heartbeat=0.5),
                )  # fmt: skip
            token = f"{entity}/{name.replace('/', '%')}/{end}/{':1:' if name == drive.STATUS else '::'},10:,:,:,,"
            self._kept.append(node.liveliness().declare_token(token))

    def detach(self) -> None:
        """Let the session go."""
        self.answers.set()
        self._kept.clear()
        self._publishers = {}

    def end(self, state: int) -> None:
        """End the goal that is on its way, if one is."""
        with self._lock:
            self.states |= {one: state for one in self.going}
            self.tell()

    @property
    def going(self) -> list[bytes]:
        """Return the ids of goals that are on their way; one at most."""
        return [one for one, state in self.states.items() if state == drive.EXECUTING]

    def tell(self) -> None:
        """Publish the status of all goals."""
        make = self._types.types
        never, goals = make["builtin_interfaces/msg/Time"](0, 0), []
        for goal_id, state in self.states.items():
            uuid = make["unique_identifier_msgs/msg/UUID"](np.frombuffer(goal_id, np.uint8))
            goals.append(make["action_msgs/msg/GoalStatus"](make["action_msgs/msg/GoalInfo"](uuid, never), state))
        self._publish(drive.STATUS, bytes(self._types.serialize_cdr(make[drive.STATUS_TYPE](goals), drive.STATUS_TYPE)))

    def feed_back(self, frame: str, recoveries: int) -> None:
        """Publish feedback on the goal that is on its way."""
        name = struct.pack("<iiI", 0, 0, len(frame) + 1) + frame.encode() + b"\0"
        body = self.going[0] + name
        body += bytes(-len(body) % 8) + bytes(56 + 16) + struct.pack("<hxxf", recoveries, 1.0)
        self._publish(drive.FEEDBACK, b"\0\1\0\0" + body)

    def _publish(self, name: str, data: bytes) -> None:
        if name in self._publishers:
            self._publishers[name].put(data, attachment=self._attachment())

    def _attachment(self, asked: bytes = b"") -> bytes:
        """Return that of a message, or of an answer: its number and sender are those of the request."""
        self._sent += 1
        number = struct.unpack_from("<q", asked)[0] if asked else self._sent
        return struct.pack("<qqB", number, time.time_ns(), 16) + (asked[17:33] or b"n" * 16)

    def _serve(self, query: Any, reply: Callable[[bytes], bytes]) -> None:
        """Answer a request, as rmw_zenoh takes it: with an attachment, whose number no other request has had."""
        asked = bytes(query.attachment or b"")
        if len(asked) != 33 or asked[16] != 16 or asked[17:] + asked[:8] in self._numbers:
            self.faults.append(f"{query.key_expr}: attachment {asked.hex()}")
            return
        self._numbers.add(asked[17:] + asked[:8])
        data = reply(bytes(query.payload))
        query.reply(query.key_expr, data, attachment=self._attachment(asked))

    def _send_goal(self, request: bytes) -> bytes:
        came_ns = time.time_ns()
        pose, ends = request[:4] + request[20:-5], request[-5:]
        try:
            self._types.deserialize_cdr(pose, GOAL_TYPE)
        except Exception as error:  # what a server cannot read is a fault, whatever is wrong with it
            self.faults.append(f"goal: {error}")
        if ends != b"\1\0\0\0\0":
            self.faults.append(f"behaviour tree: {ends.hex()}")
        self.asked.append(request[4:20])
        self.answers.wait()
        with self._lock:
            if self.accepts:
                self.end(drive.ABORTED)
                self.states[request[4:20]], self.came_ns = drive.EXECUTING, came_ns
                self.on_goal(pose)
                self.tell()
        return struct.pack("<4s?xxxii", b"\0\1\0\0", self.accepts, 0, 0)

    def _cancel_goal(self, request: bytes) -> bytes:
        goal_id, stamp = request[4:20], request[20:]
        if stamp != bytes(8):
            self.faults.append(f"cancel: time {stamp.hex()}")
        with self._lock:
            self.cancels.append(goal_id)
            state = self.states.get(goal_id)
            if state != drive.EXECUTING or not self.cancelable:
                code = 1 if state == drive.EXECUTING else 2 if state is None else 3
                return struct.pack("<4sbxxxI", b"\0\1\0\0", code, 0)
            self.end(drive.CANCELED)
        return struct.pack("<4sbxxxI16sii", b"\0\1\0\0", 0, 1, goal_id, 0, 0)

    def _get_result(self, request: bytes) -> bytes:
        state = self.states.get(request[4:20], 0)
        failed = state == drive.ABORTED
        if self._humble:
            return struct.pack("<4sbB", b"\0\1\0\0", state, 0)
        text = b"no way there\0" if failed else b"\0"
        return struct.pack("<4sbxHI", b"\0\1\0\0", state, 9000 if failed else 0, len(text)) + text


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Played:
    """The messages of a sequence, in the order and at the times a robot would send them."""

    def __init__(
        self, sequence: FrameSource, faults: Faults, *, rate_hz: float = 30.0,
        size: tuple[int, int] | None = None, color: bool = False, seed: int = 0,
    ) -> None:  # fmt: skip
        """Take the sequence; its pictures are resized to ``size`` (width, height) where one is given."""
        self.sequence, self.faults, self.rate_hz, self.size, self.color = sequence, faults, rate_hz, size, color
        self.types = message_types()
        self._random = np.random.default_rng(seed)
        self._poses = np.asarray(sequence.T_map_world @ sequence.poses)
        self._times = np.arange(len(sequence)) / rate_hz
        self._label_of = {label: i for i, label in enumerate(sequence.labels)}
        self._made: dict[int, tuple[Any, ...]] = {}

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return len(self.sequence) / self.rate_hz

    def messages(self, start_ns: int, laps: int = 1) -> Iterator[tuple[float, str, bytes]]:
        """Return (seconds after the start, topic, CDR) of all messages, ordered by when they are sent."""
        yield 0.0, "/tf_static", self._tf(start_ns, [(BASE, OPTICAL, T_BASE_OPTICAL)])
        yield 0.0, LABELS, self._string(self._labels())
        events: list[tuple[float, int, str, float]] = []
        f, total = self.faults, laps * self.seconds
        for i in range(laps * len(self.sequence)):
            at = i / self.rate_hz
            events += [(at, i, DEPTH, at), (at + f.masks_late_s, i, MASKS, at)]
            events += [(at, i, COLOR, at)] if self.color else []
        for i in range(int(total * TF_HZ) + 1):
            at = i / TF_HZ
            if not (f.tf_stops_s and f.tf_stops_s <= at < f.tf_stops_s + OUTAGE_S):
                events.append((at + f.tf_late_s, i, "/tf", at))
        for due, i, topic, at in sorted(events):
            if self._random.random() < f.drop:
                continue
            stamp_ns = start_ns + int(at * 1e9)
            if topic == "/tf":
                yield due, topic, self._transforms(stamp_ns, at, last=at + 1.0 / TF_HZ > total)
                continue
            made = self._pictures(i % len(self.sequence))
            if i % 30 == 0 and topic == DEPTH:
                yield due, INFO, self._info(stamp_ns, made[0])
            yield due, topic, self._image(stamp_ns, *made[{DEPTH: 1, MASKS: 2, COLOR: 3}[topic]])

    def drift(self, at_s: float) -> NDArray:
        """Return T_map_odom as it is at a time; what is published is that of the last correction."""
        f = self.faults
        amount = f.drift_m * at_s / max(f.correct_s, 1e-9)
        T = np.eye(4)
        T[:2, 3] = amount, -amount / 2
        T[:3, :3] = Rotation.from_euler("z", amount / 20).as_matrix()
        return T

    def _transforms(self, stamp_ns: int, at_s: float, *, last: bool) -> bytes:
        """Return the transforms of a time; the last ones of all are corrected."""
        pose = self._poses[-1] if last else self.camera(at_s)
        every_s = self.faults.correct_s
        corrected_s = at_s if last else at_s // every_s * every_s
        T_odom_base = invert_pose(self.drift(at_s)) @ pose @ invert_pose(T_BASE_OPTICAL)
        links = [("map", "odom", self.drift(corrected_s)), ("odom", BASE, T_odom_base)]
        stops_s = self.faults.map_stops_s
        return self._tf(stamp_ns, links[stops_s > 0.0 and stops_s <= at_s < stops_s + OUTAGE_S :])

    def _pictures(self, index: int) -> tuple[Any, ...]:
        """Return the camera, and (pixels, encoding) of depth, masks and colour of a frame; made once."""
        if index not in self._made:
            frame, masks = self.sequence.read(index, color=self.color), self.sequence.segmentation(index)
            table = np.zeros(max((s.id for s in masks.segments), default=0) + 1, np.uint16)
            counts: dict[str, int] = {}
            for s in masks.segments:
                counts[s.label] = counts.get(s.label, -1) + 1
                table[s.id] = A_CLASS * self._label_of[s.label] + min(counts[s.label], A_CLASS - 1)
            depth, ids, k = np.rint(frame.depth_m * 1000).astype(np.uint16), table[masks.ids], frame.intrinsics
            rgb = frame.color
            if self.size is not None:
                resize = lambda image: cv2.resize(image, self.size, interpolation=cv2.INTER_NEAREST)  # noqa: E731
                depth, ids, rgb = resize(depth), resize(ids), None if rgb is None else resize(rgb)
                sx, sy = self.size[0] / k.width, self.size[1] / k.height
                k = Intrinsics(*self.size, k.fx * sx, k.fy * sy, (k.cx + 0.5) * sx - 0.5, (k.cy + 0.5) * sy - 0.5)
            self._made[index] = k, (depth, "16UC1"), (ids, "mono16"), (rgb, "rgb8")
        return self._made[index]

    def camera(self, at_s: float) -> NDArray:
        """Return T_map_camera [4, 4] at a time."""
        lap_s = min(at_s % self.seconds, self._times[-1])
        return interpolate_poses(self._times, self._poses, np.array([lap_s]), max_gap_s=np.inf)[0][0]

    def transforms_at(self, stamp_ns: int, T_map_camera: NDArray) -> bytes:
        """Return the transforms of a robot elsewhere, whose odometry does not drift."""
        T = T_map_camera @ invert_pose(T_BASE_OPTICAL)
        return self._tf(stamp_ns, [("map", "odom", np.eye(4)), ("odom", BASE, T)])

    def prepare(self) -> None:
        """Read all frames now, so that playing them costs nothing but sending."""
        for index in range(len(self.sequence)):
            self._pictures(index)

    def _labels(self) -> str:
        things = zip(self.sequence.labels, self.sequence.is_thing, strict=True)
        return json.dumps({
            str(A_CLASS * i + n): {"label": label, "score": 1.0, "is_thing": thing}
            for i, (label, thing) in enumerate(things) if i
            for n in range(A_CLASS)
        })  # fmt: skip

    def _string(self, text: str) -> bytes:
        return self._cdr("std_msgs/msg/String", data=text)

    def _header(self, stamp_ns: int, frame: str) -> Any:
        make = self.types.types
        stamp = make["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
        return make["std_msgs/msg/Header"](stamp, frame)

    def _image(self, stamp_ns: int, pixels: NDArray, encoding: str) -> bytes:
        height, width = pixels.shape[:2]
        data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
        return self._cdr(
            "sensor_msgs/msg/Image", header=self._header(stamp_ns, OPTICAL), height=height, width=width,
            encoding=encoding, is_bigendian=0, step=data.size // height, data=data,
        )  # fmt: skip

    def _info(self, stamp_ns: int, k: Intrinsics) -> bytes:
        K = k.matrix()
        P = np.concatenate([K, np.zeros((3, 1))], axis=1)
        roi = self.types.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        return self._cdr(
            "sensor_msgs/msg/CameraInfo", header=self._header(stamp_ns, OPTICAL), height=k.height, width=k.width,
            distortion_model="plumb_bob", d=np.zeros(5), k=K.reshape(-1), r=np.eye(3).reshape(-1), p=P.reshape(-1),
            binning_x=0, binning_y=0, roi=roi,
        )  # fmt: skip

    def _tf(self, stamp_ns: int, links: Sequence[tuple[str, str, NDArray]]) -> bytes:
        make = self.types.types
        found = []
        for parent, child, T in links:
            at = make["geometry_msgs/msg/Vector3"](*T[:3, 3].tolist())
            turned = make["geometry_msgs/msg/Quaternion"](*Rotation.from_matrix(T[:3, :3]).as_quat().tolist())
            pose = make["geometry_msgs/msg/Transform"](at, turned)
            found.append(make["geometry_msgs/msg/TransformStamped"](self._header(stamp_ns, parent), child, pose))
        return self._cdr("tf2_msgs/msg/TFMessage", transforms=found)

    def _cdr(self, kind: str, **fields: Any) -> bytes:
        return bytes(self.types.serialize_cdr(self.types.types[kind](**fields), kind))


class Wheels:
    """Takes the simulated robot to its goals, by both ways, from where the playing of its sequence has ended."""

    def __init__(self, played: Played, server: Server) -> None:
        """Listen to the server's goals."""
        self.played, self.server = played, server
        self.asked = threading.Event()
        """A goal has come,"""
        self.times_ns: list[tuple[int, int]] = []
        """and when each was made, and has come, by the clock of `time.time_ns`."""
        self.goal_m: NDArray | None = None
        self._T = played.camera(0.0)
        self._nav2 = server.nav2 if isinstance(server, ZenohServer) else None
        server.on_receive = lambda topic, data: self._go(data) if topic == GOAL else None
        if self._nav2 is not None:
            self._nav2.on_goal = self._go

    def drive(self, from_s: float, stop: threading.Event, mps: float = MPS) -> None:
        """Send transforms of the robot, which stands as at a time of its sequence and goes to its goals."""
        self._T = self.played.camera(from_s)
        while not stop.wait(1.0 / DRIVE_HZ):
            if self._nav2 is not None and self._nav2.states and not self._nav2.going:
                self.goal_m = None  # it was cancelled
            if self.goal_m is not None:
                ahead = self.goal_m - (self._T @ invert_pose(T_BASE_OPTICAL))[:2, 3]
                left_m = float(np.linalg.norm(ahead))
                self._T[:2, 3] += ahead * min(mps / DRIVE_HZ / max(left_m, 1e-9), 1.0)
                if left_m <= mps / DRIVE_HZ:
                    self.goal_m = None
                    if self._nav2 is not None:
                        self._nav2.end(drive.SUCCEEDED)
            self.server.publish("/tf", self.played.transforms_at(time.time_ns(), self._T))

    def _go(self, pose: bytes) -> None:
        came_ns = time.time_ns() if self._nav2 is None else self._nav2.came_ns
        goal = self.played.types.deserialize_cdr(pose, GOAL_TYPE)
        at, stamp = goal.pose.position, goal.header.stamp
        self.times_ns.append((stamp.sec * 10**9 + stamp.nanosec, came_ns))
        self.goal_m = np.array([at.x, at.y])
        self.asked.set()


def play(played: Played, server: Server, *, laps: int = 1, stop: threading.Event | None = None) -> None:
    """Send the messages of a sequence at their times, and restart the server when it is due."""
    began_s, restarts = time.monotonic(), 0
    for due_s, topic, data in played.messages(time.time_ns(), laps):
        time.sleep(max(began_s + due_s - time.monotonic(), 0.0))
        if stop is not None and stop.is_set():
            return
        if played.faults.restart_s and due_s > (restarts + 1) * played.faults.restart_s:
            restarts += 1
            threading.Thread(target=server.restart, args=(1.0,), daemon=True).start()
        with contextlib.suppress(OSError):
            server.publish(topic, data)


@dataclass(frozen=True)
class FakeRobot:
    """What to play."""

    sequence: tyro.conf.Positional[Path | None] = None
    """A sequence with masks; by default the embedded café."""
    port: int = 8765
    """Where to serve."""
    zenoh: bool = False
    """Speak as a robot on rmw_zenoh (extra "ros2")."""
    rate_hz: float = 30.0
    """Frames a second."""
    laps: int = 1000
    """How many times over."""
    faults: Faults = field(default_factory=Faults)

    @cached_property
    def path(self) -> Path:
        """Return the sequence's path; the café is rendered on the first call."""
        if self.sequence is not None:
            return self.sequence
        from simaps_viz.app.workbench import cache_folder  # noqa: PLC0415 - only for the café
        from simaps_viz.console.progress import stage_progress  # noqa: PLC0415 - as above
        from simaps_viz.scenes.demo import ensure_demo  # noqa: PLC0415 - as above

        with stage_progress() as progress:
            return ensure_demo(cache_dir=cache_folder(), progress=progress)


def main(config: FakeRobot) -> None:
    """Play until Ctrl-C."""
    played = Played(open_sequence(config.path), config.faults, rate_hz=config.rate_hz, color=True)
    server = ZenohServer(config.port, nav2=True) if config.zenoh else FoxgloveServer(config.port)
    wheels, began_s = Wheels(played, server), time.monotonic()
    print(f"simaps live {server.address} -o map.npz --view --drive")
    with contextlib.suppress(KeyboardInterrupt):
        play(played, server, laps=config.laps, stop=wheels.asked)
        wheels.drive(time.monotonic() - began_s, threading.Event())


if __name__ == "__main__":
    main(tyro.cli(FakeRobot))
