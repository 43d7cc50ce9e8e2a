"""The files that an attack could reach, and whether they are as they were."""

import contextlib
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from unittest import mock

CHECKOUT = Path(__file__).parents[2]
"""Of this program; nothing that is tried may change a file in it."""

_OURS = frozenset([".git", ".venv", "__pycache__", ".pytest_cache", ".ruff_cache", ".hypothesis", "node_modules"])
"""Folders that programs of this machine write to meanwhile."""


@contextlib.contextmanager
def user_folders() -> Iterator[Path]:
    """Make the folders of a new user, and be that user; yields the folder that they are in, with "work" to work in."""
    names = ("XDG_DATA_HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "SIMAPS_CACHE", "SIMAPS_RECORDINGS")
    with tempfile.TemporaryDirectory(prefix="simaps-tried-") as name:
        places = {variable: str(Path(name, variable.lower())) for variable in names}
        for place in (*places.values(), Path(name, "work")):
            Path(place).mkdir()
        with mock.patch.dict(os.environ, places):
            yield Path(name)


class Watched:
    """Some folders with all below them.

    Args:
        folders: may lie in one another.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders = folders

    def files(self) -> dict[Path, tuple[int, int, int]]:
        """Return {file: its inode, size in bytes, time of the last change in ns}."""
        return {path: mark for folder in self._folders for path, mark in _files(folder)}

    def changes(self, before: dict[Path, tuple[int, int, int]]) -> list[str]:
        """Describe each file that is gone, changed or new since ``files`` was called."""
        after = self.files()
        gone = [f"{path} is gone" for path in before if path not in after]
        changed = [f"{path} was changed" for path, mark in after.items() if path in before and before[path] != mark]
        new = [f"{path} is new" for path in after if path not in before]
        return [*gone, *changed, *new]


def _files(folder: Path) -> Iterator[tuple[Path, tuple[int, int, int]]]:
    for root, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name not in _OURS]
        for name in names:
            path = Path(root, name)
            try:
                status = path.lstat()
            except FileNotFoundError:  # gone since it was listed
                continue
            yield path, (status.st_ino, status.st_size, status.st_mtime_ns)
