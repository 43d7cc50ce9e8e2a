"""Was a command carried out? Judged by what is true, not by the map the robot used.

A disc follows the planned path through the true world, and stops where it would hit something.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.evaluation.referents import TrueGoal, side_error_m
from simaps_viz.evaluation.tasks import Task
from simaps_viz.evaluation.world import TOLERANCE_M, World
from simaps_viz.geometry import wrap_angle
from simaps_viz.navigation.agent import Answer
from simaps_viz.navigation.robot import Goal
from simaps_viz.structures import Pose2, SIMap

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
    """Outcome of following a path."""

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
        """Where the robot is in the end."""
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
        start: where the robot is.
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


SUCCESS_M: Final = 1.0
"""VLMaps' rule: the robot has to stop this close (Huang et al., ICRA 2023)."""
_ROUNDING_M: Final = 0.1
"""Sides and neighbours are distinguished no finer than two map cells."""


@dataclass(frozen=True)
class Verdict:
    """Score of a run."""

    automatic: bool
    """Stopped within 1 m of every goal, in order, or refused what is not there."""
    strict: bool
    """Automatic; and everywhere at the very object that is meant, on the right side of it, without a collision."""
    reason: str | None
    """What is wrong first; None when strict."""


def true_objects_of(simap: SIMap, world: World) -> dict[int, int]:
    """Return {instance of the judged map: world-wide id of the object it shares most cells with}; 0 if with none."""
    rows, cols = np.nonzero(simap.instance)
    x = simap.spec.x0_m + (cols + 0.5) * simap.spec.cell_size_m
    y = simap.spec.y0_m + (rows + 0.5) * simap.spec.cell_size_m
    col = np.floor((x - world.spec.x0_m) / world.spec.cell_size_m).astype(np.int64)
    row = np.floor((y - world.spec.y0_m) / world.spec.cell_size_m).astype(np.int64)
    inside = (row >= 0) & (row < world.spec.rows) & (col >= 0) & (col < world.spec.cols)
    true = np.zeros(len(rows), np.int64)
    true[inside] = world.ids[row[inside], col[inside]]
    pairs, shared = np.unique(np.column_stack([simap.instance[rows, cols], true]), axis=0, return_counts=True)
    best: dict[int, int] = {instance.id: 0 for instance in simap.instances}
    for (mine, theirs), _ in sorted(zip(pairs.tolist(), shared.tolist(), strict=True), key=lambda p: (p[1], -p[0][1])):
        if theirs:
            best[mine] = theirs
    return best


def judge(world: World, shows: Mapping[int, int], task: Task, answer: Answer, drive: Drive) -> Verdict:
    """Judge one run.

    Args:
        world: what is true.
        shows: of the judged map, from `true_objects_of`.
        task: what was asked for.
        answer: what the robot planned on the judged map.
        drive: how that went in the true world.
    """
    if task.wants_refusal:
        refused = answer.status == "refused"
        return Verdict(refused, refused, None if refused else f"{answer.status}, but there is no such thing")
    stops = drive.stops_m + ((drive.final_m,) if drive.collided else ())
    if len(stops) < len(task.goals) and not drive.collided:
        return Verdict(False, False, f"{answer.status}: {answer.reason}")
    collision = "collided at ({:.2f}, {:.2f})".format(*drive.contact_m) if drive.contact_m else None
    for goal, stop in zip(task.goals, stops, strict=False):
        off = distance_to_goal_m(world, goal, stop)
        if off > SUCCESS_M + 1e-6:
            return Verdict(False, False, collision or f"stopped {off:.2f} m from {_named(goal)}")
    if len(stops) < len(task.goals):
        return Verdict(False, False, collision)
    wrong = collision
    for goal, planned, stop in zip(task.goals, answer.goals, stops, strict=False):
        wrong = wrong or _why_wrong(world, shows, goal, planned, stop)
    return Verdict(True, wrong is None, wrong)


def distance_to_goal_m(world: World, goal: TrueGoal, stop_m: Sequence[float]) -> float:
    """Return how far a stop is from the nearest cell of the goal's object; of "between", from the middle of the gap."""
    if goal.kind == "between" and goal.point_m is not None:
        return float(np.hypot(stop_m[0] - goal.point_m[0], stop_m[1] - goal.point_m[1]))
    return world.by_id(goal.object).distance_m(stop_m)


def _why_wrong(
    world: World, shows: Mapping[int, int], goal: TrueGoal, planned: Goal, stop_m: tuple[float, float]
) -> str | None:
    """Describe why a stop near a goal is not the right one; None if it is."""
    went_to = shows.get(planned.instance or 0, 0)
    if goal.kind == "between":
        other = shows.get(planned.other_instance or 0, 0)
        if {went_to, other} != {goal.object, goal.other}:
            return f"went between {went_to} and {other} instead of {goal.object} and {goal.other}"
        a, b = (world.by_id(i).centroid_m for i in (goal.object, goal.other or 0))
        length = float(np.linalg.norm(b - a))
        along = float((np.asarray(stop_m) - a) @ (b - a)) / max(length, 1e-9)
        inside = -_ROUNDING_M <= along <= length + _ROUNDING_M
        return None if inside else f"stopped beside the gap between {goal.object} and {goal.other}"
    if went_to != goal.object:
        return f"went to {went_to or 'nothing real'} instead of {_named(goal)}"
    nearest = min(world.of_class(goal.label), key=lambda o: o.distance_m(stop_m))
    if nearest.distance_m(stop_m) < world.by_id(goal.object).distance_m(stop_m) - _ROUNDING_M:
        return f"stopped nearer to {goal.label} {nearest.id} than to {_named(goal)}"
    if goal.kind == "beside" and (error := side_error_m(world, goal, stop_m)) > _ROUNDING_M:
        return f"stopped {error:.2f} m off the {goal.side} side of {_named(goal)}"
    return None


def _named(goal: TrueGoal) -> str:
    if goal.kind == "between":
        return f"the gap between {goal.object} and {goal.other}"
    return f"{goal.label} {goal.object}"
