"""Finds the very frame from which on poses are shifted, and frames that were written twice."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import relative_poses, residuals
from simaps_viz.checking.reading import Reading
from simaps_viz.checking.recording import Recording
from simaps_viz.checking.timing import quality_by_pair
from simaps_viz.checking.views import BASES, GAP, in_views, load_views
from simaps_viz.events import Progress

MOST_FRAMES = 160
"""Read to find a jump, at most."""
MOVED_M, TURNED = 0.01, 0.01
"""A camera that moved or turned (radians) by more cannot have taken the same depth image to the bit."""


def locate(recording: Recording, reading: Reading, progress: Progress) -> Reading:
    """Move ``reading.shift_from`` to the frame around it that makes the frames there agree best."""
    count = len(recording)
    reach = min(2 * GAP + 2 * (count // BASES), MOST_FRAMES // 2)
    frames = np.arange(max(0, reading.shift_from - reach), min(count, reading.shift_from + reach + 1))
    views = load_views(recording, frames, progress)
    pairs = in_views(views, np.concatenate([np.stack([frames[:-g], frames[g:]], axis=1) for g in (1, 2, 3)]))
    camera, unit_m = reading.camera_of(recording), reading.unit_m(recording)
    best, best_score = reading, -1.0
    for start in frames[1:]:
        moved = replace(reading, shift_from=int(start))
        poses = moved.poses(recording)
        posed = np.isfinite(poses[views.frames[pairs], 0, 0]).all(axis=1)
        residual = residuals(views, pairs[posed], relative_poses(poses, views.frames, pairs[posed]), camera, unit_m, 4)
        score = float(quality_by_pair(residual).sum())
        if score > best_score:
            best, best_score = moved, score
    return best


def duplicates(recording: Recording) -> NDArray:
    """Find frames whose depth file is that of the frame before, though the camera moved; int64 [k], frame indices."""
    manifest = recording.manifest
    paths = [manifest.file(manifest.depth, name) for name in recording.names]
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
