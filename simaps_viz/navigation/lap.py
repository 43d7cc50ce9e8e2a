"""Closed loops a robot can drive all around things."""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import KDTree

from simaps_viz.errors import CommandError, PlanningError
from simaps_viz.navigation.astar import clear_length
from simaps_viz.navigation.planner import Planner

MAX_LAPS: Final = 20
MAX_OFF_M: Final = 3.0
"""A loop stays this close to what it goes around: one through the next room is not what people mean."""
_MAX_PATCHES = 60


def lap(
    planner: Planner, start_m: tuple[float, float], things_m: Sequence[NDArray], what: str, turns: float = 1.0
) -> list[tuple[float, float]]:
    """Find positions of a closed loop all around things, as close to them as the robot fits.

    Every straight line from one position to the next lies on free cells. With whole turns the last position is the
    first; the winding number of the polygon around each of the things is ``-turns``.

    Args:
        planner: of the map and the robot.
        start_m: where the robot is; the loop starts at its point nearest to it.
        things_m: float64 [n, 2] for each thing, the centres of its cells, map frame. Several things are gone around
            together.
        what: names them in errors, with their article.
        turns: how often to go around, clockwise; negative: counter-clockwise. A fraction ends short of the whole loop.

    Raises:
        CommandError: the number of turns is 0 or more than ``MAX_LAPS``.
        PlanningError: something stands in the way of every such loop.
    """
    if not 0.0 < abs(turns) <= MAX_LAPS:
        raise CommandError(f"a lap takes up to {MAX_LAPS} turns, more than none; {turns:g} were asked for")
    spec = planner.spec
    # Work in a window that holds all cells near enough, with a border of cells that are not free.
    cells = np.concatenate([_rows_and_cols(spec.x0_m, spec.y0_m, spec.cell_size_m, centres) for centres in things_m])
    margin = int(np.ceil(MAX_OFF_M / spec.cell_size_m)) + 1
    low, high = cells.min(axis=0) - margin, cells.max(axis=0) + margin + 1
    inside_low, inside_high = np.maximum(low, 0), np.minimum(high, spec.shape)
    window = np.s_[inside_low[0] : inside_high[0], inside_low[1] : inside_high[1]]
    free = np.zeros(high - low, np.bool_)
    part = np.s_[tuple(slice(a, b) for a, b in zip(inside_low - low, inside_high - low, strict=True))]
    free[part] = planner.reachable(*start_m)[window]
    # What the loop goes around: the things, and the gaps between them.
    core = _joined([_rows_and_cols(spec.x0_m, spec.y0_m, spec.cell_size_m, one) - low for one in things_m], free.shape)
    off_m = np.asarray(ndimage.distance_transform_edt(~core)) * spec.cell_size_m
    free &= ~core & (off_m <= MAX_OFF_M)
    if not free.any():
        raise PlanningError(f"the robot cannot get within {MAX_OFF_M:g} m of {what}")
    # All that touches the things lies inside the loop. If it reaches the outside, nothing goes all around.
    blocked = np.asarray(ndimage.label(~free, np.ones((3, 3)))[0])  # pyright: ignore[reportIndexIssue]
    solid = np.argwhere(core)
    around = blocked == blocked[tuple(solid[0])]
    if around[0, 0]:
        raise PlanningError(f"there is no way all around {what}: something stands against it")
    ring = _outline(around)
    ring = np.roll(ring, -_nearest(ring, start_m, planner, low), axis=0)
    middle = solid[np.argmin(((solid - solid.mean(axis=0)) ** 2).sum(axis=1))]
    corners = _straightened(free, np.vstack([ring, ring[:1]]) + 0.5, middle[::-1] + 0.5)
    points = (corners + low[::-1]) * spec.cell_size_m + (spec.x0_m, spec.y0_m)
    return _repeated(points[::-1] if turns > 0.0 else points, abs(turns))


def _rows_and_cols(x0_m: float, y0_m: float, cell_size_m: float, centres_m: NDArray) -> NDArray:
    return np.floor((centres_m[:, ::-1] - (y0_m, x0_m)) / cell_size_m).astype(np.int64)


def _joined(things: Sequence[NDArray], shape: tuple[int, ...]) -> NDArray:
    """Return the cells of all things, and of the shortest straight lines that join them, bool [rows, cols]."""
    core = np.zeros(shape, np.uint8)
    for cells in things:
        core[cells[:, 0], cells[:, 1]] = 1
    count, labels = cv2.connectedComponents(core)
    if count - 1 > _MAX_PATCHES:
        raise CommandError(f"a lap goes around at most {_MAX_PATCHES} separate things, {count - 1} were asked for")
    patches = [np.argwhere(labels == number) for number in range(1, count)]
    gaps = np.zeros((len(patches), len(patches)))
    ends = {}
    for i, first in enumerate(patches):
        tree = KDTree(first)
        for j in range(i + 1, len(patches)):
            distance, nearest = tree.query(patches[j])
            k = int(np.argmin(distance))
            gaps[i, j], ends[i, j] = distance[k], (first[np.asarray(nearest)[k]], patches[j][k])
    joins = coo_array(minimum_spanning_tree(gaps))
    for i, j in zip(joins.row.tolist(), joins.col.tolist(), strict=True):
        a, b = ends[i, j]
        cv2.line(core, a[::-1].tolist(), b[::-1].tolist(), 1)
    return core.astype(np.bool_)


def _outline(around: NDArray) -> NDArray:
    """Return the ring of cells just outside a patch, int [n, 2] (x, y), counter-clockwise, joined by their sides.

    All of them are free, as the patch holds every cell that is not and touches it by a side or a corner.
    """
    grown = cv2.dilate(around.astype(np.uint8), np.ones((3, 3), np.uint8))
    outlines, _ = cv2.findContours(grown, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    ring = max(outlines, key=len)[:, 0, :].astype(np.int64)
    steps = [ring[0]]
    for x, y in np.roll(ring, -1, axis=0):
        last_x, last_y = steps[-1]
        if x != last_x and y != last_y:  # of the two cells beside a diagonal step, the one inside is free
            beside = [(x, last_y), (last_x, y)]
            steps.append(np.array(next(one for one in beside if grown[one[1], one[0]])))
        steps.append(np.array((x, y)))
    cells = np.array(steps[:-1])
    x, y = cells.T.astype(np.float64)
    area = float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    return cells if area > 0.0 else cells[::-1]


def _nearest(ring: NDArray, start_m: tuple[float, float], planner: Planner, low: NDArray) -> int:
    spec = planner.spec
    x, y = ((ring + 0.5 + low[::-1]) * spec.cell_size_m + (spec.x0_m, spec.y0_m)).T
    return int(np.argmin(np.hypot(x - start_m[0], y - start_m[1])))


def _straightened(free: NDArray, points: NDArray, middle: NDArray) -> NDArray:
    """Drop the points of a closed ring that a clear straight line can skip without passing the middle on the far side.

    Args:
        free: bool [rows, cols].
        points: float64 [n, 2], (x, y) in cells; the last is the first.
        middle: float64 [2], a point in the loop's solid middle, which no clear line can cross.
    """
    bearing = np.unwrap(np.arctan2(*(points - middle).T[::-1]))
    kept, at = [0], 0
    for i in range(2, len(points)):
        turned = bearing[i] - bearing[at]
        clear = abs(turned) < np.pi and clear_length(free, *points[at], *points[i]) >= 1.0
        if not clear:
            at = i - 1
            kept.append(at)
    return points[[*kept, len(points) - 1]]


def _repeated(points: NDArray, turns: float) -> list[tuple[float, float]]:
    """Return a closed polyline so many times over, the last time as far as the fraction of its length says."""
    whole = int(turns + 1e-9)
    found = [points[0], *np.tile(points[1:], (whole, 1))]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    left = (turns - whole) * float(lengths.sum())
    for a, b, length in zip(points, points[1:], lengths, strict=False):
        if left <= 1e-6:
            break
        found.append(a + (b - a) * min(1.0, left / length))
        left -= length
    return [(float(x), float(y)) for x, y in found]
