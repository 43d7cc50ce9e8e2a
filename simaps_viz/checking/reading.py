"""One way to read a sequence: what its files say, and what to make of it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.conventions import Convention
from simaps_viz.checking.recording import Recording


@dataclass(frozen=True, eq=False)
class Reading:
    """A hypothesis about a sequence; the default one takes the files at their word."""

    convention: Convention = field(default_factory=Convention)
    depth_factor: float = 1.0
    """On the depth unit."""
    position_factor: float = 1.0
    """On the written positions."""
    shift: int = 0
    """Frame i has the pose written for frame i + shift ..."""
    shift_later: int | None = None
    """... or, from ``shift_from`` on, that written for frame i + shift_later."""
    shift_from: int = 0
    left_out: tuple[int, ...] = ()
    """Frames to leave out."""
    camera: NDArray | None = None
    """float64 [4], fx, fy, cx, cy in place of those stated."""

    def shifts(self, count: int) -> NDArray:
        """Give for each frame how far away its pose is written, int64 [n]."""
        shifts = np.full(count, self.shift, np.int64)
        if self.shift_later is not None:
            shifts[self.shift_from :] = self.shift_later
        return shifts

    def posed(self, count: int) -> NDArray:
        """Tell which frames have a pose, bool [n]: a shift leaves some at an end without."""
        row = np.arange(count) + self.shifts(count)
        posed = (row >= 0) & (row < count)
        posed[list(self.left_out)] = False
        return posed

    def poses(self, recording: Recording) -> NDArray:
        """Give T_world_camera, float64 [n, 4, 4]; NaN for frames that have none."""
        count = len(recording)
        row = np.arange(count) + self.shifts(count)
        poses = self.convention.apply(recording.matrices)[np.clip(row, 0, count - 1)]
        poses[:, :3, 3] *= self.position_factor
        poses[~self.posed(count)] = np.nan
        return poses

    def camera_of(self, recording: Recording) -> NDArray:
        """Give fx, fy, cx, cy, float64 [4]."""
        return recording.camera if self.camera is None else self.camera

    def unit_m(self, recording: Recording) -> float:
        """Give metres a step of depth."""
        return recording.unit_m * self.depth_factor
