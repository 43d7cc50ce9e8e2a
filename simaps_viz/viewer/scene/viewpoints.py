"""Keeps a page looking at the whole map, whatever the size of its canvas, until its user moves the camera."""

import threading
import time
from collections import deque
from dataclasses import dataclass

import numpy as np
import viser

from simaps_viz.viewer.scene.camera import Extent, View, slanted_view, top_view

TOP, SLANT = "Top view", "3-D view"
"""The two views of a map, as the page names them."""
FIRST_ASPECT = 0.75
"""Width over height of the canvas assumed until a page has told its own."""
UP = (0.0, 0.0, 1.0)
INSIST_S = 3.0
"""For how long after a camera was put somewhere it is put there again when its page is still where it was before: a
page that is being set up forgets what it is sent."""

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class CameraState:
    """Where a page looks."""

    name: str
    """TOP or SLANT: the view that was chosen last."""
    moved: tuple[Triple, Triple, Triple, float] | None = None
    """Position, place looked at, up, vertical field of view (radians), where its user has moved it from there."""


def set_first_view(server: viser.ViserServer, extent: Extent) -> None:
    """Let pages that are opened from now on begin with the top view of an extent."""
    first = top_view(extent, FIRST_ASPECT)
    server.initial_camera.position = first.position
    server.initial_camera.look_at = first.look_at
    server.initial_camera.fov = first.fov_rad
    server.initial_camera.far = first.far_m


class Viewpoints:
    """The camera of one page. A camera that its user has moved is left alone."""

    def __init__(self, client: viser.ClientHandle, extent: Extent) -> None:
        """Begin with the top view of an extent, and watch the canvas."""
        self._client, self._extent = client, extent
        self._name = TOP
        self._aspect = 0.0
        # Several, for a page may still report where it was before it got what it was sent last.
        self._put_at_s = 0.0
        self._target: tuple[View, Triple] | None = None
        self._left_by_user = False
        self._first = top_view(extent, FIRST_ASPECT)
        """Where a page begins; one that takes long to be set up is there again long after it was sent elsewhere."""
        self._put_there: deque[View] = deque([self._first], maxlen=8)
        self._lock = threading.RLock()
        client.camera.on_update(lambda _: self._updated())
        self._fit()

    @property
    def name(self) -> str:
        """TOP or SLANT: the view that was chosen last."""
        return self._name

    def look(self, name: str) -> None:
        """Go to the top view or the slanted one."""
        with self._lock:
            self._name = name
            self._fit()

    def look_at(self, extent: Extent) -> None:
        """Come close to a part of the floor, from the side that was chosen last."""
        with self._lock:
            self._left_by_user = True
            view = slanted_view if self._name == SLANT else top_view
            self._put(view(extent, self._client.camera.aspect), UP)

    def look_down(self, extent: Extent | None) -> None:
        """Look straight down on a part of the floor; None: go back to the view that was chosen last."""
        if extent is None:
            self.restore()
            return
        with self._lock:
            self._left_by_user = True
            self._put(top_view(extent, self._client.camera.aspect), UP)

    def restore(self) -> None:
        """Go back to the view that was chosen last."""
        self.look(self._name)

    def show_extent(self, extent: Extent) -> None:
        """Another part of the floor is to be seen: go there, unless the camera was moved."""
        with self._lock:
            moved = self._moved()
            self._extent = extent
            if not moved:
                self._fit()

    def state(self) -> CameraState:
        """Return where the page looks."""
        with self._lock:
            if not self._moved():
                return CameraState(self._name)
            camera = self._client.camera
            places = (_triple(camera.position), _triple(camera.look_at), _triple(camera.up_direction))
            return CameraState(self._name, (*places, float(camera.fov)))

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
            lately = time.monotonic() - self._put_at_s < INSIST_S
            if abs(self._client.camera.aspect - self._aspect) >= 0.005 and not (lately and self._left_by_user):
                self._fit()
            elif (lately or self._is_at(self._first)) and self._target is not None and not self._is_at(self._target[0]):
                self._send(*self._target)

    def _fit(self) -> None:
        self._aspect, self._left_by_user = self._client.camera.aspect, False
        view = (slanted_view if self._name == SLANT else top_view)(self._extent, self._aspect)
        self._put_there.append(view)
        self._put(view, UP)

    def _put(self, view: View, up: Triple) -> None:
        self._target, self._put_at_s = (view, up), time.monotonic()
        self._send(view, up)

    def _send(self, view: View, up: Triple) -> None:
        camera = self._client.camera
        with self._client.atomic():
            camera.fov, camera.far = view.fov_rad, view.far_m
            camera.up_direction = up
            camera.position = view.position
            camera.look_at = view.look_at


def _triple(vector: np.ndarray) -> Triple:
    return float(vector[0]), float(vector[1]), float(vector[2])
