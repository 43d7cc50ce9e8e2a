"""Widgets that call a function when a person uses them; what the program itself sets calls nothing."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import viser

W = TypeVar("W", bound=Any)


def by_person(widget: W, do: Callable[[], None]) -> W:
    """Call a function when a person changes a widget; returns the widget."""
    widget.on_update(lambda event: do() if event.client_id is not None else None)
    return widget


def button(gui: viser.GuiApi, label: str, do: Callable[[], None], **options: Any) -> viser.GuiButtonHandle:
    """Add a button that calls a function; ``options`` are viser's."""
    made = gui.add_button(label, **options)
    made.on_click(lambda _: do())
    return made


def button_row(
    gui: viser.GuiApi, label: str, actions: Mapping[str, Callable[[], None]], **options: Any
) -> viser.GuiButtonGroupHandle:
    """Add a row of buttons, each of which calls its function; ``options`` are viser's."""
    made = gui.add_button_group(label, tuple(actions), **options)
    made.on_click(lambda event: actions[str(event.target.value)]())
    return made
