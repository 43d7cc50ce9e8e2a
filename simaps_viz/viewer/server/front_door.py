"""The one port of a workbench.

Whatever a browser asks for comes in here, is checked here, and is answered from

- ``/tab/…``, ``/rerun/…``, ``/recordings/…``: the pages in the frames, their files and their events (`Host`);
- ``/rerun.sdk_comms…``: the live stream of a build, from rerun's own server on 127.0.0.1;
- everything else, and the page's WebSocket: viser, on a private port of 127.0.0.1.

It is Python's HTTP server with bounds: so many connections, so long for a request to arrive, IPv6 as well. And it is
stricter: a request that two programs could read as two different ones (request smuggling) is refused, and its
connection closed, so that nothing of it is taken for the next one.
"""

import contextlib
import errno
import gzip
import http.client
import io
import json
import logging
import queue
import re
import secrets
import select
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import parse_qs, unquote, urlsplit

from simaps_viz.errors import InputError
from simaps_viz.viewer.server.access import ENTERED, ENTERED_CSP, SAFE_HEADERS, Access, headers_of, without_query
from simaps_viz.viewer.server.host import Asset, Host, parse_range, read_event
from simaps_viz.viewer.server.page_socket import KEY_HEADER, ROLE_HEADER, PageSocket, Uploads, read_head
from simaps_viz.viewer.server.viser_page import covered, page_policy

logger = logging.getLogger(__name__)

MAX_CONNECTIONS, MAX_OF_ADDRESS, MAX_PAGES = 256, 192, 64
"""Connections of any kind, those of one address, and pages."""
MAX_TRIED = 1000
"""Ports that are tried in the place of one that is taken, as viser does."""
MAX_EVENT_BYTES = 65_536
REQUEST_S = 10.0
"""How long a request may take to arrive, and a connection may be kept without one."""
WRITE_S = 30.0
"""How long a client may read nothing of what is sent to it, seconds."""
HEARTBEAT_S = 2.0
CHUNK_BYTES = 1 << 20
STREAM_ROUTE = "/rerun.sdk_comms.v1alpha1.MessageProxyService/Read"
"""Where rerun's web viewer reads a live recording; its server would also let anybody write into it."""

_REQUEST_LINE = re.compile(rb"[A-Z]+ [!-~]+ HTTP/1\.[01]\r\n")
_HEADER_LINE = re.compile(rb"[!#$%&'*+.^_`|~0-9A-Za-z-]+:[\t -~\x80-\xff]*\r\n")
"""RFC 9112: no blank before the colon, no line that continues the one before it, no bare carriage return."""


@dataclass(frozen=True)
class Viser:
    """Where viser listens on 127.0.0.1, and the key it asks for."""

    port: int
    version: str
    """Version of its protocol; a page of another version is to be loaded again."""
    key: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    """Connections to its private port are refused without this key, see `viser_hooks.admit_only`."""


class FrontDoor:
    """Listens from construction, answers from ``start`` until ``close``."""

    def __init__(self, access: Access | None = None, port: int = 0, *, tried: int = MAX_TRIED) -> None:
        """Listen.

        Args:
            access: where to listen and whom to answer; by default this machine.
            port: the next free one when it is taken; 0 for any.
            tried: after so many taken ports give up.

        Raises:
            InputError: no port is free, or the address is not one of this machine.
        """
        self.access = access or Access(token="")
        self.hosts: dict[str, Host] = {}
        self.viser: Viser | None = None
        self.stream_port: int | None = None
        self.uploads = Uploads()
        self.refused: Counter[str] = Counter()
        self.pages = 0
        self._lock = threading.Lock()
        self._server = self._listen(port, tried)
        self.port = self._server.server_port
        # How often it looks whether it is to end is how long ``close`` takes.
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), name="front-door", daemon=True)

    def start(
        self, hosts: Sequence[Host], *, viser: Viser | None = None, stream_port: int | None = None
    ) -> "FrontDoor":
        """Start to serve; returns this object.

        Args:
            hosts: of the frames; the first one's page is what the bare address leads to, where there is no viser.
            viser: where the page comes from.
            stream_port: of rerun's server on 127.0.0.1, whose live recording may be read.
        """
        self.hosts = {host.root: host for host in hosts}
        self.viser, self.stream_port = viser, stream_port
        self._thread.start()
        return self

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.access.name}:{self.port}{'' if self.viser else self.home}"

    @property
    def home(self) -> str:
        """Path of the page."""
        return "/" if self.viser or not self.hosts else f"/{next(iter(self.hosts))}/"

    @property
    def entrance(self) -> str:
        """Address of the page with the token, where one is asked for."""
        return self._with(self.access.token) if self.access.token else self.url

    @property
    def owner_entrance(self) -> str:
        """Address that makes an owner of who opens it; `entrance` where all have the same role."""
        return self._with(self.access.owner_token) if self.access.owner_token else self.entrance

    def _with(self, token: str) -> str:
        return f"http://{self.access.name}:{self.port}{self.home}?token={token}"

    def close(self) -> None:
        """Stop serving and free the port."""
        for host in self.hosts.values():
            host.push(None)  # ends the connections over which pages listen
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join(timeout=5.0)
        self._server.server_close()

    def note(self, why: str) -> None:
        """Log that something was refused: the first of a kind, and then every hundredth."""
        with self._lock:
            self.refused[why] += 1
            count, kinds = self.refused[why], len(self.refused)
        if count % 100 == 1 and kinds < 1000:
            logger.warning("refused: %s (%d times)", why, count)

    @property
    def connections(self) -> int:
        """How many are open."""
        return self._server.connections

    @contextlib.contextmanager
    def one_more_page(self) -> Iterator[bool]:
        """Count a page; False when there are too many."""
        with self._lock:
            welcome = self.pages < MAX_PAGES
            self.pages += welcome
        try:
            yield welcome
        finally:
            with self._lock:
                self.pages -= welcome

    def recording(self, name: str) -> Path | None:
        """Return the file that is served under a name; None if there is none."""
        return next((host.recordings[name] for host in self.hosts.values() if name in host.recordings), None)

    def _listen(self, port: int, tried: int) -> "_Server":
        handler = type("BoundHandler", (_Handler,), {"door": self})
        for candidate in range(port, min(port + tried, 65536)):
            try:
                return _Server(self.access.host, candidate, handler, self.note)
            except OSError as error:
                if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                    why = f"expected an address of this machine and a port to listen on, found {self.access.host}"
                    raise InputError(f"{why}, {candidate} ({error.strerror})") from error
        raise InputError(f"port {port}: expected a free one, found it taken, as are the {tried - 1} after it")


class _Server(ThreadingHTTPServer):
    """One thread for each connection, up to a maximum number; further connections are closed at once."""

    daemon_threads = True
    request_queue_size = 64

    def __init__(self, host: str, port: int, handler: type[BaseHTTPRequestHandler], note: Any) -> None:
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._open: Counter[str] = Counter()
        self._counting, self._note = threading.Lock(), note
        super().__init__((host, port), handler)

    @property
    def connections(self) -> int:
        return self._open.total()

    def server_bind(self) -> None:
        """Bind without looking up this machine's host name, which can take seconds."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start the thread of a connection, unless there are too many."""
        peer = str(client_address[0])
        with self._counting:
            welcome = self._open.total() < MAX_CONNECTIONS and self._open[peer] < MAX_OF_ADDRESS
            self._open[peer] += welcome
        if welcome:
            super().process_request(request, client_address)
        else:
            self._note("too many connections")
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, and count it no longer."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            peer = str(client_address[0])
            with self._counting:
                self._open[peer] -= 1
                if self._open[peer] <= 0:
                    del self._open[peer]

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log nothing: connections break off."""


class _Handler(BaseHTTPRequestHandler):
    """One connection; it is closed when a request takes longer than `REQUEST_S` to arrive."""

    protocol_version = default_request_version = "HTTP/1.1"
    server_version, sys_version = "simaps", ""
    disable_nagle_algorithm = True
    raw_requestline: bytes
    door: FrontDoor

    # Reading requests

    def setup(self) -> None:
        """Read through a deadline."""
        super().setup()
        self.rfile.close()
        self.connection.settimeout(WRITE_S)
        self._incoming = _Incoming(self.connection)
        self.rfile = io.BufferedReader(self._incoming)

    def handle_one_request(self) -> None:
        """Allow the next request its time."""
        self._incoming.deadline = time.monotonic() + REQUEST_S
        try:
            super().handle_one_request()
        except (OSError, ValueError):
            self.close_connection = True

    def parse_request(self) -> bool:
        """Read the head of a request; refuse one that violates the standard or whose body has an invalid length."""
        stream, head = self.rfile, _Head(self.rfile)
        self.rfile = head
        try:
            fine = super().parse_request()
        finally:
            self.rfile = stream
        if not fine:
            return False
        *fields, end = head.lines
        self._head = b"".join((self.raw_requestline, *head.lines))
        exact = _REQUEST_LINE.fullmatch(self.raw_requestline) and end == b"\r\n"
        if exact and all(map(_HEADER_LINE.fullmatch, fields)) and self._has_one_length():
            return True
        self.send_error(400)
        return False

    def _has_one_length(self) -> bool:
        """Return whether it is certain where the request ends: with its head, or a body of one length after a POST."""
        lengths = self.headers.get_all("Content-Length", [])
        if self.headers.get_all("Transfer-Encoding"):
            return False
        if self.command == "POST":
            return len(lengths) == 1 and re.fullmatch("[0-9]{1,9}", lengths[0]) is not None
        return lengths in ([], ["0"])

    def log_message(self, format: str, *args: Any) -> None:
        logger.debug("%s", without_query(format % args))

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse malformed requests and methods that are not implemented."""
        if code == HTTPStatus.NOT_IMPLEMENTED:
            self._refuse_method()
        else:
            self.close_connection = True
            self._refuse(code, HTTPStatus(code).phrase)

    # Answering

    def do_GET(self) -> None:
        upgrades = "Upgrade" in self.headers
        if not self._welcome(writes=upgrades):
            return
        path = unquote(urlsplit(self.path).path)
        root, slash, name = path[1:].partition("/")
        host = self.door.hosts.get(root) if slash else None
        if upgrades:
            self._join()
        elif host is not None and name == "events":
            self._send_events(host)
        elif host is not None and name == "":
            page = host.page.encode(), "text/html; charset=utf-8"
            self._send_asset(page, cache="no-store", csp=host.csp)
        elif host is not None and name in host.assets:
            self._send_asset(host.assets[name], cache="max-age=86400", csp=host.csp)
        elif host is None and root == "recordings" and (file := self.door.recording(name)) is not None:
            self._send_asset((file, "application/octet-stream"), cache="no-store")
        elif host is None and self.door.viser is not None:
            self._send_from_viser(self.door.viser)
        elif path == "/":
            self.send_response(302)
            self._send_headers("text/plain", 0, "no-store", Location=self.door.home)
        else:
            self._refuse(404, "no such page")

    def do_POST(self) -> None:
        path, length = urlsplit(self.path).path, int(self.headers["Content-Length"])  # it has one, see `parse_request`
        root, _, name = path[1:].partition("/")
        host = self.door.hosts.get(root) if name == "event" else None
        streams = self.door.stream_port is not None and path.startswith(STREAM_ROUTE)
        if host is None and not streams:
            self._refuse_method()
            return
        if not self._welcome(writes=True):
            return
        if length > MAX_EVENT_BYTES:
            self.close_connection = True
            self._refuse(400, "not an event")
            return
        body = self.rfile.read(length)
        if host is None:
            self._send_stream(body)
            return
        try:
            event = read_event(body)
        except (ValueError, RecursionError):
            self._refuse(400, "not JSON")
            return
        answer = host.handle(event, self._session())
        self._send_asset((json.dumps(answer).encode(), "application/json"), cache="no-store")

    def _session(self) -> str:
        return parse_qs(urlsplit(self.path).query).get("session", [""])[0]

    def _welcome(self, *, writes: bool) -> bool:
        """Refuse requests under a foreign host name (DNS rebinding), from other sites' pages, or without the token."""
        access, headers = self.door.access, headers_of(self.headers.items())
        own, peer = str(self.connection.getsockname()[0]), str(self.client_address[0])
        refusal = access.refuse(headers, self.path, own_address=own, peer=peer, writes=writes)
        if refusal is not None:
            self.close_connection = True
            self.door.note(refusal[1])
            self._refuse(*refusal)
            return False
        cookie = None if writes else access.entering(headers, self.path)
        if cookie is None:
            return True
        root = urlsplit(self.path).path[1:].partition("/")[0]
        body = ENTERED.format(path=f"/{root}/" if root in self.door.hosts else "/").encode()
        self.send_response(200)
        self._send_headers("text/html; charset=utf-8", len(body), "no-store", **cookie)
        self.wfile.write(body)
        return False

    def _refuse_method(self) -> None:
        self.close_connection = True
        self.door.note("a request that is no GET")
        self.send_response(405)
        self._send_headers("text/plain", 0, "no-store", Allow="GET")

    def _refuse(self, status: int, why: str) -> None:
        body = why.encode()
        self.send_response(status)
        self._send_headers("text/plain", len(body), "no-store")
        self.wfile.write(body)

    def _send_headers(
        self, media_type: str, length: int | None, cache: str, csp: str = ENTERED_CSP, **others: str
    ) -> None:
        own = {"Content-Type": media_type, "Content-Security-Policy": csp}
        for header, value in {**own, **SAFE_HEADERS, "Cache-Control": cache, **others}.items():
            self.send_header(header, value)
        if length is not None:
            self.send_header("Content-Length", str(length))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()

    def _send_asset(self, asset: Asset, *, cache: str, csp: str = ENTERED_CSP) -> None:
        """Send bytes or a file, or the requested range of the file."""
        content, media_type = asset
        size = len(content) if isinstance(content, bytes) else content.stat().st_size
        try:
            part = parse_range(self.headers.get("Range", ""), size)
        except ValueError as error:
            self._refuse(416, str(error))
            return
        first, last = part or (0, size - 1)
        self.send_response(206 if part else 200)
        self.send_header("Accept-Ranges", "bytes")
        if part:
            self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
        self._send_headers(media_type, last - first + 1, cache, csp)
        with BytesIO(content) if isinstance(content, bytes) else content.open("rb") as stream:
            stream.seek(first)
            self._copy(stream, last - first + 1)

    def _copy(self, stream: BinaryIO | BytesIO, length: int) -> None:
        try:
            while length > 0 and (part := stream.read(min(length, CHUNK_BYTES))):
                self.wfile.write(part)
                length -= len(part)
            if length > 0:  # the file has become shorter than was announced
                self.close_connection = True
        except OSError:  # the page was closed meanwhile
            self.close_connection = True

    def _send_events(self, host: Host) -> None:
        """Send pushed events to a session until either side closes the connection."""
        self.close_connection = True
        session = self._session()
        listener = host.listen(session)  # before the answer goes out: whoever has it must miss no message
        try:
            self.send_response(200)
            self._send_headers("text/event-stream", None, "no-store")
            host.on_listen(session)
            while True:
                try:
                    message = listener.get(timeout=HEARTBEAT_S)
                except queue.Empty:
                    self.wfile.write(b": alive\n\n")
                else:
                    if message is None:
                        return
                    self.wfile.write(f"data: {json.dumps(message)}\n\n".encode())
        except OSError:
            return
        finally:
            host.forget(listener)

    # Handing on

    def _send_from_viser(self, viser: Viser) -> None:
        """Send a file of viser's page; the page itself with our cover, and the policy that fits its scripts."""
        connection = http.client.HTTPConnection("127.0.0.1", viser.port, timeout=WRITE_S)
        try:
            connection.request("GET", urlsplit(self.path).path)
            reply = connection.getresponse()
            status, media_type, body = reply.status, reply.headers.get("Content-Type", "text/plain"), reply.read()
        except (OSError, http.client.HTTPException):
            self.close_connection = True
            self._refuse(HTTPStatus.BAD_GATEWAY, "the page is being closed")
            return
        finally:
            connection.close()
        csp, others = ENTERED_CSP, {}
        if status == HTTPStatus.OK and media_type.startswith("text/html"):
            csp = page_policy(self.headers["Host"].lower(), body)
            body = covered(body)
        if "gzip" in self.headers.get("Accept-Encoding", ""):
            body, others = _zipped(body), {"Content-Encoding": "gzip"}
        self.send_response(status)
        self._send_headers(media_type, len(body), "no-cache", csp, **others)
        self.wfile.write(body)

    def _send_stream(self, body: bytes) -> None:
        """Send on the live stream of a build, as it comes, until one of the two sides hangs up."""
        self.close_connection = True
        port = self.door.stream_port
        asked = {"host": f"127.0.0.1:{port}", "connection": "close", "content-length": str(len(body))}
        kept = ("content-type", "accept", "x-grpc-web", "x-user-agent", "grpc-timeout")
        asked |= {name: self.headers[name] for name in kept if name in self.headers}
        head = [f"POST {urlsplit(self.path).path} HTTP/1.1", *(f"{name}: {value}" for name, value in asked.items())]
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=WRITE_S) as rerun:
            rerun.sendall("\r\n".join((*head, "", "")).encode("latin-1") + body)
            first, _, fields = (answer := read_head(rerun))[0].decode("latin-1").partition("\r\n")
            named = [line.partition(":") for line in fields.split("\r\n") if line]
            self.send_response(int(first.split(" ")[1]))
            for name, _, value in named:
                if re.fullmatch("content-type|transfer-encoding|content-length|grpc-.*", name.lower()):
                    self.send_header(name, value.strip())
            for name, value in {**SAFE_HEADERS, "Cache-Control": "no-store", "Connection": "close"}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(answer[1])
            # What rerun sends is passed on; whatever the page says now ends it.
            while self.connection not in (ready := select.select([rerun, self.connection], [], [])[0]):
                if not ready or not (part := rerun.recv(CHUNK_BYTES)):
                    return
                self.wfile.write(part)

    def _join(self) -> None:
        """Connect a page's WebSocket to viser and check its messages, until either side closes the connection."""
        viser, why = self.door.viser, ""
        self.close_connection = True
        with self.door.one_more_page() as welcome:
            if viser is None or self.headers["Upgrade"].lower() != "websocket":
                why = "expected a WebSocket"
            elif self.headers.get("Sec-WebSocket-Protocol") != viser.version:
                why = "load the page again: it is of another version"
            elif welcome:
                self.log_request(101)
                role = self.door.access.role(headers_of(self.headers.items()), self.path)
                PageSocket(self.connection, self._read_page, self.door.uploads, self.door.note).run(
                    self._head, viser.port, viser.version, {KEY_HEADER: viser.key, ROLE_HEADER: role}
                )
                return
        status = HTTPStatus.BAD_REQUEST if why else HTTPStatus.SERVICE_UNAVAILABLE
        self.door.note(why or "too many open pages")
        self._refuse(status, why or "too many open pages")

    def _read_page(self, patience_s: float) -> bytes:
        self._incoming.deadline = time.monotonic() + patience_s
        return self.rfile.read1(1 << 16)


class _Head(io.BufferedIOBase):
    """Returns the lines of a request's head, and keeps them as they came."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.lines: list[bytes] = []

    def readline(self, size: int | None = -1, /) -> bytes:
        self.lines.append(self._stream.readline(size))
        return self.lines[-1]


class _Incoming(io.RawIOBase):
    """The bytes that the client sends, readable until a deadline."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self.deadline = 0.0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        self._connection.settimeout(max(0.001, self.deadline - time.monotonic()))
        try:
            return self._connection.recv_into(buffer)
        finally:
            self._connection.settimeout(WRITE_S)


@lru_cache(maxsize=4)
def _zipped(body: bytes) -> bytes:
    return gzip.compress(body, mtime=0)
