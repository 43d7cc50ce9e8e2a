"""What a build remembers of its frames: the last ones in memory, all others on disk, so that memory stays flat.

Of every frame its index, name and pose stay in memory, as the map keeps them too: some 0.3 kB. What it saw, a hundred
times as much, is held until all together is too much, and then lies in the build's log or, without one, in a scratch
file that nobody else sees and that is gone with the program.
"""

import os
import struct
import tempfile
import threading
import weakref
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any, Protocol, overload

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.mapping.steps import FrameSeen, FrameStep, pack_step, unpack_step

HELD_BYTES = 128 << 20
"""What is held in memory before it goes to disk; ordinary sequences never need more."""
_FRAME_BYTES = 1000  # of Python objects
_SEGMENT_BYTES = 300
_ALWAYS_BYTES = 3 * 8 + 2 + 16 * 8 + 8 + 49  # index, place, pose and the name's object


class Shelf(Protocol):
    """A file in which steps of frames lie already: a build's log."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    def place_of(self, index: int) -> tuple[int, int] | None:
        """Return (offset, bytes) of a frame's plain step in it; None when it is not there."""
        ...


class FrameList(Sequence[FrameSeen]):
    """Frames, ascending by index. Those on disk are read when they are asked for."""

    def __init__(self) -> None:
        """Start empty."""
        self.indices = array("q")
        """Of each frame in the sequence."""
        self.names: list[str] = []
        self.skipped: dict[int, str] = {}
        """{index: why} of the frames that could not be read."""
        self._poses = array("d")
        self._offset, self._length, self._file = array("q"), array("q"), array("h")  # file -1 = held
        self._held: dict[int, FrameSeen] = {}
        self._held_bytes = 0
        self._files: list[_OnDisk] = []
        self._scratch = -1
        self._shelf: Shelf | None = None

    def __len__(self) -> int:
        return len(self.indices)

    @overload
    def __getitem__(self, at: int) -> FrameSeen: ...
    @overload
    def __getitem__(self, at: slice) -> list[FrameSeen]: ...
    def __getitem__(self, at: int | slice) -> FrameSeen | list[FrameSeen]:
        if isinstance(at, slice):
            return [self[i] for i in range(len(self))[at]]
        at = range(len(self))[at]
        if self._file[at] < 0:
            return self._held[self.indices[at]]
        data = self._files[self._file[at]].read(self._offset[at], self._length[at])
        try:
            seen = unpack_step(data).seen
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
        """Nothing lies on disk."""
        return len(self._held) == len(self)

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use, about, without what is held; that is what a copy costs."""
        return len(self) * _ALWAYS_BYTES + sum(map(len, self.names))

    @property
    def held_bytes(self) -> int:
        """Bytes of memory, about, of what frames saw and is not on disk; copies share it."""
        return self._held_bytes

    def lean_on(self, shelf: Shelf) -> None:
        """Read frames back from a log that has them, instead of writing them a second time."""
        self._shelf = shelf

    def append(self, frame: FrameSeen) -> None:
        """Add the next frame.

        Raises:
            InputError: there is no room on disk.
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
        self._put_away()

    def copy(self) -> "FrameList":
        """Return one that goes its own way from here."""
        twin = FrameList()
        for name in ("indices", "_poses", "_offset", "_length", "_file"):
            setattr(twin, name, getattr(self, name)[:])
        twin.names, twin.skipped, twin._held = list(self.names), dict(self.skipped), dict(self._held)
        twin._files, twin._held_bytes = list(self._files), self._held_bytes
        return twin  # writes a scratch file of its own

    def merge(self, other: "FrameList") -> None:
        """Add the frames of another list; no index is in both."""
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
        self._put_away()

    def __getstate__(self) -> dict[str, Any]:
        """Return what goes to another process: everything that was seen, packed."""
        return {"packed": [pack_step(_alone(frame)) for frame in self]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__()
        for packed in state["packed"]:
            self.append(unpack_step(packed).seen)

    def _hold(self, frame: FrameSeen) -> None:
        self._held[frame.index] = frame
        self._held_bytes += _bytes_of(frame)

    def _put_away(self) -> None:
        """Let go of what is held when it is too much: on disk it stays, or is written now."""
        if self._held_bytes <= HELD_BYTES:
            return
        for at in range(len(self) - 1, -1, -1):
            if not self._held:
                break
            if self._file[at] < 0 and not self._awaits_log(at):
                self._file[at], self._offset[at], self._length[at] = self._written(self.indices[at])
        self._held_bytes = sum(map(_bytes_of, self._held.values()))

    def _awaits_log(self, at: int) -> bool:
        """Return whether a frame is the last one, which the log is about to get."""
        return at == len(self) - 1 and self._shelf is not None and self._shelf.place_of(self.indices[at]) is None

    def _written(self, index: int) -> tuple[int, int, int]:
        frame = self._held.pop(index)
        place = None if self._shelf is None else self._shelf.place_of(index)
        if self._shelf is not None and place is not None:
            return self._opened(self._shelf.path), *place
        packed = pack_step(_alone(frame))
        try:
            if self._scratch < 0:
                self._scratch = len(self._files)
                self._files.append(_OnDisk(_scratch_file(self._shelf)))
            offset = self._files[self._scratch].add(packed)
        except OSError as error:
            raise InputError(f"frames: could not be put aside on disk: {error.strerror or error}") from error
        return self._scratch, offset, len(packed)

    def _opened(self, path: Path) -> int:
        """Return the number of a log's file, opened for itself: it stays readable when the log is closed or renamed."""
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
        """Write at the end; give where that is."""
        with self._lock:
            offset = self._file.seek(0, os.SEEK_END)
            view = memoryview(data)
            while view:
                view = view[self._file.write(view) :]
            return offset


def _scratch_file(shelf: Shelf | None) -> IO[bytes]:
    """Open a file without a name, beside the log if there is one: the system's own place may be in memory."""
    folder = None if shelf is None else shelf.path.absolute().parent
    return tempfile.TemporaryFile(buffering=0, prefix="simaps-frames-", dir=folder)


def _alone(frame: FrameSeen) -> FrameStep:
    nothing = np.zeros(len(frame.readings.rows), dtype=bool)
    return FrameStep(frame, nothing, np.zeros(0, np.float32))


def _bytes_of(frame: FrameSeen) -> int:
    return 16 * len(frame.readings.rows) + _FRAME_BYTES + _SEGMENT_BYTES * len(frame.segments)
