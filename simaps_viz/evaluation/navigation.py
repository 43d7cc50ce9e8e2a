"""The paper's experiment: commands to a robot on maps of several methods, driven and judged in the true world.

Whether a command was carried out is judged by what is true, not by the map the robot used: a disc follows the planned
path through the true world, and stops where it would hit something.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.evaluation.evaluate import NOT_SIMULATED, Build, check_lists, masks_source
from simaps_viz.evaluation.report import TextTable
from simaps_viz.evaluation.tasks import FAMILIES, Task, TrueGoal, make_tasks, side_error_m
from simaps_viz.evaluation.truth import check_same_frame, find_truth, partners, truth_as_map
from simaps_viz.evaluation.world import TOLERANCE_M, World, observe_world
from simaps_viz.events import Progress
from simaps_viz.geometry import wrap_angle
from simaps_viz.navigation.agent import Answer, answer
from simaps_viz.navigation.planner import RobotShape
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
    row, col = world.spec.cells_of(simap.spec.centres_of(rows, cols))
    inside = (row >= 0) & (row < world.spec.rows) & (col >= 0) & (col < world.spec.cols)
    true = np.zeros(len(rows), np.int64)
    true[inside] = world.ids[row[inside], col[inside]]
    return {one.id: 0 for one in simap.instances} | partners(simap.instance[rows, cols], true)


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


TRUE_MAP = "true map"
"""A method that is always there: the true instances themselves. What it misses is the robot's or the judge's fault."""


@dataclass(frozen=True, eq=False)
class NavigationRun:
    """One command, on one map, in the true world."""

    method: str
    errors: str
    seed: int
    task: Task
    answer: Answer
    drive: Drive
    verdict: Verdict

    def to_json(self) -> dict[str, Any]:
        """Return what happened, JSON-able; lengths in metres, the start's heading in degrees clockwise from north."""
        start, said, drive = self.task.start, self.answer, self.drive
        return {
            "method": self.method, "errors": self.errors, "seed": self.seed, "task": self.task.number,
            "family": self.task.family, "command": self.task.command,
            "start": [start.x_m, start.y_m, round(start.heading_deg, 6)],
            "meant": [{"kind": g.kind, "label": g.label, "object": g.object, "other": g.other, "side": g.side,
                       "point": g.point_m} for g in self.task.goals],
            "status": said.status, "reason": said.reason, "program": said.program,
            "planned": [goal.to_json() for goal in said.goals],
            "track": _thinned(drive.track_m), "stops": [_rounded(stop) for stop in drive.stops_m],
            "collision": _rounded(drive.contact_m) if drive.contact_m else None,
            "automatic": self.verdict.automatic, "strict": self.verdict.strict, "wrong": self.verdict.reason,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class NavigationReport:
    """All runs of one sequence, by errors, seed, method, command."""

    name: str
    path: Path
    simulated: bool
    """The frames themselves are simulated (rendered)."""
    robot: RobotShape
    actions: Actions
    runs: tuple[NavigationRun, ...]

    @property
    def errors(self) -> tuple[str, ...]:
        """In the order asked for."""
        return tuple(dict.fromkeys(run.errors for run in self.runs))

    @property
    def methods(self) -> tuple[str, ...]:
        """In the order asked for."""
        return tuple(dict.fromkeys(run.method for run in self.runs))

    @property
    def families(self) -> tuple[str, ...]:
        """Those of which there are commands."""
        present = {run.task.family for run in self.runs}
        return tuple(family for family in FAMILIES if family in present)

    def of(self, errors: str, method: str, family: str | None = None) -> tuple[NavigationRun, ...]:
        """Return the runs behind one number of the table, over all seeds."""
        return tuple(
            run for run in self.runs
            if (run.errors, run.method) == (errors, method) and family in (None, run.task.family)
        )  # fmt: skip


def evaluate_navigation(
    sequence: PosedFrames,
    methods: Sequence[str],
    *,
    build: Build,
    errors: Sequence[str] = ("none",),
    seeds: Sequence[int] = (0,),
    commands: int = 100,
    truth: Path | None = None,
    robot: RobotShape | None = None,
    actions: Actions = "continuous",
    surface_m: NDArray | None = None,
    progress: Progress | None = None,
) -> NavigationReport:
    """Run the same commands on the map of every method, and judge the robot's motion in the true world.

    The words are read by the same parser for all methods. ``TRUE_MAP`` may be among the methods; it is not built.

    Args:
        sequence: exact ids, or masks by a network with the exact ids beside them (see `find_truth`).
        methods: names that ``build`` knows.
        build: builds a map by the method of a name.
        errors: of ``evaluate.ERRORS``: what masks the maps are built from.
        seeds: each has commands, starts and simulated errors of its own.
        commands: how many for each seed.
        truth: manifest with exact ids, if it is not to be looked for.
        robot: its shape.
        actions: how it moves in the true world.
        surface_m: points on the scene's surfaces, if they are known; see `observe_world`.
        progress: notified of every step.

    Raises:
        InputError: there is no truth, too little in the world, or something is asked for twice or not at all.
    """
    check_lists(methods, errors, seeds)
    if commands < 1 or min(seeds) < 0:
        raise InputError(f"navigation: expected at least 1 command and seeds from 0, found {commands} and {min(seeds)}")
    exact, robot = find_truth(sequence, truth), robot or RobotShape()
    tell = progress or (lambda stage, done, total: None)
    tell(f"{exact.name}: looking at the true world", 0, 1)
    world = observe_world(exact, robot=robot, surface_m=surface_m)
    tell(f"{exact.name}: looking at the true world", 1, 1)
    asked = {}
    for done, seed in enumerate(seeds, start=1):
        asked[seed] = make_tasks(world, count=commands, seed=seed)
        tell("making commands", done, len(seeds))
    runs: list[NavigationRun] = []
    total = len(errors) * len(seeds) * len(methods) * commands
    maps: dict[tuple[str, str], SIMap] = {}
    for kind in errors:
        for seed in seeds:
            source = masks_source(sequence, exact, kind, seed, progress)
            for method in methods:
                simap = maps.get((kind, method)) or _map(source, method, build, world)
                if kind in NOT_SIMULATED:  # the same masks for every seed
                    maps[kind, method] = simap
                shows = true_objects_of(simap, world)
                for task in asked[seed]:
                    said, drive, verdict = carry_out(world, simap, shows, task, actions=actions)
                    runs.append(NavigationRun(method, kind, seed, task, said, drive, verdict))
                    tell(f"driving: {kind} errors, {method}", len(runs), total)
    return NavigationReport(sequence.name, sequence.path, exact.simulated, robot, actions, tuple(runs))


def carry_out(
    world: World, simap: SIMap, shows: dict[int, int], task: Task, *, actions: Actions = "continuous"
) -> tuple[Answer, Drive, Verdict]:
    """Let the robot answer one command on a map, follow its path in the true world, and judge it."""
    said = answer(simap, task.command, task.start, robot=world.robot)
    drive = drive_through(world, legs_of(said.path_m, said.goals), task.start, actions=actions)
    return said, drive, judge(world, shows, task, said, drive)


def _map(source: FrameSource, method: str, build: Build, world: World) -> SIMap:
    if method == TRUE_MAP:
        return truth_as_map(world.tops)
    simap = build(source, method)
    check_same_frame(simap, world.tops)
    return simap


def _rounded(point: Sequence[float] | NDArray) -> list[float]:
    return [round(float(v), 3) for v in point]


def _thinned(track_m: NDArray) -> list[list[float]]:
    """Every fifth point of a track (10 cm), and its last."""
    kept = np.unique(np.append(np.arange(0, len(track_m), 5), len(track_m) - 1))
    return [_rounded(point) for point in track_m[kept]]


FORMAT: Final = "simaps-navigation/1"
LEGEND: Final = (
    f"Each cell: automatic / strict, shares of the commands. Automatic: stopped within {SUCCESS_M:g} m of every goal,\n"
    "in order (VLMaps' rule), or refused what is not there. Strict: also at the very object that is meant, on the\n"
    f"right side of it, without a collision. A run ends where the robot collides; {TOLERANCE_M * 100:g} cm of overlap\n"
    f"are put down to the map's rounding. \"{TRUE_MAP}\" has the true instances: what it misses is no map's fault."
)
PAPER_GAIN_PERCENT: Final = 233.0
"""Gain of instance-level maps over the baseline on instance-specific commands, from the paper's abstract."""
PAPER_SUCCESS: Final = {
    "vlmaps": (0.46, 0.24), "vlmaps+components": (0.48, 0.34), "paper": (0.88, 0.80), "paper-k9": (0.88, 0.76),
}  # fmt: skip
"""{method: success by VLMaps' rule, success as people judged it}, of the paper's table."""
_SHARES: Final = "; ".join(f"{name} {rule:.2f} / {people:.2f}" for name, (rule, people) in PAPER_SUCCESS.items())
PAPER: Final = (
    "Beside the paper (Nanwani et al., Instance-Level Semantic Maps for Vision Language Navigation, 2023,\n"
    f"arXiv:2305.12363), by rule / by people:\n{_SHARES}.\n"
    'Its abstract says that its map improves navigation "by two-fold (233%)" over its baseline, on commands with\n'
    "instance-specific descriptions. That is another experiment: other scenes, another simulator, other commands.\n"
    "Here commands are made from the truth in fixed families and read by one grammar for all methods, masks are\n"
    "exact, simulated or the sequence's own, and the judge is a program; what people say is a line of its own."
)


def success_tables(report: NavigationReport) -> tuple[TextTable, ...]:
    """Lay out one table for each kind of errors: families down, methods across."""
    tables = []
    for errors in report.errors:
        rows = [
            (family, str(len(report.of(errors, report.methods[0], family))),
             *(_cell(report.of(errors, method, family)) for method in report.methods))
            for family in report.families
        ]  # fmt: skip
        everything = [report.of(errors, method) for method in report.methods]
        rows.append(("all", str(len(everything[0])), *map(_cell, everything)))
        rows.append(("collisions", "", *(str(sum(run.drive.collided for run in runs)) for runs in everything)))
        title = f"{report.name}: {_words(errors)}; {_robot(report)}"
        note = LEGEND if errors == report.errors[-1] else ""
        tables.append(TextTable(title, ("family", "commands", *report.methods), tuple(rows), note=note))
    return tuple(tables)


def navigation_text(report: NavigationReport) -> str:
    """Return everything to print: the tables, the gain over VLMaps, and the paper beside it."""
    pieces = [table.text() for table in success_tables(report)]
    gains = gains_over(report, "vlmaps")
    if gains:
        lines = [f"  {errors} errors, {method}: {gain:+.0f} %" for (errors, method), gain in gains.items()]
        head = f"Strict success against vlmaps (the paper's abstract, its own experiment: {PAPER_GAIN_PERCENT:+.0f} %):"
        pieces.append("\n".join([head, *lines]) + "\n")
    return "\n".join([*pieces, PAPER]) + "\n"


def gains_over(report: NavigationReport, baseline: str) -> dict[tuple[str, str], float]:
    """{(errors, method): gain of its strict success over the baseline's, percent}; empty without that baseline."""
    gains = {}
    for errors in report.errors:
        base = strict_share(report.of(errors, baseline))
        for method in report.methods if base else ():
            if base and method not in (baseline, TRUE_MAP):
                gains[errors, method] = (strict_share(report.of(errors, method)) / base - 1.0) * 100.0
    return gains


def automatic_share(runs: Sequence[NavigationRun]) -> float:
    """Return the share of runs that reached their goals; 0 for no runs."""
    return sum(run.verdict.automatic for run in runs) / max(len(runs), 1)


def strict_share(runs: Sequence[NavigationRun]) -> float:
    """Return the share of runs that did what was meant; 0 for no runs."""
    return sum(run.verdict.strict for run in runs) / max(len(runs), 1)


def navigation_json(report: NavigationReport) -> dict[str, Any]:
    """Return the tables and every run, JSON-able; ``people`` is null: they judge later, see `judging`."""
    shares = [
        {
            "errors": errors, "method": method, "family": family, "commands": len(runs),
            "automatic": automatic_share(runs), "strict": strict_share(runs),
            "collisions": sum(run.drive.collided for run in runs),
        }
        for errors in report.errors
        for method in report.methods
        for family in (*report.families, None)
        if (runs := report.of(errors, method, family))
    ]  # fmt: skip
    return {
        "format": FORMAT, "name": report.name, "sequence": str(report.path), "simulated": report.simulated,
        "robot": {"radius_m": report.robot.radius_m, "height_m": report.robot.height_m}, "actions": report.actions,
        "success_m": SUCCESS_M, "tolerance_m": TOLERANCE_M, "shares": shares,
        "people": None, "paper": PAPER,
        "runs": [run.to_json() for run in report.runs],
    }  # fmt: skip


def _cell(runs: Sequence[NavigationRun]) -> str:
    return f"{automatic_share(runs):.2f} / {strict_share(runs):.2f}"


def _words(errors: str) -> str:
    known = {"none": "maps from exact masks", "precomputed": "maps from the masks of the sequence"}
    return known.get(errors, f"maps from masks with {errors} simulated network errors")


def _robot(report: NavigationReport) -> str:
    driven = "driven exactly" if report.actions == "continuous" else f"driven in steps of {FORWARD_M:g} m and 5 degrees"
    return f"simulated robot, radius {report.robot.radius_m:g} m, {driven}"
