"""An iPhone or iPad as a live source, by USB: the app Record3D streams, and its library receives (extra "record3d")."""

import threading
import time
from importlib import import_module
from typing import Any

import numpy as np

from simaps_viz.datasets.calibration import Lens, pinhole
from simaps_viz.datasets.file_frames import clean_depth
from simaps_viz.errors import InputError, needs_extra
from simaps_viz.io.limits import check_picture
from simaps_viz.live.phone import PhoneFrame, PhoneSource, phone_pose
from simaps_viz.live.source import Traffic
from simaps_viz.segmentation.protocol import Network

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
