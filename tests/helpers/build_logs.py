"""Logs of builds, read and kept whole as tests want them."""

from pathlib import Path
from typing import Any

from simaps_viz.build.build_log import BuildLog
from simaps_viz.mapping.steps import StepReader


def read_log(path: Path) -> tuple[dict[str, Any], list[tuple[int, bytes]]]:
    """What is built, and (kind, content) of every frame."""
    reader = StepReader(path)
    return reader.facts, [reader.read(number) for number in range(len(reader))]


def keep_log(log: Path, steps: Path) -> None:
    """Make a log that nobody writes the history of a map."""
    with BuildLog(log, StepReader(log).facts, resume=True) as found:
        found.keep(steps)
