"""Identify browser tabs, so that a page that is loaded again gets its state back, and two tabs never share one.

Every page holds a hidden frame, served by `host.Host` on 127.0.0.1, that keeps a name in its tab's own storage and
reports it. A duplicated tab has the name of the original, which is still open: it gets a new name. The frame is as wide
as the page, and reports that width too.
"""

import base64
import hashlib
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from importlib import resources
from typing import Generic, TypeVar

S = TypeVar("S")

MAX_CLOSED = 32
KEPT_S = 3600.0
LEAVE_S = 2.0
"""How long a reloaded page may wait until the session before the reload has ended."""

_SCRIPT = resources.files("simaps_viz.viewer.page").joinpath("tab.js").read_text(encoding="utf-8")
_HASH = base64.b64encode(hashlib.sha256(_SCRIPT.encode()).digest()).decode()
TAB_PAGE = f'<!doctype html><html lang="en"><title>Tab</title><script>{_SCRIPT}</script></html>'
TAB_CSP = (
    f"default-src 'none'; script-src 'sha256-{_HASH}'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors http://127.0.0.1:* http://localhost:*"
)


class Tabs(Generic[S]):
    """The names of tabs, the session that each shows, and the state that closed tabs left."""

    def __init__(
        self,
        *,
        most: int = MAX_CLOSED,
        kept_s: float = KEPT_S,
        leave_s: float = LEAVE_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Remember ``most`` closed tabs, each for ``kept_s`` seconds."""
        self._most, self._kept_s, self._leave_s, self._clock = most, kept_s, leave_s, clock
        self._session_of: dict[str, str] = {}
        self._closed: OrderedDict[str, tuple[float, S]] = OrderedDict()
        self._changed = threading.Condition()

    def claim(self, tab: object, session: str) -> tuple[str, S | None]:
        """Return the name of the tab that a session is in, a new one if need be, and the state that the tab left.

        Waits while another session is in that tab, as a reloaded page may connect before the old session has ended.
        """
        with self._changed:
            self._drop_old()
            name = tab if isinstance(tab, str) and (tab in self._closed or tab in self._session_of) else None
            if name is not None and self._session_of.get(name) != session and not self._wait_until_left(name):
                name = None  # the other session stays: this tab is a duplicate
            name = name or secrets.token_urlsafe(12)
            _, state = self._closed.pop(name, (0.0, None))
            self._session_of[name] = session
            return name, state

    def leave(self, session: str, state: S) -> None:
        """End a session; a page that is reloaded in its tab gets the state."""
        with self._changed:
            for name in [name for name, one in self._session_of.items() if one == session]:
                del self._session_of[name]
                self._closed[name] = (self._clock(), state)
            self._drop_old()
            self._changed.notify_all()

    def __len__(self) -> int:
        """Return the number of closed tabs that are remembered."""
        return len(self._closed)

    def _wait_until_left(self, name: str) -> bool:
        return self._changed.wait_for(lambda: name not in self._session_of, self._leave_s)

    def _drop_old(self) -> None:
        while self._closed:
            left_at, _ = next(iter(self._closed.values()))
            if len(self._closed) <= self._most and self._clock() - left_at < self._kept_s:
                return
            self._closed.popitem(last=False)
