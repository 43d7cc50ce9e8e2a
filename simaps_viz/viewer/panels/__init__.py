"""The panels of a page: most are a tab, some share one. A new panel is one class, and one line in this registry."""

import viser

from simaps_viz.viewer.page.panel import PanelSpec
from simaps_viz.viewer.panels.build import BuildPanel, StepsPanel
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.help import HelpPanel
from simaps_viz.viewer.panels.instance import FindBox, InstancePanel
from simaps_viz.viewer.panels.judge import JudgePanel
from simaps_viz.viewer.panels.map import MapPanel, NamesPanel
from simaps_viz.viewer.panels.why import WhyPanel

PANELS: tuple[PanelSpec, ...] = (
    PanelSpec("Page", viser.Icon.HELP, HelpPanel, "head"),
    PanelSpec("Page", viser.Icon.HELP, NamesPanel, "head"),
    PanelSpec("Find", viser.Icon.SEARCH, FindBox, "head"),
    PanelSpec("Judge", viser.Icon.GAVEL, JudgePanel, wanted=lambda has: has.judging is not None, right="edit"),
    PanelSpec("Map", viser.Icon.MAP, MapPanel),
    PanelSpec("Instance", viser.Icon.CUBE, InstancePanel),
    PanelSpec("Instance", viser.Icon.CUBE, WhyPanel),
    PanelSpec("Command", viser.Icon.ROBOT, CommandPanel),
    PanelSpec("Build", viser.Icon.TIMELINE, BuildPanel),
    PanelSpec("Build", viser.Icon.TIMELINE, StepsPanel),
)
"""The panels of every page, in their order. Those of `Services.panels`, which need more than a map, follow them."""
