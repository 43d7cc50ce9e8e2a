"""Frames as lists of columns of surface: what a camera would have seen of a place, without a camera."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.mapping.finalize import SequenceFacts, empty_accumulator, map_so_far
from simaps_viz.mapping.observations import FrameReadings, FrameRuns
from simaps_viz.mapping.steps import FrameSeen, FrameStep
from simaps_viz.structures import Segment, SIMap

LABELS = ("none", "chair", "table", "book", "floor")
IS_THING = (False, True, True, True, False)
FACTS = SequenceFacts("columns", "nowhere", LABELS, IS_THING, "drawn", True, np.eye(4))

Column = tuple[int, int, int, int, int]
"""Row, column, segment, first and last step of 5 cm."""


def block(rows: range, cols: range, segment: int, low: int, high: int) -> list[Column]:
    """Return the columns of a rectangle of cells."""
    return [(r, c, segment, low, high) for r in rows for c in cols]


def frame(index: int, columns: list[Column], labels: dict[int, str]) -> FrameStep:
    """Return the step of a frame that saw these columns; ``labels`` names its segments."""
    seen: dict[tuple[int, int], list[Column]] = {}
    for one in columns:
        seen.setdefault(one[:2], []).append(one)
    cells = sorted(seen)
    tops = [max(seen[cell], key=lambda one: one[4]) for cell in cells]
    runs = [(i, *one[2:]) for i, cell in enumerate(cells) for one in seen[cell]]
    at, segment, low, high = (np.array(part) for part in zip(*runs, strict=True))
    readings = FrameReadings(
        np.array([r for r, _ in cells], np.int32), np.array([c for _, c in cells], np.int32),
        np.array([top[2] for top in tops], np.int32), np.array([0.05 * top[4] + 0.03 for top in tops], np.float32),
    )  # fmt: skip
    segments = tuple(Segment(i, name, 0.9, name != "floor") for i, name in sorted(labels.items()))
    seen_runs = FrameRuns(at.astype(np.int32), segment.astype(np.int32), low.astype(np.int8), high.astype(np.int8))
    look = FrameSeen(index, f"{index}", np.eye(4), readings, segments, runs=seen_runs)
    return FrameStep(look, np.zeros(len(cells), bool), np.zeros(0, np.float32))


def map_of_columns(steps: list[FrameStep], config: BuildConfig | None = None) -> SIMap:
    """Return the map that a build makes of these frames."""
    config = config or BuildConfig()
    accumulator = empty_accumulator(FACTS, config)
    for step in steps:
        accumulator.replay(step)
    return map_so_far(accumulator, FACTS, config)


def table_over_chairs(*, joined: int = 0) -> list[FrameStep]:
    """Return 24 frames of a table with a chair under it, and another half under it; simulated.

    The table's top is at step 14 over rows 0 to 15, columns 0 to 15. Chair 1 (rows 2 to 5, columns 2 to 5) is under it
    completely, chair 2 (rows 2 to 5, columns 9 to 20) has its back outside. Every third frame sees the table from
    above; the others see the chairs from below, the first ``joined`` of them as one segment.
    """
    table = block(range(16), range(16), 1, 14, 14)
    floor = block(range(-4, 20), range(-4, 26), 4, 0, 0)
    steps = []
    for index in range(24):
        if index % 3 == 0:
            steps.append(frame(index, table + [one for one in floor if not (0 <= one[0] < 16 and 0 <= one[1] < 16)],
                               {1: "table", 4: "floor"}))  # fmt: skip
            continue
        second = 2 if index < joined else 3
        chairs = block(range(2, 6), range(2, 6), 2, 8, 9) + block(range(2, 6), range(9, 16), second, 8, 9)
        chairs += block(range(2, 6), range(16, 21), second, 8, 17)
        steps.append(frame(index, floor + chairs, {4: "floor"} | dict.fromkeys({2, second}, "chair")))
    return steps


def turned(steps: list[FrameStep]) -> list[FrameStep]:
    """Return the same frames with segments 2 and 3 numbered the other way round in every second one."""
    swap: NDArray = np.array([0, 1, 3, 2, 4], np.int32)
    result = []
    for step in steps:
        if step.seen.index % 2:
            look, readings, runs = step.seen, step.seen.readings, step.seen.runs
            segments = tuple(sorted((replace(s, id=int(swap[s.id])) for s in look.segments), key=lambda s: s.id))
            look = replace(
                look, segments=segments, readings=replace(readings, segments=swap[readings.segments]),
                runs=replace(runs, segments=swap[runs.segments]),
            )  # fmt: skip
            step = replace(step, seen=look)  # noqa: PLW2901
        result.append(step)
    return result
