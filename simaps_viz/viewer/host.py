"""A small web server on 127.0.0.1 for the recorded build: its page, its files, and messages both ways."""

import json
import logging
import queue
import re
import shutil
import threading
from collections.abc import Callable, Mapping, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote, unquote

from simaps_viz.errors import InputError
from simaps_viz.viewer.services import Asset

logger = logging.getLogger(__name__)

STRICT_CSP = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' data: blob:; worker-src 'self' blob:; object-src 'none'"
)
HEARTBEAT_S = 2.0
LARGEST_EVENT_BYTES = 65_536


class Host:
    """Serves until closed. Nothing but the files named on construction can be fetched."""

    def __init__(
        self,
        *,
        page: Callable[[Sequence[str]], str],
        assets: Mapping[str, Asset],
        csp: str = "",
        recordings: Sequence[Path] = (),
        on_event: Callable[[dict[str, Any]], None] = lambda event: None,
        on_listen: Callable[[], None] = lambda: None,
        port: int = 0,
    ) -> None:
        """Start serving.

        Args:
            page: makes the page's HTML from the absolute addresses of the recordings.
            assets: files served beside the page.
            csp: Content-Security-Policy of everything served; empty takes a strict one.
            recordings: files served whole or in parts; no others are.
            on_event: gets what the page tells.
            on_listen: called when a page has begun to listen for what is pushed.
            port: where on 127.0.0.1 to serve; 0 takes a free one.

        Raises:
            InputError: a recording does not exist, or the port is taken.
        """
        self.assets, self.csp = dict(assets), csp or STRICT_CSP
        self.recordings = {path.name: path for path in recordings}
        self.on_event, self.on_listen = on_event, on_listen
        for path in recordings:
            if not path.is_file():
                raise InputError(f"{path}: expected a recording, found no such file")
        self._listeners: list[queue.SimpleQueue[dict[str, Any] | None]] = []
        self._lock = threading.Lock()
        handler = type("BoundHandler", (_Handler,), {"host": self})
        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), handler)
        except OSError as error:
            raise InputError(f"port {port}: expected a free one, found it taken ({error.strerror})") from error
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        self.allowed_hosts = {f"127.0.0.1:{self.port}", f"localhost:{self.port}"}
        self.page = page([f"http://127.0.0.1:{self.port}/recordings/{quote(name)}" for name in self.recordings])
        self._thread = threading.Thread(target=self._server.serve_forever, name="workbench-host", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}/rerun/"

    def push(self, message: dict[str, Any]) -> None:
        """Send a message to every open page."""
        with self._lock:
            for listener in self._listeners:
                listener.put(message)

    def close(self) -> None:
        """Stop serving and free the port."""
        with self._lock:
            for listener in self._listeners:
                listener.put(None)
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(timeout=5.0)

    def listen(self) -> queue.SimpleQueue[dict[str, Any] | None]:
        """Open a queue that gets every pushed message, and None at the end."""
        listener: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        with self._lock:
            self._listeners.append(listener)
        return listener

    def forget(self, listener: queue.SimpleQueue[dict[str, Any] | None]) -> None:
        """Close a queue."""
        with self._lock:
            self._listeners.remove(listener)


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


class _Handler(BaseHTTPRequestHandler):
    host: Host
    protocol_version = "HTTP/1.1"

    def log_message(self, format: str, *args: Any) -> None:
        logger.debug(format, *args)

    def do_GET(self) -> None:
        if not self._welcome():
            return
        path = unquote(self.path.split("?")[0])
        if path == "/rerun/events":
            self._stream_events()
        elif path == "/rerun/":
            self._send_asset((self.host.page.encode(), "text/html; charset=utf-8"), cache="no-store")
        elif path.startswith("/rerun/") and path[7:] in self.host.assets:
            self._send_asset(self.host.assets[path[7:]], cache="max-age=86400")
        elif path.startswith("/recordings/") and path[12:] in self.host.recordings:
            asset = (self.host.recordings[path[12:]], "application/octet-stream")
            self._send_asset(asset, cache="no-store")
        else:
            self._refuse(404, "no such page")

    def do_POST(self) -> None:
        if not self._welcome():
            return
        length = self.headers.get("Content-Length", "")
        if self.path != "/rerun/event" or not length.isdigit() or int(length) > LARGEST_EVENT_BYTES:
            self.close_connection = True
            self._refuse(400, "not an event")
            return
        try:
            event = json.loads(self.rfile.read(int(length)))
        except ValueError:
            self._refuse(400, "not JSON")
            return
        if isinstance(event, dict):
            try:
                self.host.on_event(event)
            except Exception:
                logger.exception("an event of the recorded build could not be handled")
        self._send_asset((b"{}", "application/json"), cache="no-store")

    def _welcome(self) -> bool:
        """Refuse other names for this machine (DNS rebinding) and other sites' pages."""
        origin = self.headers.get("Origin")
        own = self.headers.get("Host") in self.host.allowed_hosts
        foreign = origin is not None and origin.removeprefix("http://") not in self.host.allowed_hosts
        if own and not foreign:
            return True
        self.close_connection = True
        self._refuse(403, "this server answers its own page only")
        return False

    def _refuse(self, status: int, why: str) -> None:
        body = why.encode()
        self.send_response(status)
        self._headers("text/plain", len(body), "no-store")
        self.wfile.write(body)

    def _headers(self, media_type: str, length: int | None, cache: str) -> None:
        self.send_header("Content-Type", media_type)
        self.send_header("Content-Security-Policy", self.host.csp)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cache-Control", cache)
        if length is not None:
            self.send_header("Content-Length", str(length))
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
            shutil.copyfileobj(BytesIO(stream.read(length)), self.wfile)
        except OSError:  # the page was closed meanwhile
            self.close_connection = True

    def _stream_events(self) -> None:
        self.close_connection = True
        listener = self.host.listen()  # before the answer goes out: whoever has it must miss no message
        try:
            self.send_response(200)
            self._headers("text/event-stream", None, "no-store")
            self.host.on_listen()
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
