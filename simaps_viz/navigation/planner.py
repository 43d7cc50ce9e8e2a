"""Where the robot fits, and the cheapest path there."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from simaps_viz.errors import InputError, PlanningError
from simaps_viz.navigation.astar import clear_length, pull_straight, search, straight_jumps
from simaps_viz.structures import Grid, Path

SNAP_M: Final = 0.5
"""A start that is not free moves to the nearest free cell within this distance: maps are noisy."""
APPROACH_M: Final = 1.5
"""A goal counts as reached when it is no further than this from what was asked for."""
DETOUR_TO_SEE_M: Final = 0.5
"""How much farther off a goal may be so that the target is seen from it; a low wall under a window hides nothing."""
_POCKET_M2 = 0.5
"""A start that is not free is moved to a connected free area smaller than this, such as the floor between chair legs,
only when no larger one is in reach."""
_BLOCK_CELLS = 1 << 22  # processed together where distances to obstacles are measured


@dataclass(frozen=True)
class RobotShape:
    """An upright cylinder."""

    radius_m: float = 0.2
    height_m: float = 1.5

    def __post_init__(self) -> None:
        for name in ("radius_m", "height_m"):
            value = getattr(self, name)
            if not (np.isfinite(value) and 0.0 < value <= 5.0):
                raise InputError(f"robot {name}: expected metres between 0 and 5, found {value}")


class Planner:
    """Plans over one grid for one robot; occupancy and connected areas are computed once.

    A cell is *blocked* when something at least 0.1 m over its floor is no higher than the robot. A cell is *free* when
    it was seen and no blocked cell's nearest edge is closer to its centre than the robot's radius (measured along the
    distance of centres, less half a cell). Cells that were never seen are not free either, but the
    robot may come closer to them than its radius.
    """

    def __init__(self, grid: Grid, robot: RobotShape | None = None) -> None:
        self.grid = grid
        self.robot = robot or RobotShape()
        self.spec = grid.spec
        self.kept_off: NDArray | None = None
        """Cells that were taken from the free ones, bool [rows, cols]; None where there are none."""

    def keeping_off(self, cells: NDArray) -> "Planner":
        """Return a planner for the same robot that stays off these cells too, bool [rows, cols]."""
        other = Planner(self.grid, self.robot)
        other.kept_off = cells if self.kept_off is None else cells | self.kept_off
        other.blocked, other.free = self.blocked, self.free & ~cells
        return other

    @cached_property
    def blocked(self) -> NDArray:
        """Cells the robot would touch, bool [rows, cols]."""
        with np.errstate(invalid="ignore"):
            return self.grid.lowest_m <= self.robot.height_m

    @cached_property
    def free(self) -> NDArray:
        """Cells in which the robot's centre can be, bool [rows, cols]."""
        seen = ~np.isnan(self.grid.height_m)
        needed = self.robot.radius_m / self.spec.cell_size_m + 0.5
        return seen & _clear(self.blocked, needed - 1e-9)

    @cached_property
    def jumps(self) -> NDArray:
        """How far straight moves go, int32 [rows, cols, 4], see ``straight_jumps``."""
        return straight_jumps(self.free)

    @cached_property
    def _areas(self) -> NDArray:
        """Number of the connected area of each free cell, int32 [rows, cols], 0 = not free.

        Areas are 4-connected, which is the same as reachable: a diagonal step needs both cells beside it.
        """
        return np.asarray(ndimage.label(self.free)[0])  # pyright: ignore[reportIndexIssue]

    @cached_property
    def _area_sizes(self) -> NDArray:
        return np.bincount(self._areas.ravel())

    def start_cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return the free cell the robot starts from: its own, or the nearest within 0.5 m, pockets avoided.

        Raises:
            PlanningError: when there is none.
        """
        row, col = self.spec.cell_of(x_m, y_m)
        if self.spec.contains(row, col) and self.free[row, col]:
            return row, col
        here_m = np.clip([[x_m, y_m]], -1e6, 1e6)
        rows, cols = self._window(self.free, here_m, SNAP_M)
        squared, _ = self._squared_cells(rows, cols, here_m)
        if len(rows) == 0 or squared.min() > (SNAP_M / self.spec.cell_size_m) ** 2 + 1e-6:
            raise PlanningError(
                f"the robot cannot start at ({x_m:.2f}, {y_m:.2f}): there is no free floor within {SNAP_M} m of it"
            )
        roomy = self._area_sizes[self._areas[rows, cols]] * self.spec.cell_size_m**2 >= _POCKET_M2
        beyond = squared > (SNAP_M / self.spec.cell_size_m) ** 2 + 1e-6
        best = np.lexsort((cols, rows, squared, ~roomy, beyond))[0]
        return int(rows[best]), int(cols[best])

    def reachable(self, x_m: float, y_m: float) -> NDArray:
        """Return the free cells that can be reached from a point, bool [rows, cols]."""
        return self._areas == self._areas[self.start_cell(x_m, y_m)]

    def plan(self, start_m: tuple[float, float], goal_m: tuple[float, float]) -> Path:
        """Plan from a point to another, whose cell has to be free.

        Raises:
            PlanningError: naming why there is no path.
        """
        goal = np.zeros(self.spec.shape, np.bool_)
        row, col = self.spec.cell_of(*goal_m)
        if not self._holds(self.free, goal_m):
            raise PlanningError(f"({goal_m[0]:.2f}, {goal_m[1]:.2f}) is not free floor for this robot")
        goal[row, col] = True
        return self._plan_to(start_m, goal, f"to ({goal_m[0]:.2f}, {goal_m[1]:.2f})", goal_m)

    def plan_near(
        self,
        start_m: tuple[float, float],
        target_m: NDArray,
        what: str,
        *,
        allowed: NDArray | None = None,
        see_through: NDArray | None = None,
        watch_m: NDArray | None = None,
        must_see: bool = False,
    ) -> Path:
        """Plan to the reachable free cell nearest to any of the target points.

        Of equally near cells it is the one with the shortest path. The path ends at the cell's centre, or exactly at
        the target if that is one point in that very cell.

        Args:
            start_m: where the robot is.
            target_m: float64 [n, 2], map frame.
            what: describes the target in errors, e.g. "to the chair", "left of the chair".
            allowed: bool [rows, cols], the cells that may be the goal.
            see_through: bool [rows, cols], cells that hide nothing; a cell from which the target is hidden (it lies
                behind a wall) is used only when there is no other at most ``DETOUR_TO_SEE_M`` further off.
            watch_m: float64 [2], the point that has to be seen, instead of the nearest target point.
            must_see: a cell from which the target is hidden is not used at all: behind a couch is not the next room.

        Raises:
            PlanningError: when no cell qualifies.
        """
        usable = self.reachable(*start_m)
        if allowed is not None:
            usable &= allowed

        def is_seen(x: float, y: float, target: int) -> bool:
            seen = self._in_cells(target_m[target] if watch_m is None else watch_m)
            return see_through is None or clear_length(see_through, x, y, *seen) >= 1.0

        if len(target_m) == 1 and self._holds(usable, target_m[0]) and is_seen(*self._in_cells(target_m[0]), 0):
            return self.plan(start_m, (float(target_m[0, 0]), float(target_m[0, 1])))
        # The usable cells near a target, the nearest first.
        rows, cols = self._window(usable, target_m, APPROACH_M)
        squared, nearest = self._squared_cells(rows, cols, target_m)
        order = np.lexsort((cols, rows, squared))
        order = order[squared[order] <= (APPROACH_M / self.spec.cell_size_m) ** 2 + 1e-6]
        if len(order) == 0:
            raise PlanningError(self._why_not(usable, target_m, what))

        def sees(i: int) -> bool:
            return is_seen(cols[i] + 0.5, rows[i] + 0.5, nearest[i])

        # Prefer the nearest cell from which the target can be seen, unless that is much farther off.
        further = np.sqrt(squared[order]) - np.sqrt(squared[order[0]])
        worthwhile = order[further <= DETOUR_TO_SEE_M / self.spec.cell_size_m + 1e-9]
        best = next((i for i in (order if must_see else worthwhile) if sees(i)), None)
        if best is None and must_see:
            raise PlanningError(f"the robot cannot get {what}: something high, such as a wall, lies between")
        best = order[0] if best is None else best
        # Of equally near cells A* takes the one with the shortest path.
        ties = order[np.abs(squared[order] - squared[best]) < 1e-6]
        ties = [i for i in ties if sees(i)] or ties
        goal = np.zeros(self.spec.shape, np.bool_)
        goal[rows[ties], cols[ties]] = True
        return self._plan_to(start_m, goal, what)

    def plan_into(self, start_m: tuple[float, float], area: NDArray, what: str) -> Path:
        """Plan to the cell of an area with the shortest path; a robot that is in the area stays where it is.

        Args:
            start_m: where the robot is.
            area: bool [rows, cols].
            what: describes the area in errors, e.g. "into the kitchen".

        Raises:
            PlanningError: when no cell of it can be reached.
        """
        usable = self.reachable(*start_m) & area
        if not usable.any():
            raise PlanningError(f"there is no free floor the robot can reach {what}")
        return self._plan_to(start_m, usable, what)

    def clear_ahead_m(self, start_m: tuple[float, float], end_m: tuple[float, float]) -> float:
        """Return how far a straight drive gets over free cells before it has to stop, metres.

        A start that is not free may be left, as long as the drive is on free cells within 0.5 m.
        """
        start, end = np.array(start_m), np.array(end_m)
        length = float(np.linalg.norm(end - start))
        if length == 0.0:
            return 0.0
        ahead = (end - start) / length
        leaving = (d for d in np.arange(0.0, SNAP_M + 1e-9, 0.01) if self._holds(self.free, start + ahead * d))
        begin = start + ahead * min(float(next(leaving, 0.0)), length)
        share = clear_length(self.free, *self._in_cells(begin), *self._in_cells(end))
        reached = begin + (end - begin) * share
        return float(np.linalg.norm(reached - start)) if share > 0.0 else 0.0

    def obstacle_near(self, point_m: tuple[float, float]) -> str:
        """Name the obstacle that keeps the robot's centre from a point: a class, the map's edge, or unseen floor."""
        row, col = self.spec.cell_of(*point_m)
        if not self.spec.contains(row, col):
            return "the edge of the map"
        if self.kept_off is not None and self.kept_off[row, col]:
            return "what is to be kept away from"
        rows, cols = self._window(self.blocked, np.array([point_m]), self.robot.radius_m + 2.0 * self.spec.cell_size_m)
        if len(rows) == 0:
            return "floor that was never seen"
        nearest = int(self._squared_cells(rows, cols, np.array([point_m]))[0].argmin())
        label = self.grid.labels[self.grid.label[rows[nearest], cols[nearest]]]
        return "something without a class" if label == "none" else f"a {label}"

    def _holds(self, mask: NDArray, point_m: Sequence[float] | NDArray) -> bool:
        row, col = self.spec.cell_of(float(point_m[0]), float(point_m[1]))
        return self.spec.contains(row, col) and bool(mask[row, col])

    def _plan_to(
        self, start_m: tuple[float, float], goal: NDArray, what: str, end_m: tuple[float, float] | None = None
    ) -> Path:
        start = self.start_cell(*start_m)
        rows, cols = np.nonzero(goal)
        box = np.array([rows.min(), rows.max(), cols.min(), cols.max()], np.int64)
        cells, cost_cells = search(self.free, self.jumps, start, goal, box)
        if len(cells) == 0:
            raise PlanningError(f"there is no free path from ({start_m[0]:.2f}, {start_m[1]:.2f}) {what}")
        cells_xy = cells[:, ::-1] + 0.5
        if end_m is not None and self.spec.cell_of(*end_m) == tuple(cells[-1]):
            cells_xy[-1] = self._in_cells(end_m)
        cost_m = cost_cells * self.spec.cell_size_m
        if self.spec.cell_of(*start_m) != start:  # a start that is not free is left in a straight line
            return Path(np.vstack([start_m, self._in_metres(pull_straight(self.free, cells_xy))]), cost_m)
        if len(cells) == 1 and end_m is None:
            return Path(np.array([start_m], np.float64), 0.0)
        # within its cell the robot leaves from where it is
        path = np.vstack([self._in_cells(start_m), cells_xy[1:] if len(cells) > 1 else cells_xy])
        return Path(self._in_metres(pull_straight(self.free, path)), cost_m)

    def _in_metres(self, points: NDArray) -> NDArray:
        return points * self.spec.cell_size_m + (self.spec.x0_m, self.spec.y0_m)

    def _in_cells(self, point_m: Sequence[float] | NDArray) -> tuple[float, float]:
        s = self.spec.cell_size_m
        return (point_m[0] - self.spec.x0_m) / s, (point_m[1] - self.spec.y0_m) / s

    def _window(self, mask: NDArray, target_m: NDArray, margin_m: float) -> tuple[NDArray, NDArray]:
        """Return rows and cols of the cells of a mask within a margin of the targets' bounding box."""
        (x_low, y_low), (x_high, y_high) = target_m.min(axis=0) - margin_m, target_m.max(axis=0) + margin_m
        row, col = np.maximum(self.spec.cell_of(x_low, y_low), 0)
        row_end, col_end = np.maximum(self.spec.cell_of(x_high, y_high), -1) + np.int64(1)
        rows, cols = np.nonzero(mask[row:row_end, col:col_end])
        return rows + row, cols + col

    def _squared_cells(self, rows: NDArray, cols: NDArray, target_m: NDArray) -> tuple[NDArray, NDArray]:
        """Return the squared distance of cells to the nearest target, in cells, and which target that is."""
        targets = (target_m - (self.spec.x0_m, self.spec.y0_m)) / self.spec.cell_size_m
        distance, nearest = KDTree(targets).query(np.column_stack([cols, rows]) + 0.5)
        return np.asarray(distance) ** 2, np.asarray(nearest)

    def _why_not(self, usable: NDArray, target_m: NDArray, what: str) -> str:
        rows, cols = np.nonzero(usable)
        if len(rows) == 0:
            return f"there is no free floor the robot can reach {what}"
        near_m = float(np.sqrt(self._squared_cells(rows, cols, target_m)[0].min())) * self.spec.cell_size_m
        return f"the robot cannot get {what}: the nearest it can stand is {near_m:.2f} m off (at most {APPROACH_M:g} m)"


def _clear(blocked: NDArray, needed: float) -> NDArray:
    """Return which cells are at least ``needed`` > 0 cells from every blocked one, bool [rows, cols].

    Works on blocks of rows, each with the rows around it that matter: distances take 40 bytes a cell.
    """
    clear, (rows, cols), reach = np.ones_like(blocked), blocked.shape, int(np.ceil(needed)) + 1
    step = max(_BLOCK_CELLS // max(cols, 1), reach)
    for first in range(0, rows, step):
        low, stop = max(first - reach, 0), min(first + step, rows)
        part = blocked[low : stop + reach]
        if part.any():
            distance = np.asarray(ndimage.distance_transform_edt(~part))
            clear[first:stop] = distance[first - low : stop - low] >= needed
    return clear
