"""The cells of a map's instances: where they are, and how far apart instances are, to the very cell.

Distances between instances are those of the centres of their nearest cells, so from edge to edge to within a cell. They
are computed in whole cells, so that equal distances are equal.

In view is what a ray reaches that goes from the camera to the top of one of an object's cells. It is stopped by a cell
of another object when it enters that cell's column between the floor and the column's top; a column whose lowest pixel
hangs over 1 m (a lamp, a lintel over a doorway) stops it only above that pixel. Walls and columns reach from floor to
ceiling.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.structures import Instance, Pose2, SIMap

_FAR = np.int64(1 << 62)


@dataclass(frozen=True, eq=False)
class Packed:
    """The cells of several instances (or of one room), one after the other."""

    cells: NDArray
    """int64 [n, 2], row and column."""
    starts: NDArray
    """int64 [instances + 1]: those of instance k are ``cells[starts[k] : starts[k + 1]]``."""
    ids: NDArray
    """int64 [instances]; 0 = no instance."""


class Cells:
    """The cells of all instances of one map; made once a map, see `cells_of_map`."""

    def __init__(self, simap: SIMap) -> None:
        self.spec, self._instance = simap.spec, simap.instance
        numbers = simap.instance
        things = (*simap.instances, *simap.hidden)
        self.row_of = {one.id: k for k, one in enumerate(things)}
        self.centroids = np.array([i.centroid_m[:2] for i in things], np.float64).reshape(-1, 2)
        self.boxes: dict[int, tuple[float, float, float, float]] = {}
        self._all = self._by_instance(numbers > 0)
        # Only cells with a neighbour of another instance can be the nearest to something outside.
        padded = np.pad(numbers, 1)
        rows, cols = self.spec.shape
        same = [padded[r : r + rows, c : c + cols] == numbers for r, c in ((0, 1), (2, 1), (1, 0), (1, 2))]
        self._edge = self._by_instance((numbers > 0) & ~(same[0] & same[1] & same[2] & same[3]))
        footprints = self._footprints(simap) if simap.hidden else {}
        self._all |= footprints
        self._edge |= footprints
        everything = self.pack(things)
        self._points, self._starts = self.centres(everything.cells), everything.starts[:-1]
        bounds = [self._edge[i.id] for i in things]
        half = self.spec.cell_size_m / 2.0
        self.low = self.centres(np.array([b.min(axis=0) for b in bounds]).reshape(-1, 2)) - half
        self.high = self.centres(np.array([b.max(axis=0) for b in bounds]).reshape(-1, 2)) + half

    def _by_instance(self, mask: NDArray) -> dict[int, NDArray]:
        """Return {id: row and column of its cells within a mask, int64 [n, 2]}."""
        flat = self._instance.ravel()
        cells = np.flatnonzero(mask)
        order = cells[np.argsort(flat[cells], kind="stable")]
        ids, starts = np.unique(flat[order], return_index=True)
        pairs = np.column_stack(np.divmod(order, self.spec.cols))
        return dict(zip(ids.tolist(), np.split(pairs, starts[1:]), strict=False))

    def _footprints(self, simap: SIMap) -> dict[int, NDArray]:
        """Return {id of a thing that no cell shows: row and column of the cells below its surface, int64 [n, 2]}."""
        points = simap.points()
        found = {}
        for thing in simap.hidden:
            at = points.positions[points.instances == thing.id, :2].astype(np.float64)
            cells = np.floor((at - (self.spec.x0_m, self.spec.y0_m)) / self.spec.cell_size_m + 1e-6).astype(np.int64)
            limits = np.array(self.spec.shape) - 1
            found[thing.id] = np.unique(np.clip(cells[:, ::-1], 0, limits), axis=0)
        return found

    def centres(self, cells: NDArray) -> NDArray:
        """Return the centres of cells, float64 [n, 2], x and y, map frame, given their rows and columns [n, 2]."""
        return (cells[:, ::-1] + 0.5) * self.spec.cell_size_m + (self.spec.x0_m, self.spec.y0_m)

    def of(self, number: int) -> NDArray:
        """Return the centres of an instance's cells, float64 [n, 2], map frame."""
        return self.centres(self._all[number])

    def rows_and_cols(self, number: int) -> tuple[NDArray, NDArray]:
        """Return the rows and the columns of an instance's cells, int64 [n] each."""
        cells = self._all[number]
        return cells[:, 0], cells[:, 1]

    def edge(self, number: int) -> NDArray:
        """Return the centres of the cells at an instance's edge, float64 [n, 2], map frame."""
        return self.centres(self._edge[number])

    def pack(self, things: Sequence[Instance]) -> Packed:
        """Return the cells at the edges of some instances."""
        edges = [self._edge[thing.id] for thing in things]
        cells = np.concatenate(edges) if edges else np.zeros((0, 2), np.int64)
        starts = np.cumsum([0, *map(len, edges)], dtype=np.int64)
        return Packed(cells, starts, np.array([thing.id for thing in things], np.int64))

    def from_point(self, x_m: float, y_m: float) -> NDArray:
        """Return the distance from a point to each instance of the map, float64 [instances], metres."""
        if not len(self._starts):
            return np.zeros(0)
        squares = ((self._points - (x_m, y_m)) ** 2).sum(axis=1)
        far = np.sqrt(np.minimum.reduceat(squares, self._starts))
        row, col = self.spec.cell_of(x_m, y_m)
        number = int(self._instance[row, col]) if self.spec.contains(row, col) else 0
        if number:  # within an instance, the nearest cell may be an inner one: that of the point
            far[self.row_of[number]] = np.hypot(*np.subtract(self.spec.centre_of(row, col), (x_m, y_m)))
        return far.round(9)

    def metres(self, squares: NDArray) -> NDArray:
        """Return distances, float64 [n], metres, given their squares in cells, int64 [n]; infinite for none."""
        return np.where(squares == _FAR, np.inf, np.sqrt(squares) * self.spec.cell_size_m).round(9)

    def squares(self, metres: float) -> int:
        """Return the square of a distance in cells, rounded down."""
        return int((metres / self.spec.cell_size_m) ** 2 + 1e-6)

    @property
    def size(self) -> int:
        """The number of cells at the edges of all instances."""
        return len(self._points)


_CELLS: WeakKeyDictionary[SIMap, Cells] = WeakKeyDictionary()


def cells_of_map(simap: SIMap) -> Cells:
    """Return the cells of a map's instances, found once and kept as long as the map is."""
    if simap not in _CELLS:
        _CELLS[simap] = Cells(simap)
    return _CELLS[simap]


@njit(cache=True, nogil=True)
def _gap(
    a: NDArray,  # int64 [n, 2], cells
    b: NDArray,  # int64 [m, 2], cells
    low: NDArray,  # int64 [2], of b
    high: NDArray,  # int64 [2], of b
    below: int,
) -> tuple[int, int]:
    """Return the smallest square of a distance if it is below a limit, else the limit; and how many were computed."""
    best, work = below, 0
    for i in range(len(a)):
        row, col = a[i, 0], a[i, 1]
        down = max(low[0] - row, row - high[0], 0)
        across = max(low[1] - col, col - high[1], 0)
        work += 1
        if down * down + across * across < best:
            work += len(b)
            for j in range(len(b)):
                square = (row - b[j, 0]) ** 2 + (col - b[j, 1]) ** 2
                best = min(best, square)
    return best, work


@njit(cache=True, nogil=True)
def _bounds(
    cells: NDArray,  # int64 [n, 2]
    starts: NDArray,  # int64 [things + 1]
) -> tuple[NDArray, NDArray]:
    """Return the lowest and highest row and column of each thing, int64 [things, 2] each."""
    things = len(starts) - 1
    low, high = np.zeros((things, 2), np.int64), np.zeros((things, 2), np.int64)
    for k in range(things):
        for axis in range(2):
            low[k, axis] = cells[starts[k] : starts[k + 1], axis].min()
            high[k, axis] = cells[starts[k] : starts[k + 1], axis].max()
    return low, high


@njit(cache=True, nogil=True)
def nearest_others(
    a: NDArray,  # int64 [n, 2], cells of the things
    a_starts: NDArray,  # int64 [things + 1]
    a_ids: NDArray,  # int64 [things]
    b: NDArray,  # int64 [m, 2], cells of the others
    b_starts: NDArray,  # int64 [others + 1]
    b_ids: NDArray,  # int64 [others]
    most: int,
) -> tuple[NDArray, NDArray, int]:
    """Find the nearest other of each thing, itself left out; of equally near ones, that of the smallest id.

    Stops once ``most`` distances were computed.

    Returns:
        The squares of the distances in cells, int64 [things], 2**62 = none; which other, int64 [things], -1 = none;
        and how many distances were computed.
    """
    square, which, work = np.full(len(a_ids), _FAR), np.full(len(a_ids), -1, np.int64), 0
    a_low, a_high = _bounds(a, a_starts)
    b_low, b_high = _bounds(b, b_starts)
    for k in range(len(a_ids)):
        for m in range(len(b_ids)):
            down = max(a_low[k, 0] - b_high[m, 0], b_low[m, 0] - a_high[k, 0], 0)
            across = max(a_low[k, 1] - b_high[m, 1], b_low[m, 1] - a_high[k, 1], 0)
            if (a_ids[k] == b_ids[m] and a_ids[k] > 0) or down * down + across * across > square[k] or work > most:
                continue
            mine, others = a[a_starts[k] : a_starts[k + 1]], b[b_starts[m] : b_starts[m + 1]]
            below = square[k] if square[k] == _FAR else square[k] + 1
            found, done = _gap(mine, others, b_low[m], b_high[m], below)
            work += done
            if found < square[k] or (found == square[k] and which[k] >= 0 and b_ids[m] < b_ids[which[k]]):
                square[k], which[k] = found, m
    return square, which, work


@njit(cache=True, nogil=True)
def pairs_within(
    a: NDArray,  # int64 [n, 2], cells of the things
    a_starts: NDArray,  # int64 [things + 1]
    a_ids: NDArray,  # int64 [things]
    b: NDArray,  # int64 [m, 2], cells of the others
    b_starts: NDArray,  # int64 [others + 1]
    b_ids: NDArray,  # int64 [others]
    limit: int,
    most: int,
) -> tuple[NDArray, int]:
    """Find all pairs of a thing and a different other of which the square of the distance is at most a limit.

    Stops once ``most`` distances were computed.

    Returns:
        int64 [pairs, 3]: which thing, which other, and the square of their distance, by thing and other; and how many
        distances were computed.
    """
    found, work = [(np.int64(0), np.int64(0), np.int64(0)) for _ in range(0)], 0
    a_low, a_high = _bounds(a, a_starts)
    b_low, b_high = _bounds(b, b_starts)
    for k in range(len(a_ids)):
        for m in range(len(b_ids)):
            down = max(a_low[k, 0] - b_high[m, 0], b_low[m, 0] - a_high[k, 0], 0)
            across = max(a_low[k, 1] - b_high[m, 1], b_low[m, 1] - a_high[k, 1], 0)
            if a_ids[k] == b_ids[m] or down * down + across * across > limit or work > most:
                continue
            mine, others = a[a_starts[k] : a_starts[k + 1]], b[b_starts[m] : b_starts[m + 1]]
            square, done = _gap(mine, others, b_low[m], b_high[m], limit + 1)
            work += done
            if square <= limit:
                found.append((np.int64(k), np.int64(m), np.int64(square)))
    pairs = np.zeros((len(found), 3), np.int64)
    for k in range(len(found)):
        pairs[k, 0], pairs[k, 1], pairs[k, 2] = found[k]
    return pairs, work


# ---- sight

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
        spec, (low, high) = self._simap.spec, self._column
        col, row = np.floor((cells[ahead] - (spec.x0_m, spec.y0_m)) / spec.cell_size_m).astype(np.int64).T
        tops = np.nan_to_num(self._simap.grid.height_m[row, col].astype(np.float64))
        eye = np.array([self.viewer.x_m, self.viewer.y_m, self.eye_height_m])
        origin, step = np.array([spec.x0_m, spec.y0_m, spec.cell_size_m]), spec.cell_size_m / _STEPS_PER_CELL
        number = instance.id
        return bool(_any_free(offsets[ahead], tops, eye, origin, step, low, high, self._simap.instance, number))

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
