"""Write files completely or not at all: each grows under a temporary name beside the path it will take."""

import glob
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

from simaps_viz.errors import InputError


def check_ending(path: Path, suffix: str, what: str, other: str = "") -> None:
    """Raise InputError unless a path has an ending, by which programs that open the file recognise it."""
    if path.suffix.lower() != suffix:
        ends = f"{suffix} ({other})" if other else suffix
        raise InputError(f"{path}: expected {what} that ends in {ends}, found {path.suffix or 'no ending'}")


def check_output(path: Path, suffix: str = "") -> None:
    """Raise InputError unless a file with an ending can be written at a path: better now than after a long build."""
    if suffix:
        check_ending(path, suffix, "a picture name")
    if path.is_dir() or not path.absolute().parent.is_dir() or not os.access(path.absolute().parent, os.W_OK):
        raise InputError(f"{path}: expected a file in a folder that can be written, found none")


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Yield a new, empty, hidden file in the folder of a path, to be renamed to it; otherwise it is removed at the end.

    It has the permissions of any new file (those that the umask leaves), and a name of its own.

    Raises:
        OSError: it cannot be created.
    """
    temporary = path.parent / f".{path.name}.{secrets.token_urlsafe(6)}"  # `left_beside` finds such a name
    os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


def left_beside(path: Path) -> list[Path]:
    """Return the files of `beside` that programs left behind which were killed while they wrote to a path."""
    near = path.parent.glob(f".{glob.escape(path.name)}.????????")
    return sorted(p for p in near if re.fullmatch(r"[A-Za-z0-9_-]{8}", p.name[-8:]))


@contextmanager
def replacing(path: Path, what: str, *, durable: bool = True) -> Iterator[Path]:
    """Yield a temporary file to write; at the end it replaces ``path``, after an error it is removed.

    Args:
        path: the file; an earlier one stays as it is until the new one is complete.
        what: names the contents in an error, e.g. "the map".
        durable: wait until the new file is on the disk, so that a power cut leaves either the earlier file or the new
            one. Not needed for a file that can be made again as fast as it is written.

    Raises:
        InputError: the file cannot be written, e.g. the disk is full.
    """
    try:
        with beside(path) as temporary:
            yield temporary
            if durable:
                _sync(temporary)
            os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: could not write {what}: {error.strerror or error}") from error


Written = bytes | memoryview | Iterable[bytes] | Callable[[IO[bytes]], None]
"""The contents of a file: at once, part by part, or as a function that writes them into the open file."""


def write_whole(path: Path, data: Written, what: str, *, durable: bool = True) -> None:
    """Write a file, replacing an earlier one only once the new one is complete.

    Args:
        path: the file.
        data: its contents.
        what: names the contents in an error, e.g. "the map".
        durable: as for `replacing`.

    Raises:
        InputError: the file cannot be written; an earlier one is left as it was.
    """
    with replacing(path, what, durable=durable) as temporary, temporary.open("wb") as file:
        if callable(data):
            data(file)
        else:
            for part in (data,) if isinstance(data, bytes | memoryview) else data:
                file.write(part)


def write_all(files: Mapping[Path, bytes], what: str) -> None:
    """Write files that belong together, in order; none takes its name before all are complete on disk.

    Args:
        files: {path: contents}.
        what: names the contents in an error, e.g. "the correction".

    Raises:
        InputError: one cannot be written; then none is, and earlier files are as they were.
    """
    for path in files:
        if path.is_dir():
            raise InputError(f"{path}: expected a file name to write, found a folder")
    # write all under temporary names, copy the earlier files, then rename; an error undoes the renames so far
    staged: dict[Path, Path] = {}
    kept: dict[Path, Path | None] = {}
    with ExitStack() as stack:
        try:
            for path, content in files.items():
                staged[path] = stack.enter_context(beside(path))
                staged[path].write_bytes(content)
                _sync(staged[path])
            for path in files:
                kept[path] = stack.enter_context(_copied(path)) if path.exists() else None
            for path, temporary in staged.items():
                os.replace(temporary, path)
        except BaseException as error:
            _put_back(staged, kept)
            if isinstance(error, OSError):
                raise InputError(f"{path}: could not write {what}: {error.strerror or error}") from error
            raise


@contextmanager
def _copied(path: Path) -> Iterator[Path]:
    """Yield a copy of a file, to restore it should a later file fail."""
    with beside(path) as copy:
        shutil.copy2(path, copy)
        yield copy


def _put_back(staged: Mapping[Path, Path], kept: Mapping[Path, Path | None]) -> None:
    """Undo the replacements made so far: those whose temporary file is gone."""
    for path, temporary in staged.items():
        if temporary.exists() or path not in kept:
            continue
        earlier = kept[path]
        if earlier is None:
            path.unlink(missing_ok=True)
        else:
            os.replace(earlier, path)


def _sync(path: Path) -> None:
    """Wait until a file is on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())
