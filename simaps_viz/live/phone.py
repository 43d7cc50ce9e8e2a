"""Phones as live sources: their frames come with poses, in a world whose y axis points up and which begins anywhere."""

import threading
from collections import deque
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import OPENCV_FROM_OPENGL, REACH_M, Lens, from_quaternion, see_through
from simaps_viz.datasets.rosbag import time_name
from simaps_viz.errors import InputError
from simaps_viz.geometry import upright_turns
from simaps_viz.live.source import Correction, Shot, Traffic
from simaps_viz.segmentation.protocol import Network
from simaps_viz.structures import Frame, Segmentation

BEHIND = 8
"""Frames that may wait for the map; older ones are left out, as the newest shows most."""
MAX_SIDE = 640
"""Pixels along the longer side of the pictures that a network looks at; phones take far larger ones."""
Z_UP_FROM_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""A quarter turn about x: WebXR and ARKit have y up."""


@dataclass(frozen=True, eq=False)
class PhoneFrame:
    """What a phone saw at one time."""

    depth_m: NDArray
    """float32 [h, w], metres along the optical axis, 0 = invalid."""
    color: NDArray | None
    """uint8 [H, W, 3], RGB, of the same view but of any size."""
    lens: Lens
    """The camera, for pictures of any size."""
    T_world_camera: NDArray
    """float64 [4, 4], camera with OpenGL's axes to a world with y up."""
    stamp_ns: int


def phone_pose(where: str, position: Any, xyzw: Any) -> NDArray:
    """Return a pose, float64 [4, 4]; raises InputError for numbers that are none, or too far away."""
    T = from_quaternion(where, position, xyzw)
    if np.abs(T[:3, 3]).max() > REACH_M:
        raise InputError(f"{where}: expected a phone within {REACH_M:g} m of where it began, found {T[:3, 3]}")
    return T


class PhoneSource:
    """Makes shots of a phone's frames. Malformed ones are left out and counted."""

    simulated = False
    T_map_world: NDArray | None = None
    labels, is_thing = ("none",), (False,)

    def __init__(self, name: str, *, network: Network | None, traffic: Traffic) -> None:
        """Wait for frames.

        Args:
            name: the address.
            network: looks at the pictures; phones name nothing themselves.
            traffic: counts what is left out.
        """
        self.name, self._color, self._traffic = name, network is not None, traffic
        self.segmentation_source = "none" if network is None else network.name
        self._frames: deque[Any] = deque()
        self._arrived = threading.Condition()
        self._closed, self._fault = False, ""

    @property
    def ended(self) -> bool:
        """Whether it was closed: a phone may always come back."""
        return self._closed

    def feed(self, frame: Any) -> None:
        """Take a frame as it came, from the phone's thread."""
        with self._arrived:
            self._frames.append(frame)
            if len(self._frames) > BEHIND:
                self._frames.popleft()
                self._traffic.drop("the map is too slow")
            self._arrived.notify()

    def take(self, timeout_s: float) -> Shot | None:
        """Return the next shot."""
        with self._arrived:
            if not self._arrived.wait_for(lambda: self._frames or self._closed, timeout_s) or self._closed:
                return None
            frame = self._frames.popleft()
        try:
            return self._shot(self.decode(frame))
        except InputError as error:
            self._fault = str(error)[:120]
            self._traffic.drop("malformed")
            return None

    def decode(self, frame: Any) -> PhoneFrame:
        """Return what came as a frame; raises InputError where it is malformed."""
        raise NotImplementedError

    def state(self) -> str:
        """Describe the connection."""
        raise NotImplementedError

    def correction(self) -> Correction | None:
        """Return None: phones correct their poses without saying so."""
        return None

    def words(self) -> str:
        """Describe the connection, and what was malformed last."""
        return self.state() + (f", malformed: {self._fault}" if self._fault else "")

    def close(self) -> None:
        """Stop."""
        with self._arrived:
            self._closed = True
            self._arrived.notify_all()

    def _shot(self, found: PhoneFrame) -> Shot:
        depth_m, color, lens = found.depth_m, found.color if self._color else None, found.lens
        own = lens.scaled(depth_m.shape[1], depth_m.shape[0])
        target = own
        if color is not None:
            # The picture has more pixels than the depth, and the network needs them.
            height, width = color.shape[:2]
            share = min(MAX_SIDE / max(height, width), 1.0)
            width, height = max(round(width * share), 1), max(round(height * share), 1)
            color = cv2.resize(color, (width, height), interpolation=cv2.INTER_AREA)
            target = lens.scaled(width, height)
            depth_m = see_through(depth_m, own, target.intrinsics, exact=True)
        pose = Z_UP_FROM_Y_UP @ found.T_world_camera @ OPENCV_FROM_OPENGL
        frame = Frame(0, time_name(found.stamp_ns), depth_m, pose, target.intrinsics, color)
        frame = frame.turned(upright_turns(pose))  # networks know a world that stands upright
        # Without a network nobody will ever name anything.
        masks = None if self._color else Segmentation(np.zeros(frame.depth_m.shape, np.int32), ())
        return Shot(frame, masks, found.stamp_ns, found.stamp_ns)
