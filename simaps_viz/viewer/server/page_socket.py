"""A page's WebSocket: which messages it may send, how large and how many, and how they reach viser.

viser itself would take any of its 120 messages from a page, and with `GuiUpdateMessage` any attribute of a widget.
Anything but the eight kinds below is dropped before viser sees it.
"""

import contextlib
import logging
import socket
import threading
import time
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct
from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.server import ServerProtocol
from websockets.typing import Subprotocol
from websockets.uri import parse_uri

logger = logging.getLogger(__name__)

MAX_MESSAGE = 1 << 20
"""Bytes; the largest honest ones are parts of an uploaded file, of 512 KiB."""
MAX_UPLOAD = 256 << 20
"""Bytes of one file, and of all that one page has uploaded or is uploading."""
MAX_UPLOADING = 1 << 30
"""Bytes, of all pages together."""
MAX_TRANSFERS = 16
"""Files that one page uploads at a time."""
QUIET_S = 40.0
"""A page that sends nothing for so long, not even an answer to viser's pings every 20 s, has gone."""
MESSAGES_PER_S, BURST = 400.0, 1200
"""A page that sends more is heard later, not less."""
MAX_FAULTS = 20
"""A page that sends so many messages that no page sends is shown out."""
MAX_HEAD = 16_384
CHUNK_BYTES = 1 << 18
KEY_HEADER, ROLE_HEADER = "Simaps-Key", "Simaps-Role"
"""What the front door tells viser of a page. Nothing that a page puts into its headers is passed on."""

Name = Annotated[str, Meta(max_length=256)]
Text = Annotated[str, Meta(max_length=100_000)]
Number = Annotated[float, Meta(ge=-1e12, le=1e12)]
Count = Annotated[int, Meta(ge=0, le=MAX_UPLOAD)]
Pixels = Annotated[int, Meta(ge=0, le=65_536)]
Vector = tuple[Number, Number, Number]
Modifier = Name | None
Items = Annotated[list[bool | int | Number | Name | None], Meta(max_length=64)]


class _Message(Struct, tag_field="type", forbid_unknown_fields=True):
    pass


class _ViewerCamera(_Message, tag="ViewerCameraMessage"):  # where the page's camera is
    wxyz: tuple[Number, Number, Number, Number]
    position: Vector
    fov: Number
    near: Number
    far: Number
    image_height: Pixels
    image_width: Pixels
    look_at: Vector
    up_direction: Vector


class _Change(Struct, forbid_unknown_fields=True):
    value: bool | Annotated[int, Meta(ge=-(1 << 40), le=1 << 40)] | Number | Text | Items | None


class _GuiUpdate(_Message, tag="GuiUpdateMessage"):  # a widget has another value
    uuid: Name
    updates: _Change


class _GuiButtonHold(_Message, tag="GuiButtonHoldMessage"):  # a button is held down
    uuid: Name
    frequency: Number


class _CommandTrigger(_Message, tag="CommandTriggerMessage"):  # a key was pressed, or a command chosen
    uuid: Name


class _ScenePointer(_Message, tag="ScenePointerMessage"):  # the scene was clicked
    event_type: Literal["click", "rect-select"]
    ray_origin: Vector | None
    ray_direction: Vector | None
    screen_pos: Annotated[list[tuple[Number, Number]], Meta(max_length=2)]
    modifier: Modifier


class _SceneNodeClick(_Message, tag="SceneNodeClickMessage"):  # something in the scene was clicked
    name: Name
    instance_index: int | None
    ray_origin: Vector
    ray_direction: Vector
    screen_pos: tuple[Number, Number]
    modifier: Modifier
    owner: Name = ""


class _UploadStart(_Message, tag="FileTransferStartUpload"):  # a file is about to be uploaded
    source_component_uuid: Name
    transfer_uuid: Name
    filename: Name
    mime_type: Name
    part_count: Annotated[int, Meta(ge=0, le=65_536)]
    size_bytes: Count


class _UploadPart(_Message, tag="FileTransferPart"):  # a part of an uploaded file
    source_component_uuid: Name | None
    transfer_uuid: Name
    part_index: Annotated[int, Meta(ge=0, le=65_536)]
    content: bytes


_DECODER = msgspec.msgpack.Decoder(
    _ViewerCamera | _GuiUpdate | _GuiButtonHold | _CommandTrigger | _ScenePointer | _SceneNodeClick
    | _UploadStart | _UploadPart
)  # fmt: skip


class Uploads:
    """How many bytes all pages together hold, or have announced, in uploaded files."""

    def __init__(self, most: int = MAX_UPLOADING) -> None:
        self._most, self._taken, self._lock = most, 0, threading.Lock()

    def take(self, size: int) -> bool:
        """Set some bytes aside; False when there are not so many left."""
        with self._lock:
            fits = self._taken + size <= self._most
            self._taken += size if fits else 0
            return fits

    def release(self, size: int) -> None:
        """Return the bytes."""
        with self._lock:
            self._taken -= size

    @property
    def taken(self) -> int:
        """Bytes."""
        return self._taken


class _Transfer(Struct):
    component: str
    size: int
    parts: int
    left: int


class Listener:
    """Checks every message of one page."""

    def __init__(self, uploads: Uploads) -> None:
        """Create the checks of a page, with the upload budget that all pages share."""
        self._uploads = uploads
        self._transfers: dict[str, _Transfer] = {}
        self._closed = False

    def fault(self, raw: str | bytes) -> str | None:
        """Return the fault of a message; None when a page may send it."""
        if not isinstance(raw, bytes):
            return "text, where pages send msgpack"
        try:
            message = _DECODER.decode(raw)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            return str(error)[:200]
        if isinstance(message, _UploadStart):
            return self._start(message)
        return self._part(message) if isinstance(message, _UploadPart) else None

    def close(self) -> None:
        """Release the budget of its uploads: the page was closed, and viser has dropped them."""
        self._closed = True
        for transfer in self._transfers.values():
            self._uploads.release(transfer.size)
        self._transfers.clear()

    def _start(self, message: _UploadStart) -> str | None:
        if self._closed:  # data that was still being sent
            return "an upload of a page that has gone"
        if message.transfer_uuid in self._transfers or (message.part_count == 0) != (message.size_bytes == 0):
            return "an upload that contradicts itself"
        for name, one in list(self._transfers.items()):  # a newer file takes the place of one that is complete
            if one.component == message.source_component_uuid and one.parts == 0:
                self._uploads.release(self._transfers.pop(name).size)
        size, mine = message.size_bytes, sum(one.size for one in self._transfers.values())
        if len(self._transfers) >= MAX_TRANSFERS or mine + size > MAX_UPLOAD:
            return f"an upload of {size} bytes, more than a page may"
        if not self._uploads.take(size):
            return f"an upload of {size} bytes, more than there is room for now"
        transfer = _Transfer(message.source_component_uuid, size, message.part_count, size)
        self._transfers[message.transfer_uuid] = transfer
        return None

    def _part(self, message: _UploadPart) -> str | None:
        transfer = self._transfers.get(message.transfer_uuid)
        if transfer is None or transfer.parts == 0 or len(message.content) > transfer.left:
            return "a part of no upload that was announced"
        transfer.parts -= 1
        transfer.left -= len(message.content)
        return None


class PageSocket:
    """One page's WebSocket, relayed to viser.

    What viser sends goes to the page byte by byte, as it comes. What the page sends is taken apart into messages, and
    only those that a page sends go on to viser. Each side is read no faster than the other takes it.
    """

    def __init__(
        self,
        page: socket.socket,
        read: Callable[[float], bytes],
        uploads: Uploads,
        note: Callable[[str], None],
    ) -> None:
        """Take the connection of a page.

        Args:
            page: to write to.
            read: returns what has come from the page, at most so many seconds later (TimeoutError); empty at its end.
            uploads: what all pages share.
            note: told what is refused.
        """
        self._page, self._read, self._note = page, read, note
        self._listener = Listener(uploads)
        self._parts: list[bytes] = []
        self._text, self._faults = False, 0
        self._credit, self._filled = float(BURST), time.monotonic()

    def run(self, head: bytes, port: int, version: str, credentials: Mapping[str, str]) -> None:
        """Relay until one of the two sides hangs up.

        Args:
            head: of the page's request, as it came.
            port: of viser, on 127.0.0.1.
            version: of viser's protocol.
            credentials: headers for viser's port: the key it asks for, and the role of the page.
        """
        protocols = [Subprotocol(version)]
        self._protocol = ServerProtocol(subprotocols=protocols, max_size=MAX_MESSAGE, logger=_SILENT)
        self._protocol.receive_data(head)
        requests = self._protocol.events_received()
        if not requests:
            return
        response = self._protocol.accept(requests[0])  # pyright: ignore[reportArgumentType] - the first is the request
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=QUIET_S) as viser:
                begun = _join_viser(viser, port, protocols, credentials) if response.status_code == 101 else b""
                self._protocol.send_response(response)
                self._page.sendall(b"".join(self._protocol.data_to_send()))
                if response.status_code == 101:
                    self._relay(viser, begun)
        except OSError:  # either side has closed the connection
            return
        finally:
            self._listener.close()

    def _relay(self, viser: socket.socket, begun: bytes) -> None:
        viser.settimeout(None)
        down = threading.Thread(target=self._to_page, args=(viser, begun), name="to-page", daemon=True)
        down.start()
        try:
            while data := self._read(QUIET_S):
                self._protocol.receive_data(data)
                for frame in self._protocol.events_received():
                    if isinstance(frame, Frame):
                        self._take(frame, viser)
                answer = b"".join(self._protocol.data_to_send())  # to pings and farewells, which viser answers itself
                if self._protocol.parser_exc is not None or self._faults > MAX_FAULTS:
                    self._page.sendall(answer)
                    return
        finally:
            _hang_up(viser)
            _hang_up(self._page)
            down.join()

    def _to_page(self, viser: socket.socket, part: bytes) -> None:
        """Pass on what viser sends."""
        try:
            self._page.sendall(part)
            while part := viser.recv(CHUNK_BYTES):
                self._page.sendall(part)
        except OSError:
            pass
        finally:  # wakes who reads from the page
            _hang_up(self._page)

    def _take(self, frame: Frame, viser: socket.socket) -> None:
        """Pass on a control frame, or the message that is complete with this frame, if a page sends such."""
        if frame.opcode in (Opcode.PING, Opcode.PONG, Opcode.CLOSE):
            viser.sendall(frame.serialize(mask=True))
            return
        if frame.opcode is not Opcode.CONT:
            self._text = frame.opcode is Opcode.TEXT
        self._parts.append(bytes(frame.data))
        if not frame.fin or self._faults > MAX_FAULTS:
            return
        raw, self._parts = b"".join(self._parts), []
        self._pace()
        fault = self._listener.fault("" if self._text else raw)
        if fault is None:
            viser.sendall(Frame(Opcode.BINARY, raw).serialize(mask=True))
            return
        logger.debug("dropped: %r", fault)
        self._note("a message that no page sends")
        self._faults += 1
        if self._faults > MAX_FAULTS:
            self._protocol.fail(1008, "not the messages of a page")

    def _pace(self) -> None:
        """Wait, where the page has sent too much lately."""
        now = time.monotonic()
        self._credit = min(float(BURST), self._credit + (now - self._filled) * MESSAGES_PER_S) - 1.0
        self._filled = now
        if self._credit < 0.0:
            time.sleep(-self._credit / MESSAGES_PER_S)


_SILENT = logging.getLogger(f"{__name__}.websockets")  # it would write complete requests, with their tokens
_SILENT.setLevel(logging.CRITICAL + 1)


def read_head(connection: socket.socket) -> tuple[bytes, bytes]:
    """Read the head of an HTTP response: the part before its blank line, and any bytes received after it.

    Raises:
        OSError: there is none.
    """
    received = b""
    while b"\r\n\r\n" not in received:
        part = connection.recv(MAX_HEAD)
        if not part or len(received) > MAX_HEAD:
            raise ConnectionError("expected an answer over HTTP, found none")
        received += part
    head, _, rest = received.partition(b"\r\n\r\n")
    return head, rest


def _join_viser(viser: socket.socket, port: int, protocols: list[Subprotocol], credentials: Mapping[str, str]) -> bytes:
    """Open viser's WebSocket; returns what it has already sent over it.

    Raises:
        OSError: viser does not accept it.
    """
    viser.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    client = ClientProtocol(parse_uri(f"ws://127.0.0.1:{port}/"), subprotocols=protocols, logger=_SILENT)
    request = client.connect()
    request.headers.update(credentials)
    client.send_request(request)
    viser.sendall(b"".join(client.data_to_send()))
    head, rest = read_head(viser)
    client.receive_data(head + b"\r\n\r\n")
    if client.state is not State.OPEN:
        raise ConnectionError("viser: expected it to accept a page, found that it does not")
    return rest


def _hang_up(connection: socket.socket) -> None:
    """Wake whoever reads from or writes to a connection; it may be closed already."""
    with contextlib.suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
