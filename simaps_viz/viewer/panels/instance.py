"""The panel about one instance: what it is, where, how often it was seen, and how it looked."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.drawing.frame_pictures import best_views, gallery, named, outlined
from simaps_viz.drawing.legend import facts_html, object_name
from simaps_viz.drawing.theme import BOX_STYLE
from simaps_viz.structures import Instance, SIMap

NOTHING: str = "(none)"
MOST_LISTED = 1000
"""Instances that the list offers, the largest; all can be clicked on the map, or found by name."""
_ID = re.compile(r"#(\d+)")
"""Files name objects by their ids on the map before the edit, which nobody sees on the page."""
LIST_HINT = f"Select an object; of more than {MOST_LISTED} the largest are listed, and Find knows all."
HELP = f'<div style="{BOX_STYLE}">Click an object on the map, choose it from the list, or type its name.</div>'


class InstancePanel:
    """The widgets; ``show`` fills them."""

    def __init__(
        self,
        gui: viser.GuiApi,
        simap: SIMap,
        on_choose: Callable[[int | None], None],
        on_frame: Callable[[int], None] = lambda frame: None,
    ) -> None:
        """Fill the current container.

        Args:
            gui: where.
            simap: the map.
            on_choose: gets the id of an instance chosen from the list.
            on_frame: gets the index of a frame whose button was pressed.
        """
        self._on_choose, self._on_frame = on_choose, on_frame
        self._ids: dict[str, int] = {}
        self._list = gui.add_dropdown("Object", tuple([NOTHING]), initial_value=NOTHING, hint=LIST_HINT)
        self._list.on_update(self._chosen)
        self._text = gui.add_html(HELP)
        self._why = gui.add_html("", visible=False)
        self._picture = gui.add_image(np.full((2, 2, 3), 255, np.uint8), visible=False)
        self._frames: dict[str, int] = {}
        self._jump = gui.add_button_group("Show frame", ("-",), visible=False, hint="Go to that frame of the build.")
        self._jump.on_click(lambda event: self._jumped(str(event.target.value)))
        self._note = gui.add_html("", visible=False)
        self.list(simap)

    def list(self, simap: SIMap) -> None:
        """Offer the instances of a map."""
        names = object_names(simap)
        if names == self._ids:
            return
        chosen = str(self._list.value)
        self._ids = names
        self._list.options = (NOTHING, *names)
        if chosen in names:
            self._list.value = chosen

    def show(self, simap: SIMap, instance: Instance | None) -> None:
        """Describe an instance, or say how to choose one; the pictures follow with ``show_pictures``."""
        self._picture.visible = self._jump.visible = False
        self._note.visible = instance is not None
        self._note.content = _small("Fetching its best views …")
        self._why.visible = False
        self._text.content = HELP if instance is None else facts_html(simap, instance)
        name = NOTHING if instance is None else object_name(simap, instance)
        if name not in self._list.options:
            self._ids = {name: instance.id, **self._ids} if instance is not None else self._ids
            self._list.options = (NOTHING, *self._ids)
        if self._list.value != name:
            self._list.value = name

    def explain(self, summary: str | None, edits: Sequence[Mapping[str, Any]] = ()) -> None:
        """Describe why it is one object, as HTML, and who has edited it by hand; None = nothing is selected."""
        self._why.content = (summary or "") + edits_html(edits)
        self._why.visible = summary is not None

    def show_pictures(self, picture: NDArray | None, note: str, frames: Mapping[str, int] | None = None) -> None:
        """Show the best views, uint8 [H, W, 3], a line under them, and buttons for their frames (name -> index)."""
        if picture is not None:
            self._picture.image = picture
        self._picture.visible = picture is not None
        self._note.content = _small(note)
        self._note.visible = True
        self._frames = dict(frames or {})
        if self._frames:
            self._jump.options = tuple(self._frames)
        self._jump.visible = bool(self._frames)

    def _jumped(self, name: str) -> None:
        if name in self._frames:
            self._on_frame(self._frames[name])

    def _chosen(self, event: viser.GuiEvent) -> None:
        if event.client_id is not None:
            self._on_choose(self._ids.get(str(self._list.value)))


def edits_html(edits: Sequence[Mapping[str, Any]]) -> str:
    """Describe who made an object what it is by hand, the last edit first; nothing where nobody did."""
    if not edits:
        return ""
    lines = ""
    for edit in reversed(edits):
        what = _ID.sub(r"(number \1)", str(edit.get("what")))
        when = str(edit.get("when"))[:16].replace("T", " ")
        lines += f"<div>{escape(what)}, by {escape(str(edit.get('who')))}, {escape(when)} UTC</div>"
    return f'<div style="{BOX_STYLE}"><b>Edited by hand</b>{lines}</div>'


def object_names(simap: SIMap, most: int = MOST_LISTED) -> dict[str, int]:
    """Return {name: id} of a map's instances, named as `legend.object_name` does, of many only the largest."""
    total = Counter(instance.label for instance in simap.instances)
    number: Counter[str] = Counter()
    floor = 0
    if len(simap.instances) > most:
        floor = sorted((instance.cells for instance in simap.instances), reverse=True)[most - 1]
    names: dict[str, int] = {}
    for instance in simap.instances:
        number[instance.label] += 1
        if instance.cells >= floor and len(names) < most:
            names[f"{instance.label} {number[instance.label]} of {total[instance.label]}"] = instance.id
    return names


def _small(note: str) -> str:
    return f'<div style="padding:0 .8em .4em;font-size:.85em">{escape(note)}</div>'


def best_pictures(
    simap: SIMap, instance_id: int, view: Callable[[int], tuple[NDArray, NDArray] | None]
) -> tuple[NDArray | None, str, dict[str, int]]:
    """Return an instance's best views side by side (None when the sequence is not at hand), a note, and the frames."""
    views = best_views(simap, instance_id)
    names = {simap.frame_names[one.frame]: one.frame for one in views}
    pictures = []
    for one in views:
        seen = view(one.frame)
        if seen is not None:
            pictures.append(named(outlined(*seen, one.segments), simap.frame_names[one.frame]))
    if pictures:
        return gallery(pictures), "Its best views, the object's mask outlined.", names
    note = "The sequence is not at hand, so its best views cannot be shown here."
    return None, note if views else "No frame named this object.", names
