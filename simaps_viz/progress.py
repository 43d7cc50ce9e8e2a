"""Progress on the terminal (stderr), or as JSON lines on stdout for programs."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
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

from simaps_viz.events import BuildFinished, BuildStarted, CommunitiesFound, Event, FrameProjected

console = Console(stderr=True, highlight=False)


def emit(record: dict[str, Any]) -> None:
    """Write one JSON line on stdout."""
    sys.stdout.write(json.dumps(record) + "\n")
    sys.stdout.flush()


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        digits = 0 if task.speed and task.speed >= 10.0 else 1
        return Text(f"{task.speed:.{digits}f}/s" if task.speed else "", style="progress.data.speed")


class StageProgress:
    """One bar at a time: a stage, how far it is, how fast, and how long it will take."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._task: TaskID | None = None
        self._stage = ""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` steps of a stage are done; a new stage starts a new bar."""
        if self._task is None or stage != self._stage:
            self._task = self._progress.add_task(stage, total=total)
            self._stage = stage
        self._progress.update(self._task, completed=done, total=total)


@contextmanager
def stage_progress(*, quiet: bool = False) -> Iterator[StageProgress]:
    """Show bars on stderr while the block runs."""
    text = TextColumn("{task.description:<34}")
    columns = (text, BarColumn(24), MofNCompleteColumn(), _Rate(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=quiet) as progress:
        yield StageProgress(progress)


class BuildProgress:
    """Watches a build and shows how far it is."""

    wants_color = False

    def __init__(self, progress: StageProgress, *, json_lines: bool = False) -> None:
        self._progress, self._json, self._total = progress, json_lines, 0

    def on_event(self, event: Event) -> None:
        """Take one event of the build."""
        if isinstance(event, BuildStarted):
            self._total = len(event.frame_names)
            self._tell({"event": "started", "name": event.name, "frames": self._total})
        elif isinstance(event, FrameProjected):
            self._progress("mapping frames", event.frame.index + 1, self._total)
            self._tell({"event": "frame", "frame": event.frame.name, "done": event.frame.index + 1,
                        "total": self._total})  # fmt: skip
        elif isinstance(event, CommunitiesFound) and event.final:
            self._progress("finding instances", 0, 1)
        elif isinstance(event, BuildFinished):
            self._progress("finding instances", 1, 1)

    def _tell(self, record: dict[str, Any]) -> None:
        if self._json:
            emit(record)
