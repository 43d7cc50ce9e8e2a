"""The frames of a build: what they saw moves from memory to disk when it becomes too much, so that memory stays flat.

The index, name and pose of every frame stay in memory, as the map needs them too: about 0.3 kB a frame. What it saw is
a hundred times as much. Once all frames together exceed `HELD_BYTES`, it is read back from the build log or, without a
log, from an unnamed scratch file that disappears with the program.
"""

import os
import struct
import tempfile
import threading
import weakref
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.mapping.steps import PLAIN, FrameSeen, FrameStep, StepRecord, pack_step, unpack_step

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
        self._files: list[_OnDisk] = []
        self._scratch = -1
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
                scratch = tempfile.TemporaryFile(buffering=0, prefix="simaps-frames-", dir=folder)  # noqa: SIM115
                self._files.append(_OnDisk(scratch))  # which closes it
            offset = self._files[self._scratch].add(packed)
        except OSError as error:
            raise InputError(f"frames: could not be put aside on disk: {error.strerror or error}") from error
        return self._scratch, offset, len(packed)

    def _opened(self, path: Path) -> int:
        """Return the number of a log's file, opened a second time: it stays readable when the log is removed."""
        for number, known in enumerate(self._files):
            if known.name == str(path):
                return number
        self._files.append(_OnDisk(open(path, "rb", buffering=0)))  # noqa: SIM115 - closed by its holder
        return len(self._files) - 1


class _OnDisk:
    """An open file, closed when the last list that reads it is gone. Several threads may use it."""

    def __init__(self, file: IO[bytes]) -> None:
        self.name, self._file, self._lock = file.name, file, threading.Lock()
        weakref.finalize(self, file.close)

    def read(self, offset: int, length: int) -> bytes:
        with self._lock:
            self._file.seek(offset)
            return self._file.read(length)

    def add(self, data: bytes) -> int:
        """Write at the end, and return the offset of what was written."""
        with self._lock:
            offset = self._file.seek(0, os.SEEK_END)
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
