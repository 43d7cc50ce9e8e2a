"""One person's page from its opening to its end, and what a page that is loaded again restores."""

import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import viser

from simaps_viz.structures import SIMap
from simaps_viz.viewer.layout import Layout, specs_of
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.scene.camera import TOP, CameraState

if TYPE_CHECKING:
    from simaps_viz.viewer.workbench import Workbench


@dataclass(frozen=True, eq=False)
class TabState:
    """A page as it was left."""

    published: "weakref.ref[SIMap]"
    """The map that was on all pages."""
    own: SIMap | None
    """The map of this page, where it was another."""
    picked: tuple[float, float] | None
    """The position that was selected, map frame, metres."""
    frame: int | None
    """The frame shown; None = the last one."""
    camera: CameraState
    panels: Mapping[str, Any]
    """What each panel's ``state`` returned."""


class Session(Page):
    """The page of one browser tab, with its panels; it ends with its connection."""

    def __init__(self, client: viser.ClientHandle, workbench: "Workbench") -> None:
        """Build the page; nothing is painted before ``begin``."""
        self._waiting_state: TabState | None = None
        with client.atomic():
            super().__init__(client, workbench)
            self._layout = Layout(self)

    def begin(self, state: TabState | None) -> None:
        """Paint the page, restored where its tab is known; of several calls those with a state count."""
        with self._lock:
            first, self._begun = not self._begun, True
            if self._closed or (state is None and not first):
                return
            self._waiting_state = state
        self.worker.submit("begin", self._begin_now)

    def settle(self, width_px: object = None) -> None:
        """Lay the panels out anew, now that the browser shows them on a page of that width."""
        self.worker.submit("settle", lambda: self._layout.settle(width_px))

    def reveal(self, title: str, *, only_from: str = "", focus: str = "") -> None:
        """Open a tab of this page; arguments as of `Page.reveal`."""
        self._layout.open_tab(title, only_from, focus)

    def catch_up(self) -> None:
        """Have the panels that only a finished map has, soon, if the map that was being built is done."""
        self.worker.submit("panels", self._catch_up_now)

    def close(self, timeout_s: float = 2.0) -> TabState:
        """End all that runs, and return what a page that is loaded again needs."""
        with self._lock:
            state = self._waiting_state or self._state()
            self._closed = True
        self.stop_playing()
        self.panels.each(lambda panel: panel.close())
        self.recording.close()
        for worker in (self.command_worker, self.panel_worker, self.worker):
            worker.stop(timeout_s)
        return state

    def _state(self) -> TabState:
        published = self.workbench.simap
        return TabState(
            published=weakref.ref(published),
            own=None if self.base is published else self.base,
            picked=self.picked,
            frame=None if self.at_end else self.frame,
            camera=self.viewpoints.state(),
            panels=self.panels.states(),
        )

    def _restore(self, state: TabState) -> None:
        """Restore what was done on the page before; a map published since then is kept."""
        if state.own is not None and state.published() is self.workbench.simap:
            self.take_map_now(state.own)
        self.remember(state.picked)
        if state.frame is not None:
            self.show_frame(state.frame)
        if state.camera.name != TOP:
            self.look(state.camera.name)
        self.viewpoints.go_to(state.camera)
        self.panels.restore(state.panels)

    def _begin_now(self) -> None:
        with self._lock:
            state = self._waiting_state
        if state is not None:
            with self.client.atomic():
                self._restore(state)
            self._waiting_state = None
        self._map_changed()
        self.panels.built()

    def _catch_up_now(self) -> None:
        wanted = specs_of(self)
        if not self._closed and self.panels.specs != tuple(wanted):
            with self.client.atomic():
                self.panels.have(wanted)
            self.panels.each(lambda panel: panel.time_changed(self.frame, self.time.step))
            self.worker.submit("recorded", self.recording.opened)  # once the finished map, and its last frame, are here
