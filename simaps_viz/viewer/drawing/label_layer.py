"""Texts on the map that stay readable while a page zooms."""

import threading
from collections.abc import Callable, Sequence

import viser

from simaps_viz.viewer.drawing.label_layout import Box, Label, spread
from simaps_viz.viewer.drawing.zoom import Zoom


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
        """Show nothing yet; ``zoomed`` is told the metres a pixel shows when that has changed."""
        self._page, self._name, self._zoomed = page, name, zoomed
        self.lock = threading.RLock()
        """Held while anything is drawn, and while ``zoomed`` is told, which comes from a thread of its own: whoever
        draws more than these texts takes it too."""
        self._labels: tuple[Label, ...] = ()
        self._blocked: tuple[Box, ...] = ()
        self._z_m = 0.0
        self._handles: list[viser.LabelHandle] = []
        self._zoom = Zoom(page, self.place, assumed_m=assumed_m)

    @property
    def metres_per_px(self) -> float:
        """How much of the floor a pixel shows."""
        return self._zoom.metres_per_px()

    def show(self, labels: Sequence[Label], *, blocked: Sequence[Box] = (), z_m: float = 0.05) -> None:
        """Show other texts, the most important first; ``blocked`` is what they should not cover."""
        with self._page.atomic(), self.lock:
            for handle in self._handles:
                handle.remove()
            self._labels, self._blocked, self._z_m = tuple(labels), tuple(blocked), z_m
            self._handles = [
                self._page.scene.add_label(
                    f"{self._name}/{i}", label.text, position=(label.x, label.y, z_m), anchor="center-center"
                )
                for i, label in enumerate(self._labels)
            ]
            self._lay()

    def place(self) -> None:
        """Find the texts places for the zoom of now."""
        with self._page.atomic(), self.lock:
            self._zoomed(self._lay())

    def _lay(self) -> float:
        metres_per_px = self._zoom.metres_per_px()
        places = spread(self._labels, metres_per_px, self._blocked)
        for handle, place in zip(self._handles, places, strict=True):
            if place is not None:
                handle.position = (*place, self._z_m)
            handle.visible = place is not None
        return metres_per_px
