"""A machine that is reached through one forwarded port, as by ``ssh -L``."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from browser import PATIENCE_S, mine, until, watched_page
from playwright.sync_api import Browser, Page

from simaps_viz.viewer.workbench import Workbench


def pass_on(source: socket.socket, sink: socket.socket) -> None:
    with suppress(OSError):
        while part := source.recv(65_536):
            sink.sendall(part)
    for one in (source, sink):
        with suppress(OSError):
            one.shutdown(socket.SHUT_RDWR)


@contextmanager
def forwarded(port: int) -> Iterator[int]:
    """Forward a port of this machine, and no other, to another one."""
    threads: list[threading.Thread] = []

    def start(target: Callable[..., None], *arguments: socket.socket) -> threading.Thread:
        threads.append(threading.Thread(target=target, args=arguments, daemon=True))
        threads[-1].start()
        return threads[-1]

    def forward(near: socket.socket) -> None:
        with near, socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as far:
            back = start(pass_on, far, near)
            pass_on(near, far)
            back.join()

    def accept(listening: socket.socket) -> None:
        with suppress(OSError):
            while True:
                start(forward, listening.accept()[0])

    with socket.create_server(("127.0.0.1", 0)) as listening:
        start(accept, listening)
        yield listening.getsockname()[1]
        listening.shutdown(socket.SHUT_RDWR)
    for thread in threads:
        thread.join(PATIENCE_S)


@contextmanager
def watched_through(browser: Browser, bench: Workbench, width: int) -> Iterator[Page]:
    """Open a page through one forwarded port; fails where it asks for any other."""
    with forwarded(bench.port) as near, watched_page(browser, width) as page:
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.on("websocket", lambda one: asked.append(one.url))
        page.goto(f"http://127.0.0.1:{near}/?fixedDpr=1")
        until(page, lambda: bench.sessions)
        assert mine(bench).wait_idle(PATIENCE_S)
        yield page
        elsewhere = [url for url in asked if url.startswith(("http", "ws")) and f"127.0.0.1:{near}/" not in url]
        assert asked and not elsewhere
