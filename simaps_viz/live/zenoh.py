"""A robot whose ROS 2 runs on rmw_zenoh: its topics without a bridge. Extra "ros2".

A topic's messages have the key DOMAIN/TOPIC/TYPE/HASH, with the type as "pkg::msg::dds_::Type_" and its RIHS01 hash
("TypeHashNotSupported" in Humble); so have queries, which are calls of services. Publishers and services are found by
their liveliness tokens, "@ros2_lv/…", in which "%" stands for "/". Every message carries an attachment: its number, the
time it was sent (ns), and the sender's id of 16 bytes.
"""

import json
import os
import struct
import time
from typing import Any
from urllib.parse import urlsplit

from simaps_viz.errors import InputError, needs_extra, one_line
from simaps_viz.live.robot import OnReply, RobotLink, message_types

PORT = 7447
"""Of the router."""
LATCHED_LAST = 100
"""Last messages of a latched topic that are asked for: several publishers share /tf_static."""
RETRY_S = 3.0
_ATTACHMENT = struct.Struct("<qqB")
MAX_TOPICS = 5000


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
            host, port, domain = parts.hostname, parts.port or PORT, int(parts.path.strip("/") or 0)
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
                self._closed.wait(RETRY_S)
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
                    elif len(self._services) < MAX_TOPICS:
                        self._services[found[0]] = found[1:]
                return
            topic, kind = publisher_of(key)
        except ValueError:
            return  # something else, or none of ROS
        with self._lock:
            new = comes and topic not in self._topics
            if new and len(self._topics) < MAX_TOPICS:
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
