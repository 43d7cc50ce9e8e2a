"""Which panels a page has, in their order."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import viser

from simaps_viz.viewer.desk import Desk, Panel

MAP, COMMAND, BUILD, INSTANCE, JUDGE = "Map", "Command", "Build", "Instance", "Judge"
PROGRESS = "Progress"
"""Only there until the map is done."""


@dataclass(frozen=True)
class PanelSpec:
    """A panel that is on every page."""

    title: str
    """Of its tab."""
    icon: viser.IconName
    make: Callable[[Desk], Panel]
    """Fills the container of the desk's ``gui`` that is open at that time; once for each page."""
    place: Literal["tab", "instance", "front"] = "tab"
    """Among the tabs of the main panel, beside the one about the selected instance, or in front of all tabs."""


BUILT_IN: tuple[tuple[str, viser.IconName], ...] = (
    (JUDGE, viser.Icon.GAVEL),
    (MAP, viser.Icon.MAP),
    (COMMAND, viser.Icon.ROBOT),
    (BUILD, viser.Icon.TIMELINE),
)
"""The tabs in front of those that `Services.panels` names."""
