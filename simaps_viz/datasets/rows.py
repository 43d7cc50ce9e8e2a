"""Reads the text that foreign formats keep poses and cameras in; every complaint names the file and the line."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.errors import InputError
from simaps_viz.geometry import check_rotation
from simaps_viz.io.limits import MAX_TEXT_BYTES, check_file

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
