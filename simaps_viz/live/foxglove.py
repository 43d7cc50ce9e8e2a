"""A robot that runs foxglove_bridge: its topics over a WebSocket, with any version of ROS 2 and any middleware.

The protocol (Foxglove WebSocket, version 1): the server announces channels as JSON; messages are binary: a byte 1, the
subscription's number (u32), the time it was sent (u64, ns), then the message as CDR. All numbers are little-endian.
"""

import json
import struct
import time
from typing import Any
from urllib.parse import urlsplit

from websockets.exceptions import InvalidHandshake, WebSocketException
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from simaps_viz.errors import InputError, one_line
from simaps_viz.live.robot import RobotLink

PROTOCOLS = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
"""Of newer and older bridges; each refuses the other's alone."""
PORT = 8765
MAX_MESSAGE = 64 << 20
"""Bytes; a depth picture of 4K has 16 MB."""
MAX_CHANNELS = 5000
OPEN_S = 5.0
RETRY_S = (0.2, 4.0)
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
            host, port = parts.hostname, parts.port or PORT
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
            self._closed.wait(RETRY_S[time.monotonic() - lost_s > SOON_S])

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
