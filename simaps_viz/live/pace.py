"""When to show a build that goes on: as often as it may cost, measured by how much slower the build goes after it."""

from collections import deque

SHARE = 0.1
"""Of a build's time that may be lost to showing it."""
FIRST_S = 1.0
"""Nothing is shown before: a build that is over by then is fastest seen when it is done."""
LONGEST_S = 10.0
"""However much slower the build goes afterwards: so often something is shown. What making it takes counts in full."""
WATCHED_S = 0.8
"""For how long after something was shown the build is watched: by then a page has painted it. Nothing more is shown
before."""
MOST_LOST_S = 2.0
"""No page works longer on what it is shown; a build that stays slow is slow for another reason."""
SOON_S = 0.7
"""Nothing more is shown when the build needs no longer than that."""
REMEMBERED = 3
"""Showings over which the cost is averaged."""
MOST_CALM_FRAMES = 200
"""The build's own rate is that of about so many frames."""


class Pace:
    """Told when frames arrive and when something was shown; all times in seconds, of one clock.

    What is shown costs twice: making it holds up the build itself, and drawing it keeps processors busy, here and in
    the browser, wherever that runs. Both are the frames that the build should have done meanwhile at its own rate.
    """

    def __init__(self) -> None:
        """Begin with ``begin``."""
        self.begin(0.0)

    def begin(self, now_s: float) -> None:
        """A build begins, or goes on."""
        self._last_s: float | None = None
        self._next_s = now_s + FIRST_S
        self._calm_s, self._calm_frames = 0.0, 0
        self._shown_s: float | None = None
        self._making_s, self._since = 0.0, 0
        self._lost: deque[float] = deque(maxlen=REMEMBERED)

    def arrive(self, now_s: float) -> None:
        """A frame is on the map."""
        passed_s = 0.0 if self._last_s is None else now_s - self._last_s
        first, self._last_s = self._last_s is None, now_s
        if self._shown_s is not None:
            self._since += 1
            if now_s - self._shown_s >= WATCHED_S:
                self._judge(now_s)
        elif not first:
            self._calm_s, self._calm_frames = self._calm_s + passed_s, self._calm_frames + 1
            if self._calm_frames > MOST_CALM_FRAMES:
                self._calm_s, self._calm_frames = self._calm_s / 2, self._calm_frames // 2

    def has_time(self, now_s: float, left_s: float | None = None) -> bool:
        """Tell whether something may be shown now; ``left_s``: how long the build still needs, where that is known."""
        return self._shown_s is None and now_s >= self._next_s and (left_s is None or left_s >= SOON_S)

    def shown(self, began_s: float, now_s: float) -> None:
        """Something has been made to be shown, which held up the build since ``began_s``."""
        self._making_s, self._since = now_s - began_s, 0
        self._shown_s = self._last_s = now_s

    def _judge(self, now_s: float) -> None:
        assert self._shown_s is not None
        watched_s = now_s - self._shown_s
        own_s = self._calm_s / self._calm_frames if self._calm_frames else watched_s / self._since
        self._lost.append(min(max(watched_s - self._since * own_s, 0.0), MOST_LOST_S))
        lost_s = sum(self._lost) / len(self._lost)
        wait_s = self._making_s / SHARE + min(lost_s / SHARE, LONGEST_S)
        self._next_s = self._shown_s + wait_s
        self._shown_s = None
