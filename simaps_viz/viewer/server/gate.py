"""Stands before viser's server: asks who comes, adds what keeps pages safe, and drops what no page would say.

Bound to viser 1.1.1, which opens its one port with ``websockets.asyncio.server.serve`` and leaves no place for any of
this. While a server is made, viser's module finds our ``serve`` in the place of that one.
"""

import asyncio
import base64
import contextlib
import gzip
import hashlib
import logging
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, lru_cache
from http import HTTPStatus
from importlib import resources
from types import SimpleNamespace
from typing import Any

import viser
import viser.infra._infra as infra
import websockets
from viser import _messages
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as serve_plainly
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from simaps_viz.viewer.server.access import ENTERED, ENTERED_CSP, SAFE_HEADERS, Access, headers_of
from simaps_viz.viewer.server.messages import LARGEST_MESSAGE, Listener, Uploads
from simaps_viz.viewer.server.page_script import HANDLERS, OPENED
from simaps_viz.viewer.server.threadsafe_event import hang_bells


class _GuardedPool:
    """Runs callbacks as the server's own threads do, and tells one page what they raise."""

    def __init__(self, pool: Any, report: Callable[[Exception], None]) -> None:
        self._pool, self._report = pool, report

    def submit(self, callback: Callable[..., Any], *arguments: Any) -> Any:
        return self._pool.submit(self._run, callback, *arguments)

    def _run(self, callback: Callable[..., Any], *arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception as error:  # whatever happens, the page must live on
            self._report(error)


def guard(client: viser.ClientHandle, report: Callable[[Exception], None]) -> None:
    """Make the errors of every callback of a page, whoever wrote it, appear on that page.

    viser 1.1.1 would print them and go on. It also warns of what a thread still sends when its page has just been
    closed, which nobody can help.
    """
    for api in (client.gui, client.scene):
        api._thread_executor = _GuardedPool(api._thread_executor, report)  # pyright: ignore[reportAttributeAccessIssue]
    with contextlib.suppress(AttributeError):
        client._websock_connection.get_message_buffer()._warned_push_after_done = True


LONGEST_S = 30
"""A page that never comes is uncovered after so long: viser's says what it waits for."""
_STYLE = (
    "<style>@keyframes simaps-uncover{to{visibility:hidden}}"
    'body::after{content:"Opening the map \\2026";position:fixed;inset:0;z-index:100000;display:grid;'
    "place-items:center;background:#fff;color:#495057;font:1.1rem system-ui,sans-serif;"
    f"animation:simaps-uncover 0s {LONGEST_S}s forwards}}body:has(.{OPENED})::after{{display:none}}</style></head>"
).encode()


def cover(response: Response) -> None:
    """Add the cover to a page of HTML; anything else stays as it is."""
    kind = response.headers.get("Content-Type", "")
    if response.status_code != 200 or not kind.startswith("text/html") or not response.body:
        return
    response.body = covered(bytes(response.body), zipped=response.headers.get("Content-Encoding") == "gzip")
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


@lru_cache(maxsize=4)
def covered(body: bytes, *, zipped: bool) -> bytes:
    """Return a page of HTML, gzipped or not, with the cover."""
    head, end, rest = (gzip.decompress(body) if zipped else body).rpartition(b"</head>")
    page = head + _STYLE + rest if end else rest
    return gzip.compress(page, mtime=0) if zipped else page


def fits(widget: Any, value: Any) -> bool:
    """Return whether a person could have given a widget that value."""
    state = widget._impl
    now, props = state.value, state.props
    options = getattr(props, "options", None)
    if options is not None:
        return isinstance(value, str) and value in options
    if isinstance(now, bool):
        return isinstance(value, bool)
    if isinstance(now, int | float):
        low, high = getattr(props, "min", None), getattr(props, "max", None)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and (low is None or value >= low) and (high is None or value <= high)
    if isinstance(now, str):
        return isinstance(value, str)
    if isinstance(now, tuple):
        same = isinstance(value, list | tuple) and len(value) == len(now)
        return same and all(isinstance(one, int | float) for one in value)
    return False


def check_values(client: viser.ClientHandle, note: Callable[[str], None]) -> None:
    """Let through to a page's widgets only what fits them; ``note`` is told of the rest."""
    handlers = client._websock_connection._incoming_handlers[_messages.GuiUpdateMessage]
    first = list(handlers)

    async def checked(client_id: Any, message: Any) -> None:
        widget = client.gui._gui_input_handle_from_uuid.get(message.uuid)
        if widget is not None and not fits(widget, message.updates.get("value")):
            note("a value that a widget cannot have")
            return
        for handler in first:
            await handler(client_id, message)  # pyright: ignore[reportGeneralTypeIssues]

    handlers[:] = [checked]


logger = logging.getLogger(__name__)

VISER_VERSION = "1.1.1"
MOST_SOCKETS, MOST_OF_ADDRESS, MOST_PAGES = 256, 192, 64
"""Connections of any kind, those of one address, and pages."""
SHAKE_HANDS_S = 5.0
"""How long a request may take to arrive."""
PING_S = 20.0
"""A page whose machine does not answer a ping for so long has gone."""
MESSAGES_PER_S, BURST = 400.0, 1200
"""A page that says more is heard later, not less."""
LONGEST_METHOD = 16
"""Letters of what an HTTP request begins with, such as GET."""
MOST_FAULTS = 20
"""A page that says so much that no page says is shown out."""

_INDEX_SHA256 = "8c05b8bfea1ed54773a7616d1d868ebf0b45055ff8da8fc1603ccb2a7858f079"
_MODULE_HASH = "'sha256-o/BTEGoB4UnTxqb+3RxwUFQZkWXpqUxouHkbDNrAkqE='"
"""Of the script that viser's page unpacks itself into, and of the page it was taken from."""


class Gate:
    """What the server of one workbench asks and allows; ``frames`` are the ports of the pages shown inside it."""

    def __init__(self, access: Access, frames: Callable[[], list[int]] = lambda: []) -> None:
        """Take the rules, and the ports that the page may show in frames."""
        if viser.__version__ != VISER_VERSION:
            raise RuntimeError(f"viser: expected version {VISER_VERSION}, found {viser.__version__}")
        self.access, self._frames = access, frames
        self.uploads = Uploads()
        self.refused: Counter[str] = Counter()
        self.pages = 0
        self._sockets: Counter[str] = Counter()

    @contextmanager
    def guard(self) -> Iterator[None]:
        """Stand before the viser server that is made meanwhile."""
        server = SimpleNamespace(serve=self._serve, ServerConnection=ServerConnection)
        hang_bells()
        with _MAKING:
            infra.__dict__["websockets"] = SimpleNamespace(
                asyncio=SimpleNamespace(server=server),
                datastructures=websockets.datastructures,
                exceptions=websockets.exceptions,
            )
            try:
                yield
            finally:
                infra.__dict__["websockets"] = websockets

    def enter(self, peer: str) -> bool:
        """Count a connection; False when there are too many."""
        self._sockets[peer] += 1
        return self._sockets.total() <= MOST_SOCKETS and self._sockets[peer] <= MOST_OF_ADDRESS

    def leave(self, peer: str) -> None:
        """Count it no longer."""
        self._sockets[peer] -= 1
        if self._sockets[peer] <= 0:
            del self._sockets[peer]

    def note(self, why: str) -> None:
        """Write down that something was refused: the first of a kind, and then every hundredth."""
        self.refused[why] += 1
        if self.refused[why] % 100 == 1 and len(self.refused) < 1000:
            logger.warning("refused: %s (%d times)", why, self.refused[why])

    def csp(self, host: str) -> str:
        """Return the Content-Security-Policy of viser's page under the name it is asked by, such as 127.0.0.1:8080."""
        name = re.sub(r":\d+$", "", host)
        frames = " ".join(f"http://{name}:{port}" for port in self._frames()) or "'none'"
        return "; ".join(
            (
                "default-src 'none'",
                f"script-src {_script_sources()}",  # no eval: only viser's Gaussian splats would need it
                "style-src 'unsafe-inline'",  # viser's widgets have their styles in attributes
                "img-src 'self' data: blob:",
                "media-src data: blob:",
                "font-src data:",
                f"connect-src 'self' ws://{host} wss://{host} data: blob:",
                "worker-src blob:",
                f"frame-src {frames}",
                "base-uri 'none'",
                "form-action 'none'",
                "frame-ancestors 'none'",
                "object-src 'none'",
            )
        )

    def _serve(self, handler: Any, host: str, port: int, *, process_request: Any, **options: Any) -> Any:
        def ask(connection: ServerConnection, request: Request) -> Response | None:
            refused = self._refuse(connection, request)
            return refused or self._with_headers(process_request(connection, request), request)

        asyncio.get_running_loop().set_exception_handler(_tell_failure)
        connection = type("BoundConnection", (GatedConnection,), {"gate": self})
        options |= {
            "create_connection": connection,
            "max_size": LARGEST_MESSAGE,
            "max_queue": 4,
            "open_timeout": SHAKE_HANDS_S,
            "ping_interval": PING_S,
            "ping_timeout": PING_S,
            "close_timeout": SHAKE_HANDS_S,
            "server_header": None,
            "logger": _SILENT,
        }
        return serve_plainly(handler, host, port, process_request=ask, **options)

    def _refuse(self, connection: ServerConnection, request: Request) -> Response | None:
        headers = headers_of(request.headers.raw_items())
        joins = "upgrade" in headers
        own, peer = str(connection.local_address[0]), str(connection.remote_address[0])
        refusal = self.access.refuse(headers, request.path, own_address=own, peer=peer, joins=joins)
        if refusal is None and joins and headers["upgrade"].lower() != "websocket":
            refusal = HTTPStatus.BAD_REQUEST, "expected a WebSocket"
        if refusal is None and joins and headers.get("sec-websocket-protocol") != f"viser-v{VISER_VERSION}":
            refusal = HTTPStatus.BAD_REQUEST, "load the page again: it is of another version"
        if refusal is None and joins and self.pages >= MOST_PAGES:
            refusal = HTTPStatus.SERVICE_UNAVAILABLE, "too many open pages"
        if refusal is not None:
            status, why = refusal
            self.note(why)
            return _response(status, why.encode(), "text/plain; charset=utf-8", ENTERED_CSP)
        if joins and isinstance(connection, GatedConnection):
            connection.becomes_page()
        cookie = None if joins else self.access.entering(headers, request.path)
        if cookie is None:
            return None
        page = ENTERED.format(path="/").encode()
        response = _response(HTTPStatus.OK, page, "text/html; charset=utf-8", ENTERED_CSP)
        response.headers.update(cookie)
        return response

    def _with_headers(self, response: Response | None, request: Request) -> Response | None:
        if response is not None:
            response.headers["Content-Security-Policy"] = self.csp(request.headers["Host"].lower())
            response.headers["Cache-Control"] = "no-cache"
            response.headers.update(SAFE_HEADERS)
            cover(response)
        return response


class GatedConnection(ServerConnection):
    """One connection; what arrives over it is judged before viser gets it."""

    gate: Gate

    def connection_made(self, transport: Any) -> None:
        """Let it in, unless there are too many."""
        peer = transport.get_extra_info("peername")
        self._peer = str(peer[0]) if peer else ""
        self._listener = Listener(self.gate.uploads)
        self._is_page, self._faults, self._credit, self._filled = False, 0, float(BURST), time.monotonic()
        self._begun, self._knows_method, self._turned_away = b"", False, False
        self._entered = self.gate.enter(self._peer)
        super().connection_made(transport)
        if not self._entered:
            self.gate.note("too many connections")
            transport.abort()

    def data_received(self, data: bytes) -> None:
        """Answer HEAD, POST and the others, on which websockets would hang up without a word."""
        if not self._knows_method:
            self._begun += data
            method, blank, _ = self._begun.partition(b" ")
            if not blank and re.fullmatch(rb"[A-Z]{,%d}" % LONGEST_METHOD, method):
                return  # it may become one
            data, self._begun, self._knows_method = self._begun, b"", True
            self._turned_away = method != b"GET" and re.fullmatch(rb"[A-Z]{1,%d}" % LONGEST_METHOD, method) is not None
            if self._turned_away:
                self._turn_away()
        if not self._turned_away:
            super().data_received(data)

    def _turn_away(self) -> None:
        """Describe what is answered here; what else comes is not read, and who does not go is hung up on in time."""
        self.gate.note("a request that is no GET")
        response = _response(HTTPStatus.METHOD_NOT_ALLOWED, b"", "text/plain; charset=utf-8", ENTERED_CSP)
        response.headers["Allow"] = "GET"
        self.transport.write(response.serialize())
        self.transport.write_eof()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self.gate.leave(self._peer)
        self._listener.close()
        if self._is_page:
            self.gate.pages -= 1
        super().connection_lost(exc)

    def becomes_page(self) -> None:
        """It is let in as a page."""
        self._is_page = True
        self.gate.pages += 1

    async def recv(self, decode: bool | None = None) -> Any:
        """Wait for the next message that a page would send."""
        while True:
            raw = await super().recv(decode)
            await self._pace()
            fault = self._listener.fault(raw)
            if fault is None:
                return raw
            logger.debug("dropped: %r", fault)
            self.gate.note("a message that no page sends")
            self._faults += 1
            if self._faults > MOST_FAULTS:
                await self.close(1008, "not the messages of a page")

    async def _pace(self) -> None:
        now = time.monotonic()
        self._credit = min(float(BURST), self._credit + (now - self._filled) * MESSAGES_PER_S) - 1.0
        self._filled = now
        if self._credit < 0.0:
            await asyncio.sleep(-self._credit / MESSAGES_PER_S)


_MAKING = threading.Lock()
_SILENT = logging.getLogger(f"{__name__}.websockets")  # it would write whole requests, with their tokens
_SILENT.setLevel(logging.CRITICAL + 1)


def _response(status: HTTPStatus, body: bytes, media_type: str, csp: str) -> Response:
    headers = Headers(SAFE_HEADERS)
    headers["Content-Type"] = media_type
    headers["Content-Length"] = str(len(body))
    headers["Content-Security-Policy"] = csp
    headers["Cache-Control"] = "no-store"
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, body)


def _tell_failure(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Write one line where asyncio would write a traceback: what a page said made no sense to the widget it named."""
    logger.warning("a message could not be handled: %r", context.get("exception") or context.get("message"))


@cache
def _script_sources() -> str:
    index = resources.files(viser).joinpath("client/build/index.html").read_bytes()
    if hashlib.sha256(index).hexdigest() != _INDEX_SHA256:
        logger.warning("viser's page is not that of viser %s: its scripts cannot be told apart", VISER_VERSION)
        return "'unsafe-inline' 'wasm-unsafe-eval'"
    loader = re.findall(rb"<script[^>]*>(.*?)</script>", index, re.DOTALL)
    hashes = [_sha256(script) for script in loader] + [_MODULE_HASH] + [_sha256(one.encode()) for one in HANDLERS]
    return " ".join(("'wasm-unsafe-eval'", "'unsafe-hashes'", *hashes))


def _sha256(script: bytes) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'"
