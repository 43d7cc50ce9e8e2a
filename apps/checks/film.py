"""What a page shows, picture by picture as the browser paints it: when does a part of it change? For the bench."""

import base64
import contextlib
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from playwright.sync_api import FloatRect, Page

SCALE = 0.5
"""Pictures are smaller than the page, so that making them costs the page little."""
SEEN = 40
"""A pixel has changed when a channel differs by more: JPEG's own noise stays below."""
FIRST_MS = 200
MAX_FIRST = 150
"""How often the first picture is asked for; on a machine that is busy, it takes its time."""
REPAINT = "(opacity) => { document.documentElement.style.opacity = opacity; }"
"""A page where nothing moves is not painted, and its first picture would not come."""
LEAST = 20
"""So many changed pixels of a picture count as a change."""


class Film:
    """Pictures of a page, as they arrive here after the browser painted them."""

    def __init__(self, part: "FloatRect") -> None:
        """Take which part of the page is watched: x, y, width and height in its pixels."""
        top, left = int(part["y"] * SCALE), int(part["x"] * SCALE)
        self._rows = slice(top, top + int(part["height"] * SCALE))
        self._columns = slice(left, left + int(part["width"] * SCALE))
        self._last: NDArray | None = None
        self._first: NDArray | None = None
        self.changed_at: float | None = None
        """When it first looked different from what it was at ``begin``; ``time.perf_counter``, seconds."""

    @property
    def begun(self) -> bool:
        """Whether there is a picture to compare with."""
        return self._last is not None

    def begin(self) -> None:
        """What was shown last is what later pictures are compared with; raises RuntimeError before the first one."""
        if not self.begun:
            raise RuntimeError("film: expected a picture to compare with, found none yet")
        self._first, self.changed_at = self._last, None

    def take(self, event: dict[str, Any]) -> None:
        """Look at a picture that the browser sent."""
        arrived = time.perf_counter()
        jpeg = np.frombuffer(base64.b64decode(event["data"]), np.uint8)
        picture = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR))
        self._last = picture[self._rows, self._columns].astype(np.int16)
        if self.changed_at is None and self._first is not None:
            differs = np.abs(self._last - self._first).max(axis=2) > SEEN
            if np.count_nonzero(differs) >= LEAST:
                self.changed_at = arrived


@contextlib.contextmanager
def filmed(page: "Page", part: "FloatRect") -> Iterator[Film]:
    """Film a part of a page of Chromium: x, y, width and height in pixels; raises RuntimeError if no picture comes."""
    from playwright.sync_api import Error  # noqa: PLC0415 - only the bench needs it

    size, film = page.viewport_size, Film(part)
    assert size is not None
    session = page.context.new_cdp_session(page)

    def take(event: dict[str, Any]) -> None:
        film.take(event)
        with contextlib.suppress(Error):  # the page may be gone
            session.send("Page.screencastFrameAck", {"sessionId": event["sessionId"]})

    session.on("Page.screencastFrame", take)
    width, height = int(size["width"] * SCALE), int(size["height"] * SCALE)
    session.send("Page.startScreencast", {"format": "jpeg", "quality": 60, "maxWidth": width, "maxHeight": height})
    try:
        for _ in range(MAX_FIRST):
            repaint(page)
            if film.begun:
                break
        else:
            raise RuntimeError(f"film: expected a picture of {page.url}, found none after {MAX_FIRST} paintings")
        yield film
    finally:
        session.send("Page.stopScreencast")
        session.detach()


def repaint(page: "Page") -> None:
    """Have a page painted where nothing moves: the browser may leave a picture out, and sends no other by itself."""
    for opacity in ("0.999", ""):
        page.evaluate(REPAINT, opacity)
        page.wait_for_timeout(FIRST_MS)
