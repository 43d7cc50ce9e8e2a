"""Small random frames with several segments at several depths, for comparing the kernels with their twins."""

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation

LABELS = ("none", "chair", "floor", "table")
IS_THING = (False, True, False, True)


def random_rotation(rng: np.random.Generator) -> NDArray:
    """A camera that looks more or less down, so that cells are hit often."""
    yaw, tilt = rng.uniform(-np.pi, np.pi), rng.uniform(-0.6, 0.6)
    down = np.diag([1.0, -1.0, -1.0])
    z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    return z @ x @ down


def random_frames(seed: int, frames: int = 3) -> list[tuple[Frame, Segmentation, NDArray]]:
    """Return (frame, segmentation, T_map_camera) with blocky segments, noisy blocky depth and holes."""
    rng = np.random.default_rng(seed)
    width, height = 40, 30
    intrinsics = Intrinsics(width, height, 35.0, 36.0, 19.2, 14.7)
    result = []
    for index in range(frames):
        blocks = rng.integers(0, 5, (5, 6))
        ids = np.kron(blocks, np.ones((6, 7), int))[:height, :width].astype(np.int32)
        depth = np.kron(rng.uniform(1.0, 2.2, (5, 6)), np.ones((6, 7)))[:height, :width]
        depth = depth + rng.normal(0, 0.02, depth.shape)
        depth[rng.random(depth.shape) < 0.05] = 0.0
        depth[rng.random(depth.shape) < 0.02] = 7.0
        T = np.eye(4)
        T[:3, :3] = random_rotation(rng)
        T[:3, 3] = (*rng.uniform(-0.5, 0.5, 2), rng.uniform(1.6, 2.4))
        segments = tuple(Segment(i, str(rng.choice(LABELS[1:])), float(rng.random()), True) for i in range(1, 5))
        segments = tuple(Segment(s.id, s.label, s.score, s.label != "floor") for s in segments)
        frame = Frame(index, f"{index}", depth.astype(np.float32), T, intrinsics)
        result.append((frame, Segmentation(ids, segments), T))
    return result
