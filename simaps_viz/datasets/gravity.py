"""Find up and the floor in posed depth images, for sequences that do not say where they are.

People hold cameras upright, or on their side, and look around, so the mean of the cameras' upper, left or right sides
is close to the true up; the surface normals near it then vote, and the lowest large plane among the surfaces that face
up is the floor.
"""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.geometry import back_project
from simaps_viz.structures import Frame

COLUMNS = 90
"""Points taken along a row of pixels, about; rows are taken as densely."""
MEDIAN = 5
"""Pixels square that depth is taken over; noise of 2 % between single pixels hides which way a surface faces."""
RANGE_M = (0.3, 6.0)
PRIOR_CONE_DEG = 45.0
"""How far true up may lie from the mean of the cameras' up axes."""
PRIOR_SHARE = 0.2
"""Votes that the best direction in the cone needs, as a share of the best one anywhere; else the prior is dropped."""
NO_PRIOR = 0.2
"""Cameras whose sides' mean is shorter than this disagree about it altogether."""
ON_SIDE = 0.8
"""Cameras whose upper sides' mean is shorter than so much of the right sides' mean are held on their side."""
BIN_M = 0.02
FLOOR_SHARE = 0.17
"""Seen area that a plane needs to be the floor, as a share of the largest plane's."""
FLOOR_BAND_M = 0.05
VOTERS = 120
"""Normals compared with all directions at once: that stays in the processor's cache, and their votes fit a byte."""
BELOW_CAMERA_M = (0.2, 10.0)
"""How far the floor lies below the median camera."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Sampled surface points of all frames."""

    points: NDArray
    """float64 [n, 3], world frame, metres."""
    normals: NDArray
    """float64 [n, 3], world frame, unit length, towards the camera."""
    areas_m2: NDArray
    """float64 [n], area between neighbouring samples, so that a near table top does not outweigh a far floor."""


FEWEST_FLOOR_POINTS = 3
"""A plane needs so many."""
FEWEST_POINTS = 100
WALL_CONE_DEG = 15.0
"""Walls face within this of the horizontal."""
WALL_SHARE = 0.3
"""Share of all points that walls have, or nothing is taken from them."""
SECOND_WALL = 0.15
"""Walls that face one way only do not tell up; those of a second one have this share of the first ones' spread."""
LOWEST_SHARE = 0.01
"""Share of the points that may lie below a floor that nobody sees."""
UNSEEN_FLOOR_M = 1.5
"""How far the floor is taken to lie below the cameras where nothing at all is seen."""
OFF_DEG, LEVEL_SHARE = 5.0, 0.2
"""A stated up is doubted from so far off, if so large a share of surfaces, and twice that of its own, is level with
the one that surfaces say."""


@dataclass(frozen=True, eq=False)
class Gravity:
    """Which way is up and where the floor is."""

    up: NDArray
    """float64 [3], world frame, unit length."""
    floor_height_m: float
    """Along ``up``."""
    up_note: str = ""
    """In words, where no floor was seen and up comes from something else, or surfaces contradict the one stated."""
    floor_note: str = ""
    """In words, where no floor was seen, what is taken as the floor."""


def find_gravity(frames: Iterable[Frame], *, up: NDArray | None = None) -> Gravity:
    """Estimate gravity as `estimate_gravity` does; where no floor is in view, take what else can be had.

    Then up is the one stated, else the direction that the walls stand along, else the mean of the cameras' upper sides,
    and the floor is the lowest surface seen. There has to be a frame.
    """
    frames = list(frames)
    surface, poses = sample_surface(frames), np.stack([frame.T_world_camera for frame in frames])
    with suppress(InputError):
        note = "" if up is None else _off_level(surface, poses, np.asarray(up, dtype=np.float64))
        return Gravity(*gravity_of(surface, poses, up=up), note)
    if up is None:
        unit_up, source = _up_without_floor(surface, poses)
        up_note = f"no floor is in view: up is a guess, {source}; --up X,Y,Z states it"
    else:
        unit_up, up_note = np.asarray(up, dtype=np.float64) / np.linalg.norm(up), ""
    floor_height_m, floor = _floor_or_lowest(surface, poses, unit_up)
    floor_note = f"no floor is in view: {floor} is taken as its height; --floor-height M states it" if floor else ""
    return Gravity(unit_up, floor_height_m, up_note, floor_note)


def _off_level(surface: Surface, poses: NDArray, up: NDArray) -> str:
    """Return words for how far a stated up is from what surfaces say, where far more of them are level with theirs."""
    try:
        seen, _ = gravity_of(surface, poses)
    except InputError:
        return ""
    stated = up / np.linalg.norm(up)
    off_deg = float(np.rad2deg(np.arccos(np.clip(stated @ seen, -1.0, 1.0))))
    with_stated, with_seen = (level_share(surface.normals, one, OFF_DEG) for one in (stated, seen))
    if off_deg < OFF_DEG or with_seen < max(LEVEL_SHARE, 2.0 * with_stated):
        return ""
    return f"surfaces say up is {off_deg:.0f}° from the one stated; `simaps check` measures it, --up X,Y,Z states it"


def _floor_or_lowest(surface: Surface, poses: NDArray, up: NDArray) -> tuple[float, str]:
    """Return the floor's height, or that of what is taken for it, and what that is: "" for the floor itself."""
    try:
        return _floor_height(surface, poses, up), ""
    except InputError:
        heights = surface.points @ up
    if len(heights) >= FEWEST_POINTS:
        return float(np.quantile(heights, LOWEST_SHARE)), "the lowest surface seen"
    return float(np.median(poses[:, :3, 3] @ up)) - UNSEEN_FLOOR_M, f"{UNSEEN_FLOOR_M:g} m below the cameras"


def _up_without_floor(surface: Surface, poses: NDArray) -> tuple[NDArray, str]:
    """Return the direction that all walls stand along, or else the cameras' upper sides' mean, and what it is."""
    held = _priors(poses)[0]
    held = held if np.linalg.norm(held) > NO_PRIOR else -poses[0, :3, 1]
    found = _walls_up(surface.normals, held)
    if found is None:
        return held / np.linalg.norm(held), "the mean of the cameras' upper sides"
    return found, "the direction that the walls stand along"


def _walls_up(normals: NDArray, prior: NDArray) -> NDArray | None:
    """Return the direction near a prior that most surfaces stand along; None unless they face two ways or more."""
    found = prior / np.linalg.norm(prior)
    for cone_deg in (2 * WALL_CONE_DEG, WALL_CONE_DEG, WALL_CONE_DEG):
        walls = normals[np.abs(normals @ found) < np.sin(np.deg2rad(cone_deg))]
        if len(walls) < max(FEWEST_POINTS, WALL_SHARE * len(normals)):
            return None
        spread, directions = np.linalg.eigh(walls.T @ walls)
        if spread[1] < SECOND_WALL * spread[2]:
            return None
        found = directions[:, 0] if directions[:, 0] @ prior > 0 else -directions[:, 0]
    return found


def estimate_gravity(frames: Iterable[Frame], *, up: NDArray | None = None) -> tuple[NDArray, float]:
    """Estimate which way is up and where the floor is.

    Nothing is random: frames and pixels are taken at even steps, directions are tried on a fixed lattice.

    Args:
        frames: Some forty frames spread over the sequence are enough.
        up: [3], world frame, any length: known already, only the floor is looked for.

    Returns:
        Unit vector [3], world frame, and the floor's height along it, metres.

    Raises:
        InputError: There are too few surface points, or no plane that faces up lies below the cameras.
    """
    frames = list(frames)
    return gravity_of(sample_surface(frames), np.stack([frame.T_world_camera for frame in frames]), up=up)


def gravity_of(surface: Surface, poses: NDArray, *, up: NDArray | None = None) -> tuple[NDArray, float]:
    """Estimate as `estimate_gravity` does, from what `sample_surface` found in frames of these poses."""
    if len(surface.points) < FEWEST_POINTS:
        raise InputError(f"expected surfaces to estimate up and the floor from, found {len(surface.points)} points")
    if up is not None:
        unit_up = np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
        return unit_up, _floor_height(surface, poses, unit_up)
    found_up = _refine_direction(surface.normals, _vote(surface.normals, _priors(poses)))
    for _ in range(3):
        found_up = _fit_plane(surface, found_up, _floor_height(surface, poses, found_up))
    return found_up, _floor_height(surface, poses, found_up)


def sample_surface(frames: list[Frame]) -> Surface:
    """Return surface points of all frames, with their normals and areas; not where depth has edges."""
    points, normals, areas_m2 = [], [], []
    for frame in frames:
        k = frame.intrinsics
        step = max(1, k.width // COLUMNS)
        depth_m = cv2.medianBlur(np.ascontiguousarray(frame.depth_m, np.float32), MEDIAN)
        camera_points = back_project(depth_m[::step, ::step], k.fx / step, k.fy / step, k.cx / step, k.cy / step)
        right, below = camera_points[:-1, 1:], camera_points[1:, :-1]
        corner = camera_points[:-1, :-1]
        z = corner[..., 2]
        near = 0.1 * z  # a step of more than this in depth is an edge, not a surface
        valid = (z > RANGE_M[0]) & (z < RANGE_M[1])
        valid &= (np.abs(right[..., 2] - z) < near) & (np.abs(below[..., 2] - z) < near)
        normal = np.cross((below - corner)[valid], (right - corner)[valid])  # v x u: towards the camera
        area_m2 = np.linalg.norm(normal, axis=1)
        normal /= area_m2[:, None]
        rotation = frame.T_world_camera[:3, :3]
        points.append(corner[valid] @ rotation.T + frame.T_world_camera[:3, 3])
        normals.append(normal @ rotation.T)
        areas_m2.append(area_m2)
    return Surface(np.concatenate(points), np.concatenate(normals), np.concatenate(areas_m2))


def _priors(poses: NDArray) -> list[NDArray]:
    """Return the directions that may be up, [3] each, the likeliest first: means over the cameras' sides.

    Where the cameras differ, a mean is short: a camera that is turned about keeps only the side up that it is held by.
    """
    upper, right = -poses[:, :3, 1].mean(axis=0), poses[:, :3, 0].mean(axis=0)
    if np.linalg.norm(right) < ON_SIDE * np.linalg.norm(upper):
        return [upper]
    on_side = np.linalg.norm(upper) < ON_SIDE * np.linalg.norm(right)
    return [right, -right, upper] if on_side else [upper, right, -right]


def _vote(normals: NDArray, priors: list[NDArray]) -> NDArray:
    """Return the direction of a lattice that most normals are within 10 degrees of, near a prior if one is there.

    A camera that looks straight down sees nothing that faces the way its upper side does.

    Raises:
        InputError: It is held upright and all that it sees are walls.
    """
    lattice = _fibonacci_sphere(800)
    every = max(1, len(normals) // 20000)
    votes, chosen = np.zeros(len(lattice), np.int64), normals[::every]
    for first in range(0, len(chosen), VOTERS):
        near = chosen[first : first + VOTERS] @ lattice.T > np.cos(np.deg2rad(10.0))
        votes += near.sum(axis=0, dtype=np.uint8)
    on_side = len(priors) > 1 and np.array_equal(priors[1], -priors[0])
    upright = None if on_side else priors[0]
    for prior in priors:
        if np.linalg.norm(prior) < NO_PRIOR:
            continue
        in_cone = lattice @ prior / np.linalg.norm(prior) > np.cos(np.deg2rad(PRIOR_CONE_DEG))
        if votes[in_cone].max() >= PRIOR_SHARE * votes.max():
            return lattice[int(np.argmax(np.where(in_cone, votes, 0)))]
        if prior is upright and _walls_up(normals, prior) is not None:  # else the side of a shelf would be the floor
            raise InputError("expected a floor, found walls only")
    return lattice[int(np.argmax(votes))]


def _refine_direction(normals: NDArray, direction: NDArray) -> NDArray:
    """Move to the mean of the normals around, in narrowing cones (mean shift)."""
    for cone_deg in (15.0, 12.0, 10.0, 8.0, 6.0, 5.0):
        near = normals[normals @ direction > np.cos(np.deg2rad(cone_deg))]
        if len(near):
            direction = near.mean(axis=0) / np.linalg.norm(near.mean(axis=0))
    return direction


def _floor_height(surface: Surface, poses: NDArray, up: NDArray) -> float:
    """The height along ``up`` of the lowest plane of a good share of the upward-facing area below the cameras."""
    camera_height_m = float(np.median(poses[:, :3, 3] @ up))
    below_m = camera_height_m - surface.points @ up
    chosen = faces_up(surface, up) & (below_m > BELOW_CAMERA_M[0]) & (below_m < BELOW_CAMERA_M[1])
    heights = camera_height_m - below_m[chosen]
    if len(heights) < 50:
        raise InputError(f"expected a floor below the cameras, found {len(heights)} points that face up")
    low = heights.min()
    areas_m2 = np.bincount(((heights - low) / BIN_M).astype(np.int64), weights=surface.areas_m2[chosen])
    band = np.convolve(areas_m2, np.ones(3), mode="same")
    candidates = np.flatnonzero(band >= FLOOR_SHARE * band.max())
    first = int(candidates[0])
    window = band[first : first + 6]  # climb from the foot of the lowest peak to its top
    centre = low + (first + int(np.argmax(window)) + 0.5) * BIN_M
    return float(np.median(heights[np.abs(heights - centre) < FLOOR_BAND_M]))


def _fit_plane(surface: Surface, up: NDArray, height_m: float) -> NDArray:
    """Return the normal of the plane through the floor's points: their direction of least spread.

    Raises:
        InputError: too few points are there, or they lie too far away for numbers to tell.
    """
    near = faces_up(surface, up) & (np.abs(surface.points @ up - height_m) < FLOOR_BAND_M)
    points = surface.points[near]
    spread = _spread(points) if len(points) >= FEWEST_FLOOR_POINTS else None
    if spread is None or not np.isfinite(spread).all():
        raise InputError(f"expected a floor to estimate up from, found {len(points)} points of one")
    normal = np.linalg.eigh(spread)[1][:, 0]
    return normal if normal @ up > 0 else -normal


def _spread(points: NDArray) -> NDArray:
    """Return the scatter matrix of points, [3, 3]; not finite where poses lie far beyond any room."""
    with np.errstate(invalid="ignore", over="ignore"):
        centred = points - points.mean(axis=0)
        return centred.T @ centred


def faces_up(surface: Surface, up: NDArray) -> NDArray:
    """Return which points [n] lie on surface that faces up ([3], unit length) within 20 degrees, bool."""
    return surface.normals @ up > np.cos(np.deg2rad(20.0))


def level_share(normals: NDArray, up: NDArray, within_deg: float) -> float:
    """Return the share of unit normals, [n, 3], that are within an angle of up, [3], unit length."""
    return float((normals @ up > np.cos(np.deg2rad(within_deg))).mean())


def _fibonacci_sphere(count: int) -> NDArray:
    """Return [count, 3] unit vectors, nearly evenly spread (spherical Fibonacci lattice)."""
    i = np.arange(count) + 0.5
    z = 1.0 - 2.0 * i / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * i
    radius = np.sqrt(1.0 - z**2)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1)
