"""Writing a file whole or not at all."""

import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO

from simaps_viz.errors import InputError


def check_ending(path: Path, suffix: str, what: str) -> None:
    """Raise InputError unless a name has that ending: whoever opens the file tells by it what it is."""
    if path.suffix.lower() != suffix:
        raise InputError(f"{path}: expected {what} that ends in {suffix}, found {path.suffix or 'no ending'}")


def check_output(path: Path, suffix: str = "") -> None:
    """Raise InputError unless a file of that ending can be written there, so that nobody waits for nothing."""
    if suffix:
        check_ending(path, suffix, "a picture name")
    if path.is_dir() or not path.absolute().parent.is_dir() or not os.access(path.absolute().parent, os.W_OK):
        raise InputError(f"{path}: expected a file in a folder that can be written, found none")


Written = bytes | memoryview | Iterable[bytes] | Callable[[IO[bytes]], None]
"""What goes into a file: all of it, or part by part, or what writes it into the open file."""


def write_whole(path: Path, data: Written, what: str) -> None:
    """Write a file, replacing an earlier one only once the new one is complete on disk.

    Args:
        path: where.
        data: what goes into it.
        what: names the contents in an error, e.g. "the map".

    Raises:
        InputError: the file cannot be written; an earlier one is left as it was.
    """
    temporary = ""
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            if callable(data):
                data(file)
            else:
                for part in (data,) if isinstance(data, bytes | memoryview) else data:
                    file.write(part)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: could not write {what}: {error.strerror or error}") from error
    finally:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
