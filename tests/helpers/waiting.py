"""Waiting for what other threads do."""

import time
from collections.abc import Callable


def until(predicate: Callable[[], object], timeout_s: float = 60.0) -> None:
    """Wait until a predicate holds; a test fails when that takes too long."""
    end = time.monotonic() + timeout_s
    while not predicate():
        assert time.monotonic() < end, "timed out"
        time.sleep(0.01)
