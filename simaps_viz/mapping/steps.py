"""Steps of a build: what each frame adds to the map, as bytes, the file that holds one step a frame, and their list.

A step is small enough to be kept and exact enough to be replayed. While a map is built its steps are appended to the
build log (`build.build_log`); afterwards the log may be kept, compressed, as the map's history (`mapping.history`).
Both are the same kind of file: 16 bytes of magic, then records, each ``<IIB`` = bytes of content, CRC-32 of the rest,
kind, then the content. The first record is JSON that names what is built (the facts); each later one is the step of one
frame. A record that is cut off or changed ends the file: it and all records behind it count as not written.

What frames saw moves from memory to disk when it becomes too much (`FrameList`), so that memory stays flat. The index,
name and pose of every frame stay in memory, as the map needs them too: about 0.3 kB a frame. What it saw is a hundred
times as much. Once all frames together exceed `HELD_BYTES`, it is read back from the build log or, without a log, from
an unnamed scratch file that disappears with the program.

Why not sqlite3: a prototype with one table of steps (5,000 steps of 32 kB, SQLite 3.40) read back as fast (0.03 ms a
step) and lost no step to SIGKILL, but appending took 0.22 ms instead of 0.05 ms, and
- a database cut at 10 % to 90 % of its length was "malformed" and lost every step, where this file keeps all complete
  records before the cut (a log copied off a robot too early, a power cut);
- pages have no checksums, so the CRC-32 of each step stayed ours;
- a killed build leaves a second file (-wal or -journal); setting the log aside without it lost every step;
- a full disk was reported as "disk I/O error", without the reason of the operating system;
- a hostile file of 4 kB whose table was an endless view kept the reader busy for ever until its schema was checked.
"""

import json
import os
import struct
import tempfile
import threading
import weakref
import zlib
from array import array
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from io import FileIO
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_CELL_INDEX, MAX_LINKED_CELL, MAX_SEGMENT_ID, MAX_STEP_BYTES
from simaps_viz.mapping.links import Links
from simaps_viz.mapping.observations import FrameReadings, FrameRuns, no_readings, no_runs
from simaps_viz.structures import Segment

_TYPES = tuple(np.dtype(t) for t in ("i1", "<i2", "<i4", "<i8", "u1", "<f4", "<f8"))
_ARRAY = struct.Struct("<BI")
_HEAD = struct.Struct("<iI")


@dataclass(frozen=True, eq=False)
class FrameSeen:
    """What a build keeps of one frame: where it was taken, what it saw and what its segments are."""

    index: int
    """Position in the sequence, from 0."""
    name: str
    T_map_camera: NDArray
    """float64 [4, 4], camera (OpenCV axes) to map, metres."""
    readings: FrameReadings
    segments: tuple[Segment, ...]
    skipped: str = ""
    """Why the frame could not be read, as a sentence; it saw nothing then. Empty for a frame that was read."""
    runs: FrameRuns = field(default_factory=no_runs)
    """At which heights it saw surface; none in logs of earlier versions."""
    segmented: bool = True
    """False: no objects were looked for in it, so that what it saw names nothing."""

    @property
    def witness(self) -> "FrameSeen":
        """What the frame can say of objects: itself, or nothing when it was not segmented."""
        return self if self.segmented else replace(self, readings=no_readings(), runs=no_runs())


@dataclass(frozen=True, eq=False)
class FrameStep:
    """All that one frame adds to a map, in whatever order frames come; `MapAccumulator.replay` adds it."""

    seen: FrameSeen
    lowered: NDArray
    """bool [readings]: cells whose lowest obstacle pixel so far is this frame's."""
    lowest_m: NDArray
    """float32 [lowered cells], height of that pixel over the floor, metres."""
    links: Links | None = None
    """The links of this frame alone, in the order it met them; None when links are not counted."""


def step_upon(step: FrameStep, lowest_m: NDArray) -> FrameStep:
    """Return a frame's step after other frames: a cell they saw lower still is not lowered by this frame.

    Args:
        step: the step after none, or some, of these other frames.
        lowest_m: float32 [lowered cells], the lowest obstacle pixel of the other frames there, inf = none.
    """
    lower = step.lowest_m < lowest_m
    if lower.all():
        return step
    lowered = step.lowered.copy()
    lowered[lowered] = lower
    return replace(step, lowered=lowered, lowest_m=step.lowest_m[lower])


def pack_step(step: FrameStep) -> bytes:
    """Return a step as bytes, without loss.

    A head (index, length of the JSON), JSON with name and segments, then arrays, each with a head (type, length).
    Cells follow each other closely: differences from one to the next fit smaller types than positions.
    """
    seen, readings = step.seen, step.seen.readings
    about = {
        "name": seen.name,
        "skipped": seen.skipped,
        "segments": [[s.id, s.label, s.score, s.is_thing] for s in seen.segments],
        "links": step.links is not None,
        "runs": True,
    }
    if not seen.segmented:
        about["segmented"] = False
    arrays = [
        seen.T_map_camera.reshape(-1),
        _differences(readings.rows),
        _differences(readings.cols),
        _narrowed(readings.segments),
        readings.height_m,
        np.packbits(step.lowered),
        step.lowest_m,
        _differences(seen.runs.reading),
        _narrowed(seen.runs.segments),
        seen.runs.low,
        seen.runs.high,
    ]
    if step.links is not None:
        cells = step.links.cells
        first_to_second = cells[:, 2:] - cells[:, :2]
        arrays += [_differences(cells[:, 0]), _differences(cells[:, 1])]
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
        raise ValueError(f"a damaged step ({type(error).__name__})") from error


def _step_in(data: bytes) -> FrameStep:
    # take the bytes apart
    index, length = _HEAD.unpack_from(data)
    about = json.loads(data[_HEAD.size : _HEAD.size + length])
    arrays, at = [], _HEAD.size + length
    while at < len(data):
        array, at = _unpacked(data, at)
        arrays.append(array)
    pose, rows, cols, segments, heights, lowered, lowest = arrays[:7]
    # check types and numbers before anything is computed from them
    floats = [i for i, array in enumerate(arrays) if array.dtype.kind == "f"]
    if floats != [0, 4, 6] or lowered.dtype != np.uint8:
        raise ValueError("arrays of other kinds")
    if not np.isfinite(pose).all() or not np.isfinite(heights).all() or not np.isfinite(lowest).all():
        raise ValueError("numbers that are not finite")
    readings = FrameReadings(_summed(rows), _summed(cols), segments.astype(np.int32), heights)
    runs, rest = (_runs(arrays[7:11], len(rows)), 11) if about.get("runs") else (no_runs(), 7)
    seen = FrameSeen(
        index=index,
        name=about["name"],
        T_map_camera=pose.reshape(4, 4),
        readings=readings,
        segments=tuple(_segment(*one) for one in about["segments"]),
        skipped=about["skipped"],
        runs=runs,
        segmented=about.get("segmented", True) is not False,
    )
    if not isinstance(seen.name, str) or not isinstance(seen.skipped, str):
        raise ValueError("names that are no text")
    mask = np.unpackbits(lowered, count=len(rows)).astype(bool)
    if not len(rows) == len(cols) == len(segments) == len(heights) or mask.sum() != len(lowest):
        raise ValueError("readings of different lengths")
    return FrameStep(seen, mask, lowest, _links(arrays[rest:]) if about["links"] else None)


def _segment(number: int, label: str, score: float, is_thing: bool) -> Segment:
    fine = type(number) is int and 1 <= number <= MAX_SEGMENT_ID and isinstance(label, str) and type(is_thing) is bool
    if not fine or not isinstance(score, int | float) or not 0 <= score <= 1:
        raise ValueError("a malformed segment")
    return Segment(number, label, score, is_thing)


def _runs(arrays: list[NDArray], readings: int) -> FrameRuns:
    steps, segments, low, high = arrays
    reading = _summed(steps)
    fine = len(reading) == len(segments) == len(low) == len(high) and low.dtype == high.dtype == np.int8
    if not fine or (low > high).any() or (len(reading) and not 0 <= int(reading[0]) <= int(reading[-1]) < readings):
        raise ValueError("malformed runs of heights")
    if (np.diff(reading) < 0).any() or (segments < 0).any():
        raise ValueError("malformed runs of heights")
    return FrameRuns(reading, segments.astype(np.int32), low, high)


def _links(arrays: list[NDArray]) -> Links:
    rows, cols, down, right, labels, counts = arrays
    first = np.stack([_summed(rows), _summed(cols)], axis=1)
    second = first + np.stack([down, right], axis=1)
    cells = np.concatenate([first, second], axis=1)
    if cells.size and not -MAX_LINKED_CELL <= int(cells.min()) <= int(cells.max()) < MAX_LINKED_CELL:
        raise ValueError("links of cells farther from the origin than links reach")
    cells = cells.astype(np.int32)
    return Links(cells, labels.astype(np.int16), counts.astype(np.int64))


def _differences(values: NDArray) -> NDArray:
    """Return each number less the one before it, in the smallest type."""
    return _narrowed(np.diff(values, prepend=values.dtype.type(0)))


def _summed(differences: NDArray) -> NDArray:
    """Undo `_differences`."""
    found = np.cumsum(differences, dtype=np.int64)
    if len(found) and not -MAX_CELL_INDEX < int(found.min()) <= int(found.max()) < MAX_CELL_INDEX:
        raise ValueError("cells farther from the origin than a map reaches")
    return found.astype(np.int32)


def _narrowed(values: NDArray) -> NDArray:
    """Return integers in the smallest type that holds them all."""
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


def compress(data: bytes) -> bytes:
    """Return a packed step with fewer bytes; costs about 0.2 ms."""
    return zlib.compress(data, 1)


def decompress(data: bytes, *, most: int = MAX_STEP_BYTES) -> bytes:
    """Undo `compress`.

    Raises:
        ValueError: it is something else, or longer than ``most`` bytes.
    """
    machine = zlib.decompressobj()
    try:
        found = machine.decompress(data, most)
    except zlib.error as error:
        raise ValueError(f"not compressed data ({error})") from error
    if not machine.eof:
        raise ValueError("compressed data that is cut or too long")
    return found


MAGIC = b"SIMAPS STEPS 1\r\n"
FACTS, PLAIN, COMPRESSED = 0, 1, 2
"""Kinds of records."""
RECORD = struct.Struct("<IIB")
"""What precedes the content of a record: bytes of content, CRC-32, kind."""


class StepRecord(NamedTuple):
    """Where the content of a step's record is in the file."""

    offset: int
    """Bytes from the start of the file."""
    length: int
    """Bytes."""
    kind: int
    """`PLAIN` or `COMPRESSED`."""


class ScannedSteps(NamedTuple):
    """The complete records of a file of steps."""

    facts: dict[str, Any] | None
    """What is built; None for another kind of file."""
    records: list[StepRecord]
    """One for each frame."""
    end: int
    """Bytes up to the end of the last complete record."""


class StepReader:
    """Reads the steps of a log or history one by one. Several threads may share it.

    The file stays open: when it is replaced or removed, its steps can still be read.
    """

    def __init__(self, path: Path) -> None:
        """Find all complete records; raises InputError when the file is missing or is something else."""
        self._path, self._lock = path, threading.Lock()
        try:
            self._file = FileIO(path)
        except OSError as error:
            raise InputError(f"{path}: expected the steps of a build, found {error.strerror or error}") from error
        weakref.finalize(self, self._file.close)
        facts, self._records, _ = scan(self._file)
        if facts is None:
            raise InputError(f"{path}: expected the steps of a build, found another kind of file")
        self.facts: dict[str, Any] = facts
        """What is built."""

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._records)

    def read(self, number: int) -> tuple[int, bytes]:
        """Return (kind, content) of a frame's record, for `decode_step`.

        Raises:
            InputError: the file was changed after it was opened, or cannot be read.
        """
        offset, length, kind = self._records[number]
        try:
            with self._lock:
                self._file.seek(offset - RECORD.size)
                data = read_bytes(self._file, RECORD.size + length)
        except OSError as error:
            raise InputError(f"{self._path}: could not be read: {error.strerror or error}") from error
        content = data[RECORD.size :]
        if data != record(kind, content) or len(content) != length:
            raise InputError(f"{self._path}: frame {number} could not be read back, the file was changed")
        return kind, content


def is_step_file(path: Path) -> bool:
    """Return whether a file is the log or history of a build."""
    try:
        with FileIO(path) as file:
            return read_bytes(file, len(MAGIC)) == MAGIC
    except OSError:
        return False


def contents(file: FileIO, records: Sequence[StepRecord]) -> Iterator[tuple[int, bytes]]:
    """Read (kind, content) of each frame's record when it is asked for: a log may be larger than memory."""
    for offset, length, kind in records:
        file.seek(offset)
        yield kind, read_bytes(file, length)


def decode_step(found: tuple[int, bytes]) -> FrameStep:
    """Return the step in a record's (kind, content).

    Raises:
        ValueError, KeyError, TypeError, struct.error: it is something else.
    """
    kind, content = found
    return unpack_step(decompress(content) if kind == COMPRESSED else content)


def record(kind: int, content: bytes) -> bytes:
    """Return a complete record."""
    return RECORD.pack(len(content), zlib.crc32(content, zlib.crc32(bytes([kind]))), kind) + content


def read_bytes(file: FileIO, length: int) -> bytes:
    """Read so many bytes; fewer only at the end of the file."""
    parts = []
    while length > 0:
        part = file.read(length)
        if not part:
            break
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


def scan(file: FileIO) -> ScannedSteps:
    """Find the complete records of a file of steps; whatever is damaged ends them."""
    size = os.fstat(file.fileno()).st_size
    file.seek(0)
    if read_bytes(file, len(MAGIC)) != MAGIC:
        return ScannedSteps(None, [], 0)
    facts: dict[str, Any] | None = None
    records: list[StepRecord] = []
    end = len(MAGIC)
    while True:
        head = read_bytes(file, RECORD.size)
        if len(head) < RECORD.size:
            break
        # A damaged head is recognised before its length is believed; the facts come first, and only once.
        length, crc, kind = RECORD.unpack(head)
        start = end + RECORD.size
        if length > MAX_STEP_BYTES or start + length > size or (kind == FACTS) != (facts is None) or kind > COMPRESSED:
            break
        content = read_bytes(file, length)
        if zlib.crc32(content, zlib.crc32(head[-1:])) != crc:
            break
        if facts is None:
            facts = _facts_in(content)
            if facts is None:
                break
        else:
            records.append(StepRecord(start, length, kind))
        end = start + length
    return ScannedSteps(facts, records, end)


def _facts_in(content: bytes) -> dict[str, Any] | None:
    try:
        facts = json.loads(content)
    except (ValueError, RecursionError):
        return None
    return facts if isinstance(facts, dict) else None


HELD_BYTES = 128 << 20
"""What frames may hold in memory before they move to disk; ordinary sequences never need more."""
_FRAME_BYTES = 1000  # of Python objects
_SEGMENT_BYTES = 300
_ALWAYS_BYTES = 3 * 8 + 2 + 16 * 8 + 8 + 49  # index, position on disk, pose and the name's object


_Kept = TypeVar("_Kept")


class LazySequence(Sequence[_Kept]):
    """A sequence whose entries are made or read when they are asked for, by `at`."""

    def at(self, at: int) -> _Kept:
        """Return an entry; ``at`` is not negative."""
        raise NotImplementedError

    @overload
    def __getitem__(self, at: int) -> _Kept: ...
    @overload
    def __getitem__(self, at: slice) -> list[_Kept]: ...
    def __getitem__(self, at: int | slice) -> _Kept | list[_Kept]:
        where = range(len(self))[at]
        return self.at(where) if isinstance(where, int) else [self.at(i) for i in where]


class FrameList(LazySequence[FrameSeen]):
    """What the frames of a build saw, ascending by index. Frames on disk are read when they are asked for."""

    def __init__(self) -> None:
        """Start empty."""
        self.indices = array("q")
        """The index of each frame in the sequence."""
        self.names: list[str] = []
        self.skipped: dict[int, str] = {}
        """{index: reason} for the frames that could not be read."""
        self._poses = array("d")
        self._offset, self._length, self._file = array("q"), array("q"), array("h")  # file -1 = held
        self._held: dict[int, FrameSeen] = {}
        self._held_bytes = 0
        self._files: list[OnDisk] = []
        self._scratch, self._wasted = -1, 0
        self._log: Path | None = None
        self._logged: Sequence[StepRecord] = ()

    def __len__(self) -> int:
        return len(self.indices)

    def at(self, at: int) -> FrameSeen:
        """Return a frame, by its position in the list; raises InputError when it cannot be read back."""
        if self._file[at] < 0:
            return self._held[self.indices[at]]
        data = self._files[self._file[at]].read(self._offset[at], self._length[at])
        try:
            seen = unpack_step(data).seen.witness
            if seen.index != self.indices[at]:
                raise ValueError("another frame")
        except (ValueError, KeyError, TypeError, struct.error) as error:
            name = self.names[at]
            raise InputError(f"frame {name}: could not be read back, its log was changed ({error})") from error
        return seen

    def __iter__(self) -> Iterator[FrameSeen]:
        return (self[at] for at in range(len(self)))

    @property
    def poses(self) -> NDArray:
        """float64 [n, 4, 4], T_map_camera. A copy."""
        return np.array(self._poses, dtype=np.float64).reshape(-1, 4, 4)

    @property
    def all_held(self) -> bool:
        """Whether all frames are in memory."""
        return len(self._held) == len(self)

    @property
    def nbytes(self) -> int:
        """Approximate bytes of memory that a copy takes: all but what frames saw, which copies share."""
        return len(self) * _ALWAYS_BYTES + sum(map(len, self.names))

    @property
    def held_bytes(self) -> int:
        """Approximate bytes of memory for what frames saw, as far as it is not on disk; copies share it."""
        return self._held_bytes

    def read_from(self, log: Path, records: Sequence[StepRecord]) -> None:
        """Read frames back from a build log that has them, instead of writing them a second time.

        Args:
            log: the file.
            records: where the step of each frame is in it; grows as the log grows.
        """
        self._log, self._logged = log, records

    def append(self, frame: FrameSeen) -> None:
        """Add the next frame.

        Raises:
            InputError: the disk is full.
        """
        self.indices.append(frame.index)
        self.names.append(frame.name)
        self._poses.extend(frame.T_map_camera.reshape(-1).tolist())
        self._offset.append(0)
        self._length.append(0)
        self._file.append(-1)
        if frame.skipped:
            self.skipped[frame.index] = frame.skipped
        self._hold(frame)
        self._limit_memory()

    def drop(self, index: int) -> None:
        """Forget the frame of an index, and its place on disk once frames that are gone hold too much there."""
        at = bisect_left(self.indices, index)
        self.skipped.pop(index, None)
        if (frame := self._held.pop(index, None)) is not None:
            self._held_bytes -= _bytes_of(frame)
        elif self._file[at] == self._scratch:
            self._wasted += self._length[at]
        del self._poses[16 * at : 16 * (at + 1)], self.names[at]
        for entries in (self.indices, self._offset, self._length, self._file):
            del entries[at]
        if self._wasted > HELD_BYTES:
            # into a new file: copies may still read the old one, which goes with the last of them
            old, self._wasted, fresh = self._files[self._scratch], 0, OnDisk(unnamed_file())
            for at, number in enumerate(self._file):
                if number == self._scratch:
                    self._offset[at] = fresh.add(old.read(self._offset[at], self._length[at]))
            self._files[self._scratch] = fresh

    def copy(self) -> "FrameList":
        """Return an independent copy, which shares what frames saw."""
        twin = self._empty()
        for name in ("indices", "_poses", "_offset", "_length", "_file"):
            setattr(twin, name, getattr(self, name)[:])
        twin.names, twin.skipped, twin._held = list(self.names), dict(self.skipped), dict(self._held)
        twin._files, twin._held_bytes = list(self._files), self._held_bytes
        return twin  # writes a scratch file of its own

    def _empty(self) -> "FrameList":
        return FrameList()

    def merge(self, other: "FrameList") -> None:
        """Add the frames of another list, which has none of the same indices."""
        # files are numbered on; all else is put in the order of the indices
        files = len(self._files)
        self._files += other._files
        moved = array("h", [file + files if file >= 0 else -1 for file in other._file])
        order = np.argsort(np.concatenate([np.array(self.indices, np.int64), np.array(other.indices, np.int64)]))
        poses = np.concatenate([self.poses, other.poses])[order]
        for name, theirs in (("indices", other.indices), ("_offset", other._offset), ("_length", other._length),
                             ("_file", moved)):  # fmt: skip
            mine = getattr(self, name)
            both = mine + theirs
            setattr(self, name, array(mine.typecode, [both[i] for i in order.tolist()]))
        names = [*self.names, *other.names]
        self.names = [names[i] for i in order.tolist()]
        self._poses = array("d", poses.reshape(-1).tobytes())
        self.skipped = dict(sorted((self.skipped | other.skipped).items()))
        for frame in other._held.values():
            self._hold(frame)
        self._limit_memory()

    def __getstate__(self) -> dict[str, Any]:
        """Return what is sent to another process: all that frames saw, packed."""
        return {"packed": [pack_step(_alone(frame)) for frame in self]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__()
        for packed in state["packed"]:
            self.append(unpack_step(packed).seen)

    def _hold(self, frame: FrameSeen) -> None:
        self._held[frame.index] = frame
        self._held_bytes += _bytes_of(frame)

    def _limit_memory(self) -> None:
        """Move frames to disk once they hold more than `HELD_BYTES`: those in the log already need not be written."""
        if self._held_bytes <= HELD_BYTES:
            return
        for at in range(len(self) - 1, -1, -1):
            if not self._held:
                break
            awaits_log = self._log is not None and at == len(self) - 1 and self._in_log(self.indices[at]) is None
            if self._file[at] < 0 and not awaits_log:  # the last frame is about to be logged
                self._file[at], self._offset[at], self._length[at] = self._moved_to_disk(self.indices[at])
        self._held_bytes = sum(map(_bytes_of, self._held.values()))

    def _in_log(self, index: int) -> StepRecord | None:
        """Return the record of a frame in the log; None when there is none, or it is compressed."""
        found = self._logged[index] if index < len(self._logged) else None
        return found if found is not None and found.kind == PLAIN else None

    def _moved_to_disk(self, index: int) -> tuple[int, int, int]:
        """Return (number of the file, offset, bytes) of a frame, which is no longer held."""
        frame, logged = self._held.pop(index), self._in_log(index)
        if self._log is not None and logged is not None:
            return self._opened(self._log), logged.offset, logged.length
        packed = pack_step(_alone(frame))
        try:
            if self._scratch < 0:
                self._scratch = len(self._files)
                # beside the log if there is one: the system's own folder may be in memory
                folder = None if self._log is None else self._log.absolute().parent
                self._files.append(OnDisk(unnamed_file(folder)))
            offset = self._files[self._scratch].add(packed)
        except OSError as error:
            raise InputError(f"frames: could not be put aside on disk: {error.strerror or error}") from error
        return self._scratch, offset, len(packed)

    def _opened(self, path: Path) -> int:
        """Return the number of a log's file, opened a second time: it stays readable when the log is removed."""
        for number, known in enumerate(self._files):
            if known.name == str(path):
                return number
        self._files.append(OnDisk(open(path, "rb", buffering=0)))  # noqa: SIM115 - closed by its holder
        return len(self._files) - 1


def unnamed_file(folder: Path | None = None) -> IO[bytes]:
    """Open a file that disappears with the program."""
    return tempfile.TemporaryFile(buffering=0, prefix="simaps-frames-", dir=folder)


class OnDisk:
    """An open file, closed when the last list that reads it is gone. Several threads may use it."""

    def __init__(self, file: IO[bytes]) -> None:
        self.name, self._file, self._lock = file.name, file, threading.Lock()
        weakref.finalize(self, file.close)

    def read(self, offset: int, length: int) -> bytes:
        """Return so many bytes from an offset."""
        with self._lock:
            self._file.seek(offset)
            return self._file.read(length)

    @property
    def size(self) -> int:
        """Bytes of the file."""
        with self._lock:
            return self._file.seek(0, os.SEEK_END)

    def add(self, data: bytes, offset: int | None = None) -> int:
        """Write at the end, or at an offset, and return the offset of what was written."""
        with self._lock:
            offset = self._file.seek(0, os.SEEK_END) if offset is None else self._file.seek(offset)
            view = memoryview(data)
            while view:
                view = view[self._file.write(view) :]
            return offset


def _alone(frame: FrameSeen) -> FrameStep:
    """Return a step that carries what a frame saw and nothing else."""
    nothing = np.zeros(len(frame.readings.rows), dtype=bool)
    return FrameStep(frame, nothing, np.zeros(0, np.float32))


def _bytes_of(frame: FrameSeen) -> int:
    arrays = 16 * len(frame.readings.rows) + 10 * len(frame.runs.reading)
    return arrays + _FRAME_BYTES + _SEGMENT_BYTES * len(frame.segments)
