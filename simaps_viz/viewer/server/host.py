"""A small web server beside the page: the recorded build, and messages to and from each tab."""

import errno
import json
import logging
import queue
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import parse_qs, quote, unquote, urlsplit

from simaps_viz.errors import InputError
from simaps_viz.viewer.server.access import (
    ENTERED,
    ENTERED_CSP,
    SAFE_HEADERS,
    Access,
    headers_of,
    name_of,
    without_query,
)
from simaps_viz.viewer.server.bounded_http import BoundedHandler, BoundedServer

logger = logging.getLogger(__name__)

STRICT_CSP = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' data: blob:; worker-src 'self' blob:; object-src 'none'"
)
HEARTBEAT_S = 2.0
LARGEST_EVENT_BYTES = 65_536
CHUNK_BYTES = 1 << 20
LARGEST_NUMBER = 1e15


Asset = tuple[bytes | Path, str]
"""Content (or the file that holds it) and its media type."""


class Host:
    """Serves until closed. Nothing but the files named on construction can be fetched."""

    def __init__(
        self,
        *,
        page: Callable[[Sequence[str]], str],
        assets: Mapping[str, Asset],
        csp: str = "",
        recordings: Sequence[Path] = (),
        streams: Sequence[str] = (),
        on_event: Callable[[dict[str, Any], str], dict[str, Any] | None] = lambda event, session: None,
        on_listen: Callable[[str], None] = lambda session: None,
        port: int = 0,
        root: str = "rerun",
        access: Access | None = None,
    ) -> None:
        """Start serving.

        Args:
            page: makes the page's HTML from the addresses of the recordings on this server.
            assets: files served beside the page.
            csp: Content-Security-Policy of everything served; empty takes a strict one.
            recordings: files served whole or in parts; no others are.
            streams: addresses of live recordings, which are shown first.
            on_event: gets what a page tells, and the session in its address ("" without one); may answer.
            on_listen: called with the session of a page that has begun to listen for what is pushed.
            port: where to serve; 0 takes a free one.
            root: folder of all addresses but those of the recordings.
            access: where it listens and whom it answers; by default this machine.

        Raises:
            InputError: a recording does not exist, or the port is taken.
        """
        self.root = root
        self.access = access or Access(token="")
        self.assets, self._csp = dict(assets), re.sub(r";? *frame-ancestors[^;]*", "", csp or STRICT_CSP)
        self.recordings = {path.name: path for path in recordings}
        self.on_event, self.on_listen = on_event, on_listen
        for path in recordings:
            if not path.is_file():
                raise InputError(f"{path}: expected a recording, found no such file")
        self._listeners: list[tuple[str, queue.SimpleQueue[dict[str, Any] | None]]] = []
        self._lock = threading.Lock()
        handler = type("BoundHandler", (_Handler,), {"host": self})
        try:
            self._server = BoundedServer(self.access.host, port, handler)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                why = f"expected an address of this machine and a port to listen on, found {self.access.host}, {port}"
                raise InputError(f"{why} ({error.strerror})") from error
            raise InputError(f"port {port}: expected a free one, found it taken ({error.strerror})") from error
        self.port = self._server.server_port
        self._make_page = page
        addresses = [*streams, *(f"/recordings/{quote(name)}" for name in self.recordings)]
        self.front = addresses[0] if addresses else ""
        """Address of what the page shows at first."""
        self.page = page(addresses)
        self._thread = threading.Thread(target=self._server.serve_forever, name="workbench-host", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.name}:{self.port}/{self.root}/"

    @property
    def name(self) -> str:
        """What a browser calls this machine by."""
        return self.access.name

    @property
    def entrance(self) -> str:
        """Address of the page with the token, where one is asked for."""
        return f"{self.url}?token={self.access.token}" if self.access.token else self.url

    def seen_as(self, name: str) -> "Host":
        """Return this host with addresses under the name that a browser calls this machine by."""
        return _SeenHost(self, name)

    def csp(self, host: str) -> str:
        """Return the Content-Security-Policy of what is served; pages of the host it was asked by may show it."""
        names = {"127.0.0.1", "localhost", host}
        return f"{self._csp}; frame-ancestors {' '.join(sorted(f'http://{one}:*' for one in names))}"

    def url_for(self, session: str) -> str:
        """Return the address of the page for one session."""
        return f"{self.url}?session={quote(session)}"

    def offer(self, path: Path) -> str:
        """Serve one more recording; returns its address on this server.

        Raises:
            InputError: it does not exist.
        """
        if not path.is_file():
            raise InputError(f"{path}: expected a recording, found no such file")
        number, name = 1, path.name
        while self.recordings.setdefault(name, path) != path:
            number, name = number + 1, f"{number + 1}-{path.name}"
        return f"/recordings/{quote(name)}"

    def turn_to(self, recording: Path) -> None:
        """Show a recording in the place of what was streamed, on open pages and on those to come.

        Raises:
            InputError: it does not exist.
        """
        self.front = self.offer(recording)
        self.page = self._make_page([self.front])
        self.push({"show": self.front})

    def push(self, message: dict[str, Any], session: str | None = None) -> None:
        """Send a message to the pages of a session, or to every open page."""
        with self._lock:
            for name, listener in self._listeners:
                if session is None or name == session:
                    listener.put(message)

    def hang_up(self, session: str) -> None:
        """End the connections over which a session listens."""
        with self._lock:
            for name, listener in self._listeners:
                if name == session:
                    listener.put(None)

    def close(self) -> None:
        """Stop serving and free the port."""
        with self._lock:
            for _, listener in self._listeners:
                listener.put(None)
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(timeout=5.0)

    def listen(self, session: str = "") -> queue.SimpleQueue[dict[str, Any] | None]:
        """Open a queue that gets every message pushed to a session or to all, and None at the end."""
        listener: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        with self._lock:
            self._listeners.append((session, listener))
        return listener

    def forget(self, listener: queue.SimpleQueue[dict[str, Any] | None]) -> None:
        """Close a queue."""
        with self._lock:
            self._listeners[:] = [(name, one) for name, one in self._listeners if one is not listener]


def parse_range(header: str, size: int) -> tuple[int, int] | None:
    """Read a Range header for one part of ``size`` bytes: (first, last), or None for the whole file.

    Raises:
        ValueError: the part lies outside the file.
    """
    match = re.fullmatch(r"bytes=(\d*)-(\d*)", header.strip())
    if match is None or match[1] == match[2] == "":
        return None
    if match[1] == "":
        first, last = max(0, size - int(match[2])), size - 1
    else:
        first, last = int(match[1]), min(int(match[2] or size - 1), size - 1)
    if first > last:
        raise ValueError(f"range {header} of {size} bytes")
    return first, last


def _number(text: str) -> float | int:
    """Read a number of a page's event; ValueError for those that no page counts to, or that are none."""
    number = float(text)
    if not abs(number) < LARGEST_NUMBER:
        raise ValueError(f"number {text[:20]}")
    return int(text) if text.lstrip("-").isdigit() else number


class _SeenHost(Host):
    """A host under another name, and otherwise the same one."""

    __slots__ = ("_seen_name",)

    def __init__(self, host: Host, name: str) -> None:
        self.__dict__ = host.__dict__
        self._seen_name = name

    @property
    def name(self) -> str:
        return self._seen_name


class _Handler(BoundedHandler):
    host: Host

    def log_message(self, format: str, *args: Any) -> None:
        logger.debug("%s", without_query(format % args))

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse what is no request."""
        self.close_connection = True
        self._refuse(code, HTTPStatus(code).phrase)

    def do_GET(self) -> None:
        if not self._welcome():
            return
        path, root = unquote(urlsplit(self.path).path), f"/{self.host.root}/"
        if path == f"{root}events":
            self._stream_events()
        elif path == root:
            self._send_asset((self.host.page.encode(), "text/html; charset=utf-8"), cache="no-store")
        elif path.startswith(root) and path[len(root) :] in self.host.assets:
            self._send_asset(self.host.assets[path[len(root) :]], cache="max-age=86400")
        elif path.startswith("/recordings/") and path[12:] in self.host.recordings:
            asset = (self.host.recordings[path[12:]], "application/octet-stream")
            self._send_asset(asset, cache="no-store")
        elif path == "/":
            self._lead_to(root)
        else:
            self._refuse(404, "no such page")

    def do_POST(self) -> None:
        if not self._welcome():
            return
        length = int(self.headers["Content-Length"])  # a POST has exactly one, see `BoundedHandler.parse_request`
        if urlsplit(self.path).path != f"/{self.host.root}/event" or length > LARGEST_EVENT_BYTES:
            self.close_connection = True
            self._refuse(400, "not an event")
            return
        try:
            body = self.rfile.read(length)
            event = json.loads(body, parse_float=_number, parse_int=_number, parse_constant=_number)
        except (ValueError, RecursionError):
            self._refuse(400, "not JSON")
            return
        answer: dict[str, Any] | None = None
        if isinstance(event, dict):
            try:
                answer = self.host.on_event(event, self._session())
            except Exception:
                logger.exception("an event of a page could not be handled")
        self._send_asset((json.dumps(answer or {}).encode(), "application/json"), cache="no-store")

    def _session(self) -> str:
        return parse_qs(urlsplit(self.path).query).get("session", [""])[0]

    def _welcome(self) -> bool:
        """Refuse other names for this machine (DNS rebinding), other sites' pages, and who has no token."""
        access, headers = self.host.access, headers_of(self.headers.items())
        refusal = access.refuse(
            headers,
            self.path,
            own_address=str(self.connection.getsockname()[0]),
            peer=str(self.client_address[0]),
            joins=self.command != "GET",
        )
        if refusal is not None:
            self.close_connection = True
            self._refuse(*refusal)
            return False
        cookie = access.entering(headers, self.path) if self.command == "GET" else None
        if cookie is None:
            return True
        body = ENTERED.format(path=f"/{self.host.root}/").encode()
        self.send_response(200)
        self._headers("text/html; charset=utf-8", len(body), "no-store", csp=ENTERED_CSP, **cookie)
        self.wfile.write(body)
        return False

    def _lead_to(self, path: str) -> None:
        self.send_response(302)
        self._headers("text/plain", 0, "no-store", Location=path)

    def _refuse(self, status: int, why: str) -> None:
        body = why.encode()
        self.send_response(status)
        self._headers("text/plain", len(body), "no-store")
        self.wfile.write(body)

    def _headers(self, media_type: str, length: int | None, cache: str, csp: str = "", **others: str) -> None:
        name = name_of(self.headers.get("Host")) if hasattr(self, "headers") else None
        own = {"Content-Type": media_type, "Content-Security-Policy": csp or self.host.csp(name or "127.0.0.1")}
        for header, value in {**own, **SAFE_HEADERS, "Cache-Control": cache, **others}.items():
            self.send_header(header, value)
        if length is not None:
            self.send_header("Content-Length", str(length))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()

    def _send_asset(self, asset: Asset, *, cache: str) -> None:
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
        self._headers(media_type, last - first + 1, cache)
        with BytesIO(content) if isinstance(content, bytes) else content.open("rb") as stream:
            stream.seek(first)
            self._copy(stream, last - first + 1)

    def _copy(self, stream: BinaryIO | BytesIO, length: int) -> None:
        try:
            while length > 0 and (part := stream.read(min(length, CHUNK_BYTES))):
                self.wfile.write(part)
                length -= len(part)
            if length > 0:  # the file has become shorter than was said
                self.close_connection = True
        except OSError:  # the page was closed meanwhile
            self.close_connection = True

    def _stream_events(self) -> None:
        self.close_connection = True
        session = self._session()
        listener = self.host.listen(session)  # before the answer goes out: whoever has it must miss no message
        try:
            self.send_response(200)
            self._headers("text/event-stream", None, "no-store")
            self.host.on_listen(session)
            while True:
                try:
                    message = listener.get(timeout=HEARTBEAT_S)
                except queue.Empty:
                    self.wfile.write(b": alive\n\n")
                else:
                    if message is None:
                        return
                    self.wfile.write(f"data: {json.dumps(message)}\n\n".encode())
                self.wfile.flush()
        except OSError:
            return
        finally:
            self.host.forget(listener)
