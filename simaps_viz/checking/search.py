"""Try the ways poses and depth are usually written wrongly, and keep the simplest that makes frames agree.

Camera matrix and depth scale are then fitted to what neighbouring frames see of the same surfaces: Gauss-Newton with
Tukey's weights whose reach shrinks in steps, and a weak pull for what the frames do not show (square pixels, the
principal point in the middle of the image, the stated focal length and depth scale). Last come poses that belong to
other frames: all shifted, or shifted from some frame on, as after a dropped frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import AGREES, Agreement, Views, kept_by_pair, relative_poses, residuals, summarise
from simaps_viz.checking.recording import (
    BASES,
    FORMS,
    GAP,
    OPENGL,
    PLAIN,
    ROS,
    Convention,
    Reading,
    Recording,
    conventions,
    in_views,
    load_views,
)
from simaps_viz.datasets.sequence import DEPTH_RANGE_M
from simaps_viz.events import Progress

REACH = (0.25, 0.12, 0.06, 0.04)
"""Residuals beyond this share of the depth weigh nothing, stage by stage."""
STEPS = 10
"""Steps of Gauss-Newton a stage, at most."""
CONVERGED = 2e-4
"""A stage ends when no change of `ALL` steps further than this: 0.02 % of a focal length or of the depth scale."""
SPREAD = np.array([0.05, 0.1, 0.1, 0.5, 0.5])
"""Standard deviations of the pulls: log aspect, principal point (x, y) over focal length, log focal, log scale."""
POINTS_AS_ONE = 100.0
"""Neighbouring points err together; so many count as one against the pulls."""
DERIVATIVE_STEP = 3e-3
"""Wide enough that depth noise does not pass for slope."""
MAX_STEP = 0.15
"""Limit of any change of `ALL`, as slopes hold only nearby; a focal length twice too long takes five steps."""
MIN_GAIN = 0.01
"""Gain of quality that counts: where frames hardly overlap, any camera gains a little by chance."""
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
    """Width and height of the image, pixels."""

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
            change = change + np.clip(step, -MAX_STEP, MAX_STEP)
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
    if whole.quality < stated * (1 + worth) + MIN_GAIN:
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


USUAL_M = (0.001, 0.0002, 0.00025, 0.0001, 0.0005, 0.01, 0.1, 1.0, 1e-6, 1 / 256, 1e-5)
"""Metres a step that cameras and datasets use."""
SNAP = 0.03
"""A found unit this close to a usual one is that one."""
TYPICAL_M = 2.2
"""Median depth of a room; only the order of magnitude matters."""
ROOM_M = (0.5, 8.0)
"""Where the median depth of a room usually lies."""


def median_depth_m(views: Views, unit_m: float) -> float:
    """Return the median depth of all views."""
    steps = views.steps[:, ::4, ::4]
    return float(np.median(steps[steps > 0])) * unit_m


def positions_are_wrong(views: Views, unit_m: float, depth_factor: float) -> bool:
    """Whether the stated depth is more like a room's than after the factor: then the positions' unit is wrong."""
    stated = median_depth_m(views, unit_m)
    return abs(np.log(stated / TYPICAL_M)) < abs(np.log(stated * depth_factor / TYPICAL_M))


def snapped_unit(unit_m: float) -> float:
    """Return the usual unit close by, or the unit itself."""
    near = [usual for usual in USUAL_M if abs(np.log(unit_m / usual)) < SNAP]
    return near[0] if near else unit_m


def likely_units(views: Views, unit_m: float) -> list[float]:
    """Usual units that make a room of an impossible depth; none when the depth is possible or nothing helps."""
    median = median_depth_m(views, unit_m)
    if DEPTH_RANGE_M[0] <= median <= DEPTH_RANGE_M[1]:
        return []
    return [usual for usual in USUAL_M if ROOM_M[0] <= median / unit_m * usual <= ROOM_M[1]]


FACTORS = (1.0, 1e-3, 1e3, 0.1, 10.0, 0.2, 5.0, 0.25, 4.0, 0.01, 100.0, 0.5, 2.0, 1e-6, 1e6, 256 / 1000, 1000 / 256)
"""On the depth: units mistaken for one another."""
SHIFTS = (-1, 1, -2, 2, -3, 3)
USUAL = 2
"""Stranger conventions (see `Convention.changes`) are tried with the stated depth and no shift only."""
GAIN, GAIN_SHARE = 0.05, 0.2
"""What a hypothesis has to gain on the files' own word: of all points, and in proportion."""
BETTER, BETTER_PAIRS, FEWEST = 0.03, 0.3, 4
"""A pair is better by more than the first; this share of all pairs has to be, and this many."""
NEARLY = 0.97
"""Share of the best score that makes a simpler hypothesis as good."""
_COARSE, _COARSE_PAIRS, _FINALISTS = 10, 24, 14


@dataclass(frozen=True, eq=False)
class Scored:
    """A hypothesis and how well frames agree under it."""

    reading: Reading
    agreement: Agreement


def mirrored(recording: Recording) -> bool:
    """Return whether most of the written rotations are mirrored."""
    return bool(np.median(np.linalg.det(recording.matrices[:, :3, :3])) < 0)


def score(recording: Recording, views: Views, pairs: NDArray, reading: Reading, every: int = 1) -> Agreement:
    """Measure how well pairs of views agree under a reading; pairs without poses do not count as seen."""
    return summarise(reading.residuals(recording, views, pairs, every))


def search(recording: Recording, views: Views, pairs: NDArray) -> list[Scored]:
    """Score the hypotheses about conventions, depth unit and shift.

    Returns:
        The chosen one, the files' own word (the same when nothing is better), then others worth showing.
    """
    ways = conventions(mirrored=mirrored(recording))
    finalists = [
        Scored(reading, score(recording, views, pairs, reading))
        for reading in _promising(recording, views, pairs, ways)
    ]
    stated = Scored(Reading(), score(recording, views, pairs, Reading()))
    best = max(one.agreement.kept for one in finalists)
    good = [one for one in finalists if one.agreement.kept >= NEARLY * best]
    chosen = min(good, key=lambda one: (complexity(one.reading), -one.agreement.kept))
    proper = not mirrored(recording)
    if proper and chosen.agreement.kept < stated.agreement.kept * (1 + GAIN_SHARE) + GAIN:
        chosen = stated
    if proper and not _supported(recording, views, pairs, chosen.reading):
        chosen = stated
    shown = _worth_showing(chosen.reading, proper)
    return [chosen, stated, *(Scored(reading, score(recording, views, pairs, reading)) for reading in shown)]


def _supported(recording: Recording, views: Views, pairs: NDArray, reading: Reading) -> bool:
    """Return whether enough pairs agree better than as the files are, so that chance cannot choose among thousands."""
    stated, found = (kept_by_pair(one.residuals(recording, views, pairs)) for one in (Reading(), reading))
    better = int((found > stated + BETTER).sum())
    return better >= max(FEWEST, BETTER_PAIRS * len(pairs))


def _promising(recording: Recording, views: Views, pairs: NDArray, ways: list[Convention]) -> list[Reading]:
    """Score everything on few points, and return what comes near the best, the simplest first."""
    few = pairs[:: max(1, len(pairs) // _COARSE_PAIRS)]
    tried, kept = [], []
    for way in ways:
        plain = Reading(convention=way)
        usual = way.changes <= USUAL and way.turned_positions == PLAIN
        groups = [[plain if f == 1 else replace(plain, depth_factor=f) for f in (FACTORS if usual else FACTORS[:1])]]
        groups += [[replace(plain, shift=shift)] for shift in SHIFTS] if usual else []
        for group in groups:  # of readings that share their poses
            T_target_source = relative_poses(group[0].poses(recording), views.frames, few)
            for reading in group:
                unit_m = reading.unit_m(recording)
                residual = residuals(views, few, T_target_source, recording.camera, unit_m, _COARSE)
                tried.append(reading)
                kept.append(float((np.abs(residual) <= AGREES).sum()))
    T_target_source = relative_poses(recording.matrices, views.frames, few)
    for camera in other_sizes(recording.camera, recording.depth_size):
        residual = residuals(views, few, T_target_source, camera, recording.unit_m, _COARSE)
        tried.append(Reading(camera=camera))
        kept.append(float((np.abs(residual) <= AGREES).sum()))
    order = np.argsort(-np.array(kept), kind="stable")
    near = [i for i in range(len(tried)) if kept[i] >= 0.93 * kept[order[0]]]
    return [tried[i] for i in sorted({*order[:_FINALISTS].tolist(), *near[:_FINALISTS]})]


def complexity(reading: Reading) -> int:
    """Count the unusual assumptions of a reading."""
    return (
        reading.convention.changes + (reading.depth_factor != 1) + (reading.shift != 0) + (reading.camera is not None)
    )


def _worth_showing(chosen: Reading, proper: bool) -> Sequence[Reading]:
    """Return the well-known mistakes, for comparison."""
    way = chosen.convention
    ways = [replace(way, form=form) for form in FORMS[:2]]
    ways += [replace(way, axes=axes) for axes in (PLAIN, OPENGL, ROS)] if proper else []
    found = [replace(chosen, convention=other) for other in ways]
    found += [replace(chosen, depth_factor=factor) for factor in (1.0, 0.1, 10.0, 0.001, 1000.0, 0.2, 5.0)]
    found += [replace(chosen, shift=shift) for shift in (0, -1, 1)]
    keys = {_key(chosen), _key(Reading())}
    return [r for r in found if not (_key(r) in keys or keys.add(_key(r)))]


def _key(reading: Reading) -> tuple[Convention, float, float]:
    return reading.convention, reading.depth_factor, reading.shift


ALL_SHIFTS = (0, *SHIFTS)
SHIFT_GAIN = 0.05
"""Relative gain of quality that a shift has to bring ..."""
FRACTIONS = tuple(i / 4 for i in range(-3, 4))
MIN_FRACTION = 0.1
"""Of a frame; less does not matter."""
OFFSET_GAIN = 0.01
"""Relative gain of quality that a fraction of a frame has to bring."""
SURE = 3.0
"""... and how many standard errors of its mean over the pairs that has to be."""
FEWEST_BY_JUMP = 4
"""Pairs on either side of a jump."""


@dataclass(frozen=True, eq=False)
class Shifts:
    """How well each pair of views agrees with its poses shifted."""

    quality: NDArray
    """float64 [p, len(ALL_SHIFTS)], mean over samples, 0-1; NaN where a pose is missing."""
    earlier: NDArray
    """int64 [p], the earlier frame of each pair."""
    later: NDArray


def measure(recording: Recording, views: Views, pairs: NDArray, reading: Reading) -> Shifts:
    """Score every pair with poses written for frames a little before or after."""
    table = np.full((len(pairs), len(ALL_SHIFTS)), np.nan)
    for column, shift in enumerate(ALL_SHIFTS):
        shifted = replace(reading, shift=shift, shift_later=None)
        posed = shifted.posed_pairs(recording, views, pairs)
        table[posed, column] = quality_by_pair(shifted.residuals(recording, views, pairs[posed]))
    frames = views.frames[pairs]
    return Shifts(table, frames.min(axis=1), frames.max(axis=1))


def quality_by_pair(residual: NDArray) -> NDArray:
    """Return for each pair the mean over its samples of 1 at no residual, 0 at the tolerance or unseen; float64 [p]."""
    good = np.maximum(1 - np.abs(np.where(np.isfinite(residual), residual, np.inf)) / AGREES, 0)
    return good.sum(axis=1) / np.maximum((~np.isnan(residual)).sum(axis=1), 1)


def best_shift(shifts: Shifts, current: int = 0) -> int:
    """Return the shift that most pairs want, or the current one when none is clearly better."""
    table = shifts.quality[np.isfinite(shifts.quality).all(axis=1)]
    if len(table) < 2:
        return current
    column = int(table.mean(axis=0).argmax())
    before = table[:, ALL_SHIFTS.index(current)]
    return ALL_SHIFTS[column] if _clear(table[:, column] - before, before.mean()) else current


def best_offset(recording: Recording, views: Views, pairs: NDArray, reading: Reading) -> float:
    """Return the shift of poses, to fractions of a frame, that fits better than the reading's whole number of frames.

    Interpolated poses are smoother than written ones, which alone makes frames agree better; so a shift also has to fit
    better than the same one the other way.
    """

    def quality(shift: float) -> NDArray:
        moved = replace(reading, shift=shift)
        posed, found = moved.posed_pairs(recording, views, pairs), np.full(len(pairs), np.nan)
        found[posed] = quality_by_pair(moved.residuals(recording, views, pairs[posed]))
        return found

    tried = np.stack([quality(reading.shift + fraction) for fraction in FRACTIONS])
    tried = tried[:, np.isfinite(tried).all(axis=0)]
    if tried.shape[1] < FEWEST_BY_JUMP:
        return reading.shift
    mean = tried.mean(axis=1)
    at = int(np.clip(np.argmax(mean), 1, len(mean) - 2))
    before, top, after = mean[at - 1 : at + 2]  # the top of the parabola through these is where it fits best
    bend = before - 2 * top + after
    step = FRACTIONS[1] - FRACTIONS[0]
    fraction = FRACTIONS[at] + float(np.clip(step * (before - after) / (2 * bend), -step, step)) if bend < 0 else 0.0
    if abs(fraction) < MIN_FRACTION:
        return reading.shift
    stated, moved, other = (quality(reading.shift + by) for by in (0.0, fraction, -fraction))
    known = np.isfinite(stated + moved + other)
    level = float(stated[known].mean())
    if not all(_clear((moved - one)[known], level, OFFSET_GAIN) for one in (stated, other)):
        return reading.shift
    return round(reading.shift + fraction, 3)


def best_jump(shifts: Shifts, now: NDArray, current: int = 0) -> tuple[int, int, int] | None:
    """Find a frame from which on poses are shifted otherwise.

    Args:
        shifts: Scores of whole shifts.
        now: float64 [p], quality of each pair with the best one shift for all, NaN where a pose is missing.
        current: That shift, in whole frames.

    Returns:
        Shift before, shift after, and the first frame after; None when one shift for all is as good.
    """
    ends = np.unique(shifts.later)
    found = None
    table = np.where(np.isfinite(shifts.quality), shifts.quality, np.nanmean(shifts.quality, axis=1, keepdims=True))
    now = np.where(np.isfinite(now), now, np.nanmean(shifts.quality, axis=1))
    best = now.sum() * (1 + SHIFT_GAIN)
    for at in ends[1:]:
        before, after = shifts.later < at, shifts.earlier >= at
        if min(before.sum(), after.sum()) < FEWEST_BY_JUMP:
            continue
        one, two = table[before].sum(axis=0), table[after].sum(axis=0)
        i, j = int(one.argmax()), int(two.argmax())
        total = one[i] + two[j] + now[~before & ~after].sum()
        if i != j and total > best:
            found, best = (ALL_SHIFTS[i], ALL_SHIFTS[j], int(at)), total
    if found is None:
        return None
    sides = ((shifts.later < found[2], found[0]), (shifts.earlier >= found[2], found[1]))
    for side, shift in sides:
        gain = table[side][:, ALL_SHIFTS.index(shift)] - now[side]
        if shift != current and not _clear(gain, float(now[side].mean())):
            return None
    return found


def _clear(gain: NDArray, level: float, least: float = SHIFT_GAIN) -> bool:
    error = gain.std(ddof=1) / np.sqrt(len(gain)) if len(gain) > 1 else np.inf
    return bool(gain.mean() > least * level and gain.mean() > SURE * error)


MAX_FRAMES = 160
"""Read to find a jump, at most."""
MOVED_M, TURNED = 0.01, 0.01
"""A camera that moved or turned (radians) by more cannot have taken the same depth image to the bit."""


def locate(recording: Recording, reading: Reading, progress: Progress) -> Reading:
    """Move ``reading.shift_from`` to the frame around it that makes the frames there agree best."""
    count = len(recording)
    reach = min(2 * GAP + 2 * (count // BASES), MAX_FRAMES // 2)
    frames = np.arange(max(0, reading.shift_from - reach), min(count, reading.shift_from + reach + 1))
    views = load_views(recording, frames, progress)
    pairs = in_views(views, np.concatenate([np.stack([frames[:-g], frames[g:]], axis=1) for g in (1, 2, 3)]))
    best, best_score = reading, -1.0
    for start in frames[1:]:
        moved = replace(reading, shift_from=int(start))
        posed = pairs[moved.posed_pairs(recording, views, pairs)]
        score = float(quality_by_pair(moved.residuals(recording, views, posed, 4)).sum())
        if score > best_score:
            best, best_score = moved, score
    return best


def duplicates(recording: Recording, poses: NDArray) -> NDArray:
    """Find frames whose depth file is that of the frame before, though the camera moved; int64 [k], frame indices."""
    paths = [path for index in range(len(recording)) if (path := recording.depth_file(index)) is not None]
    if len(paths) < len(recording) or len(set(paths)) < len(paths):
        return np.zeros(0, np.int64)  # one file holds several frames
    sizes = [path.stat().st_size for path in paths]
    found = []
    for index in range(1, len(paths)):
        if sizes[index] != sizes[index - 1] or not _moved(poses[index - 1], poses[index]):
            continue
        if paths[index].read_bytes() == paths[index - 1].read_bytes() and recording.depth_steps(index).any():
            found.append(index)
    return np.array(found, np.int64)


def _moved(a: NDArray, b: NDArray) -> bool:
    distance = np.linalg.norm(a[:3, 3] - b[:3, 3])
    return bool(distance > MOVED_M or np.abs(a[:3, :3] - b[:3, :3]).max() > TURNED)
