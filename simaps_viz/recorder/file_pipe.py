"""Writes what rerun records into a file, and tells when it cannot: rerun itself waits for ever on a full disk."""

import os
import shutil
import tempfile
import threading
from pathlib import Path

_AT_ONCE = 1 << 20


class FilePipe:
    """A file behind a pipe. Everything put in is taken out, written or, after a failure, dropped."""

    def __init__(self, path: Path) -> None:
        """Make both; raises OSError where that cannot be."""
        self._file = path.open("wb", buffering=0)
        self._folder = Path(tempfile.mkdtemp(prefix="simaps-recording-"))
        self.entrance: Path = self._folder / path.name
        """Where to write: a pipe that is read from now on."""
        os.mkfifo(self.entrance, 0o600)
        self._failure: OSError | None = None
        self._thread = threading.Thread(target=self._pass_on, name="recording", daemon=True)
        self._thread.start()

    def opened(self) -> None:
        """The writer has opened the entrance; nobody else needs it."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def finish(self) -> None:
        """Wait until all is on the disk, once the writer has closed the entrance; raises OSError when it is not."""
        self._thread.join()
        with self._file:
            if self._failure is not None:
                raise self._failure
            os.fsync(self._file.fileno())

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
