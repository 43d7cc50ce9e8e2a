"""Lines in a page's 3-D scene."""

import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color

FULL_FROM_PX = 60.0
"""What is smaller than this on the screen gets thinner lines, or they would hide it."""
THINNEST = 0.4
"""Share of a line's thickness that is left around the smallest."""


def line_share(segments: NDArray, metres_per_px: float) -> float:
    """Return the share of their thickness, THINNEST to 1, that lines around a thing, float [n, 2, 3], should have."""
    if not len(segments):
        return 1.0
    corners = segments.reshape(-1, 3)[:, :2]
    size_px = float((corners.max(axis=0) - corners.min(axis=0)).min()) / metres_per_px
    return float(np.clip(size_px / FULL_FROM_PX, THINNEST, 1.0))


def draw_lines(
    scene: viser.SceneApi, name: str, segments: NDArray, color: Color, thickness_px: float, *, visible: bool = True
) -> None:
    """Draw line segments, float [n, 2, 3], map frame, metres, in the place of those of that name; n = 0: none."""
    if len(segments):
        scene.add_line_segments(
            name, segments, color, thickness=thickness_px, thickness_units="screen", visible=visible
        )
    elif scene.get_handle_by_name(name) is not None:
        scene.remove_by_name(name)
