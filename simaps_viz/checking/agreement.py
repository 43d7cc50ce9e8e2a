"""How well frames agree: surface points of one frame, seen from another, have to lie at the depth measured there.

A point of frame i is back-projected, moved to frame j and compared with the depth of the pixel it falls on. Residuals
are shares of that depth, so that a hypothesis cannot win by making everything small.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

AGREES = 0.04
"""A residual up to this share of the depth is agreement; depth noise and rounding of poses stay far below."""


@dataclass(frozen=True, eq=False)
class Views:
    """Depth images of chosen frames, in memory, with points sampled on their smooth surfaces."""

    frames: NDArray
    """int64 [f], index of each view's frame in the sequence, rising."""
    steps: NDArray
    """uint16 [f, h, w], depth as stored, every ``stride``-th pixel, 0 = invalid."""
    stride: int
    pixels: NDArray
    """int32 [f, s, 2], (u, v) of sampled pixels in ``steps``; u = -1 = no sample."""

    def camera(self, camera: NDArray) -> NDArray:
        """Scale a camera (fx, fy, cx, cy) from pixels of the full image to those of ``steps``."""
        return np.asarray(camera, np.float64) / self.stride


@dataclass(frozen=True)
class Agreement:
    """Summary of the residuals of some pairs of views."""

    share: float
    """Share of the points that fall on a measured pixel and agree with it, among those that fall on one (0-1)."""
    kept: float
    """Share of all points that fall on a measured pixel and agree with it (0-1)."""
    median: float
    """Absolute residual, share of the depth; NaN when nothing was seen."""

    def percent(self) -> int:
        """Return ``share`` in whole percent."""
        return round(100 * self.share)


def residuals(
    views: Views,
    pairs: NDArray,
    T_target_source: NDArray,
    camera: NDArray,
    unit_m: float,
    every: int = 1,
    near_m: float = 0.0,
) -> NDArray:
    """Compare sampled points of source views with the depth of target views.

    Args:
        views: The depth images.
        pairs: int64 [p, 2], indices (source, target) into ``views``.
        T_target_source: float64 [p, 4, 4], source camera to target camera, metres.
        camera: float64 [4], fx, fy, cx, cy of the full image, pixels.
        unit_m: Metres a step of depth.
        every: Take only every so-manieth sample.
        near_m: Least depth that residuals are shares of.

    Returns:
        float32 [p, s], (expected - measured) / measured depth; NaN = no sample, infinite = fell on nothing measured,
        or on a depth jump.
    """
    pixels = np.ascontiguousarray(views.pixels[:, ::every])
    out = np.full((len(pairs), pixels.shape[1]), np.nan, np.float32)
    if len(pairs):
        transforms = np.ascontiguousarray(T_target_source, np.float64)
        _residuals(views.steps, pixels, pairs, transforms, views.camera(camera), float(unit_m), near_m, out)
    return out


def summarise(residual: NDArray) -> Agreement:
    """Pool the residuals [p, s] of some pairs."""
    sampled = int((~np.isnan(residual)).sum())
    seen = np.abs(residual[np.isfinite(residual)])
    agreeing = int((seen <= AGREES).sum())
    return Agreement(
        share=agreeing / max(len(seen), 1),
        kept=agreeing / max(sampled, 1),
        median=float(np.median(seen)) if len(seen) else float("nan"),
    )


def kept_by_pair(residual: NDArray) -> NDArray:
    """Return for each pair the share of its samples that agree, float64 [p]."""
    sampled = (~np.isnan(residual)).sum(axis=1)
    return (np.abs(residual) <= AGREES).sum(axis=1) / np.maximum(sampled, 1)


def relative_poses(poses: NDArray, frames: NDArray, pairs: NDArray) -> NDArray:
    """Return T_target_source [p, 4, 4] for pairs of views whose frames have ``poses`` [n, 4, 4], T_world_camera."""
    source, target = poses[frames[pairs[:, 0]]], poses[frames[pairs[:, 1]]]
    rotation = target[:, :3, :3].transpose(0, 2, 1)
    out = np.zeros((len(pairs), 4, 4))
    out[:, :3, :3] = rotation @ source[:, :3, :3]
    out[:, :3, 3] = np.einsum("pij,pj->pi", rotation, source[:, :3, 3] - target[:, :3, 3])
    out[:, 3, 3] = 1.0
    return out


@njit(cache=True)
def _residuals(steps, pixels, pairs, transforms, camera, unit_m, near_m, out):
    fx, fy, cx, cy = camera
    height, width = steps.shape[1:]
    for p in range(len(pairs)):
        source, target = pairs[p]
        T = transforms[p]
        for s in range(pixels.shape[1]):
            u, v = pixels[source, s]
            if u < 0:
                continue
            out[p, s] = np.inf
            z = steps[source, v, u] * unit_m
            x = (u - cx) / fx * z
            y = (v - cy) / fy * z
            depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            if depth <= 1e-9:
                continue
            column = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / depth * fx + cx
            row = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / depth * fy + cy
            if not (0.0 <= column < width - 1 and 0.0 <= row < height - 1):
                continue
            measured = _interpolated(steps[target], column, row) * unit_m
            if measured > 0:
                out[p, s] = (depth - measured) / max(measured, near_m)


@njit(cache=True)
def _interpolated(image, column, row):
    """Bilinear depth; 0 where one of the four is invalid or they are of different surfaces."""
    u, v = int(column), int(row)
    a, b = float(image[v, u]), float(image[v, u + 1])
    c, d = float(image[v + 1, u]), float(image[v + 1, u + 1])
    low, high = min(a, b, c, d), max(a, b, c, d)
    if low <= 0 or high > 1.1 * low:
        return 0.0
    du, dv = column - u, row - v
    return (a * (1 - du) + b * du) * (1 - dv) + (c * (1 - du) + d * du) * dv
