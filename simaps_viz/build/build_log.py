"""The build log: an append-only file in the folder of the map being built, from which a killed build resumes.

It holds what is being built (the facts) and the step of every frame so far; `mapping.steps` describes the file and why
it is not an SQLite database. One build at a time writes it, which a lock of the operating system ensures.
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
from simaps_viz.mapping.steps import (
    COMPRESSED,
    FACTS,
    MAGIC,
    PLAIN,
    RECORD,
    FrameStep,
    StepRecord,
    compress,
    contents,
    decode_step,
    pack_step,
    read_bytes,
    record,
    scan,
)

_SYNC_S = 5.0  # a power cut loses at most the frames of so many seconds; killing the program loses none
NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
"""Errors of network folders that have no locks; there nothing stops two builds from writing one log."""


class LogBusyError(InputError):
    """Another program, or another thread, is building the same map."""


class BuildLog:
    """The log of a build that is under way; one program at a time may write it."""

    def __init__(self, path: Path, facts: Mapping[str, Any], *, resume: bool = False) -> None:
        """Open the log; without ``resume`` an earlier one at the path is set aside (see `set_aside_name`).

        Args:
            path: the file.
            facts: what is being built, JSON-able: all that the map depends on, and the path of the sequence
                (["sequence"]["path"]), which may differ when a build resumes.
            resume: continue the log at the path, if there is one.

        Raises:
            InputError: the log at the path is of another build, another program writes it, or it cannot be written.
        """
        self.path = Path(path)
        self.records: list[StepRecord] = []
        """The complete records of frames, in order."""
        self._synced = time.monotonic()
        wanted: dict[str, Any] = json.loads(json.dumps(facts))  # as it comes back from the file
        try:
            self._file = self._open()
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
        """Return the number of frames in the log."""
        return len(self.records)

    def append(self, step: FrameStep) -> None:
        """Add the step of the next frame; killing the program after this returns does not lose it.

        Raises:
            InputError: the file cannot be written, e.g. the disk is full; the complete records in it stay.
        """
        self.records.append(self._write(PLAIN, pack_step(step)))

    def replay(self) -> Iterator[FrameStep]:
        """Yield the steps in the log, in order; the log is cut before the first that is damaged or out of order."""
        for number, (offset, length, kind) in enumerate(self.records):
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
        if frames < len(self.records):
            self._file.truncate(self.records[frames].offset - RECORD.size)
            del self.records[frames:]
        self._file.seek(0, os.SEEK_END)

    def keep(self, steps: Path) -> None:
        """Write the log, compressed, as the history of the finished map, and remove it.

        Raises:
            InputError: the history cannot be written; the log and an earlier history are left as they were.
        """
        facts, records, _ = scan(self._file)
        compressed = (
            record(COMPRESSED, content if kind == COMPRESSED else compress(content))
            for kind, content in contents(self._file, records)
        )
        write_whole(steps, chain([MAGIC, record(FACTS, json.dumps(facts).encode())], compressed), "the history")
        self.remove()

    def remove(self) -> None:
        """Remove the log, and the one set aside, of a map that is finished. The lock is held until `close`."""
        if sys.platform == "win32":  # where no open file can be removed, and there is no lock
            self.close()
        self.path.unlink(missing_ok=True)
        set_aside_name(self.path).unlink(missing_ok=True)

    def close(self) -> None:
        """Close the file and release its lock."""
        self._file.close()

    def _open(self) -> FileIO:
        return FileIO(os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644), "r+")

    def _lock(self) -> None:
        if sys.platform == "win32":
            return
        import fcntl  # noqa: PLC0415 - not on Windows

        try:
            while True:
                fcntl.flock(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
                if self._is_at_path():
                    return
                # Between opening and locking, the build that held the lock has ended and removed its log.
                self._file.close()
                self._file = self._open()
        except BlockingIOError:
            raise LogBusyError(f"{self.path}: expected one build at a time, found another one writing it") from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise InputError(f"{self.path}: could not write the build log: {error.strerror or error}") from error

    def _is_at_path(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._file.fileno()), os.stat(self.path))
        except FileNotFoundError:
            return False

    def _begin(self, facts: dict[str, Any], *, resume: bool) -> None:
        # Resume from the log with more frames, without an incomplete record at its end.
        if resume:
            self._restore_set_aside(facts)
        found, records, end = scan(self._file)
        if resume and found is not None:
            _check_same(self.path, found, facts)
            self.records = records
            self._file.truncate(end)
            self._file.seek(end)
            return
        # Start anew. One unfinished log is kept aside: this one, or the one set aside before if that has more frames.
        if len(records) > frames_logged(set_aside_name(self.path)):
            os.replace(self.path, set_aside_name(self.path))
            self._reopen()
        self._file.truncate(0)
        self._file.seek(0)
        self._put(MAGIC)
        self._write(FACTS, json.dumps(facts).encode())

    def _restore_set_aside(self, facts: dict[str, Any]) -> None:
        """Resume from the log that was set aside when it is of the same build and has more frames."""
        aside = set_aside_name(self.path)
        if not aside.is_file():
            return
        with FileIO(aside) as file:
            found, records, _ = scan(file)
        if _without_path(found) == _without_path(facts) and len(records) > len(scan(self._file).records):
            os.replace(aside, self.path)
            self._reopen()

    def _reopen(self) -> None:
        self._file.close()
        self._file = self._open()
        self._lock()

    def _write(self, kind: int, content: bytes) -> StepRecord:
        offset = self._file.tell() + RECORD.size
        self._put(record(kind, content))
        if time.monotonic() - self._synced > _SYNC_S:
            os.fsync(self._file.fileno())
            self._synced = time.monotonic()
        return StepRecord(offset, len(content), kind)

    def _put(self, data: bytes) -> None:
        try:
            view = memoryview(data)
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            raise InputError(
                f"{self.path}: could not write the build log: {error.strerror or error}; --resume continues from here"
            ) from error


def log_path(output: Path) -> Path:
    """Return the path of the log while a map is built: a hidden file in the map's folder."""
    return output.with_name(f".{output.name}.building")


def set_aside_name(log: Path) -> Path:
    """Return the path that an unfinished log gets when a build starts anew; it is kept until that build is done."""
    return log.with_name(f"{log.name}.old")


def history_path(output: Path) -> Path:
    """Return the path of a map's history: the map's name with the ending ``.steps``."""
    return output.with_suffix(".steps")


def frames_logged(log: Path) -> int:
    """Return the number of frames in an unfinished log, 0 when there is none."""
    try:
        with FileIO(log) as file:
            return len(scan(file).records)
    except OSError:
        return 0


def _check_same(path: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Raise InputError, naming the first difference, unless a log is of the build that is wanted."""
    found, wanted = _without_path(found), _without_path(wanted)
    key = next((key for key in wanted if found.get(key) != wanted[key]), None)
    if key is not None:
        raise InputError(
            f"{path}: expected the unfinished build of the same sequence with the same settings, found another "
            f"{_difference(key, found.get(key), wanted[key])}; without --resume a new build starts"
        )


def _without_path(facts: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return facts without the path of the sequence: the same files may be found elsewhere today."""
    facts = facts or {}
    sequence = facts.get("sequence")
    return {**facts, "sequence": {**sequence, "path": None}} if isinstance(sequence, dict) else dict(facts)


def _difference(key: str, found: Any, wanted: Any) -> str:
    """Return the name of the innermost entry that differs, with both values where they are short."""
    while isinstance(found, dict) and isinstance(wanted, dict):
        inner = next((k for k in wanted if found.get(k) != wanted[k]), None)
        if inner is None:
            break
        key, found, wanted = inner, found.get(inner), wanted[inner]
    if isinstance(found, str | int | float) and isinstance(wanted, str | int | float):
        return f"{key} ({str(found)[:80]}, now {str(wanted)[:80]})"
    return key
