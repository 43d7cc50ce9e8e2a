"""A simulated robot that carries out programs and spoken commands on a map."""

import re
from collections.abc import Callable, Generator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import CommandError, InputError, PlanningError
from simaps_viz.language.commands import Reading, read_command
from simaps_viz.language.interpreter import Budget, BudgetError, Caller, interpret
from simaps_viz.language.primitives import SELF, Primitive
from simaps_viz.language.program import Call, Program, ProgramError, ProgramStuckError, parse_program
from simaps_viz.navigation.planner import Planner, RobotShape
from simaps_viz.navigation.robot import Goal, Motion, Robot
from simaps_viz.structures import Pose2, SIMap

_CALL_ON_ROBOT = re.compile(r"\brobot\s*\.\s*[^\W\d]\w*\s*\(")
_RANK_OF = {"instance": "name", "n": "name", "instance_a": "name_a", "instance_b": "name_b"}
_TURNS = ("turn", "turn_absolute", "face", "with_object_on_left", "with_object_on_right")
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
    goal: Goal | None
    """The goal that the statement drove or turned to; None before it ran and for look-ups."""
    done: bool


@dataclass(frozen=True, eq=False)
class Answer:
    """The outcome of one command on a simulated robot."""

    status: Literal["ok", "refused", "failed"]
    """refused: not understood, not a program, or not on this map; failed: no path there, or a budget used up."""
    reason: str | None
    """In words; None when ok."""
    program: str
    """The program that was run; empty when the command was not understood."""
    goals: tuple[Goal, ...]
    path_m: NDArray
    """float64 [n, 2], map frame: from where the robot was, as far as it came."""
    final_pose: Pose2
    path_length_m: float
    notes: tuple[str, ...] = ()
    """How words were read."""
    alternatives: tuple[str, ...] = ()
    """Other programs the command could mean."""

    def to_json(self) -> dict[str, Any]:
        """Return the line ``simaps query`` prints, as a dict; angles in degrees clockwise from north."""
        pose = self.final_pose
        return {
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


def outcome_text(answer: Answer) -> str:
    """Describe in one sentence where the robot goes and how far, or why it does not."""
    if answer.status != "ok":
        return answer.reason or ""
    names = [f"{g.label} and the {g.other_label}" if g.other_label else g.label for g in answer.goals if g.label]
    parts = [", then ".join(f"to the {name}" for name in dict.fromkeys(names))] if names else []
    pose = answer.final_pose
    parts += [
        f"{answer.path_length_m:.2f} m",
        f"ends at x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, heading {pose.heading_deg % 360:.0f}°",
    ]
    text = ", ".join(parts)
    return f"{text[0].upper()}{text[1:]}."


class Rehearsal:
    """Runs a program on a robot that does not drive, so that a program that must fail is refused before it starts.

    Look-ups depend on the map and on where the command was given, not on where the robot is by then: all but
    ``get_pos("robot")`` are answered for real. So the rehearsal takes the very branches and turns the run will take;
    it finds names, ranks and positions the map lacks, however they were computed, and loops that would not end
    within the budget. Where a program asks for the robot's position after a motion, the rehearsal ends without a
    verdict.

    Args:
        robot: at the place where the program will start; it turns, but does not drive.
        look_up: answers look-ups.
    """

    def __init__(self, robot: Robot, look_up: Caller) -> None:
        self._robot = robot
        self._look_up = look_up
        self._has_moved = False

    def run(self, program: Program, budget: Budget) -> None:
        """Rehearse a program.

        Raises:
            CommandError: naming the line, as the run would.
        """
        with suppress(_WhereaboutsError):
            for _ in interpret(program, self._call, budget=budget):
                self._robot.take_poses()

    def _call(self, primitive: Primitive, arguments: Mapping[str, Any]) -> Any:
        if primitive.kind == "lookup":
            if self._has_moved and arguments.get("name") == SELF:
                raise _WhereaboutsError
            return self._look_up(primitive, arguments)
        if primitive.name in _TURNS:
            return self._robot.call(primitive, arguments)
        self._has_moved = True
        spec = self._robot.simap.spec
        if primitive.name == "move_to" and not spec.contains(*spec.cell_of(*arguments["pos"])):
            return self._robot.call(primitive, arguments)  # which says what the map's edges are
        picked = [
            self._robot.grounding.pick(arguments[name], arguments[which])
            for which, name in _RANK_OF.items()
            if arguments.get(which) is not None
        ]
        if primitive.name == "move_in_between":
            second = picked[1] if len(picked) > 1 else arguments["name_b"]
            self._robot.grounding.pair(picked[0], second)
        return None


class _WhereaboutsError(Exception):
    """A rehearsal does not know where the robot will be."""


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
        self._budget = budget or Budget()
        self._motion = motion
        self.robot = self._new_robot(pose)

    @property
    def pose(self) -> Pose2:
        """Where the robot is now."""
        return self.robot.pose

    def steps(self, program: str) -> Generator[StepEvent, None, None]:
        """Validate all of a program, then return a generator that runs it statement by statement.

        Nothing moves before the first ``next``. Every ``next`` runs up to just before, or just after, the next
        statement, also those inside ``for`` and ``if``; between two calls the program pauses, and waiting costs
        nothing of its budget. ``close`` (or dropping the generator, or starting another program) stops the robot where
        the last statement left it.

        Raises:
            CommandError: at once when the program is invalid, when it names what the map lacks, or when a look-up
                finds nothing or a budget is used up in the rehearsal (see ``Rehearsal``); from the generator when that
                shows only later.
            PlanningError: from the generator.
        """
        parsed = parse_program(program)
        robot = self._new_robot(self.robot.pose)
        _check_names(parsed, robot)
        call = _caching(robot.call)
        Rehearsal(self._new_robot(robot.pose), call).run(parsed, self._budget)
        self.robot = robot
        return self._run(parsed, robot, call)

    def run_program(self, program: str) -> list[StepEvent]:
        """Run a program to its end and return all its events."""
        return list(self.steps(program))

    def _new_robot(self, pose: Pose2) -> Robot:
        budget = self._budget
        return Robot(
            self.simap, self.planner, pose, motion=self._motion,
            max_path_m=budget.path_m, max_planned_cells=budget.planned_cells,
        )  # fmt: skip

    def _run(self, program: Program, robot: Robot, call: Caller) -> Generator[StepEvent, None, None]:
        reported = 0
        for turn in interpret(program, call, budget=self._budget):
            goal = robot.goals[-1] if len(robot.goals) > reported else None
            reported = len(robot.goals)
            yield StepEvent(turn.line, program.lines[turn.line - 1], robot.take_poses(), goal, turn.phase == "after")
            if self.robot is not robot:
                return


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
        command: English, or a program (anything that calls ``robot.``).
        pose: where the command is given.
        robot: the robot's shape.
        program: run this program for the command instead of reading the words.
        reader: reads the words; by default the offline grammar.

    Returns:
        An answer; refusals and failures are answers too. A refused command leaves the robot where it was.
    """
    agent = Agent(simap, pose, robot)
    written = command if program is None and is_program(command) else program
    try:
        reading = Reading(written) if written is not None else reader(command, simap.counts())
    except CommandError as error:
        return _answer(agent, Reading(""), "refused", str(error))
    try:
        for _ in agent.steps(reading.program):
            pass
    except (ProgramError, ProgramStuckError) as error:
        failed = isinstance(error, ProgramStuckError | BudgetError)
        return _answer(
            agent, reading, "failed" if failed else "refused", str(error) if written else error.message, pose
        )
    except CommandError as error:
        return _answer(agent, reading, "refused", str(error), pose)
    except PlanningError as error:
        return _answer(agent, reading, "failed", str(error), pose)
    return _answer(agent, reading, "ok", None)


def is_program(command: str) -> bool:
    """Return whether a command is a program rather than English: it calls something on ``robot``."""
    return command.lstrip().startswith("robot.") or _CALL_ON_ROBOT.search(command) is not None


def planner_of(simap: SIMap, robot: RobotShape) -> Planner:
    """Return the planner of a map and robot, made once and kept as long as the map is."""
    planners = _PLANNERS.setdefault(simap, {})
    if robot not in planners:
        planners[robot] = Planner(simap.grid, robot)
    return planners[robot]


def _answer(
    agent: Agent,
    reading: Reading,
    status: Literal["ok", "refused", "failed"],
    reason: str | None,
    stays_at: Pose2 | None = None,
) -> Answer:
    robot = agent.robot
    stays = status == "refused" and stays_at is not None
    return Answer(
        status=status,
        reason=reason,
        program=reading.program,
        goals=() if stays else tuple(robot.goals),
        path_m=np.array(robot.path_m[:1] if stays else robot.path_m, np.float64),
        final_pose=stays_at if stays and stays_at else robot.pose,
        path_length_m=0.0 if stays else robot.path_length_m,
        notes=reading.notes,
        alternatives=reading.alternatives,
    )


def _caching(call: Caller) -> Caller:
    """Return a caller that looks everything up only once: all but the robot's own position stay the same in a run."""
    known: dict[tuple[Any, ...], Any] = {}

    def cached(primitive: Primitive, arguments: Mapping[str, Any]) -> Any:
        if primitive.kind != "lookup" or arguments.get("name") == SELF:
            return call(primitive, arguments)
        key = (primitive.name, *arguments.values())
        if key not in known:
            known[key] = call(primitive, arguments)
        return known[key]

    return cached


def _check_names(program: Program, robot: Robot) -> None:
    """Refuse, before anything moves, every name and rank written in the program that the map lacks."""
    for call in program.calls:
        try:
            _check_call(call, robot)
        except CommandError as error:
            raise ProgramError(call.line, call.primitive.name, str(error)) from None


def _check_call(call: Call, robot: Robot) -> None:
    for parameter in call.primitive.parameters:
        value = call.constant(parameter.name)
        asks_itself = call.primitive.name == "get_pos" and value == SELF
        if parameter.type in ("label", "object") and isinstance(value, str) and not asks_itself:
            robot.grounding.label_of(value)
        if parameter.type in ("instance", "count") and isinstance(value, int | float):
            of = "other" if call.primitive.name == "closest_to" else _RANK_OF[parameter.name]
            name = call.constant(of)
            if isinstance(name, str) and name != SELF:
                robot.grounding.pick(name, int(value))


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
