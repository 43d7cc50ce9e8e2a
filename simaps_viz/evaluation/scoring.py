"""Was a command carried out? Judged by what is true, not by the map the robot used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from simaps_viz.evaluation.driving import Drive
from simaps_viz.evaluation.referents import TrueGoal, side_error_m
from simaps_viz.evaluation.tasks import Task
from simaps_viz.evaluation.world import World
from simaps_viz.navigation.agent import Answer
from simaps_viz.navigation.robot import Goal
from simaps_viz.structures import SIMap

SUCCESS_M: Final = 1.0
"""VLMaps' rule: the robot has to stop this close (Huang et al., ICRA 2023)."""
_ROUNDING_M: Final = 0.1
"""Sides and neighbours are told apart no finer than two map cells."""


@dataclass(frozen=True)
class Verdict:
    """What a run was worth."""

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
