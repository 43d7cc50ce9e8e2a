"""The panel about one instance: what it is, where, how often it was seen, and how it looked."""

from collections.abc import Callable
from html import escape

import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.structures import Instance, SIMap
from simaps_viz.viewer.legend import facts_html, object_name

NOTHING: str = "(none)"
HELP = (
    '<div style="padding:.4em .8em;font-size:.82em;opacity:.75">Click an object on the map, '
    "or choose one from the list.</div>"
)


class InstancePanel:
    """The widgets; ``show`` fills them."""

    def __init__(self, gui: viser.GuiApi, simap: SIMap, on_choose: Callable[[int | None], None]) -> None:
        """Fill the current container; ``on_choose`` gets the id of an instance chosen from the list."""
        self._on_choose = on_choose
        self._ids: dict[str, int] = {}
        self._list = gui.add_dropdown("Object", tuple([NOTHING]), initial_value=NOTHING)
        self._list.on_update(self._chosen)
        self._text = gui.add_html(HELP)
        self._picture = gui.add_image(np.full((2, 2, 3), 255, np.uint8), visible=False)
        self._note = gui.add_html("", visible=False)
        self.list(simap)

    def list(self, simap: SIMap) -> None:
        """Offer the instances of a map."""
        names = {object_name(simap, instance): instance.id for instance in simap.instances}
        if names == self._ids:
            return
        self._ids = names
        self._list.options = (NOTHING, *names)

    def show(self, simap: SIMap, instance: Instance | None) -> None:
        """Describe an instance, or say how to choose one; the pictures follow with ``show_pictures``."""
        self._picture.visible = False
        self._note.visible = False
        self._text.content = HELP if instance is None else facts_html(simap, instance)
        name = NOTHING if instance is None else object_name(simap, instance)
        if self._list.value != name and name in self._list.options:
            self._list.value = name

    def show_pictures(self, picture: NDArray | None, note: str) -> None:
        """Show the best views, uint8 [H, W, 3], and a line under them."""
        if picture is not None:
            self._picture.image = picture
        self._picture.visible = picture is not None
        self._note.content = f'<div style="padding:0 .8em .4em;font-size:.78em;opacity:.75">{escape(note)}</div>'
        self._note.visible = True

    def _chosen(self, event: viser.GuiEvent) -> None:
        if event.client_id is not None:
            self._on_choose(self._ids.get(str(self._list.value)))
