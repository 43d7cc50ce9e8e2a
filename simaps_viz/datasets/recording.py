"""What a reader of a foreign format hands over: everything already in metres, OpenCV axes and camera-to-world poses."""

import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.structures import Intrinsics, Segment, Segmentation


@dataclass(frozen=True)
class FormatFacts:
    """What a format's files mean, as its reader takes them: a row of the table in docs/FORMATS.md."""

    title: str
    recognised_by: str
    """Files that have to be there."""
    depth: str
    """Kind of the depth images."""
    depth_unit_m: float
    """Metres that a stored 1 means."""
    invalid: str
    """Stored values that mean "no reading"."""
    pose: str
    """As stored."""
    camera_axes: str
    """"OpenCV" (x right, y down, z forward) or "OpenGL" (x right, y up, z backward), as stored."""
    up: tuple[float, float, float] | None
    """World's up direction; None = estimated from the depth images. The floor's height is always estimated."""
    segmentation: str = "none"


@dataclass(frozen=True, eq=False)
class Segments:
    """Segmentation that a format brings along."""

    classes: Mapping[str, bool]
    """{class name: is it a thing}."""
    read: Callable[[int], Segmentation]
    """Decode a frame's."""
    source: str
    """In words."""
    world: Mapping[int, Segment] | None = None
    """What ids mean when they are the same objects in every frame; None = ids per frame."""
    ground_truth: bool = False


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
    """Of depth and colour as they are handed over."""
    depth: Callable[[int], NDArray]
    """float32 [H, W], metres along the optical axis, 0 = invalid."""
    color: Callable[[int], NDArray]
    """uint8 [H, W, 3], RGB, seen through the same camera as the depth."""
    color_file: Callable[[int], Path | None] = field(default=lambda _: None)
    """The file that holds exactly that colour image, if there is one."""
    stored: Callable[[int], tuple[Path, Path]] | None = None
    """The files that colour and depth of a frame lie in; None = the recording's own path."""
    segments: Segments | None = None
    depth_unit_m: float | None = None
    """Unit for 16-bit depth images written of it; None = the format's."""
    notes: tuple[str, ...] = ()
    """What was left out, in words."""
    simulated: bool = False
    floor_height_m: float | None = None
    """Height of the floor along the format's up; None = estimated from the depth images."""


@contextmanager
def whole(path: Path, title: str) -> Iterator[None]:
    """Turn what Python raises where a recording's contents lack something into InputError."""
    try:
        yield
    except (KeyError, TypeError, IndexError, AttributeError, ArithmeticError, ValueError, struct.error) as error:
        why = " ".join(repr(error).split())[:200]
        raise InputError(
            f"{path}: expected a whole {title} recording, found that it lacks something ({why})"
        ) from error
