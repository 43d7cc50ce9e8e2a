"""Tries the ways poses and depth are usually written wrongly, and keeps the simplest that makes frames agree."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import AGREES, Agreement, Views, kept_by_pair, relative_poses, residuals, summarise
from simaps_viz.checking.conventions import FORMS, OPENGL, PLAIN, ROS, Convention, conventions
from simaps_viz.checking.recording import Reading, Recording
from simaps_viz.checking.refine import other_sizes
from simaps_viz.datasets.sequence import DEPTH_RANGE_M

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


def likely_unit(views: Views, unit_m: float) -> float | None:
    """A usual unit that makes a room of an impossible depth; None when the depth is possible or nothing helps."""
    median = median_depth_m(views, unit_m)
    if DEPTH_RANGE_M[0] <= median <= DEPTH_RANGE_M[1]:
        return None
    good = [usual for usual in USUAL_M if ROOM_M[0] <= median / unit_m * usual <= ROOM_M[1]]
    return good[0] if good else None


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
    T_target_source = relative_poses(reading.poses(recording), views.frames, pairs)
    camera, unit_m = reading.camera_of(recording), reading.unit_m(recording)
    return summarise(residuals(views, pairs, T_target_source, camera, unit_m, every))


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
    by_pair = []
    for one in (Reading(), reading):
        T_target_source = relative_poses(one.poses(recording), views.frames, pairs)
        camera, unit_m = one.camera_of(recording), one.unit_m(recording)
        by_pair.append(kept_by_pair(residuals(views, pairs, T_target_source, camera, unit_m)))
    better = int((by_pair[1] > by_pair[0] + BETTER).sum())
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
    """Count what a reading says is unusual."""
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


def _key(reading: Reading) -> tuple[Convention, float, int]:
    return reading.convention, reading.depth_factor, reading.shift
