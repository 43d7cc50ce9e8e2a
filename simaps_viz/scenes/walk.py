"""The camera's walk through all rooms: smooth positions at one height, looking at one thing after another."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

CAMERA_HEIGHT_M = 1.45
PITCH_DOWN_RAD = np.deg2rad(19.0)
TURN_COST_M_PER_RAD = 0.7
"""A turn of one radian takes as many frames as a straight way of this length."""

STATIONS: tuple[tuple[float, float, float, float], ...] = (
    # x, y of the camera; x, y of what it looks at there
    (6.30, 3.50, 4.50, 4.90),
    (5.60, 3.05, 4.90, 1.60),
    (4.30, 2.95, 4.60, 1.30),
    (3.50, 2.85, 1.90, 1.50),
    (2.90, 2.95, 1.30, 1.90),
    (2.95, 2.10, 1.50, 1.60),
    (2.95, 1.30, 1.40, 1.60),
    (2.95, 2.00, 1.10, 2.60),
    (2.80, 2.80, 1.20, 3.90),
    (2.75, 3.30, 1.60, 4.40),
    (3.00, 4.30, 1.60, 4.40),
    (2.95, 5.45, 1.60, 6.60),
    (2.20, 5.68, 1.50, 6.80),
    (1.40, 5.66, 2.20, 6.70),
    (2.60, 5.72, 3.60, 6.60),
    (3.70, 6.30, 2.20, 7.00),
    (4.35, 7.10, 2.60, 7.80),
    (4.15, 7.85, 2.20, 8.30),
    (3.60, 7.93, 1.60, 8.60),
    (4.30, 7.70, 2.60, 8.80),
    (4.90, 7.10, 3.80, 8.60),
    (5.60, 6.70, 4.20, 8.60),
    (6.00, 6.65, 5.90, 8.40),
    (6.60, 6.80, 8.00, 6.80),
    (7.20, 6.80, 8.40, 7.60),
    (8.20, 6.75, 8.60, 8.50),
    (9.30, 6.70, 9.90, 8.50),
    (9.90, 6.75, 11.40, 7.60),
    (9.95, 6.30, 11.50, 6.40),
    (9.80, 5.95, 11.20, 5.00),
    (9.30, 6.20, 8.00, 5.30),
    (9.25, 5.90, 7.60, 6.60),
    (9.60, 5.50, 9.64, 4.20),
    (9.64, 4.70, 9.90, 2.80),
    (9.62, 4.00, 10.90, 3.90),
    (9.40, 3.50, 11.30, 2.60),
    (9.36, 2.60, 10.60, 2.00),
    (9.36, 1.75, 9.90, 0.50),
    (9.60, 1.24, 11.40, 1.40),
    (10.40, 1.24, 11.40, 2.20),
    (10.75, 1.70, 10.90, 3.80),
    (10.75, 2.60, 9.90, 3.60),
    (10.60, 3.75, 8.80, 2.40),
    (9.50, 3.65, 8.40, 2.10),
    (8.70, 3.55, 7.60, 4.00),
    (7.95, 3.05, 8.30, 1.90),
    (7.75, 2.60, 7.80, 0.80),
    (7.20, 2.50, 5.20, 2.20),
    (6.50, 2.50, 4.90, 1.20),
    (6.42, 1.90, 4.80, 0.60),
    (6.35, 2.60, 5.00, 2.60),
    (6.20, 3.40, 5.60, 5.00),
    (5.95, 4.60, 4.50, 5.00),
    (5.80, 5.80, 4.50, 4.90),
    (4.70, 6.20, 4.40, 5.00),
    (3.30, 5.75, 4.30, 4.90),
    (3.05, 4.60, 4.30, 4.95),
    (3.30, 3.50, 4.40, 4.80),
    (3.60, 3.00, 2.40, 4.00),
)
"""Where the walk passes and what it turns to."""


@dataclass(frozen=True, eq=False)
class Walk:
    """Camera poses along the walk."""

    T_world_camera: NDArray
    """float64 [n, 4, 4], camera (OpenCV axes) to world, metres."""

    def __len__(self) -> int:
        return len(self.T_world_camera)


def camera_pose(position_m: NDArray, yaw_rad: float, pitch_down_rad: float) -> NDArray:
    """Return ``T_world_camera`` [4, 4] of a level camera that looks along yaw, tipped down by the pitch."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    forward = np.array([c * np.cos(pitch_down_rad), s * np.cos(pitch_down_rad), -np.sin(pitch_down_rad)])
    right = np.array([s, -c, 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = position_m
    return T


def _smooth(values: NDArray, sigma: float) -> NDArray:
    """Blur samples [n, ...] along their first axis with a Gaussian; the ends are held."""
    reach = int(3 * sigma) + 1
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    padded = np.concatenate([np.repeat(values[:1], reach, 0), values, np.repeat(values[-1:], reach, 0)])
    return np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=1)


def plan_walk(frames: int) -> Walk:
    """Sample the walk at that many frames, evenly in way and turning taken together, ends included."""
    stations = np.array(STATIONS)
    position, target = stations[:, :2], stations[:, 2:]
    yaw = np.unwrap(np.arctan2(*(target - position).T[::-1]))
    pitch = PITCH_DOWN_RAD + 0.05 * np.sin(np.arange(len(stations)) * 1.3)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1) + 0.05)])
    fine = np.linspace(0.0, along[-1], 4000)
    track = PchipInterpolator(along, np.column_stack([position, yaw, pitch]), axis=0)(fine)
    track = _smooth(track, sigma=0.16 / (fine[1] - fine[0]))
    step = np.linalg.norm(np.diff(track[:, :2], axis=0), axis=1) + TURN_COST_M_PER_RAD * np.abs(np.diff(track[:, 2]))
    effort = np.concatenate([[0.0], np.cumsum(step)])
    wanted = np.linspace(0.0, effort[-1], frames)
    x, y, yaw_at, pitch_at = (np.interp(wanted, effort, column) for column in track.T)
    height = CAMERA_HEIGHT_M + 0.03 * np.sin(wanted * 0.8)
    poses = [camera_pose(np.array([x[i], y[i], height[i]]), yaw_at[i], pitch_at[i]) for i in range(frames)]
    return Walk(T_world_camera=np.stack(poses))
