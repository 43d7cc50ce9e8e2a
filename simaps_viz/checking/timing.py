"""Find poses that belong to other frames: all shifted, or shifted from some frame on, as after a dropped frame."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import AGREES, Views
from simaps_viz.checking.recording import Reading, Recording
from simaps_viz.checking.views import BASES, GAP, in_views, load_views
from simaps_viz.events import Progress

SHIFTS = (0, -1, 1, -2, 2, -3, 3)
GAIN = 0.05
"""Relative gain of quality that a shift has to bring ..."""
FRACTIONS = tuple(i / 4 for i in range(-3, 4))
LEAST_FRACTION = 0.1
"""Of a frame; less does not matter."""
OFFSET_GAIN = 0.01
"""Relative gain of quality that a fraction of a frame has to bring."""
SURE = 3.0
"""... and how many standard errors of its mean over the pairs that has to be."""
FEWEST = 4
"""Pairs on either side of a jump."""


@dataclass(frozen=True, eq=False)
class Shifts:
    """How well each pair of views agrees with its poses shifted."""

    quality: NDArray
    """float64 [p, len(SHIFTS)], mean over samples, 0-1; NaN where a pose is missing."""
    earlier: NDArray
    """int64 [p], the earlier frame of each pair."""
    later: NDArray


def measure(recording: Recording, views: Views, pairs: NDArray, reading: Reading) -> Shifts:
    """Score every pair with poses written for frames a little before or after."""
    table = np.full((len(pairs), len(SHIFTS)), np.nan)
    for column, shift in enumerate(SHIFTS):
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
    before = table[:, SHIFTS.index(current)]
    return SHIFTS[column] if _clear(table[:, column] - before, before.mean()) else current


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
    if tried.shape[1] < FEWEST:
        return reading.shift
    mean = tried.mean(axis=1)
    at = int(np.clip(np.argmax(mean), 1, len(mean) - 2))
    before, top, after = mean[at - 1 : at + 2]  # the top of the parabola through these is where it fits best
    bend = before - 2 * top + after
    step = FRACTIONS[1] - FRACTIONS[0]
    fraction = FRACTIONS[at] + float(np.clip(step * (before - after) / (2 * bend), -step, step)) if bend < 0 else 0.0
    if abs(fraction) < LEAST_FRACTION:
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
    best = now.sum() * (1 + GAIN)
    for at in ends[1:]:
        before, after = shifts.later < at, shifts.earlier >= at
        if min(before.sum(), after.sum()) < FEWEST:
            continue
        one, two = table[before].sum(axis=0), table[after].sum(axis=0)
        i, j = int(one.argmax()), int(two.argmax())
        total = one[i] + two[j] + now[~before & ~after].sum()
        if i != j and total > best:
            found, best = (SHIFTS[i], SHIFTS[j], int(at)), total
    if found is None:
        return None
    sides = ((shifts.later < found[2], found[0]), (shifts.earlier >= found[2], found[1]))
    for side, shift in sides:
        gain = table[side][:, SHIFTS.index(shift)] - now[side]
        if shift != current and not _clear(gain, float(now[side].mean())):
            return None
    return found


def _clear(gain: NDArray, level: float, least: float = GAIN) -> bool:
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


def duplicates(recording: Recording) -> NDArray:
    """Find frames whose depth file is that of the frame before, though the camera moved; int64 [k], frame indices."""
    paths = [path for index in range(len(recording)) if (path := recording.depth_file(index)) is not None]
    if len(paths) < len(recording) or len(set(paths)) < len(paths):
        return np.zeros(0, np.int64)  # one file holds several frames
    sizes = [path.stat().st_size for path in paths]
    found = []
    for index in range(1, len(paths)):
        if sizes[index] != sizes[index - 1] or not _moved(recording.matrices[index - 1], recording.matrices[index]):
            continue
        if paths[index].read_bytes() == paths[index - 1].read_bytes() and recording.depth_steps(index).any():
            found.append(index)
    return np.array(found, np.int64)


def _moved(a: NDArray, b: NDArray) -> bool:
    distance = np.linalg.norm(a[:3, 3] - b[:3, 3])
    return bool(distance > MOVED_M or np.abs(a[:3, :3] - b[:3, :3]).max() > TURNED)
