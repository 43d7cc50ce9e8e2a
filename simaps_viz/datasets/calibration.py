"""Read and check the cameras and poses of recordings, and show pictures of one camera as another would take them.

Formats keep both in text; every error message names the file and the line.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.errors import InputError
from simaps_viz.geometry import check_rotation
from simaps_viz.io.limits import MAX_FRAMES, MAX_TEXT_BYTES, check_file, check_frame_name, check_picture
from simaps_viz.structures import Intrinsics

FIELD_OF_VIEW_DEG = (20.0, 150.0)
"""A pinhole camera outside this range is a mistake in the file, not a camera."""

REACH_M = 1000.0
"""Largest distance of a camera from the median one, metres; beyond it the grid would not fit in memory."""


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


OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Half a turn about x: points with OpenGL camera axes (y up, z backward) to OpenCV's, and back."""


def lines(path: Path) -> list[tuple[int, str]]:
    """Return (line number, text) of the lines that say something; # starts a comment line.

    Raises:
        InputError: The file is missing, too large or not text.
    """
    check_file(path, MAX_TEXT_BYTES, "a text file")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: expected a text file, found {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected a text file, found bytes that are not UTF-8") from error
    numbered = enumerate(text.split("\n"), start=1)
    return [(i, line) for i, line in numbered if line.strip() and not line.lstrip().startswith("#")]


def words(path: Path) -> list[tuple[int, list[str]]]:
    """Return (line number, words) of the lines that say something; errors as `lines`."""
    return [(number, line.split()) for number, line in lines(path)]


def numbers(where: str, found: list[str]) -> NDArray:
    """Turn words to float64 numbers, infinite ones included; raises InputError for the first that is none."""
    values = []
    for word in found:
        try:
            values.append(float(word))
        except ValueError as error:
            raise InputError(f"{where}: expected numbers, found {word[:30]!r}") from error
    return np.array(values)


def number_rows(path: Path, columns: int) -> list[tuple[str, NDArray]]:
    """Return (where, float64 [columns]) of each line; raises InputError when one has another number of columns."""
    rows = []
    for line, found in words(path):
        where = f"{path}, line {line}"
        if len(found) != columns:
            raise InputError(f"{where}: expected {columns} numbers, found {len(found)}")
        rows.append((where, numbers(where, found)))
    if not rows:
        raise InputError(f"{path}: expected lines of {columns} numbers, found none")
    return rows


def matrix4(path: Path) -> NDArray:
    """Read a 4x4 matrix, which may hold infinities; raises InputError for any other number of numbers."""
    found = [word for _, line in words(path) for word in line]
    if len(found) != 16:
        raise InputError(f"{path}: expected a 4x4 matrix, found {len(found)} numbers")
    return numbers(str(path), found).reshape(4, 4)


def rigid(where: str, matrix: ArrayLike) -> NDArray:
    """Check that a [4, 4] matrix moves without stretching, and square its rotation up.

    Formats store matrices with few digits; the nearest rotation (singular value decomposition) is taken.

    Raises:
        InputError: It is not finite, its last row is not 0 0 0 1, or its rotation is off by more than 0.01.
    """
    T = np.array(matrix, dtype=np.float64)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise InputError(f"{where}: expected a 4x4 matrix of finite numbers, found {_kind(T)}")
    if not np.allclose(T[3], (0, 0, 0, 1), atol=1e-4):
        found = " ".join(f"{x:g}" for x in T[3])
        raise InputError(f"{where}: expected 0 0 0 1 as the last row, found {found}")
    check_rotation(T[:3, :3], where)
    if np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > 1e-12:
        u, _, vt = np.linalg.svd(T[:3, :3])
        T[:3, :3] = u @ vt
    T[3] = (0, 0, 0, 1)
    return T


def from_quaternion(where: str, position: ArrayLike, xyzw: ArrayLike) -> NDArray:
    """Make a pose [4, 4] of a position and a quaternion (x, y, z, w), which may be slightly off unit length.

    Raises:
        InputError: A number is not finite, or the length is off by more than a hundredth.
    """
    q, t = np.asarray(xyzw, dtype=np.float64), np.asarray(position, dtype=np.float64)
    length = float(np.linalg.norm(q))
    if not np.isfinite(t).all() or not abs(length - 1.0) < 0.01:
        raise InputError(f"{where}: expected finite numbers and a quaternion of length 1, found length {length:.4g}")
    x, y, z, w = q / length
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = t
    return T


def _kind(T: NDArray) -> str:
    return "NaN or infinity" if T.shape == (4, 4) else "x".join(map(str, T.shape)) + " numbers"


@dataclass(frozen=True)
class Lens:
    """A camera with radial and tangential distortion (Brown-Conrady, as OpenCV writes it)."""

    intrinsics: Intrinsics
    distortion: tuple[float, ...] = ()
    """k1, k2, p1, p2, k3; empty = none."""

    def scaled(self, width: int, height: int) -> "Lens":
        """Return the camera whose pictures are those of this one, resized to width x height pixels."""
        k = self.intrinsics
        if (k.width, k.height) == (width, height):
            return self
        sx, sy = width / k.width, height / k.height
        return Lens(
            Intrinsics(width, height, k.fx * sx, k.fy * sy, (k.cx + 0.5) * sx - 0.5, (k.cy + 0.5) * sy - 0.5),
            self.distortion,
        )


def pinhole(where: str, width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> Intrinsics:
    """Check a camera (pixels, pixel centres at whole numbers) and return it.

    Raises:
        InputError: It is not finite, its principal point is outside the picture or its field of view not a camera's.
    """
    if not np.isfinite([fx, fy, cx, cy]).all() or min(fx, fy, width, height) <= 0:
        raise InputError(f"{where}: expected a size and focal lengths over 0, found {width}x{height}, {fx:g}, {fy:g}")
    check_picture(where, width, height)
    if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
        found = f"({cx:g}, {cy:g})"
        raise InputError(f"{where}: expected the principal point inside the {width}x{height} image, found {found}")
    low, high = FIELD_OF_VIEW_DEG
    for focal, size in ((fx, width), (fy, height)):
        degrees = float(np.rad2deg(2 * np.arctan(size / 2 / focal)))
        if not low <= degrees <= high:
            raise InputError(
                f"{where}: expected a field of view of {low:g} to {high:g} degrees, found {degrees:.3g} "
                f"(focal length {focal:g} for {size} pixels)"
            )
    return Intrinsics(int(width), int(height), float(fx), float(fy), float(cx), float(cy))


def see_through(image: NDArray, source: Lens, target: Intrinsics, *, exact: bool) -> NDArray:
    """Show a picture of one camera as the other would have taken it; outside of what was seen is 0.

    Both stand at the same place and look the same way, so depth along the optical axis stays what it is.

    Args:
        image: [H, W] or [H, W, 3] of ``source``.
        source: the camera that took it.
        target: the camera wanted, a pinhole.
        exact: take the nearest pixel (depth, ids) rather than mix neighbours (colour).
    """
    if _same(source, target):
        return image
    u, v = _pixels(source, target)
    if exact and image.dtype == np.int32:  # which OpenCV does not remap
        image = image.astype(np.float32)  # ids stay whole: they are under 2^24
        return np.rint(_remap(image, u, v, cv2.INTER_NEAREST)).astype(np.int32)
    return _remap(image, u, v, cv2.INTER_NEAREST if exact else cv2.INTER_LINEAR)


def _remap(image: NDArray, u: NDArray, v: NDArray, how: int) -> NDArray:
    return cv2.remap(image, u, v, how, borderMode=cv2.BORDER_CONSTANT, borderValue=0)


def _same(source: Lens, target: Intrinsics) -> bool:
    k = source.intrinsics
    if any(source.distortion) or (k.width, k.height) != (target.width, target.height):
        return False
    return bool(np.allclose(k.matrix(), target.matrix(), rtol=0, atol=1e-3))


@lru_cache(maxsize=8)
def _pixels(source: Lens, target: Intrinsics) -> tuple[NDArray, NDArray]:
    """Return float32 [H, W] twice: where each pixel of the target lies in the source's picture."""
    row, column = np.mgrid[: target.height, : target.width].astype(np.float64)
    x, y = (column - target.cx) / target.fx, (row - target.cy) / target.fy
    k1, k2, p1, p2, k3 = (*source.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    x, y = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    k = source.intrinsics
    return (x * k.fx + k.cx).astype(np.float32), (y * k.fy + k.cy).astype(np.float32)
