"""What the page itself needs to name objects under the pointer: the map's objects and their cells, sent once a map."""

import base64
import json
from html import escape
from typing import Any

import cv2
import numpy as np

from simaps_viz.structures import Instance, SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel
from simaps_viz.viewer.page.timeline import Snapshot
from simaps_viz.viewer.panels.map import MapPanel

MAX_SIDE = 1024
"""Cells of the picture of ids a side; of a larger map every second cell is sent, or every third."""
MAX_NAMED = 3000
"""Objects that the page names: the largest."""


class NamesPanel(Panel):
    """Two hidden pieces of HTML that ``map.js`` reads; nothing of the panel is seen."""

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page = page
        self._objects, self._state = page.gui.add_html(""), page.gui.add_html("")
        self._shown: SIMap | None = None
        self._show_state()

    def painted(self, simap: SIMap, snapshot: Snapshot) -> None:
        """Send the objects of the map, none of an earlier one: its objects have no names yet."""
        shown = None if snapshot.badge else simap
        if shown is not self._shown:
            self._shown = shown
            self._objects.content = "" if shown is None else self._page.shared.names(shown, names_html)
        self._show_state()

    def selection_changed(self, instance_id: int | None) -> None:
        """Send which object is selected."""
        self._show_state()

    def view_changed(self, name: str) -> None:
        """Send whether the map is seen from above."""
        self._show_state()

    def built(self) -> None:
        """Send the state of a page that was loaded again."""
        self._show_state()

    def told(self, event: dict[str, Any]) -> None:
        """Turn the view to the north, and back to the whole map."""
        if event.get("type") == "north":
            self._page.look(self._page.viewpoints.name)

    def _show_state(self) -> None:
        page, only, faded = self._page, None, ()
        if MapPanel in page.panels:
            shown = page.panels[MapPanel]
            only, faded = shown.shown_class, sorted(shown.faded)
        state = {"view": page.viewpoints.name, "selected": page.selected, "only": only, "faded": faded}
        content = f'<div class="simaps-state" hidden data-state="{escape(json.dumps(state))}"></div>'
        if self._state.content != content:
            self._state.content = content


def hint_text(one: Instance, cell_m: float) -> str:
    """Return what is said of the object under the pointer: "chair 18 · 0.22 m² · score 0.86"."""
    area = one.area_m2(cell_m)
    return f"{one.name} · {area:.{2 if area >= 0.01 else 4}f} m² · score {one.score:.2f}"


def names_html(simap: SIMap) -> str:
    """Write the objects of a map for the page's script.

    Their ids are a PNG, one pixel a cell, row 0 at the south: red + 256 * green + 65536 * blue, 0 = none. The rest is
    JSON: the map's extent and the side of a pixel, metres; and of each object, the largest first, id, name, class and
    what is said of it.
    """
    step = -(-max(simap.spec.shape) // MAX_SIDE)
    ids = simap.instance[::step, ::step]
    picture = np.stack([ids >> 16, ids >> 8 & 255, ids & 255], axis=2).astype(np.uint8)  # OpenCV's order: blue first
    png = base64.b64encode(cv2.imencode(".png", picture)[1].tobytes()).decode()
    cell_m = simap.spec.cell_size_m
    largest = sorted(simap.instances, key=lambda one: (-one.cells, one.id))[:MAX_NAMED]
    rows = [(one.id, one.name, one.label, hint_text(one, cell_m)) for one in largest]
    (xmin, ymin, xmax, ymax), size_m = simap.spec.extent_m, step * cell_m
    told = json.dumps({"extent": (xmin, ymin, xmax, ymax), "cell": size_m, "objects": rows})
    return (
        f'<div class="simaps-objects" hidden data-objects="{escape(told)}">'
        f'<img alt="" src="data:image/png;base64,{png}"></div>'
    )
