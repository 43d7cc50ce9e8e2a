"""A phone that is not there: the frames of a sequence as the page's messages, and a network that knows its colours."""

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from sequences import COLORS, LABELS

from simaps_viz.app.webxr import HEAD, MAGIC
from simaps_viz.structures import Segment, Segmentation

UNIT_M = 0.001
Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def phone_pose(T_world_camera: NDArray) -> tuple[list[float], list[float]]:
    """Return position, and quaternion x y z w, of a camera as phones have it: y up, OpenGL's axes."""
    T = Y_UP_FROM_Z_UP @ T_world_camera @ np.diag([1.0, -1.0, -1.0, 1.0])
    return T[:3, 3].tolist(), Rotation.from_matrix(T[:3, :3]).as_quat().tolist()


def phone_message(frame: Any, *, picture: bool = True, ms: float = 1.7e12) -> bytes:
    """Return a frame of a sequence as the page sends it, with its picture twice as large as its depth."""
    k = frame.intrinsics
    depth = np.rint(frame.depth_m / UNIT_M).astype("<u2")
    png = b""
    if picture:
        large = cv2.resize(frame.color, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_NEAREST)
        png = cv2.imencode(".png", cv2.cvtColor(large, cv2.COLOR_RGB2BGR))[1].tobytes()
    position, xyzw = phone_pose(frame.T_world_camera)
    head = HEAD.pack(MAGIC, k.width, k.height, len(png), ms, UNIT_M, k.fx, k.fy, k.cx, k.cy, *position, *xyzw)
    return head + depth.tobytes() + png


def color_network() -> Any:
    """Return a network that names each pixel by its colour, as the tiny sequence has them."""

    def decode(color: NDArray, height: int, width: int) -> Segmentation:
        assert color.shape == (height, width, 3)
        known = np.array(list(COLORS.values()))
        nearest = np.linalg.norm(color[:, :, None].astype(float) - known, axis=3).argmin(axis=2)
        ids = np.array(list(COLORS), np.int32)[nearest]
        return Segmentation(
            ids, tuple(Segment(i, LABELS[i], 1.0, LABELS[i] != "floor") for i in np.unique(ids).tolist())
        )

    return SimpleNamespace(
        name="colours", key="colours", labels=("chair", "floor"), is_thing=(True, False),
        prepare=lambda color: color, infer=lambda prepared: prepared, decode=decode,
    )  # fmt: skip
