"""The steps of a finished build: the first ones in memory, all others read from their file when asked for."""

from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from simaps_viz.limits import MAX_HISTORY_BYTES, check_cells
from simaps_viz.mapping.frame_list import FrameList
from simaps_viz.mapping.log_records import LogReader, decode_step
from simaps_viz.mapping.steps import FrameSeen, FrameStep

HELD_BYTES = 128 << 20
"""Memory for the steps that are held; those of ordinary builds all fit into it."""
_ALWAYS_CELLS = 1 << 24  # 205 m x 205 m with cells of 0.05 m
_CELLS_A_READING = 1000  # a larger map is one that was looked at


class KeptSteps(Sequence[FrameStep]):
    """The steps of one build, one a frame, in order. Several threads may read them."""

    def __init__(self, path: Path) -> None:
        """Look through a history's file.

        Raises:
            InputError: it is missing or something else.
            ValueError, KeyError, TypeError, struct.error: these are not the steps of one build of at least one frame,
                in order, of a map not too large.
        """
        self._reader = LogReader(path)
        self.known: dict[str, Any] = self._reader.known
        """What was built."""
        self.names: list[str] = []
        """Of the frames."""
        self.readings = array("q")
        """How many each frame has."""
        self._poses, self._held = array("d"), list[FrameStep]()
        self._look_through()

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, at: int) -> FrameStep: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[FrameStep]: ...
    def __getitem__(self, at: int | slice) -> FrameStep | Sequence[FrameStep]:
        if isinstance(at, slice):
            return [self[i] for i in range(len(self))[at]]
        at = range(len(self))[at]
        return self._held[at] if at < len(self._held) else decode_step(self._reader.read(at))

    @property
    def poses(self) -> NDArray:
        """float64 [n, 4, 4], T_map_camera. A copy."""
        return np.array(self._poses, dtype=np.float64).reshape(-1, 4, 4)

    @property
    def all_held(self) -> bool:
        """Nothing is read from the file any more."""
        return len(self._held) == len(self)

    def _look_through(self) -> None:
        """Check every step, which bounds the memory that a damaged or hostile file can make a reader ask for."""
        size, held = 0, True
        extent = np.array([[1 << 62, -(1 << 62)]] * 2, dtype=np.int64)  # lowest and highest row, and column
        for number in range(len(self._reader)):
            step = decode_step(self._reader.read(number))
            seen = step.seen
            if seen.index != number:
                raise ValueError("frames are missing")
            size += _bytes_of(step)
            if size > MAX_HISTORY_BYTES:
                raise ValueError(f"more than {MAX_HISTORY_BYTES} bytes of readings")
            held = held and size <= HELD_BYTES
            if held:
                self._held.append(step)
            for low_high, cells in zip(extent, (seen.readings.rows, seen.readings.cols), strict=True):
                if len(cells):
                    low_high[:] = min(low_high[0], cells.min()), max(low_high[1], cells.max())
            self.names.append(seen.name)
            self._poses.extend(seen.T_map_camera.reshape(-1).tolist())
            self.readings.append(len(seen.readings.rows))
        if not self.names:
            raise ValueError("frames are missing")
        self._check_extent(extent)

    def _check_extent(self, extent: NDArray) -> None:
        readings = sum(self.readings)
        rows, cols = (extent[:, 1] - extent[:, 0] + 1).tolist() if readings else (1, 1)
        check_cells("history", rows, cols)
        if rows * cols > max(_ALWAYS_CELLS, _CELLS_A_READING * readings):
            raise ValueError("a map larger than its readings make")


class KeptFrames(FrameList):
    """The first frames of a history, which has them: nothing is held here."""

    def __init__(self, steps: KeptSteps) -> None:
        """Start empty."""
        super().__init__()
        self._steps = steps

    @overload
    def __getitem__(self, at: int) -> FrameSeen: ...
    @overload
    def __getitem__(self, at: slice) -> list[FrameSeen]: ...
    def __getitem__(self, at: int | slice) -> FrameSeen | list[FrameSeen]:
        if isinstance(at, slice):
            return [self[i] for i in range(len(self))[at]]
        return self._steps[range(len(self))[at]].seen

    @property
    def all_held(self) -> bool:
        """Nothing lies on disk."""
        return self._steps.all_held

    def copy(self) -> "KeptFrames":
        """Give one that goes its own way from here."""
        twin = KeptFrames(self._steps)
        for name in ("indices", "_poses", "_offset", "_length", "_file"):
            setattr(twin, name, getattr(self, name)[:])
        twin.names, twin.skipped = list(self.names), dict(self.skipped)
        return twin

    def _hold(self, frame: FrameSeen) -> None:
        """Its history has it."""


def _bytes_of(step: FrameStep) -> int:
    readings = step.seen.readings
    return sum(part.nbytes for part in (readings.rows, readings.cols, readings.segments, readings.height_m))
