"""Frames whose colour and depth lie in one file each, as most formats have them."""

import os
import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import Lens, see_through
from simaps_viz.datasets.images import image_size, read_color, read_depth
from simaps_viz.datasets.manifest import is_finite_number, shown
from simaps_viz.datasets.recording import FormatFacts, Recording, first_readable
from simaps_viz.errors import InputError
from simaps_viz.io.arrays import read_npy
from simaps_viz.io.limits import MAX_ARRAY_BYTES, check_file, check_picture
from simaps_viz.structures import Intrinsics

K = TypeVar("K", bound=Hashable)

MAX_STEP = 65535
"""The largest value of a 16-bit depth image."""


@dataclass(frozen=True, eq=False)
class Stored:
    """A picture in a file that holds more than it: calling it reads it."""

    where: str
    """Names it in an error."""
    read: Callable[[], NDArray]
    file: Path | None = None

    def __call__(self) -> NDArray:
        """Read it."""
        return self.read()

    def __str__(self) -> str:
        return self.where


@dataclass(frozen=True, eq=False)
class FileFrames:
    """Colour and depth of a recording, each in a file or `Stored`; cameras are one for all frames, or one a frame."""

    color_paths: Sequence[Any]
    """Files, or what else ``read_color`` takes; as text it names itself in an error."""
    depth_paths: Sequence[Any]
    color_lenses: Sequence[Lens]
    depth_lenses: Sequence[Lens]
    read_depth_m: Callable[[Any], NDArray]
    """Returns float32 [H, W], metres, 0 = invalid."""
    read_color: Callable[[Any], NDArray] = read_color
    """Returns uint8 [H, W, 3], RGB."""

    @classmethod
    def of_one_view(
        cls, color: Sequence[Any], depth: Sequence[Any], lenses: Sequence[Lens], read_depth_m: Callable, **more: Any
    ) -> "FileFrames":
        """Return the frames of a camera whose depth images are of another size than the pictures, but show the same."""
        height, width = first_readable(lambda i: read_depth_m(depth[i]), len(depth)).shape
        return cls(color, depth, lenses, [lens.scaled(width, height) for lens in lenses], read_depth_m, **more)

    @property
    def intrinsics(self) -> Intrinsics:
        """Camera of the images that `depth` and `color` return: that of the first depth image."""
        return self.depth_lenses[0].intrinsics

    def depth(self, index: int) -> NDArray:
        """Read a frame's depth, metres; raises InputError when it is damaged or of another size."""
        path, lens = self.depth_paths[index], _of(self.depth_lenses, index)
        depth_m = self.read_depth_m(path)
        check_size(path, depth_m, lens.intrinsics)
        return see_through(depth_m, lens, self.intrinsics, exact=True)

    def color(self, index: int) -> NDArray:
        """Read a frame's colour as the depth camera would see it; raises InputError like ``depth``."""
        path, lens = self.color_paths[index], _of(self.color_lenses, index)
        rgb = self.read_color(path)
        check_size(path, rgb, lens.intrinsics)
        return see_through(rgb, lens, self.intrinsics, exact=False)

    def color_file(self, index: int) -> Path | None:
        """Return the colour file if it can be used as it is."""
        lens = _of(self.color_lenses, index)
        return self.color_paths[index] if lens == Lens(self.intrinsics) else None

    def recording(
        self,
        facts: FormatFacts,
        path: Path,
        *,
        poses: NDArray,
        name: str | None = None,
        frame_names: tuple[str, ...] | None = None,
        **more: Any,
    ) -> Recording:
        """Return the recording of these frames.

        Args:
            facts: of its format.
            path: of it.
            poses: float64 [n, 4, 4], T_world_camera.
            name: by default its folder's.
            frame_names: by default those of the depth files, or numbers where these are not all different.
            more: other members of `Recording`.
        """
        frame_names = names_of(self.depth_paths) if frame_names is None else frame_names
        images: dict[str, Any] = {"depth": self.depth, "color": self.color}
        if isinstance(self.color_paths[0], Path):  # else all is in one file, the recording's
            images |= {"color_file": self.color_file, "stored": self.stored}
        name = name or path.resolve().name
        return Recording(facts, path, name, frame_names, poses, self.intrinsics, **images | more)

    def stored(self, index: int) -> tuple[Path, Path]:
        """Return the files of a frame's colour and depth."""
        depth = self.depth_paths[index]
        return self.color_paths[index], getattr(depth, "file", depth)


def first_size(files: Sequence[Path]) -> tuple[int, int]:
    """Return width and height of the first picture that can be read; raises InputError when none of the first can."""
    return first_readable(lambda i: image_size(files[i]), len(files))


def names_of(files: Sequence[Path]) -> tuple[str, ...]:
    """Return the frames' names: those of their files without suffix and blanks, or numbers where two are the same."""
    names = tuple(file.stem.replace(" ", "_") for file in files)
    return names if len(set(names)) == len(names) else tuple(f"{i:06d}" for i in range(len(names)))


def present(files: Mapping[K, Path]) -> dict[K, Path]:
    """Return those of the files that are there."""
    return {frame: file for frame, file in files.items() if os.path.isfile(file)}  # False also for too long a name


def by_line(files: Sequence[Path], lines: int, *, first: int = 0) -> dict[int, Path]:
    """Return the files by the number of the line, or list entry, that belongs to each, from 0.

    That is its place where there are as many of both, else the number in its name, counted from ``first``.
    """
    if len(files) == lines:
        return dict(enumerate(files))
    return {int(number_of(file)) - first: file for file in files}


def by_stem(files: Sequence[Path]) -> dict[str, Path]:
    """Return the files by their names without the suffix, in their order."""
    return {file.stem: file for file in files}


def depth_png(unit_m: float, *, invalid: int | None = None) -> Callable[[Path], NDArray]:
    """Return a reader of 16-bit images: so many metres a step; 0 and ``invalid`` mean no reading."""

    def read(path: Path) -> NDArray:
        depth_m = read_depth(path, unit_m)
        if invalid is not None:
            depth_m[depth_m == np.float32(invalid) * np.float32(unit_m)] = 0.0
        return depth_m

    return read


def depth_npy(unit_m: float = 1.0) -> Callable[[Path], NDArray]:
    """Return a reader of NumPy files of [H, W] or [H, W, 1] numbers, so many metres each."""

    def read(path: Path) -> NDArray:
        values = read_array(path)
        if values.ndim == 3 and values.shape[2] == 1:
            values = values[..., 0]
        if values.ndim != 2 or values.dtype.kind not in "fui":
            found = f"{values.dtype.name} {list(values.shape)}"
            raise InputError(f"{path}: expected a depth image [H, W] of numbers, found {found}")
        return clean_depth(values * np.float32(unit_m))

    return read


def read_array(path: Path) -> NDArray:
    """Read a picture in a NumPy file, never a pickle; raises InputError when it is missing, too large or damaged."""
    check_file(path, MAX_ARRAY_BYTES, "a NumPy array")
    try:
        with path.open("rb") as file:
            return read_npy(path, file, path.stat().st_size, check=_check_picture(path))
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        found = error.strerror if isinstance(error, OSError) else None
        raise InputError(f"{path}: expected a NumPy array, found {found or error}") from error


def _check_picture(path: Path) -> Callable[[tuple[int, ...], np.dtype], None]:
    def check(shape: tuple[int, ...], dtype: np.dtype) -> None:
        if len(shape) not in (2, 3) or dtype.kind not in "fiu" or (len(shape) == 3 and shape[2] > 4):
            raise InputError(f"{path}: expected an image [H, W] of numbers, found {dtype.name} {list(shape)}")
        check_picture(path, shape[1], shape[0])

    return check


def clean_depth(depth_m: NDArray) -> NDArray:
    """Return depths in metres as float32 with 0 for what is not finite or not in front of the camera."""
    depth_m = depth_m.astype(np.float32, copy=True)
    depth_m[~(np.isfinite(depth_m) & (depth_m > 0))] = 0.0
    return depth_m


def check_size(where: object, image: NDArray, camera: Intrinsics) -> None:
    """Raise InputError unless a picture has the size its camera has."""
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise InputError(f"{where}: expected {camera.width}x{camera.height} pixels, found {width}x{height}")


def numbered(folder: Path, pattern: str) -> list[Path]:
    """Return the files of a folder, sorted by the last number in their names (9 before 10), but for a Mac's "._"."""
    files = (file for file in folder.glob(pattern) if not file.name.startswith("._"))
    return sorted(files, key=lambda path: (number_of(path), path.name))


def number_of(path: Path) -> float:
    """Return the last number in a file's name without its last suffix; -1 when there is none."""
    found = re.findall(r"\d+(?:\.\d+)?", path.stem)
    return float(found[-1]) if found else -1.0


def json_number(where: str, values: object, key: str) -> float:
    """Return a number of a JSON object; raises InputError when it is not there or no number."""
    value = values.get(key) if isinstance(values, dict) else None
    if value is None or not is_finite_number(value):
        raise InputError(f"{where}: {key}: expected a number, found {shown(value) if value is not None else 'none'}")
    return float(value)


def _of(lenses: Sequence[Lens], index: int) -> Lens:
    return lenses[index] if len(lenses) > 1 else lenses[0]
