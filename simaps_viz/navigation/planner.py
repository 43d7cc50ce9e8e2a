"""Where the robot fits, and the cheapest path there: A* over grid cells, and the line-of-sight test, compiled.

Steps go to the 8 neighbours and cost 1 or sqrt(2) cells; a diagonal step needs both cells beside it free, so no corner
is cut. The heuristic is the octile distance to the bounding box of the goal cells: it never overestimates and never
drops by more than a step costs, so a cell is final when it leaves the heap (Hart, Nilsson and Raphael, 1968).
Among equal estimates the smaller cell number leaves the heap first, so the answer does not depend on chance.

Only *jump points* enter the heap: of all equally short paths the search follows the one that goes diagonally first, and
such a path turns only beside the end of an obstacle (Harabor and Grastien, 2011; without cutting corners: 2012).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from simaps_viz.errors import InputError, PlanningError
from simaps_viz.structures import Grid, Path

EAST, WEST, NORTH, SOUTH = 0, 1, 2, 3
"""The last index of the table; east is the next column, north the next row."""


@numba.njit(cache=True)
def straight_jumps(free: NDArray) -> NDArray:
    """Compute the table of straight jumps.

    Args:
        free: bool [rows, cols].

    Returns:
        int32 [rows, cols, 4]: a number n > 0 when the next jump point is n cells away; -n when there is none on the
        n free cells before the next obstacle or the map's edge. 0 for cells that are not free.
    """
    rows, cols = free.shape
    jumps = np.zeros((rows, cols, 4), np.int32)
    for i in range(rows):
        row, back = i, rows - 1 - i
        for j in range(cols):
            col, left = j, cols - 1 - j
            # Each direction runs against its own sense, so that the next cell is always known.
            _extend(jumps, free, row, left, 0, 1, EAST)
            _extend(jumps, free, row, col, 0, -1, WEST)
            _extend(jumps, free, back, col, 1, 0, NORTH)
            _extend(jumps, free, row, col, -1, 0, SOUTH)
    return jumps


@numba.njit(cache=True)
def _extend(jumps: NDArray, free: NDArray, row: int, col: int, dr: int, dc: int, side: int) -> None:
    """Fill in one cell of the table from the next cell in that direction, which is filled in already."""
    rows, cols = free.shape
    r, c = row + dr, col + dc
    if not free[row, col] or r < 0 or c < 0 or r >= rows or c >= cols or not free[r, c]:
        return
    if _obstacle_ends(free, r, c, dr, dc, 1) or _obstacle_ends(free, r, c, dr, dc, -1):
        jumps[row, col, side] = 1
    else:
        beyond = jumps[r, c, side]
        jumps[row, col, side] = beyond + 1 if beyond > 0 else beyond - 1


@numba.njit(cache=True)
def _obstacle_ends(free: NDArray, row: int, col: int, dr: int, dc: int, hand: int) -> bool:
    """Whether, at a cell come to in a direction, the cell on one hand is free but the one before that was not."""
    r, c = row + hand * dc, col + hand * dr
    return 0 <= r < free.shape[0] and 0 <= c < free.shape[1] and free[r, c] and not free[r - dr, c - dc]


_SQRT2 = math.sqrt(2.0)


@numba.njit(cache=True)
def _octile_to_box(row: int, col: int, box: NDArray) -> float:
    dr = max(box[0] - row, 0, row - box[1])
    dc = max(box[2] - col, 0, col - box[3])
    return max(dr, dc) + (_SQRT2 - 1.0) * min(dr, dc)


@numba.njit(cache=True)
def _straight_jump(jumps: NDArray, goal: NDArray, lines: NDArray, row: int, col: int, dr: int, dc: int) -> int:
    """Return how many cells a straight jump goes: to the next goal, or else jump point; 0 when there is neither."""
    side = (EAST if dc > 0 else WEST) if dr == 0 else (NORTH if dr > 0 else SOUTH)
    jump = jumps[row, col, side]
    if lines[0, row] if dr == 0 else lines[1, col]:
        for step in range(1, abs(jump) + 1):
            if goal[row + step * dr, col + step * dc]:
                return step
    return max(jump, 0)


@numba.njit(cache=True)
def _diagonal_jump(
    free: NDArray, jumps: NDArray, goal: NDArray, lines: NDArray, row: int, col: int, dr: int, dc: int
) -> int:
    """Return how many steps a diagonal jump goes: to a goal or a cell from which a straight jump continues, else 0."""
    rows, cols = free.shape
    step = 0
    while True:
        r, c = row + dr, col + dc
        if r < 0 or c < 0 or r >= rows or c >= cols:
            return 0
        if not (free[r, c] and free[row, c] and free[r, col]):
            return 0
        row, col, step = r, c, step + 1
        if (
            goal[r, c]
            or _straight_jump(jumps, goal, lines, r, c, 0, dc) > 0
            or _straight_jump(jumps, goal, lines, r, c, dr, 0) > 0
        ):
            return step


@numba.njit(cache=True)
def _may_continue(free: NDArray, row: int, col: int, came: tuple[int, int], dr: int, dc: int) -> bool:
    """Return whether a path that came to a cell in one direction may continue in another.

    After a diagonal: in the same direction, or in either of its two straight parts. After a straight: straight on; to a
    side, or diagonally towards it, only where the cell beside the previous one is not free, since otherwise the path
    would have gone there first.
    """
    came_r, came_c = came
    if came_r == 0 and came_c == 0:
        return True
    if came_r != 0 and came_c != 0:
        return dr in (0, came_r) and dc in (0, came_c)
    if came_r == 0:
        if dr == 0:
            return dc == came_c
        return dc != -came_c and 0 <= row + dr < free.shape[0] and not free[row + dr, col - came_c]
    if dc == 0:
        return dr == came_r
    return dr != -came_r and 0 <= col + dc < free.shape[1] and not free[row - came_r, col + dc]


@numba.njit(cache=True)
def search(free: NDArray, jumps: NDArray, start: tuple[int, int], goal: NDArray, box: NDArray) -> tuple[NDArray, float]:
    """Find a cheapest path from a cell to the nearest of the goal cells.

    Args:
        free: bool [rows, cols].
        jumps: int32 [rows, cols, 4], ``straight_jumps(free)``.
        start: (row, col), a free cell.
        goal: bool [rows, cols].
        box: int64 [4], (first row, last row, first col, last col) of the goal cells.

    Returns:
        int64 [n, 2] cells from start to goal, and the cost in cells; empty and infinity when there is no path.
    """
    rows, cols = free.shape
    lines = _lines_with_goals(goal, box)
    cost = np.full(rows * cols, np.inf)
    parent = np.full(rows * cols, -1, np.int32)
    first = start[0] * cols + start[1]
    cost[first] = 0.0
    heap = [(_octile_to_box(start[0], start[1], box), first)]
    while heap:
        estimate, here = heappop(heap)
        row, col = here // cols, here % cols
        if estimate > cost[here] + _octile_to_box(row, col, box):
            continue  # a cheaper path to this cell has been found since
        if goal[row, col]:
            return _path_back(parent, here, cols), float(cost[here])
        # Expand: jump in every direction in which a path that came this way may continue.
        came = _direction(int(parent[here]), here, cols)
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                if (dr == 0 and dc == 0) or not _may_continue(free, row, col, came, dr, dc):
                    continue
                if dr == 0 or dc == 0:
                    steps = _straight_jump(jumps, goal, lines, row, col, dr, dc)
                else:
                    steps = _diagonal_jump(free, jumps, goal, lines, row, col, dr, dc)
                # Relax: keep the jump point if this is the cheapest path to it until now.
                there = here + steps * (dr * cols + dc)
                along = float(cost[here]) + steps * (_SQRT2 if dr != 0 and dc != 0 else 1.0)
                if steps > 0 and along < cost[there]:
                    cost[there] = along
                    parent[there] = here
                    heappush(heap, (along + _octile_to_box(there // cols, there % cols, box), there))
    return np.zeros((0, 2), np.int64), np.inf


@numba.njit(cache=True)
def _lines_with_goals(goal: NDArray, box: NDArray) -> NDArray:
    """Mark the rows ([0]) and columns ([1]) that hold a goal: only along those a straight jump looks for one."""
    lines = np.zeros((2, max(goal.shape)), np.bool_)
    for row in range(box[0], box[1] + 1):
        for col in range(box[2], box[3] + 1):
            if goal[row, col]:
                lines[0, row] = lines[1, col] = True
    return lines


@numba.njit(cache=True)
def _direction(before: int, cell: int, cols: int) -> tuple[int, int]:
    """Return the direction from one cell to another as signs, (0, 0) when there is no previous cell."""
    if before < 0:
        return 0, 0
    dr, dc = cell // cols - before // cols, cell % cols - before % cols
    return (dr > 0) - (dr < 0), (dc > 0) - (dc < 0)


@numba.njit(cache=True)
def _path_back(parent: NDArray, goal: int, cols: int) -> NDArray:
    """Follow the parents from the goal to the start, filling in the cells between jump points."""
    n, cell = 1, goal
    while parent[cell] >= 0:
        before = parent[cell]
        n += max(abs(cell // cols - before // cols), abs(cell % cols - before % cols))
        cell = before
    path = np.zeros((n, 2), np.int64)
    row, col, cell = goal // cols, goal % cols, goal
    for i in range(n - 1, -1, -1):
        path[i, 0], path[i, 1] = row, col
        if row * cols + col == parent[cell]:
            cell = parent[cell]
        dr, dc = _direction(parent[cell], cell, cols)
        row, col = row - dr, col - dc
    return path


@numba.njit(cache=True)
def clear_length(free: NDArray, x0: float, y0: float, x1: float, y1: float) -> float:
    """Return the share (0 to 1) of a segment before it first enters a cell that is not free; 1 = all of it is clear.

    Every cell the segment passes through counts; where it passes exactly through a corner, the two cells beside it
    count as well. Coordinates are in cells: cell (row, col) covers x in [col, col + 1), y in [row, row + 1).
    ``free`` is bool [rows, cols].
    """
    rows, cols = free.shape
    row, col = math.floor(y0), math.floor(x0)
    last_row, last_col = math.floor(y1), math.floor(x1)
    dx, dy = x1 - x0, y1 - y0
    step_c, step_r = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    t_c = ((col + (step_c > 0)) - x0) / dx if dx != 0 else np.inf
    t_r = ((row + (step_r > 0)) - y0) / dy if dy != 0 else np.inf
    entered = 0.0
    # Amanatides and Woo (1987): step to the next column or row, whichever the segment crosses first.
    for _ in range(abs(last_row - row) + abs(last_col - col) + 2):
        if row < 0 or col < 0 or row >= rows or col >= cols or not free[row, col]:
            return entered
        if row == last_row and col == last_col:
            return 1.0
        if abs(t_c - t_r) < 1e-9:
            beside = 0 <= row + step_r < rows and 0 <= col + step_c < cols
            if not beside or not free[row + step_r, col] or not free[row, col + step_c]:
                return min(t_c, 1.0)
            row, col, entered = row + step_r, col + step_c, t_c
            t_c, t_r = t_c + abs(1.0 / dx), t_r + abs(1.0 / dy)
        elif t_c < t_r:
            col, entered, t_c = col + step_c, t_c, t_c + abs(1.0 / dx)
        else:
            row, entered, t_r = row + step_r, t_r, t_r + abs(1.0 / dy)
    return 1.0


@numba.njit(cache=True)
def pull_straight(free: NDArray, points: NDArray) -> NDArray:
    """Drop the points of a path that a clear straight line can skip.

    ``points`` is float64 [n, 2], (x, y) in cells; both ends stay.
    """
    keep = np.zeros(len(points), np.bool_)
    keep[0] = keep[-1] = True
    # First pass: keep the last point in sight of the previous kept one.
    anchor = 0
    for i in range(1, len(points) - 1):
        if not _is_clear(free, points, anchor, i + 1):
            keep[i] = True
            anchor = i
    kept = np.flatnonzero(keep)
    shorter = [kept[0]]
    at = 0
    # Second pass: the first stops at every hidden point, even if a later one is in sight again.
    while at < len(kept) - 1:
        ahead = len(kept) - 1
        while ahead > at + 1 and not _is_clear(free, points, kept[at], kept[ahead]):
            ahead -= 1
        at = ahead
        shorter.append(kept[at])
    return points[np.array(shorter)]


@numba.njit(cache=True)
def _is_clear(free: NDArray, points: NDArray, a: int, b: int) -> bool:
    return clear_length(free, points[a, 0], points[a, 1], points[b, 0], points[b, 1]) >= 1.0


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
        there = f"only a stop within {APPROACH_M:g} m counts as there"
        return f"the robot cannot get {what}: the nearest it can stand is {near_m:.2f} m off, and {there}"


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
