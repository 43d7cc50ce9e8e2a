"""Where a robot may stand."""

import cv2
import numpy as np

from simaps_viz.geometry import STANDS_FROM_M
from simaps_viz.structures import Pose2, SIMap


def open_floor(simap: SIMap) -> Pose2:
    """Find where the robot starts when nobody says: the free cell farthest from anything, looking north."""
    height = simap.grid.height_m
    free = (np.nan_to_num(height, nan=9.0) < STANDS_FROM_M) & (simap.instance == 0)
    if not free.any():
        xmin, ymin, xmax, ymax = simap.spec.extent_m
        return Pose2.from_heading((xmin + xmax) / 2.0, (ymin + ymax) / 2.0, 0.0)
    clearance = cv2.distanceTransform(np.pad(free, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    row, col = np.unravel_index(int(clearance.argmax()), clearance.shape)
    return Pose2.from_heading(*simap.spec.centre_of(float(row), float(col)), 0.0)
