"""A page that nobody draws: viser's side of a browser tab without the browser, and what its hidden frame does."""

import json
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec.msgpack
import viser
from websockets.sync.client import connect

from simaps_viz.viewer.session import Session
from simaps_viz.viewer.workbench import Workbench

PATIENCE_S = 60.0
"""How long anything may take: a machine with other work is slow, and what hangs never comes."""
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (3.0, 3.0, 3.0),
    "fov": 0.5,
    "near": 0.1,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 600,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class FakePage:
    """Connects, says where its camera is, throws away what it is sent."""

    def __init__(self, bench: Workbench, *, tab: str | None = None, tells: bool = True) -> None:
        """Open the page; ``tab``: the name in the tab's storage; ``tells``: whether its hidden frame gets through."""
        before = {session.token for session in bench.sessions}
        address = f"ws://127.0.0.1:{bench.port}"
        self._socket = connect(address, subprotocols=[f"viser-v{viser.__version__}"], max_size=None)  # type: ignore
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._socket.send(msgspec.msgpack.encode(CAMERA))
        end = time.monotonic() + PATIENCE_S
        while not (new := [one for one in bench.sessions if one.token not in before]):
            assert time.monotonic() < end, "no session for the page"
            time.sleep(0.01)
        self.session: Session = new[-1]
        self.tab = self._tell(bench, tab) if tells else None
        assert self.session.wait_idle()

    def close(self) -> None:
        """Close the tab, or begin to load the page again."""
        self._socket.close()
        self._reader.join(timeout=PATIENCE_S)

    def _tell(self, bench: Workbench, tab: str | None) -> str:
        address = f"{bench.url}/tab/event?session={self.session.token}"
        body = json.dumps({"type": "tab", "tab": tab}).encode()
        direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with direct.open(address, body, timeout=PATIENCE_S) as answer:
            return json.load(answer)["tab"]

    def _read(self) -> None:
        for _ in self._socket:
            pass


@contextmanager
def fake_page(bench: Workbench, *, tab: str | None = None) -> Iterator[FakePage]:
    page = FakePage(bench, tab=tab)
    yield page
    page.close()


def gone(bench: Workbench, session: Session, timeout_s: float = PATIENCE_S) -> None:
    """Wait until a session has ended."""
    end = time.monotonic() + timeout_s
    while session in bench.sessions:
        assert time.monotonic() < end, "the session did not end"
        time.sleep(0.01)
