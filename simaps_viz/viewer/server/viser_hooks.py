"""All uses of viser beyond its public interface; none of its modules is patched.

1. `admit_only`, on a server: a WebSocket on its private port needs a key; and messages that other threads put in are
   heard at once (a fault of viser 1.1.1, see `Bell`). It needs ``_websock_server`` with ``on_client_connect``,
   ``_client_connect_cb``, ``_live_connections``, ``_client_state_from_id``, ``_background_event_loop`` and
   ``get_message_buffer()``, whose ``message_event`` is an ``asyncio.Event``.
2. `role_of`, of a page: the role that the front door gave it. It needs ``_live_connections``.
3. `guard`, on a page: what callbacks raise appears on that page. It needs ``_thread_executor`` of ``gui`` and
   ``scene``.
4. `check_values`, on a page: a widget takes only values that fit it. It needs ``_websock_connection`` with
   ``_incoming_handlers``, and ``gui._gui_input_handle_from_uuid``.
5. `inputs_of`, of a page: its widgets with a value. It needs ``gui._gui_input_handle_from_uuid``.
6. `initial_camera`, of a page: the public ``ViserServer.initial_camera`` for one page. It needs ``_websock_connection``
   with ``queue_message``, and messages with a ``redundancy_key``.

``tests/viewer/test_viser_hooks.py`` checks each of them by what it does.
"""

import asyncio
import contextlib
import hmac
import logging
from collections.abc import Callable
from typing import Any

import viser
from viser import _messages

from simaps_viz.viewer.server.access import Role
from simaps_viz.viewer.server.page_socket import KEY_HEADER, ROLE_HEADER

logger = logging.getLogger(__name__)


class Bell(asyncio.Event):
    """An event of a loop that any thread may set.

    viser 1.1.1 sets an ``asyncio.Event`` from any thread that has a message for a page, but such an event may be used
    only in the thread of its loop. Set after the loop has tested it and before the loop waits for it, it stays set
    without waking the loop, and so does every later call. That page would receive no further messages.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take the loop that waits for it."""
        super().__init__()
        self._own = loop

    def set(self) -> None:
        """Wake the waiting task from the loop's own thread; a closed loop has no waiting task."""
        try:
            running = asyncio.get_running_loop()
        except RuntimeError:
            running = None
        if running is self._own:
            super().set()
        else:
            with contextlib.suppress(RuntimeError):
                self._own.call_soon_threadsafe(super().set)


def hang_bell(buffer: Any) -> None:
    """Equip a buffer of messages with such an event, before anybody waits for the one it has."""
    bell = Bell(buffer.event_loop)
    buffer.message_event = bell
    bell.set()  # it may hold messages already


def admit_only(server: viser.ViserServer, key: str) -> None:
    """Have a viser server accept only WebSockets that bring a key; to be called before its port is known to anybody.

    Browsers cannot send the header that holds it, and other accounts of this machine do not know it: whoever comes has
    passed the front door.
    """
    connections = server._websock_server
    loop = connections._background_event_loop
    assert loop is not None

    async def admit(page: Any) -> None:
        connection = connections._live_connections[page.client_id]
        request = connection.request
        given = "" if request is None else request.headers.get(KEY_HEADER, "")
        if hmac.compare_digest(given.encode(errors="replace"), key.encode()):
            hang_bell(page.get_message_buffer())
            return
        logger.warning("refused: a WebSocket on viser's private port")
        connections._live_connections.pop(page.client_id, None)
        connections._client_state_from_id.pop(page.client_id, None)
        await connection.close(1008, "this port is private")
        raise asyncio.CancelledError  # viser hears nothing of it, and websockets ends its task

    connections._client_connect_cb.insert(0, admit)
    hang_bell(connections.get_message_buffer())
    loop.call_soon_threadsafe(loop.set_exception_handler, _log_failure)


def role_of(server: viser.ViserServer, client: viser.ClientHandle) -> Role:
    """Return the role of a page's person; a page that has gone meanwhile is a visitor's."""
    connection = server._websock_server._live_connections.get(client.client_id)
    request = None if connection is None else connection.request
    return "owner" if request is not None and request.headers.get(ROLE_HEADER) == "owner" else "visitor"


def initial_camera(client: viser.ClientHandle) -> viser.InitialCameraConfig:
    """Return where one page's camera begins, and returns to whenever the page is set up anew; what is set is sent."""
    queue = client._websock_connection.queue_message

    def queue_apart(message: Any) -> None:
        # Of the messages of one kind that wait, viser sends the last only: this one must not replace the camera's own.
        key = f"initial {message.redundancy_key()}"
        message.redundancy_key = lambda: key
        queue(message)

    return viser.InitialCameraConfig(queue_apart)


def _log_failure(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Write one line where asyncio would write a traceback: a message made no sense to the widget it named."""
    logger.warning("a message could not be handled: %r", context.get("exception") or context.get("message"))


class _GuardedPool:
    """Runs callbacks as the server's own threads do, and reports to one page what they raise."""

    def __init__(self, pool: Any, report: Callable[[Exception], None]) -> None:
        self._pool, self._report = pool, report

    def submit(self, callback: Callable[..., Any], *arguments: Any) -> Any:
        return self._pool.submit(self._run, callback, *arguments)

    def _run(self, callback: Callable[..., Any], *arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception as error:  # an error of any kind must not end the page
            self._report(error)


def guard(client: viser.ClientHandle, report: Callable[[Exception], None]) -> None:
    """Make the errors of every callback of a page, whoever wrote it, appear on that page.

    viser 1.1.1 would only print them. It also warns when a thread still sends to a page that has just been closed,
    which cannot be avoided.
    """
    for api in (client.gui, client.scene):
        api._thread_executor = _GuardedPool(api._thread_executor, report)  # pyright: ignore[reportAttributeAccessIssue]
    with contextlib.suppress(AttributeError):
        client._websock_connection.get_message_buffer()._warned_push_after_done = True


def check_values(client: viser.ClientHandle, note: Callable[[str], None]) -> None:
    """Let through to a page's widgets only what fits them; ``note`` is told of the rest."""
    handlers = client._websock_connection._incoming_handlers[_messages.GuiUpdateMessage]
    first = list(handlers)

    async def checked(client_id: Any, message: Any) -> None:
        widget = client.gui._gui_input_handle_from_uuid.get(message.uuid)
        if widget is not None and not fits(widget, message.updates.get("value")):
            note("a value that a widget cannot have")
            return
        for handler in first:
            await handler(client_id, message)  # pyright: ignore[reportGeneralTypeIssues]

    handlers[:] = [checked]


def inputs_of(gui: viser.GuiApi) -> list[viser.GuiInputHandle]:
    """Return the widgets of a page that hold a value of a person: all but buttons."""
    return [one for one in gui._gui_input_handle_from_uuid.values() if isinstance(one, viser.GuiInputHandle)]


def fits(widget: Any, value: Any) -> bool:
    """Return whether a person could have given a widget that value."""
    state = widget._impl
    now, props = state.value, state.props
    options = getattr(props, "options", None)
    if options is not None:
        return isinstance(value, str) and value in options
    if isinstance(now, bool):
        return isinstance(value, bool)
    if isinstance(now, int | float):
        low, high = getattr(props, "min", None), getattr(props, "max", None)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and (low is None or value >= low) and (high is None or value <= high)
    if isinstance(now, str):
        return isinstance(value, str)
    if isinstance(now, tuple):
        same = isinstance(value, list | tuple) and len(value) == len(now)
        return same and all(isinstance(one, int | float) for one in value)
    return False
