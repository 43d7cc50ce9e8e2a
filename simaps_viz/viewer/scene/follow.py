"""A camera that goes along with the robot."""

import threading
import time
from collections.abc import Callable

import numpy as np
import viser

from simaps_viz.geometry import wrap_angle
from simaps_viz.structures import Pose2
from simaps_viz.viewer.scene.camera import TOP_FOV_RAD, View

SEEN_M = 6.0
"""Height of what the camera above the robot sees."""
BEHIND_M, OVER_M, AHEAD_M = 3.0, 2.6, 1.5
BEHIND_FOV_RAD = float(np.deg2rad(55.0))
_EVERY_S = 0.08
_TURNS_BY = 0.3
"""Share of the robot's turn that the camera makes up for at each move, so that a turn on the spot is no whirl."""


class Follower:
    """Moves the camera of a page, while it is on."""

    def __init__(self, client: viser.ClientHandle, *, behind: Callable[[], bool], let_go: Callable[[], None]) -> None:
        """Take what it needs.

        Args:
            client: whose camera.
            behind: whether to look from behind the robot rather than from above.
            let_go: called when it is switched off; puts the camera back.
        """
        self._client, self._behind, self._let_go = client, behind, let_go
        self._on = False
        self._yaw: float | None = None
        self._moved_at = 0.0
        self._lock = threading.Lock()

    @property
    def on(self) -> bool:
        """Whether the camera follows."""
        return self._on

    def switch(self, on: bool, pose: Pose2) -> None:
        """Begin to follow, or leave the camera to its user again."""
        with self._lock:  # a move that is being made would undo what ``let_go`` does
            was, self._on, self._yaw, self._moved_at = self._on, on, None, 0.0
            if was and not on:
                self._let_go()
        self.see(pose, rests=True)

    def see(self, pose: Pose2, *, rests: bool = False) -> None:
        """Report where the robot is, and whether it rests there; else moves that come too fast are left out."""
        soon = time.monotonic() - self._moved_at < _EVERY_S and not rests
        if not self._on or soon or not self._lock.acquire(blocking=rests):
            return
        try:
            if not self._on:
                return
            self._moved_at = time.monotonic()
            yaw = pose.yaw_rad if self._yaw is None else self._yaw
            self._yaw = wrap_angle(yaw + _TURNS_BY * wrap_angle(pose.yaw_rad - yaw))
            view = behind(pose, self._yaw) if self._behind() else above(pose)
            camera = self._client.camera
            with self._client.atomic():
                camera.fov = view.fov_rad
                camera.up_direction = (0.0, 0.0, 1.0)
                camera.position = view.position
                camera.look_at = view.look_at
        finally:
            self._lock.release()


def above(pose: Pose2) -> View:
    """Look straight down on the robot, north up."""
    height = SEEN_M / 2.0 / np.tan(TOP_FOV_RAD / 2.0)
    # A hair to the south: straight down would leave "up" undefined.
    return View((pose.x_m, pose.y_m - 1e-3 * height, height), (pose.x_m, pose.y_m, 0.0), TOP_FOV_RAD)


def behind(pose: Pose2, yaw_rad: float) -> View:
    """Look over the robot's shoulder, along a direction near to its own."""
    c, s = float(np.cos(yaw_rad)), float(np.sin(yaw_rad))
    position = (pose.x_m - BEHIND_M * c, pose.y_m - BEHIND_M * s, OVER_M)
    return View(position, (pose.x_m + AHEAD_M * c, pose.y_m + AHEAD_M * s, 0.0), BEHIND_FOV_RAD)
