"""Timed trajectories: from poses, paths or the statements of a program; and a thread that plays one in real time."""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.geometry import wrap_angle
from simaps_viz.navigation.agent import StepEvent
from simaps_viz.navigation.robot import Motion
from simaps_viz.structures import Pose2

MOTION = Motion()
"""The robot's speeds, the same as in `simaps export --trajectory`."""
SPEED_HINT = f"Speed of the simulated robot; 1 is {MOTION.speed_mps:g} m/s."
TICK_S = 0.05
LOOK_S = 0.3
"""How long a statement that drives nowhere is shown at normal speed."""
ALL_LOOKS_S = 3.0
"""How long all of these together may take."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses and when the robot is at each."""

    poses: NDArray
    """float64 [n, 3], x, y (metres), yaw (radians), map frame; n >= 1."""
    times_s: NDArray
    """float64 [n], from 0, never falling."""
    steps_s: NDArray = field(default_factory=lambda: np.zeros(0))
    """float64 [k], when each statement of the program begins, rising."""
    lines: NDArray = field(default_factory=lambda: np.zeros(1, np.int64))
    """int64 [n], the line of the program that drives on from each pose, counted from 1; 0 or too short: unknown."""

    @property
    def duration_s(self) -> float:
        """How long it takes at normal speed, seconds."""
        return float(self.times_s[-1])

    def segment_at(self, time_s: float) -> int:
        """Return the index of the last pose that was passed by a time."""
        return int(np.clip(np.searchsorted(self.times_s, time_s, side="right") - 1, 0, len(self.times_s) - 1))

    def next_step(self, time_s: float) -> float | None:
        """Return when the next statement begins; None when there is none."""
        later = self.steps_s[self.steps_s > time_s + 1e-9]
        return float(later[0]) if len(later) and later[0] < self.duration_s - 1e-9 else None

    def at(self, time_s: float) -> Pose2:
        """Return the pose at a time; before the start and after the end the robot is at rest."""
        i = self.segment_at(time_s)
        if i == len(self.times_s) - 1 or time_s <= 0.0:
            return Pose2(*(float(v) for v in self.poses[i]))
        share = (time_s - self.times_s[i]) / (self.times_s[i + 1] - self.times_s[i])
        a, b = self.poses[i], self.poses[i + 1]
        x, y = a[:2] + share * (b[:2] - a[:2])
        return Pose2(float(x), float(y), wrap_angle(a[2] + share * wrap_angle(b[2] - a[2])))


def trajectory(poses: ArrayLike) -> Trajectory:
    """Time poses [n, 3] (x, y, yaw) so that the robot neither drives nor turns faster than it may."""
    array = np.asarray(poses, np.float64).reshape(-1, 3)
    steps = np.diff(array, axis=0)
    turn = np.abs((steps[:, 2] + np.pi) % (2.0 * np.pi) - np.pi)
    seconds = np.maximum(np.hypot(steps[:, 0], steps[:, 1]) / MOTION.speed_mps, turn / MOTION.turn_rate_rps)
    return Trajectory(array, np.concatenate([[0.0], np.cumsum(seconds)]))


def poses_along(start: Pose2, path: ArrayLike, final: Pose2) -> NDArray:
    """Poses [n, 3] for a path [m, 2]: turn on the spot towards each next point, drive there, end as ``final``."""
    poses = [[start.x_m, start.y_m, start.yaw_rad]]
    for x, y in np.asarray(path, np.float64).reshape(-1, 2):
        dx, dy = x - poses[-1][0], y - poses[-1][1]
        if np.hypot(dx, dy) > 1e-6:
            yaw = float(np.arctan2(dy, dx))
            poses += [[poses[-1][0], poses[-1][1], yaw], [float(x), float(y), yaw]]
    poses += [[final.x_m, final.y_m, poses[-1][2]], [final.x_m, final.y_m, final.yaw_rad]]
    return np.array(poses)


def trajectory_of_steps(steps: Sequence[StepEvent], start: Pose2) -> Trajectory:
    """Assign times to the poses of a program.

    A statement without motion takes a short time, so that its line is seen to run.

    Args:
        steps: one or two events a statement: before it runs (``done`` False, no poses) and after.
        start: where the robot is.
    """
    rows, lines, looks, begins = [[start.x_m, start.y_m, start.yaw_rad]], [0], [], []
    for line, poses in _statements(steps):
        begins.append(len(rows))
        driven = [[*map(float, pose)] for pose in poses]
        if not driven:
            looks.append(len(rows))
            driven = [rows[-1]]
        rows += [rows[-1], *driven]
        lines += [line] * (1 + len(driven))
    timed = trajectory(rows)
    wait = np.zeros(len(rows))
    wait[np.array(looks, np.int64) + 1] = min(LOOK_S, ALL_LOOKS_S / max(len(looks), 1))
    times = timed.times_s + np.cumsum(wait)
    return Trajectory(timed.poses, times, times[np.array(begins, np.int64)], np.array(lines, np.int64))


def _statements(steps: Sequence[StepEvent]) -> list[tuple[int, NDArray]]:
    """Return the line and the poses [n, 3] of each statement; one that ends after its block is listed at its start."""
    found: list[tuple[int, NDArray]] = []
    open_line: int | None = None
    for step in steps:
        poses = np.asarray(step.poses, np.float64).reshape(-1, 3)
        if not step.done:
            found.append((step.line, poses))
            open_line = step.line
        elif open_line == step.line:
            found[-1] = (step.line, poses)
            open_line = None
        elif len(poses):
            found.append((step.line, poses))
    return found


class TrajectoryPlayer:
    """Plays a trajectory in real time, all at once or statement by statement."""

    def __init__(
        self,
        on_pose: Callable[[Pose2, float, int], None],
        on_end: Callable[[], None],
        on_pause: Callable[[], None] = lambda: None,
        on_error: Callable[[Exception], None] | None = None,
    ) -> None:
        """Create a player at rest. No callback is called once ``stop`` has returned.

        Args:
            on_pose: takes the pose, the share of the trajectory that is over, and the index of the pose passed last.
            on_end: called when the trajectory has ended by itself.
            on_pause: called when a step is over and the trajectory waits.
            on_error: called with an error raised by another callback, which ends the trajectory; None: the thread
                raises it.
        """
        self._on_pose, self._on_end, self._on_pause = on_pose, on_end, on_pause
        self._on_error = on_error
        self.speed = 1.0
        """Factor on the normal speed; may change while the robot drives."""
        self._running = threading.Event()
        self._lock = threading.RLock()
        self._trajectory: Trajectory | None = None
        self._elapsed = 0.0
        self._until: float | None = None

    @property
    def active(self) -> bool:
        """Whether a trajectory has begun and not ended, paused or not."""
        return self._trajectory is not None

    @property
    def paused(self) -> bool:
        """Whether a trajectory is paused."""
        return self.active and not self._running.is_set()

    def start(self, trajectory: Trajectory, *, paused: bool = False) -> None:
        """Begin a trajectory, or pause it before its first statement; one that is being played ends where it is."""
        with self._lock:
            self._running.set()  # wakes the thread of an earlier trajectory, which then ends
            self._trajectory, self._elapsed, self._until = trajectory, 0.0, None
            if paused:
                self._running.clear()
        threading.Thread(target=self._run, args=(trajectory,), name="workbench-drive", daemon=True).start()

    def pause(self, paused: bool) -> None:
        """Pause or resume the trajectory."""
        with self._lock:
            self._until = None
            if paused:
                self._running.clear()
            else:
                self._running.set()

    def step(self) -> None:
        """Play to the end of the current statement, and pause there."""
        with self._lock:
            if self._trajectory is not None:
                self._until = self._trajectory.next_step(self._elapsed)
                self._running.set()

    def stop(self) -> None:
        """End the trajectory where the robot is."""
        with self._lock:
            self._trajectory = None
            self._running.set()

    def _run(self, trajectory: Trajectory) -> None:
        try:
            self._play(trajectory)
        except Exception as fault:
            with self._lock:
                still_current = self._trajectory is trajectory
                if still_current:
                    self._trajectory = None
            if self._on_error is None:
                raise
            if still_current:  # else another trajectory has begun, or this one was stopped
                self._on_error(fault)

    def _play(self, trajectory: Trajectory) -> None:
        before = time.monotonic()
        self._report(trajectory)
        while self._trajectory is trajectory and self._elapsed < trajectory.duration_s:
            self._running.wait(0.5)
            time.sleep(TICK_S)
            now = time.monotonic()
            self._advance(trajectory, min(now - before, 5 * TICK_S) * self.speed)
            before = now
        with self._lock:
            if self._trajectory is trajectory:
                self._elapsed = trajectory.duration_s
                self._report(trajectory)
                self._trajectory = None
                self._on_end()

    def _advance(self, trajectory: Trajectory, seconds: float) -> None:
        """Play some seconds more, but not past the end of a step."""
        with self._lock:
            if self._trajectory is not trajectory or not self._running.is_set():
                return
            self._elapsed = min(self._elapsed + seconds, trajectory.duration_s)
            if self._until is None or self._elapsed < self._until:
                self._report(trajectory)
                return
            self._elapsed, self._until = self._until, None
            self._running.clear()
            self._report(trajectory)
            self._on_pause()

    def _report(self, trajectory: Trajectory) -> None:
        with self._lock:
            if self._trajectory is trajectory:
                share = min(1.0, self._elapsed / max(trajectory.duration_s, 1e-9))
                self._on_pose(trajectory.at(self._elapsed), share, trajectory.segment_at(self._elapsed))
