"""What can be seen on one map from one pose.

In view is what a ray reaches that goes from the camera to the top of one of an object's cells. It is stopped by a cell
of another object when it enters that cell's column between the floor and the column's top; a column whose lowest pixel
hangs over 1 m (a lamp, a lintel over a doorway) stops it only above that pixel. Walls and columns reach from floor to
ceiling.
"""

from functools import cached_property
from typing import Final

import numpy as np
from numba import njit
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
        self._simap, self.viewer = simap, viewer
        self.field_of_view_rad = field_of_view_rad
        self.eye_height_m = recorded_height_m(simap) if eye_height_m is None else eye_height_m

    def sees(self, instance: Instance, cells_m: NDArray) -> bool:
        """Return whether a free line of sight within the field of view reaches one of (at most 48 of) its cells.

        Args:
            instance: what is looked for.
            cells_m: float64 [n, 2], the centres of its cells, map frame.
        """
        cells = cells_m[:: max(1, len(cells_m) // _SIGHT_CELLS)]
        offsets = cells - (self.viewer.x_m, self.viewer.y_m)
        bearing = np.arctan2(offsets[:, 1], offsets[:, 0]) - self.viewer.yaw_rad
        ahead = np.abs((bearing + np.pi) % (2.0 * np.pi) - np.pi) <= self.field_of_view_rad / 2.0 + 1e-9
        if not ahead.any():
            return False
        return self._any_free(offsets[ahead], self._tops_m(cells[ahead]), instance.id)

    def _tops_m(self, cells_m: NDArray) -> NDArray:
        row, col = self._cells_of(cells_m[:, 0], cells_m[:, 1])
        return np.nan_to_num(self._simap.grid.height_m[row, col].astype(np.float64))

    def _any_free(self, offsets_m: NDArray, tops_m: NDArray, instance_id: int) -> bool:
        """Return whether nothing else stops one of the rays, given where they end [n, 2] and how high [n]."""
        spec, (low, high) = self._simap.spec, self._column
        step, eye = (
            spec.cell_size_m / _STEPS_PER_CELL,
            np.array([self.viewer.x_m, self.viewer.y_m, self.eye_height_m]),
        )
        origin = np.array([spec.x0_m, spec.y0_m, spec.cell_size_m])
        return bool(_any_free(offsets_m, tops_m, eye, origin, step, low, high, self._simap.instance, instance_id))

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


@njit(cache=True, nogil=True)
def _any_free(
    offsets: NDArray,  # float64 [n, 2], from the eye to where the rays end
    tops: NDArray,  # float64 [n], heights at which they end
    eye: NDArray,  # float64 [3], x, y and height
    origin: NDArray,  # float64 [3], x0, y0 and size of the cells
    step: float,
    low: NDArray,  # float32 [rows, cols], from which height each cell stops rays
    high: NDArray,  # float32 [rows, cols], to which height
    instance: NDArray,  # int32 [rows, cols]
    number: int,
) -> bool:
    """Return whether one of the rays is stopped by no column but those of the instance looked at."""
    rows, cols = instance.shape
    for i in range(len(offsets)):
        length, free = max(np.hypot(offsets[i, 0], offsets[i, 1]), 1e-9), True
        for k in range(int(np.ceil((length - _BODY_M) / step))):
            share = (_BODY_M + k * step) / length
            col = int(np.floor((eye[0] + share * offsets[i, 0] - origin[0]) / origin[2]))
            row = int(np.floor((eye[1] + share * offsets[i, 1] - origin[1]) / origin[2]))
            if share < 1.0 and 0 <= row < rows and 0 <= col < cols and instance[row, col] != number:
                height = eye[2] + share * (tops[i] - eye[2])
                if low[row, col] <= height <= high[row, col]:
                    free = False
                    break
        if free:
            return True
    return False


def wall_cells(simap: SIMap) -> NDArray:
    """Return the cells whose class reaches from floor to ceiling, bool [rows, cols]."""
    names = simap.grid.labels
    walls = [i for i, name in enumerate(names) if name == "wall" or name.startswith("wall-") or name == "column"]
    return np.isin(simap.grid.label, walls)


def recorded_height_m(simap: SIMap) -> float:
    """Return the median height the map's camera had over the floor, kept to what a robot may carry."""
    heights = simap.T_map_camera[:, 2, 3] if len(simap.T_map_camera) else np.array([EYE_HEIGHT_M])
    return float(np.clip(np.median(heights), *_EYE_RANGE_M))
