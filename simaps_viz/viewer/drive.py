"""The robot's ride: poses to a timed trajectory, and a thread that plays it."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.geometry import wrap_angle
from simaps_viz.structures import Pose2

SPEED_M_S = 0.9
TURN_RAD_S = float(np.deg2rad(150.0))
TICK_S = 0.05


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses and when the robot is at each."""

    poses: NDArray
    """float64 [n, 3], x, y (metres), yaw (radians), map frame; n >= 1."""
    times_s: NDArray
    """float64 [n], from 0, never falling."""

    @property
    def duration_s(self) -> float:
        """How long the ride takes at normal speed, seconds."""
        return float(self.times_s[-1])

    def leg_at(self, time_s: float) -> int:
        """Give the index of the last pose that was passed by a time."""
        return int(np.clip(np.searchsorted(self.times_s, time_s, side="right") - 1, 0, len(self.times_s) - 1))

    def at(self, time_s: float) -> Pose2:
        """Give the pose at a time; before the start and after the end the robot stands."""
        i = self.leg_at(time_s)
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
    seconds = np.maximum(np.hypot(steps[:, 0], steps[:, 1]) / SPEED_M_S, turn / TURN_RAD_S)
    return Trajectory(array, np.concatenate([[0.0], np.cumsum(seconds)]))


def poses_along(start: Pose2, path: ArrayLike, final: Pose2) -> NDArray:
    """Give poses [n, 3] for a path [m, 2]: turn on the spot towards each next point, drive there, end as ``final``."""
    poses = [[start.x_m, start.y_m, start.yaw_rad]]
    for x, y in np.asarray(path, np.float64).reshape(-1, 2):
        dx, dy = x - poses[-1][0], y - poses[-1][1]
        if np.hypot(dx, dy) > 1e-6:
            yaw = float(np.arctan2(dy, dx))
            poses += [[poses[-1][0], poses[-1][1], yaw], [float(x), float(y), yaw]]
    poses += [[final.x_m, final.y_m, poses[-1][2]], [final.x_m, final.y_m, final.yaw_rad]]
    return np.array(poses)


class Drive:
    """Plays a trajectory in real time."""

    def __init__(self, on_pose: Callable[[Pose2, float, int], None], on_end: Callable[[], None]) -> None:
        """Take whom to tell.

        Args:
            on_pose: gets the pose, the share of the ride that is over, and the index of the pose passed last.
            on_end: called when the ride has ended by itself.
        """
        self._on_pose, self._on_end = on_pose, on_end
        self.speed = 1.0
        """Factor on the normal speed; may change while the robot drives."""
        self._running = threading.Event()
        self._ride: object | None = None

    @property
    def active(self) -> bool:
        """Whether a ride has begun and not ended, paused or not."""
        return self._ride is not None

    @property
    def paused(self) -> bool:
        """Whether a ride waits."""
        return self.active and not self._running.is_set()

    def start(self, ride: Trajectory) -> None:
        """Begin a ride; one that is under way ends where it is."""
        self._ride = ride
        self._running.set()
        threading.Thread(target=self._play, args=(ride,), name="workbench-drive", daemon=True).start()

    def pause(self, paused: bool) -> None:
        """Hold the ride, or let it go on."""
        if paused:
            self._running.clear()
        else:
            self._running.set()

    def stop(self) -> None:
        """End the ride where the robot is."""
        self._ride = None
        self._running.set()

    def _play(self, ride: Trajectory) -> None:
        elapsed, before = 0.0, time.monotonic()
        while self._ride is ride and elapsed < ride.duration_s:
            self._running.wait()
            time.sleep(TICK_S)
            now = time.monotonic()
            if self._running.is_set():
                elapsed += min(now - before, 5 * TICK_S) * self.speed
            before = now
            if self._ride is ride:
                self._on_pose(ride.at(elapsed), min(1.0, elapsed / max(ride.duration_s, 1e-9)), ride.leg_at(elapsed))
        if self._ride is ride:
            self._on_pose(ride.at(ride.duration_s), 1.0, len(ride.poses) - 1)
            self._ride = None
            self._on_end()
