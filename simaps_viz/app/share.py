"""Services for the files that the page shares: the map after each frame, and a simulated robot."""

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from simaps_viz.build.to_file import open_history
from simaps_viz.mapping.history import MapHistory, cut_as
from simaps_viz.navigation.agent import Agent, answer
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import SIMap

if TYPE_CHECKING:
    from simaps_viz.viewer.panels.share import ShareServices


def look_back(path: Callable[[], Path | None]) -> Callable[[SIMap, int], SIMap | None]:
    """Return a function that shows a map as it was after a frame, from the history beside the map's file.

    The history is opened on the first call. The returned map has the objects of the map it is called with, including
    its K and its edits, as far as they had been observed by then; None where there is no history.

    Args:
        path: of the map or its recording; None as long as there is none.
    """
    lock = threading.Lock()
    opened: list[MapHistory | None] = []

    def look(simap: SIMap, frame: int) -> SIMap | None:
        beside = path()
        if beside is None:
            return None
        with lock:
            if not opened:
                opened.append(open_history(beside, simap))
        then = None if opened[0] is None else opened[0].look_at(frame)
        return cut_as(then, simap) if then is not None and then.spec == simap.spec else None

    return look


def share_services(beside: Path | None) -> "ShareServices":
    """Return the services of the panel that shares files.

    Args:
        beside: the map's recording; the history of its build lies beside it, if there is one.
    """
    from simaps_viz.viewer.panels.share import ShareServices  # noqa: PLC0415 - viser is slow to import

    look = look_back(lambda: beside)
    return ShareServices(
        ask=answer,
        steps=lambda simap, program, pose: Agent(simap, pose).steps(program),
        look=lambda simap: partial(look, simap),
        radius_m=RobotShape().radius_m,
    )
