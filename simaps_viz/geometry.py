"""Poses, back-projection and the map frame.

World: as the sequence gives it. Map frame: right-handed, metres, +z up, floor at z = 0, x east, y north.
Camera: OpenCV axes (x right, y down, z forward). ``T_a_b`` takes points of frame b to frame a.
Headings are degrees clockwise from north at the user's surface, radians counter-clockwise from +x inside.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.errors import InputError

STANDS_FROM_M = 0.10
"""Height from which something counts as standing on the floor; what is lower is part of the floor."""


def heading_to_yaw(heading_deg: float) -> float:
    """Convert a compass heading (degrees clockwise from north) into a yaw (radians from +x, counter-clockwise)."""
    return wrap_angle(np.deg2rad(90.0 - heading_deg))


def yaw_to_heading(yaw_rad: float) -> float:
    """Convert a yaw (radians from +x, counter-clockwise) into a compass heading in [0, 360) degrees."""
    return float((90.0 - np.rad2deg(yaw_rad)) % 360.0)


def wrap_angle(angle_rad: float) -> float:
    """Wrap an angle in radians to (-pi, pi]."""
    return float(-((-angle_rad + np.pi) % (2.0 * np.pi) - np.pi))


def transform_points(T_a_b: NDArray, points_b: NDArray) -> NDArray:
    """Transform points, float [..., 3], from frame b to frame a by the rigid transform ``T_a_b``, float64 [4, 4]."""
    return points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def invert_pose(T_a_b: NDArray) -> NDArray:
    """Invert a rigid transform [4, 4] by transposing its rotation."""
    T_b_a = np.eye(4)
    T_b_a[:3, :3] = T_a_b[:3, :3].T
    T_b_a[:3, 3] = -T_a_b[:3, :3].T @ T_a_b[:3, 3]
    return T_b_a


def back_project(depth_m: NDArray, fx: float, fy: float, cx: float, cy: float) -> NDArray:
    """Back-project a depth image to camera points.

    Pinhole model: ``x = (u - cx) / fx * z``, ``y = (v - cy) / fy * z``, pixel centres at whole numbers.

    Args:
        depth_m: [H, W], metres along the optical axis, 0 = invalid.
        fx: focal length along u, pixels.
        fy: focal length along v, pixels.
        cx: principal point along u, pixels.
        cy: principal point along v, pixels.

    Returns:
        float64 [H, W, 3], camera frame, metres; all zero where the depth is invalid.
    """
    height, width = depth_m.shape
    v, u = np.mgrid[:height, :width]
    z = depth_m.astype(np.float64)
    return np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=-1)


def project(points_camera: NDArray, fx: float, fy: float, cx: float, cy: float) -> NDArray:
    """Project camera points [..., 3] (z > 0) to pixel coordinates (u, v) [..., 2]."""
    z = points_camera[..., 2]
    return np.stack([points_camera[..., 0] / z * fx + cx, points_camera[..., 1] / z * fy + cy], axis=-1)


UNCLEAR = 0.15
"""Cosine between up and the picture below which it cannot be told how the picture stands: a look straight down."""


def upright_turns(T_map_camera: NDArray) -> int:
    """Return how many quarter turns counter-clockwise make a camera's picture stand upright, 0 to 3.

    A phone held upright stores pictures that lie on their side; the pose shows which. A picture taken straight down or
    up stays as it is.
    """
    right, down = T_map_camera[2, :2]  # of the map's up, in the camera's axes
    if np.hypot(right, down) < UNCLEAR:
        return 0
    return round(float(np.arctan2(right, -down)) / (np.pi / 2)) % 4


def turned(image: NDArray, turns: int) -> NDArray:
    """Return a picture [H, W, ...] after quarter turns counter-clockwise; itself when there is nothing to turn."""
    return np.ascontiguousarray(np.rot90(image, turns)) if turns % 4 else image


def turned_pose(T_a_camera: NDArray, turns: int) -> NDArray:
    """Return the pose [4, 4] of the camera that would have taken the turned picture."""
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[turns % 4]
    return T_a_camera @ np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def check_rotation(rotation: NDArray, where: str) -> None:
    """Raise InputError, naming ``where``, unless the 3x3 matrix is finite, orthonormal and right-handed."""
    if not np.isfinite(rotation).all():
        raise InputError(f"{where}: expected a finite rotation, found NaN or infinity")
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > 1e-2:
        raise InputError(f"{where}: expected an orthonormal rotation, found one off by {error:.3g}")
    if np.linalg.det(rotation) < 0:
        raise InputError(f"{where}: expected a right-handed rotation (determinant 1), found a mirrored one")


def map_from_world(up: ArrayLike, floor_height_m: float) -> NDArray:
    """Compute ``T_map_world`` [4, 4] from the world's up direction and the floor's height along it.

    The rotation is the shortest one that takes ``up`` to +z (Rodrigues), so a world that is z-up already
    keeps its x and y.

    Args:
        up: [3], world frame, any length but zero.
        floor_height_m: ``up_unit . p`` of every floor point p, metres.
    """
    up_world = np.asarray(up, dtype=np.float64)
    norm = np.linalg.norm(up_world)
    if up_world.shape != (3,) or not np.isfinite(norm) or norm < 1e-9:
        raise InputError(f"up: expected three finite numbers that are not all zero, found {up!r}")
    up_world = up_world / norm
    z = np.array([0.0, 0.0, 1.0])
    # Rodrigues: R = I + [v]x + [v]x² / (1 + cos), with v = up x z.
    axis = np.cross(up_world, z)
    cosine = float(up_world @ z)
    sine = float(np.linalg.norm(axis))
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    if cosine >= 0.0:
        rotation = np.eye(3) + skew + skew @ skew / (1.0 + cosine)
    elif sine > 1e-100:  # nearly upside down: 1 + cos has lost its digits, so normalise the axis
        half = skew / sine
        rotation = np.eye(3) + skew + half @ half * (1.0 - cosine)
    else:  # upside down: half a turn about x
        rotation = np.diag([1.0, -1.0, -1.0])
    T_map_world = np.eye(4)
    T_map_world[:3, :3] = rotation
    T_map_world[2, 3] = -floor_height_m
    return T_map_world


def spread(count: int, most: int) -> list[int]:
    """Return at most so many of the indices 0 .. count - 1, ascending and evenly spread, the ends among them."""
    return sorted({int(i) for i in np.linspace(0, count - 1, min(count, most))})


def moved(cells: NDArray, shift: tuple[int, int], shape: tuple[int, int], empty: float) -> NDArray:
    """Copy cells to where they lie in another window.

    Args:
        cells: any dtype [rows, cols], which the copy has too; given back itself when there is nothing to move.
        shift: rows and cols from the first cell of the other window to the first of this one.
        shape: of the other window; what lies outside is cut off.
        empty: value of cells that lie only in the other window.
    """
    if shift == (0, 0) and cells.shape == shape:
        return cells
    result = np.full(shape, empty, dtype=cells.dtype)
    low = [max(0, s) for s in shift]
    high = [min(n, s + m) for n, s, m in zip(shape, shift, cells.shape, strict=True)]
    if high[0] > low[0] and high[1] > low[1]:
        source = tuple(slice(a - s, b - s) for a, b, s in zip(low, high, shift, strict=True))
        result[low[0] : high[0], low[1] : high[1]] = cells[source]
    return result


def shared_cells(one: NDArray, other: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Count the cells that each pair of ids has in common.

    Cells of one pair that follow each other count at once, as there are far fewer such runs than cells.

    Args:
        one: ids, int of any shape, 0 = none.
        other: ids of the same cells.

    Returns:
        int64 [n] each, ascending: the ids of ``one``, those of ``other``, and how many cells have both.
    """
    one, other = one.reshape(-1), other.reshape(-1)
    differs = (one[1:] != one[:-1]) | (other[1:] != other[:-1])
    start = np.flatnonzero(np.concatenate([np.ones(min(one.size, 1), np.bool_), differs]))
    cells = np.diff(start, append=one.size)
    there = (one[start] > 0) & (other[start] > 0)
    start, cells = start[there], cells[there]
    pairs, at = np.unique(one[start].astype(np.int64) << 32 | other[start], return_inverse=True)
    return pairs >> 32, pairs & 0xFFFFFFFF, np.bincount(at, weights=cells, minlength=len(pairs)).astype(np.int64)
