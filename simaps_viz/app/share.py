"""What stands behind the files that a page makes to be sent: the map's growth and a robot's ride."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from simaps_viz.build.to_file import history_beside
from simaps_viz.mapping.history import MapHistory, cut_as
from simaps_viz.navigation.agent import Agent, answer
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import SIMap

if TYPE_CHECKING:
    from simaps_viz.viewer.panels.share import ShareServices


def looking_back(path: Callable[[], Path | None]) -> Callable[[SIMap, int], SIMap | None]:
    """Return what shows a map as it was after a frame, from the history beside a file, opened when first asked for.

    Args:
        path: of the map or its recording; None as long as there is none.
    """
    lock = threading.Lock()
    opened: list[MapHistory | None] = []

    def look_back(simap: SIMap, frame: int) -> SIMap | None:
        beside = path()
        if beside is None:
            return None
        with lock:
            if not opened:
                opened.append(history_beside(beside, simap))
        look = None if opened[0] is None else opened[0].look_at(frame)
        return cut_as(look, simap) if look is not None and look.spec == simap.spec else None

    return look_back


def share_services(beside: Path | None) -> "ShareServices":
    """Return what the page's files to send need.

    Args:
        beside: the map's recording; the history of its build lies beside it, if there is one.
    """
    from simaps_viz.viewer.panels.share import ShareServices  # noqa: PLC0415 - viser is slow to import

    return ShareServices(
        ask=answer,
        steps=lambda simap, program, pose: Agent(simap, pose).steps(program),
        look=lambda simap: look_back(beside, simap) if beside is not None else None,
        radius_m=RobotShape().radius_m,
    )


def look_back(beside: Path, simap: SIMap) -> Callable[[int], SIMap] | None:
    """Return what shows the map after a frame, from the history beside a map or its recording; None without one."""
    history = history_beside(beside, simap)
    return None if history is None else history.look_at
