"""What is attacked: a running workbench, and plain ways to talk to it that no browser would."""

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec.msgpack
import viser
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from simaps_viz.viewer.session import Session
from simaps_viz.viewer.workbench import Workbench

Tries = Iterator[str | None]
"""For each try: None when it was withstood, else what it brought about."""
PATIENCE_S = 30.0
"""Shorter than a page is kept that says nothing."""
PAGES = ("/", "/tab/", "/rerun/")
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (3.0, 3.0, 3.0), "fov": 0.5, "near": 0.1,
    "far": 1000.0, "image_height": 600, "image_width": 600, "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0),
}  # fmt: skip


@dataclass(frozen=True)
class Reply:
    """What a server answered; status 0 when it hung up."""

    status: int
    head: str
    body: bytes

    @property
    def text(self) -> str:
        """All of it."""
        return self.head + self.body.decode("latin-1")


@dataclass(frozen=True, eq=False)
class Target:
    """A workbench whose pages may do all, one with tokens for visitors and an owner, and a file that is nobody's."""

    bench: Workbench
    closed: Workbench
    secret: Path
    """Lies beside the recording that is served; holds ``secret_text``."""
    secret_text: str = "nobody may read this"

    @property
    def port(self) -> int:
        """Port of the page and its frames."""
        return self.bench.port

    def is_well(self) -> str | None:
        """Open a page as a browser would; returns what is wrong."""
        for path in PAGES:
            reply = ask(self.port, path)
            if reply.status != 200:
                return f"{path} answers {reply.status} to an honest page"
        with page(self.bench) as (_, session):
            return None if session.wait_idle() else "a new page is never painted"


def ask(
    port: int, path: str = "/", *, method: str = "GET", host: str | None = "", body: bytes = b"", **head: str
) -> Reply:
    """Send one HTTP request as it is written here; ``host``: "" for the right one, None for none."""
    lines = [f"{method} {path} HTTP/1.1"]
    if host is not None:
        lines.append(f"Host: {host or f'127.0.0.1:{port}'}")
    lines += [f"{name.replace('_', '-')}: {value}" for name, value in head.items()]
    if body and "Content_Length" not in head:
        lines.append(f"Content-Length: {len(body)}")
    return send_raw(port, "\r\n".join([*lines, "Connection: close", "", ""]).encode("latin-1", "replace") + body)


def send_raw(port: int, request: bytes, *, most: int = 1 << 20, finish: bool = False) -> Reply:
    """Send bytes, and read what comes until the other side hangs up, at most ``most`` bytes of it.

    ``finish``: say that no more will be sent, so that nobody waits for the rest of a request.
    """
    content = b""
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as connection:
        with contextlib.suppress(OSError):  # it may hang up before it has read all
            connection.sendall(request)
            if finish:
                connection.shutdown(socket.SHUT_WR)
        while len(content) < most and (part := connection.recv(65_536)):
            content += part
    head, _, body = content.partition(b"\r\n\r\n")
    words = head.split(b" ", 2)
    status = int(words[1]) if len(words) > 1 and words[1].isdigit() else 0
    return Reply(status, head.decode("latin-1"), body)


def enter(bench: Workbench, *, owner: bool = False) -> str:
    """Bring a workbench its token, and return the cookie that lets in; empty where none is asked for."""
    token = bench.access.owner_token if owner else bench.access.token
    if not token:
        return ""
    reply = ask(bench.port, f"/?token={token}")
    cookie = next((line for line in reply.head.splitlines() if line.startswith("Set-Cookie: ")), "")
    return cookie.removeprefix("Set-Cookie: ").partition(";")[0]


def open_socket(
    port: int, *, name: str = "127.0.0.1", path: str = "/", protocol: str = "", **options: Any
) -> Connection:
    """Open a WebSocket as viser's page does."""
    through = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    return connect(
        f"ws://{name}:{port}{path}", sock=through, subprotocols=[protocol or f"viser-v{viser.__version__}"],  # type: ignore
        max_size=None, proxy=None, open_timeout=PATIENCE_S, close_timeout=0.3, **options,
    )  # fmt: skip


def socket_refused(port: int, **options: Any) -> bool:
    """Return whether a WebSocket is refused."""
    try:
        with open_socket(port, **options):
            return False
    except (InvalidHandshake, OSError):
        return True


@contextlib.contextmanager
def page(bench: Workbench, *, name: str = "127.0.0.1", owner: bool = False) -> Iterator[tuple[Connection, Session]]:
    """Open a page that nobody draws, by another name or an owner's if need be; returns its WebSocket and session."""
    before = {session.token for session in bench.sessions}
    head = {"Cookie": cookie} if (cookie := enter(bench, owner=owner)) else {}
    with open_socket(bench.port, name=name, additional_headers=head) as connection:
        connection.send(msgspec.msgpack.encode(CAMERA))
        new: list[Session] = []

        def has_come() -> bool:
            new[:] = [one for one in bench.sessions if one.token not in before]
            return bool(new)

        if not wait(has_come):
            raise TimeoutError("no session for a page")
        yield connection, new[-1]


def say(connection: Connection, **message: Any) -> None:
    """Send a message as viser's pages do; nothing when the server has hung up."""
    with contextlib.suppress(ConnectionClosed, OSError):
        connection.send(msgspec.msgpack.encode(message))


def wait(predicate: Callable[[], object], timeout_s: float = PATIENCE_S) -> bool:
    """Wait until something holds; False when it takes too long."""
    end = time.monotonic() + timeout_s
    while not predicate():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def hung_up(connection: Connection, timeout_s: float = PATIENCE_S) -> bool:
    """Return whether the server ends a WebSocket, reading all it sends until then."""
    end = time.monotonic() + timeout_s
    try:
        while time.monotonic() < end:
            with contextlib.suppress(TimeoutError):
                connection.recv(timeout=0.2)
    except (ConnectionClosed, OSError):
        return True
    return False
