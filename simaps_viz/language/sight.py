"""What can be seen on one map from one pose.

In view is what a ray reaches that goes from the camera to the top of one of an object's cells. It is stopped by a cell
of another object when it enters that cell's column between the floor and the column's top; a column whose lowest pixel
hangs over 1 m (a lamp, a lintel over a doorway) stops it only above that pixel. Walls and columns reach from floor to
ceiling.
"""

from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import Instance, Pose2, SIMap

FIELD_OF_VIEW_RAD: Final = np.pi / 2.0
EYE_HEIGHT_M: Final = 1.3
"""Height of the camera where the map does not record that of its own."""
_EYE_RANGE_M: Final = (0.3, 1.9)
_HANGING_M: Final = 1.0
_SIGHT_CELLS: Final = 48
_BODY_M: Final = 0.2  # cells this near to the viewer show the viewer itself, or noise
_STEPS_PER_CELL: Final = 3.0


class Sight:
    """Decides what can be seen on one map from one pose.

    Args:
        simap: the map.
        viewer: where the camera is, and where it looks.
        field_of_view_rad: full horizontal angle; the vertical one is taken to be wide enough.
        eye_height_m: height of the camera over the floor; by default the median of those the map was recorded from.
    """

    def __init__(
        self,
        simap: SIMap,
        viewer: Pose2,
        *,
        field_of_view_rad: float = FIELD_OF_VIEW_RAD,
        eye_height_m: float | None = None,
    ) -> None:
        self._simap, self._viewer = simap, viewer
        self.field_of_view_rad = field_of_view_rad
        self.eye_height_m = recorded_height_m(simap) if eye_height_m is None else eye_height_m

    def sees(self, instance: Instance, cells_m: NDArray) -> bool:
        """Return whether a free line of sight within the field of view reaches one of (at most 48 of) its cells.

        Args:
            instance: what is looked for.
            cells_m: float64 [n, 2], the centres of its cells, map frame.
        """
        cells = cells_m[:: max(1, len(cells_m) // _SIGHT_CELLS)]
        offsets = cells - (self._viewer.x_m, self._viewer.y_m)
        bearing = np.arctan2(offsets[:, 1], offsets[:, 0]) - self._viewer.yaw_rad
        ahead = np.abs((bearing + np.pi) % (2.0 * np.pi) - np.pi) <= self.field_of_view_rad / 2.0 + 1e-9
        if not ahead.any():
            return False
        return bool(self._free(offsets[ahead], self._tops_m(cells[ahead]), instance.id).any())

    def _tops_m(self, cells_m: NDArray) -> NDArray:
        row, col = self._cells_of(cells_m[:, 0], cells_m[:, 1])
        return np.nan_to_num(self._simap.grid.height_m[row, col].astype(np.float64))

    def _free(self, offsets_m: NDArray, tops_m: NDArray, instance_id: int) -> NDArray:
        """Return which rays nothing else stops, bool [n], given where they end [n, 2] and how high [n]."""
        spec = self._simap.spec
        # Sample points along every ray, [n, samples], and the cells they lie in.
        length = np.linalg.norm(offsets_m, axis=1)
        along = np.arange(_BODY_M, float(length.max()), spec.cell_size_m / _STEPS_PER_CELL)[None, :]
        share = along / np.maximum(length, 1e-9)[:, None]
        x = self._viewer.x_m + share * offsets_m[:, :1]
        y = self._viewer.y_m + share * offsets_m[:, 1:]
        row, col = self._cells_of(x, y)
        inside = (share < 1.0) & (row >= 0) & (row < spec.rows) & (col >= 0) & (col < spec.cols)
        row, col = np.where(inside, row, 0), np.where(inside, col, 0)
        # Compare the height of the ray at each point with the column of its cell.
        height = self.eye_height_m + share * (tops_m[:, None] - self.eye_height_m)
        low, high = self._column
        stopped = inside & (height >= low[row, col]) & (height <= high[row, col])
        return ~(stopped & (self._simap.instance[row, col] != instance_id)).any(axis=1)

    def _cells_of(self, x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
        spec = self._simap.spec
        col = np.floor((x - spec.x0_m) / spec.cell_size_m).astype(np.int64)
        row = np.floor((y - spec.y0_m) / spec.cell_size_m).astype(np.int64)
        return row, col

    @cached_property
    def _column(self) -> tuple[NDArray, NDArray]:
        """The heights from and to which each cell's column stops rays, float [rows, cols]; NaN where it stops none."""
        grid = self._simap.grid
        walls = wall_cells(self._simap)
        hangs = np.nan_to_num(grid.lowest_m) > _HANGING_M
        low = np.where(walls | ~hangs, -1.0, grid.lowest_m)
        return low, np.where(walls, np.inf, grid.height_m)


def wall_cells(simap: SIMap) -> NDArray:
    """Return the cells whose class reaches from floor to ceiling, bool [rows, cols]."""
    names = simap.grid.labels
    walls = [i for i, name in enumerate(names) if name == "wall" or name.startswith("wall-") or name == "column"]
    return np.isin(simap.grid.label, walls)


def recorded_height_m(simap: SIMap) -> float:
    """Return the median height the map's camera had over the floor, kept to what a robot may carry."""
    heights = simap.T_map_camera[:, 2, 3] if len(simap.T_map_camera) else np.array([EYE_HEIGHT_M])
    return float(np.clip(np.median(heights), *_EYE_RANGE_M))
