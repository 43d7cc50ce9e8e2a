"""Wakes what sends messages to a page.

viser 1.1.1 rings an ``asyncio.Event`` from whatever thread has a message. Such an event may be used in its loop's own
thread only: rung after the loop has looked at it and before the loop waits for it, it stays rung and wakes nobody, and
neither does any later ring. That page would get nothing any more.
"""

import asyncio
import contextlib
from typing import Any

import viser.infra._infra as infra
from viser.infra._async_message_buffer import AsyncMessageBuffer


class Bell(asyncio.Event):
    """An event of a loop that any thread may set."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take the loop that waits for it."""
        super().__init__()
        self._own = loop

    def set(self) -> None:
        """Wake who waits, from the loop's own thread; nobody waits in a loop that is closed."""
        if _running_loop() is self._own:
            super().set()
        else:
            with contextlib.suppress(RuntimeError):
                self._own.call_soon_threadsafe(super().set)


class RungBuffer(AsyncMessageBuffer):
    """viser's own buffer of messages, with such a bell."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.message_event = Bell(self.event_loop)


def hang_bells() -> None:
    """Have viser use it for the servers and pages that come."""
    infra.__dict__["AsyncMessageBuffer"] = RungBuffer


def _running_loop() -> asyncio.AbstractEventLoop | None:
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None
