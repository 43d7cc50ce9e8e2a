"""What the pages of one workbench have in common."""

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.server.host import Host
from simaps_viz.viewer.services import Services
from simaps_viz.viewer.shared import Shared


@dataclass(frozen=True, eq=False)
class Common:
    """Handed to every session by its workbench."""

    services: Services
    shared: Shared
    recording: Host | None
    """Serves the recorded build."""
    tabs: Host
    """Serves the hidden frame that tells which tab a page is in."""
    recorded: SIMap
    """The map whose build was recorded."""
    building: bool
    """The map is still being built: the recording runs ahead of the page, and nothing ties them."""
    published: Callable[[], SIMap]
    """The map that a new page shows."""
    publish: Callable[[SIMap], None]
    """Show a map on all pages, cut as each page's sliders are."""
    start: Pose2 | None
    robot_radius_m: float
    judging: AbstractContextManager[object] = field(default_factory=threading.RLock)
    """Held while an answer of a judge is saved."""
