"""The recorded builds at hand: those shipped with the program and the user's own, and repairing broken ones.

Renaming and deleting touch nothing outside the folders of the library. Deleting moves a file to the trash, a hidden
folder inside the user's; what ships with the program or lies under version control is neither renamed nor deleted.
"""

import difflib
import itertools
import os
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from platformdirs import user_data_path

from simaps_viz.errors import InputError
from simaps_viz.io.files import beside, replacing
from simaps_viz.recorder.facts import RecordingFacts, read_facts

SUFFIX = ".rrd"
TRASH = ".trash"
"""Name of the folder of deleted recordings."""
_SHIPPED = Path(__file__).parents[2] / "recordings"
_MAX_NAME = 120


def recording_folders() -> list[Path]:
    """Return the folders of the library, the user's first: ``SIMAPS_RECORDINGS``, or the user's data directory.

    A checkout of the program has a second one, ``recordings/``.
    """
    chosen = os.environ.get("SIMAPS_RECORDINGS")
    own = Path(chosen) if chosen else user_data_path("simaps") / "recordings"
    checkout = (_SHIPPED.parent / "pyproject.toml").is_file() and _SHIPPED.is_dir()
    return [own, _SHIPPED] if checkout else [own]


@dataclass(frozen=True)
class LibraryEntry:
    """One recorded build."""

    path: Path
    size_bytes: int
    modified: datetime
    facts: RecordingFacts = field(default_factory=RecordingFacts)
    fault: str | None = None
    """Why it cannot be opened, in words."""
    read_only: str | None = None
    """Why it can be neither renamed nor deleted here, in words; None when it can."""

    @property
    def name(self) -> str:
        """Name of the recording: that of the file without its ending."""
        return self.path.stem

    def to_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {
            "name": self.name,
            "path": str(self.path),
            "size_bytes": self.size_bytes,
            "modified": self.modified.isoformat(timespec="seconds"),
            **asdict(self.facts),
            "fault": self.fault,
            "read_only": self.read_only,
        }


class RecordingLibrary:
    """The recordings in some folders. Names are file names without ``.rrd``; the first folder gets what is added."""

    def __init__(self, folders: Sequence[Path] | None = None) -> None:
        """Take the given folders, or those of `recording_folders`."""
        self.folders = list(folders) if folders is not None else recording_folders()

    def entries(self) -> list[LibraryEntry]:
        """List the recordings, the newest first; links are left out, as they lead outside."""
        return self._listed(self.folders)

    @staticmethod
    def _listed(folders: Sequence[Path]) -> list[LibraryEntry]:
        found = [entry for folder in folders for path in _files(folder) if (entry := _entry(path)) is not None]
        return sorted(found, key=lambda entry: (-entry.modified.timestamp(), entry.name))

    @property
    def trash(self) -> Path:
        """The folder of deleted recordings."""
        return self.folders[0] / TRASH

    def _movable(self, name: str) -> LibraryEntry:
        entry = self.find(name)
        if entry.read_only:
            raise InputError(f"{entry.path}: expected a recording of your own, found one that {entry.read_only}")
        return entry

    def find(self, name: str) -> LibraryEntry:
        """Return the recording of that name; of the same name in two folders, the user's.

        Raises:
            InputError: there is none; the message says what is near.
        """
        wanted = name.removesuffix(SUFFIX)
        for folder in self.folders:
            for path in _files(folder):
                if path.stem == wanted and (entry := _entry(path)) is not None:
                    return entry
        names = sorted({path.stem for folder in self.folders for path in _files(folder)})
        near = difflib.get_close_matches(wanted, names, n=1, cutoff=0.4)
        hint = f"; did you mean {near[0]!r}?" if near else f" among {len(names)} in {self.folders[0]}"
        raise InputError(f"recording {name!r}: expected one of the library, found none{hint}")

    def rename(self, name: str, new_name: str) -> LibraryEntry:
        """Rename a recording within its folder.

        Raises:
            InputError: there is no such recording, the new name is none for a file, or it is taken.
        """
        entry = self._movable(name)
        target = entry.path.with_name(_checked(new_name) + SUFFIX)
        _move_to_free(entry.path, target, "rename")
        return self.find(target.stem)

    def delete(self, name: str) -> Path:
        """Move a recording to the trash; returns where it lies there.

        Raises:
            InputError: there is no such recording, it ships with the program, or it cannot be moved.
        """
        path = self._movable(name).path
        try:
            self.trash.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{path}: could not delete the recording: {error.strerror or error}") from error
        # Another one of that name may lie in the trash: this one gets a number then.
        names = itertools.chain([path.stem], (f"{path.stem} ({number})" for number in itertools.count(2)))
        target = next(file for name in names if not (file := self.trash / (name + SUFFIX)).exists())
        _move_to_free(path, target, "delete")
        return target

    def deleted(self) -> list[LibraryEntry]:
        """List the recordings in the trash, the newest first."""
        return self._listed([self.trash])

    def restore(self, name: str) -> LibraryEntry:
        """Move a recording from the trash back to the user's folder.

        Raises:
            InputError: there is none of that name in the trash, its name is taken meanwhile, or it cannot be moved.
        """
        stem = name.removesuffix(SUFFIX)
        if all(path.stem != stem for path in _files(self.trash)):
            raise InputError(f"recording {name!r}: expected one of the trash, found none in {self.trash}")
        target = self.folders[0] / (stem + SUFFIX)
        _move_to_free(self.trash / (stem + SUFFIX), target, "restore")
        return self.find(target.stem)

    def empty_trash(self) -> list[Path]:
        """Delete the recordings in the trash for good; returns where they were.

        Raises:
            InputError: one cannot be deleted.
        """
        gone = _files(self.trash)
        for path in gone:
            try:
                path.unlink()
            except OSError as error:
                raise InputError(f"{path}: could not delete the recording: {error.strerror or error}") from error
        return gone

    def add(self, file: Path, name: str | None = None) -> LibraryEntry:
        """Copy a recording into the user's folder; a copy that fails leaves no file.

        Raises:
            InputError: it is no finished recording, its name is taken, or it cannot be copied.
        """
        file = Path(file)
        if not file.is_file():
            raise InputError(f"{file}: expected a recording (.rrd), found no such file")
        read_facts(file)
        folder = self.folders[0]
        target = folder / (_checked(name or file.stem) + SUFFIX)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with beside(target) as temporary:
                shutil.copyfile(file, temporary)
                _move_to_free(temporary, target, "copy")
        except OSError as error:
            raise InputError(f"{target}: could not copy the recording: {error.strerror or error}") from error
        return self.find(target.stem)


def _move_to_free(source: Path, target: Path, what: str) -> None:
    """Move a file to an unused name; the name is reserved first, since moving alone would overwrite another file."""
    try:
        target.open("xb").close()
    except FileExistsError as error:
        raise InputError(f"{target}: expected a name that is free, found a recording of it") from error
    except OSError as error:
        raise InputError(f"{target}: could not {what} the recording: {error.strerror or error}") from error
    try:
        os.replace(source, target)
    except OSError as error:
        target.unlink(missing_ok=True)
        raise InputError(f"{target}: could not {what} the recording: {error.strerror or error}") from error


def _files(folder: Path) -> list[Path]:
    try:
        inside = sorted(folder.iterdir())
    except OSError:
        return []
    return [p for p in inside if p.suffix == SUFFIX and p.name[0] != "." and p.is_file() and not p.is_symlink()]


def _entry(path: Path) -> LibraryEntry | None:
    try:
        status = path.stat()
    except OSError:  # removed meanwhile
        return None
    modified, read_only = datetime.fromtimestamp(status.st_mtime, tz=UTC), _why_read_only(path)
    try:
        return LibraryEntry(path, status.st_size, modified, read_facts(path), read_only=read_only)
    except InputError as error:
        fault = str(error).partition("found ")[2] or str(error)
        return LibraryEntry(path, status.st_size, modified, fault=fault, read_only=read_only)


def _why_read_only(path: Path) -> str | None:
    """Return why a file is neither renamed nor deleted by this program: it ships with it, or git looks after it."""
    if path.parent.resolve() == _SHIPPED.resolve():
        return "ships with SI Maps"
    home = Path.home().resolve()
    for folder in path.resolve().parents:
        if folder == home:  # a home that is a repository keeps settings there, and data is ignored
            return None
        if (folder / ".git").exists():
            return f"lies under version control ({folder})"
    return None


def _checked(name: str) -> str:
    """Raise InputError unless a name is one for a file, and nothing but a name."""
    stem = name.strip().removesuffix(SUFFIX)
    if not stem or stem[0] == "." or len(stem) > _MAX_NAME or not stem.isprintable() or set(stem) & set('/\\:*?"<>|'):
        raise InputError(f"name of a recording: expected a file name without / and the like, found {name[:60]!r}")
    return stem


def unfinished_recordings(path: Path) -> list[Path]:
    """Find the partial recordings that killed builds have left: hidden files in the same folder, the newest last."""
    left = path.parent.glob(f".{path.stem}.*.partial.rrd")
    return sorted((p for p in left if not _is_running(p)), key=lambda p: p.stat().st_mtime)


def repair_recording(broken: Path, output: Path) -> int:
    """Write all complete messages of a broken recording as a finished one, with its end and its layout.

    Args:
        broken: a recording that ends anywhere; it stays as it is.
        output: where the mended one goes (.rrd); may be the same file.

    Returns:
        The number of frames it shows.

    Raises:
        InputError: there is no recording in it, or the output cannot be written.
    """
    if not broken.is_file():
        raise InputError(f"{broken}: expected a recording (.rrd), found nothing")
    with replacing(output, "the recording") as mended:
        merge = [sys.executable, "-m", "rerun", "rrd", "merge", "--continue-on-error", "-o", str(mended), str(broken)]
        done = subprocess.run(merge, capture_output=True, text=True, check=False)
        if unwritten := re.search(r"Failed to write: ([^(\n]+)", done.stderr):
            raise InputError(f"{output}: could not write the recording: {unwritten[1].strip()}")
        frames = _frames(mended) if done.returncode == 0 else 0
        if not frames:
            raise InputError(f"{broken}: expected the recording of a build, found no whole frame in it")
    return frames


def _frames(path: Path) -> int:
    """Count the frames a recording shows; 0 when it is none."""
    import rerun.chunk as rc  # noqa: PLC0415 - rerun is slow to import

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            chunks = rc.RrdReader(path).stream().filter(content="/world/camera").to_chunks()
    except (ValueError, RuntimeError, OSError, Warning):
        return 0
    seen: set[int] = set()
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if "frame" in batch.schema.names:
            seen |= set(batch.column("frame").to_pylist())
    return len(seen)


def _is_running(partial: Path) -> bool:
    """Return whether the program that writes a partial recording is still there."""
    try:
        os.kill(int(partial.name.split(".")[-3]), 0)
    except (ValueError, IndexError, ProcessLookupError):
        return False
    except PermissionError:
        return True
    return True
