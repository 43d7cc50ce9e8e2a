"""How long the stages of a command took."""

import time
from collections.abc import Callable


class StageClock:
    """Measures one stage after another; a stage that comes again goes on where it was."""

    def __init__(self, now: Callable[[], float] = time.perf_counter) -> None:
        """Take the clock to read, in seconds."""
        self._now = now
        self._spent: dict[str, float] = {}
        self._current: str | None = None
        self._since = 0.0

    def begin(self, stage: str) -> None:
        """End the stage that runs, if any, and begin another; beginning the one that runs does nothing."""
        if stage == self._current:
            return
        self.end()
        self._current, self._since = stage, self._now()
        self._spent.setdefault(stage, 0.0)

    def end(self) -> None:
        """End the stage that runs, if any."""
        if self._current is not None:
            self._spent[self._current] += self._now() - self._since
            self._current = None

    def seconds(self) -> dict[str, float]:
        """Give {stage: seconds} in the order they began; the one that runs counts up to now."""
        spent = dict(self._spent)
        if self._current is not None:
            spent[self._current] += self._now() - self._since
        return {stage: round(value, 4) for stage, value in spent.items()}
