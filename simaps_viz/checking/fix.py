"""Writes a corrected manifest, and what it names anew, beside the old one, which stays as it is."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.checking.diagnose import Diagnosis
from simaps_viz.datasets.manifest import CAMERA_AXES, POSE, read_json
from simaps_viz.errors import InputError


def fixed_path(manifest: Path) -> Path:
    """Name the corrected manifest: ``sequence.json`` becomes ``sequence-fixed.json``."""
    return manifest.with_name(f"{manifest.stem}-fixed.json")


def write_fixed(diagnosis: Diagnosis) -> Path:
    """Write the correction: a manifest, and poses and intrinsics where they change.

    Everything is written under temporary names first; the manifest takes its name last.

    Returns:
        The new manifest.

    Raises:
        InputError: There is nothing to correct, or the folder cannot be written.
    """
    if diagnosis.correction is None:
        raise InputError(f"{diagnosis.recording.manifest.path}: expected something to correct, found nothing")
    recording, values = diagnosis.recording, diagnosis.correction.values
    target = fixed_path(recording.manifest.path)
    keys: dict[str, Any] = dict(read_json(recording.manifest.path))
    files: list[tuple[Path, str]] = []
    if "poses" in values:
        files.append((target.with_name(f"{target.stem}-poses.txt"), _pose_text(diagnosis)))
        keys["poses"] = files[-1][0].name
        keys["pose"], keys["camera_axes"] = POSE, CAMERA_AXES
    if "intrinsics" in values:
        fx, fy, cx, cy = (values["intrinsics"][name] for name in ("fx", "fy", "cx", "cy"))
        files.append((target.with_name(f"{target.stem}-intrinsics.txt"), f"{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1\n"))
        keys["intrinsics"] = files[-1][0].name
    keys |= {name: values[name] for name in ("depth_unit_m", "up", "floor_height_m") if name in values}
    files.append((target, json.dumps(keys, indent=1, ensure_ascii=False) + "\n"))
    _write_together(files)
    return target


def _pose_text(diagnosis: Diagnosis) -> str:
    poses = diagnosis.reading.poses(diagnosis.recording)
    lines = []
    for name, pose in zip(diagnosis.recording.names, poses, strict=True):
        if np.isfinite(pose).all():
            lines.append(f"{name} " + " ".join(f"{value:.10g}" for value in pose.ravel() + 0.0))
    return "\n".join(lines) + "\n"


def _write_together(files: list[tuple[Path, str]]) -> None:
    """Write all files or none; each appears whole."""
    waiting: list[tuple[str, Path]] = []
    try:
        for path, text in files:
            handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
            waiting.append((temporary, path))
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
            os.chmod(temporary, 0o644)
        for temporary, path in waiting:
            os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{files[-1][0]}: could not write the correction: {error.strerror or error}") from error
    finally:
        for temporary, _ in waiting:
            Path(temporary).unlink(missing_ok=True)
