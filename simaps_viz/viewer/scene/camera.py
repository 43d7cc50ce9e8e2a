"""Where to look at the map from: straight down, or at a slant."""

from dataclasses import dataclass

import numpy as np

Extent = tuple[float, float, float, float]
"""(xmin, ymin, xmax, ymax), map frame, metres."""

TOP_FOV_RAD = float(np.deg2rad(10.0))
TOP_MOST_M = 600.0
"""The top view's camera is no farther from the floor, however large the map: it opens wider instead."""
SEES_M = 1000.0
"""viser's camera sees nothing beyond; one that stands farther away is told to see farther."""
SLANT_FOV_RAD = float(np.deg2rad(40.0))
SLANT_RAD = float(np.deg2rad(48.0))
"""Angle of the slanted view over the horizon."""


@dataclass(frozen=True)
class View:
    """A camera that looks at the map; up is always +z."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    fov_rad: float
    """Vertical field of view."""

    @property
    def far_m(self) -> float:
        """How far the camera has to see, with room for moving away."""
        return max(SEES_M, 4.0 * float(np.linalg.norm(np.subtract(self.position, self.look_at))))


def with_margin(extent: Extent, share: float = 0.05, least_m: float = 0.3) -> Extent:
    """Widen an extent on all sides by a share of its longer side."""
    xmin, ymin, xmax, ymax = extent
    margin = max(least_m, share * max(xmax - xmin, ymax - ymin))
    return xmin - margin, ymin - margin, xmax + margin, ymax + margin


def top_view(extent: Extent, aspect: float) -> View:
    """Look straight down, north up, so that the extent just fits; far away, for there is no orthographic camera.

    Args:
        extent: what has to be seen.
        aspect: width over height of the canvas.
    """
    xmin, ymin, xmax, ymax = extent
    half = max((ymax - ymin) / 2.0, (xmax - xmin) / 2.0 / max(aspect, 1e-3))
    distance = min(half / np.tan(TOP_FOV_RAD / 2.0), TOP_MOST_M)
    fov_rad = 2.0 * float(np.arctan2(half, distance))
    x, y = (xmin + xmax) / 2.0, (ymin + ymax) / 2.0
    # A hair to the south: straight down would leave "up" undefined.
    return View((x, y - 1e-3 * distance, distance), (x, y, 0.0), fov_rad)


def slanted_view(extent: Extent, aspect: float) -> View:
    """Look at the map from the south, from above, so that the extent fits."""
    xmin, ymin, xmax, ymax = extent
    half = max((ymax - ymin) / 2.0, (xmax - xmin) / 2.0 / max(aspect, 1e-3))
    distance = half * 1.12 / np.tan(SLANT_FOV_RAD / 2.0)
    x, y = (xmin + xmax) / 2.0, (ymin + ymax) / 2.0
    position = (x, y - distance * float(np.cos(SLANT_RAD)), distance * float(np.sin(SLANT_RAD)))
    return View(position, (x, y, 0.0), SLANT_FOV_RAD)
