"""A disc that follows a planned path through the true world, and stops where it would hit something."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.evaluation.world import TOLERANCE_M, World
from simaps_viz.geometry import wrap_angle
from simaps_viz.navigation.robot import Goal
from simaps_viz.structures import Pose2

Actions = Literal["continuous", "discrete"]
"""continuous: exactly along the path; discrete: forward 0.1 m and turns of 5 degrees, as VLMaps' agent moves."""
STEP_M: Final = 0.02
"""How densely a drive is checked for collisions."""
FORWARD_M: Final = 0.1
TURN_RAD: Final = np.deg2rad(5.0)
AIM_M: Final = 0.5
"""With discrete actions it aims at points of the path this far apart: aiming further it would drift off a long leg."""


@dataclass(frozen=True, eq=False)
class Drive:
    """What came of following a path."""

    track_m: NDArray
    """float64 [n, 2], where the centre went, map frame."""
    stops_m: tuple[tuple[float, float], ...]
    """Where it stood at the end of each leg, as far as it came."""
    contact_m: tuple[float, float] | None
    """Where its centre would have been at the collision; None without one."""

    @property
    def collided(self) -> bool:
        """Whether the drive ended at an obstacle. It does not slide along it, so there is at most one contact."""
        return self.contact_m is not None

    @property
    def final_m(self) -> tuple[float, float]:
        """Where it stands in the end."""
        return float(self.track_m[-1, 0]), float(self.track_m[-1, 1])


def legs_of(path_m: NDArray, goals: Sequence[Goal]) -> list[NDArray]:
    """Cut an answer's path where its goals end: one polyline [n, 2] for each goal, in order.

    ``path_m`` is float64 [m, 2], map frame; empty before any driving. A goal that was reached without driving has a leg
    of one point. What follows the last goal is left out.
    """
    legs, at = [], 0
    for goal in goals:
        ends = np.flatnonzero((path_m[at:] == np.asarray(goal.point_m)).all(axis=1))
        if len(ends):
            legs.append(path_m[at : at + int(ends[0]) + 1])
            at += int(ends[0])
    return legs


def drive_through(
    world: World,
    legs: Sequence[NDArray],
    start: Pose2,
    *,
    actions: Actions = "continuous",
    tolerance_m: float = TOLERANCE_M,
) -> Drive:
    """Follow the legs of a path in the true world; the drive ends short of the first collision.

    A collision is a disc of the robot's radius, less the tolerance, that overlaps an occupied cell.

    Args:
        world: what is true.
        legs: polylines [n, 2], map frame, each beginning where the last one ends.
        start: where the robot stands.
        actions: how it moves.
        tolerance_m: how much overlap the map's rounding excuses.
    """
    pose, track, stops = start, [np.array([[start.x_m, start.y_m]])], []
    for leg in legs:
        points, pose = _follow(leg, pose, actions)
        hit = np.flatnonzero(world.clearance_m(points) < world.robot.radius_m - tolerance_m)
        if len(hit):
            track.append(points[: int(hit[0])])
            contact = points[int(hit[0])]
            return Drive(np.concatenate(track), tuple(stops), (float(contact[0]), float(contact[1])))
        track.append(points)
        stops.append((pose.x_m, pose.y_m))
    return Drive(np.concatenate(track), tuple(stops), None)


def _follow(leg: NDArray, pose: Pose2, actions: Actions) -> tuple[NDArray, Pose2]:
    """Return the points passed through, float64 [n, 2], without the first, and the pose at the end."""
    here, yaw = np.array([pose.x_m, pose.y_m]), pose.yaw_rad
    pieces = [np.zeros((0, 2))]
    for target in leg if actions == "continuous" else _no_longer_than(leg, AIM_M):
        ways = [target] if actions == "continuous" else []
        while actions == "discrete" and len(ways) < 10_000:
            offset = target - (ways[-1] if ways else here)
            if float(np.hypot(*offset)) <= FORWARD_M / 2.0 + 1e-9:
                break
            yaw += TURN_RAD * round(wrap_angle(float(np.arctan2(offset[1], offset[0])) - yaw) / TURN_RAD)
            ways.append((ways[-1] if ways else here) + FORWARD_M * np.array([np.cos(yaw), np.sin(yaw)]))
        for end in ways:
            steps = int(np.ceil(float(np.linalg.norm(end - here)) / STEP_M - 1e-9))
            pieces.append(here + np.linspace(0.0, 1.0, steps + 1)[1:, None] * (end - here))
            here = np.asarray(end, np.float64)
    return np.concatenate(pieces), Pose2(float(here[0]), float(here[1]), wrap_angle(yaw))


def _no_longer_than(points: NDArray, length_m: float) -> NDArray:
    """Put points between those of a polyline [n, 2], so that none are further apart."""
    pieces = [points[:1]]
    for a, b in pairwise(points):
        steps = max(1, int(np.ceil(float(np.linalg.norm(b - a)) / length_m - 1e-9)))
        pieces.append(a + np.linspace(0.0, 1.0, steps + 1)[1:, None] * (b - a))
    return np.concatenate(pieces)
