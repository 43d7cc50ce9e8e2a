"""Depth units: which are usual, and which a room allows."""

import numpy as np

from simaps_viz.checking.agreement import Views
from simaps_viz.datasets.posed_frames import DEPTH_RANGE_M

USUAL_M = (0.001, 0.0002, 0.00025, 0.0001, 0.0005, 0.01, 0.1, 1.0, 1e-6, 1 / 256, 1e-5)
"""Metres a step that cameras and datasets use."""
SNAP = 0.03
"""A found unit this close to a usual one is that one."""
TYPICAL_M = 2.2
"""Median depth of a room; only the order of magnitude matters."""
ROOM_M = (0.5, 8.0)
"""Where the median depth of a room usually lies."""


def median_depth_m(views: Views, unit_m: float) -> float:
    """Give the median depth of all views."""
    steps = views.steps[:, ::4, ::4]
    return float(np.median(steps[steps > 0])) * unit_m


def positions_are_wrong(views: Views, unit_m: float, depth_factor: float) -> bool:
    """Tell whether the stated depth is more like a room's than after the factor: then the positions' unit is wrong."""
    stated = median_depth_m(views, unit_m)
    return abs(np.log(stated / TYPICAL_M)) < abs(np.log(stated * depth_factor / TYPICAL_M))


def snapped_unit(unit_m: float) -> float:
    """Give the usual unit close by, or the unit itself."""
    near = [usual for usual in USUAL_M if abs(np.log(unit_m / usual)) < SNAP]
    return near[0] if near else unit_m


def likely_unit(views: Views, unit_m: float) -> float | None:
    """Give a usual unit that makes a room of an impossible depth; None when the depth is possible or nothing helps."""
    median = median_depth_m(views, unit_m)
    if DEPTH_RANGE_M[0] <= median <= DEPTH_RANGE_M[1]:
        return None
    good = [usual for usual in USUAL_M if ROOM_M[0] <= median / unit_m * usual <= ROOM_M[1]]
    return good[0] if good else None
