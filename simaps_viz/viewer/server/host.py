"""A page shown in a frame: its files, its recordings, what it reports, and what is pushed to it."""

import json
import logging
import queue
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from simaps_viz.errors import InputError

logger = logging.getLogger(__name__)

STRICT_CSP = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' data: blob:; worker-src 'self' blob:; object-src 'none'"
)
MAX_NUMBER = 1e15


Asset = tuple[bytes | Path, str]
"""Content (or the file that holds it) and its media type."""


class Host:
    """The files and events that the front door serves for one frame; no other file can be fetched."""

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
        root: str = "rerun",
    ) -> None:
        """Create a host of one frame.

        Args:
            page: makes the page's HTML from the addresses of the recordings.
            assets: files served beside the page.
            csp: Content-Security-Policy of everything served; empty takes a strict one.
            recordings: files served complete or in parts; no others are.
            streams: addresses of live recordings, which are shown first.
            on_event: gets what a page reports, and the session in its address ("" without one); may answer.
            on_listen: called with the session of a page that has begun to listen for what is pushed.
            root: folder of all addresses but those of the recordings.

        Raises:
            InputError: a recording does not exist.
        """
        self.root = root
        self.assets = dict(assets)
        own_frames_only = re.sub(r";? *frame-ancestors[^;]*", "", csp or STRICT_CSP)
        self.csp = f"{own_frames_only}; frame-ancestors 'self'"
        self.on_event, self.on_listen = on_event, on_listen
        self.recordings: dict[str, Path] = {}
        self._listeners: list[tuple[str, queue.SimpleQueue[dict[str, Any] | None]]] = []
        self._lock = threading.Lock()
        self._make_page = page
        addresses = [*streams, *map(self.offer, recordings)]
        self.front = addresses[0] if addresses else ""
        """Address of what the page shows at first."""
        self.page = page(addresses)

    def url_for(self, session: str) -> str:
        """Return the address of the page for one session, on the front door."""
        return f"/{self.root}/?session={quote(session)}"

    def offer(self, path: Path) -> str:
        """Serve one more recording; returns its address on the front door.

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
        """Replace the live stream by a recording, on pages that are open and on later ones.

        Raises:
            InputError: it does not exist.
        """
        self.front = self.offer(recording)
        self.page = self._make_page([self.front])
        self.push({"show": self.front})

    def handle(self, event: object, session: str) -> dict[str, Any]:
        """Handle an event of a page and return the answer; an event that cannot be handled is logged."""
        answer: dict[str, Any] | None = None
        if isinstance(event, dict):
            try:
                answer = self.on_event(event, session)
            except Exception:
                logger.exception("an event of a page could not be handled")
        return answer or {}

    def push(self, message: dict[str, Any] | None, session: str | None = None) -> None:
        """Send a message to the pages of a session, or to every open page; None ends their connections."""
        with self._lock:
            for name, listener in self._listeners:
                if session is None or name == session:
                    listener.put(message)

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
    """Read a Range header for one part of ``size`` bytes: (first, last), or None for the complete file.

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


def read_event(body: bytes) -> object:
    """Read the JSON of a page's event.

    Raises:
        ValueError: it is not JSON, or has numbers that no page counts to.
        RecursionError: it is nested too deeply.
    """
    return json.loads(body, parse_float=_number, parse_int=_number, parse_constant=_number)


def _number(text: str) -> float | int:
    number = float(text)
    if not abs(number) < MAX_NUMBER:
        raise ValueError(f"number {text[:20]}")
    return int(text) if text.lstrip("-").isdigit() else number
