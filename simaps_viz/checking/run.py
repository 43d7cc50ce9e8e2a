"""Run `simaps check`: diagnose a sequence, draw the evidence, and write the correction beside it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.diagnose import Diagnosis, diagnose
from simaps_viz.checking.picture import save_picture
from simaps_viz.checking.recording import open_recording
from simaps_viz.datasets.convert import write_posed_frames
from simaps_viz.datasets.manifest import CAMERA_AXES, POSE, read_json
from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.recording import Recording as SourceRecording
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.io.files import check_output, write_all


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
        save_picture(diagnosis, picture)
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
    lines = [f"{recording.path}: {len(recording)} frames, neighbours agree on {diagnosis.before.percent()} %"]
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
