"""Chooses the frames and pairs of frames a check looks at, and samples points on their surfaces."""

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import Views
from simaps_viz.checking.recording import Recording
from simaps_viz.events import Progress

BASES = 40
"""Places in the sequence where frames are compared."""
TURN_DEG = (8.0, 40.0)
"""A partner is the first frame that has turned by more than the first, as long as it has by less than the second."""
GAP = 6
"""Partners are no further apart than this many frames."""
SAMPLES = 800
"""Points a frame, at most."""
WIDEST = 640
"""Pixels; wider depth images are thinned out by whole steps."""
REVISIT_GAP = 15
"""Frames between two visits of a place, at least."""
REVISIT_TURN_DEG = 45.0
REVISIT_DISTANCE_M = 1.5


def neighbour_pairs(matrices: NDArray) -> NDArray:
    """Pair frames with later ones that have turned a little, so that mistakes show but most is still in view.

    Angles between rotations are the same whichever way poses are written, so this needs no right poses.

    Returns:
        int64 [p, 2], frame indices (earlier, later); empty for a single frame.
    """
    count = len(matrices)
    found = []
    for base in sorted({int(i) for i in np.linspace(0, max(count - 2, 0), BASES)} if count > 1 else ()):
        last = min(base + GAP, count - 1)
        turns = turned_deg(matrices[base], matrices[base + 1 : last + 1]).tolist()
        gap = next((g for g, turn in enumerate(turns, 1) if turn > TURN_DEG[0]), len(turns))
        while gap > 1 and turns[gap - 1] > TURN_DEG[1]:
            gap -= 1
        found.append((base, base + gap))
    return np.array(found, np.int64).reshape(-1, 2)


def load_views(recording: Recording, frames: NDArray, progress: Progress) -> Views:
    """Read the depth of some frames; raises InputError when an image cannot be read."""
    stride = max(1, -(-recording.depth_size[0] // WIDEST))
    steps, pixels = [], []
    for done, frame in enumerate(frames):
        progress("reading depth", done, len(frames))
        image = np.ascontiguousarray(recording.depth_steps(int(frame))[::stride, ::stride])
        steps.append(image)
        pixels.append(_sample(image))
    progress("reading depth", len(frames), len(frames))
    return Views(np.asarray(frames), np.stack(steps), stride, np.stack(pixels))


def in_views(views: Views, pairs: NDArray) -> NDArray:
    """Turn pairs of frame indices into pairs of view indices, each in both directions, int64 [2 p, 2]."""
    there = np.searchsorted(views.frames, pairs)
    return np.concatenate([there, there[:, ::-1]])


def revisit_pairs(views: Views, poses: NDArray, gap: int = REVISIT_GAP) -> NDArray:
    """Pair views of one place that are ``gap`` frames apart or more, each in both directions, int64 [p, 2]."""
    frames = views.frames
    rotation, position = poses[frames, :3, :3], poses[frames, :3, 3]
    cosine = rotation[:, :, 2] @ rotation[:, :, 2].T
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    apart = np.abs(frames[:, None] - frames[None]) >= max(gap, REVISIT_GAP)
    good = apart & (cosine > np.cos(np.deg2rad(REVISIT_TURN_DEG))) & (distance < REVISIT_DISTANCE_M)
    cost = np.where(good, distance + 2 * np.arccos(np.clip(cosine, -1, 1)), np.inf)
    best = cost.argmin(axis=1)
    chosen = {tuple(sorted((a, int(b)))) for a, b in enumerate(best) if np.isfinite(cost[a, b])}
    pairs = np.array(sorted(chosen), np.int64).reshape(-1, 2)
    return np.concatenate([pairs, pairs[:, ::-1]])


def turned_deg(a: NDArray, b: NDArray) -> NDArray:
    """Return the angle between the rotations of poses [..., 4, 4], degrees [...]."""
    cosine = (np.einsum("...ij,...ij->...", a[..., :3, :3], b[..., :3, :3]) - 1) / 2
    return np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))


def _sample(steps: NDArray) -> NDArray:
    """Pick measured pixels whose right and lower neighbours are of the same surface, evenly over the image."""
    pixels = np.full((SAMPLES, 2), -1, np.int32)
    depth = steps.astype(np.float32)
    corner = depth[:-1, :-1]
    near = 0.03 * corner + 1  # a step of rounding is no edge
    smooth = (corner > 0) & (np.abs(depth[:-1, 1:] - corner) <= near) & (np.abs(depth[1:, :-1] - corner) <= near)
    v, u = np.nonzero(smooth)
    if len(u):
        chosen = np.unique(np.linspace(0, len(u) - 1, min(SAMPLES, len(u))).astype(np.int64))
        pixels[: len(chosen)] = np.stack([u[chosen], v[chosen]], axis=1)
    return pixels
