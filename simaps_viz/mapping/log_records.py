"""The file of a build log or history: records of frames, read back whole or one by one.

Layout: 16 bytes of magic, then records, each ``<IIB`` = bytes of content, CRC-32 of the rest, kind, then the content.
The first record is JSON that says what is being built; every other one is a frame's step (`mapping.steps`), plain while
building and squeezed when the log is kept as history. A record that is cut or changed ends the log: it and all behind
it count as not written.
"""

import json
import os
import struct
import threading
import weakref
import zlib
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import Any

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_STEP_BYTES
from simaps_viz.mapping.steps import FrameStep, unpack_step, unsqueeze

MAGIC = b"SIMAPS STEPS 1\r\n"
FACTS, PLAIN, SQUEEZED = 0, 1, 2
"""Kinds of records."""
RECORD = struct.Struct("<IIB")
_LARGEST = MAX_STEP_BYTES  # a record that claims more is damaged


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
        known, self._places, _ = scan(self._file)
        if known is None:
            raise InputError(f"{path}: expected the steps of a build, found another kind of file")
        self.known: dict[str, Any] = known
        """What is built."""

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._places)

    def read(self, number: int) -> tuple[int, bytes]:
        """Return (kind, content) of a frame for `decode_step`; raises InputError when the file was written over."""
        offset, length, kind = self._places[number]
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


def is_log(path: Path) -> bool:
    """Return whether a file is the log or history of a build."""
    try:
        with FileIO(path) as file:
            return read_bytes(file, len(MAGIC)) == MAGIC
    except OSError:
        return False


def contents(file: FileIO, places: list[tuple[int, int, int]]) -> Iterator[tuple[int, bytes]]:
    """Read (kind, content) of each frame as it is asked for: a log may be larger than memory."""
    for offset, length, kind in places:
        file.seek(offset)
        yield kind, read_bytes(file, length)


def decode_step(found: tuple[int, bytes]) -> FrameStep:
    """Read a frame's (kind, content); raises ValueError, KeyError, TypeError or struct.error for anything else."""
    kind, content = found
    return unpack_step(unsqueeze(content, most=_LARGEST) if kind == SQUEEZED else content)


def record(kind: int, content: bytes) -> bytes:
    """Return a whole record."""
    head = bytes([kind])
    return RECORD.pack(len(content), zlib.crc32(content, zlib.crc32(head)), kind) + content


def read_bytes(file: FileIO, length: int) -> bytes:
    """Read so many bytes; fewer only at the file's end."""
    parts = []
    while length > 0:
        part = file.read(length)
        if not part:
            break
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


def scan(file: FileIO) -> tuple[dict[str, Any] | None, list[tuple[int, int, int]], int]:
    """Find the whole records: what is built (None: this is no log), (offset, bytes, kind) of frames, and their end."""
    size = os.fstat(file.fileno()).st_size
    file.seek(0)
    if read_bytes(file, len(MAGIC)) != MAGIC:
        return None, [], 0
    facts: dict[str, Any] | None = None
    records: list[tuple[int, int, int]] = []
    end = len(MAGIC)
    while True:
        head = read_bytes(file, RECORD.size)
        if len(head) < RECORD.size:
            break
        length, crc, kind = RECORD.unpack(head)
        start = end + RECORD.size
        if length > _LARGEST or start + length > size or (kind == FACTS) != (facts is None) or kind > SQUEEZED:
            break
        content = read_bytes(file, length)
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
