"""The robot on the page: where it stands, what it was told, how it drives there."""

import contextlib
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import cv2
import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.errors import SIMapsError
from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.command_panel import CommandActions, CommandPanel
from simaps_viz.viewer.drive import Drive, poses_along, trajectory
from simaps_viz.viewer.scene import MapScene
from simaps_viz.viewer.services import AnswerLike, CandidateLike, Services, StepLike
from simaps_viz.viewer.worker import Worker

FLOOR_HEIGHT_M = 0.10


class RobotControl:
    """Carries commands to the service and shows what came of them. One command at a time."""

    def __init__(
        self,
        gui: viser.GuiApi,
        scene: MapScene,
        worker: Worker,
        services: Services,
        *,
        current_map: Callable[[], SIMap],
        start: Pose2 | None,
    ) -> None:
        """Fill the current container and put the robot on the map."""
        self._scene, self._worker, self._services, self._current_map = scene, worker, services, current_map
        self._start = start or open_floor(current_map())
        self._pose = self._start
        self._placing: list[tuple[float, float]] | None = None
        self._answer: AnswerLike | None = None
        self._lines = np.zeros(1, np.int64)
        self._line = 0
        self._drive = Drive(self._moved, self._arrived)
        actions = CommandActions(
            ask=self.ask,
            pause=self.pause,
            stop=self.stop,
            speed=self._set_speed,
            reset=self.reset,
            place=self.place,
        )
        self._panel = CommandPanel(gui, current_map(), actions, enabled=services.ask is not None)
        self._stand(self._start)

    @property
    def pose(self) -> Pose2:
        """Where the robot is now."""
        return self._pose

    @property
    def driving(self) -> bool:
        """Whether a ride is under way, paused or not."""
        return self._drive.active

    def ask(self, command: str) -> None:
        """Have a command carried out from where the robot stands."""
        self._panel.show_thinking(command)
        self._worker.submit("command", lambda: self._carry_out(command))

    def pause(self) -> None:
        """Hold the ride, or let it go on."""
        self._drive.pause(not self._drive.paused)

    def stop(self) -> None:
        """End the ride where the robot is."""
        if self._drive.active:
            self._drive.stop()
            self._panel.show_progress(None)
            self._panel.show_result("Stopped", "The robot stands where it was stopped.", "plain")

    def reset(self) -> None:
        """Put the robot back where it started."""
        self._drive.stop()
        self._clear()
        self._stand(self._start)

    def place(self) -> None:
        """Take the next two clicks for position and heading."""
        self._drive.stop()
        self._placing = []
        self._panel.show_result("Set start pose", "Click where the robot stands, then click where it looks.", "plain")

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Use a click for the start pose; False when nobody waits for one."""
        if self._placing is None:
            return False
        self._placing.append((x_m, y_m))
        if len(self._placing) == 1:
            self._clear()
            self._stand(Pose2(x_m, y_m, self._pose.yaw_rad))
            self._panel.show_result("Set start pose", "Now click where the robot looks.", "plain")
            return True
        (x0, y0), (x1, y1) = self._placing
        self._placing = None
        self._start = Pose2(x0, y0, float(np.arctan2(y1 - y0, x1 - x0)))
        self._stand(self._start)
        self._panel.show_result("Start pose set", "The next command starts here.", "good")
        return True

    def close(self) -> None:
        """End any ride."""
        self._drive.stop()

    def _carry_out(self, command: str) -> None:
        if self._services.ask is None:
            return
        self._drive.stop()
        self._placing = None
        self._clear()
        try:
            answer = self._services.ask(self._current_map(), command, self._pose)
        except SIMapsError as error:
            self._panel.show_result("Refused", str(error), "bad")
            return
        self._panel.show_program(answer.program or "")
        self._answer = answer
        if answer.status != "ok" and len(answer.path_m) < 2:
            self._conclude(answer)
            return
        self._panel.show_result("On the way", result_text(answer), "plain")
        self._scene.show_path(answer.path_m)
        self._scene.show_candidates(self._numbered(answer))
        self._panel.show_progress(0.0)
        poses, self._lines = self._ride(answer)
        self._drive.start(trajectory(poses))

    def _ride(self, answer: AnswerLike) -> tuple[NDArray, NDArray]:
        """Give the poses [n, 3] of the ride and the line of the program that each belongs to, [n]; 0 = unknown."""
        if self._services.steps is not None and answer.program:
            steps = []
            with contextlib.suppress(SIMapsError):  # the answer has said it already; the ride ends there
                steps.extend(self._services.steps(self._current_map(), answer.program, self._pose))
            poses, lines = poses_of_steps(steps)
            if len(poses):
                return poses, lines
        poses = poses_along(self._pose, answer.path_m, answer.final_pose)
        return poses, np.zeros(len(poses), np.int64)

    def _numbered(self, answer: AnswerLike) -> list[tuple[str, float, float]]:
        """Number what the command could have meant; without that service, or for several goals, the goals."""
        labels = {_field(goal, "label") for goal in answer.goals}
        if self._services.candidates is None or len(labels) != 1 or None in labels:
            return goal_labels(self._current_map(), answer.goals)
        chosen = {int(_field(goal, "instance") or 0) for goal in answer.goals}
        return candidate_labels(self._services.candidates(self._current_map(), labels.pop(), self._pose), chosen)

    def _moved(self, pose: Pose2, share: float, leg: int) -> None:
        self._pose = pose
        self._scene.show_robot(pose)
        self._panel.show_progress(share)
        line = int(self._lines[leg])
        if self._answer is not None and line != self._line:
            self._line = line
            self._panel.show_program(self._answer.program or "", line or None)

    def _arrived(self) -> None:
        if self._answer is not None:
            self._stand(self._answer.final_pose)
            self._panel.show_progress(None)
            self._conclude(self._answer)

    def _conclude(self, answer: AnswerLike) -> None:
        self._panel.show_program(answer.program or "")
        title, tone = {"ok": ("Done", "good"), "refused": ("Refused", "bad")}.get(answer.status, ("Failed", "bad"))
        self._panel.show_result(title, result_text(answer), tone)

    def _set_speed(self, speed: float) -> None:
        self._drive.speed = speed

    def _stand(self, pose: Pose2) -> None:
        self._pose = pose
        self._scene.show_robot(pose)
        self._panel.show_pose(pose)

    def _clear(self) -> None:
        self._answer, self._line = None, 0
        self._scene.show_path(np.zeros((0, 2)))
        self._scene.show_candidates(())
        self._panel.show_program("")
        self._panel.show_progress(None)


def poses_of_steps(steps: Sequence[StepLike]) -> tuple[NDArray, NDArray]:
    """Join what statements drove: poses float64 [n, 3] and the line of each, int64 [n]."""
    driven = [(np.asarray(step.poses, np.float64).reshape(-1, 3), step.line) for step in steps]
    poses = np.concatenate([np.zeros((0, 3)), *(poses for poses, _ in driven)])
    lines = np.concatenate([np.zeros(0, np.int64), *(np.full(len(poses), line) for poses, line in driven)])
    return poses, lines.astype(np.int64)


def result_text(answer: AnswerLike) -> str:
    """Say why not, or where the robot goes and how far, and how the words were read."""
    if answer.status != "ok":
        return " ".join([str(answer.reason or ""), *answer.notes])
    names = [str(_field(goal, "label")) for goal in answer.goals if _field(goal, "label")]
    parts = [", then ".join(f"to the {name}" for name in dict.fromkeys(names))] if names else []
    pose = answer.final_pose
    parts += [
        f"{answer.path_length_m:.2f} m",
        f"ends at x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, heading {pose.heading_deg % 360:.0f}°",
    ]
    text = ", ".join(parts)
    return " ".join([f"{text[0].upper()}{text[1:]}.", *answer.notes])


def goal_labels(simap: SIMap, goals: Sequence[Any]) -> list[tuple[str, float, float]]:
    """Number the objects the robot was sent to, in order: (text, x, y) of each that is on the map."""
    places: dict[int, list[str]] = {}
    for number, goal in enumerate(goals, start=1):
        if _field(goal, "instance"):
            places.setdefault(int(_field(goal, "instance")), []).append(str(number))
    known = {instance.id: instance.centroid_m for instance in simap.instances}
    return [(", ".join(texts), *known[i][:2]) for i, texts in places.items() if i in known]


def candidate_labels(
    candidates: Sequence[CandidateLike], chosen: Collection[int], most: int = 12
) -> list[tuple[str, float, float]]:
    """Number the closest candidates and the chosen ones: "3 · 2.6 m", the chosen marked; each with its (x, y)."""
    texts = []
    for candidate in candidates:
        mine = candidate.instance.id in chosen
        if mine or candidate.rank <= most:
            text = f"{'▶ ' if mine else ''}{candidate.rank} · {candidate.distance_m:.1f} m"
            texts.append((text, *candidate.instance.centroid_m[:2]))
    return texts


def open_floor(simap: SIMap) -> Pose2:
    """Find where the robot starts when nobody says: the free cell farthest from anything, looking north."""
    height = simap.grid.height_m
    free = (np.nan_to_num(height, nan=9.0) < FLOOR_HEIGHT_M) & (simap.instance == 0)
    if not free.any():
        xmin, ymin, xmax, ymax = simap.spec.extent_m
        return Pose2.from_heading((xmin + xmax) / 2.0, (ymin + ymax) / 2.0, 0.0)
    clearance = cv2.distanceTransform(np.pad(free, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    row, col = np.unravel_index(int(clearance.argmax()), clearance.shape)
    return Pose2.from_heading(*simap.spec.centre_of(float(row), float(col)), 0.0)


def _field(goal: Any, name: str) -> Any:
    return goal.get(name) if isinstance(goal, Mapping) else getattr(goal, name, None)
