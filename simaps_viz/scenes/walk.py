"""The camera's walk through all rooms: smooth positions at one height, looking at one thing after another.

Its stations are listed by hand, or planned: everywhere on the free floor, a full turn every so often.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import PchipInterpolator
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from simaps_viz.scenes.scene import Scene

CAMERA_HEIGHT_M = 1.45
PITCH_DOWN_RAD = np.deg2rad(19.0)
TURN_COST_M_PER_RAD = 0.7
"""A turn of one radian takes as many frames as a straight way of this length."""

Station = tuple[float, float, float, float]
"""x, y of the camera; x, y of what it looks at there: metres, world frame."""


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


def sample_walk(stations: Sequence[Station], frames: int) -> Walk:
    """Sample a walk at that many frames, evenly in way and turning taken together, ends included."""
    listed = np.array(stations)
    position, target = listed[:, :2], listed[:, 2:]
    yaw = np.unwrap(np.arctan2(*(target - position).T[::-1]))
    pitch = PITCH_DOWN_RAD + 0.05 * np.sin(np.arange(len(listed)) * 1.3)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1) + 0.05)])
    fine = np.linspace(0.0, along[-1], max(4000, int(along[-1] / 0.02)))
    track = PchipInterpolator(along, np.column_stack([position, yaw, pitch]), axis=0)(fine)
    track = _smooth(track, sigma=0.16 / (fine[1] - fine[0]))
    step = np.linalg.norm(np.diff(track[:, :2], axis=0), axis=1) + TURN_COST_M_PER_RAD * np.abs(np.diff(track[:, 2]))
    effort = np.concatenate([[0.0], np.cumsum(step)])
    wanted = np.linspace(0.0, effort[-1], frames)
    x, y, yaw_at, pitch_at = (np.interp(wanted, effort, column) for column in track.T)
    height = CAMERA_HEIGHT_M + 0.03 * np.sin(wanted * 0.8)
    poses = [camera_pose(np.array([x[i], y[i], height[i]]), yaw_at[i], pitch_at[i]) for i in range(frames)]
    return Walk(T_world_camera=np.stack(poses))


FLOOR_GRID_M = 0.025
LATTICE_M = 0.1
CLEARANCE_M = 0.3
"""The camera keeps this far from everything lower than ``OVERHEAD_M``."""
OVERHEAD_M = 1.9
STEP_M = 0.04
"""What is no higher, such as a carpet, counts as floor."""
TURNS_APART_M = 1.6
"""On every free spot, a place of a full turn is no farther than this to walk."""


def plan_stations(scene: Scene) -> list[Station]:
    """Plan a walk over all free floor that hangs together: full turns at spots spread evenly, the nearest one next.

    The spots are the roomiest ones: in front of a wall there is little to see.
    """
    points, clear, ways = _lattice(scene)
    spots, steps = [], []
    far = np.ones(len(points), dtype=bool)
    while far.any():
        spots.append(int(np.where(far, clear, 0.0).argmax()))
        steps.append(dijkstra(ways, indices=spots[-1], return_predecessors=True))
        far &= steps[-1][0] > TURNS_APART_M
    stations: list[Station] = []
    at, left, yaw = 0, set(range(len(spots))), 0.0
    while left:
        left.remove(at)
        x, y = points[spots[at]]
        stations += [_station(x, y, yaw + turn) for turn in np.linspace(0.0, 2 * np.pi, 9)]
        if left:
            length, before = steps[at]
            at = min(left, key=lambda spot: (length[spots[spot]], spot))
            way = [spots[at]]
            while before[way[-1]] >= 0:
                way.append(int(before[way[-1]]))
            track = points[way[::-1]][::4]
            for (x, y), (to_x, to_y) in pairwise(track):
                yaw = float(np.arctan2(to_y - y, to_x - x))
                stations.append(_station(to_x, to_y, yaw))
    return stations


def _station(x: float, y: float, yaw_rad: float) -> Station:
    return float(x), float(y), float(x + 2.0 * np.cos(yaw_rad)), float(y + 2.0 * np.sin(yaw_rad))


def _lattice(scene: Scene) -> tuple[NDArray, NDArray, coo_array]:
    """Return the largest connected part of the free floor.

    Returns:
        Points float64 [n, 2], their distances float64 [n] to what stands there, and the ways between neighbours [n, n].
    """
    heights = scene.triangles_m[:, :, 2]
    solid = scene.triangles_m[(heights.min(axis=1) < OVERHEAD_M) & (heights.max(axis=1) > STEP_M)]
    low, high = scene.triangles_m.reshape(-1, 3).min(axis=0)[:2], scene.triangles_m.reshape(-1, 3).max(axis=0)[:2]
    x, y = (np.arange(low[axis], high[axis], FLOOR_GRID_M) for axis in (0, 1))
    floor = np.ones((len(y), len(x)), dtype=np.uint8)
    for triangle in np.round((solid[:, :, :2] - low) / FLOOR_GRID_M).astype(np.int32):
        cv2.fillConvexPoly(floor, triangle, 0)
    clear = np.asarray(ndimage.distance_transform_edt(floor)) * FLOOR_GRID_M
    every = round(LATTICE_M / FLOOR_GRID_M)
    free: NDArray = clear[::every, ::every] > CLEARANCE_M
    number: NDArray = np.full(free.shape, -1)
    number[free] = np.arange(free.sum())
    pairs, lengths = [], []
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = number[: number.shape[0] - dr, max(0, -dc) : number.shape[1] - max(0, dc)]
        there = number[dr:, max(0, dc) : number.shape[1] - max(0, -dc)]
        both = (here >= 0) & (there >= 0)
        pairs.append(np.stack([here[both], there[both]]))
        lengths.append(np.full(both.sum(), LATTICE_M * np.hypot(dr, dc)))
    (a, b), length = np.concatenate(pairs, axis=1), np.concatenate(lengths)
    ways = coo_array((np.tile(length, 2), (np.r_[a, b], np.r_[b, a])), shape=(free.sum(),) * 2).tocsr()
    _, part = connected_components(ways)
    kept = np.flatnonzero(part == np.bincount(part).argmax())
    rows, cols = np.nonzero(free)
    points = np.stack([x[::every][cols], y[::every][rows]], axis=1)
    return points[kept], clear[::every, ::every][free][kept], ways[kept][:, kept]
