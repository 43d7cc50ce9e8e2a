"""Draws one frame's surfaces as another frame's camera would see them, to lay over that frame's own picture."""

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import relative_poses, residuals
from simaps_viz.checking.diagnose import Diagnosis
from simaps_viz.checking.reading import Reading


def telling_pair(diagnosis: Diagnosis) -> NDArray | None:
    """Choose the pair whose agreement the correction raises most (or, with none, a well agreeing one); view indices."""
    views, pairs, recording = diagnosis.views, diagnosis.pairs, diagnosis.recording
    if views is None or not len(pairs):
        return None
    scores = []
    for reading in (Reading(), diagnosis.reading):
        poses = reading.poses(recording)
        T = relative_poses(poses, views.frames, pairs)
        r = residuals(views, pairs, T, reading.camera_of(recording), reading.unit_m(recording))
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
