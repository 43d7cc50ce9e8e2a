"""The complete check: read a sequence as its files are, and return its faults and their corrections."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking import faults
from simaps_viz.checking.agreement import Agreement, Views, relative_poses
from simaps_viz.checking.faults import Bar, Correction, Finding
from simaps_viz.checking.level import Level, find_level
from simaps_viz.checking.recording import (
    MIRRORS,
    PLAIN,
    Reading,
    Recording,
    in_views,
    load_views,
    neighbour_pairs,
    revisit_pairs,
)
from simaps_viz.checking.registration import find_offset
from simaps_viz.checking.search import (
    Scored,
    Sight,
    best_fit,
    best_jump,
    best_offset,
    best_shift,
    duplicates,
    likely_units,
    locate,
    measure,
    mirrored,
    positions_are_wrong,
    quality_by_pair,
    score,
    search,
    snapped_unit,
)
from simaps_viz.events import Progress

FIT_WORTH = 0.06
"""Relative gain of quality before a camera or a depth scale is called wrong."""
ROUNDS = 3
"""Rounds of looking for a shift and for a camera in turn; each may hide the other."""
CREDIBLE = 0.4
"""Agreement below which a reading explains nothing, however much better it is than the files' own word."""
ON_ITS_HEAD, HEAD_DEG = 0.8, 135.0
"""Agreement below which other camera axes explain nothing if they turn the stated up by more than so many degrees."""
CALIBRATED = 1.3
"""Depth scales further off are no matter of calibration."""
MINOR_GAIN = 0.03
"""Agreement that a small change of camera and depth scale has to gain: one of no more is what noise and time make."""
UNTIMED_GAIN = 0.1
"""The same where poses were interpolated, which leaves frames disagreeing a little."""
FEWEST_PAIRS = 10
"""For fitting, each counted in both directions; fewer fit too much."""
MAX_PAIRS = 120
"""For fitting; more only cost time."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The faults of a sequence, and everything needed to show or repair it."""

    recording: Recording
    findings: tuple[Finding, ...]
    reading: Reading
    """How to read the files so that frames agree; the default one when nothing is wrong."""
    before: Agreement
    after: Agreement
    level: Level | None
    correction: Correction | None
    bars: tuple[Bar, ...] = ()
    views: Views | None = None
    pairs: NDArray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    """int64 [p, 2], the pairs of neighbouring views that were compared."""

    @property
    def ok(self) -> bool:
        """Nothing found would make a map wrong."""
        return not any(finding.severity == "error" for finding in self.findings)

    def to_json(self) -> dict:
        """Return the diagnosis as a JSON-able record."""
        return {
            "sequence": str(self.recording.path),
            "frames": len(self.recording),
            "ok": self.ok,
            "agreement": round(self.before.share, 4),
            "findings": [finding.to_json() for finding in self.findings],
            "correction": self.correction.to_json() if self.correction else None,
            "estimated": self.level.to_json() if self.level else None,
        }


def diagnose(recording: Recording, progress: Progress = lambda *_: None) -> Diagnosis:
    """Check a sequence.

    Args:
        recording: As `recording.open_recording` gives it.
        progress: Called with the name of each step.

    Raises:
        InputError: An image cannot be read, or no frame has any depth.
    """
    frames = neighbour_pairs(recording.matrices)
    views = load_views(recording, np.unique(frames) if len(frames) else np.array([0]), progress)
    faults.need_depth(recording, views)
    pairs = in_views(views, frames)
    before = score(recording, views, pairs, Reading())
    still = faults.unjudged(recording, frames, before)
    reading, scored = Reading(), []
    if still is None:
        reading, scored = _moving(recording, views, pairs, progress)
    copies = duplicates(recording, reading.poses(recording))
    if len(copies):
        reading = replace(reading, left_out=tuple(int(i) for i in copies))
    reading = _unit_without_motion(recording, views, pairs, reading)
    unregistered, reading = _registration(recording, views, reading, progress)
    progress("looking for the floor", 0, 1)
    level, reading = _level(recording, views, reading)
    progress("looking for the floor", 1, 1)
    after = score(recording, views, pairs, reading)
    if after.share < ON_ITS_HEAD and reading.convention.axes != PLAIN and level and (level.tilt_deg or 0) > HEAD_DEG:
        reading = Reading(left_out=reading.left_out)  # poses in reverse look like those of a camera on its head
        after = score(recording, views, pairs, reading)
    findings = [still] if still else faults.of_what_is_left(recording, views, pairs, reading, after)
    lost = any(finding.kind == "disagreement" and finding.severity == "error" for finding in findings)
    level = None if lost else level  # surfaces put together wrongly show neither up nor the floor
    findings = [
        *faults.of_reading(recording, views, pairs, reading),
        *([] if lost else faults.of_level(recording, level)),
        *findings,
    ]
    if unregistered:  # depth that lies elsewhere bends places that are seen again, as drift does
        findings = [*(finding for finding in findings if finding.kind != "drift"), unregistered]
    return Diagnosis(
        recording=recording,
        findings=tuple(findings),
        reading=reading,
        before=before,
        after=after,
        level=level,
        correction=_correction(recording, reading, level, before, after),
        bars=_bars(recording, scored, reading, before, after),
        views=views,
        pairs=pairs,
    )


def _moving(recording: Recording, views: Views, pairs: NDArray, progress: Progress) -> tuple[Reading, list[Scored]]:
    """Find the reading under which frames of a moving camera agree, and what else was tried."""
    progress("trying conventions", 0, 1)
    scored = search(recording, views, pairs)
    progress("trying conventions", 1, 1)
    reading = _unit_without_motion(recording, views, pairs, _units(recording, views, scored[0].reading))
    reading = _calibrate(recording, views, pairs, reading, progress)
    reading = _without_idle_changes(recording, views, pairs, reading)
    if not mirrored(recording) and score(recording, views, pairs, reading).share < CREDIBLE:
        return Reading(), scored  # where frames hardly overlap, chance finds something among thousands
    return reading, scored


def _without_idle_changes(recording: Recording, views: Views, pairs: NDArray, reading: Reading) -> Reading:
    """Take back changes without which neighbouring frames agree as well."""
    timing = {"shift": 0, "shift_later": None, "shift_from": 0}
    for changes in ({"camera": None}, {"depth_factor": 1.0}, {"position_factor": 1.0}, timing):
        without = replace(reading, **changes)
        before, after = (score(recording, views, pairs, one) for one in (without, reading))
        least = faults.GAIN
        if changes is not timing:
            least = UNTIMED_GAIN if reading.shift % 1 else MINOR_GAIN if faults.minor(recording, reading) else least
        if not (faults.gains(before, after, least) or (changes is timing and faults.comes_closer(before, after))):
            reading = without
    return reading


def _registration(
    recording: Recording, views: Views, reading: Reading, progress: Progress
) -> tuple[Finding | None, Reading]:
    """Compare depth with colour; a camera found for depth that lies elsewhere than it should is forgotten."""
    progress("comparing depth with colour", 0, 1)
    unregistered = faults.unregistered(recording, find_offset(recording, views))
    progress("comparing depth with colour", 1, 1)
    if unregistered and reading.camera is not None:
        only_moved = np.allclose(recording.camera[:2], reading.camera[:2], rtol=0.03)  # the principal point alone
        if only_moved or recording.depth_size != recording.color_size:
            reading = replace(reading, camera=None)
    return unregistered, reading


def _units(recording: Recording, views: Views, reading: Reading) -> Reading:
    """Decide whether a factor between depth and positions is the fault of the depth unit or of the positions."""
    if reading.depth_factor != 1 and positions_are_wrong(views, recording.unit_m, reading.depth_factor):
        return replace(reading, depth_factor=1.0, position_factor=1 / reading.depth_factor)
    return reading


def _unit_without_motion(recording: Recording, views: Views, pairs: NDArray, reading: Reading) -> Reading:
    """Repair a depth unit that no room can have, where frames hardly show which it is: the one they agree best with."""
    units = likely_units(views, reading.unit_m(recording))
    tried = [replace(reading, depth_factor=unit_m / recording.unit_m) for unit_m in units]
    return max(tried, key=lambda one: score(recording, views, pairs, one).share, default=reading)


def _calibrate(recording: Recording, views: Views, pairs: NDArray, reading: Reading, progress: Progress) -> Reading:
    """Look for a shift and for a wrong camera or depth scale in turn, until nothing changes."""
    for done in range(ROUNDS):
        progress("looking for shifts and the camera", done, ROUNDS)
        shifted = _shift(recording, views, pairs, reading, progress)
        fitted = _camera(recording, views, pairs, shifted)
        if fitted is reading:
            break
        if fitted is shifted and done:
            reading = fitted
            break
        reading = fitted
    progress("looking for shifts and the camera", ROUNDS, ROUNDS)
    return reading


def _shift(recording: Recording, views: Views, pairs: NDArray, reading: Reading, progress: Progress) -> Reading:
    everything = _with_revisits(recording, views, pairs, reading)
    shifts = measure(recording, views, everything, reading)
    if reading.shift_later is not None:
        return reading
    moved = replace(reading, shift=best_shift(shifts, round(reading.shift)))
    moved = replace(moved, shift=best_offset(recording, views, everything, moved))
    posed, now = moved.posed_pairs(recording, views, pairs), np.full(len(pairs), np.nan)
    now[posed] = quality_by_pair(moved.residuals(recording, views, pairs[posed]))
    jump = best_jump(measure(recording, views, pairs, reading), now, round(moved.shift))
    if jump is not None:
        return locate(recording, replace(reading, shift=jump[0], shift_later=jump[1], shift_from=jump[2]), progress)
    return reading if moved.shift == reading.shift else moved


def _camera(recording: Recording, views: Views, pairs: NDArray, reading: Reading) -> Reading:
    everything = _with_revisits(recording, views, pairs, reading)
    everything = everything[:: max(1, -(-len(everything) // MAX_PAIRS))]
    everything = everything[reading.posed_pairs(recording, views, everything)]
    if len(everything) < FEWEST_PAIRS:
        return reading
    sight = Sight(
        views, everything, relative_poses(reading.poses(recording), views.frames, everything), recording.depth_size
    )
    camera, unit_m = reading.camera_of(recording), reading.unit_m(recording)
    found = best_fit(sight, camera, unit_m, worth=FIT_WORTH)
    if found is None:
        return reading
    name, fit = found
    if abs(np.log(fit.scale)) > np.log(CALIBRATED):
        return reading  # a camera that hardly moves shows no scale; mistaken units were tried before
    if name != "scale":
        reading = replace(reading, camera=fit.camera)
    if name in ("scale", "all"):
        if reading.position_factor != 1:
            return replace(reading, position_factor=reading.position_factor / fit.scale)
        unit_m = snapped_unit(unit_m * fit.scale)
        reading = replace(reading, depth_factor=unit_m / recording.unit_m)
    return reading


def _with_revisits(recording: Recording, views: Views, pairs: NDArray, reading: Reading) -> NDArray:
    return np.concatenate([pairs, revisit_pairs(views, reading.poses(recording))])


def _level(recording: Recording, views: Views, reading: Reading) -> tuple[Level | None, Reading]:
    """Find up and the floor; of a mirrored world also which mirroring makes the stated up right."""
    up = None if recording.up is None else np.array(recording.up)

    def level(reading: Reading) -> Level | None:
        return find_level(
            views, reading.poses(recording), reading.camera_of(recording), reading.unit_m(recording),
            up=up, floor_height_m=recording.floor_height_m,
        )  # fmt: skip

    found = level(reading)
    if found is None or up is None or reading.convention.world not in MIRRORS:
        return found, reading
    original = np.array(reading.convention.world, float).T @ found.up
    off = [-float((np.array(mirror, float) @ original) @ up) for mirror in MIRRORS]
    mirror = MIRRORS[int(np.argmin(np.round(off, 3)))]
    reading = replace(reading, convention=replace(reading.convention, world=mirror))
    return level(reading), reading


def _correction(
    recording: Recording, reading: Reading, level: Level | None, before: Agreement, after: Agreement
) -> Correction | None:
    if recording.depth_size != recording.color_size:
        return None  # no manifest makes them fit
    changes, values = faults.changes(recording, reading)
    if level is not None and (level.tilted or level.floor_wrong):
        if level.tilted:
            values["up"] = [round(float(x), 6) for x in level.up]
            values["floor_height_m"] = round(level.floor_height_m, 4)
            changes.append("up and floor as the surfaces show them")
        elif recording.floor_height_m is not None and level.floor_error_m is not None:
            values["floor_height_m"] = round(recording.floor_height_m + level.floor_error_m, 4)
            changes.append("the floor as the surfaces show it")
    return Correction(tuple(changes), values, before.share, after.share) if changes else None


def _bars(
    recording: Recording, scored: list[Scored], reading: Reading, before: Agreement, after: Agreement
) -> tuple[Bar, ...]:
    """Return the picture's bars: what the files say, what the check believes, and well-known mistakes."""
    right = faults.plain_words(recording, reading)
    bars = [Bar("as the files say", before.share, True, right is None)]
    if right is not None:
        bars.append(Bar("with the correction", after.share, False, True))
    seen = {right, None}
    for one in scored[2:]:
        words = faults.plain_words(recording, one.reading)
        if words not in seen:
            seen.add(words)
            bars.append(Bar(words or "", one.agreement.share))
    return tuple(bars)
