"""Where a frame was taken from, as a node of a page's scene."""

import numpy as np
import viser
import viser.transforms as vtf
from numpy.typing import NDArray

CAMERA = (220, 60, 40)
FOV_RAD, ASPECT, SIZE_M = 0.9, 4 / 3, 0.45
"""It shows where a frame was taken from, not how much was on it."""


class CameraMark:
    """A camera's frustum and the line from it to the floor.

    Made once and then moved: a page that is sent a node anew for every frame shows none of them while they come.
    """

    def __init__(self, page: viser.ViserServer | viser.ClientHandle) -> None:
        """Add the nodes, hidden."""
        self._page = page
        self._frustum = page.scene.add_camera_frustum(
            "/camera",
            FOV_RAD,
            ASPECT,
            scale=SIZE_M,
            thickness=2.5,
            thickness_units="screen",
            color=CAMERA,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        upright = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
        self._drop = page.scene.add_line_segments(
            "/camera_dot", upright, CAMERA, thickness=1.5, thickness_units="screen", visible=False
        )

    def show(self, T_map_camera: NDArray) -> None:
        """Stand where a frame was taken from, float [4, 4], camera to map, metres."""
        x, y, z = (float(value) for value in T_map_camera[:3, 3])
        with self._page.atomic():
            self._frustum.position = (x, y, z)
            self._frustum.wxyz = vtf.SO3.from_matrix(T_map_camera[:3, :3]).wxyz
            self._drop.position = (x, y, 0.0)
            self._drop.scale = (1.0, 1.0, z)
            self._frustum.visible = self._drop.visible = True

    def hide(self) -> None:
        """Take it away."""
        with self._page.atomic():
            self._frustum.visible = self._drop.visible = False
