"""Fits the camera matrix and the depth scale to what neighbouring frames see of the same surfaces.

Gauss-Newton with Tukey's weights whose reach shrinks in steps, and a weak pull for what the frames do not show: square
pixels, the principal point in the middle of the image, the stated focal length and depth scale.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import AGREES, Views, residuals

REACH = (0.25, 0.12, 0.06, 0.04)
"""Residuals beyond this share of the depth weigh nothing, stage by stage."""
STEPS = 10
"""Of Gauss-Newton a stage, at most."""
CONVERGED = 2e-4
"""A stage ends when no change of `ALL` steps further than this: 0.02 % of a focal length or of the depth scale."""
SPREAD = np.array([0.05, 0.1, 0.1, 0.5, 0.5])
"""Standard deviations of the pulls: log aspect, principal point (x, y) over focal length, log focal, log scale."""
POINTS_AS_ONE = 100.0
"""Neighbouring points err together; so many count as one against the pulls."""
DERIVATIVE_STEP = 3e-3
"""Wide enough that depth noise does not pass for slope."""
LARGEST_STEP = 0.15
"""Of any change of `ALL`, as slopes hold only nearby; a focal length twice too long takes five steps."""
LEAST_GAIN = 0.01
"""Of quality: where frames hardly overlap, any camera gains a little by chance."""
ROUNDING = 0.002
"""Residual that is always possible (depth in whole steps, poses of few digits)."""
STEEPEST = 8.0
"""Slopes of a residual by a change of `ALL`; changes move a surface's depth by about their own size, edges by leaps."""

SCALE = np.eye(5)[:, 4:]
FOCAL = np.array([[1.0, 1.0, 0, 0, 0]]).T
BOTH_FOCALS = np.eye(5)[:, :2]
CENTRE = np.eye(5)[:, 2:4]
FOCAL_AND_CENTRE = np.concatenate([FOCAL, CENTRE], axis=1)
CAMERA = np.eye(5)[:, :4]
ALL = np.eye(5)
"""What to fit: columns are directions of a change (log fx, log fy, cx / fx, cy / fy, log scale)."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Pairs of views and how they stand to each other: what a camera is judged by."""

    views: Views
    pairs: NDArray
    """int64 [p, 2], view indices (source, target)."""
    T_target_source: NDArray
    """float64 [p, 4, 4]."""
    size: tuple[int, int]
    """Of the whole image: width and height, pixels."""

    def residuals(self, camera: NDArray, unit_m: float, every: int = 1) -> NDArray:
        """Return float32 [p, s], see `agreement.residuals`."""
        return residuals(self.views, self.pairs, self.T_target_source, camera, unit_m, every)


@dataclass(frozen=True, eq=False)
class Fit:
    """A camera and a depth scale that fit."""

    camera: NDArray
    """float64 [4], fx, fy, cx, cy, pixels."""
    scale: float
    """Factor on the depth."""
    quality: float
    """See `quality`."""


def quality(residual: NDArray) -> float:
    """Mean over all samples of how well they agree: 1 at no residual, 0 at the tolerance, beyond or unseen."""
    sampled = max(int((~np.isnan(residual)).sum()), 1)
    seen = np.abs(residual[np.isfinite(residual)])
    return float(np.maximum(1.0 - seen / AGREES, 0.0).sum()) / sampled


def fit(sight: Sight, camera: NDArray, unit_m: float, directions: NDArray) -> Fit:
    """Fit along ``directions`` [5, k], beginning at ``camera`` and ``unit_m``."""
    change = np.zeros(5)

    def at(change: NDArray, every: int) -> NDArray:
        return sight.residuals(moved(camera, change), unit_m * float(np.exp(change[4])), every)

    for reach in REACH:
        every = 3 if reach > REACH[-1] else 1
        for _ in range(STEPS):
            now = at(change, every)
            ahead = [at(change + DERIVATIVE_STEP * d, every) for d in directions.T]
            step = directions @ _newton_step(now, ahead, reach, *_pull(camera, change, sight.size), directions)
            change = change + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
            if np.abs(step).max() < CONVERGED:
                break
    return Fit(moved(camera, change), float(np.exp(change[4])), quality(at(change, 1)))


def moved(camera: NDArray, change: NDArray) -> NDArray:
    """Return the camera fx, fy, cx, cy after a change (log fx, log fy, cx / fx, cy / fy, ...)."""
    fx, fy, cx, cy = camera
    return np.array([fx * np.exp(change[0]), fy * np.exp(change[1]), cx + change[2] * fx, cy + change[3] * fy])


def _pull(camera: NDArray, change: NDArray, size: tuple[int, int]) -> tuple[NDArray, NDArray]:
    """Return the pulls' errors [5], in standard deviations, and their derivatives by the change [5, 5]."""
    fx, fy, cx, cy = moved(camera, change)
    middle_x, middle_y = (size[0] - 1) / 2, (size[1] - 1) / 2
    errors = np.array([np.log(fx / fy), (cx - middle_x) / fx, (cy - middle_y) / fy, change[:2].mean(), change[4]])
    slopes = np.array([[1, -1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [0.5, 0.5, 0, 0, 0], [0, 0, 0, 0, 1.0]])
    return errors / SPREAD, slopes / SPREAD[:, None]


def _newton_step(
    now: NDArray, ahead: list[NDArray], reach: float, pull: NDArray, pull_slopes: NDArray, directions: NDArray
) -> NDArray:
    good = np.isfinite(now) & (np.abs(np.nan_to_num(now, posinf=np.inf)) < reach)
    slopes = []
    for other in ahead:
        slope = (np.where(good, other, np.inf).astype(np.float64) - np.where(good, now, 0)) / DERIVATIVE_STEP
        good &= np.isfinite(slope) & (np.abs(slope) < STEEPEST)  # a step across a depth edge is no slope
        slopes.append(slope)
    r = now[good].astype(np.float64)
    J = np.stack([slope[good] for slope in slopes], axis=-1)
    weight = (1 - (r / reach) ** 2) ** 2
    noise = max(float(np.sqrt((weight * r**2).sum() / max(weight.sum(), 1e-9))), ROUNDING)
    strength = weight / noise**2 / POINTS_AS_ONE
    along = pull_slopes @ directions
    hessian = (J * strength[:, None]).T @ J + along.T @ along
    gradient = J.T @ (strength * r) + along.T @ pull
    return -np.linalg.lstsq(hessian, gradient, rcond=None)[0]


_FACTORS = (1.0, 0.5, 2 / 3, 0.8, 1.25, 1.5, 2.0, 3.0, 1 / 3)
"""On focal lengths."""
_SUBSETS = {
    "scale": SCALE, "focal": FOCAL, "centre": CENTRE, "focals": BOTH_FOCALS, "focal and centre": FOCAL_AND_CENTRE,
    "camera": CAMERA, "all": ALL,
}  # fmt: skip
"""The simplest first."""
ENOUGH = 0.95
"""Share of the largest possible gain that a simpler explanation has to reach to be preferred."""


def best_fit(sight: Sight, camera: NDArray, unit_m: float, *, worth: float) -> tuple[str, Fit] | None:
    """Find the simplest change of camera and depth scale that explains nearly all of what any change can.

    Args:
        sight: What to judge by.
        camera: float64 [4], as stated.
        unit_m: As stated.
        worth: Relative gain of quality below which nothing is said to be wrong.

    Returns:
        What was changed and the fit; None when the stated values are good enough.
    """
    stated = quality(sight.residuals(camera, unit_m))
    start = _start(sight, camera, unit_m)
    whole = fit(sight, start, unit_m, ALL)
    if whole.quality < stated * (1 + worth) + LEAST_GAIN:
        return None
    found = {"all": whole}
    if not np.array_equal(start, camera):
        found["size"] = Fit(start, 1.0, quality(sight.residuals(start, unit_m)))
    for name, directions in _SUBSETS.items():
        if "size" in found and name == "scale":
            continue
        if any(one.quality - stated >= ENOUGH * (whole.quality - stated) for n, one in found.items() if n != "all"):
            break
        if name not in found:
            found[name] = fit(sight, start, unit_m, directions)
    best = max(one.quality for one in found.values())
    good = (name for name in ("size", *_SUBSETS) if name in found)
    return next((n, found[n]) for n in good if found[n].quality - stated >= ENOUGH * (best - stated))


def other_sizes(camera: NDArray, size: tuple[int, int]) -> list[NDArray]:
    """Return cameras made for images of other sizes, or of other focal lengths, with centres to match."""
    middle = (np.array(size, float) - 1) / 2
    guesses = []
    for factor in _FACTORS:
        focal = camera[:2] * factor
        guesses += [np.concatenate([focal, centre]) for centre in (camera[2:] * factor, camera[2:], middle)]
    return guesses


def _start(sight: Sight, camera: NDArray, unit_m: float) -> NDArray:
    """Return the camera to begin at: the stated one, unless one of another size or centre is far better."""
    guesses = [camera, *other_sizes(camera, sight.size)]
    scores = [quality(sight.residuals(guess, unit_m, 12)) for guess in guesses]
    best = int(np.argmax(scores))
    return guesses[best] if scores[best] > 1.5 * scores[0] + 0.02 else camera
