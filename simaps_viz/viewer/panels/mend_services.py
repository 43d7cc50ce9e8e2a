"""What the page asks for when a person mends the map by hand."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import viser

from simaps_viz.structures import SIMap
from simaps_viz.viewer.drawing.lines import draw_lines

Point = tuple[float, float]
"""x and y in metres, map frame."""
CUT = (214, 39, 40)
FLOOR_M = 0.03
CROSS_M = 0.05


class EntryLike(Protocol):
    """One edit, signed."""

    @property
    def who(self) -> str:
        """Who made it."""
        ...

    @property
    def when(self) -> str:
        """ISO 8601, UTC."""
        ...

    def to_json(self) -> dict[str, str]:
        """Give at least ``what``: the edit in words."""
        ...


@dataclass(frozen=True, eq=False)
class MendServices:
    """Every change takes the map that is shown, is saved before it returns, and raises InputError in words."""

    merge: Callable[[SIMap, int, int, str], SIMap]
    """map, first and second id, who -> map: they are one, of the first one's class."""
    split: Callable[[SIMap, int, Point, Point, str], SIMap]
    """map, id, two points of the line, who -> map."""
    relabel: Callable[[SIMap, int, str, str], SIMap]
    """map, id, class, who -> map."""
    delete: Callable[[SIMap, int, str], SIMap]
    """map, id, who -> map."""
    undo: Callable[[SIMap], SIMap]
    redo: Callable[[SIMap], SIMap]
    entries: Callable[[], Sequence[EntryLike]]
    """The edits, the first one first."""
    told: Callable[[], Sequence[str]]
    """What each of them did, for one who sees the map."""
    undone: Callable[[], int]
    """How many can be redone."""
    refused: Callable[[], Sequence[str]]
    """Which edits no longer make sense on this map, in words."""
    covers: Callable[[SIMap], bool]
    """Whether a map is the one whose edits these are."""
    saved: Callable[[], bool]
    """Whether there is a file of edits."""
    path: str
    """Of that file."""
    who: str
    """Who is likely to sit here."""


class CutMark:
    """The line along which an object will be cut, on the floor of one page."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Take the page's scene."""
        self._scene = scene

    def show(self, points_m: Sequence[Point], reach_m: float = 0.0) -> None:
        """Draw nothing, a cross at one point, or the line through two, drawn on by ``reach_m`` at both ends."""
        segments = [_cross(*point) for point in points_m]
        if len(points_m) == 2:
            a, b = np.asarray(points_m, np.float64)
            along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9) * reach_m
            segments.append(np.array([[[*(a - along), FLOOR_M], [*(b + along), FLOOR_M]]]))
        draw_lines(self._scene, "/cut", np.concatenate(segments) if segments else np.zeros((0, 2, 3)), CUT, 4.0)


def _cross(x: float, y: float) -> np.ndarray:
    r = CROSS_M
    return np.array(
        [[[x - r, y - r, FLOOR_M], [x + r, y + r, FLOOR_M]], [[x - r, y + r, FLOOR_M], [x + r, y - r, FLOOR_M]]]
    )
