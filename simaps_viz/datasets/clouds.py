"""Render point clouds as depth images of a camera, so that all later steps are the same for both.

A cloud is thinner than a picture: between the points of a near thing those of what lies behind it are seen. They would
take its class, so a point is left out where nearer ones surround it. What is left needs no neighbours: every point
counts for the cell it falls in.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import Lens, see_through
from simaps_viz.datasets.gravity import Gravity, find_gravity
from simaps_viz.geometry import back_project, transform_points
from simaps_viz.structures import Frame, Intrinsics

NEAREST_M = 0.05
HIDDEN_STEP = 0.1
"""What lies behind the points around it by more than this share of its depth is hidden."""
WIDEST_GAP = 8
"""Pixels; a cloud thinner than one point in (2 x 8)^2 pixels leaves gaps through which hidden points show."""
COARSEST = 32
_DENSE = 0.6
"""Share of pixels with a reading that surfaces can be found in."""
_FLOOR_REACH_M, _FLOOR_POINTS = 0.1, 50


@dataclass(frozen=True)
class CloudSettings:
    """How clouds become depth images."""

    hidden_pixels: int | None = None
    """Points are hidden by nearer ones that are no more than so many pixels away; None = as the cloud's gaps are."""
    fill_pixels: int = 0
    """Pixels without a point take the depth of the nearest one that is no more than so many pixels away. Method paper
    links neighbouring pixels and needs this; method evidence does not."""


def depth_of_cloud(points_camera: NDArray, k: Intrinsics, settings: CloudSettings) -> NDArray:
    """Render a cloud: every point falls in its nearest pixel, the nearest point of a pixel wins.

    Args:
        points_camera: float64 [n, 3], camera axes, metres.
        k: the camera.
        settings: which points are hidden, and which gaps are filled.

    Returns:
        float32 [H, W], metres along the optical axis, 0 = no point.
    """
    depth_m = _z_buffer(points_camera, k)
    hidden = gap_pixels(depth_m) if settings.hidden_pixels is None else settings.hidden_pixels
    if hidden > 0:
        depth_m[_hidden(depth_m, hidden)] = 0.0
    return _fill(depth_m, settings.fill_pixels) if settings.fill_pixels > 0 else depth_m


def register_depth(depth_m: NDArray, lens: Lens, T_camera_depth: NDArray, target: Intrinsics) -> NDArray:
    """Return the depth image that another camera beside the one that took it would have taken.

    Args:
        depth_m: float32 [H, W], metres, 0 = invalid.
        lens: the camera that took it.
        T_camera_depth: [4, 4], takes its points to the other camera's frame.
        target: the other camera, no finer than the first, or there are gaps wider than a pixel.

    Returns:
        float32 [H, W] of ``target``, metres, 0 = invalid.
    """
    k = lens.intrinsics
    straight = see_through(depth_m, lens, k, exact=True)
    points = back_project(straight, k.fx, k.fy, k.cx, k.cy)[straight > 0]
    share = max(k.fx / target.fx, 1.0)  # where several points fall in a pixel, its centre's counts, not the nearest
    fine = Lens(target).scaled(round(target.width * share), round(target.height * share)).intrinsics
    seen = depth_of_cloud(camera_points(points, T_camera_depth), fine, CloudSettings(fill_pixels=1))
    return see_through(seen, Lens(fine), target, exact=True)


def gap_pixels(depth_m: NDArray) -> int:
    """Return half the usual distance of a sparse depth image's readings, whole pixels; 0 for a full one."""
    share = _share(depth_m)
    return 0 if share is None else min(int(0.5 / np.sqrt(share) + 0.25), WIDEST_GAP)


def _share(depth_m: NDArray) -> float | None:
    """Return the share of pixels with a reading in the rectangle around all readings; None where there are none."""
    filled = depth_m > 0
    rows, cols = np.flatnonzero(filled.any(axis=1)), np.flatnonzero(filled.any(axis=0))
    return float(filled[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1].mean()) if len(rows) else None


def gravity_of_clouds(
    clouds: list[tuple[NDArray, NDArray]], k: Intrinsics, up: tuple[float, float, float] | None
) -> Gravity:
    """Estimate up and the floor's height from clouds, seen by a camera coarse enough to have no gaps.

    Args:
        clouds: (points in camera axes [n, 3], T_world_camera [4, 4]) of some forty frames.
        k: the camera.
        up: known already; only the floor is looked for.
    """
    divide = 1
    while divide < COARSEST and _fullness(clouds, _coarse(k, divide)) < _DENSE:
        divide *= 2
    camera = _coarse(k, divide)
    frames = [
        Frame(
            i, str(i), _z_buffer(points, camera) if divide == 1 else _averaged(points, camera), T_world_camera, camera
        )
        for i, (points, T_world_camera) in enumerate(clouds)
    ]
    found = find_gravity(frames, up=None if up is None else np.array(up))
    if divide == 1 or found.floor_note:
        return found
    return replace(found, floor_height_m=_sharper(clouds, found.up, found.floor_height_m))


def camera_points(points: NDArray, T_camera_points: NDArray) -> NDArray:
    """Move a cloud to the camera and drop what lies behind it."""
    moved = transform_points(T_camera_points, points)
    return moved[moved[:, 2] > NEAREST_M]


def _z_buffer(points_camera: NDArray, k: Intrinsics) -> NDArray:
    pixel, z = _pixels(points_camera, k)
    nearest = np.full(k.height * k.width, np.inf, np.float32)
    np.minimum.at(nearest, pixel, z.astype(np.float32))
    nearest[np.isinf(nearest)] = 0.0
    return nearest.reshape(k.height, k.width)


def _averaged(points_camera: NDArray, k: Intrinsics) -> NDArray:
    """The depth of each large pixel's front surface at its centre: on a plane, 1 / depth is linear in u and v."""
    pixel, z = _pixels(points_camera, k)
    front = z < _z_buffer(points_camera, k).ravel()[pixel] * (1.0 + 2 * HIDDEN_STEP)
    size = k.height * k.width
    points = np.bincount(pixel[front], minlength=size)
    inverse = np.bincount(pixel[front], weights=1.0 / z[front], minlength=size)
    return np.divide(points, inverse, out=np.zeros(size), where=points > 0).astype(np.float32).reshape(k.height, -1)


def _pixels(points_camera: NDArray, k: Intrinsics) -> tuple[NDArray, NDArray]:
    """Return the pixel (v * width + u) and the depth of every point that falls in the picture."""
    front = points_camera[points_camera[:, 2] > NEAREST_M]
    z = front[:, 2]
    u = np.rint(front[:, 0] / z * k.fx + k.cx)
    v = np.rint(front[:, 1] / z * k.fy + k.cy)
    inside = (u >= 0) & (u < k.width) & (v >= 0) & (v < k.height)
    return v[inside].astype(np.int64) * k.width + u[inside].astype(np.int64), z[inside]


def _sharper(clouds: list[tuple[NDArray, NDArray]], up: NDArray, floor_height_m: float) -> float:
    """Move a floor found by coarse pixels to where the points are densest around it, metres."""
    heights = np.concatenate([transform_points(T, points) @ up for points, T in clouds])
    near = heights[np.abs(heights - floor_height_m) < _FLOOR_REACH_M]
    if len(near) < _FLOOR_POINTS:
        return floor_height_m
    counts, edges = np.histogram(near, bins=25)
    window = np.convolve(counts, np.ones(5), mode="same")
    centre = (edges[np.argmax(window)] + edges[np.argmax(window) + 1]) / 2
    return float(np.median(near[np.abs(near - centre) < _FLOOR_REACH_M / 5]))


def _hidden(depth_m: NDArray, pixels: int) -> NDArray:
    """Return which readings lie well behind another one in the square around them, bool [H, W]."""
    far = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    surface = cv2.erode(far, np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8))
    return (depth_m > 0) & (surface < depth_m * np.float32(1.0 - HIDDEN_STEP))


def _fill(depth_m: NDArray, pixels: int) -> NDArray:
    if not (depth_m > 0).any():
        return depth_m
    empty = (depth_m <= 0).astype(np.uint8)
    distance, nearest = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    number = np.asarray(nearest, dtype=np.int64)
    depth_of = np.zeros(int(number.max()) + 1, np.float32)
    depth_of[number[empty == 0]] = depth_m[empty == 0]
    return np.where(np.asarray(distance) <= pixels, depth_of[number], np.float32(0.0))


def _coarse(k: Intrinsics, divide: int) -> Intrinsics:
    """Return the camera with pixels so many times larger."""
    if divide == 1:
        return k
    width, height = max(k.width // divide, 1), max(k.height // divide, 1)
    return Intrinsics(width, height, k.fx / divide, k.fy / divide, (k.cx + 0.5) / divide - 0.5,
                      (k.cy + 0.5) / divide - 0.5)  # fmt: skip


def _fullness(clouds: list[tuple[NDArray, NDArray]], k: Intrinsics) -> float:
    shares = [share for points, _ in clouds if (share := _share(_z_buffer(points, k))) is not None]
    return float(np.median(shares)) if shares else 0.0
