"""A simulated robot that carries out programs and spoken commands on a map."""

import re
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import plural
from simaps_viz.errors import CommandError, InputError, PlanningError
from simaps_viz.language.commands import MAX_SUGGESTIONS, Reading, instead, read_command
from simaps_viz.language.grounding import Grounding
from simaps_viz.language.interpreter import Budget, BudgetError, interpret
from simaps_viz.language.primitives import FUNCTIONS
from simaps_viz.language.program import ProgramError, ProgramStuckError, parse_program
from simaps_viz.navigation.planner import Planner, RobotShape
from simaps_viz.navigation.robot import Goal, Motion, Robot
from simaps_viz.structures import Instance, Pose2, SIMap

_CALL = re.compile(rf"\brobot\s*\.\s*[^\W\d]\w*\s*\(|\b(?:{'|'.join(FUNCTIONS)})\(")
_BY_NAME = re.compile(r'robot\.(?!move_to_nth_closest|get_|in_view|instances)\w+\("([^"]+)"\)')
"""A line that moves by the name of a thing alone."""
_MAX_TRIED = 8
_PLANNERS: WeakKeyDictionary[SIMap, dict[RobotShape, Planner]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class StepEvent:
    """The agent is about to run (``done`` False) or has run (``done`` True) one statement."""

    line: int
    """Counted from 1."""
    text: str
    """The line, without its indent."""
    poses: NDArray
    """float64 [n, 3], (x, y, yaw) every ``Motion.dt_s``, map frame: the poses driven by the statement; empty before it
    ran."""
    pose: Pose2
    """Where the robot is then."""
    goal: Goal | None
    """The goal that the statement drove or turned to; None before it ran and for look-ups."""
    done: bool


@dataclass(frozen=True, eq=False)
class Answer:
    """The outcome of one command on a simulated robot."""

    status: Literal["ok", "refused", "failed"]
    """refused: not understood, not a program, or not on this map; failed: no path there, or a budget used up. Either is
    known before the robot moves, so it stays where it is."""
    reason: str | None
    """In words; None when ok."""
    program: str
    """The program that was run; empty when the command was not understood."""
    goals: tuple[Goal, ...]
    path_m: NDArray
    """float64 [n, 2], map frame; the first point is where the robot was."""
    final_pose: Pose2
    path_length_m: float
    notes: tuple[str, ...] = ()
    """How words were read."""
    alternatives: tuple[str, ...] = ()
    """Other programs the command could mean."""
    answer: Mapping[str, Any] | None = None
    """The answer to a question: ``text``, a sentence; ``value``, a number, truth value, name or None, of several
    questions a list; ``instances``, the ids of what it speaks of. None for a command that asks nothing."""
    steps: tuple[StepEvent, ...] = ()
    """The statements that were run, in order; empty unless ok."""
    line: int | None = None
    """The line of the program, counted from 1, that cannot be carried out; None when ok or when no line is to blame."""
    suggestions: tuple[str, ...] = ()
    """Commands that can be given instead of one that was refused or failed, or that go to the nearer thing that was
    passed over as doubtful; the likeliest first, at most three."""
    stuck_at: Pose2 | None = None
    """Where the robot would be when that line cannot be carried out; None when ok or when no line is to blame."""
    anchors: tuple[int, ...] = ()
    """Ids of the single objects that others were looked for by: of "the chair by the oven" the oven."""

    def to_json(self) -> dict[str, Any]:
        """Return the line ``simaps query`` prints, as a dict; angles in degrees clockwise from north."""
        pose = self.final_pose
        line = {
            "status": self.status,
            "reason": self.reason,
            "program": self.program,
            "goals": [goal.to_json() for goal in self.goals],
            "path": [[round(float(v), 6) for v in point] for point in self.path_m],
            "final_pose": [round(pose.x_m, 6), round(pose.y_m, 6), round(pose.heading_deg, 6) % 360.0],
            "path_length_m": round(self.path_length_m, 6),
            "notes": list(self.notes),
            "alternatives": list(self.alternatives),
        }
        if self.suggestions:
            line["suggestions"] = list(self.suggestions)
        return line if self.answer is None else {**line, "answer": dict(self.answer)}


def outcome_text(answer: Answer) -> str:
    """Answer a question, or describe in one sentence where the robot goes and how far, or why it does not."""
    if answer.status != "ok":
        return (answer.reason or "")[:1].upper() + (answer.reason or "")[1:]
    said = str(answer.answer["text"]) if answer.answer else ""
    if said and not answer.goals and answer.path_length_m == 0.0:
        return said
    pose, start = answer.final_pose, answer.path_m[0]
    stops = [
        _several(words, tuple(goals)) for words, goals in groupby(answer.goals, lambda goal: _goal_words(goal, start))
    ]
    parts = [", then ".join(filter(None, stops))] if any(stops) else []
    heading = f"heading {round(pose.heading_deg) % 360}° ({pose.looks})"
    at = f"at x {pose.x_m:.2f} m, y {pose.y_m:.2f} m"
    if answer.path_length_m > 0.0:
        parts += [f"a path of {answer.path_length_m:.2f} m that ends {at}", heading]
    else:
        arrives = answer.goals and all(goal.primitive.startswith("move") for goal in answer.goals)
        parts += [f"{'where the robot is already' if arrives else 'without driving'}, {at}", f"{heading} in the end"]
    text = ", ".join(parts)
    return f"{said} {text[0].upper()}{text[1:]}.".lstrip()


_GOAL_WORDS = {
    "move_to": "to a place by {}",
    "face": "facing {}",
    "with_object_on_left": "turned so that {} is on the left",
    "with_object_on_right": "turned so that {} is on the right",
    "move_to_left": "to the left of {}, as seen from the robot",
    "move_to_right": "to the right of {}, as seen from the robot",
    "move_north": "to the north of {}",
    "move_south": "to the south of {}",
    "move_east": "to the east of {}",
    "move_west": "to the west of {}",
    "move_in_between": "between {}",
}
"""What a goal of a primitive is, of the thing that it is about; of the others, "to {}"."""
_BACK_M = 0.6
"""A stop no farther from where the command was given is back there: the robot may have stood where nothing is free."""


def _goal_words(goal: Goal, start: NDArray) -> str:
    """Describe a goal: "to the chair", "between the couch and the table"; empty for a place without a name."""
    if goal.label is None:
        back = goal.primitive == "move_to" and np.hypot(*(np.array(goal.point_m) - start)) < _BACK_M
        return "back to where it started" if back else ""
    name = f"the {goal.words or goal.label}"
    if goal.other_label:
        name = f"the {goal.label} and the {goal.other_label}"
        if goal.label == goal.other_label:
            name = f"{goal.label} {goal.instance} and {goal.other_label} {goal.other_instance}"
    sees = ", as seen from the robot" if re.search(r"\b(left|right) of\b", goal.words) else ""
    return _GOAL_WORDS.get(goal.primitive, "to {}").format(name) + sees


def _several(words: str, goals: Sequence[Goal]) -> str:
    """Return the words of goals that follow one another, which all have the same."""
    if goals[0].primitive == "move_to" and goals[0].label and len(goals) > 2:
        return f"around the {goals[0].label}"
    things, label = {goal.instance for goal in goals}, goals[0].label
    return words.replace(f"the {label}", plural(len(things), label)) if label and len(things) > 1 else words


@dataclass(frozen=True, eq=False)
class Run:
    """A program that was run to its end."""

    steps: tuple[StepEvent, ...]
    robot: Robot
    """As it is in the end: its pose, goals and path, and the answer to a question."""


class Agent:
    """Runs programs one after the other, each from where the last one ended.

    Args:
        simap: the map.
        pose: where the robot is.
        robot: its shape.
        budget: what one program may use.
        motion: speeds and sampling of the drive.
    """

    def __init__(
        self,
        simap: SIMap,
        pose: Pose2,
        robot: RobotShape | None = None,
        *,
        budget: Budget | None = None,
        motion: Motion | None = None,
    ) -> None:
        self.simap = simap
        self.planner = planner_of(simap, robot or RobotShape())
        self.pose = pose
        self._budget = budget or Budget()
        self._motion = motion
        self._playing: Run | None = None

    def rehearse(self, program: str) -> Run:
        """Run a program to its end on a robot that starts where this one is; this one does not move.

        The robot is simulated and does exactly what it plans, so this is what the program does, to the last pose.

        Raises:
            CommandError: the program is invalid or asks for what the map lacks; names the line.
            PlanningError: the robot cannot get where a line sends it.
            BudgetError: a budget is used up.
        """
        parsed, budget = parse_program(program), self._budget
        robot = Robot(
            self.simap, self.planner, self.pose, motion=self._motion,
            max_path_m=budget.path_m, max_planned_cells=budget.planned_cells,
        )  # fmt: skip
        steps, reported = [], 0
        try:
            for turn in interpret(parsed, robot.call, budget=budget):
                goal = robot.goals[-1] if len(robot.goals) > reported else None
                reported = len(robot.goals)
                text, done = parsed.lines[turn.line - 1], turn.phase == "after"
                steps.append(StepEvent(turn.line, text, robot.take_poses(), robot.pose, goal, done))
        except (ProgramError, ProgramStuckError) as error:
            error.pose = robot.pose
            raise
        return Run(tuple(steps), robot)

    def steps(self, program: str) -> Generator[StepEvent, None, None]:
        """Rehearse a program, then return a generator that moves the robot statement by statement.

        Nothing moves before the first ``next``. Every ``next`` runs up to just before, or just after, the next
        statement, also those inside ``for`` and ``if``. ``close`` (or dropping the generator, or starting another
        program) stops the robot where the last statement left it.

        Raises:
            CommandError, PlanningError: at once, see ``rehearse``: what cannot be done to its end is not begun.
        """
        run = self._playing = self.rehearse(program)
        return self._play(run)

    def run_program(self, program: str) -> Run:
        """Run a program to its end; the robot is there then."""
        run = self._playing = self.rehearse(program)
        self.pose = run.robot.pose
        return run

    def _play(self, run: Run) -> Generator[StepEvent, None, None]:
        for step in run.steps:
            if self._playing is not run:
                return
            self.pose = step.pose
            yield step


CommandReader = Callable[[str, Mapping[str, int]], Reading]
"""Reads a command on a map with {class: number of instances}; raises CommandError when it does not understand it."""


def answer(
    simap: SIMap,
    command: str,
    pose: Pose2,
    *,
    robot: RobotShape | None = None,
    program: str | None = None,
    reader: CommandReader = read_command,
) -> Answer:
    """Carry out one spoken command, or one program, in simulation.

    Args:
        simap: the map.
        command: English, or a program (anything that calls ``robot.`` or a function).
        pose: where the command is given.
        robot: the robot's shape.
        program: run this program for the command instead of reading the words.
        reader: reads the words; by default the offline grammar.

    Returns:
        An answer; refusals and failures are answers too, and leave the robot where it was.

    Raises:
        InputError: the pose is not finite.
    """
    if not np.isfinite([pose.x_m, pose.y_m, pose.yaw_rad]).all():
        raise InputError(f"pose: expected three finite numbers, found {pose.x_m}, {pose.y_m}, {pose.yaw_rad}")
    written = command if program is None and is_program(command) else program
    reading = Reading(written or "")
    agent, certain = Agent(simap, pose, robot), ()
    try:
        if written is None:
            reading = reader(command, simap.counts(hidden=True))
            reading, certain = _certain(agent, reading)
        run = agent.rehearse(reading.program)
    except (CommandError, PlanningError) as error:
        failed = isinstance(error, PlanningError | BudgetError)
        located = error if isinstance(error, ProgramError | ProgramStuckError) else None
        reason = located.message if located and written is None else str(error)
        suggested = instead(command, simap.counts(hidden=True)) if written is None else ()
        if failed and located and written is None:
            suggested = _reachable(agent, reading.program, located) or suggested
        return Answer(
            "failed" if failed else "refused", reason, reading.program, (), np.array([[pose.x_m, pose.y_m]]), pose, 0.0,
            reading.notes, reading.alternatives, line=located.line if located else None,
            suggestions=getattr(error, "suggestions", ()) or suggested, stuck_at=located.pose if located else None,
        )  # fmt: skip
    end = run.robot
    return Answer(
        "ok", None, reading.program, tuple(end.goals), np.array(end.path_m, np.float64), end.pose, end.path_length_m,
        (*reading.notes, *end.grounding.notes), reading.alternatives, end.answer, run.steps,
        suggestions=certain, anchors=tuple(end.grounding.anchors),
    )  # fmt: skip


def _certain(agent: Agent, reading: Reading) -> tuple[Reading, tuple[str, ...]]:
    """Return a reading that takes the nearest certain thing for a mere name whose nearest is doubtful, if it can.

    Its program says so by the rank: ``robot.move_to_object("oven", 2)``. With it come commands for the nearest ones.
    """
    program, doubtful, settled = reading.program, agent.simap.doubtful, set[int]()
    notes, passed = dict[str, None](), dict[int, Instance]()
    while doubtful and any(map(_BY_NAME.fullmatch, program.splitlines())):  # else there is nothing to rehearse for
        begun, stuck = _begun(agent, program)
        lines = program.splitlines()
        for line, pose in begun:
            named = [] if line in settled else _by_name(agent.simap, lines[line - 1], pose)
            rank = next((rank for rank, one in enumerate(named, start=1) if one.id not in doubtful), 0)
            if rank > 1:
                break
        else:
            break
        settled.add(line)
        lines[line - 1] = f"{lines[line - 1][:-1]}, {rank})"
        certain, nearest, taken = "\n".join(lines), named[0], named[rank - 1].name
        seen = f"doubtful, seen in {plural(nearest.frames, 'frame')} of {len(agent.simap.frame_names)}"
        if line == _begun(agent, certain)[1] != stuck:
            notes[f"{nearest.name.capitalize()} is {seen}; {taken}, which is certain, cannot be reached."] = None
            continue
        program = certain
        notes[f"{nearest.name.capitalize()} is nearer, but {seen}: {taken} is taken."] = None
        passed[nearest.id] = nearest
    return replace(reading, program=program, notes=(*reading.notes, *notes)), _commands_to(agent, passed.values())


def _begun(agent: Agent, program: str) -> tuple[list[tuple[int, Pose2]], int]:
    """Return each line that a program begins, with where the robot is then, and the line that it is stuck at, or 0."""
    try:
        return [(step.line, step.pose) for step in agent.rehearse(program).steps if not step.done], 0
    except (ProgramError, ProgramStuckError) as error:
        return [(error.line, error.pose or agent.pose)], error.line


def _by_name(simap: SIMap, line: str, pose: Pose2) -> list[Instance]:
    """Return the things, the closest first, of which a line of a program takes the closest by its mere name."""
    name = _BY_NAME.fullmatch(line)
    with suppress(CommandError):  # a room
        return list(Grounding(simap, pose).instances(name[1])) if name else []
    return []


def _reachable(agent: Agent, program: str, stuck: ProgramError | ProgramStuckError) -> tuple[str, ...]:
    """Return commands that go to others of that name, the nearest first, where the one meant is out of reach."""
    one_line = re.sub(r", \d+\)$", ")", program)
    if not one_line.startswith("robot.move_to_object("):
        return ()
    return _commands_to(agent, _by_name(agent.simap, one_line, stuck.pose or agent.pose)[:_MAX_TRIED])


def _commands_to(agent: Agent, things: Iterable[Instance]) -> tuple[str, ...]:
    """Return the commands that go to things, as far as these can be reached; the first few of them."""
    found = []
    for one in things:
        with suppress(CommandError, PlanningError):
            agent.rehearse(f'robot.move_to_object(called(things("{one.label}"), {one.id}))')
            found.append(f"go to {one.name}")
    return tuple(found[:MAX_SUGGESTIONS])


def is_program(command: str) -> bool:
    """Return whether a command is a program rather than English: it calls something on ``robot``, or a function."""
    return command.lstrip().startswith("robot.") or _CALL.search(command) is not None


def planner_of(simap: SIMap, robot: RobotShape) -> Planner:
    """Return the planner of a map and robot, made once and kept as long as the map is."""
    planners = _PLANNERS.setdefault(simap, {})
    if robot not in planners:
        planners[robot] = Planner(simap.grid, robot)
    return planners[robot]


def start_pose(simap: SIMap, robot: RobotShape | None = None) -> Pose2:
    """Return where the robot starts: at the first camera with free floor by it, in its direction.

    A person who scans by hand seldom sees the floor below at first. Where no camera has free floor, it is the first.

    Raises:
        InputError: the map has no camera.
    """
    if len(simap.T_map_camera) == 0:
        raise InputError("start pose: expected a map with at least one camera, found none")
    planner = planner_of(simap, robot or RobotShape())
    poses = [_pose_on_floor(T) for T in simap.T_map_camera[:: max(1, len(simap.T_map_camera) // 200)]]
    for pose in poses:
        with suppress(PlanningError):
            planner.start_cell(pose.x_m, pose.y_m)
            return pose
    return poses[0]


def _pose_on_floor(T_map_camera: NDArray) -> Pose2:
    x, y = T_map_camera[:2, 3].tolist()
    return Pose2(x, y, float(np.arctan2(T_map_camera[1, 2], T_map_camera[0, 2])))
