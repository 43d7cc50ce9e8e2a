"""Readings: what each frame saw on top of each cell; votes, evidence and views are made of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import Segment

if TYPE_CHECKING:
    from simaps_viz.mapping.steps import FrameSeen


@dataclass(frozen=True, eq=False)
class FrameReadings:
    """What one frame saw: for every cell, its highest pixel there. All arrays aligned."""

    rows: NDArray
    """int32 [n], counted from the map's origin."""
    cols: NDArray
    """int32 [n], counted from the map's origin."""
    segments: NDArray
    """int32 [n], id in the frame's segmentation, 0 = nothing."""
    height_m: NDArray
    """float32 [n], of that pixel over the floor."""


def no_readings() -> FrameReadings:
    """Return the readings of a frame that saw nothing."""
    nothing = np.zeros(0, np.int32)
    return FrameReadings(nothing, nothing, nothing, np.zeros(0, np.float32))


@dataclass(frozen=True, eq=False)
class FrameRuns:
    """At which heights one frame saw surface in its cells: runs of steps (`projection.STEPS_PER_M`). Arrays aligned."""

    reading: NDArray
    """int32 [m], ascending, the cell: its place in the frame's `FrameReadings`."""
    segments: NDArray
    """int32 [m], id in the frame's segmentation, 0 = nothing."""
    low: NDArray
    """int8 [m], first step; step k is from 0.05 k to 0.05 (k + 1) metres over the floor."""
    high: NDArray
    """int8 [m], last step."""


def no_runs() -> FrameRuns:
    """Return the runs of a frame that saw nothing, or of a log of an earlier version."""
    return FrameRuns(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0, np.int8), np.zeros(0, np.int8))


class AllReadings(Protocol):
    """The readings of all frames, as often as asked for; they need not fit into memory."""

    def batches(self) -> "Iterator[Readings]":
        """Return the readings in the order of the frames; no frame is in two batches."""
        ...


@dataclass(frozen=True, eq=False)
class Readings:
    """The readings of all frames, frame by frame. All arrays aligned."""

    cell: NDArray
    """int32 [v], flat cell of the grid."""
    frame: NDArray
    """int32 [v], ascending."""
    segment: NDArray
    """int32 [v], 0 = nothing."""
    label: NDArray
    """int16 [v], class of the segment, 0 = nothing."""
    score: NDArray
    """float32 [v], confidence of the segment; 0 for nothing."""
    height_m: NDArray
    """float32 [v]."""

    def __len__(self) -> int:
        return len(self.cell)

    def batches(self) -> "Iterator[Readings]":
        """Return all of them at once."""
        yield self

    def where(self, kept: NDArray) -> "Readings":
        """Return the readings that a mask, bool [v], or places among them, int, select."""
        return Readings(
            self.cell[kept],
            self.frame[kept],
            self.segment[kept],
            self.label[kept],
            self.score[kept],
            self.height_m[kept],
        )


def gather_readings(
    frames: Sequence[FrameReadings],
    segments: Sequence[tuple[Segment, ...]],
    origin_cell: tuple[int, int],
    labels: Sequence[str],
    cols: int,
    *,
    first: int = 0,
) -> Readings:
    """Join the readings of all frames on the finished grid.

    Args:
        frames: one for each frame, in order.
        segments: the segments of each frame.
        origin_cell: (row, col), counted from the map's origin, of the grid's cell (0, 0).
        labels: of the grid, index 0 is "none".
        cols: of the finished grid, which must hold all cells.
        first: number of the first of these frames.
    """
    row0, col0 = origin_cell
    index_of = {name: i for i, name in enumerate(labels)}
    joined: dict[str, list[NDArray]] = {"cell": [], "frame": [], "segment": [], "label": [], "score": [], "height": []}
    for i, (seen, known) in enumerate(zip(frames, segments, strict=True)):
        highest = max((s.id for s in known), default=0)
        label_of, score_of = np.zeros(highest + 1, np.int16), np.zeros(highest + 1, np.float32)
        for s in known:
            label_of[s.id], score_of[s.id] = index_of[s.label], s.score
        joined["cell"].append((seen.rows - row0) * cols + (seen.cols - col0))
        joined["frame"].append(np.full(len(seen.rows), first + i, dtype=np.int32))
        joined["segment"].append(seen.segments)
        joined["label"].append(label_of[seen.segments])
        joined["score"].append(score_of[seen.segments])
        joined["height"].append(seen.height_m)
    types = (np.int32, np.int32, np.int32, np.int16, np.float32, np.float32)
    arrays = [
        np.concatenate([np.zeros(0, dtype), *parts]).astype(dtype, copy=False)
        for dtype, parts in zip(types, joined.values(), strict=True)
    ]
    return Readings(*arrays)


BATCH = 1 << 21
"""Readings in one batch, 22 bytes each and as much again while they are joined."""


@dataclass(frozen=True, eq=False)
class StreamedReadings:
    """The readings of frames that lie on disk, read anew each time they are asked for."""

    frames: Sequence["FrameSeen"]
    """In order."""
    origin_cell: tuple[int, int]
    """(row, col), counted from the map's origin, of the grid's cell (0, 0)."""
    labels: Sequence[str]
    """Of the grid. Not the grid itself: its layers would stay in memory."""
    cols: int
    """Of the finished grid."""

    def batches(self) -> Iterator[Readings]:
        """Return them some frames at a time."""
        waiting: list[FrameSeen] = []
        first = size = 0
        for frame in self.frames:
            waiting.append(frame)
            size += len(frame.readings.rows)
            if size >= BATCH:
                yield self._joined(waiting, first)
                first, size, waiting = first + len(waiting), 0, []
        if waiting or not first:
            yield self._joined(waiting, first)

    def _joined(self, frames: list["FrameSeen"], first: int) -> Readings:
        readings, segments = [frame.readings for frame in frames], [frame.segments for frame in frames]
        return gather_readings(readings, segments, self.origin_cell, self.labels, self.cols, first=first)
