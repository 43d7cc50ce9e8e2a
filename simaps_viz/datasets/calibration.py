"""Read and check the cameras and poses of recordings, and show pictures of one camera as another would take them.

Formats keep both in text; every error message names the file and the line.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.errors import InputError
from simaps_viz.geometry import check_rotation
from simaps_viz.io.limits import MAX_FRAMES, MAX_TEXT_BYTES, check_frame_name, check_picture, read_bytes
from simaps_viz.structures import Intrinsics

FIELD_OF_VIEW_DEG = (20.0, 150.0)
"""A pinhole camera outside this range is a mistake in the file, not a camera."""

REACH_M = 1000.0
"""Largest distance of a camera from the median one, metres; beyond it the grid would not fit in memory."""


def camera_matrix(path: Path, *, commas: bool = False) -> NDArray:
    """Read a file of three lines of three finite numbers, float64 [3, 3]; raises InputError for anything else.

    With ``commas``, they may stand between numbers, too.
    """
    rows = [numbers(f"{path}, line {line}", found, finite=True) for line, found in words(path, commas=commas)]
    if len(rows) != 3 or any(len(row) != 3 for row in rows):
        found = f"{len(rows)} lines of {', '.join(sorted({str(len(row)) for row in rows})) or 'no'} numbers"
        raise InputError(f"{path}: expected a 3x3 camera matrix, found {found}")
    return np.array(rows)


def read_intrinsics(path: Path, *, width: int, height: int) -> Intrinsics:
    """Read and check a 3x3 camera matrix for images of that size, pixels.

    Raises:
        InputError: Not nine numbers in three lines, not a pinhole matrix, or one that does not fit the images.
    """
    K = camera_matrix(path)
    if K[0, 1] or K[1, 0]:
        raise InputError(f"{path}: expected a matrix without skew, found {K[0, 1]:g} and {K[1, 0]:g}")
    if tuple(K[2]) != (0, 0, 1):
        raise InputError(f"{path}: expected 0 0 1 as the last row, found {' '.join(f'{x:g}' for x in K[2])}")
    return pinhole(str(path), width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])


def pose_rows(path: Path) -> dict[str, tuple[str, list[str]]]:
    """Read the frames' names and what is written after them; blank lines and lines that start with # are skipped.

    Returns:
        {frame: (where it stands, the words of its pose, for `matrix16`)}, in the order of the file.

    Raises:
        InputError: A frame was there before or has a name that is none; or there is no line at all.
    """
    rows: dict[str, tuple[str, list[str]]] = {}
    for number, (name, *columns) in words(path):
        where = f"{path}, line {number}"
        check_frame_name(where, name)
        if len(rows) == MAX_FRAMES:
            raise InputError(f"{where}: expected at most {MAX_FRAMES} frames, found more")
        if name in rows:
            first = rows[name][0].rpartition("line ")[2]
            raise InputError(f"{where}: expected each frame once, found {name} again (first in line {first})")
        rows[name] = (where, columns)
    if not rows:
        raise InputError(f"{path}: expected a pose per frame, found none")
    return rows


def stated_pose(where: str, T: NDArray) -> NDArray:
    """Return a pose [4, 4] as it is; raises InputError unless it is a rigid transform."""
    if not np.allclose(T[3], (0, 0, 0, 1), atol=1e-6):
        hint = "; is the matrix written column by column?" if np.allclose(T[:, 3], (0, 0, 0, 1)) else ""
        found = " ".join(f"{x:g}" for x in T[3])
        raise InputError(f"{where}: expected 0 0 0 1 as the last row, found {found}{hint}")
    check_rotation(T[:3, :3], where)
    return T


def check_reach(wheres: Sequence[str], poses: NDArray) -> None:
    """Raise InputError, naming the farthest camera by ``wheres``, unless all are within reach of the median one."""
    positions = poses[:, :3, 3]
    distances = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    if not distances.max() <= REACH_M:  # NaN is not less
        raise InputError(
            f"{wheres[int(distances.argmax())]}: expected a camera within {REACH_M:g} m of the others, found one "
            f"{distances.max():.4g} m away; are the positions in metres?"
        )


OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Half a turn about x: points with OpenGL camera axes (y up, z backward) to OpenCV's, and back."""


def words(path: Path, *, commas: bool = False) -> list[tuple[int, list[str]]]:
    """Return (line number, words) of the lines that say something; # starts a comment line.

    Args:
        path: the file.
        commas: they may stand between words, too.

    Raises:
        InputError: The file is missing, too large or not text.
    """
    try:
        text = read_bytes(path, MAX_TEXT_BYTES, "a text file").decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected a text file, found bytes that are not UTF-8") from error
    text = text.replace(",", " ") if commas else text
    numbered = enumerate(re.split("\r\n|\r|\n", text), start=1)
    return [(i, line.split()) for i, line in numbered if line.strip() and not line.lstrip().startswith("#")]


_WINDOWS = re.compile(r"([+-]?)(?:1\.#)?(INF|IND|QNAN|SNAN|NAN)\d*(?:\(ind\)|\(snan\))?", re.IGNORECASE)
"""How programs that Visual C++ compiled print infinity and NaN: -1.#INF, 1.#QNAN0, -nan(ind)."""


def numbers(where: str, found: list[str], *, finite: bool = False, count: int | None = None) -> NDArray:
    """Turn words to float64 numbers; raises InputError for the first that is none, or not finite where it has to be.

    With ``count``, another number of words is an error, too.
    """
    if count is not None and len(found) != count:
        raise InputError(f"{where}: expected {count} numbers, found {len(found)}")
    values = []
    for word in found:
        try:
            odd = _WINDOWS.fullmatch(word)
            values.append(float(f"{odd[1]}inf" if odd[2].upper() == "INF" else "nan") if odd else float(word))
        except ValueError:
            values.append(None)
        if values[-1] is None or (finite and not math.isfinite(values[-1])):
            raise InputError(f"{where}: expected {'finite ' if finite else ''}numbers, found {word[:30]!r}")
    return np.array(values)


def number_rows(path: Path, columns: int) -> list[tuple[str, list[str]]]:
    """Return (where, words) of each line, of which there has to be one.

    Whoever turns them to numbers, line by line, can leave out one that is cut off.
    """
    rows = [(f"{path}, line {line}", found) for line, found in words(path, commas=True)]
    if not rows:
        raise InputError(f"{path}: expected lines of {columns} numbers, found none")
    return rows


def matrix16(where: str, found: list[str], *, finite: bool = False) -> NDArray:
    """Return the 4x4 matrix of a line; raises InputError unless it has 16 numbers."""
    return numbers(where, found, finite=finite, count=16).reshape(4, 4)


def matrix4(path: Path) -> NDArray:
    """Read a 4x4 matrix, which may hold infinities; raises InputError for any other number of numbers."""
    found = [word for _, line in words(path, commas=True) for word in line]
    if len(found) != 16:
        raise InputError(f"{path}: expected a 4x4 matrix, found {len(found)} numbers")
    return numbers(str(path), found).reshape(4, 4)


def nearest_rotation(matrix: NDArray) -> NDArray:
    """Return the rotation that is nearest to a matrix [3, 3] of positive determinant (singular value decomposition)."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt)


def rigid(where: str, matrix: ArrayLike) -> NDArray:
    """Check that a [4, 4] matrix moves without stretching, and square its rotation up.

    Formats store matrices with few digits; the nearest rotation (singular value decomposition) is taken.

    Raises:
        InputError: It is not finite, its last row is not 0 0 0 1, or its rotation is off by more than 0.01.
    """
    T = np.array(matrix, dtype=np.float64)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        found = "NaN or infinity" if T.shape == (4, 4) else "x".join(map(str, T.shape)) + " numbers"
        raise InputError(f"{where}: expected a 4x4 matrix of finite numbers, found {found}")
    if not np.allclose(T[3], (0, 0, 0, 1), atol=1e-4):
        found = " ".join(f"{x:g}" for x in T[3])
        raise InputError(f"{where}: expected 0 0 0 1 as the last row, found {found}")
    check_rotation(T[:3, :3], where)
    if np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > 1e-12:
        T[:3, :3] = nearest_rotation(T[:3, :3])
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


@dataclass(frozen=True)
class Lens:
    """A camera with the distortion of its lens, as OpenCV writes it."""

    intrinsics: Intrinsics
    distortion: tuple[float, ...] = ()
    """Brown-Conrady: k1, k2, p1, p2, k3, and k4, k5, k6 of the rational model; fisheye: k1, k2, k3, k4."""
    fisheye: bool = False
    """Rays fall on the sensor in proportion to their angle (equidistant, Kannala-Brandt) rather than its tangent."""

    def scaled(self, width: int, height: int) -> "Lens":
        """Return the camera whose pictures are those of this one, resized to width x height pixels."""
        k = self.intrinsics
        if (k.width, k.height) == (width, height):
            return self
        sx, sy = width / k.width, height / k.height
        return Lens(
            Intrinsics(width, height, k.fx * sx, k.fy * sy, (k.cx + 0.5) * sx - 0.5, (k.cy + 0.5) * sy - 0.5),
            self.distortion,
            self.fisheye,
        )


def pinhole(where: str, width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> Intrinsics:
    """Check a camera (pixels, pixel centres at whole numbers) and return it.

    Raises:
        InputError: It is not finite, its principal point is outside the picture or its field of view not a camera's.
    """
    if not np.isfinite([fx, fy, cx, cy]).all() or min(fx, fy, width, height) <= 0:
        raise InputError(
            f"{where}: expected a size and focal lengths over 0, found {width}x{height}, {fx:g} and {fy:g}"
        )
    check_picture(where, width, height)
    if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
        found = f"({cx:g}, {cy:g})"
        raise InputError(f"{where}: expected the principal point inside the {width}x{height} image, found {found}")
    low, high = FIELD_OF_VIEW_DEG
    for focal, size, axis in ((fx, width, "horizontal"), (fy, height, "vertical")):
        degrees = float(np.rad2deg(2 * np.arctan(size / 2 / focal)))
        if not low <= degrees <= high:
            raise InputError(
                f"{where}: expected a {axis} field of view of {low:g} to {high:g} degrees, found {degrees:.3g} (focal "
                f"length {focal:g} for {size} pixels); is the camera one for images of another size?"
            )
    return Intrinsics(int(width), int(height), float(fx), float(fy), float(cx), float(cy))


def matrix_lens(where: str, width: int, height: int, K: NDArray) -> Lens:
    """Return the camera without distortion of a matrix [3, 3] or [4, 4]; raises InputError as `pinhole`."""
    return Lens(pinhole(where, width, height, float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])))


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
    if source.fisheye or any(source.distortion) or (k.width, k.height) != (target.width, target.height):
        return False
    return bool(np.allclose(k.matrix(), target.matrix(), rtol=0, atol=1e-3))


@lru_cache(maxsize=8)
def _pixels(source: Lens, target: Intrinsics) -> tuple[NDArray, NDArray]:
    """Return float32 [H, W] twice: where each pixel of the target lies in the source's picture."""
    row, column = np.mgrid[: target.height, : target.width].astype(np.float64)
    x, y = (column - target.cx) / target.fx, (row - target.cy) / target.fy
    radius = np.sqrt(x * x + y * y)
    scale = _radial(source, radius)
    # Far outside, polynomials turn back, and would show what lies inside a second time.
    steps = np.linspace(0.0, float(radius.max()), 1024)
    turns = np.flatnonzero(np.diff(steps * _radial(source, steps)) <= 0)
    p1, p2 = (0.0, 0.0) if source.fisheye else (*source.distortion, 0.0, 0.0, 0.0, 0.0)[2:4]
    r2 = radius * radius
    x, y = x * scale + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * scale + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    k = source.intrinsics
    u, v = x * k.fx + k.cx, y * k.fy + k.cy
    if len(turns):
        u[radius > steps[turns[0]]] = _OUTSIDE
    return u.astype(np.float32), v.astype(np.float32)


_OUTSIDE = -10.0
"""A pixel that no picture has."""


def _radial(lens: Lens, radius: NDArray) -> NDArray:
    """Return how many times farther from the axis a ray meets the sensor than without distortion.

    Args:
        lens: the camera.
        radius: tangents of the rays' angles to its axis.
    """
    k = (*lens.distortion, *(0.0,) * 8)
    if lens.fisheye:
        angle = np.arctan(radius)
        a2 = angle * angle
        bent = angle * (1 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))))
        return np.divide(bent, radius, out=np.ones_like(radius), where=radius > 0)
    r2 = radius * radius
    return (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])))
