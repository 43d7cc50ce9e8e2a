"""Is depth registered to colour? Depth jumps have to lie where the colour picture has edges."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import Views
from simaps_viz.checking.recording import Recording

FRAMES = 64
FEWEST = 8
"""Frames with edges; in fewer, chance decides."""
WIDTH = 256
"""Both images are brought to about this width, pixels."""
REACH = 0.08
"""Offsets up to this share of the width are tried."""
NARROW_PX, BROAD_PX, PEAK_PX = 0.8, 4.0, 4
"""Widths (standard deviations) between which a peak lies, and what belongs to it all around, pixels of `WIDTH`."""
JUMP = 0.1
"""Share of the depth that makes an edge."""


@dataclass(frozen=True)
class Offset:
    """Where depth edges fit colour edges best."""

    right: float
    """Share of the image's width by which depth has to move to the right."""
    down: float
    """Share of the image's width by which it has to move down."""
    gain: float
    """Mean colour edge strength under depth edges there, over that without moving."""
    sure: float
    """How many times as high as the second highest peak the highest one is."""


def find_offset(recording: Recording, views: Views) -> Offset | None:
    """Compare edges in a few frames; None when they differ in shape or too few frames have edges."""
    if not np.isclose(recording.depth_size[0] / recording.depth_size[1],
                      recording.color_size[0] / recording.color_size[1], rtol=0.02):  # fmt: skip
        return None
    chosen = np.unique(np.linspace(0, len(views.frames) - 1, FRAMES).astype(int))
    table, used = None, 0
    for view in chosen:
        depth = views.steps[view].astype(np.float32)
        height = round(WIDTH * depth.shape[0] / depth.shape[1])
        size = (WIDTH, height)
        edges = _depth_edges(cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST))
        gradient = _color_edges(
            cv2.resize(recording.color(int(views.frames[view])), size, interpolation=cv2.INTER_AREA)
        )
        if edges.sum() < 50:
            continue
        scores, used = _correlate(edges, gradient), used + 1
        table = scores if table is None else table + scores
    if table is None or used < FEWEST or not table.any():
        return None
    strength = cv2.GaussianBlur(table, (0, 0), NARROW_PX)
    # Edges that are the same give a narrow peak; that some parts of the picture have more edges gives broad ones.
    table = strength - cv2.GaussianBlur(table, (0, 0), BROAD_PX)
    reach = table.shape[0] // 2
    row, column = (int(at) for at in np.unravel_index(int(table.argmax()), table.shape))
    rest = table.copy()
    rest[max(row - PEAK_PX, 0) : row + PEAK_PX + 1, max(column - PEAK_PX, 0) : column + PEAK_PX + 1] = 0
    return Offset(
        right=(column - reach) / WIDTH,
        down=(row - reach) / WIDTH,
        gain=float(strength[row, column] / max(float(strength[reach, reach]), 1e-9)),
        sure=float(table[row, column] / max(float(rest.max()), 1e-9)),
    )


def _depth_edges(depth: NDArray) -> NDArray:
    """Mark the nearer side of depth jumps between measured pixels, a few missing ones apart; float32 [h, w]."""
    filled = cv2.dilate(depth, np.ones((3, 3), np.uint8))
    near = np.where(depth > 0, depth, 1e9).astype(np.float32)
    lowest = cv2.erode(near, np.ones((3, 3), np.uint8))
    jump = (depth > 0) & (filled > lowest * (1 + JUMP)) & (depth < lowest * (1 + JUMP / 2))
    return jump.astype(np.float32)


def _color_edges(rgb: NDArray) -> NDArray:
    """Return gradient strength, evened out over the picture, 0-1; float32 [h, w]."""
    gray = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (0, 0), 1.0).astype(np.float32)
    strength = np.hypot(cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1))
    return np.minimum(strength / (np.percentile(strength, 95) + 1e-6), 1.0).astype(np.float32)


def _correlate(edges: NDArray, gradient: NDArray) -> NDArray:
    """Mean gradient under the edges moved by every offset, rows down and columns right, float32 [2r+1, 2r+1]."""
    reach = int(REACH * WIDTH)
    inner = edges[reach:-reach, reach:-reach]
    return cv2.matchTemplate(gradient, inner, cv2.TM_CCORR) / max(float(inner.sum()), 1.0)
