"""One person's page from its opening to its end: its tab, its panels, and what a page that is loaded again restores.

The panels are in one row of tabs on the right; the recorded build is on the left, folded at first.

Every page holds a hidden frame, served by `host.Host` on 127.0.0.1, that keeps a name in its tab's own storage and
reports it. A duplicated tab has the name of the original, which is still open: it gets a new name. The frame is as wide
as the page, and reports that width too.
"""

import base64
import hashlib
import secrets
import threading
import time
import weakref
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import TYPE_CHECKING, Any, Generic, TypeGuard, TypeVar

import viser

from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import PanelSpec
from simaps_viz.viewer.panels import PANELS
from simaps_viz.viewer.scene.camera import PANEL_WIDTH_PX, RIM_PX, TOP, CameraState

if TYPE_CHECKING:
    from simaps_viz.viewer.workbench import Workbench


S = TypeVar("S")
MAX_CLOSED = 32
KEPT_S = 3600.0
LEAVE_S = 2.0
"""How long a reloaded page may wait until the session before the reload has ended."""

_SCRIPT = resources.files("simaps_viz.viewer.page").joinpath("tab.js").read_text(encoding="utf-8")
_HASH = base64.b64encode(hashlib.sha256(_SCRIPT.encode()).digest()).decode()
TAB_PAGE = f'<!doctype html><html lang="en"><title>Tab</title><script>{_SCRIPT}</script></html>'
TAB_CSP = (
    f"default-src 'none'; script-src 'sha256-{_HASH}'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors http://127.0.0.1:* http://localhost:*"
)


class Tabs(Generic[S]):
    """The names of tabs, the session that each shows, and the state that closed tabs left."""

    def __init__(
        self,
        *,
        most: int = MAX_CLOSED,
        kept_s: float = KEPT_S,
        leave_s: float = LEAVE_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Remember ``most`` closed tabs, each for ``kept_s`` seconds."""
        self._most, self._kept_s, self._leave_s, self._clock = most, kept_s, leave_s, clock
        self._session_of: dict[str, str] = {}
        self._closed: OrderedDict[str, tuple[float, S]] = OrderedDict()
        self._changed = threading.Condition()

    def claim(self, tab: object, session: str) -> tuple[str, S | None]:
        """Return the name of the tab that a session is in, a new one if need be, and the state that the tab left.

        Waits while another session is in that tab, as a reloaded page may connect before the old session has ended.
        """
        with self._changed:
            self._drop_old()
            name = tab if isinstance(tab, str) and (tab in self._closed or tab in self._session_of) else None
            if name is not None and self._session_of.get(name) != session and not self._wait_until_left(name):
                name = None  # the other session stays: this tab is a duplicate
            name = name or secrets.token_urlsafe(12)
            _, state = self._closed.pop(name, (0.0, None))
            self._session_of[name] = session
            return name, state

    def leave(self, session: str, state: S) -> None:
        """End a session; a page that is reloaded in its tab gets the state."""
        with self._changed:
            for name in [name for name, one in self._session_of.items() if one == session]:
                del self._session_of[name]
                self._closed[name] = (self._clock(), state)
            self._drop_old()
            self._changed.notify_all()

    def __len__(self) -> int:
        """Return the number of closed tabs that are remembered."""
        return len(self._closed)

    def _wait_until_left(self, name: str) -> bool:
        return self._changed.wait_for(lambda: name not in self._session_of, self._leave_s)

    def _drop_old(self) -> None:
        while self._closed:
            left_at, _ = next(iter(self._closed.values()))
            if len(self._closed) <= self._most and self._clock() - left_at < self._kept_s:
                return
            self._closed.popitem(last=False)


RECORDING_WIDTH_PX = 400
MAP_SHARE = 0.55
"""The share of the page's width that the map keeps while the recorded build is docked beside it."""
ROOMY_PX, MAX_PX = 1900, 20_000
"""Pages narrower than the first have the recorded build folded up to a strip: the room is for the map."""
PHONE_PX = 576
"""Narrower pages are a phone's, as in the page's style."""


def prepare(server: viser.ViserServer) -> None:
    """Set up what is the same for all pages, before the first one connects."""
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(22, 110, 235))
    server.gui.set_panel_label("SI Maps workbench")
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_WIDTH_PX)


def specs_of(page: Page) -> Sequence[PanelSpec]:
    """Return the panels of a page: those that its services allow, and its services' own; as far as its person may."""
    specs = [*(spec for spec in PANELS if spec.wanted(page.services)), *page.services.panels]
    return [spec for spec in specs if spec.right is None or page.may(spec.right)]


class Layout:
    """The docked panels of one page; building it makes all panels of the page."""

    def __init__(self, page: Page) -> None:
        """Make the panels and dock them."""
        gui, specs = page.gui, specs_of(page)
        wide = "position:fixed;width:100vw;height:0;border:0;visibility:hidden"  # it reports the page's width
        gui.add_html(
            f'<iframe title="Tab" style="{wide}" src="{page.workbench.tab_host.url_for(page.token)}"></iframe>'
        )
        self._page, self._recording = page, _dock_recording(page)
        # The main panel: help and keys above the tabs.
        page.panels.place("head", gui, specs)
        tabs = gui.add_tab_group()
        page.panels.place("front", tabs, specs)
        page.panels.place("tab", tabs, specs)
        # viser cannot open a tab: the page's script does, when this names one anew.
        self._open, self._turn = gui.add_html(""), 0

    def settle(self, page_px: object, height_px: object) -> None:
        """Show the recorded build beside the map where there is room for both, once the browser has docked it folded.

        Args:
            page_px: width of the page, as it reported it.
            height_px: its height, likewise; what is no size is not used.
        """
        self._page.is_phone = False
        if not _is_length(page_px):
            return
        if self._recording is not None and page_px >= ROOMY_PX:
            beside = int((1.0 - MAP_SHARE) * page_px) - PANEL_WIDTH_PX - 2 * RIM_PX
            self._recording.set_width(min(RECORDING_WIDTH_PX, beside))
            self._recording.expand()
        self._page.is_phone = page_px < PHONE_PX
        if _is_length(height_px):
            self._page.viewpoints.settle(page_px, height_px)

    def unfold_recording(self) -> None:
        """Show the recorded build beside the map."""
        if self._recording is not None:
            self._recording.expand()

    def open_tab(self, title: str, only_from: str, focus: str) -> None:
        """Open a tab in the browser, and focus the control labelled ``focus``; arguments as of `Page.reveal`."""
        self._turn += 1
        what = f'data-simaps-tab="{title}" data-from="{only_from}" data-focus="{escape(focus)}"'
        what += f' data-turn="{self._turn}"'
        self._open.content = f"<i hidden {what}></i>"


def _is_length(told: object) -> TypeGuard[float]:
    return isinstance(told, int | float) and 0 < told < MAX_PX


def _dock_recording(page: Page) -> viser.PanelHandle | None:
    if page.recording.url is None:
        return None
    panel = page.gui.add_panel()
    with panel.add_tab("Recorded build", viser.Icon.MOVIE):
        back = page.gui.add_button("Back to this map's build", icon=viser.Icon.ARROW_BACK_UP, visible=False)
        back.on_click(lambda _: page.recording.show(None))
        page.recording.on_switch = lambda foreign: setattr(back, "visible", foreign)
        page.gui.add_html(
            f'<iframe title="Recorded build" src="{page.recording.url}" '
            'style="width:100%;height:calc(100vh - 92px);border:0;display:block"></iframe>'
        )
    panel.dock_left()
    panel.set_width(RECORDING_WIDTH_PX)
    panel.minimize()
    return panel


@dataclass(frozen=True, eq=False)
class TabState:
    """A page as it was left."""

    published: "weakref.ref[SIMap]"
    """The map that was on all pages."""
    own: SIMap | None
    """The map of this page, where it was another."""
    picked: tuple[float, float] | None
    """The position that was selected, map frame, metres."""
    picked_as: tuple[int, str] | None
    """Id and class of what was selected there."""
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

    def unfold_recording(self) -> None:
        """Show the recorded build."""
        self._layout.unfold_recording()

    def settle(self, width_px: object = None, height_px: object = None) -> None:
        """Lay the panels and the map out anew, now that the browser shows them on a page of that size."""
        self.worker.submit("settle", lambda: self._layout.settle(width_px, height_px))

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
            picked_as=self.picked_as,
            frame=None if self.at_end else self.frame,
            camera=self.viewpoints.state(),
            panels=self.panels.states(),
        )

    def _restore(self, state: TabState) -> None:
        """Restore what was done on the page before; a map published since then is kept."""
        if state.own is not None and state.published() is self.workbench.simap:
            self.take_map_now(state.own)
        self.remember(state.picked, state.picked_as)
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
