"""What a reader returns: a recording in metres, OpenCV camera axes and camera-to-world poses, whatever its format."""

import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.structures import Intrinsics, Segment, Segmentation

T = TypeVar("T")


@dataclass(frozen=True)
class FormatFacts:
    """What the files of a format mean: a row of the table in docs/FORMATS.md."""

    title: str
    recognised_by: str
    """Files that have to be there."""
    pose: str
    """As stored."""
    depth: str = "16-bit PNG"
    """Kind of the depth images."""
    depth_unit_m: float = 0.001
    """Metres that a stored 1 means."""
    invalid: str = "0"
    """Stored values that mean "no reading"."""
    camera_axes: str = "OpenCV"
    """"OpenCV" (x right, y down, z forward) or "OpenGL" (x right, y up, z backward), as stored."""
    up: tuple[float, float, float] | None = None
    """World's up direction; None = estimated from the depth images."""
    segmentation: str = "none"


@dataclass(frozen=True, eq=False)
class Segments:
    """The segmentation that a recording brings along."""

    classes: Mapping[str, bool]
    """{class name: is it a thing}."""
    read: Callable[[int], Segmentation]
    """Decode the segmentation of a frame."""
    source: str
    """Who made it, in words."""
    world: Mapping[int, Segment] | None = None
    """What ids mean when they are the same objects in every frame; None = ids per frame."""
    ground_truth: bool = False
    table: Path | None = None
    """The JSON file that says what the ids are, where there is one."""
    stored: Callable[[int], Path] | None = None
    """The id image of a frame; None = it has none of its own."""


@dataclass(frozen=True, eq=False)
class Recording:
    """An opened recording; reading keeps no state that a second thread could disturb."""

    facts: FormatFacts
    path: Path
    """Folder or file; opening it again gives the same."""
    name: str
    frame_names: tuple[str, ...]
    """In order, without blanks."""
    poses: NDArray
    """float64 [n, 4, 4], ``T_world_camera``, OpenCV axes, metres."""
    intrinsics: Intrinsics
    """The camera of depth and colour as ``depth`` and ``color`` return them."""
    depth: Callable[[int], NDArray]
    """float32 [H, W], metres along the optical axis, 0 = invalid."""
    color: Callable[[int], NDArray]
    """uint8 [H, W, 3], RGB, seen through the same camera as the depth."""
    color_file: Callable[[int], Path | None] = lambda _: None
    """The file that holds exactly that colour image, if there is one."""
    stored: Callable[[int], tuple[Path, Path]] | None = None
    """The files that colour and depth of a frame are in; None = the recording's own path."""
    segments: Segments | None = None
    depth_unit_m: float | None = None
    """Unit for 16-bit depth images written from it; None = the format's."""
    notes: tuple[str, ...] = ()
    """What was left out, as the format has it, in words: frames without depth, or where tracking was lost."""
    faults: tuple[str, ...] = ()
    """What was left out because something of it is missing or damaged, in words."""
    simulated: bool = False
    floor_height_m: float | None = None
    """Height of the floor along the format's up; None = estimated from the depth images."""
    description: str | None = None
    """In words; None = the format's title."""


@dataclass(frozen=True)
class Reader:
    """Recognises and opens the recordings of one format; registered by one line in ``datasets/open.py``."""

    facts: FormatFacts
    recognise: Callable[[Path], bool]
    """Returns whether a folder or file is in this format, from names alone."""
    open: Callable[[Path], Recording]
    """Opens a recording; raises InputError for anything that is not as the format wants it."""


def left_out(count: int, total: int, which: str) -> tuple[str, ...]:
    """Return the note on what was left out of a recording; none when nothing was."""
    return (f"{count} of {total} {which}: left out",) if count else ()


MAX_TRIED = 20
"""When none of so many first frames can be read, the recording is at fault, not a frame."""


def first_readable(read: Callable[[int], T], count: int, *, strict: bool = False) -> T:
    """Return what reading the first of so many frames gives, or else the next that can be read.

    Raises:
        InputError: The first cannot be read, nor any of `MAX_TRIED`; with ``strict``, the first cannot.
    """
    error = None
    for index in range(1 if strict else min(count, MAX_TRIED)):
        try:
            return read(index)
        except InputError as found:
            error = error or found
    raise error or InputError("expected a frame, found none")


@contextmanager
def complete(path: Path, title: str) -> Iterator[None]:
    """Turn errors that Python raises for incomplete contents of a recording into InputError."""
    try:
        yield
    except (KeyError, TypeError, IndexError, AttributeError, ArithmeticError, ValueError, struct.error) as error:
        why = " ".join(repr(error).split())[:200]
        raise InputError(
            f"{path}: expected a complete {title} recording, found that it lacks something ({why})"
        ) from error
