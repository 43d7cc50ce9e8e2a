"""Do poses drift? Frames of a place seen again are laid over one another; drift is what moving one of them explains.

Noise of the depth, blur and people who walk about make two visits of a place differ too, but no rigid motion of a
camera mends that.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from simaps_viz.checking.agreement import AGREES, Views, relative_poses, residuals

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
