"""Run `simaps check`: diagnose a sequence, draw the evidence, and write the correction beside it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import relative_poses
from simaps_viz.checking.diagnose import Diagnosis, diagnose
from simaps_viz.checking.faults import Bar
from simaps_viz.checking.recording import Reading, open_recording
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
