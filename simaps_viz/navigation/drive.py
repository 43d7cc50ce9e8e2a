"""How the simulated robot moves: a differential drive that turns on the spot, then drives straight."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import PlanningError
from simaps_viz.geometry import wrap_angle
from simaps_viz.structures import Path, Pose2

MAX_STRAIGHT_M: Final = 10_000.0
"""A longer drive is refused before its poses are sampled: they would fill the memory."""


@dataclass(frozen=True)
class Motion:
    """How fast the robot is."""

    speed_mps: float = 0.8
    turn_rate_rps: float = 1.8
    """Radians a second."""
    dt_s: float = 0.05
    """Time between two poses."""


def drive(path: Path, start_yaw_rad: float, motion: Motion | None = None) -> NDArray:
    """Sample the drive along a path: at every point turn on the spot, then go straight to the next.

    Args:
        path: polyline, map frame; its first point is where the robot stands.
        start_yaw_rad: where it looks.
        motion: speeds and sampling.

    Returns:
        float64 [n, 3], (x, y, yaw) every ``dt_s``, map frame, metres and radians; the first row is the start and the
        last exactly the path's end.
    """
    motion = motion or Motion()
    pose = Pose2(float(path.points_m[0, 0]), float(path.points_m[0, 1]), start_yaw_rad)
    pieces = [np.array([[pose.x_m, pose.y_m, pose.yaw_rad]])]
    for x, y in path.points_m[1:]:
        dx, dy = float(x) - pose.x_m, float(y) - pose.y_m
        if np.hypot(dx, dy) > 1e-9:
            turned = spin(pose, wrap_angle(np.arctan2(dy, dx) - pose.yaw_rad), motion)
            heading = Pose2(pose.x_m, pose.y_m, float(np.arctan2(dy, dx)))
            ahead = straight(heading, float(np.hypot(dx, dy)), motion)
            pieces += [turned[1:], ahead[1:]]
            pose = Pose2(float(x), float(y), heading.yaw_rad)
    return np.concatenate(pieces)


def spin(pose: Pose2, angle_rad: float, motion: Motion | None = None) -> NDArray:
    """Sample a turn on the spot, counter-clockwise positive, float64 [n, 3]; the first row is the start."""
    motion = motion or Motion()
    steps = int(np.ceil(abs(angle_rad) / (motion.turn_rate_rps * motion.dt_s) - 1e-9))
    share = np.linspace(0.0, 1.0, steps + 1) if steps else np.zeros(1)
    poses = np.tile([pose.x_m, pose.y_m, pose.yaw_rad], (len(share), 1))
    yaw = pose.yaw_rad + angle_rad * share
    poses[:, 2] = -((-yaw + np.pi) % (2.0 * np.pi) - np.pi)  # as wrap_angle does it, for all at once
    return poses


def straight(pose: Pose2, distance_m: float, motion: Motion | None = None) -> NDArray:
    """Sample a straight drive along the heading (negative: backwards), float64 [n, 3]; the first row is the start.

    Raises:
        PlanningError: when it is longer than ``MAX_STRAIGHT_M``.
    """
    if abs(distance_m) > MAX_STRAIGHT_M:
        raise PlanningError(f"one straight drive is at most {MAX_STRAIGHT_M:g} m, {abs(distance_m):g} m were asked for")
    motion = motion or Motion()
    steps = int(np.ceil(abs(distance_m) / (motion.speed_mps * motion.dt_s) - 1e-9))
    along = np.linspace(0.0, distance_m, steps + 1) if steps else np.zeros(1)
    poses = np.tile([pose.x_m, pose.y_m, pose.yaw_rad], (len(along), 1))
    poses[:, 0] += along * np.cos(pose.yaw_rad)
    poses[:, 1] += along * np.sin(pose.yaw_rad)
    return poses
