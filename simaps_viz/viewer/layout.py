"""Where the panels of a page are: docked on the right, the selected instance below them, the recording on the left."""

from collections.abc import Sequence

import viser

from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import PanelSpec
from simaps_viz.viewer.panels import PANELS

RECORDING_WIDTH_PX = 400
ROOMY_PX, NARROW_PX, MAX_PX = 1280, 1150, 20_000
"""Pages narrower than the first have the recorded build docked narrower, than the second folded up to a strip."""
PANEL_WIDTH_PX = 340


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
        # The panel about the selected instance, below it. viser 1.1.1 halves the space on docking and has no heights
        # for docked panels: another one, docked between the two and removed by ``settle``, leaves them two thirds and
        # one.
        objects = gui.add_panel()
        page.panels.place("instance", objects, specs)
        self._spacer: list[viser.PanelHandle] = [gui.add_panel()]
        self._spacer[0].add_tab("Between")
        self._spacer[0].dock_below(gui.main_panel)
        objects.dock_below(self._spacer[0])

    def settle(self, page_px: object) -> None:
        """Make room for the main panel, and for the map on a narrow page, once the browser has docked the panels.

        Args:
            page_px: width of the page, as it reported it.
        """
        while self._spacer:
            self._spacer.pop().remove()
        if self._recording is not None and isinstance(page_px, int | float) and 0 < page_px < MAX_PX:
            if page_px < NARROW_PX:
                self._recording.minimize()
            else:
                self._recording.set_width(recording_width(page_px))


def recording_width(page_px: float) -> float:
    """Return the width of the docked recording on a page of some width, px: a quarter, or 400 where there is room."""
    return max(0.25 * page_px, RECORDING_WIDTH_PX if page_px >= ROOMY_PX else 0.0)


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
    return panel
