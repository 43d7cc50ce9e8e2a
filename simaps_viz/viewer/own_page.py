"""What panels reach of the one page they stand on, where the desk is one browser's: its camera, its downloads."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import viser

from simaps_viz.structures import Pose2
from simaps_viz.viewer.desk import Desk
from simaps_viz.viewer.drawing.camera import Extent, top_view

Look = Callable[[Extent | None], None]
"""Moves a page's camera over an extent; None: back to where it was before."""
Send = Callable[[str, bytes], None]
"""(file name, content): hands a page's browser a file to save."""


@runtime_checkable
class _OfClient(Protocol):
    @property
    def client(self) -> viser.ClientHandle: ...


@runtime_checkable
class _Restoring(Protocol):
    def restore(self) -> None: ...


@runtime_checkable
class _WithRobot(Protocol):
    @property
    def pose(self) -> Pose2: ...


def look_on(desk: Desk) -> Look | None:
    """Give what moves the camera of a desk's page; None when the desk is not one browser's."""
    if not isinstance(desk, _OfClient):
        return None
    client = desk.client

    def look(extent: Extent | None) -> None:
        if extent is None:
            viewpoints = getattr(desk, "viewpoints", None)
            if isinstance(viewpoints, _Restoring):
                viewpoints.restore()
            return
        view = top_view(extent, client.camera.aspect)
        with client.atomic():
            client.camera.fov = view.fov_rad
            client.camera.up_direction = (0.0, 0.0, 1.0)
            client.camera.position = view.position
            client.camera.look_at = view.look_at

    return look


def send_from(desk: Desk) -> Send | None:
    """Give what hands files to a desk's browser; None when the desk is not one browser's."""
    if not isinstance(desk, _OfClient):
        return None
    client = desk.client
    return lambda name, content: client.send_file_download(name, content, save_immediately=True)


def robot_on(desk: Desk) -> Callable[[], Pose2] | None:
    """Give what tells where a desk's robot stands; None when it has none."""
    return (lambda: desk.pose) if isinstance(desk, _WithRobot) else None
