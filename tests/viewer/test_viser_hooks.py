"""What we need of viser beyond its public interface, by what it does; and when it is no longer needed."""

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
from attacks.target import CAMERA, open_socket, say
from viser import ClientHandle, ViserServer
from viser._messages import RunJavascriptMessage, SetCameraPositionMessage
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.sync.connection import Connection

from simaps_viz.viewer.server.page_socket import KEY_HEADER
from simaps_viz.viewer.server.viser_hooks import Bell, admit_only, check_values, guard, hang_bell, initial_camera


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


def told(loop, *, bell: bool, timeout_s: float) -> list[str]:
    """What is heard of a first, a late and a last message."""
    buffer = AsyncMessageBuffer(loop, persistent_messages=False)
    if bell:
        hang_bell(buffer)
    drained = Drained(buffer)
    drained.buffer.push(message("first"))
    assert until(lambda: drained.got == ["first"])
    waiters: Any = vars(buffer.message_event)["_waiters"]
    assert until(lambda: waiters)  # it waits again
    drained.late = ["late"]
    drained.buffer.push(message("next"))
    assert until(lambda: drained.buffer.message_counter == 3 and not drained.late)
    assert until(lambda: waiters or "late" in drained.got)
    drained.buffer.push(message("last"))
    until(lambda: "last" in drained.got, timeout_s)
    drained.end()
    return drained.got


def test_a_message_put_in_at_the_worst_moment_is_heard_and_so_are_those_after_it(loop) -> None:
    assert told(loop, bell=True, timeout_s=60.0) == ["first", "next", "late", "last"]


def test_the_bell_is_needed(loop) -> None:
    """When viser hears them all by itself, the bell can go."""
    assert told(loop, bell=False, timeout_s=1.0) == ["first", "next"]


@pytest.fixture
def server():
    made = ViserServer("127.0.0.1", 0, verbose=False)
    admit_only(made, "the key")
    yield made
    made.stop()


def test_nobody_joins_without_the_key_and_nothing_of_them_is_kept(server) -> None:
    came = []
    server.on_client_connect(came.append)
    for headers in ({}, {KEY_HEADER: "another"}):
        with open_socket(server.get_port(), additional_headers=headers) as stranger:
            say(stranger, **CAMERA)
            assert until(lambda one=stranger: one.protocol.close_code is not None)
            assert stranger.protocol.close_code == 1008
    assert not came and not server.get_clients()
    assert until(lambda: not server._websock_server._client_state_from_id)
    assert not server._websock_server._live_connections
    with open_socket(server.get_port(), additional_headers={KEY_HEADER: "the key"}) as page:
        say(page, **CAMERA)
        assert until(lambda: came and server.get_clients())


def test_the_server_and_each_page_have_the_bell(server) -> None:
    assert isinstance(server._websock_server.get_message_buffer().message_event, Bell)
    with joined(server) as (_, client):
        assert isinstance(client._websock_connection.get_message_buffer().message_event, Bell)


CLICK = {
    "type": "ScenePointerMessage", "event_type": "click", "ray_origin": (0.0, 0.0, 5.0),
    "ray_direction": (0.0, 0.0, -1.0), "screen_pos": [(0.5, 0.5)], "modifier": None,
}  # fmt: skip


@contextmanager
def joined(server: ViserServer) -> Iterator[tuple[Connection, ClientHandle]]:
    """A page, and viser's handle of it."""
    with open_socket(server.get_port(), additional_headers={KEY_HEADER: "the key"}) as page:
        say(page, **CAMERA)
        assert until(server.get_clients)
        (client,) = server.get_clients().values()
        yield page, client


def test_what_a_callback_of_a_widget_or_the_scene_raises_is_reported_to_its_page(server) -> None:
    def fail(_: object) -> None:
        raise ZeroDivisionError(f"fault {len(reported)}")

    reported: list[Exception] = []
    with joined(server) as (page, client):
        guard(client, reported.append)
        box = client.gui.add_checkbox("Box", False)
        box.on_update(fail)
        client.scene.on_click()(fail)
        say(page, type="GuiUpdateMessage", uuid=box._impl.uuid, updates={"value": True})
        assert until(lambda: len(reported) == 1) and box.value
        say(page, **CLICK)
        assert until(lambda: len(reported) == 2)
        assert [str(error) for error in reported] == ["fault 0", "fault 1"]


def test_a_widget_gets_only_values_that_fit_it_and_the_rest_is_noted(server) -> None:
    noted: list[str] = []
    with joined(server) as (page, client):
        check_values(client, noted.append)
        gui = client.gui
        widgets: list[tuple[Any, list[Any], Any]] = [
            (gui.add_slider("Number", 0.0, 1.0, 0.1, 0.5), [2.0, -0.1, "1", True, None, [0.5]], 1.0),
            (gui.add_checkbox("Box", False), [1, "yes", None], True),
            (gui.add_text("Text", "a"), [1, None, ["b"], True], "b"),
            (gui.add_dropdown("Choice", ("x", "y")), ["z", 0, None], "y"),
            (gui.add_vector3("Place", (0.0, 0.0, 0.0)), [[1.0, 2.0], ["a", "b", "c"], 1.0], (1.0, 2.0, 3.0)),
        ]
        for widget, unfit, fit in widgets:
            before, known = widget.value, len(noted)
            for value in unfit:
                say(page, type="GuiUpdateMessage", uuid=widget._impl.uuid, updates={"value": value})
            assert until(lambda known=known, unfit=unfit: len(noted) == known + len(unfit))
            assert widget.value == before
            say(page, type="GuiUpdateMessage", uuid=widget._impl.uuid, updates={"value": fit})
            assert until(lambda widget=widget, fit=fit: widget.value == fit)
        assert set(noted) == {"a value that a widget cannot have"}


def test_a_closed_loop_is_no_error() -> None:
    loop = asyncio.new_event_loop()
    bell = Bell(loop)
    loop.close()
    bell.set()
    assert not bell.is_set()


def test_where_a_camera_begins_takes_no_message_from_where_it_is_put(loop):
    """Of two of one kind that wait, viser sends the last only: a page stayed in the other view, told to leave it."""
    buffer = AsyncMessageBuffer(loop, persistent_messages=False)
    client: Any = SimpleNamespace(_websock_connection=SimpleNamespace(queue_message=buffer.push))
    first = initial_camera(client)
    for height_m in (5.0, 6.0):
        buffer.push(SetCameraPositionMessage((0.0, 0.0, height_m)))
        first.position = (1.0, 0.0, height_m)
    waiting = [one for one in buffer.message_from_id.values() if isinstance(one, SetCameraPositionMessage)]
    assert [(one.position, one.initial) for one in waiting] == [((0.0, 0.0, 6.0), False), ((1.0, 0.0, 6.0), True)]
    assert waiting[1].as_serializable_dict() == SetCameraPositionMessage((1.0, 0.0, 6.0), True).as_serializable_dict()
