"""A live build: the map grows on the page, and in the docked recording, while it is computed.

`LiveBuild` builds in a thread of its own and shows the map now and then, as `Pace` allows; it can be stopped and
resumed. `live_workbench` serves the page of such a build; `source_workbench` that of a map whose frames come from a
live source, which ends with a saved map when it is stopped.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.app import workbench
from simaps_viz.build.methods import config_of, keeps_log
from simaps_viz.build.pipeline import BuildCancelled, BuildConfig, facts_of, started
from simaps_viz.build.to_file import BuildRequest, RecordingFault, build_to_file, resume_hint
from simaps_viz.console.logs import logger
from simaps_viz.console.progress import StageProgress, stage_progress
from simaps_viz.console.terminal import note
from simaps_viz.datasets.source import FrameSource
from simaps_viz.drawing.texture import sketch_png
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.events import BuildStarted, CommunitiesFound, Event, FrameProjected, FrameSkipped, Observer
from simaps_viz.live.drive import Driver
from simaps_viz.live.robot import RobotSource
from simaps_viz.live.run import LiveRequest, LiveRun
from simaps_viz.mapping.finalize import SequenceFacts
from simaps_viz.mapping.mending import Mending, open_mending
from simaps_viz.mapping.partition import empty_log, empty_views
from simaps_viz.mapping.simap import Origin, assemble
from simaps_viz.navigation.agent import start_pose
from simaps_viz.recorder.recorder import LiveStream
from simaps_viz.structures import Grid, GridSpec, Pose2, SIMap
from simaps_viz.viewer.page.panel import PanelSpec
from simaps_viz.viewer.panels.live import LiveState, live_panel
from simaps_viz.viewer.workbench import Workbench

AROUND_M = 2.0
"""Margin of floor that is shown around the cameras' path before anything was seen, metres."""
MAX_CELLS = 4_000_000
CELL_M = 0.05
"""Of the map of a live source before anything came."""
REPORT_S = 2.0
"""How often a live source is reported on, seconds."""

SHARE = 0.1
"""Share of a build's time that may be lost to showing it."""
FIRST_S = 1.0
"""Nothing is shown before: a build that is over by then is fastest seen when it is done."""
MAX_WAIT_S = 10.0
"""Longest wait that slow drawing can cause between two updates, seconds; the time to make an update always counts in
full."""
WATCHED_S = 0.8
"""For how long after something was shown the build is watched: by then a page has painted it. Nothing more is shown
before."""
MAX_LOST_S = 2.0
"""Upper bound of the time a page works on one update; a build that is slow for longer has another reason."""
SOON_S = 0.7
"""Nothing more is shown when the build needs no longer than that."""
REMEMBERED = 3
"""Showings over which the cost is averaged."""
MAX_CALM_FRAMES = 200
"""The build's own rate is that of about so many frames."""


class Pace:
    """Decides when the next update may be shown, from the times of frames and earlier updates; seconds of one clock.

    An update costs twice: making it stops the build, and drawing it occupies processors, here and in the browser.
    Both costs are measured as the frames that the build would have mapped in that time at its own rate.
    """

    def __init__(self) -> None:
        """Begin with ``begin``."""
        self.begin(0.0)

    def begin(self, now_s: float) -> None:
        """A build begins, or resumes."""
        self._last_s: float | None = None
        self._next_s = now_s + FIRST_S
        self._calm_s, self._calm_frames = 0.0, 0
        self._shown_s: float | None = None
        self._making_s, self._since = 0.0, 0
        self._lost: deque[float] = deque(maxlen=REMEMBERED)

    def arrive(self, now_s: float) -> None:
        """Take note that a frame is on the map."""
        passed_s = 0.0 if self._last_s is None else now_s - self._last_s
        first, self._last_s = self._last_s is None, now_s
        if self._shown_s is not None:
            self._since += 1
            if now_s - self._shown_s >= WATCHED_S:
                self._judge(now_s)
        elif not first:
            self._calm_s, self._calm_frames = self._calm_s + passed_s, self._calm_frames + 1
            if self._calm_frames > MAX_CALM_FRAMES:
                self._calm_s, self._calm_frames = self._calm_s / 2, self._calm_frames // 2

    def has_time(self, now_s: float, left_s: float | None = None) -> bool:
        """Whether something may be shown now; ``left_s``: how long the build still needs, where that is known."""
        return self._shown_s is None and now_s >= self._next_s and (left_s is None or left_s >= SOON_S)

    def shown(self, began_s: float, now_s: float) -> None:
        """Take note that something was made to be shown, which held up the build since ``began_s``."""
        self._making_s, self._since = now_s - began_s, 0
        self._shown_s = self._last_s = now_s

    def _judge(self, now_s: float) -> None:
        """Schedule the next update by the cost of the last ones."""
        assert self._shown_s is not None
        # The loss is the time beyond what the same number of frames takes without updates.
        watched_s = now_s - self._shown_s
        own_s = self._calm_s / self._calm_frames if self._calm_frames else watched_s / self._since
        self._lost.append(min(max(watched_s - self._since * own_s, 0.0), MAX_LOST_S))
        # The time to make an update counts in full; that to draw it is bounded: other things slow builds, too.
        lost_s = sum(self._lost) / len(self._lost)
        wait_s = self._making_s / SHARE + min(lost_s / SHARE, MAX_WAIT_S)
        self._next_s = self._shown_s + wait_s
        self._shown_s = None


RATE_OVER_S = 5.0
"""Frames a second are those of the last so many seconds."""
SKETCH_SHARE = 0.03
"""Share of the time since the last sketch that may go into making the next one."""
SKETCH_EVERY_S = 0.9
"""How often a sketch is made at most; the page looks a little less often."""
STOPPED = "Stopped. Nothing is lost: resume here, or later with the same command and --resume."
STARTS_AGAIN = "Stopped. This method keeps no log of its frames: resuming starts at the first one."


Run = Callable[[Sequence[Observer], threading.Event, bool], SIMap]
"""(observers, set to stop it, whether to resume from the log) -> the finished map, which is saved."""
Words = Callable[[], str]
"""Describes the state of a live source."""


@dataclass(frozen=True, eq=False)
class Audience:
    """The page and the recording that a build is shown on."""

    show: Callable[[SIMap], None]
    """Show the unfinished map; returns at once."""
    watches: Callable[[], bool]
    """Whether anybody is watching."""
    done: Callable[[SIMap], str]
    """Called when the map is finished and saved; returns the words that say where."""
    stream: LiveStream | None = None
    sketch: Callable[[FrameProjected], bytes] = lambda event: b""
    """Draw a quick sketch of the cells observed so far, for ``LiveState.sketch``."""
    stopped: str = STOPPED
    """Words for a build that was stopped."""


class LiveBuild:
    """A build in its own thread that reports updates; its methods may be called from any thread."""

    wants_color = False

    def __init__(self, run: Run, frames: int, audience: Audience) -> None:
        """Create a build that has not begun yet; ``start`` begins it."""
        self._run, self._audience = run, audience
        self._state = LiveState(total=frames)
        self._lock = threading.RLock()
        self._cancel = threading.Event()
        self._thread: threading.Thread | None = None
        self._arrived: deque[tuple[float, int]] = deque()
        self._sketch_s = 0.0
        self._pace = Pace()
        self._for_stream: SIMap | None = None
        self._latest: FrameProjected | None = None
        self._show_last = True
        self._turn = False

    def state(self) -> LiveState:
        """Return how far it is."""
        return self._state

    def start(self, *, resume: bool = False) -> None:
        """Begin, or resume; does nothing while it runs or when it is done."""
        with self._lock:
            if self._state.status == "done" or self._runs():
                return
            if self._thread is not None:
                self._thread.join()  # it reported its end, and is clearing up
            self._cancel, self._latest, self._show_last = threading.Event(), None, True
            self._arrived.clear()
            self._sketch_s = time.perf_counter()
            self._pace.begin(self._sketch_s)
            self._say(status="starting", error="", notice="", rate=None, left_s=None)
            self._thread = threading.Thread(target=self._build, args=(resume,), name="live-build", daemon=True)
            self._thread.start()

    def go_on(self) -> None:
        """Begin again where it was stopped or has failed."""
        self.start(resume=True)

    def stop(self, *, show: bool = True) -> None:
        """Stop after the frame that is being worked on; ``show``: then show the unfinished map, which takes a while."""
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
        """Whether the build has not reported its end yet; its thread may end slightly later."""
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
            self._say(status="finishing", done=max(self._state.done, self._state.total))
            said = self._audience.done(simap)
            self._say(status="done", notice=said)
        except BuildCancelled:
            self._show_stopped()
            self._say(status="stopped", notice=self._audience.stopped)
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

    def _show_map(self, simap: SIMap | None) -> None:
        if simap is None:  # of a live build, whose first map is being made
            return
        self._for_stream = simap
        self._audience.show(simap)
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
            self._say(status=status, done=done, rate=rate, left_s=(total - done) / rate if rate and total else None)

    def _show(self, event: FrameProjected) -> None:
        """Show the unfinished map, or this frame, by turns, when there is time and somebody is watching."""
        self._latest = event
        if not self._audience.watches():
            return
        # A small sketch of the map costs little and comes about once a second.
        began_s = time.perf_counter()
        if began_s >= self._sketch_s:
            sketch = self._audience.sketch(event)
            took_s = time.perf_counter() - began_s
            self._sketch_s = began_s + max(SKETCH_EVERY_S, took_s / SKETCH_SHARE)
            self._say(sketch=sketch)
        # The map itself and the recording take turns, at a pace that costs the build a tenth of its time.
        if not self._pace.has_time(began_s, self._state.left_s):
            return
        if self._turn and self._audience.stream is not None:
            self._audience.stream.show(event, self._for_stream)
            self._for_stream = None
        elif event.map_so_far is not None:
            self._show_map(event.map_so_far())
        self._turn = not self._turn
        self._pace.shown(began_s, time.perf_counter())


def watch_build(sequence: FrameSource, request: BuildRequest, *, port: int, browser: bool) -> None:
    """Build a map and show it while it grows, until Ctrl-C, which leaves a log to resume from."""
    with stage_progress() as progress, live_workbench(sequence, request, progress, port=port) as (page, build):
        workbench.tell_where(page, browser=browser)
        build.start(resume=request.resume)
        try:
            with resume_hint(request.output):
                _wait(build)
            page.wait()
        finally:
            build.stop(show=False)
            build.wait(10.0)


class _LivePage:
    """The page of a live build, with the resulting map, its edits, and the errors that do not end the build."""

    def __init__(self, waiting: SIMap, output: Path, record: Path | None = None) -> None:
        """Take the map to begin with, and the files that the map and its recording are written to."""
        self.waiting, self._output, self._record = waiting, output, record
        self.faults: list[str] = []
        self._ended = False
        self._page: Workbench | None = None
        self._progress: PanelSpec | None = None
        self.mending: Mending | None = None

    def audience(self, stream: LiveStream, stopped: str) -> Audience:
        """Return the page as the audience of its build; ``stopped``: words for a build that was stopped."""
        return Audience(
            show=self._show,
            watches=lambda: bool(self._opened.sessions),
            done=lambda simap: self._done(simap, stream),
            stream=stream,
            sketch=lambda event: sketch_png(event.snapshot(), event.T_map_camera[:2, 3]),
            stopped=stopped,
        )

    @contextmanager
    def serve(
        self, build: LiveBuild, stream: LiveStream, port: int, *,
        start: Pose2 | None, words: Words | None = None, driver: Driver | None = None,
    ) -> Iterator[Workbench]:  # fmt: skip
        """Serve the page until the block ends, which stops the build."""

        def state() -> LiveState:
            driving = "" if driver is None else driver.words()
            return build.state() if words is None else replace(build.state(), words=words(), driving=driving)

        self._progress = live_panel(state, build.stop, build.go_on, driver)
        services = replace(
            workbench.services_of(self.waiting, mending=lambda: self.mending),
            panels=(self._progress,),
            stream=stream.url,
            building=True,
            look_back=workbench.look_back(lambda: None if self.mending is None else self._output),
        )
        with Workbench(self.waiting, services=services, port=port, start=start) as page:
            self._page = page
            yield page
            self._ended = True
            build.stop(show=False)
            build.wait(10.0)

    def driver(self, source: RobotSource, *, allowed: bool) -> Driver:
        """Return what lets a robot drive on the map that the page shows, as long as somebody looks at it."""
        simap = lambda: self.waiting if self._page is None else self._page.simap  # noqa: E731
        watched = lambda: self._page is not None and bool(self._page.sessions)  # noqa: E731
        return Driver(source, simap, watched, allowed=allowed)

    def _show(self, simap: SIMap) -> None:
        if simap is not self._opened.simap:
            self._opened.publish(simap, growing=True)

    @property
    def _opened(self) -> Workbench:
        assert self._page is not None, "a build starts when its page is open"
        return self._page

    def _done(self, simap: SIMap, stream: LiveStream) -> str:
        """Complete the page with the finished map, and report where it is."""
        try:
            self.mending = open_mending(self._output, simap)
        except InputError as fault:  # edits of an earlier build: this one is there nevertheless
            self.faults.append(str(fault))
        recorded = self._record if self._record is not None and self._record.is_file() else None
        panels = [*filter(None, [self._progress]), *workbench.panels_of(simap, self.mending, workbench.maps_of())]
        self._opened.finish(simap if self.mending is None else self.mending.simap(), panels, recorded)
        if not self._ended:
            stream.finish()
        note(f"{self._output}: {workbench.all_counts(simap)}", *self.faults)
        return " ".join((f"Saved as {self._output}.", *self.faults))


@contextmanager
def live_workbench(
    sequence: FrameSource, request: BuildRequest, progress: StageProgress, *, port: int = 0
) -> Iterator[tuple[Workbench, LiveBuild]]:
    """Serve the page of a build that has not begun; begin with ``start`` of the build that this yields.

    Args:
        sequence: to build from.
        request: the build; its history is kept, asked for or not, where its method keeps a log.
        progress: in the terminal.
        port: where to serve the page; the next free one when it is taken, 0 for any.

    Raises:
        InputError: the port is taken, or rerun's viewer is missing.
    """
    logged = keeps_log(request.method)
    live = _LivePage(waiting_map(sequence, config_of(request.method, request.config)), request.output, request.record)

    def run(observers: Sequence[Observer], cancel: threading.Event, resume: bool) -> SIMap:
        """Build the map and save it; a recording that was lost is reported with it."""
        how = replace(request, resume=resume and logged, history=request.history or logged)
        try:
            return build_to_file(sequence, how, progress, observers=tuple(observers), cancel=cancel)
        except RecordingFault as fault:
            live.faults.append(str(fault))
            return fault.simap

    color: Any = getattr(sequence, "color", None)
    stream = LiveStream(color or (lambda index: None))
    stream.open(started(sequence), first_look(sequence, live.waiting))
    build = LiveBuild(run, len(sequence), live.audience(stream, STOPPED if logged else STARTS_AGAIN))
    start = start_pose(replace(live.waiting, T_map_camera=_cameras(sequence)))
    try:
        with live.serve(build, stream, port, start=start) as page:
            yield page, build
    finally:
        stream.close()


@contextmanager
def source_workbench(
    request: LiveRequest, *, port: int = 0, drive: bool = False
) -> Iterator[tuple[Workbench, LiveBuild, LiveRun]]:
    """Serve the page of a map that grows from a live source; like `live_workbench`, but stopping saves the map.

    Args:
        request: the run.
        port: as for `live_workbench`.
        drive: the page may let the robot drive.

    Raises:
        InputError: the port is taken, or rerun's viewer is missing.
    """
    source, run = request.source, LiveRun(request)
    live = _LivePage(_empty_map(run.growing.facts(), request.config, GridSpec(1, 1, CELL_M, 0.0, 0.0)), request.output)
    stream = LiveStream(lambda index: None)
    stream.open(run.started(), None)
    build = LiveBuild(lambda observers, cancel, resume: run.run(observers, cancel), 0, live.audience(stream, ""))
    driver = live.driver(source, allowed=drive) if isinstance(source, RobotSource) else None
    try:
        with live.serve(build, stream, port, start=None, words=run.words, driver=driver) as page:
            yield page, build, run
    finally:
        if driver is not None:
            driver.close()
        source.close()
        stream.close()


def watch_source(request: LiveRequest, *, port: int, browser: bool, drive: bool = False) -> None:
    """Let a map grow on its page until its source ends or Ctrl-C, which saves it; then show it until Ctrl-C."""
    with source_workbench(request, port=port, drive=drive) as (page, build, run):
        workbench.tell_where(page, browser=browser)
        build.start()
        _until_saved(build, run)
        page.wait()


def run_source(request: LiveRequest, *, tell: Callable[[str], None] = note) -> tuple[SIMap, LiveRun]:
    """Let a map grow until its source ends or Ctrl-C, and save it; ``tell`` gets a line on its state now and then.

    Raises:
        InputError: nothing came, or the map cannot be written.
    """
    run, found = LiveRun(request), []
    audience = Audience(show=lambda simap: None, watches=lambda: False, done=lambda simap: found.append(simap) or "")
    build = LiveBuild(lambda observers, cancel, resume: run.run(observers, cancel), 0, audience)
    build.start()
    try:
        _until_saved(build, run, tell)
    finally:
        request.source.close()
    return found[0], run


def _until_saved(build: LiveBuild, run: LiveRun, tell: Callable[[str], None] = note) -> None:
    """Report on a live run until its map is saved; Ctrl-C ends it early, a second one gives the map up.

    Raises:
        InputError: it has failed.
    """
    pause, said, next_s = threading.Event(), "", 0.0
    while (state := build.state()).status not in ("done", "failed", "stopped"):
        try:
            reports = state.status != "stopping" and time.monotonic() >= next_s
            if reports and (words := run.words()) != said:
                next_s, said = time.monotonic() + REPORT_S, words
                tell(words)
            pause.wait(0.1)
        except KeyboardInterrupt:
            if state.status == "stopping":
                raise
            tell("Saving the map …")
            build.stop()
    build.wait()
    if state.status == "failed":
        raise InputError(state.error)


def waiting_map(sequence: FrameSource, config: BuildConfig) -> SIMap:
    """Return a map on which nothing has been seen yet, of the floor around the cameras' path."""
    facts, size = facts_of(sequence), config.projection.cell_size_m
    at = _cameras(sequence)[:, :2, 3]
    low = np.floor((at.min(axis=0) - AROUND_M) / size)
    cells = np.ceil((at.max(axis=0) + AROUND_M) / size) - low
    rows, cols = (int(cells[1]), int(cells[0])) if cells.prod() <= MAX_CELLS else (1, 1)
    spec = GridSpec(rows, cols, cell_size_m=size, x0_m=float(low[0] * size), y0_m=float(low[1] * size))
    return _empty_map(facts, config, spec)


def _empty_map(facts: SequenceFacts, config: BuildConfig, spec: GridSpec) -> SIMap:
    nothing, zero = np.full(spec.shape, np.nan, np.float32), np.zeros(spec.shape, np.int32)
    grid = Grid(spec, facts.labels, facts.is_thing, zero.astype(np.int16), nothing, nothing.copy(), zero)
    origin = Origin(
        T_map_world=facts.T_map_world,
        method=config.method,
        parameters=config.parameters(),
        provenance={"sequence": facts.path, "name": facts.name, "segmentation": facts.segmentation_source,
                    "simulated": facts.simulated, "frames": 0},
        frame_names=(),
        T_map_camera=np.zeros((0, 4, 4)),
    )  # fmt: skip
    return assemble(grid, (), zero.copy(), empty_log(), empty_views(), origin)


def first_look(sequence: FrameSource, waiting: SIMap) -> FrameProjected | None:
    """Return the first frame, before it is mapped; None when it cannot be read."""
    try:
        frame, segmentation = sequence.read(0), sequence.segmentation(0)
    except InputError:
        return None  # the build reports it
    nothing = np.zeros((0, 4), np.int32)
    return FrameProjected(
        frame=frame,
        segmentation=segmentation,
        T_map_camera=np.asarray(sequence.T_map_world @ sequence.poses[0]),
        cells=nothing[:, :2],
        new_edges=nothing,
        new_edge_labels=np.zeros(0, np.int16),
        snapshot=lambda: waiting.grid,
    )


def _cameras(sequence: FrameSource) -> np.ndarray:
    """Return the cameras' poses in the map frame, float64 [frames, 4, 4]."""
    return np.asarray(sequence.T_map_world @ sequence.poses)


def _wait(build: LiveBuild) -> None:
    """Wait until the map is done, however often it is stopped and resumed on the page."""
    pause, before = threading.Event(), build.state()
    while (state := build.state()).status != "done":
        if state.status != before.status and state.status in ("stopped", "failed"):
            note(f"{state.status}: {state.error or state.notice}")
        before = state
        pause.wait(0.2)
