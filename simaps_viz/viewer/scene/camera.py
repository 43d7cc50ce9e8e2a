"""Where a page looks: views of the map, the camera of a page, and a camera that follows the robot."""

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from simaps_viz.geometry import wrap_angle
from simaps_viz.structures import Pose2
from simaps_viz.viewer.server.viser_hooks import initial_camera

Extent = tuple[float, float, float, float]
"""(xmin, ymin, xmax, ymax), map frame, metres."""

TOP_FOV_RAD = float(np.deg2rad(10.0))
MAX_TOP_HEIGHT_M = 600.0
"""The top view's camera is no farther from the floor, however large the map: it opens wider instead."""
SEES_M = 1000.0
"""viser's camera sees nothing beyond this distance unless its far plane is moved."""
SLANT_FOV_RAD = float(np.deg2rad(40.0))
SLANT_RAD = float(np.deg2rad(48.0))
"""Angle of the slanted view over the horizon."""


@dataclass(frozen=True)
class View:
    """A camera that looks at the map; up is always +z."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    fov_rad: float
    """Vertical field of view."""

    @property
    def far_m(self) -> float:
        """How far the camera has to see, with room for moving away."""
        return max(SEES_M, 4.0 * float(np.linalg.norm(np.subtract(self.position, self.look_at))))


def with_margin(extent: Extent, share: float = 0.05, least_m: float = 0.3) -> Extent:
    """Widen an extent on all sides by a share of its longer side."""
    xmin, ymin, xmax, ymax = extent
    margin = max(least_m, share * max(xmax - xmin, ymax - ymin))
    return xmin - margin, ymin - margin, xmax + margin, ymax + margin


def top_view(extent: Extent, aspect: float) -> View:
    """Look straight down, north up, so that the extent just fits; far away, for there is no orthographic camera.

    Args:
        extent: what has to be seen.
        aspect: width over height of the canvas.
    """
    xmin, ymin, xmax, ymax = extent
    half = max((ymax - ymin) / 2.0, (xmax - xmin) / 2.0 / max(aspect, 1e-3))
    distance = min(half / np.tan(TOP_FOV_RAD / 2.0), MAX_TOP_HEIGHT_M)
    fov_rad = 2.0 * float(np.arctan2(half, distance))
    x, y = (xmin + xmax) / 2.0, (ymin + ymax) / 2.0
    # A hair to the south: straight down would leave "up" undefined.
    return View((x, y - 1e-3 * distance, distance), (x, y, 0.0), fov_rad)


def slanted_view(extent: Extent, aspect: float) -> View:
    """Look at the map from the south, from above, so that the extent fits."""
    xmin, ymin, xmax, ymax = extent
    half = max((ymax - ymin) / 2.0, (xmax - xmin) / 2.0 / max(aspect, 1e-3))
    distance = half * 1.12 / np.tan(SLANT_FOV_RAD / 2.0)
    x, y = (xmin + xmax) / 2.0, (ymin + ymax) / 2.0
    position = (x, y - distance * float(np.cos(SLANT_RAD)), distance * float(np.sin(SLANT_RAD)))
    return View(position, (x, y, 0.0), SLANT_FOV_RAD)


TOP, SLANT = "Top view", "3-D view"
"""The two views of a map, as the page names them."""
PANEL_WIDTH_PX, RIM_PX = 440, 4
"""Of the docked panels, and of what viser draws beside them."""
PHONE_PX, SHEET_SHARE = 576, 0.45
"""On narrower pages the panels are a sheet at the bottom, of so much of the height (see ``page.css``)."""
UP = (0.0, 0.0, 1.0)
INSIST_S = 3.0
"""For how long after a camera was put somewhere it is put there again when its page is still where it was before: a
page that is being set up forgets what it is sent."""

Triple = tuple[float, float, float]


def docked_aspect(width_px: float, height_px: float) -> float:
    """Return width over height of the canvas of a page of some size, once its panels are docked."""
    if width_px < PHONE_PX:
        return width_px / max((1.0 - SHEET_SHARE) * height_px, 1.0)
    return max(width_px - PANEL_WIDTH_PX - RIM_PX, 1.0) / max(height_px, 1.0)


FIRST_ASPECT = docked_aspect(1280, 800)
"""Assumed until a page has reported its size."""


@dataclass(frozen=True)
class CameraState:
    """Where a page looks."""

    name: str
    """TOP or SLANT: the view that was chosen last."""
    moved: tuple[Triple, Triple, Triple, float] | None = None
    """Position, point looked at, up, vertical field of view (radians), if its user has moved it from there."""


def set_first_view(server: viser.ViserServer, extent: Extent, aspect: float = FIRST_ASPECT) -> None:
    """Set the first view of pages that are opened from now on: the top view of an extent."""
    _set_camera(server.initial_camera, top_view(extent, aspect))


def _set_camera(camera: viser.InitialCameraConfig, view: View) -> None:
    camera.position, camera.look_at = view.position, view.look_at
    camera.fov, camera.far = view.fov_rad, view.far_m


class Viewpoints:
    """The camera of one page. It shows the complete map, whatever the canvas, until its user moves it."""

    def __init__(self, client: viser.ClientHandle, extent: Extent) -> None:
        """Begin with the top view of an extent, and watch the canvas."""
        self._client, self._extent = client, extent
        self.name = TOP
        """TOP or SLANT: the view that was chosen last."""
        self._aspect = 0.0
        # Several, for a page may still report where it was before it got what it was sent last.
        self._put_at_s, self._begun_s = 0.0, time.monotonic()
        self._target: tuple[View, Triple] | None = None
        self._left_by_user = False
        self._first = top_view(extent, FIRST_ASPECT)
        """Where a page begins; one that takes long to be set up is there again long after it was sent elsewhere."""
        self._put_there: deque[View] = deque([self._first], maxlen=8)
        self._lock = threading.RLock()
        client.camera.on_update(lambda _: self._updated())
        # The canvas of a page that has just begun is mostly still as large as the page.
        self._dock(client.camera.image_width, client.camera.image_height)

    def settle(self, width_px: float, height_px: float) -> None:
        """Fit the map to the canvas that a page of some size will have, if it was guessed wrongly."""
        with self._lock:
            if abs(self._aspect - docked_aspect(width_px, height_px)) >= 0.005 and not self._moved():
                self._dock(width_px, height_px)

    def look(self, name: str) -> None:
        """Go to the top view or the slanted one."""
        with self._lock:
            self.name = name
            self._fit()

    def look_at(self, extent: Extent) -> None:
        """Come close to a part of the floor, from the side that was chosen last."""
        with self._lock:
            self._left_by_user = True
            self._put(self._view(extent, self._client.camera.aspect), UP)

    def bring_in(self, extent: Extent) -> None:
        """Go back to the whole map where a part of the floor is out of sight in the top view."""
        with self._lock:
            camera, (xmin, ymin, xmax, ymax) = self._client.camera, extent
            x, y, height_m = camera.position
            high_m = height_m * float(np.tan(camera.fov / 2.0))
            wide_m = high_m * camera.aspect
            if self.name == TOP and not (
                x - wide_m <= xmin and xmax <= x + wide_m and y - high_m <= ymin and ymax <= y + high_m
            ):
                self._fit()

    def look_down(self, extent: Extent | None) -> None:
        """Look straight down on a part of the floor; None: go back to the view that was chosen last."""
        if extent is None:
            self.look(self.name)
            return
        with self._lock:
            self._left_by_user = True
            self._put(top_view(extent, self._client.camera.aspect), UP)

    def show_extent(self, extent: Extent) -> None:
        """Show another part of the floor, unless the camera was moved."""
        with self._lock:
            moved = self._moved()
            self._extent = extent
            if not moved:
                self._fit()

    def state(self) -> CameraState:
        """Return where the page looks."""
        with self._lock:
            if not self._moved():
                return CameraState(self.name)
            camera = self._client.camera
            places = (_triple(camera.position), _triple(camera.look_at), _triple(camera.up_direction))
            return CameraState(self.name, (*places, float(camera.fov)))

    def go_to(self, state: CameraState) -> None:
        """Look where a page looked."""
        with self._lock:
            self.look(state.name)
            if state.moved is not None:
                position, look_at, up, fov_rad = state.moved
                self._left_by_user = True
                self._put(View(position, look_at, fov_rad), up)

    def _moved(self) -> bool:
        """Return whether the camera is not where it was put."""
        return not any(self._is_at(view) for view in self._put_there)

    def _is_at(self, view: View) -> bool:
        camera = self._client.camera
        scale = float(np.linalg.norm(np.subtract(view.position, view.look_at)))
        away = float(np.linalg.norm(np.asarray(camera.position) - view.position))
        return away <= 0.01 * scale and abs(float(camera.fov) - view.fov_rad) <= 0.01 * view.fov_rad

    def _updated(self) -> None:
        """Fit again when the canvas changed its shape, or forgot, and the camera is still where it was put."""
        with self._lock:
            if self._moved():
                return
            now_s, aspect = time.monotonic(), self._client.camera.aspect
            lately = now_s - self._put_at_s < INSIST_S
            docking = now_s - self._begun_s < INSIST_S and self._docking[0] <= aspect <= self._docking[1]
            kept = docking or (lately and self._left_by_user)
            if abs(aspect - self._aspect) >= 0.005 and not kept:
                self._fit()
            elif (lately or self._is_at(self._first)) and self._target is not None and not self._is_at(self._target[0]):
                _send(self._client, *self._target)

    def _dock(self, width_px: float, height_px: float) -> None:
        docked = docked_aspect(width_px, height_px)
        # The canvas gets its shape bit by bit while the panels are being docked.
        self._docking = sorted((docked, width_px / max(height_px, 1)))
        self._fit(docked)

    def _fit(self, aspect: float | None = None) -> None:
        self._aspect, self._left_by_user = self._client.camera.aspect if aspect is None else aspect, False
        view = self._view(self._extent, self._aspect)
        self._put_there.append(view)
        _set_camera(initial_camera(self._client), view)  # which it returns to while it is being set up
        self._put(view, UP)

    def _view(self, extent: Extent, aspect: float) -> View:
        return (slanted_view if self.name == SLANT else top_view)(extent, aspect)

    def _put(self, view: View, up: Triple) -> None:
        self._target, self._put_at_s = (view, up), time.monotonic()
        _send(self._client, view, up)


def _send(client: viser.ClientHandle, view: View, up: Triple = UP) -> None:
    camera = client.camera
    with client.atomic():
        camera.fov, camera.far = view.fov_rad, view.far_m
        camera.up_direction = up
        camera.position = view.position
        camera.look_at = view.look_at


def _triple(vector: np.ndarray) -> Triple:
    return float(vector[0]), float(vector[1]), float(vector[2])


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
        """Follow nothing yet.

        Args:
            client: whose camera.
            behind: whether to look from behind the robot rather than from above.
            let_go: called when it is switched off; restores the camera.
        """
        self._client, self._behind, self._let_go = client, behind, let_go
        self.on = False
        """Whether the camera follows."""
        self._yaw: float | None = None
        self._moved_at = 0.0
        self._lock = threading.Lock()

    def switch(self, on: bool, pose: Pose2) -> None:
        """Begin to follow, or return the camera to its user."""
        with self._lock:  # a move that is being made would undo what ``let_go`` does
            was, self.on, self._yaw, self._moved_at = self.on, on, None, 0.0
            if was and not on:
                self._let_go()
        self.see(pose, rests=True)

    def see(self, pose: Pose2, *, rests: bool = False) -> None:
        """Move the camera to a pose of the robot; moves that come too fast are left out unless the robot rests."""
        soon = time.monotonic() - self._moved_at < _EVERY_S and not rests
        if not self.on or soon or not self._lock.acquire(blocking=rests):
            return
        try:
            if not self.on:
                return
            self._moved_at = time.monotonic()
            yaw = pose.yaw_rad if self._yaw is None else self._yaw
            self._yaw = wrap_angle(yaw + _TURNS_BY * wrap_angle(pose.yaw_rad - yaw))
            _send(self._client, behind(pose, self._yaw) if self._behind() else above(pose))
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
