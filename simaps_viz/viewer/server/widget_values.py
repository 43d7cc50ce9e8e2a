"""A page may set a widget only to what a person could: viser 1.1.1 checks neither limits nor options."""

from collections.abc import Callable
from typing import Any

import viser
from viser import _messages


def fits(widget: Any, value: Any) -> bool:
    """Tell whether a person could have given a widget that value."""
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
