"""Which true object a phrase means, by the meanings written down in ``language.primitives``, asked of the true world.

Every function returns None where people could disagree: where the answer is close, or where another sensible reading of
the same words (nearest edge or middle, left by offset or by bearing, ...) means something else.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.evaluation.world import TrueObject, World
from simaps_viz.navigation.robot import CLEARANCE_M
from simaps_viz.structures import Pose2

MARGIN_M: Final = 0.3
"""What is meant is at least this much nearer (or further to a side) than what comes before and after it."""
MIN_CELLS: Final = 12
"""A class with an object of which less is seen from above is not asked for: 12 cells of 5 cm are a book."""
REACH_M: Final = 0.8
"""What is asked for can be approached this closely with elbow room, so that 1 m is no accident."""
CLEARLY_SEEN: Final = 0.3
"""An object is clearly in view when this share of its cells is."""
FIELD_OF_VIEW_RAD: Final = np.pi / 2.0
"""As documented of ``in_view``."""
_ALONE_M: Final = 0.1
_COMPASS: Final = {"north": (0.0, 1.0), "south": (0.0, -1.0), "east": (1.0, 0.0), "west": (-1.0, 0.0)}


@dataclass(frozen=True)
class TrueGoal:
    """Where one part of a command should end."""

    kind: Literal["object", "beside", "between"]
    label: str
    object: int
    """World-wide id of the object that is meant."""
    other: int | None = None
    """The second object of "between"."""
    side: str | None = None
    """Compass word of "beside"."""
    point_m: tuple[float, float] | None = None
    """The documented point, for "beside" and "between"; map frame."""


def ranked(values: Sequence[float] | NDArray, n: int, *others: Sequence[float] | NDArray) -> int | None:
    """Return the index of the n-th smallest value, if it is clear of its neighbours and all readings agree.

    Args:
        values: the documented reading, metres.
        n: 1 is the smallest.
        others: other readings of the same words; the index must be n-th smallest in each.
    """
    order = np.argsort(values, kind="stable")
    if not 1 <= n <= len(order):
        return None
    gaps = np.diff(np.asarray(values, np.float64)[order])
    if (n >= 2 and gaps[n - 2] < MARGIN_M) or (n < len(order) and gaps[n - 1] < MARGIN_M):
        return None
    meant = int(order[n - 1])
    return meant if all(int(np.argsort(v, kind="stable")[n - 1]) == meant for v in others) else None


def nth_closest(objects: Sequence[TrueObject], here_m: NDArray, n: int) -> TrueObject | None:
    """Return the n-th closest to a point, float [2], map frame: by the centre of the nearest cell and by the middle."""
    edges = [o.distance_m(here_m) for o in objects]
    middles = [float(np.linalg.norm(o.centroid_m - here_m)) for o in objects]
    meant = ranked(edges, n, middles)
    return None if meant is None else objects[meant]


def nth_from(objects: Sequence[TrueObject], side: str, n: int, viewer: Pose2) -> TrueObject | None:
    """The n-th counted from a side: by middles, and by edges; left and right also by bearing, all being ahead."""
    here = np.array([viewer.x_m, viewer.y_m])
    ahead = np.array([np.cos(viewer.yaw_rad), np.sin(viewer.yaw_rad)])
    left = np.array([-ahead[1], ahead[0]])
    direction = np.array(_COMPASS[side]) if side in _COMPASS else left if side == "left" else -left
    others = [[-float((o.cells_m @ direction).max()) for o in objects]]
    if side not in _COMPASS:
        offsets = [o.cells_m - here for o in objects]
        if any(float((cells @ ahead).min()) <= 0.0 for cells in offsets):
            return None
        others.append([-float(np.arctan2((c @ direction).mean(), (c @ ahead).mean())) for c in offsets])
    meant = ranked([-float(o.centroid_m @ direction) for o in objects], n, *others)
    return None if meant is None else objects[meant]


def nearest_to(objects: Sequence[TrueObject], targets: Sequence[TrueObject], here_m: NDArray) -> TrueObject | None:
    """Return the object nearest to the closest of the targets; also when "the target" is taken as any of them."""
    target = nth_closest(targets, here_m, 1)
    if target is None or len(objects) < 2:
        return None
    gaps = np.array([[float(t.tree.query(o.cells_m)[0].min()) for o in objects] for t in targets])
    middles = [float(np.linalg.norm(o.centroid_m - target.centroid_m)) for o in objects]
    meant = ranked(gaps[list(targets).index(target)], 1, middles, gaps.min(axis=0))
    return None if meant is None else objects[meant]


def in_view(world: World, objects: Sequence[TrueObject], viewer: Pose2) -> list[TrueObject] | None:
    """Return the objects clearly in view; None if it is not clear of one of them, as how high the camera is matters."""
    seen = []
    for thing in objects:
        if _share_in_view(thing, viewer, FIELD_OF_VIEW_RAD, world.surely_sees) >= CLEARLY_SEEN:
            seen.append(thing)
        elif _share_in_view(thing, viewer, FIELD_OF_VIEW_RAD + np.deg2rad(20.0), world.might_see) > 0.0:
            return None
    return seen


def _share_in_view(
    thing: TrueObject, viewer: Pose2, field_of_view_rad: float, sees: Callable[[NDArray, NDArray, int], bool]
) -> float:
    """Return the share of an object's (at most 60) cells that is in a field of view and that a test says is seen."""
    here = np.array([viewer.x_m, viewer.y_m])
    cells = thing.cells_m[:: max(1, len(thing.cells_m) // 60)]
    bearing = np.arctan2(*(cells - here).T[::-1]) - viewer.yaw_rad
    ahead = np.abs((bearing + np.pi) % (2.0 * np.pi) - np.pi) <= field_of_view_rad / 2.0
    return sum(sees(here, cell, thing.id) for cell in cells[ahead]) / len(cells)


def is_approachable(world: World, thing: TrueObject) -> bool:
    """Return whether a robot can stand near an object and see it, and then nearer to it than to others of its class."""
    distance, cell = thing.tree.query(world.roomy)
    if distance.min() > REACH_M:
        return False
    near = np.flatnonzero(distance <= distance.min() + _ALONE_M)
    some = near[:: max(1, len(near) // 40)]
    nearest_m = thing.cells_m[np.asarray(cell)[some]]
    sees = any(world.sight_is_free(eye, c, thing.id) for eye, c in zip(world.roomy[some], nearest_m, strict=True))
    return sees and _stands_alone(world, thing, world.roomy[near])


def beside(world: World, thing: TrueObject, side: str) -> TrueGoal | None:
    """Return the goal on a compass side of an object, if the robot can stand there and sees the object."""
    direction = np.array(_COMPASS[side])
    extent = float(((thing.cells_m - thing.centroid_m) @ direction).max()) + world.spec.cell_size_m / 2.0
    point = thing.centroid_m + direction * (extent + world.robot.radius_m + CLEARANCE_M)
    if not _can_stand(world, point) or not world.sight_is_free(point, thing.centroid_m, thing.id):
        return None
    if thing.distance_m(point) > REACH_M or not _stands_alone(world, thing, point[None]):
        return None
    return TrueGoal("beside", thing.label, thing.id, side=side, point_m=(float(point[0]), float(point[1])))


def between(world: World, a: TrueObject, b: TrueObject) -> TrueGoal | None:
    """Return the goal in the gap between two objects, if the robot can stand there and sees both."""
    share = np.linspace(0.0, 1.0, 4001)
    line = a.centroid_m + share[:, None] * (b.centroid_m - a.centroid_m)
    cells = np.floor((line - (world.spec.x0_m, world.spec.y0_m)) / world.spec.cell_size_m).astype(np.int64)
    ids = world.ids[cells[:, 1], cells[:, 0]]
    leaves = share[ids == a.id].max(initial=0.0)
    enters = share[(ids == b.id) & (share > leaves)].min(initial=1.0)
    gap_m = float((enters - leaves) * np.linalg.norm(b.centroid_m - a.centroid_m))
    point = a.centroid_m + (leaves + enters) / 2.0 * (b.centroid_m - a.centroid_m)
    sees = all(world.sight_is_free(point, o.centroid_m, o.id) for o in (a, b))
    if not 0.8 <= gap_m <= 5.0 or not sees or not _can_stand(world, point):
        return None
    return TrueGoal("between", a.label, a.id, other=b.id, point_m=(float(point[0]), float(point[1])))


def side_error_m(world: World, goal: TrueGoal, point_m: Sequence[float]) -> float:
    """How far a point is from being on the goal's side of its object (within 45 degrees of it), metres; 0 = is."""
    thing = world.by_id(goal.object)
    direction = np.array(_COMPASS[goal.side or "north"])
    offset = np.asarray(point_m) - thing.centroid_m
    along, across = float(offset @ direction), abs(float(offset[0] * direction[1] - offset[1] * direction[0]))
    extent = float(((thing.cells_m - thing.centroid_m) @ direction).max()) + world.spec.cell_size_m / 2.0
    return max(extent - along, across - along, 0.0)


def _can_stand(world: World, point_m: NDArray) -> bool:
    return bool(world.roomy_tree.query(point_m)[0] <= 0.25)


def _stands_alone(world: World, thing: TrueObject, points_m: NDArray) -> bool:
    own = thing.tree.query(points_m)[0]
    others = [o.tree.query(points_m)[0] for o in world.of_class(thing.label) if o is not thing]
    return all(bool((own < other).all()) for other in others)
