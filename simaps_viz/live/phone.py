"""Phones as live sources: their frames come with poses, in a world whose y axis points up and which begins anywhere.

An iPhone or iPad streams by USB: the app Record3D sends, and its library receives (extra "record3d").
"""

import threading
import time
from collections import deque
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import OPENCV_FROM_OPENGL, REACH_M, Lens, from_quaternion, pinhole, see_through
from simaps_viz.datasets.file_frames import clean_depth
from simaps_viz.datasets.rosbag import time_name
from simaps_viz.errors import InputError, needs_extra
from simaps_viz.geometry import upright_turns
from simaps_viz.io.limits import check_picture
from simaps_viz.live.source import Shot, Source, Traffic
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


class PhoneSource(Source):
    """Makes shots of a phone's frames. Malformed ones are left out and counted; one that ends may always come back."""

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
        self._fault = ""

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
            if not self._arrived.wait_for(lambda: self._frames or self.ended, timeout_s) or self.ended:
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

    def words(self) -> str:
        """Describe the connection, and what was malformed last."""
        return self.state() + (f", malformed: {self._fault}" if self._fault else "")

    def close(self) -> None:
        """Stop."""
        with self._arrived:
            self.ended = True
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


RETRY_S = 1.0
LIDAR = 1
"""Kind of camera; the other one is that of the face, whose pictures are mirrored."""
NO_PHONE = "no iPhone at the USB: plug it in, unlock it and trust this machine (usbmuxd has to run)"
NO_STREAM = "the iPhone does not stream: in Record3D switch on USB streaming, and press record"


class Record3DSource(PhoneSource):
    """Takes the frames of the first device that streams; it connects again by itself."""

    def __init__(self, address: str, *, network: Network | None, traffic: Traffic) -> None:
        """Look for devices from now on.

        Raises:
            InputError: the address is not record3d://, or the extra is missing.
        """
        super().__init__(address, network=network, traffic=traffic)
        if address != "record3d://":
            raise InputError(f"{address}: expected record3d://, as the device is found by itself")
        with needs_extra("record3d", address):
            self._streams: Any = import_module("record3d").Record3DStream
        self._said, self._ending = NO_PHONE, threading.Event()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="record3d", daemon=True)
        self._thread.start()

    def state(self) -> str:
        """Describe the connection."""
        return self._said

    def close(self) -> None:
        """Disconnect."""
        super().close()
        self._ending.set()
        self._stopped.set()
        self._thread.join()

    def decode(self, frame: tuple[Any, ...]) -> PhoneFrame:
        """Return a frame as the library hands it out; raises InputError where it makes no sense."""
        depth_m, rgb, confidence, k, pose, camera, stamp_ns = frame
        if camera != LIDAR:
            raise InputError(f"{self.name}: expected the LiDAR at the back, found the camera at the front")
        if rgb.ndim != 3 or depth_m.ndim != 2:
            raise InputError(f"{self.name}: expected a picture and depth, found {rgb.shape} and {depth_m.shape}")
        check_picture(self.name, depth_m.shape[1], depth_m.shape[0])
        lens = Lens(pinhole(self.name, rgb.shape[1], rgb.shape[0], k.fx, k.fy, k.tx, k.ty))
        depth_m = clean_depth(depth_m)
        if confidence.shape == depth_m.shape:  # of older apps there is none
            depth_m[confidence == 0] = 0.0
        T = phone_pose(self.name, (pose.tx, pose.ty, pose.tz), (pose.qx, pose.qy, pose.qz, pose.qw))
        return PhoneFrame(depth_m, np.asarray(rgb), lens, T, stamp_ns)

    def _run(self) -> None:
        while not self._ending.is_set():
            stream = self._connected()
            if stream is not None:
                self._said = "connected"
                self._stopped.wait()
                self._said = NO_STREAM
                if self._ending.is_set():
                    stream.disconnect()
            # The library's own thread may still be in a stream that has stopped, so it is kept for a while.
            self._ending.wait(RETRY_S)

    def _connected(self) -> Any:
        """Return the stream of the first device that streams; None where there is none."""
        devices = self._streams.get_connected_devices()
        self._said = NO_STREAM if devices else NO_PHONE
        for device in devices:
            stream = self._streams()
            stream.on_new_frame = lambda stream=stream: self._take(stream)
            stream.on_stream_stopped = self._stopped.set
            self._stopped.clear()
            if self._ending.is_set():
                self._stopped.set()
            if stream.connect(device):
                return stream
        return None

    def _take(self, stream: Any) -> None:
        """Copy a frame, in the library's thread, where an exception would end the program."""
        try:
            if not self._ending.is_set():
                self.feed((
                    stream.get_depth_frame(), stream.get_rgb_frame(), stream.get_confidence_frame(),
                    stream.get_intrinsic_mat(), stream.get_camera_pose(), stream.get_device_type(), time.time_ns(),
                ))  # fmt: skip
        except Exception:
            self._traffic.drop("malformed")
