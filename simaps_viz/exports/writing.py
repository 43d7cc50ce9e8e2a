"""Writing several files that belong together: all of them or none."""

import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from simaps_viz.errors import InputError


def write_all(files: Mapping[Path, bytes]) -> None:
    """Write files; earlier ones of these names are replaced only once every new one is complete on disk.

    Raises:
        InputError: one cannot be written; then none is, and earlier ones are as they were.
    """
    for path in files:
        if path.is_dir():
            raise InputError(f"{path}: expected a file name to write, found a folder")
    staged: dict[Path, Path] = {}
    kept: dict[Path, Path | None] = {}
    try:
        for path, content in files.items():
            staged[path] = _stage(path, content)
        for path in files:
            kept[path] = _keep(path)
        for path, temporary in staged.items():
            os.replace(temporary, path)
    except BaseException as error:
        _put_back(staged, kept)
        if isinstance(error, OSError):
            raise InputError(f"{path}: expected to write it, found: {error.strerror or error}") from error
        raise
    finally:
        for leftover in (*staged.values(), *kept.values()):
            if leftover is not None:
                leftover.unlink(missing_ok=True)


def _stage(path: Path, content: bytes) -> Path:
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o644)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return Path(name)


def _keep(path: Path) -> Path | None:
    """Copy what stands at a path, to put it back should a later file fail; None when nothing does."""
    if not path.exists():
        return None
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    try:
        shutil.copy2(path, name)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return Path(name)


def _put_back(staged: Mapping[Path, Path], kept: Mapping[Path, Path | None]) -> None:
    """Undo the replacements done so far: those whose temporary file is gone."""
    for path, temporary in staged.items():
        if temporary.exists() or path not in kept:
            continue
        earlier = kept[path]
        if earlier is None:
            path.unlink(missing_ok=True)
        else:
            os.replace(earlier, path)
