"""Texts and lines on the map that stay readable while a page zooms."""

import json
import threading
from collections.abc import Callable, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.structures import Instance

CANVAS_PX = 560.0
"""Height of the canvas assumed until a page has reported its own."""
FINE_FROM_PX = 1500
"""A canvas of more rows is taken for one of a fine screen."""
CHANGE = 0.1
"""Share by which the size of a metre has to change before anything is drawn anew."""
REST_S = 0.25
"""For how long the camera has to rest before that."""


class Zoom:
    """Reports when the size of a metre on one page has changed, once its camera rests."""

    def __init__(
        self,
        page: "viser.ViserServer | viser.ClientHandle",
        changed: Callable[[], None],
        *,
        assumed_m: Callable[[], float] = lambda: 10.0,
        rest_s: float = REST_S,
    ) -> None:
        """Watch a page.

        Args:
            page: a server has no camera of its own.
            changed: called from a thread of its own, once the camera rests.
            assumed_m: how much of the floor, from south to north, a page is assumed to show until it reports.
            rest_s: for how long the camera has to rest.
        """
        self._page, self._changed, self._assumed_m, self._rest_s = page, changed, assumed_m, rest_s
        self._lock = threading.Lock()
        self._waiting: threading.Timer | None = None
        self._reported = 0.0
        if isinstance(page, viser.ClientHandle):
            page.camera.on_update(lambda _: self._moved())

    def metres_per_px(self) -> float:
        """Return how much of the floor a pixel of the screen shows, where the camera looks."""
        found = None
        if isinstance(self._page, viser.ClientHandle):
            found = seen_metres_per_px(self._page.camera)
        self._reported = self._assumed_m() / CANVAS_PX if found is None else found
        return self._reported

    def _moved(self) -> None:
        assert isinstance(self._page, viser.ClientHandle)
        now = seen_metres_per_px(self._page.camera)
        if now is None or (self._reported > 0.0 and abs(now / self._reported - 1.0) < CHANGE):
            return
        with self._lock:
            if self._waiting is not None:
                self._waiting.cancel()
            self._waiting = threading.Timer(self._rest_s, self._changed)
            self._waiting.daemon = True
            self._waiting.start()


def seen_metres_per_px(camera: Any) -> float | None:
    """Return how many metres a pixel shows where a camera looks; None for one that has not reported yet."""
    if camera.update_timestamp == 0.0 or camera.image_height <= 0:
        return None
    away = float(np.linalg.norm(np.subtract(camera.position, camera.look_at)))
    shown = 2.0 * away * float(np.tan(float(camera.fov) / 2.0))
    # viser reports rows of the canvas: between three quarters of a page's pixels (where drawing is slow) and all those
    # of the screen, of which fine screens have two for one of the page.
    rows = float(camera.image_height) / (2.0 if camera.image_height > FINE_FROM_PX else 1.0)
    return shown / rows if shown > 0.0 else None


class Label(NamedTuple):
    """A text and the position or object that it names. Metres, map frame."""

    text: str
    """Empty: what is there is only kept free of other texts."""
    x: float
    y: float
    reach_x: float = 0.0
    """Half the object's size from west to east; its text is next to it. With 0 here and in ``reach_y`` it is on the
    position."""
    reach_y: float = 0.0
    away_x: float = 0.0
    """The side on which the text should be, if there is room: a direction, of any length; 0, 0 = above."""
    away_y: float = 0.0
    z: float = 0.0
    reach_z: float = 0.0
    id: int = 0
    """The instance, which is outlined too; 0 outlines none."""


def label_of(text: str, one: Instance) -> Label:
    """Return a label next to an instance."""
    (x0, y0, z0), (x1, y1, z1) = one.aabb_m
    middle, reach = ((x0 + x1) / 2, (y0 + y1) / 2), ((x1 - x0) / 2, (y1 - y0) / 2)
    return Label(text, *middle, *reach, z=(z0 + z1) / 2, reach_z=(z1 - z0) / 2, id=one.id)


KINDS = ("selection", "change", "command", "why", "rooms", "compare")
"""Of texts, the most important first; the last are those of a picture that lies over the map."""


class Texts:
    """The texts on one page's map, in a hidden piece of HTML; ``map.js`` lays them out, none over another."""

    def __init__(self, page: viser.ViserServer | viser.ClientHandle) -> None:
        """Show nothing yet."""
        self._html, self._lock = page.gui.add_html(""), threading.Lock()
        self._of: dict[str, tuple[Label, ...]] = dict.fromkeys(KINDS, ())

    def __getitem__(self, kind: str) -> tuple[Label, ...]:
        """Return the texts of a kind."""
        return self._of[kind]

    def show(self, kind: str, labels: Sequence[Label]) -> None:
        """Show other texts of one of `KINDS`, the most important first."""
        with self._lock:
            if self._of[kind] != tuple(labels):
                self._of[kind] = tuple(labels)
                rows = [(kind, *label) for kind, labels in self._of.items() for label in labels]
                told = escape(json.dumps(rows))
                self._html.content = f'<div class="simaps-texts" hidden data-texts="{told}"></div>'


FULL_FROM_PX = 60.0
"""Objects smaller than this on the screen get thinner lines, because thick ones would hide them."""
MIN_LINE_SHARE = 0.4
"""Share of a line's thickness that is left around the smallest."""


def line_share(segments: NDArray, metres_per_px: float) -> float:
    """Return the share of their thickness that lines around an object, float [n, 2, 3], should have."""
    if not len(segments):
        return 1.0
    corners = segments.reshape(-1, 3)[:, :2]
    size_px = float((corners.max(axis=0) - corners.min(axis=0)).min()) / metres_per_px
    return float(np.clip(size_px / FULL_FROM_PX, MIN_LINE_SHARE, 1.0))


def draw_lines(
    scene: viser.SceneApi, name: str, segments: NDArray, color: Color, thickness_px: float, *, visible: bool = True
) -> None:
    """Draw line segments, float [n, 2, 3], map frame, metres, instead of those of that name; n = 0: none."""
    if len(segments):
        scene.add_line_segments(
            name, segments, color, thickness=thickness_px, thickness_units="screen", visible=visible
        )
    elif scene.get_handle_by_name(name) is not None:
        scene.remove_by_name(name)
