"""The robot on the page: where it stands, what it was told, how it drives there."""

import contextlib
import functools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import viser

from simaps_viz.drawing.label_layout import Label, boxes_near
from simaps_viz.errors import SIMapsError
from simaps_viz.geometry import STANDS_FROM_M
from simaps_viz.language.grounding import Candidate
from simaps_viz.language.llm_settings import Exchange
from simaps_viz.navigation.agent import Answer, StepEvent, outcome_text
from simaps_viz.navigation.trajectory import Trajectory, TrajectoryPlayer, poses_along, trajectory, trajectory_of_steps
from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.page.services import Services
from simaps_viz.viewer.page.worker import Worker
from simaps_viz.viewer.panels.command import (
    CommandActions,
    CommandPanel,
    Past,
    candidate_labels,
    goal_labels,
    why_text,
)
from simaps_viz.viewer.scene.camera import Follower
from simaps_viz.viewer.scene.map_scene import MapScene


def open_floor(simap: SIMap) -> Pose2:
    """Find where the robot starts when nobody says: the free cell farthest from anything, looking north."""
    height = simap.grid.height_m
    free = (np.nan_to_num(height, nan=9.0) < STANDS_FROM_M) & (simap.instance == 0)
    if not free.any():
        xmin, ymin, xmax, ymax = simap.spec.extent_m
        return Pose2.from_heading((xmin + xmax) / 2.0, (ymin + ymax) / 2.0, 0.0)
    clearance = cv2.distanceTransform(np.pad(free, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    row, col = np.unravel_index(int(clearance.argmax()), clearance.shape)
    return Pose2.from_heading(*simap.spec.centre_of(float(row), float(col)), 0.0)


__all__ = ["RobotControl", "candidate_labels", "goal_labels"]

MOST_PAST = 50
GOAL_M = 0.25
"""What is kept free of texts around the place where the robot will stand."""


@dataclass(frozen=True)
class RobotState:
    """What a page that is loaded again shows of its robot."""

    pose: Pose2
    start: Pose2
    past: tuple[Past, ...]
    said: tuple[str, str, str]
    """As `CommandPanel.said`."""
    speed: float


class RobotControl:
    """Carries commands to the service and shows what came of them. One command at a time; a new one ends the last."""

    def __init__(
        self,
        gui: viser.GuiApi,
        scene: MapScene,
        worker: Worker,
        services: Services,
        *,
        current_map: Callable[[], SIMap],
        start: Pose2 | None,
        follower: Follower | None = None,
        on_use: Callable[[], None] = lambda: None,
    ) -> None:
        """Fill the current container and put the robot on the map.

        Args:
            gui: where the widgets go.
            scene: where the robot stands.
            worker: carries out the commands; of its own, for a language model may let it wait.
            services: what answers.
            current_map: gives the map that is shown.
            start: where the robot stands; None finds open floor.
            follower: a camera that goes along.
            on_use: called when a person is about to move this robot.
        """
        self._scene, self._worker, self._services, self._current_map = scene, worker, services, current_map
        self._follower, self._on_use = follower, on_use
        self._start = start or open_floor(current_map())
        self._pose = self._asked_at = self._start
        self._placing: list[tuple[float, float]] | None = None
        self._answer: Answer | None = None
        self._why: tuple[str, ...] = ()
        self._readings: tuple[str, ...] = ()
        self._ride: Trajectory | None = None
        self._line = 0
        self._past: list[Past] = []
        self._waiting: threading.Event | None = None
        self._drive = TrajectoryPlayer(self._moved, self._arrived, self._held, self._broke_down)
        model = services.model.name if services.model else None
        self._panel = CommandPanel(gui, current_map(), self._actions(), enabled=services.ask is not None, model=model)
        self._stand(self._start)

    @property
    def pose(self) -> Pose2:
        """Where the robot is now."""
        return self._pose

    @property
    def driving(self) -> bool:
        """Whether a ride is under way, paused or not."""
        return self._drive.active

    def ask(self, command: str, held: bool = False) -> None:
        """Have a command carried out from where the robot stands; held: wait before its first line."""
        model = self._services.model if self._panel.uses_model else None
        self._remember(command, "")
        self._submit(command, held=held, reader=model.name if model else "")

    def pause(self) -> None:
        """Hold the ride, or let it go on."""
        self._drive.pause(not self._drive.paused)
        if self._drive.active:
            self._panel.show_phase("held" if self._drive.paused else "driving")

    def step(self) -> None:
        """Run one statement of the program and hold after it."""
        if self._drive.active:
            self._drive.step()
            self._panel.show_phase("driving")

    def stop(self) -> None:
        """End the ride where the robot is, or the wait for an answer."""
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.set()
            self._panel.show_result("Stopped", "The answer is not waited for; the robot stays where it is.", "plain")
        elif self._drive.active:
            self._drive.stop()
            self._panel.show_progress(None)
            self._panel.show_pose(self._pose)
            self._panel.show_result("Stopped", "The robot stands where it was stopped.", "plain", self._why)
        self._panel.show_phase("idle")

    def run_other_reading(self) -> None:
        """Go back to where the command was given, and do what else it could mean; again: what it could mean besides."""
        if self._readings:
            program, *others = self._readings
            before = self._answer.program if self._answer is not None else None
            others += [before] if before else []
            self._submit(program, at=self._asked_at, readings=tuple(others))

    def state(self) -> RobotState:
        """Return where the robot is and what was said; a ride or a wait that is under way ends."""
        if self.driving or self._waiting is not None:
            self.stop()
        return RobotState(self._pose, self._start, tuple(self._past), self._panel.said, self._panel.speed)

    def go_to(self, state: RobotState) -> None:
        """Be as a robot was."""
        self._start, self._past = state.start, list(state.past)
        self._panel.say_again(state.said, state.speed)
        self._set_speed(state.speed)
        self._panel.show_past(self._past)
        self._stand(state.pose)

    def leave(self) -> None:
        """End what is under way and take all this drew off the map; the robot is somebody else's."""
        self._end()
        self._clear()

    def reset(self) -> None:
        """Put the robot back where it started."""
        self._on_use()
        self.leave()
        self._stand(self._start)

    def place(self) -> None:
        """Take the next two clicks for position and heading."""
        self._on_use()
        self._end()
        self._placing = []
        self._panel.show_result("Set start pose", "Click where the robot stands, then click where it looks.", "plain")

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Use a click for the start pose; False when nobody waits for one."""
        placing = self._placing
        if placing is None:
            return False
        placing.append((x_m, y_m))
        if len(placing) == 1:
            self._clear()
            self._stand(Pose2(x_m, y_m, self._pose.yaw_rad))
            self._panel.show_result("Set start pose", "Now click where the robot looks.", "plain")
            return True
        (x0, y0), (x1, y1) = placing[:2]
        self._placing = None
        self._start = Pose2(x0, y0, float(np.arctan2(y1 - y0, x1 - x0)))
        self._stand(self._start)
        self._panel.show_result("Start pose set", "The next command starts here.", "good")
        return True

    def close(self) -> None:
        """End any ride, and any wait."""
        self._end()

    def _actions(self) -> CommandActions:
        return CommandActions(
            ask=self.ask,
            pause=self.pause,
            step=self.step,
            stop=self.stop,
            speed=self._set_speed,
            follow=lambda on: self._follower.switch(on, self._pose) if self._follower is not None else None,
            other_reading=self.run_other_reading,
            reset=self.reset,
            place=self.place,
        )

    def _end(self) -> None:
        """End the ride and the wait for an answer, without a word."""
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.set()
        self._drive.stop()
        self._placing = None
        self._panel.show_phase("idle")

    def _submit(
        self,
        command: str,
        *,
        held: bool = False,
        reader: str = "",
        at: Pose2 | None = None,
        readings: tuple[str, ...] = (),
    ) -> None:
        """Return a command to the worker; ``at``: put the robot there first; ``readings``: what else it could mean."""
        self._on_use()
        self._end()
        self._waiting = cancel = threading.Event()
        self._panel.show_thinking(command, reader)
        self._panel.show_phase("asking")
        job = functools.partial(self._carry_out, command, cancel, held, bool(reader), at, readings)
        self._worker.submit("command", job)

    def _carry_out(
        self,
        command: str,
        cancel: threading.Event,
        held: bool,
        by_model: bool,
        at: Pose2 | None,
        readings: tuple[str, ...],
    ) -> None:
        if cancel.is_set():
            return
        self._clear()
        if at is not None:
            self._stand(at)
        simap, self._asked_at = self._current_map(), self._pose
        try:
            answer = self._answer_to(simap, command, cancel, by_model)
        except SIMapsError as error:
            if not cancel.is_set():
                self._waiting = None
                self._refuse(command, str(error))
            return
        except Exception:
            self._panel.show_phase("idle")
            self._panel.show_result("Failed", "The command met an unexpected error; the robot stays.", "bad")
            raise
        if cancel.is_set():
            return
        self._answer, self._readings = answer, (*answer.alternatives, *readings)
        self._begin(simap, answer, cancel, held)
        if at is None:
            self._remember(command, answer.status)

    def _answer_to(self, simap: SIMap, command: str, cancel: threading.Event, by_model: bool) -> Answer:
        services = self._services
        if by_model and services.model is not None:

            def told(exchanges: Sequence[Exchange]) -> None:
                if self._waiting in (cancel, None):  # not when another command has taken over
                    self._panel.show_exchanges(exchanges)

            return services.model.ask(simap, command, self._pose, cancel, told)
        if services.ask is None:
            raise SIMapsError("commands: expected a service that carries them out, found none")
        return services.ask(simap, command, self._pose)

    def _begin(self, simap: SIMap, answer: Answer, cancel: threading.Event, held: bool) -> None:
        """Show an answer, and start the ride if there is one."""
        labels, self._why = self._explain(simap, answer)
        ride = None if answer.status == "refused" else self._ride_of(simap, answer)
        if cancel.is_set():
            return
        self._panel.show_program(answer.program or "")
        self._panel.show_other_reading(self._readings[0] if self._readings else None)
        self._waiting = None
        if ride is None or (answer.status != "ok" and ride.duration_s == 0.0):
            self._conclude(answer)
            return
        self._ride = ride
        self._panel.show_result("On the way", outcome_text(answer), "plain", (*self._why, *answer.notes))
        self._scene.show_path(answer.path_m)
        end = answer.final_pose
        goal = (end.x_m - GOAL_M, end.y_m - GOAL_M, end.x_m + GOAL_M, end.y_m + GOAL_M)
        self._scene.show_candidates(labels, blocked=(goal, *boxes_near(simap, labels)))
        self._panel.show_progress(0.0)
        self._panel.show_phase("held" if held else "driving")
        self._drive.start(ride, paused=held)

    def _ride_of(self, simap: SIMap, answer: Answer) -> Trajectory:
        """Return the ride, with the lines of the program where the statements are known."""
        if self._services.steps is not None and answer.program:
            steps: list[StepEvent] = []
            with contextlib.suppress(SIMapsError):  # the answer has said it already; the ride ends there
                steps.extend(self._services.steps(simap, answer.program, self._pose))
            if steps:
                return trajectory_of_steps(steps, self._pose)
        if len(answer.path_m) < 2 and answer.status != "ok":
            return trajectory([[self._pose.x_m, self._pose.y_m, self._pose.yaw_rad]])
        return trajectory(poses_along(self._pose, answer.path_m, answer.final_pose))

    def _explain(self, simap: SIMap, answer: Answer) -> tuple[list[Label], tuple[str, ...]]:
        """Number what the command could have meant, and say why it means this one.

        Without that service, or for goals of several classes, the goals are numbered in their order.
        """
        labels = {goal.label for goal in answer.goals if goal.label}
        mixed = any(goal.other_label or not goal.label for goal in answer.goals)
        if self._services.candidates is None or mixed or len(labels) != 1:
            return goal_labels(simap, answer.goals), ()
        candidates: Sequence[Candidate] = self._services.candidates(simap, labels.pop(), self._pose)
        chosen = {goal.instance or 0 for goal in answer.goals}
        return candidate_labels(candidates, chosen), (why_text(answer, candidates),)

    def _moved(self, pose: Pose2, share: float, leg: int) -> None:
        self._pose = pose
        self._scene.show_robot(pose)
        if self._follower is not None:
            self._follower.see(pose)
        self._panel.show_progress(share)
        ride, answer = self._ride, self._answer  # another command may take them away meanwhile
        lines = ride.lines if ride is not None else ()
        line = int(lines[leg]) if leg < len(lines) else 0
        if answer is not None and line != self._line:
            self._line = line
            self._panel.show_program(answer.program or "", line or None)

    def _held(self) -> None:
        self._panel.show_phase("held")

    def _arrived(self) -> None:
        answer = self._answer
        if answer is not None:
            self._stand(answer.final_pose)
            self._conclude(answer)

    def _broke_down(self, fault: Exception) -> None:
        """The ride met an error: say so, where the robot stands."""

        def tell() -> None:
            self._panel.show_phase("idle")
            self._panel.show_progress(None)
            self._panel.show_result("Failed", "The ride met an unexpected error; the robot stays where it is.", "bad")
            raise fault  # the page's notification, and the log

        self._worker.submit("broke down", tell)

    def _conclude(self, answer: Answer) -> None:
        stuck = answer.status != "ok" and self._line > 0
        self._panel.show_program(answer.program or "", self._line if stuck else None, stuck=stuck)
        self._panel.show_progress(None)
        self._panel.show_phase("idle")
        title, tone = {"ok": ("Done", "good"), "refused": ("Refused", "bad")}.get(answer.status, ("Failed", "bad"))
        self._panel.show_result(title, outcome_text(answer), tone, (*self._why, *answer.notes))

    def _refuse(self, command: str, reason: str) -> None:
        self._panel.show_phase("idle")
        self._panel.show_result("Refused", reason, "bad")
        self._remember(command, "refused")

    def _remember(self, command: str, status: str) -> None:
        """Put a command in front of the history."""
        self._past = [Past(command, status), *(past for past in self._past if past.command != command)][:MOST_PAST]
        self._panel.show_past(self._past)

    def _set_speed(self, speed: float) -> None:
        self._drive.speed = speed

    def _stand(self, pose: Pose2) -> None:
        self._pose = pose
        self._scene.show_robot(pose)
        self._panel.show_pose(pose)
        if self._follower is not None:
            self._follower.see(pose, rests=True)

    def _clear(self) -> None:
        self._answer, self._line, self._ride, self._why, self._readings = None, 0, None, (), ()
        self._scene.show_path(np.zeros((0, 2)))
        self._scene.show_candidates(())
        self._panel.show_program("")
        self._panel.show_other_reading(None)
        self._panel.show_exchanges(())
        self._panel.show_progress(None)
