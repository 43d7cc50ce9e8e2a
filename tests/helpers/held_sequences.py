"""Shared by the tests of process and others."""

import time
from pathlib import Path
from typing import Any

from deadly_sequences import Deadly, KillsItsWorker

from simaps_viz import open_sequence


class Held(Deadly):
    """A sequence whose one frame is not read before there is a flag, a file."""

    def read(self, index, *, color=False):
        while index == self._frame and not self._flag.exists():
            self._flag.with_suffix(".asked").touch()
            time.sleep(0.02)
        return self._sequence.read(index, color=color)


class OpensHeld(KillsItsWorker):
    def __call__(self) -> Any:
        return Held(open_sequence(Path(self.path)), self.frame, Path(self.flag))
