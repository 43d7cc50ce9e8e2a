"""The paper's experiment: commands to a robot on maps of several methods, driven and judged in the true world."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.evaluation.evaluate import ERRORS, NOT_SIMULATED, Build, masks_source
from simaps_viz.evaluation.report import TextTable
from simaps_viz.evaluation.scoring import (
    FORWARD_M,
    SUCCESS_M,
    Actions,
    Drive,
    Verdict,
    drive_through,
    judge,
    legs_of,
    true_objects_of,
)
from simaps_viz.evaluation.tasks import FAMILIES, Task, make_tasks
from simaps_viz.evaluation.truth import check_same_frame, find_truth, truth_as_map
from simaps_viz.evaluation.world import TOLERANCE_M, World, observe_world
from simaps_viz.events import Progress
from simaps_viz.navigation.agent import Answer, answer
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import SIMap

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
    _check(methods, errors, seeds, commands)
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


def _check(methods: Sequence[str], errors: Sequence[str], seeds: Sequence[int], commands: int) -> None:
    for what, values in (("methods", methods), ("errors", errors), ("seeds", seeds)):
        if not values or len(set(values)) != len(values):
            raise InputError(f"{what}: expected at least one, each once, found {', '.join(map(str, values)) or 'none'}")
    unknown = [kind for kind in errors if kind not in ERRORS]
    if unknown:
        raise InputError(f"errors: expected some of {', '.join(ERRORS)}, found {', '.join(unknown)}")
    if commands < 1 or min(seeds) < 0:
        raise InputError(f"navigation: expected at least 1 command and seeds from 0, found {commands} and {min(seeds)}")


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
