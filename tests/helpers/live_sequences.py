"""A sequence whose frames come when the test says so."""

import threading
from pathlib import Path
from typing import Any

from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.build.to_file import BuildRequest


class Held:
    """The frames of a tiny sequence, from a certain one on held back until ``let_go``."""

    def __init__(self, folder: Path, frames: int, *, held_from: int) -> None:
        write_tiny_sequence(folder, frames=frames)
        self.whole: Any = open_sequence(folder)
        self._held_from = held_from
        self._free = threading.Event()

    def let_go(self) -> None:
        self._free.set()

    def read(self, index: int, **how: Any) -> Any:
        if index >= self._held_from:
            assert self._free.wait(600.0)
        return self.whole.read(index, **how)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.whole, name)

    def __len__(self) -> int:
        return len(self.whole)


def held_sequence(folder: Path, frames: int, *, held_from: int) -> Any:
    """Make such a sequence; it serves as a frame source."""
    return Held(folder, frames, held_from=held_from)


def at_once(monkeypatch: Any) -> None:
    """Let builds show every frame, the map and the recording by turns, whatever it costs."""
    for name, value in {"FIRST_S": 0.0, "SOON_S": 0.0, "WATCHED_S": 0.0, "SHARE": 1e9}.items():
        monkeypatch.setattr(f"simaps_viz.app.live.{name}", value)


def settings(output: Path, **others: Any) -> BuildRequest:
    return BuildRequest("evidence", BuildConfig(), output, **others)
