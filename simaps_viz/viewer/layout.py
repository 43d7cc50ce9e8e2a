"""Where the panels of a page are: in one row of tabs on the right; the recorded build on the left, folded at first."""

from collections.abc import Sequence
from html import escape

import viser

from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import PanelSpec
from simaps_viz.viewer.panels import PANELS
from simaps_viz.viewer.scene.camera import PANEL_WIDTH_PX, RIM_PX

RECORDING_WIDTH_PX = 400
MAP_SHARE = 0.6
"""The share of the page's width that the map keeps while the recorded build is docked beside it."""
ROOMY_PX, MAX_PX = 1900, 20_000
"""Pages narrower than the first have the recorded build folded up to a strip: the room is for the map."""


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
        self._recording = _dock_recording(page)
        # The main panel: help and keys above the tabs.
        page.panels.place("head", gui, specs)
        tabs = gui.add_tab_group()
        page.panels.place("front", tabs, specs)
        page.panels.place("tab", tabs, specs)
        # viser cannot open a tab: the page's script does, when this names one anew.
        self._open, self._turn = gui.add_html(""), 0

    def settle(self, page_px: object) -> None:
        """Show the recorded build beside the map where there is room for both, once the browser has docked it folded.

        Args:
            page_px: width of the page, as it reported it.
        """
        if self._recording is not None and isinstance(page_px, int | float) and ROOMY_PX <= page_px < MAX_PX:
            beside = int((1.0 - MAP_SHARE) * page_px) - PANEL_WIDTH_PX - 2 * RIM_PX
            self._recording.set_width(min(RECORDING_WIDTH_PX, beside))
            self._recording.expand()

    def open_tab(self, title: str, only_from: str, focus: str) -> None:
        """Open a tab in the browser, and focus the control labelled ``focus``; arguments as of `Page.reveal`."""
        self._turn += 1
        what = f'data-simaps-tab="{title}" data-from="{only_from}" data-focus="{escape(focus)}"'
        what += f' data-turn="{self._turn}"'
        self._open.content = f"<i hidden {what}></i>"


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
