"""Reads the camera of a sequence: ``intrinsics.txt`` and ``poses.txt``."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.rows import lines
from simaps_viz.errors import InputError
from simaps_viz.geometry import check_rotation
from simaps_viz.io.limits import MAX_FRAMES, check_frame_name
from simaps_viz.structures import Intrinsics

FIELD_OF_VIEW_DEG = (20.0, 150.0)
"""A pinhole camera outside this range is a mistake in the file, not a camera."""

REACH_M = 1000.0
"""How far a camera may stand from the median one: further, the grid would not fit in memory."""


def read_intrinsics(path: Path, *, width: int, height: int) -> Intrinsics:
    """Read and check a 3x3 camera matrix for images of that size, pixels.

    Raises:
        InputError: Not nine numbers in three lines, not a pinhole matrix, or one that does not fit the images.
    """
    rows = [_numbers(path, number, line.split()) for number, line in lines(path)]
    if len(rows) != 3 or any(len(row) != 3 for row in rows):
        found = f"{len(rows)} lines of {', '.join(sorted({str(len(row)) for row in rows})) or 'no'} numbers"
        raise InputError(f"{path}: expected a 3x3 camera matrix, found {found}")
    K = np.array(rows)
    if K[0, 1] or K[1, 0]:
        raise InputError(f"{path}: expected a matrix without skew, found {K[0, 1]:g} and {K[1, 0]:g}")
    if tuple(K[2]) != (0, 0, 1):
        raise InputError(f"{path}: expected 0 0 1 as the last row, found {' '.join(f'{x:g}' for x in K[2])}")
    fx, fy, cx, cy = (float(x) for x in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    if not (fx > 0 and fy > 0):
        raise InputError(f"{path}: expected focal lengths fx, fy over 0, found {fx:g} and {fy:g}")
    if not (0 <= cx <= width - 1 and 0 <= cy <= height - 1):
        raise InputError(
            f"{path}: expected the principal point inside the {width}x{height} image, found ({cx:g}, {cy:g})"
        )
    for focal, size, axis in ((fx, width, "horizontal"), (fy, height, "vertical")):
        _check_field_of_view(path, focal, size, axis)
    return Intrinsics(width, height, fx, fy, cx, cy)


def read_poses(path: Path) -> tuple[tuple[str, ...], NDArray]:
    """Read the frames' names and poses; blank lines and lines that start with # are skipped.

    Returns:
        The names, in the order of the file, and float64 [n, 4, 4] ``T_world_camera``, metres.

    Raises:
        InputError: A line has another number of columns, something that is not a finite number, a matrix that is no
            rigid transform, a frame that was there before or a camera far away; or there is no line at all.
    """
    seen: dict[str, int] = {}
    poses = []
    for number, line in lines(path):
        name, *columns = line.split()
        where = f"{path}, line {number}"
        if len(columns) != 16:
            raise InputError(f"{where}: expected a frame name and 16 numbers, found {len(columns)} after the name")
        check_frame_name(where, name)
        if len(seen) == MAX_FRAMES:
            raise InputError(f"{where}: expected at most {MAX_FRAMES} frames, found more")
        if name in seen:
            raise InputError(f"{where}: expected each frame once, found {name} again (first in line {seen[name]})")
        seen[name] = number
        poses.append(_pose(f"{where}, frame {name}", np.array(_numbers(path, number, columns)).reshape(4, 4)))
    if not poses:
        raise InputError(f"{path}: expected a pose per frame, found none")
    T_world_camera = np.stack(poses)
    _check_reach(path, seen, T_world_camera[:, :3, 3])
    return tuple(seen), T_world_camera


def _pose(where: str, T_world_camera: NDArray) -> NDArray:
    if not np.allclose(T_world_camera[3], (0, 0, 0, 1), atol=1e-6):
        hint = "; is the matrix written column by column?" if np.allclose(T_world_camera[:, 3], (0, 0, 0, 1)) else ""
        found = " ".join(f"{x:g}" for x in T_world_camera[3])
        raise InputError(f"{where}: expected 0 0 0 1 as the last row, found {found}{hint}")
    check_rotation(T_world_camera[:3, :3], where)
    return T_world_camera


def _check_reach(path: Path, line_of: dict[str, int], positions: NDArray) -> None:
    distances = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    if not distances.max() <= REACH_M:  # NaN is not less
        frame = list(line_of)[int(distances.argmax())]
        raise InputError(
            f"{path}, line {line_of[frame]}, frame {frame}: expected a camera within {REACH_M:g} m of the others, "
            f"found one {distances.max():.4g} m away; are the positions in metres?"
        )


def _numbers(path: Path, line: int, words: list[str]) -> list[float]:
    numbers = []
    for word in words:
        try:
            number = float(word)
        except ValueError:
            number = np.nan
        if not np.isfinite(number):
            raise InputError(f"{path}, line {line}: expected finite numbers, found {word[:30]!r}")
        numbers.append(number)
    return numbers


def _check_field_of_view(path: Path, focal: float, size: int, axis: str) -> None:
    degrees = float(np.rad2deg(2 * np.arctan(size / 2 / focal)))
    low, high = FIELD_OF_VIEW_DEG
    if not low <= degrees <= high:
        raise InputError(
            f"{path}: expected a {axis} field of view of {low:g} to {high:g} degrees, found {degrees:.3g} "
            f"(focal length {focal:g} for {size} pixels); is the matrix for images of another size?"
        )
