"""The mending panel as one that every page has."""

import viser

from simaps_viz.viewer.desk import Desk, Panel
from simaps_viz.viewer.panels.mend import MendPanel
from simaps_viz.viewer.panels.mend_services import CutMark, MendServices
from simaps_viz.viewer.panels.spec import PanelSpec
from simaps_viz.viewer.session import Session


def mend_spec(services: MendServices) -> PanelSpec:
    """Give the panel, beside the one about the selected instance."""

    def make(desk: Desk) -> Panel:
        mark = CutMark(desk.client.scene) if isinstance(desk, Session) else None
        return MendPanel(desk, services, mark)

    return PanelSpec("Mend", viser.Icon.TOOL, make, place="instance")
