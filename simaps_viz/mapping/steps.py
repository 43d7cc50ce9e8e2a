"""One step of a build: all that one frame adds to the map, small enough to be kept, exact enough to be replayed."""

import json
import struct
import zlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.io.limits import MAX_CELL_INDEX, MAX_LINKED_CELL, MAX_SEGMENT_ID
from simaps_viz.mapping.links import Links
from simaps_viz.mapping.observations import FrameReadings
from simaps_viz.structures import Segment

_TYPES = tuple(np.dtype(t) for t in ("i1", "<i2", "<i4", "<i8", "u1", "<f4", "<f8"))
_ARRAY = struct.Struct("<BI")
_HEAD = struct.Struct("<iI")


@dataclass(frozen=True, eq=False)
class FrameSeen:
    """What is remembered of one frame: where it was taken, what it saw and what its segments are."""

    index: int
    """In the sequence."""
    name: str
    T_map_camera: NDArray
    """float64 [4, 4]."""
    readings: FrameReadings
    segments: tuple[Segment, ...]
    skipped: str = ""
    """Why the frame could not be read, in words; it saw nothing then."""


@dataclass(frozen=True, eq=False)
class FrameStep:
    """All that one frame adds to a map, in whatever order frames come; `MapAccumulator.replay` takes it."""

    seen: FrameSeen
    lowered: NDArray
    """bool [readings]: cells whose lowest obstacle pixel so far is this frame's."""
    lowest_m: NDArray
    """float32 [lowered cells], that pixel over the floor."""
    links: Links | None = None
    """Of this frame alone, in the order it met them; None when nobody counts links."""


def step_upon(step: FrameStep, lowest_m: NDArray) -> FrameStep:
    """Return the step that a frame is upon others than it was gathered upon: what is still lower than what they saw.

    Args:
        step: gathered upon some of these others, or upon none.
        lowest_m: float32, of the step's lowered cells: the lowest obstacle pixel of the others, inf = none.
    """
    lower = step.lowest_m < lowest_m
    if lower.all():
        return step
    lowered = step.lowered.copy()
    lowered[lowered] = lower
    return replace(step, lowered=lowered, lowest_m=step.lowest_m[lower])


def pack_step(step: FrameStep) -> bytes:
    """Write a step as bytes; nothing is lost."""
    seen, readings = step.seen, step.seen.readings
    about = {
        "name": seen.name,
        "skipped": seen.skipped,
        "segments": [[s.id, s.label, s.score, s.is_thing] for s in seen.segments],
        "links": step.links is not None,
    }
    arrays = [
        seen.T_map_camera.reshape(-1),
        _steps_of(readings.rows),
        _steps_of(readings.cols),
        _narrowed(readings.segments),
        readings.height_m,
        np.packbits(step.lowered),
        step.lowest_m,
    ]
    if step.links is not None:
        cells = step.links.cells
        first_to_second = cells[:, 2:] - cells[:, :2]
        arrays += [_steps_of(cells[:, 0]), _steps_of(cells[:, 1])]
        arrays += [_narrowed(first_to_second[:, 0]), _narrowed(first_to_second[:, 1])]
        arrays += [_narrowed(step.links.labels), _narrowed(step.links.counts)]
    words = json.dumps(about, separators=(",", ":")).encode()
    return b"".join([_HEAD.pack(seen.index, len(words)), words, *[_packed(a) for a in arrays]])


def unpack_step(data: bytes) -> FrameStep:
    """Read what `pack_step` wrote.

    Raises:
        ValueError, KeyError, TypeError, struct.error: it is something else.
    """
    try:
        return _step_in(data)
    except (IndexError, AttributeError, OverflowError, RecursionError, MemoryError) as error:
        raise ValueError(f"a step that makes no sense ({type(error).__name__})") from error


def _step_in(data: bytes) -> FrameStep:
    index, length = _HEAD.unpack_from(data)
    about = json.loads(data[_HEAD.size : _HEAD.size + length])
    arrays, at = [], _HEAD.size + length
    while at < len(data):
        array, at = _unpacked(data, at)
        arrays.append(array)
    pose, rows, cols, segments, heights, lowered, lowest = arrays[:7]
    floats = [i for i, array in enumerate(arrays) if array.dtype.kind == "f"]
    if floats != [0, 4, 6] or lowered.dtype != np.uint8:
        raise ValueError("arrays of other kinds")
    if not np.isfinite(pose).all() or not np.isfinite(heights).all() or not np.isfinite(lowest).all():
        raise ValueError("numbers that are not finite")
    readings = FrameReadings(_summed(rows), _summed(cols), segments.astype(np.int32), heights)
    seen = FrameSeen(
        index=index,
        name=about["name"],
        T_map_camera=pose.reshape(4, 4),
        readings=readings,
        segments=tuple(_segment(*one) for one in about["segments"]),
        skipped=about["skipped"],
    )
    if not isinstance(seen.name, str) or not isinstance(seen.skipped, str):
        raise ValueError("names that are none")
    mask = np.unpackbits(lowered, count=len(rows)).astype(bool)
    if not len(rows) == len(cols) == len(segments) == len(heights) or mask.sum() != len(lowest):
        raise ValueError("readings of different lengths")
    return FrameStep(seen, mask, lowest, _links(arrays[7:]) if about["links"] else None)


def _segment(number: int, label: str, score: float, is_thing: bool) -> Segment:
    fine = type(number) is int and 1 <= number <= MAX_SEGMENT_ID and isinstance(label, str) and type(is_thing) is bool
    if not fine or not isinstance(score, int | float) or not 0 <= score <= 1:
        raise ValueError("a segment that is none")
    return Segment(number, label, score, is_thing)


def _links(arrays: list[NDArray]) -> Links:
    rows, cols, down, right, labels, counts = arrays
    first = np.stack([_summed(rows), _summed(cols)], axis=1)
    second = first + np.stack([down, right], axis=1)
    cells = np.concatenate([first, second], axis=1)
    if cells.size and not -MAX_LINKED_CELL <= int(cells.min()) <= int(cells.max()) < MAX_LINKED_CELL:
        raise ValueError("links of cells farther from the origin than links reach")
    cells = cells.astype(np.int32)
    return Links(cells, labels.astype(np.int16), counts.astype(np.int64))


def _steps_of(values: NDArray) -> NDArray:
    """Return the differences from one to the next, which are small: neighbours follow each other."""
    return _narrowed(np.diff(values, prepend=values.dtype.type(0)))


def _summed(differences: NDArray) -> NDArray:
    found = np.cumsum(differences, dtype=np.int64)
    if len(found) and not -MAX_CELL_INDEX < int(found.min()) <= int(found.max()) < MAX_CELL_INDEX:
        raise ValueError("cells farther from the origin than a map reaches")
    return found.astype(np.int32)


def _narrowed(values: NDArray) -> NDArray:
    """Return whole numbers in the smallest type that holds them all."""
    low, high = (int(values.min()), int(values.max())) if len(values) else (0, 0)
    for dtype in _TYPES[:3]:
        limits = np.iinfo(dtype)
        if limits.min <= low and high <= limits.max:
            return values.astype(dtype)
    return values.astype(np.int64)


def _packed(array: NDArray) -> bytes:
    return _ARRAY.pack(_TYPES.index(array.dtype), len(array)) + np.ascontiguousarray(array).tobytes()


def _unpacked(data: bytes, at: int) -> tuple[NDArray, int]:
    kind, length = _ARRAY.unpack_from(data, at)
    at += _ARRAY.size
    return np.frombuffer(data, _TYPES[kind], length, at).copy(), at + length * _TYPES[kind].itemsize


def squeeze(data: bytes) -> bytes:
    """Make a packed step smaller; costs some 0.2 ms."""
    return zlib.compress(data, 1)


def unsqueeze(data: bytes, *, most: int) -> bytes:
    """Undo `squeeze`.

    Raises:
        ValueError: it is something else, or longer than ``most`` bytes.
    """
    machine = zlib.decompressobj()
    try:
        whole = machine.decompress(data, most)
    except zlib.error as error:
        raise ValueError(f"not squeezed data ({error})") from error
    if not machine.eof:
        raise ValueError("squeezed data that is cut or too long")
    return whole
