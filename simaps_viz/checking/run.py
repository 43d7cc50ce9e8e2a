"""Run `simaps check`: diagnose a sequence as its files are, draw the evidence, and write the correction beside it."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking import faults
from simaps_viz.checking.agreement import Agreement, Views, relative_poses
from simaps_viz.checking.faults import Bar, Correction, Finding, Level, find_level, find_offset
from simaps_viz.checking.recording import (
    MIRRORS,
    PLAIN,
    Reading,
    Recording,
    in_views,
    load_views,
    neighbour_pairs,
    open_recording,
    revisit_pairs,
)
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
from simaps_viz.colors.palette import Color
from simaps_viz.datasets.convert import write_posed_frames
from simaps_viz.datasets.manifest import CAMERA_AXES, POSE, read_json
from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.recording import Recording as SourceRecording
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.drawing.sheet import INK, PALE_INK, RULE, Sheet, save_png, wrapped
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.io.files import check_output, write_all

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
            "notes": list(self.recording.notes),
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


WIDTH, MARGIN = 1500, 36
STATED, CHOSEN, OTHER = (196, 70, 52), (38, 132, 90), (176, 184, 196)
FINDING, HEADING, LABEL = 18, 20, 17
"""Font sizes."""
LINE, ROW, LABEL_WIDTH = 26, 34, 560
"""Height of a line and of a bar's row, width of its label, pixels."""
MAX_BARS = 12


def telling_pair(diagnosis: Diagnosis) -> NDArray | None:
    """Choose the pair whose agreement the correction raises most (or, with none, a well agreeing one); view indices."""
    views, pairs, recording = diagnosis.views, diagnosis.pairs, diagnosis.recording
    if views is None or not len(pairs):
        return None
    scores = []
    for reading in (Reading(), diagnosis.reading):
        r = reading.residuals(recording, views, pairs)
        sampled = np.maximum((~np.isnan(r)).sum(axis=1), 1)
        scores.append((np.abs(r) < 0.02).sum(axis=1) / sampled)
    gain = 2 * scores[1] - scores[0]
    return pairs[int(gain.argmax())]


def overlay(diagnosis: Diagnosis, pair: NDArray, reading: Reading) -> NDArray:
    """Lay frame a, moved to the camera of frame b, over frame b.

    Frame b is drawn in the red, frame a in the green and blue channel: where they agree the picture is grey.

    Returns:
        uint8 [H, W, 3], RGB, size of the depth images in memory.
    """
    recording, views = diagnosis.recording, diagnosis.views
    assert views is not None
    source, target = (int(i) for i in pair)
    height, width = views.steps.shape[1:]
    gray_a, gray_b = (_gray(diagnosis, view, (width, height)) for view in (source, target))
    poses = reading.poses(recording)
    T = relative_poses(poses, views.frames, pair[None])[0]
    moved = np.full((height, width), np.nan, np.float32)
    if np.isfinite(T).all():
        fx, fy, cx, cy = views.camera(reading.camera_of(recording))
        v, u = np.nonzero(views.steps[source])
        z = views.steps[source][v, u] * reading.unit_m(recording)
        points = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=-1) @ T[:3, :3].T + T[:3, 3]
        ahead = points[:, 2] > 1e-9
        points, shade = points[ahead], gray_a[v, u][ahead]
        with np.errstate(over="ignore"):
            column = np.round(points[:, 0] / points[:, 2] * fx + cx)
            row = np.round(points[:, 1] / points[:, 2] * fy + cy)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        order = np.argsort(-points[inside, 2], kind="stable")  # near ones last, so that they hide the others
        moved[row[inside][order].astype(int), column[inside][order].astype(int)] = shade[inside][order]
    moved = _filled(moved)
    seen = np.isfinite(moved)
    out = np.repeat((96 + gray_b * 0.35)[..., None], 3, axis=2)
    out[seen] = np.stack([gray_b[seen], moved[seen], moved[seen]], axis=-1)
    return np.clip(out, 0, 255).astype(np.uint8)


def _gray(diagnosis: Diagnosis, view: int, size: tuple[int, int]) -> NDArray:
    assert diagnosis.views is not None
    rgb = diagnosis.recording.color(int(diagnosis.views.frames[view]))
    gray = cv2.cvtColor(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    return cv2.createCLAHE(2.0, (4, 4)).apply(gray).astype(np.float32)


def _filled(image: NDArray) -> NDArray:
    """Close the thin gaps between moved pixels with the brightest neighbour; float32 [H, W], NaN = none."""
    empty = ~np.isfinite(image)
    grown = cv2.dilate(np.where(empty, -1, image).astype(np.float32), np.ones((3, 3), np.uint8))
    return np.where(empty & (grown >= 0), grown, image)


def draw(diagnosis: Diagnosis) -> NDArray:
    """Lay out the picture: verdict, findings, bars, frames. uint8 [H, W, 3], RGB."""
    lines = _finding_lines(diagnosis)
    bars, frames = _shown(diagnosis.bars), _frames(diagnosis)
    bars_top = MARGIN + 56 + LINE * len(lines) + 34
    frames_top = bars_top + 40 + ROW * len(bars) + 34
    frames_high = max((image.shape[0] for _, image in frames), default=-90) + 90
    sheet = Sheet(WIDTH, frames_top + frames_high + MARGIN)

    verdict = "usable" if diagnosis.ok else "not usable as it is"
    title = f"{diagnosis.recording.name}: {verdict}"
    sheet.text(title, (MARGIN, MARGIN + 16), 30, room=WIDTH - 2 * MARGIN)
    for number, (text, color) in enumerate(lines):
        sheet.text(text, (MARGIN, MARGIN + 62 + LINE * number), FINDING, color)
    _draw_bars(sheet, bars, bars_top)

    for number, (title, image) in enumerate(frames):
        sheet.panel(image, (MARGIN + number * (image.shape[1] + MARGIN), frames_top), title)
    if frames:
        words = "grey where both agree; red and cyan fringes where they do not; pale where only one of them sees"
        sheet.text(words, (MARGIN, frames_top + frames_high - 32), LABEL, PALE_INK)
    return sheet.pixels


def _finding_lines(diagnosis: Diagnosis) -> list[tuple[str, Color]]:
    lines: list[tuple[str, Color]] = []
    for finding in diagnosis.findings:
        color = STATED if finding.severity == "error" else PALE_INK
        lines += [(line, color) for line in wrapped(finding.message, FINDING, WIDTH - 2 * MARGIN)]
    return lines or [("Neighbouring frames see the same surfaces in the same places.", CHOSEN)]


def _shown(bars: tuple[Bar, ...]) -> list[Bar]:
    """Return what the files say and what is believed first, then the best of the others."""
    special = [bar for bar in bars if bar.stated or bar.chosen]
    others = sorted((bar for bar in bars if not (bar.stated or bar.chosen)), key=lambda bar: -bar.share)
    return (special + others)[:MAX_BARS]


def _draw_bars(sheet: Sheet, bars: list[Bar], top: int) -> None:
    sheet.text("How much of what two neighbouring frames see agrees, if ...", (MARGIN, top + 10), HEADING)
    left, room = MARGIN + LABEL_WIDTH, WIDTH - 2 * MARGIN - LABEL_WIDTH - 90
    top += 40
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        x = left + share * room
        sheet.fill((x, top - 4, x + 1, top + ROW * len(bars)), RULE)
    for number, bar in enumerate(bars):
        y, end = top + ROW * number, left + max(2, bar.share * room)
        color = CHOSEN if bar.chosen else STATED if bar.stated else OTHER
        ink = INK if bar.chosen or bar.stated else PALE_INK
        middle = y + ROW / 2 - 4
        sheet.text(bar.label, (left - 14, middle), LABEL, ink, anchor="right", room=LABEL_WIDTH - 20)
        sheet.fill((left, y + 3, end, y + ROW - 11), color)
        sheet.text(f"{100 * bar.share:.0f} %", (end + 10, middle), LABEL, ink)


def _frames(diagnosis: Diagnosis) -> list[tuple[str, NDArray]]:
    """Return titled overlays: as the files are, and as corrected where that differs."""
    pair = telling_pair(diagnosis)
    if pair is None or diagnosis.views is None:
        return []
    names = [diagnosis.recording.names[diagnosis.views.frames[i]] for i in pair]
    wanted = [(f"as the files are: frame {names[0]} over {names[1]}", Reading())]
    if any(bar.chosen and not bar.stated for bar in diagnosis.bars):
        wanted.append(("corrected", diagnosis.reading))
    wide = (WIDTH - 3 * MARGIN) // 2
    images = []
    for title, reading in wanted:
        image = overlay(diagnosis, pair, reading)
        size = (wide, round(image.shape[0] * wide / image.shape[1]))
        images.append((title, cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)))
    return images


def write_fixed(diagnosis: Diagnosis) -> Path:
    """Write the correction, all of it or none.

    Of posed-frames/1: a manifest, and poses and intrinsics where they change; the manifest takes its name last. Of
    other formats: the whole recording as a posed-frames/1 folder.

    Returns:
        The new manifest.

    Raises:
        InputError: There is nothing to correct, or the folder cannot be written.
    """
    recording = diagnosis.recording
    if diagnosis.correction is None:
        raise InputError(f"{recording.path}: expected something to correct, found nothing")
    values, manifest = diagnosis.correction.values, recording.path
    if recording.source is not None:
        corrected = PosedFrames(_corrected(diagnosis, recording.source))
        return write_posed_frames(corrected, manifest.with_name(f"{manifest.stem}-fixed"))
    target = manifest.with_name(f"{manifest.stem}-fixed.json")
    keys: dict[str, Any] = dict(read_json(manifest))
    files: dict[Path, bytes] = {}
    if "poses" in values:
        poses = target.with_name(f"{target.stem}-poses.txt")
        files[poses] = _pose_text(diagnosis).encode()
        keys["poses"] = poses.name
        keys["pose"], keys["camera_axes"] = POSE, CAMERA_AXES
    if "intrinsics" in values:
        fx, fy, cx, cy = (values["intrinsics"][name] for name in ("fx", "fy", "cx", "cy"))
        intrinsics = target.with_name(f"{target.stem}-intrinsics.txt")
        files[intrinsics] = f"{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1\n".encode()
        keys["intrinsics"] = intrinsics.name
    keys |= {name: values[name] for name in ("depth_unit_m", "up", "floor_height_m") if name in values}
    files[target] = (json.dumps(keys, indent=1, ensure_ascii=False) + "\n").encode()
    write_all(files, "the correction")
    return target


def _corrected(diagnosis: Diagnosis, source: SourceRecording) -> SourceRecording:
    """Return a recording of another format than posed-frames/1 as it has to be read."""
    recording, reading, level = diagnosis.recording, diagnosis.reading, diagnosis.level
    poses, unit_m = reading.poses(recording), reading.unit_m(recording)
    kept = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))
    fx, fy, cx, cy = (float(x) for x in reading.camera_of(recording))
    up, floor_height_m = source.facts.up, source.floor_height_m
    if level is not None and level.held and (level.tilted or level.floor_wrong or up is None or floor_height_m is None):
        up, floor_height_m = tuple(float(x) for x in level.up), level.floor_height_m

    def depth(index: int) -> NDArray:
        return recording.depth_steps(int(kept[index])) * np.float32(unit_m)

    return replace(
        source,
        facts=replace(source.facts, up=up),
        frame_names=tuple(source.frame_names[i] for i in kept),
        poses=poses[kept],
        intrinsics=replace(source.intrinsics, fx=fx, fy=fy, cx=cx, cy=cy),
        depth=depth,
        color=lambda index: source.color(int(kept[index])),
        color_file=lambda index: source.color_file(int(kept[index])),
        stored=None,
        segments=None,
        depth_unit_m=unit_m,
        floor_height_m=floor_height_m,
    )


def _pose_text(diagnosis: Diagnosis) -> str:
    poses = diagnosis.reading.poses(diagnosis.recording)
    lines = []
    for name, pose in zip(diagnosis.recording.names, poses, strict=True):
        if np.isfinite(pose).all():
            lines.append(f"{name} " + " ".join(f"{value:.10g}" for value in pose.ravel() + 0.0))
    return "\n".join(lines) + "\n"


def check(path: Path, *, fix: bool, picture: Path | None, progress: Progress) -> tuple[bool, str, dict[str, Any]]:
    """Check a sequence, and correct it when asked.

    Returns:
        Whether it is usable as it is, what a person reads, and the record.

    Raises:
        InputError: It cannot be read, or something cannot be written; then nothing was.
    """
    if picture is not None:
        check_output(picture, ".png")
    diagnosis = diagnose(open_recording(path), progress)
    if picture is not None:
        save_png(draw(diagnosis), picture)
    record = diagnosis.to_json()
    written = None
    if fix and diagnosis.correction is not None:
        written = write_fixed(diagnosis)
        open_sequence(written)
        record["correction"]["written"] = str(written)
    text = _text(diagnosis, written, fix) + (f"\n{picture}: the evidence" if picture is not None else "")
    return diagnosis.ok, text, record


def _text(diagnosis: Diagnosis, written: Path | None, fix: bool) -> str:
    recording = diagnosis.recording
    agree = f"s, neighbours agree on {diagnosis.before.percent()} %" if len(recording) > 1 else ""
    lines = [f"{recording.path}: {len(recording)} frame{agree}"]
    lines += [f"note: {note}" for note in recording.notes]
    lines += [f"{finding.severity}: {finding.message}" for finding in diagnosis.findings]
    if diagnosis.ok:
        lines.append("usable" + (", with the remarks above" if diagnosis.findings else ""))
    correction = diagnosis.correction
    if written is not None:
        lines.append(f"{written}: corrected ({'; '.join(correction.changes if correction else ())})")
    elif correction is not None:
        lines.append(f"A correction fits: {'; '.join(correction.changes)}. Write it with --fix.")
    elif not diagnosis.ok:
        lines.append("Nothing can be corrected automatically." if fix else "No correction is known.")
    return "\n".join(lines)
