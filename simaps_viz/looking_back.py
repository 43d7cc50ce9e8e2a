"""What a map looked like after each frame of its build, from the history beside its file."""

import threading
from collections.abc import Callable
from pathlib import Path

from simaps_viz.building import history_beside
from simaps_viz.mapping.history import MapHistory, cut_as
from simaps_viz.structures import SIMap


def looking_back(path: Callable[[], Path | None]) -> Callable[[SIMap, int], SIMap | None]:
    """Give what shows a map as it was after a frame, from the history beside a file, opened when first asked for.

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
