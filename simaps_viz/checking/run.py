"""Run `simaps check`: diagnose a sequence, draw the evidence, and write a corrected manifest beside the old one."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.checking.diagnose import Diagnosis, diagnose
from simaps_viz.checking.picture import save_picture
from simaps_viz.checking.recording import open_recording
from simaps_viz.datasets.manifest import CAMERA_AXES, POSE, read_json
from simaps_viz.datasets.open import open_sequence, recognise
from simaps_viz.datasets.posed_frames import PosedFramesReader
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.io.files import check_output, write_all


def write_fixed(diagnosis: Diagnosis) -> Path:
    """Write the correction: a manifest, and poses and intrinsics where they change.

    All of it or none; the manifest takes its name last.

    Returns:
        The new manifest.

    Raises:
        InputError: There is nothing to correct, or the folder cannot be written.
    """
    if diagnosis.correction is None:
        raise InputError(f"{diagnosis.recording.manifest.path}: expected something to correct, found nothing")
    recording, values = diagnosis.recording, diagnosis.correction.values
    manifest = recording.manifest.path
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
    reader = recognise(path)
    if reader is not None and not isinstance(reader, PosedFramesReader):
        raise InputError(f"{path}: expected a posed-frames/1 sequence, found another format; run simaps convert first")
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
    lines = [f"{recording.manifest.path}: {len(recording)} frames, neighbours agree on {diagnosis.before.percent()} %"]
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
