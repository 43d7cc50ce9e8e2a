"""What readers of point cloud files share."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_CLOUD_BYTES, MAX_CLOUD_POINTS, check_file


def read_cloud(path: Path) -> bytes:
    """Read the bytes of a cloud's file; raises InputError when it is missing or too large."""
    check_file(path, MAX_CLOUD_BYTES, "a point cloud")
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        found = error.strerror if isinstance(error, OSError) else None
        raise InputError(f"{path}: expected a point cloud, found {found or error}") from error


def whole_number(path: Path, what: str, word: str) -> int:
    """Read how many there are of something; raises InputError for what is no sensible number."""
    if not word.isascii() or not word.isdigit() or len(word) > 12 or int(word) > MAX_CLOUD_POINTS:
        raise InputError(f"{path}: {what}: expected a whole number up to {MAX_CLOUD_POINTS}, found {word[:30]!r}")
    return int(word)


def parse_rows(path: Path, data: bytes, count: int, columns: int, *, skip: int = 0) -> NDArray:
    """Read ``count`` lines of so many numbers as float64 [count, columns], after ``skip`` other lines.

    Raises:
        InputError: There are fewer lines, or something in them is no number.
    """
    lines = [line for line in data.split(b"\n") if line.strip()][skip : skip + count]
    words = b" ".join(lines).split()
    if len(lines) < count or len(words) != count * columns:
        raise InputError(
            f"{path}: expected {count} lines of {columns} numbers, found {len(words)} numbers in {len(lines)} lines"
        )
    try:
        return np.array(words, dtype="S").astype(np.float64).reshape(count, columns)
    except ValueError as error:
        raise InputError(f"{path}: expected points of numbers, found something else among them") from error


def finite_points(points: NDArray) -> NDArray:
    """Return the points [n, 3] that are finite; drivers write NaN for rays that met nothing."""
    return np.ascontiguousarray(points[np.isfinite(points).all(axis=1)], dtype=np.float64)
