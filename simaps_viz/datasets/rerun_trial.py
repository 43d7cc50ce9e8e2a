"""Has another process read a rerun recording first: of a damaged one rerun's library may end the process it runs in.

One process serves all recordings; where one ended it, the next one gets a new process.
"""

import atexit
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

from simaps_viz.errors import InputError

_ROOM = 8 << 30
"""Bytes of address space that the other process may take."""
_PROGRAM = f"""
import resource, sys, warnings
warnings.simplefilter("ignore")
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
hard = resource.getrlimit(resource.RLIMIT_AS)[1]
room = {_ROOM} if hard == resource.RLIM_INFINITY else min({_ROOM}, hard)
resource.setrlimit(resource.RLIMIT_AS, (room, hard))
import rerun.chunk as rc
for line in sys.stdin:
    try:
        for chunk in rc.RrdReader(line[:-1]).stream():
            chunk.to_record_batch()
    except Exception:
        pass  # whoever reads it next says what is wrong
    print("read", flush=True)
"""


class _Trial:
    """The other process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None

    def survives(self, path: Path) -> bool:
        """Have it read a file; False when that ended it."""
        with self._lock:
            process = self._running()
            assert process.stdin is not None and process.stdout is not None
            try:
                process.stdin.write(f"{path.absolute()}\n")
                process.stdin.flush()
                survived = process.stdout.readline() == "read\n"
            except (OSError, UnicodeEncodeError):
                survived = False
            if not survived:
                self.close()
            return survived

    def close(self) -> None:
        """End it."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            for pipe in (process.stdin, process.stdout):
                with suppress(OSError):
                    pipe.close()  # pyright: ignore[reportOptionalMemberAccess]
            process.wait()

    def _running(self) -> subprocess.Popen[str]:
        if self._process is not None and self._process.poll() is not None:
            self.close()
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL, text=True, encoding="utf-8",
            )  # fmt: skip
        return self._process


_trial = _Trial()
atexit.register(_trial.close)


def check_readable(path: Path) -> None:
    """Raise InputError for a recording that ends the process which reads it; costs a second once, then a reading."""
    if "\n" in str(path) or not _trial.survives(path):
        raise InputError(f"{path}: expected a rerun recording, found one so damaged that rerun cannot read it")
