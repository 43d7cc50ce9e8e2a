"""Limits on what is read: every reader checks them before it allocates memory. docs/RELIABILITY.md has the table.

They are far above what cameras, scanners and buildings of 500 m x 500 m need. An input beyond them is damaged, hostile
or not meant for this program, and is refused with one line.
"""

from collections.abc import Iterable
from pathlib import Path

from simaps_viz.errors import InputError

MAX_IMAGE_PIXELS = 1 << 26
"""Pixels of an image, 8192 x 8192; decoding one takes 200 MB."""
MAX_IMAGE_SIDE = 16_384
"""Pixels along one side of an image."""
MAX_IMAGE_BYTES = 1 << 28
"""Bytes of an image file."""
MAX_FRAMES = 1_000_000
"""Frames of a sequence; 9 hours at 30 a second."""
MAX_TEXT_BYTES = 1 << 28
"""Bytes of a text file: a million poses."""
MAX_JSON_BYTES = 1 << 27
"""Bytes of a JSON file, which takes about ten times as much memory."""
MAX_ARRAY_BYTES = 1 << 30
"""Bytes of one array in a file."""
MAX_CLOUD_POINTS = 100_000_000
"""Points of one point cloud."""
MAX_CLOUD_BYTES = 1 << 33
"""Bytes of a point cloud file."""
MAX_MAP_CELLS = 1 << 27
"""Cells of a map: 579 m x 579 m with cells of 0.05 m, which takes 7 GB to build, 2 GB to open with all its layers."""
MAX_CELL_INDEX = 1 << 29
"""Cells from the map's origin, either way: 26,000 km with cells of 0.05 m."""
MAX_LINKED_CELL = 1 << 15
"""The same where links of cells are counted (method paper): 1638 m; a link's key has 16 bits for each number."""
MAX_EDITS_BYTES = 1 << 26
"""Bytes of an edits file."""
MAX_BUILDING_BYTES = 1 << 22
"""Bytes of a building file."""
MAX_MEMBER_BYTES = 1 << 28
"""Bytes of a file inside an archive, unpacked."""
MAX_NAME = 200
"""Characters of a frame's name."""
MAX_SEGMENT_ID = (1 << 24) - 1
"""Highest id of a segment: what fits the pixels of a COCO panoptic image."""
MAX_STEP_BYTES = 1 << 28
"""Bytes of what one frame adds to a map, in a build log."""
MAX_HISTORY_BYTES = 1 << 33
"""Bytes of the readings of a build, unpacked, when a history is opened."""
MAX_CLASSES = 30_000
"""Class names of a map: its layers hold them as 16-bit numbers."""


def check_file(path: Path, most: int, what: str) -> None:
    """Raise InputError for a file of more than ``most`` bytes; a missing file is the error of the reader.

    Anything but a regular file is refused too: a pipe or a device has no size, and may never end. So is what Git leaves
    in place of a file that was not fetched.
    """
    try:
        size = path.stat().st_size if path.is_file() or not path.exists() or path.is_dir() else None
    except (OSError, ValueError):
        return
    if size is None:
        raise InputError(f"{path}: expected {what}, found something that is no file")
    if size > most and not path.is_dir():
        raise InputError(f"{path}: expected {what} of at most {most} bytes, found {size}")
    if is_lfs_pointer(path):
        raise InputError(f"{path}: expected {what}, found {LFS_POINTER}")


def read_bytes(path: Path, most: int, what: str) -> bytes:
    """Read a file of at most ``most`` bytes; raise InputError, which names ``what`` was expected, when it cannot be."""
    check_file(path, most, what)
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        found = error.strerror if isinstance(error, OSError) else None
        raise InputError(f"{path}: expected {what}, found {found or error}") from error


_LFS_START = b"version https://git-lfs.github.com/spec/"
LFS_POINTER = "a pointer of Git LFS to it; fetch the file itself with: git lfs pull"


def is_lfs_pointer(path: Path) -> bool:
    """Return whether a file is what Git leaves in place of a large one that was not fetched."""
    try:
        with path.open("rb") as file:
            return file.read(len(_LFS_START)) == _LFS_START
    except (OSError, ValueError):
        return False


def check_picture(where: object, width: int, height: int) -> None:
    """Raise InputError for an image larger than any camera takes."""
    if not (1 <= width <= MAX_IMAGE_SIDE and 1 <= height <= MAX_IMAGE_SIDE and width * height <= MAX_IMAGE_PIXELS):
        raise InputError(
            f"{where}: expected a picture of at most {MAX_IMAGE_SIDE} pixels a side and {MAX_IMAGE_PIXELS} in all, "
            f"found {width}x{height}"
        )


def check_port(port: int) -> None:
    """Raise InputError for a number that is no port; 0 means any free one."""
    if not 0 <= port <= 65_535:
        raise InputError(f"--port: expected 0 to 65535, found {port}")


def check_cells(where: object, rows: int, cols: int) -> None:
    """Raise InputError for a grid larger than a map may be."""
    if rows * cols > MAX_MAP_CELLS:
        raise InputError(
            f"{where}: expected a map of at most {MAX_MAP_CELLS} cells, found {rows} x {cols}; are the positions in "
            "metres, and is the cell size right?"
        )


def check_camera(camera_xy_m: Iterable[float], reach_m: float, cell_size_m: float) -> None:
    """Raise InputError for a camera, x and y in the map frame, that could see farther out than a map may reach."""
    found, most_m = [float(at) for at in camera_xy_m], MAX_CELL_INDEX * cell_size_m
    if not all(abs(at) + reach_m < most_m for at in found):  # NaN is not less
        raise InputError(f"map: expected cameras within {most_m:g} m of its origin, found {found}")


def check_frame_name(where: object, name: str) -> None:
    """Raise InputError for a frame name that cannot be part of a file name, or leads out of its folder."""
    if not name or len(name) > MAX_NAME or not name.isprintable() or not _encodable(name):
        raise InputError(f"{where}: expected a frame name of 1 to {MAX_NAME} printable characters, found {name[:30]!r}")
    if "\\" in name or any(part in ("", ".", "..") for part in name.split("/")):
        raise InputError(f"{where}: expected a frame name that stays in its folder, found {name[:60]!r}")


def _encodable(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
