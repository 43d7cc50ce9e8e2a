"""What the page asks of a build that goes on while it is looked at."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Status = Literal["starting", "building", "finishing", "stopping", "stopped", "failed", "done"]


@dataclass(frozen=True)
class LiveState:
    """How far a build is."""

    status: Status = "starting"
    done: int = 0
    """Frames on the map."""
    total: int = 0
    """Frames of the sequence."""
    rate: float | None = None
    """Frames a second, lately."""
    left_s: float | None = None
    """Seconds until the last frame is on the map."""
    skipped: int = 0
    """Frames that could not be read."""
    error: str = ""
    """Why it failed, in words."""
    said: str = ""
    """Where the map is, once it is done; or how a stopped build goes on."""
    shown: int = 0
    """Frames that the map on the page knows of; 0 = none has been shown yet."""
    sketch: bytes = b""
    """Picture (PNG) of what was seen so far, north up; empty = none."""


@dataclass(frozen=True)
class LiveServices:
    """All of these return at once."""

    state: Callable[[], LiveState]
    stop: Callable[[], None]
    go_on: Callable[[], None]
    """Begin again where it was stopped, or has failed."""
