"""Where a robot starts on a map, when nobody says where."""

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError, PlanningError
from simaps_viz.navigation.agent import planner_of
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Pose2, SIMap


def start_pose(simap: SIMap, robot: RobotShape | None = None) -> Pose2:
    """Give where the robot starts: where the first camera stood that has free floor by it, looking its way.

    Who scans by hand seldom sees the floor he stands on first. Where no camera has any, it is the first one's place.

    Raises:
        InputError: the map has no camera.
    """
    if len(simap.T_map_camera) == 0:
        raise InputError("start pose: expected a map with at least one camera, found none")
    planner = planner_of(simap, robot or RobotShape())
    poses = [_standing(T) for T in simap.T_map_camera[:: max(1, len(simap.T_map_camera) // 200)]]
    for pose in poses:
        with suppress(PlanningError):
            planner.start_cell(pose.x_m, pose.y_m)
            return pose
    return poses[0]


def _standing(T_map_camera: NDArray) -> Pose2:
    x, y = T_map_camera[:2, 3].tolist()
    return Pose2(x, y, float(np.arctan2(T_map_camera[1, 2], T_map_camera[0, 2])))
