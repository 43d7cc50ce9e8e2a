"""Connections to robots: foxglove_bridge's WebSocket, which goes with any ROS 2, or the router of rmw_zenoh.

**Foxglove** (WebSocket protocol, version 1): the server announces channels as JSON; messages are binary: a byte 1, the
subscription's number (u32), the time it was sent (u64, ns), then the message as CDR. All numbers are little-endian.

**Zenoh** (extra "ros2"): a topic's messages have the key DOMAIN/TOPIC/TYPE/HASH, with the type as
"pkg::msg::dds_::Type_" and its RIHS01 hash ("TypeHashNotSupported" in Humble); so have queries, which are calls of
services. Publishers and services are found by their liveliness tokens, "@ros2_lv/…", in which "%" stands for "/". Every
message carries an attachment: its number, the time it was sent (ns), and the sender's id of 16 bytes.
"""

import json
import os
import struct
import threading
import time
from collections.abc import Callable
from functools import cache
from typing import Any
from urllib.parse import urlsplit

from websockets.exceptions import InvalidHandshake, WebSocketException
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from simaps_viz.errors import InputError, needs_extra, one_line

JOIN_S = 6.0
"""A link's thread is waited for so long."""

OnMessage = Callable[[str, bytes, int], None]
"""(topic, CDR bytes, when it was sent in ns or 0)"""
OnReply = Callable[[bytes | None], None]
"""(CDR bytes of an answer; None = no more comes)"""


class RobotLink:
    """A connection to a robot, whatever the protocol; it connects again by itself."""

    def __init__(self, address: str) -> None:
        """Take an address; ``open`` connects."""
        self.address, self._state = address, "connecting"
        self._wanted: tuple[str, ...] = ()
        self._listeners: dict[str, Callable[[bytes], None]] = {}
        self._lock = threading.RLock()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def state(self) -> str:
        """Return what is wrong with the connection, in words; "" = nothing."""
        return self._state

    def open(self, on_topics: Callable[[dict[str, str]], None], on_message: OnMessage) -> None:
        """Connect, and keep calling back from one thread: with {topic: type} when it changes, and messages."""
        self._on_topics, self._on_message = on_topics, on_message
        self._thread = threading.Thread(target=self._run, name="robot-link", daemon=True)
        self._thread.start()

    def subscribe(self, topics: tuple[str, ...]) -> None:
        """Receive these topics from now on, also after connecting again."""
        with self._lock:
            self._wanted = topics
            self._subscribe()

    def advertise(self, topic: str, kind: str) -> None:
        """Announce that a topic will be published, now and after connecting again."""
        raise NotImplementedError

    def publish(self, topic: str, data: bytes) -> bool:
        """Publish CDR bytes on an announced topic; False when there is no connection."""
        raise NotImplementedError

    @property
    def services(self) -> dict[str, tuple[str, str]]:
        """Return {service: (type, its hash)} of what can be called, as Zenoh's keys have them."""
        return {}

    def call(self, service: str, request: bytes, take: OnReply, timeout_s: float) -> bool:
        """Call a service with CDR bytes, and ``take`` its answer, then None; False where it cannot be called."""
        return False

    def listen(self, topic: str, take: Callable[[bytes], None]) -> None:
        """Also receive a topic that no frame needs, where services can be called; before ``open`` or later."""
        with self._lock:
            self._listeners[topic] = take
            self._subscribe()

    def close(self) -> None:
        """Disconnect."""
        self._closed.set()
        self._hang_up()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        """Connect again and again until ``_closed``, calling back; then end the connection."""
        raise NotImplementedError

    def _subscribe(self) -> None:
        """Subscribe to what is wanted and not subscribed to, where there is a connection; under the lock."""
        raise NotImplementedError

    def _hang_up(self) -> None:
        """End the connection, where its thread does not look at ``_closed`` by itself."""


@cache
def message_types() -> Any:
    """Return rosbags' types of messages, which have not changed since Foxy, so a robot's own are not needed.

    They are one object for all: it compiles each type when it is first used, which takes a tenth of a second.
    """
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - only robots need it

    return get_typestore(Stores.ROS2_JAZZY)


PROTOCOLS = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
"""Of newer and older bridges; each refuses the other's alone."""
FOXGLOVE_PORT = 8765
MAX_MESSAGE = 64 << 20
"""Bytes; a depth picture of 4K has 16 MB."""
MAX_CHANNELS = 5000
"""Or topics, that a robot may announce."""
OPEN_S = 5.0
FOXGLOVE_RETRY_S = (0.2, 4.0)
"""Wait before connecting again: at first, and when it has lasted longer than `SOON_S`."""
SOON_S = 10.0
"""A bridge that was restarted is back by then: each further second away costs thirty pictures."""
_DATA, _PUBLISH = struct.Struct("<BIQ"), struct.Struct("<BI")


class FoxgloveLink(RobotLink):
    """A connection to a Foxglove WebSocket server."""

    def __init__(self, address: str) -> None:
        """Take an address: foxglove://HOST:PORT.

        Raises:
            InputError: it is none.
        """
        super().__init__(address)
        try:
            parts = urlsplit(address)
            host, port = parts.hostname, parts.port or FOXGLOVE_PORT
        except ValueError:
            host, port = None, 0
        if not host or parts.path not in ("", "/"):
            raise InputError(f"{address}: expected foxglove://HOST:PORT")
        self._url = f"ws://{f'[{host}]' if ':' in host else host}:{port}"
        self._socket: Connection | None = None
        self._published: dict[str, tuple[int, str]] = {}
        self._channels: dict[int, tuple[str, str]] = {}
        self._topic_of: dict[int, str] = {}

    def advertise(self, topic: str, kind: str) -> None:
        """Announce that a topic will be published, now and after connecting again."""
        with self._lock:
            if topic not in self._published:
                self._published[topic] = len(self._published) + 1, kind
                self._advertise(topic)

    def publish(self, topic: str, data: bytes) -> bool:
        """Publish CDR bytes; False when there is no connection."""
        with self._lock:
            return self._send(_PUBLISH.pack(1, self._published[topic][0]) + data)

    def _hang_up(self) -> None:
        with self._lock:
            socket = self._socket
        if socket is not None:
            socket.close()

    def _run(self) -> None:
        lost_s, seen = time.monotonic(), False
        while not self._closed.is_set():
            try:
                with connect(
                    self._url, subprotocols=PROTOCOLS, compression=None, max_size=MAX_MESSAGE, open_timeout=OPEN_S,
                    close_timeout=1.0, proxy=None,
                ) as socket:  # fmt: skip
                    with self._lock:
                        self._socket, self._state, self._channels, self._topic_of = socket, "", {}, {}
                        for topic in self._published:
                            self._advertise(topic)
                    seen = True
                    for message in socket:
                        self._take(message)
                    reason = "the robot has closed the connection"
            except InvalidHandshake as error:
                reason = f"no Foxglove server there ({one_line(error)})"
            except (OSError, WebSocketException, TimeoutError) as error:
                reason = one_line(error)
            with self._lock:
                lost_s = lost_s if self._socket is None else time.monotonic()
                self._socket = None
            self._state = f"{'connection lost' if seen else 'no connection'}, trying again: {reason}"
            self._closed.wait(FOXGLOVE_RETRY_S[time.monotonic() - lost_s > SOON_S])

    def _take(self, message: str | bytes) -> None:
        if isinstance(message, str):
            self._take_text(message)
        elif len(message) >= _DATA.size and message[0] == 1:
            _, number, sent_ns = _DATA.unpack_from(message)
            topic = self._topic_of.get(number)
            if topic is not None:
                self._on_message(topic, message[_DATA.size :], sent_ns)

    def _take_text(self, text: str) -> None:
        try:
            said = json.loads(text)
            op = said.get("op")
            changed = op in ("advertise", "unadvertise")
            if op == "advertise":
                found = {int(one["id"]): (str(one["topic"]), str(one["schemaName"])) for one in said["channels"]
                         if one.get("encoding") == "cdr"}  # fmt: skip
                if len(found) + len(self._channels) <= MAX_CHANNELS:
                    self._channels |= found
            elif op == "unadvertise":
                for number in said["channelIds"]:
                    self._channels.pop(int(number), None)
                    self._topic_of.pop(int(number), None)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            return  # what cannot be read is not meant for us
        if changed:
            # Types as ROS 2 names them: pkg/msg/Type.
            self._on_topics({
                topic: kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
                for topic, kind in self._channels.values()
            })  # fmt: skip
            with self._lock:
                self._subscribe()

    def _subscribe(self) -> None:
        """Subscribe to the wanted channels that are not subscribed to; their numbers are those of the channels."""
        new = {number: topic for number, (topic, _) in self._channels.items()
               if topic in self._wanted and number not in self._topic_of}  # fmt: skip
        if new:
            self._topic_of |= new
            self._send(json.dumps({"op": "subscribe", "subscriptions": [{"id": n, "channelId": n} for n in new]}))

    def _advertise(self, topic: str) -> None:
        number, kind = self._published[topic]
        channel: dict[str, Any] = {"id": number, "topic": topic, "encoding": "cdr", "schemaName": kind}
        self._send(json.dumps({"op": "advertise", "channels": [channel]}))

    def _send(self, data: str | bytes) -> bool:
        if self._socket is None:
            return False
        try:
            self._socket.send(data)
        except (OSError, WebSocketException):
            return False
        return True


ZENOH_PORT = 7447
"""Of the router."""
LATCHED_LAST = 100
"""Last messages of a latched topic that are asked for: several publishers share /tf_static."""
ZENOH_RETRY_S = 3.0
_ATTACHMENT = struct.Struct("<qqB")


class ZenohLink(RobotLink):
    """A connection to the Zenoh router of a robot; Zenoh connects again by itself."""

    def __init__(self, address: str) -> None:
        """Take an address: zenoh://HOST:PORT, or zenoh://HOST:PORT/DOMAIN for a ROS domain other than 0.

        Raises:
            InputError: it is none, or the extra is missing.
        """
        super().__init__(address)
        with needs_extra("ros2", "zenoh://"):
            import zenoh  # noqa: PLC0415 - only robots without a bridge need it
            import zenoh.ext  # noqa: PLC0415 - as above
        try:
            parts = urlsplit(address)
            host, port, domain = parts.hostname, parts.port or ZENOH_PORT, int(parts.path.strip("/") or 0)
        except ValueError:
            host, port, domain = None, 0, 0
        if not host or not 0 <= domain <= 232:
            raise InputError(f"{address}: expected zenoh://HOST:PORT or zenoh://HOST:PORT/DOMAIN")
        self._zenoh, self._domain = zenoh, domain
        self._endpoint = f"tcp/{f'[{host}]' if ':' in host else host}:{port}"
        self._session: Any = None
        self._declared: list[Any] = []
        self._topics: dict[str, str] = {}
        self._services: dict[str, tuple[str, str]] = {}
        self._subscribed: set[str] = set()
        self._kinds: dict[str, str] = {}
        self._publishers: dict[str, Any] = {}
        self._sent, self._gid = 0, os.urandom(16)

    def advertise(self, topic: str, kind: str) -> None:
        """Announce that a topic will be published; late subscribers get its last message."""
        with self._lock:
            self._kinds[topic] = kind
            if self._session is not None:
                self._publisher(topic)

    def publish(self, topic: str, data: bytes) -> bool:
        """Publish CDR bytes; False when there is no connection."""
        with self._lock:
            if self._session is None or self._state:
                return False
            try:
                self._publisher(topic).put(data, attachment=self._attachment())
            except self._zenoh.ZError:
                return False
            return True

    @property
    def services(self) -> dict[str, tuple[str, str]]:
        """Return {service: (type, its hash)} of what is announced."""
        return dict(self._services)

    def call(self, service: str, request: bytes, take: OnReply, timeout_s: float) -> bool:
        """Call a service with CDR bytes, and ``take`` its answer, then None; False when it is not there."""
        zenoh = self._zenoh
        with self._lock:
            if self._session is None or self._state or service not in self._services:
                return False
            key = "/".join((str(self._domain), service.strip("/"), *self._services[service]))
            heard = lambda reply: take(bytes(reply.ok.payload)) if reply.ok is not None else None  # noqa: E731
            try:
                self._session.get(
                    key, zenoh.handlers.Callback(heard, lambda: take(None)), payload=request,
                    attachment=self._attachment(), target=zenoh.QueryTarget.ALL_COMPLETE,
                    consolidation=zenoh.ConsolidationMode.NONE, timeout=timeout_s,
                )  # fmt: skip
            except zenoh.ZError:
                return False
            return True

    def _attachment(self) -> bytes:
        """Return that of the next message; servers tell requests apart by its number."""
        self._sent += 1
        return _ATTACHMENT.pack(self._sent, time.time_ns(), len(self._gid)) + self._gid

    def _run(self) -> None:
        config = self._zenoh.Config()
        # A client: routers do not forward between peers.
        for key, value in {"mode": "client", "connect/endpoints": [self._endpoint],
                           "scouting/multicast/enabled": False, "listen/endpoints": [],
                           "timestamping/enabled": {"client": True}}.items():  # fmt: skip
            config.insert_json5(key, json.dumps(value))
        session: Any = None
        while not self._closed.is_set() and session is None:
            try:
                session = self._zenoh.open(config)
            except self._zenoh.ZError as error:
                self._state = f"no connection, trying again: {one_line(error)}"
                self._closed.wait(ZENOH_RETRY_S)
                continue
            with self._lock:
                self._session, self._state = session, ""  # a client's session opens when its router has answered
                tokens = f"@ros2_lv/{self._domain}/**"
                watch = session.liveliness().declare_subscriber(tokens, self._token, history=True)
                self._declared.append(watch)
                for topic in self._kinds:
                    self._publisher(topic)
                self._subscribe()
        while session is not None and not self._closed.wait(0.2):
            there = bool(list(session.info.routers_zid()))
            self._state = "" if there else "connection lost, trying again"
        with self._lock:
            self._session = None
        if session is not None:
            session.close()

    def _token(self, sample: Any) -> None:
        """Take the token of a publisher or a service that comes or goes."""
        key, comes = str(sample.key_expr), sample.kind == self._zenoh.SampleKind.PUT
        try:
            if (found := service_of(key)) is not None:
                with self._lock:
                    if not comes:
                        self._services.pop(found[0], None)
                    elif len(self._services) < MAX_CHANNELS:
                        self._services[found[0]] = found[1:]
                return
            topic, kind = publisher_of(key)
        except ValueError:
            return  # something else, or none of ROS
        with self._lock:
            new = comes and topic not in self._topics
            if new and len(self._topics) < MAX_CHANNELS:
                self._topics = self._topics | {topic: kind}
                self._subscribe()
            topics = self._topics
        if new:
            self._on_topics(topics)

    def _subscribe(self) -> None:
        if self._session is None:
            return
        ext = self._zenoh.ext
        for topic in (*self._wanted, *self._listeners):
            if topic in self._subscribed:
                continue
            self._subscribed.add(topic)

            def take(sample: Any, topic: str = topic) -> None:
                if topic in self._listeners:
                    self._listeners[topic](bytes(sample.payload))
                    return
                attachment = bytes(sample.attachment) if sample.attachment is not None else b""
                sent_ns = _ATTACHMENT.unpack_from(attachment)[1] if len(attachment) >= _ATTACHMENT.size else 0
                self._on_message(topic, bytes(sample.payload), sent_ns)

            # Latched topics are asked for what was published before; the others answer with nothing.
            key = f"{self._domain}/{topic.strip('/')}/*/*"
            history = ext.HistoryConfig(detect_late_publishers=True, max_samples=LATCHED_LAST)
            recovery = ext.RecoveryConfig(heartbeat=True)
            self._declared.append(
                ext.declare_advanced_subscriber(self._session, key, take, history=history, recovery=recovery)
            )

    def _publisher(self, topic: str) -> Any:
        """Return the publisher of a topic, declared with a token, so that ROS sees it."""
        if topic not in self._publishers:
            ext, session, kind = self._zenoh.ext, self._session, self._kinds[topic]
            dds, type_hash = dds_name(kind), message_types().hash_rihs01(kind)
            number = 10 + len(self._publishers)
            node = f"@ros2_lv/{self._domain}/{session.info.zid()}/0"
            ends = [f"{node}/{number}/MP/%/%/simaps/{topic.replace('/', '%')}/{dds}/{type_hash}/:1:,1:,:,:,,"]
            if not self._publishers:
                ends.append(f"{node}/0/NN/%/%/simaps")
            self._declared += [session.liveliness().declare_token(end) for end in ends]
            self._publishers[topic] = ext.declare_advanced_publisher(
                session, f"{self._domain}/{topic.strip('/')}/{dds}/{type_hash}", cache=ext.CacheConfig(1),
                sample_miss_detection=ext.MissDetectionConfig(sporadic_heartbeat=0.5), publisher_detection=True,
            )  # fmt: skip
        return self._publishers[topic]


def dds_name(kind: str) -> str:
    """Return how rmw_zenoh names a type: "std_msgs::msg::dds_::String_" for "std_msgs/msg/String"."""
    package, folder, name = kind.split("/")
    return f"{package}::{folder}::dds_::{name}_"


def publisher_of(token: str) -> tuple[str, str]:
    """Return topic and type of a publisher's token; raises ValueError for other tokens."""
    parts = _parts(token, "MP")
    if not parts:
        raise ValueError("no token of a publisher")
    names = parts[10].split("::")
    if len(names) != 4 or names[2] != "dds_" or not names[3].endswith("_"):
        raise ValueError("no type of ROS")
    return parts[9].replace("%", "/"), f"{names[0]}/{names[1]}/{names[3][:-1]}"


def service_of(token: str) -> tuple[str, str, str] | None:
    """Return name, type and hash of a service's token, the type as its keys have it; None for other tokens."""
    parts = _parts(token, "SS")
    return (parts[9].replace("%", "/"), parts[10], parts[11]) if parts else None


def _parts(token: str, kind: str) -> list[str]:
    """Return the 13 parts of a token of a kind; none where it is another one."""
    parts = token.split("/")
    return parts if len(parts) == 13 and parts[0] == "@ros2_lv" and parts[5] == kind else []
