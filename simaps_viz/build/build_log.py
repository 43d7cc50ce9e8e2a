"""The build log: an append-only file that grows while a map is built, so that a killed build can go on.

What a record looks like says `mapping.log_records`.
"""

import errno
import json
import os
import struct
import sys
import time
from collections.abc import Iterator, Mapping
from io import FileIO
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any

from simaps_viz.errors import InputError
from simaps_viz.io.files import write_whole
from simaps_viz.mapping.log_records import (
    FACTS,
    MAGIC,
    PLAIN,
    RECORD,
    SQUEEZED,
    contents,
    decode_step,
    read_bytes,
    record,
    scan,
)  # fmt: skip
from simaps_viz.mapping.steps import FrameStep, pack_step, squeeze

_SYNC_S = 5.0  # a power cut loses at most the frames of so many seconds; killing the program loses none


NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
"""What some network folders answer who asks for a lock; there nobody watches that one build writes at a time."""


class LogBusyError(InputError):
    """Another program, or another thread, is building the same map."""


class BuildLog:
    """The log of a build that is under way; one program at a time may write it."""

    def __init__(self, path: Path, facts: Mapping[str, Any], *, resume: bool = False) -> None:
        """Open the log; without ``resume`` an earlier one at the path is set aside (see `set_aside_name`).

        Args:
            path: the file.
            facts: what is being built, JSON-able: all that the map depends on, and where from (["sequence"]["path"]),
                which may be another way to the same files when a build goes on.
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
        """Return (offset, bytes) of a frame's step in the file, as `pack_step` wrote it; None when it is not there."""
        if not 0 <= index < len(self.steps) or self.steps[index][2] != PLAIN:
            return None
        return self.steps[index][:2]

    def append(self, step: FrameStep) -> None:
        """Add the step of the next frame; it is out of this program's hands when this returns.

        Raises:
            InputError: the file cannot be written, e.g. the disk is full; what is whole in it stays.
        """
        self.steps.append(self._write(PLAIN, pack_step(step)))

    def replay(self) -> Iterator[FrameStep]:
        """Return the steps in the log, in order; ends before the first that makes no sense, which is cut off."""
        for number, (offset, length, kind) in enumerate(self.steps):
            self._file.seek(offset)
            try:
                step = decode_step((kind, read_bytes(self._file, length)))
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
            self._file.truncate(self.steps[frames][0] - RECORD.size)
            del self.steps[frames:]
        self._file.seek(0, os.SEEK_END)

    def keep(self, steps: Path) -> None:
        """Make the log the history of the map that is there now: squeezed, whole or not at all; then remove it.

        Raises:
            InputError: the history cannot be written; the log is left as it was.
        """
        known, places, _ = scan(self._file)
        found = contents(self._file, places)
        records = (record(SQUEEZED, content if kind == SQUEEZED else squeeze(content)) for kind, content in found)
        write_whole(steps, chain([MAGIC, record(FACTS, json.dumps(known).encode())], records), "the history")
        self.remove()

    def remove(self) -> None:
        """Remove the log and what was set aside for it: the map is there. Nobody else writes it until `close`."""
        if sys.platform == "win32":  # where no open file can be removed, and there is no lock
            self.close()
        self.path.unlink(missing_ok=True)
        set_aside_name(self.path).unlink(missing_ok=True)

    def close(self) -> None:
        """Let go of the file, which stays unless it was removed."""
        self._file.close()

    def _lock(self) -> None:
        if sys.platform == "win32":
            return
        import fcntl  # noqa: PLC0415 - not on Windows

        try:
            while True:
                fcntl.flock(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
                if self._in_place():
                    return
                self._file.close()  # whose build was just done, and has removed it
                self._file = FileIO(os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644), "r+")
        except BlockingIOError:
            raise LogBusyError(f"{self.path}: expected one build at a time, found another one writing it") from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise InputError(f"{self.path}: could not write the build log: {error.strerror or error}") from error

    def _in_place(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._file.fileno()), os.stat(self.path))
        except FileNotFoundError:
            return False

    def _begin(self, facts: dict[str, Any], *, resume: bool) -> None:
        if resume:
            self._take_set_aside(facts)
        known, records, end = scan(self._file)
        if resume and known is not None:
            _check_same(self.path, known, facts)
            self.steps = records
            self._file.truncate(end)
            self._file.seek(end)
            return
        if len(records) > frames_logged(set_aside_name(self.path)):  # what is farther is kept
            self._set_aside()
        self._file.truncate(0)
        self._file.seek(0)
        self._put(MAGIC)
        self._write(FACTS, json.dumps(facts).encode())

    def _set_aside(self) -> None:
        os.replace(self.path, set_aside_name(self.path))
        self._reopen()

    def _take_set_aside(self, facts: dict[str, Any]) -> None:
        """Go on with the log that was set aside when it is of the same build and farther than the one in place."""
        aside = set_aside_name(self.path)
        if not aside.is_file():
            return
        with FileIO(aside) as file:
            known, records, _ = scan(file)
        if _wherever(known) == _wherever(facts) and len(records) > len(scan(self._file)[1]):
            os.replace(aside, self.path)
            self._reopen()

    def _reopen(self) -> None:
        self._file.close()
        self._file = FileIO(os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644), "r+")
        self._lock()

    def _write(self, kind: int, content: bytes) -> tuple[int, int, int]:
        offset = self._file.tell() + RECORD.size
        self._put(record(kind, content))
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
    """Return where the log of a map that is being built lies: hidden, beside the map."""
    return output.with_name(f".{output.name}.building")


def set_aside_name(log: Path) -> Path:
    """Return the name an unfinished log gets when a build starts anew; it is kept until that build is done."""
    return log.with_name(f"{log.name}.old")


def steps_beside(output: Path) -> Path:
    """Return where the history of a map lies: the map's name with the ending ``.steps``."""
    return output.with_suffix(".steps")


def frames_logged(log: Path) -> int:
    """Count the frames in an unfinished log, 0 when there is none."""
    try:
        with FileIO(log) as file:
            return len(scan(file)[1])
    except OSError:
        return 0


def _check_same(path: Path, known: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    known, wanted = _wherever(known), _wherever(wanted)
    key = next((key for key in wanted if known.get(key) != wanted[key]), None)
    if key is not None:
        raise InputError(
            f"{path}: expected the unfinished build of the same sequence with the same settings, found another "
            f"{_difference(key, known.get(key), wanted[key])}; without --resume a new build starts"
        )


def _wherever(facts: Mapping[str, Any] | None) -> dict[str, Any]:
    """Leave out the way to the sequence's files, which may be another one today."""
    facts = facts or {}
    sequence = facts.get("sequence")
    return {**facts, "sequence": {**sequence, "path": None}} if isinstance(sequence, dict) else dict(facts)


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
