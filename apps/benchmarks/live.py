"""What it costs to watch a map while it is built, in a browser on the same machine, without a graphics card."""

import contextlib
import os
import subprocess
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

from benchmarks.page import ARGUMENTS, CHROMIUM, HEIGHT, WIDTH

from simaps_viz.app import live
from simaps_viz.app.live import Audience, LiveBuild, Run, live_workbench
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.build.to_file import BuildRequest, build_to_file
from simaps_viz.console.progress import StageProgress
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import Event, FrameProjected, Observer
from simaps_viz.recorder.recorder import LiveStream
from simaps_viz.structures import SIMap
from simaps_viz.viewer.workbench import Workbench

PATIENCE_S = 60.0
SETTLED_S = 6.0
"""After rerun has opened the stream: until the page has painted all there is and rests."""


@dataclass(frozen=True)
class Cost:
    """What one build cost, from its start to the saved map."""

    seconds: float
    busy_s: float
    """Processor time of this program."""
    browser_s: float = 0.0
    """Processor time of the browser."""
    maps: int = 0
    """Times the page got a map while frames came."""
    frames: int = 0
    """Frames that the docked recording got meanwhile."""
    sketches: int = 0
    """Small pictures of what was seen so far."""
    told: int = 0
    """Events that the docked recording told of: times its cursor moved on, mostly."""
    complete: bool = False
    """In the end the page shows the finished map."""

    def __str__(self) -> str:
        """Return the two times as one line."""
        return f"{self.seconds:6.2f} s, {self.busy_s:5.2f} s busy"


class MeasuredBuild(LiveBuild):
    """A build that counts what was shown while frames came, and measures the time until its map was saved."""

    def __init__(self, run: Run, frames: int, audience: Audience) -> None:
        self.maps_shown = self.frames_shown = self.sketches = 0
        self.saved_s: float | None = None
        """From the start to the saved map."""
        self.busy_s = 0.0
        """Processor time of the whole program in that time."""
        stream = None if audience.stream is None else _CountedStream(audience.stream, self)
        super().__init__(
            self._measured(run),
            frames,
            replace(audience, show=self._show_counted(audience), sketch=self._sketch_counted(audience), stream=stream),
        )

    def _measured(self, run: Run) -> Run:
        def measured(observers: Sequence[Observer], cancel: threading.Event, resume: bool) -> SIMap:
            start, busy = time.perf_counter(), time.process_time()
            simap = run(observers, cancel, resume)
            self.busy_s = time.process_time() - busy
            self.saved_s = time.perf_counter() - start
            return simap

        return measured

    def _show_counted(self, audience: Audience) -> Callable[[SIMap], None]:
        def show(simap: SIMap) -> None:
            self.maps_shown += 1
            audience.show(simap)

        return show

    def _sketch_counted(self, audience: Audience) -> Callable[[FrameProjected], bytes]:
        def sketch(event: FrameProjected) -> bytes:
            self.sketches += 1
            return audience.sketch(event)

        return sketch


class _CountedStream:
    def __init__(self, stream: LiveStream, build: MeasuredBuild) -> None:
        self._stream, self._build = stream, build

    def on_event(self, event: Event) -> None:
        self._stream.on_event(event)

    def show(self, event: FrameProjected, simap: SIMap | None) -> None:
        self._build.frames_shown += 1
        self._stream.show(event, simap)


def plain_build(sequence: FrameSource, folder: Path, progress: StageProgress) -> Cost:
    """Build with nobody looking, and no browser."""
    start, busy = time.perf_counter(), time.process_time()
    build_to_file(sequence, BuildRequest("evidence", BuildConfig(), folder / "plain.npz", history=True), progress)
    return Cost(time.perf_counter() - start, time.process_time() - busy)


def watched_build(sequence: FrameSource, folder: Path, progress: StageProgress) -> Cost:
    """Build with a page open, which rests when the build begins; nothing but the person's browser looks at it.

    (A browser that a test drives has each message of its page copied to its driver, which costs as much again.)

    Raises:
        InputError: Chromium is missing, or its page does not open.
    """
    request = BuildRequest("evidence", BuildConfig(), folder / "watched.npz", history=True)
    with (
        patch.object(live, "LiveBuild", MeasuredBuild),
        live_workbench(sequence, request, progress) as (page, build),
        _browser(page.url) as process,
    ):
        assert isinstance(build, MeasuredBuild)
        told = _wait_for_page(page)
        told.clear()
        before = browser_busy_s(process.pid)
        build.start()
        while build.saved_s is None and not build.wait(0.01):
            pass
        browser_s = browser_busy_s(process.pid) - before
        found = sum(told.values())
        if build.saved_s is None:
            raise InputError(f"the build that was watched: expected a map, found: {build.state().error}")
        cost = Cost(build.saved_s, build.busy_s, browser_s, build.maps_shown, build.frames_shown, build.sketches, found)
        return replace(cost, complete=_complete(page, build, len(sequence)))


def browser_busy_s(pid: int) -> float:
    """Return the processor time, seconds, of a process and its descendants so far; 0 where /proc does not tell."""
    children: dict[int, list[int]] = {}
    busy: dict[int, float] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            one = int(stat.parent.name)
            children.setdefault(int(fields[1]), []).append(one)
            busy[one] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    total, todo = 0.0, [pid]
    while todo:
        one = todo.pop()
        total += busy.get(one, 0.0)
        todo += children.get(one, [])
    return total


@contextlib.contextmanager
def _browser(url: str) -> Iterator["subprocess.Popen[bytes]"]:
    if not CHROMIUM.is_file():
        raise InputError(f"{CHROMIUM}: expected Chromium there, found none")
    with tempfile.TemporaryDirectory(prefix="simaps-chromium-", ignore_cleanup_errors=True) as home:
        command = [str(CHROMIUM), "--headless", *ARGUMENTS, "--no-first-run", "--remote-debugging-port=0"]
        command += [f"--user-data-dir={home}", f"--window-size={WIDTH},{HEIGHT}", f"{url}/?fixedDpr=1"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield process
        finally:
            process.terminate()
            process.wait()


def _wait_for_page(page: Workbench) -> Counter[str]:
    """Wait until the page rests and its docked recording is open; returns what the recording tells from now on."""
    told: Counter[str] = Counter()
    host = page.recording_host
    assert host is not None
    tell = host.on_event

    def count(event: dict, session: str) -> dict | None:
        told[str(event.get("type"))] += 1
        return tell(event, session)

    host.on_event = count
    end = time.monotonic() + PATIENCE_S
    while not (page.sessions and told["recording_open"]):
        if time.monotonic() > end:
            raise InputError("the page: expected it and its recording to open within a minute, found that they did not")
        time.sleep(0.1)
    time.sleep(SETTLED_S)
    return told


def _complete(page: Workbench, build: LiveBuild, frames: int) -> bool:
    """Return whether the page ends with the whole map and its panels."""
    build.wait(PATIENCE_S)
    page.wait_idle(PATIENCE_S)
    session = page.sessions[0]
    return build.state().status == "done" and len(session.simap.frame_names) == frames and not session.services.building
