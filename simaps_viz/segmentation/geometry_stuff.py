"""Floor and walls by geometry, for detectors that know only things: what lies flat at height 0, what stands tall.

Only pixels that no segment has are named, and only where the depth says enough: a wall has to be seen to rise above the
furniture, so a picture of its foot alone leaves it unnamed.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import Frame, Segment, Segmentation

FLOOR, WALL = "floor", "wall"


FLOOR_M = 0.10
"""The floor lies within this of height 0."""
FLAT = 0.85
"""Least vertical share of a floor's normal (cosine of its tilt)."""
UPRIGHT = 0.35
"""Largest vertical share of a wall's normal."""
WALL_TOP_M = 1.7
"""A wall is seen to reach this high; most furniture does not."""
EDGE = 0.04
"""A step in depth between samples of more than this share of the depth is an edge, where walls end."""
WALL_AREA = 0.005
"""Least share of the picture that one wall covers."""
COLUMNS = 180
"""Normals are taken on about this many samples a row."""
FAR_M = 8.0


def add_stuff(frame: Frame, segmentation: Segmentation, T_map_camera: NDArray) -> Segmentation:
    """Name unsegmented pixels floor or wall.

    Args:
        frame: its depth and camera are used.
        segmentation: of the same frame; its segments stay as they are.
        T_map_camera: float64 [4, 4], camera to map frame.
    """
    floor, wall = stuff_masks(frame, T_map_camera)
    free = segmentation.ids == 0
    ids, segments = segmentation.ids.copy(), list(segmentation.segments)
    number = max((s.id for s in segments), default=0)
    for label, mask in ((FLOOR, floor), (WALL, wall)):
        named = mask & free
        if named.any():
            number += 1
            ids[named] = number
            segments.append(Segment(number, label, 1.0, is_thing=False))
    return Segmentation(ids, tuple(segments))


def stuff_masks(frame: Frame, T_map_camera: NDArray) -> tuple[NDArray, NDArray]:
    """Find floor and walls in a depth image.

    Returns:
        bool [H, W] twice: floor, wall. A pixel without depth is neither.
    """
    height, width = frame.depth_m.shape
    step = max(1, round(width / COLUMNS))
    depth = np.ascontiguousarray(frame.depth_m[step // 2 :: step, step // 2 :: step])
    points = _map_points(depth, frame, T_map_camera, step)
    normal_z, known = _vertical_share(points, depth)
    known &= depth < FAR_M
    up = points[..., 2]
    floor = known & (np.abs(up) < FLOOR_M) & (normal_z > FLAT)
    wall = _tall(known & (np.abs(normal_z) < UPRIGHT), up, depth)
    valid = frame.depth_m > 0.0
    return tuple(_full_size(mask, height, width, step) & valid for mask in (floor, wall))  # pyright: ignore


def _map_points(depth: NDArray, frame: Frame, T_map_camera: NDArray, step: int) -> NDArray:
    k, first = frame.intrinsics, step // 2
    u = (np.arange(depth.shape[1]) * step + first - k.cx) / k.fx
    v = (np.arange(depth.shape[0]) * step + first - k.cy) / k.fy
    R, t = T_map_camera[:3, :3].astype(np.float32), T_map_camera[:3, 3].astype(np.float32)
    across, down = u[None].astype(np.float32), v[:, None].astype(np.float32)
    # By plane: with the coordinates last NumPy's inner loops would be three long.
    return cv2.merge([(across * r[0] + (down * r[1] + r[2])) * depth + shift for r, shift in zip(R, t, strict=True)])


def _vertical_share(points: NDArray, depth: NDArray) -> tuple[NDArray, NDArray]:
    """Return z of the surface's unit normal (float32 [h, w], towards the camera for floors: up) and where it is known.

    Points are averaged over 5 x 5 samples first, as depth cameras are noisy; differences reach two samples each way.
    """
    valid = (depth > 0.0).astype(np.float32)
    weight = cv2.blur(valid, (5, 5))
    mean = cv2.blur(points * valid[..., None], (5, 5)) / np.maximum(weight, 1e-6)[..., None]
    across = cv2.copyMakeBorder(mean, 2, 2, 2, 2, cv2.BORDER_REPLICATE)
    along_u = across[2:-2, 4:] - across[2:-2, :-4]
    along_v = across[4:, 2:-2] - across[:-4, 2:-2]
    (ax, ay, az), (bx, by, bz) = cv2.split(along_v), cv2.split(along_u)
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    known = (depth > 0.0) & (weight > 0.5) & (length > 1e-9)
    return nz / np.maximum(length, 1e-9), known


def _tall(upright: NDArray, up: NDArray, depth: NDArray) -> NDArray:
    """Keep the connected upright surfaces that reach above the furniture."""
    jump = np.zeros_like(upright)
    reach = EDGE * depth
    jump[:, 1:] |= np.abs(depth[:, 1:] - depth[:, :-1]) > reach[:, 1:]
    jump[1:] |= np.abs(depth[1:] - depth[:-1]) > reach[1:]
    apart = (upright & ~jump).astype(np.uint8)
    count, labelled, stats, _ = cv2.connectedComponentsWithStats(apart, connectivity=4)
    part = np.asarray(labelled, dtype=np.int64)
    top = np.full(count, -np.inf, dtype=np.float32)
    np.maximum.at(top, part.reshape(-1), up.reshape(-1))
    good = (top >= WALL_TOP_M) & (stats[:, cv2.CC_STAT_AREA] >= WALL_AREA * upright.size)
    good[0] = False
    grown = cv2.dilate(good[part].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return grown & upright


def _full_size(mask: NDArray, height: int, width: int, step: int) -> NDArray:
    small = mask.astype(np.uint8)
    repeated = cv2.resize(small, (small.shape[1] * step, small.shape[0] * step), interpolation=cv2.INTER_NEAREST)
    bottom, right = max(0, height - repeated.shape[0]), max(0, width - repeated.shape[1])
    padded = cv2.copyMakeBorder(repeated, 0, bottom, 0, right, cv2.BORDER_REPLICATE)
    return padded[:height, :width] > 0
