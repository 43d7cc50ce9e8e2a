"""A build that people watch: in a thread of its own, its map shown now and then; it can be stopped and gone on with."""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from simaps_viz.build.pipeline import BuildCancelled
from simaps_viz.console.logs import logger
from simaps_viz.errors import SIMapsError
from simaps_viz.events import BuildStarted, CommunitiesFound, Event, FrameProjected, FrameSkipped, Observer
from simaps_viz.structures import SIMap
from simaps_viz.viewer.panels.live import LiveState

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
        """Whether something may be shown now; ``left_s``: how long the build still needs, where that is known."""
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


RATE_OVER_S = 5.0
"""Frames a second are those of the last so many seconds."""
SKETCH_SHARE = 0.03
"""Of the time since the last sketch that may go into making the next one."""
SKETCH_EVERY_S = 0.9
"""How often a sketch is made at most; the page looks a little less often."""
STOPPED = "Stopped. Nothing is lost: go on here, or later with the same command and --resume."
BEGINS_ANEW = "Stopped. This method keeps no log of its frames: going on begins at the first one."


class Stream(Protocol):
    """Where some of the build's frames are shown, with what their camera saw."""

    def on_event(self, event: Event) -> None:
        """Take one event; shows nothing yet."""
        ...

    def show(self, event: FrameProjected, simap: SIMap | None) -> None:
        """Show a frame, and the objects found so far where they are new."""
        ...


Run = Callable[[Sequence[Observer], threading.Event, bool], SIMap]
"""(observers, set to stop it, whether to go on with what is there) -> the finished map, which is saved."""


@dataclass(frozen=True, eq=False)
class Audience:
    """Who watches."""

    show: Callable[[SIMap], None]
    """Show the map so far; returns at once."""
    watches: Callable[[], bool]
    """Whether anybody does."""
    done: Callable[[SIMap], str]
    """The map is finished and saved; says where."""
    stream: Stream | None = None
    sketch: Callable[[FrameProjected], bytes] = lambda event: b""
    """Draw what was seen so far in little time, for ``LiveState.sketch``."""
    stopped: str = STOPPED
    """What is said of a build that was stopped."""


class LiveBuild:
    """Begins with ``start``; all else may be called from any thread."""

    wants_color = False

    def __init__(self, run: Run, frames: int, audience: Audience) -> None:
        """Take what builds, of how many frames, and who watches."""
        self._run, self._audience = run, audience
        self._state = LiveState(total=frames)
        self._lock = threading.RLock()
        self._cancel = threading.Event()
        self._thread: threading.Thread | None = None
        self._arrived: deque[tuple[float, int]] = deque()
        self._began_s = self._sketch_s = self._busy_before_s = 0.0
        self._pace = Pace()
        self._for_stream: SIMap | None = None
        self._latest: FrameProjected | None = None
        self._show_last = True
        self._turn = False
        self.maps_shown = self.frames_shown = self.sketches = 0
        """What was shown while frames came, for the bench: maps, frames in the recording, sketches."""
        self.saved_s: float | None = None
        """How long it took from the last start to the saved map, for the bench."""
        self.busy_s = 0.0
        """Processor time of the whole program in that time."""

    def state(self) -> LiveState:
        """Return how far it is."""
        return self._state

    def start(self, *, resume: bool = False) -> None:
        """Begin, or go on; does nothing while it runs or when it is done."""
        with self._lock:
            if self._state.status == "done" or self._runs():
                return
            if self._thread is not None:
                self._thread.join()  # it has said that it ended, and clears up
            self._cancel, self._latest, self._show_last = threading.Event(), None, True
            self._arrived.clear()
            self._began_s = self._sketch_s = time.perf_counter()
            self._pace.begin(self._began_s)
            self._busy_before_s = time.process_time()
            self._say(status="starting", error="", said="", rate=None, left_s=None)
            self._thread = threading.Thread(target=self._build, args=(resume,), name="live-build", daemon=True)
            self._thread.start()

    def go_on(self) -> None:
        """Begin again where it was stopped or has failed."""
        self.start(resume=True)

    def stop(self, *, show: bool = True) -> None:
        """Stop after the frame that is being worked on; ``show``: then show the map so far, which may take a while."""
        with self._lock:
            if self._runs():
                self._show_last = show
                self._cancel.set()
                self._say(status="stopping")

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until it is done, stopped or failed; False when that took too long."""
        thread = self._thread
        if thread is not None:
            thread.join(timeout_s)
        return thread is None or not thread.is_alive()

    def _runs(self) -> bool:
        """Return whether the build has not yet said how it ended; its thread may live on for a moment."""
        alive = self._thread is not None and self._thread.is_alive()
        return alive and self._state.status not in ("done", "stopped", "failed")

    def on_event(self, event: Event) -> None:
        """Watch the build, from its thread."""
        if isinstance(event, FrameProjected):
            self._arrive(event.frame.index + 1)
            self._show(event)
        elif isinstance(event, FrameSkipped):
            self._arrive(event.index + 1)
            self._say(skipped=self._state.skipped + 1)
        elif isinstance(event, BuildStarted):
            self._say(skipped=0, total=len(event.frame_names))
        elif isinstance(event, CommunitiesFound) and event.final:
            self._say(status="finishing", left_s=None)
        if self._audience.stream is not None:
            self._audience.stream.on_event(event)

    def _build(self, resume: bool) -> None:
        try:
            simap = self._run((self,), self._cancel, resume)
            self.saved_s, self.busy_s = time.perf_counter() - self._began_s, time.process_time() - self._busy_before_s
            self._say(status="finishing", done=self._state.total)
            said = self._audience.done(simap)
            self._say(status="done", said=said)
        except BuildCancelled:
            self._show_stopped()
            self._say(status="stopped", said=self._audience.stopped)
        except SIMapsError as error:
            self._say(status="failed", error=str(error))
        except Exception as error:  # the page has to say so; the log has it in full
            logger.error("a build that was watched failed", exc_info=error)
            self._say(status="failed", error=f"Unexpected error ({type(error).__name__}): {error}")
        finally:
            self._latest = None  # with it goes what the build has gathered

    def _show_stopped(self) -> None:
        """Show the map of all frames there are, and the last of them; a fault in that is no fault of the build."""
        event, audience = self._latest, self._audience
        if event is None or event.map_so_far is None or not (self._show_last and audience.watches()):
            return
        try:
            self._say(sketch=audience.sketch(event))
            self._show_map(event.map_so_far())
            if audience.stream is not None:
                audience.stream.show(event, self._for_stream)
        except Exception as error:
            logger.error("the map of a stopped build could not be shown", exc_info=error)
        self._for_stream = None

    def _show_map(self, simap: SIMap) -> None:
        self._for_stream = simap
        self._audience.show(simap)
        self.maps_shown += 1
        self._say(shown=len(simap.frame_names))

    def _say(self, **changes: object) -> None:
        with self._lock:
            self._state = replace(self._state, **changes)  # pyright: ignore[reportArgumentType]

    def _arrive(self, done: int) -> None:
        now = time.perf_counter()
        self._pace.arrive(now)
        self._arrived.append((now, done))
        while now - self._arrived[0][0] > RATE_OVER_S:
            self._arrived.popleft()
        (then, before), total = self._arrived[0], self._state.total
        rate = (done - before) / (now - then) if now > then else None
        with self._lock:
            status = "stopping" if self._cancel.is_set() else "building"
            self._say(status=status, done=done, rate=rate, left_s=(total - done) / rate if rate else None)

    def _show(self, event: FrameProjected) -> None:
        """Show the map so far, or this frame, by turns, when it is time and somebody looks."""
        self._latest = event
        if not self._audience.watches():
            return
        began_s = time.perf_counter()
        if began_s >= self._sketch_s:
            sketch = self._audience.sketch(event)
            took_s = time.perf_counter() - began_s
            self._sketch_s = began_s + max(SKETCH_EVERY_S, took_s / SKETCH_SHARE)
            self.sketches += 1
            self._say(sketch=sketch)
        if not self._pace.has_time(began_s, self._state.left_s):
            return
        if self._turn and self._audience.stream is not None:
            self._audience.stream.show(event, self._for_stream)
            self._for_stream = None
            self.frames_shown += 1
        elif event.map_so_far is not None:
            self._show_map(event.map_so_far())
        self._turn = not self._turn
        self._pace.shown(began_s, time.perf_counter())
