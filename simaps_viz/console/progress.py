"""Progress on the terminal (stderr), or as JSON lines on stdout for programs."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)  # fmt: skip
from rich.text import Text

from simaps_viz.console.logs import log_stages, logger
from simaps_viz.console.terminal import console, emit, note
from simaps_viz.events import (
    BuildFinished,
    BuildStarted,
    CommunitiesFound,
    Event,
    FrameGathered,
    FrameProjected,
    FrameSkipped,
    MergesFound,
)  # fmt: skip


class StageClock:
    """Measures one stage after another; a stage that begins again adds to its time."""

    def __init__(self, now: Callable[[], float] = time.perf_counter) -> None:
        """Take the clock, in seconds."""
        self._now = now
        self._spent: dict[str, float] = {}
        self._current: str | None = None
        self._since = 0.0

    def begin(self, stage: str) -> None:
        """End the current stage, if any, and begin another; does nothing if it is the current one."""
        if stage == self._current:
            return
        self.end()
        self._current, self._since = stage, self._now()
        self._spent.setdefault(stage, 0.0)

    def end(self) -> None:
        """End the current stage, if any."""
        if self._current is not None:
            self._spent[self._current] += self._now() - self._since
            self._current = None

    def seconds(self) -> dict[str, float]:
        """Return {stage: seconds} in the order they began; the current one counts up to now."""
        spent = dict(self._spent)
        if self._current is not None:
            spent[self._current] += self._now() - self._since
        return {stage: round(value, 4) for stage, value in spent.items()}


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        digits = 0 if task.speed and task.speed >= 10.0 else 1
        return Text(f"{task.speed:.{digits}f}/s" if task.speed else "", style="progress.data.speed")


class StageProgress:
    """Shows one bar at a time: a stage, its progress, its rate, and the time left."""

    def __init__(self, progress: Progress) -> None:
        self.clock = StageClock()
        """Measures the stages; `BuildProgress` adds finer ones."""
        self._progress = progress
        self._task: TaskID | None = None
        self._stage = ""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` steps of a stage are done; a new stage starts a new bar."""
        if self._task is None or stage != self._stage:
            self.clock.begin(stage)
            self._task = self._progress.add_task(stage, total=total)
            self._stage = stage
        self._progress.update(self._task, completed=done, total=total)


@contextmanager
def stage_progress(*, quiet: bool = False) -> Iterator[StageProgress]:
    """Show bars on stderr while the block runs."""
    text = TextColumn("{task.description:<34}")
    columns = (text, BarColumn(24), MofNCompleteColumn(), _Rate(), TimeRemainingColumn())
    stages = None
    try:
        with Progress(*columns, console=console, disable=quiet) as progress:
            stages = StageProgress(progress)
            yield stages
    finally:
        if stages is not None:
            stages.clock.end()
            log_stages(stages.clock.seconds())


class BuildProgress:
    """Observes a build and shows its progress."""

    wants_color = False

    def __init__(self, progress: StageProgress, *, json_lines: bool = False) -> None:
        self._progress, self._json, self._total = progress, json_lines, 0

    def on_event(self, event: Event) -> None:
        """Take one event of the build."""
        if isinstance(event, BuildStarted):
            self._total = len(event.frame_names)
            self._emit({"event": "started", "name": event.name, "frames": self._total})
        elif isinstance(event, FrameProjected):
            self._mapped(event.frame.index, event.frame.name)
        elif isinstance(event, FrameGathered):
            self._mapped(event.index, event.name)
        elif isinstance(event, FrameSkipped):
            logger.warning("skipped frame %s: %s", event.name, event.reason,
                           extra={"event": "skipped", "frame": event.name, "people": False})  # fmt: skip
            self._emit({"event": "skipped", "frame": event.name, "reason": event.reason})
            if not self._json:
                note(f"skipped frame {event.name}: {event.reason}")
        elif isinstance(event, CommunitiesFound) and event.final:
            self._progress("finding instances", 0, 1)
            self._progress.clock.begin("joining communities")
        elif isinstance(event, MergesFound):
            self._progress.clock.begin("describing instances")
        elif isinstance(event, BuildFinished):
            self._progress("finding instances", 1, 1)

    def _mapped(self, index: int, name: str) -> None:
        done = index + 1
        self._progress("mapping frames", done, self._total)
        self._emit({"event": "frame", "frame": name, "done": done, "total": self._total})
        if done == self._total:
            self._progress.clock.begin("finding communities")

    def _emit(self, record: dict[str, Any]) -> None:
        if self._json:
            emit(record)
