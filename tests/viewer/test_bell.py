"""A page hears of every message, whenever a thread puts it in: also between the loop's look and its waiting."""

import asyncio
import threading
import time
from typing import Any

import pytest
import viser.infra._infra as infra
from browser import free_port
from viser import ViserServer
from viser._messages import RunJavascriptMessage
from viser.infra._async_message_buffer import AsyncMessageBuffer

from simaps_viz.viewer.server.access import Access
from simaps_viz.viewer.server.gate import Gate
from simaps_viz.viewer.server.threadsafe_event import Bell, RungBuffer


@pytest.fixture
def loop():
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    yield loop
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.run_until_complete(loop.shutdown_asyncgens())
    loop.close()


def message(text: str) -> RunJavascriptMessage:
    return RunJavascriptMessage(source=text)


def until(holds, timeout_s=60.0):
    end = time.monotonic() + timeout_s
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


class Drained:
    """What a page gets, and a thread that puts a message in exactly when the loop is about to wait."""

    def __init__(self, buffer: AsyncMessageBuffer) -> None:
        self.buffer, self.got, self.late = buffer, [], []
        self._find_loop: Any = getattr(buffer.message_event, "_get_loop")  # noqa: B009 - what asyncio asks between its look and its waiting
        vars(buffer.message_event)["_get_loop"] = self._about_to_wait
        self._task = asyncio.run_coroutine_threadsafe(self._drain(), buffer.event_loop)

    async def _drain(self) -> None:
        async for window in self.buffer.window_generator(0):
            self.got += [one.source for one in window if isinstance(one, RunJavascriptMessage)]

    def _about_to_wait(self):
        if self.late:
            thread = threading.Thread(target=self.buffer.push, args=(message(self.late.pop()),))
            thread.start()
            thread.join()
        return self._find_loop()

    def end(self) -> None:
        self.buffer.set_done()
        self._task.cancel()


def told(loop, kind: type[AsyncMessageBuffer], timeout_s: float) -> list[str]:
    """What is heard of a first, a late and a last message."""
    drained = Drained(kind(loop, persistent_messages=False))
    drained.buffer.push(message("first"))
    assert until(lambda: drained.got == ["first"])
    time.sleep(0.1)  # it waits again
    drained.late = ["late"]
    drained.buffer.push(message("next"))
    assert until(lambda: drained.buffer.message_counter == 3)
    time.sleep(0.05)
    drained.buffer.push(message("last"))
    until(lambda: "last" in drained.got, timeout_s)
    drained.end()
    return drained.got


def test_a_message_put_in_at_the_worst_moment_is_heard_and_so_are_those_after_it(loop) -> None:
    assert told(loop, RungBuffer, 60.0) == ["first", "next", "late", "last"]


def test_it_is_needed(loop) -> None:
    """When viser hears them all by itself, the bell can go."""
    assert told(loop, AsyncMessageBuffer, 1.0) == ["first", "next"]


def test_the_workbench_has_such_buffers_for_the_server_and_for_each_page() -> None:
    with Gate(Access()).guard():
        server = ViserServer("127.0.0.1", free_port(), verbose=False)
    try:
        assert isinstance(server._websock_server._broadcast_buffer, RungBuffer)
        assert infra.__dict__["AsyncMessageBuffer"] is RungBuffer  # pages come later
    finally:
        server.stop()


def test_a_closed_loop_is_no_error() -> None:
    loop = asyncio.new_event_loop()
    bell = Bell(loop)
    loop.close()
    bell.set()
    assert not bell.is_set()
