"""Writes what rerun records into a file, and tells when it cannot: rerun itself waits for ever on a full disk."""

import contextlib
import os
import shutil
import tempfile
import threading
from pathlib import Path

_AT_ONCE = 1 << 20


class FilePipe:
    """A file behind a pipe. Everything put in is taken out, written or, after a failure, dropped."""

    def __init__(self, path: Path) -> None:
        """Make both; raises OSError when the file cannot be made. Where pipes cannot, the file is its own entrance."""
        self.path = path
        self.entrance = path
        """Where to write: a pipe that is read from now on, or the file itself."""
        self._file = path.open("wb", buffering=0)
        self._folder: Path | None = None
        self._thread: threading.Thread | None = None
        self._failure: OSError | None = None
        if hasattr(os, "mkfifo"):  # not on Windows
            with contextlib.suppress(OSError):
                self._dig()

    def opened(self) -> None:
        """The writer has opened the entrance; nobody else needs it."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def finish(self) -> None:
        """Wait until all is on the disk, once the writer has closed the entrance; raises OSError when it is not."""
        if self._thread is not None:
            self._thread.join()
        with self._file:
            if self._failure is not None:
                raise self._failure
            os.fsync(self._file.fileno())

    def _dig(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="simaps-recording-"))
        pipe = self._folder / self.path.name
        try:
            os.mkfifo(pipe, 0o600)
        except OSError:
            self.opened()
            raise
        self.entrance = pipe
        self._thread = threading.Thread(target=self._pass_on, name="recording", daemon=True)
        self._thread.start()

    def _pass_on(self) -> None:
        with self.entrance.open("rb", buffering=0) as pipe:
            while data := pipe.read(_AT_ONCE):
                if self._failure is None:
                    self._write(memoryview(data))

    def _write(self, data: memoryview) -> None:
        try:
            while data:
                data = data[self._file.write(data) :]
        except OSError as error:
            self._failure = error
