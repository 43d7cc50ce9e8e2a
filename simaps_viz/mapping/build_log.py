"""The build log: an append-only file that grows while a map is built, so that a killed build can go on.

Layout: 16 bytes of magic, then records, each ``<IIB`` = bytes of content, CRC-32 of the rest, kind, then the content.
The first record is JSON that says what is being built; every other one is a frame's step (`mapping.steps`), plain while
building and squeezed when the log is kept as history. A record that is cut or changed ends the log: it and all behind
it count as not written.
"""

import json
import os
import struct
import sys
import threading
import time
import weakref
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import FileIO
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any

from simaps_viz.errors import InputError
from simaps_viz.files import write_whole
from simaps_viz.limits import MAX_STEP_BYTES
from simaps_viz.mapping.steps import FrameStep, pack_step, squeeze, unpack_step, unsqueeze

MAGIC = b"SIMAPS STEPS 1\r\n"
_RECORD = struct.Struct("<IIB")
_FACTS, _PLAIN, _SQUEEZED = 0, 1, 2
_LARGEST = MAX_STEP_BYTES  # a record that claims more is damaged
_SYNC_S = 5.0  # a power cut loses at most the frames of so many seconds; killing the program loses none


class LogBusyError(InputError):
    """Another program, or another thread, is building the same map."""


class BuildLog:
    """The log of a build that is under way; one program at a time may write it."""

    def __init__(self, path: Path, facts: Mapping[str, Any], *, resume: bool = False) -> None:
        """Open the log; without ``resume`` an earlier one at the path is set aside (see `set_aside_name`).

        Args:
            path: the file.
            facts: what is being built, JSON-able: all that the map depends on.
            resume: go on with the log that is there, if there is one.

        Raises:
            InputError: the log there is of another build, another program writes it, or the file cannot be written.
        """
        self.path = Path(path)
        self.steps: list[tuple[int, int, int]] = []
        """(offset, bytes, kind) of the whole records of frames."""
        self._synced = time.monotonic()
        wanted: dict[str, Any] = json.loads(json.dumps(facts))  # as it comes back from the file
        try:
            self._file = FileIO(os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644), "r+")
        except OSError as error:
            raise InputError(f"{self.path}: could not write the build log: {error.strerror or error}") from error
        try:
            self._lock()
            self._begin(wanted, resume=resume)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> "BuildLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def __len__(self) -> int:
        """Number of frames in the log."""
        return len(self.steps)

    def place_of(self, index: int) -> tuple[int, int] | None:
        """Give (offset, bytes) of a frame's step in the file, as `pack_step` wrote it; None when it is not there."""
        if not 0 <= index < len(self.steps) or self.steps[index][2] != _PLAIN:
            return None
        return self.steps[index][:2]

    def append(self, step: FrameStep) -> None:
        """Add the step of the next frame; it is out of this program's hands when this returns.

        Raises:
            InputError: the file cannot be written, e.g. the disk is full; what is whole in it stays.
        """
        self.steps.append(self._write(_PLAIN, pack_step(step)))

    def replay(self) -> Iterator[FrameStep]:
        """Give the steps in the log, in order; ends before the first that makes no sense, which is cut off."""
        for number, (offset, length, kind) in enumerate(self.steps):
            self._file.seek(offset)
            try:
                step = _step(kind, _read(self._file, length))
                if step.seen.index != number:
                    raise ValueError("a frame out of order")
            except (ValueError, KeyError, TypeError, struct.error):
                self.cut(number)
                return
            yield step
        self._file.seek(0, os.SEEK_END)

    def cut(self, frames: int) -> None:
        """Keep only the first frames of the log."""
        if frames < len(self.steps):
            self._file.truncate(self.steps[frames][0] - _RECORD.size)
            del self.steps[frames:]
        self._file.seek(0, os.SEEK_END)

    def close(self) -> None:
        """Let go of the file, which stays."""
        self._file.close()

    def _lock(self) -> None:
        if sys.platform == "win32":
            return
        import fcntl  # noqa: PLC0415 - not on Windows

        try:
            fcntl.flock(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise LogBusyError(f"{self.path}: expected one build at a time, found another one writing it") from None

    def _begin(self, facts: dict[str, Any], *, resume: bool) -> None:
        if resume:
            self._take_set_aside(facts)
        known, records, end = _scan(self._file)
        if resume and known is not None:
            _check_same(self.path, known, facts)
            self.steps = records
            self._file.truncate(end)
            self._file.seek(end)
            return
        if records:
            self._set_aside()
        self._file.truncate(0)
        self._file.seek(0)
        self._put(MAGIC)
        self._write(_FACTS, json.dumps(facts).encode())

    def _set_aside(self) -> None:
        os.replace(self.path, set_aside_name(self.path))
        self._reopen()

    def _take_set_aside(self, facts: dict[str, Any]) -> None:
        """Go on with the log that was set aside when it is of the same build and farther than the one in place."""
        aside = set_aside_name(self.path)
        if not aside.is_file():
            return
        with FileIO(aside) as file:
            known, records, _ = _scan(file)
        if known == facts and len(records) > len(_scan(self._file)[1]):
            os.replace(aside, self.path)
            self._reopen()

    def _reopen(self) -> None:
        self._file.close()
        self._file = FileIO(os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644), "r+")
        self._lock()

    def _write(self, kind: int, content: bytes) -> tuple[int, int, int]:
        offset = self._file.tell() + _RECORD.size
        self._put(_record(kind, content))
        if time.monotonic() - self._synced > _SYNC_S:
            os.fsync(self._file.fileno())
            self._synced = time.monotonic()
        return offset, len(content), kind

    def _put(self, data: bytes) -> None:
        try:
            view = memoryview(data)
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            raise InputError(
                f"{self.path}: could not write the build log: {error.strerror or error}; --resume goes on from here"
            ) from error


def log_beside(output: Path) -> Path:
    """Give where the log of a map that is being built lies: hidden, beside the map."""
    return output.with_name(f".{output.name}.building")


def set_aside_name(log: Path) -> Path:
    """Give the name an unfinished log gets when a build starts anew; it is kept until that build is done."""
    return log.with_name(f"{log.name}.old")


def steps_beside(output: Path) -> Path:
    """Give where the history of a map lies: the map's name with the ending ``.steps``."""
    return output.with_suffix(".steps")


def frames_logged(log: Path) -> int:
    """Count the frames in an unfinished log, 0 when there is none."""
    try:
        with FileIO(log) as file:
            return len(_scan(file)[1])
    except OSError:
        return 0


def keep_log(log: Path, steps: Path) -> None:
    """Make the log of a finished build its history: squeezed, whole or not at all; the log is removed.

    Raises:
        InputError: it cannot be written; the log is left as it was.
    """
    with _opened(log) as file:
        known, places = _whole_records(log, file)
        contents = (content if kind == _SQUEEZED else squeeze(content) for kind, content in _contents(file, places))
        records = (_record(_SQUEEZED, content) for content in contents)
        write_whole(steps, chain([MAGIC, _record(_FACTS, json.dumps(known).encode())], records), "the history")
    log.unlink(missing_ok=True)


def read_log(path: Path) -> tuple[dict[str, Any], list[tuple[int, bytes]]]:
    """Read all whole records: what is built, and (kind, content) of every frame; `decode_step` reads one.

    Raises:
        InputError: the file is missing or is something else.
    """
    with _opened(path) as file:
        known, places = _whole_records(path, file)
        return known, list(_contents(file, places))


class LogReader:
    """The frames of a log or history, read one by one when asked for. Several threads may ask.

    The file stays open: another one in its place, or none, changes nothing.
    """

    def __init__(self, path: Path) -> None:
        """Find all whole records; raises InputError when the file is missing or is something else."""
        self._path, self._lock = path, threading.Lock()
        try:
            self._file = FileIO(path)
        except OSError as error:
            raise InputError(f"{path}: expected the steps of a build, found {error.strerror or error}") from error
        weakref.finalize(self, self._file.close)
        self.known, self._places = _whole_records(path, self._file)

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._places)

    def read(self, number: int) -> tuple[int, bytes]:
        """Give (kind, content) of a frame for `decode_step`; raises InputError when the file was written over."""
        offset, length, kind = self._places[number]
        try:
            with self._lock:
                self._file.seek(offset - _RECORD.size)
                data = _read(self._file, _RECORD.size + length)
        except OSError as error:
            raise InputError(f"{self._path}: could not be read: {error.strerror or error}") from error
        content = data[_RECORD.size :]
        if data != _record(kind, content) or len(content) != length:
            raise InputError(f"{self._path}: frame {number} could not be read back, the file was changed")
        return kind, content


@contextmanager
def _opened(path: Path) -> Iterator[FileIO]:
    try:
        with FileIO(path) as file:
            yield file
    except OSError as error:
        raise InputError(f"{path}: expected the steps of a build, found {error.strerror or error}") from error


def _whole_records(path: Path, file: FileIO) -> tuple[dict[str, Any], list[tuple[int, int, int]]]:
    known, places, _ = _scan(file)
    if known is None:
        raise InputError(f"{path}: expected the steps of a build, found another kind of file")
    return known, places


def _contents(file: FileIO, places: list[tuple[int, int, int]]) -> Iterator[tuple[int, bytes]]:
    """Read (kind, content) of each frame as it is asked for: a log may be larger than memory."""
    for offset, length, kind in places:
        file.seek(offset)
        yield kind, _read(file, length)


def decode_step(record: tuple[int, bytes]) -> FrameStep:
    """Read a frame's record; raises ValueError, KeyError, TypeError or struct.error when it is something else."""
    return _step(*record)


def _record(kind: int, content: bytes) -> bytes:
    head = bytes([kind])
    return _RECORD.pack(len(content), zlib.crc32(content, zlib.crc32(head)), kind) + content


def _step(kind: int, content: bytes) -> FrameStep:
    return unpack_step(unsqueeze(content, most=_LARGEST) if kind == _SQUEEZED else content)


def _read(file: FileIO, length: int) -> bytes:
    parts = []
    while length > 0:
        part = file.read(length)
        if not part:
            break
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


def _scan(file: FileIO) -> tuple[dict[str, Any] | None, list[tuple[int, int, int]], int]:
    """Find the whole records: what is built (None: this is no log), where the frames are, and where they end."""
    size = os.fstat(file.fileno()).st_size
    file.seek(0)
    if _read(file, len(MAGIC)) != MAGIC:
        return None, [], 0
    facts: dict[str, Any] | None = None
    records: list[tuple[int, int, int]] = []
    end = len(MAGIC)
    while True:
        head = _read(file, _RECORD.size)
        if len(head) < _RECORD.size:
            break
        length, crc, kind = _RECORD.unpack(head)
        start = end + _RECORD.size
        if length > _LARGEST or start + length > size or (kind == _FACTS) != (facts is None) or kind > _SQUEEZED:
            break
        content = _read(file, length)
        if zlib.crc32(content, zlib.crc32(head[-1:])) != crc:
            break
        if facts is None:
            facts = _read_facts(content)
            if facts is None:
                break
        else:
            records.append((start, length, kind))
        end = start + length
    return facts, records, end


def _read_facts(content: bytes) -> dict[str, Any] | None:
    try:
        facts = json.loads(content)
    except (ValueError, RecursionError):
        return None
    return facts if isinstance(facts, dict) else None


def _check_same(path: Path, known: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for key in wanted:
        if known.get(key) != wanted[key]:
            raise InputError(
                f"{path}: expected the unfinished build of the same sequence with the same settings, found another "
                f"{_difference(key, known.get(key), wanted[key])}; without --resume a new build starts"
            )


def _difference(key: str, known: Any, wanted: Any) -> str:
    """Name the first thing that differs."""
    while isinstance(known, dict) and isinstance(wanted, dict):
        inner = next((k for k in wanted if known.get(k) != wanted[k]), None)
        if inner is None:
            break
        key, known, wanted = inner, known.get(inner), wanted[inner]
    if isinstance(known, str | int | float) and isinstance(wanted, str | int | float):
        return f"{key} ({str(known)[:80]}, now {str(wanted)[:80]})"
    return key
