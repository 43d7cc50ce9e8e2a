"""Keeps every open page looking at the whole map, whatever the size of its canvas."""

import threading

import numpy as np
import viser

from simaps_viz.viewer.camera import Extent, View, slanted_view, top_view
from simaps_viz.viewer.map_panel import SLANT, TOP

FIRST_ASPECT = 0.75
"""Width over height of the canvas assumed until a page has told its own."""


class Viewpoints:
    """The cameras of all clients. A camera that its user has moved is left alone."""

    def __init__(self, server: viser.ViserServer, extent: Extent) -> None:
        """Set the first camera and watch for clients."""
        self._server, self._extent = server, extent
        self._name = TOP
        self._fitted: dict[int, tuple[float, View]] = {}
        self._lock = threading.Lock()
        first = self._view(FIRST_ASPECT)
        self._first = first
        server.initial_camera.position = first.position
        server.initial_camera.look_at = first.look_at
        server.initial_camera.fov = first.fov_rad
        server.on_client_connect(self._connected)
        server.on_client_disconnect(self._left)

    def look(self, name: str) -> None:
        """Bring every page to the top view or the slanted one."""
        self._name = name
        for client in self._server.get_clients().values():
            self._fit(client)

    def restore(self) -> None:
        """Bring every page back to the view that was chosen last."""
        self.look(self._name)

    def _view(self, aspect: float) -> View:
        return (slanted_view if self._name == SLANT else top_view)(self._extent, aspect)

    def _connected(self, client: viser.ClientHandle) -> None:
        client.camera.on_update(lambda _: self._updated(client))

    def _left(self, client: viser.ClientHandle) -> None:
        self._fitted.pop(client.client_id, None)

    def _updated(self, client: viser.ClientHandle) -> None:
        """Fit again when the canvas changed its shape and the camera is still where it was put."""
        aspect = client.camera.aspect
        fitted_aspect, view = self._fitted.get(client.client_id, (0.0, self._first))
        if abs(aspect - fitted_aspect) < 0.005:
            return
        scale = float(np.linalg.norm(np.subtract(view.position, view.look_at)))
        moved = float(np.linalg.norm(np.asarray(client.camera.position) - view.position)) > 0.01 * scale
        if client.client_id in self._fitted and moved:
            return
        self._fit(client)

    def _fit(self, client: viser.ClientHandle) -> None:
        with self._lock:
            aspect = client.camera.aspect
            view = self._view(aspect)
            self._fitted[client.client_id] = (aspect, view)
            with client.atomic():
                client.camera.fov = view.fov_rad
                client.camera.up_direction = (0.0, 0.0, 1.0)
                client.camera.position = view.position
                client.camera.look_at = view.look_at
