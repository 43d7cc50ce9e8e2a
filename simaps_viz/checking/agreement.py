"""How well frames agree: surface points of one frame, seen from another, have to lie at the depth measured there.

A point of frame i is back-projected, moved to frame j and compared with the depth of the pixel it falls on. Residuals
are shares of that depth, so that a hypothesis cannot win by making everything small.

Whether poses drift is read off frames of a place seen again: drift is what moving one of two such frames explains.
Noise of the depth, blur and people who walk about make two visits of a place differ too, but no rigid motion of a
camera mends that.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

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


DISTURBED = 0.06
"""Share of a pair's surfaces that is seen through from which on it is worth a closer look."""
NEAR_M = 1.25
"""Depth is taken as no less than this: nearer by, what counts as agreement is a twentieth of a metre, a map's cell."""
REACH = (0.6, 0.3, 0.15, 0.08, 0.05)
"""Residuals beyond this share of the depth weigh nothing, stage by stage."""
STEPS = 4
"""Steps of Gauss-Newton a stage."""
DAMPING = 1e-3
"""Keeps a motion that the surfaces do not show, such as along a bare wall, small."""
DERIVATIVE_STEP = 2e-3
STEEPEST = 8.0
MENDED, FITS = 0.12, 0.5
"""A pair has drifted if moving it raises agreement by more than the first, to more than the second ..."""
OFF_M = 0.1
"""... and moves its surfaces by more than this: two of a map's cells."""
FEWEST, SHARE = 3, 0.3
"""So many pairs, and this share of those that disagree, have to have drifted."""
JITTER = 3.0
"""Places seen again have to be off by so many times as much as neighbouring frames."""
OVERLAP = 0.15
"""Share of a view's points that have to fall on something measured."""


@dataclass(frozen=True)
class Drift:
    """What places seen again show."""

    agreement: float
    """Share of the surfaces seen twice that agree as the poses are (0-1)."""
    mended: float
    """The same after each pair was moved."""
    off_m: float
    """Median distance by which surfaces are off."""


def find_drift(
    views: Views, pairs: NDArray, neighbours: NDArray, poses: NDArray, camera: NDArray, unit_m: float
) -> Drift | None:
    """Look for drift in pairs of views of one place.

    Args:
        views: Depth images.
        pairs: int64 [p, 2], views (source, target) of one place, far apart in time.
        neighbours: int64 [n, 2], the same of views taken shortly after one another: poses that are off from frame to
            frame, as where times do not match, are no drift.
        poses: float64 [n, 4, 4], T_world_camera of all frames.
        camera: float64 [4], fx, fy, cx, cy, pixels.
        unit_m: Metres a step of depth.

    Returns:
        None when poses do not drift, or too few places are seen again to tell.
    """

    def compare(chosen: NDArray, T: NDArray, every: int = 1) -> NDArray:
        return residuals(views, chosen, T, camera, unit_m, every, NEAR_M)

    T = relative_poses(poses, views.frames, pairs)
    now = compare(pairs, T)
    sampled = np.maximum((~np.isnan(now)).sum(axis=1), 1)
    overlap = np.isfinite(now).sum(axis=1) > OVERLAP * sampled
    through = (now < -AGREES).sum(axis=1) / np.maximum((now < AGREES).sum(axis=1), 1)
    suspects = overlap & (through > DISTURBED)
    if suspects.sum() < FEWEST:
        return None
    pairs, T = pairs[suspects], T[suspects]
    found = _align(compare, pairs, T)
    before, after = _agreeing(compare(pairs, T)), _agreeing(compare(pairs, found))
    off_m = _moved_m(views, pairs, T, found, camera, unit_m)
    drifted = (after > before + MENDED) & (after > FITS) & (off_m > OFF_M)
    if drifted.sum() < max(FEWEST, SHARE * len(pairs)):
        return None
    T = relative_poses(poses, views.frames, neighbours)
    T, neighbours = T[np.isfinite(T).all(axis=(1, 2))], neighbours[np.isfinite(T).all(axis=(1, 2))]
    jitter_m = np.median(_moved_m(views, neighbours, T, _align(compare, neighbours, T), camera, unit_m))
    if np.median(off_m[drifted]) < JITTER * jitter_m:
        return None
    return Drift(float(before[drifted].mean()), float(after[drifted].mean()), float(np.median(off_m[drifted])))


def _agreeing(residual: NDArray) -> NDArray:
    """Return for each pair the share of the points not hidden that agree, float64 [p]."""
    return (np.abs(residual) <= AGREES).sum(axis=1) / np.maximum((residual <= AGREES).sum(axis=1), 1)


def _align(compare: Callable[..., NDArray], pairs: NDArray, T: NDArray) -> NDArray:
    """Move each source view so that it lies on its target: Gauss-Newton over six numbers a pair, Tukey's weights."""
    T = T.copy()
    for reach in REACH:
        every = 3 if reach > REACH[-1] else 2
        for _ in range(STEPS):
            now = compare(pairs, T, every)
            good = np.isfinite(now) & (np.abs(now) < reach)
            slopes = []
            for axis in np.eye(6):
                ahead = compare(pairs, _moved(T, DERIVATIVE_STEP * axis), every)
                slope = (np.where(good, ahead, np.nan) - now) / DERIVATIVE_STEP
                good &= np.isfinite(slope) & (np.abs(slope) < STEEPEST)
                slopes.append(slope)
            r = np.where(good, now, 0).astype(np.float64)
            J = np.where(good[..., None], np.stack(slopes, axis=-1), 0).astype(np.float64)
            weight = np.where(good, (1 - (r / reach) ** 2) ** 2, 0)
            hessian = np.einsum("psi,ps,psj->pij", J, weight, J)
            hessian += DAMPING * np.maximum(np.trace(hessian, axis1=1, axis2=2), 1)[:, None, None] * np.eye(6)
            gradient = np.einsum("psi,ps,ps->pi", J, weight, r)
            T = _moved(T, -np.linalg.solve(hessian, gradient[..., None])[..., 0])
    return T


def _moved(T: NDArray, change: NDArray) -> NDArray:
    """Turn and move transforms [p, 4, 4] by rotation vectors and lengths, [6] or [p, 6]."""
    change = np.tile(change, (len(T), 1)) if change.ndim == 1 else change
    step = np.tile(np.eye(4), (len(T), 1, 1))
    step[:, :3, :3], step[:, :3, 3] = Rotation.from_rotvec(change[:, :3]).as_matrix(), change[:, 3:]
    return step @ T


def _moved_m(views: Views, pairs: NDArray, a: NDArray, b: NDArray, camera: NDArray, unit_m: float) -> NDArray:
    """Return how far apart two transforms put the middle of each pair's surfaces, metres [p]."""
    fx, fy, cx, cy = views.camera(camera)
    out = np.zeros(len(pairs))
    for p, (source, _) in enumerate(pairs):
        u, v = views.pixels[source][views.pixels[source][:, 0] >= 0].T
        z = views.steps[source, v, u] * unit_m
        middle = np.append(np.median(np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z]), axis=1), 1.0)
        out[p] = np.linalg.norm((a[p] - b[p]) @ middle)
    return out
