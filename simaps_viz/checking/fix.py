"""Writes a corrected manifest, and what it names anew, beside the old one, which stays as it is."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.checking.diagnose import Diagnosis
from simaps_viz.datasets.manifest import CAMERA_AXES, POSE, read_json
from simaps_viz.errors import InputError
from simaps_viz.io.files import write_all


def fixed_path(manifest: Path) -> Path:
    """Name the corrected manifest: ``sequence.json`` becomes ``sequence-fixed.json``."""
    return manifest.with_name(f"{manifest.stem}-fixed.json")


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
    target = fixed_path(recording.manifest.path)
    keys: dict[str, Any] = dict(read_json(recording.manifest.path))
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
