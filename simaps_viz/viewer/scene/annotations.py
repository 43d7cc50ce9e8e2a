"""Texts and lines on the map that stay readable while a page zooms."""

import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.drawing.label_layout import Box, Label, spread

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


class LabelLayer:
    """Texts below one name of a page's scene; they find other places when the page zooms."""

    def __init__(
        self,
        page: viser.ViserServer | viser.ClientHandle,
        name: str,
        *,
        assumed_m: Callable[[], float] = lambda: 10.0,
        zoomed: Callable[[float], None] = lambda metres_per_px: None,
    ) -> None:
        """Show nothing yet; ``zoomed`` is called with the metres a pixel shows when that has changed."""
        self._page, self._name, self._zoomed = page, name, zoomed
        self.lock = threading.RLock()
        """Held while anything is drawn, and while ``zoomed`` is called, which is on a thread of its own: whoever
        draws more than these texts takes it too."""
        self._labels: tuple[Label, ...] = ()
        self._blocked: tuple[Box, ...] = ()
        self._within: Box | None = None
        self._named: Label | None = None
        self._z_m = 0.0
        self._handles: list[viser.LabelHandle] = []
        self._zoom = Zoom(page, self.place, assumed_m=assumed_m)

    @property
    def metres_per_px(self) -> float:
        """How much of the floor a pixel shows."""
        return self._zoom.metres_per_px()

    def show(
        self,
        labels: Sequence[Label],
        *,
        blocked: Sequence[Box] = (),
        within: Box | None = None,
        named: Label | None = None,
        z_m: float = 0.05,
    ) -> None:
        """Show other texts, the most important first, at a height; other arguments as of `spread`."""
        with self._page.atomic(), self.lock:
            for handle in self._handles:
                handle.remove()
            self._labels, self._blocked, self._z_m = tuple(labels), tuple(blocked), z_m
            self._within, self._named = within, named
            self._handles = [
                self._page.scene.add_label(
                    f"{self._name}/{i}", label.text, position=(label.x, label.y, z_m), anchor="center-center"
                )
                for i, label in enumerate(self._labels)
            ]
            self._lay()

    def place(self) -> None:
        """Lay the texts out for the current zoom."""
        with self._page.atomic(), self.lock:
            self._zoomed(self._lay())

    def _lay(self) -> float:
        metres_per_px = self._zoom.metres_per_px()
        places = spread(self._labels, metres_per_px, self._blocked, within=self._within, named=self._named)
        for handle, place in zip(self._handles, places, strict=True):
            if place is not None:
                handle.position = (*place, self._z_m)
            handle.visible = place is not None
        return metres_per_px


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
