"""Attacks by holding on: requests that drip, connections that are never used, and more of everything."""

import contextlib
import socket
import threading
import time

from attacks.messages import memory
from attacks.target import CAMERA, Target, Tries, ask, open_socket, page, say, wait

AWAY_S = 20.0
"""After so long all that an attacker held is to be free again."""
SERVED_S, ANSWERED_S = 5.0, 2.0
"""So long others may wait for a request, and for what they say on a page, while somebody attacks."""
HUNG_UP_S = 0.5
"""So long connections may be held that are too many; shorter than any connection is kept on which nothing is said."""


def _connect(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=5.0)


def _is_open(connection: socket.socket) -> bool:
    connection.setblocking(False)
    try:
        return connection.recv(65_536) != b""
    except BlockingIOError:
        return True
    except OSError:
        return False


def dripping_requests(target: Target) -> Tries:
    """Slowloris: headers, and bodies, that arrive a byte at a time; others are served meanwhile."""
    held: list[socket.socket] = []
    port = target.port
    head = f"POST /tab/event HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 60000\r\n\r\n".encode()
    for n in range(40):
        held.append(_connect(port))
        held[-1].sendall(head if n % 2 else b"GET / HTTP/1.1\r\nX: ")
    begun = time.monotonic()
    quick, served = time.monotonic(), ask(port, "/").status == 200
    yield None if served and time.monotonic() - quick < SERVED_S else "others are not served"
    while any(alive := [_is_open(one) for one in held]) and time.monotonic() - begun < AWAY_S:
        for one in held:
            with contextlib.suppress(OSError):
                one.send(b"a")
        time.sleep(0.5)
    yield from ("a request may drip for ever" if still else None for still in alive)
    for one in held:
        one.close()


def unused_connections(target: Target) -> Tries:
    """Open hundreds of connections and send nothing: the limit is held, the rest are closed, all are freed in time."""
    port = target.port
    held = []
    for _ in range(280):
        with contextlib.suppress(OSError):
            held.append(_connect(port))
    few = wait(lambda: sum(map(_is_open, held)) <= 256, HUNG_UP_S)
    yield None if few else f"{sum(map(_is_open, held))} connections are held open"
    for one in held:
        one.close()
    served = wait(lambda: ask(port, "/").status == 200)
    yield None if served else "nobody is served any more"


def streams_without_end(target: Target) -> Tries:
    """Open hundreds of event streams of a recording, and never read them."""
    before = memory()
    port = target.port
    held = []
    for n in range(300):
        with contextlib.suppress(OSError):
            one = _connect(port)
            held.append(one)
            one.sendall(f"GET /rerun/events?session={n} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
    for _ in range(2000):
        target.bench.recording_host.push({"set_time": {"timeline": "frame", "time": 1}})  # type: ignore[union-attr]
    yield None if threading.active_count() < 400 else f"{threading.active_count()} threads"
    for one in held:
        one.close()
    yield (None if wait(lambda: ask(port, "/rerun/").status == 200, AWAY_S) else "nobody is served any more")
    yield None if memory() - before < 200 << 20 else "memory was taken"


def more_pages_than_allowed(target: Target) -> Tries:
    """Open a hundred pages at once: the limit is let in, the rest are refused, and closed pages make room."""
    held = []
    for _ in range(100):
        with contextlib.suppress(Exception):
            held.append(open_socket(target.port))
    yield None if len(held) <= 64 else f"{len(held)} pages were let in"
    for one in held:
        one.close()
    yield None if wait(lambda: target.bench.door.pages == 0, AWAY_S) else "pages that went are still counted"
    yield target.is_well()


def floods_of_messages(target: Target) -> Tries:
    """Send twenty thousand messages from one page as fast as it can; another is still answered."""
    with page(target.bench) as (mine, _), page(target.bench) as (other, session):
        stop = threading.Event()

        def flood() -> None:
            for _ in range(20_000):
                if stop.is_set():
                    return
                say(mine, **CAMERA)

        flooding = threading.Thread(target=flood, daemon=True)
        flooding.start()
        slowest = 0.0
        for n in range(5):
            begun = time.monotonic()
            say(other, **{**CAMERA, "fov": 0.1 + n / 10.0})
            seen = wait(lambda n=n: abs(session.client.camera.fov - (0.1 + n / 10.0)) < 1e-9, SERVED_S)
            slowest = max(slowest, time.monotonic() - begun)
            yield None if seen else "another page is no longer heard"
        stop.set()
        flooding.join(timeout=SERVED_S)
        yield None if slowest < ANSWERED_S else f"another page waited {slowest:.1f} s"


def pages_that_break_off(target: Target) -> Tries:
    """Pages that go in the middle of a message, without a word, and at once after they came."""
    for _ in range(8):
        one = open_socket(target.port)
        one.socket.sendall(b"\x82\xfe\x10\x00")
        one.socket.shutdown(socket.SHUT_RDWR)
        one.socket.close()
        yield None
    yield None if wait(lambda: not target.bench.sessions, 3 * AWAY_S) else "sessions without a page are kept"
    yield target.is_well()
