"""A recorded sequence as a live source: its frames come at their own times, as if it were being recorded now."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.live.source import Correction, Shot
from simaps_viz.segmentation.protocol import Network

RATE_HZ = 30.0
"""Of sequences whose frames have no time of their own."""
STEPS_S = (1e-3, 10.0)
"""The median time between two frames lies in this range, or their names are no times."""
LATE_S = 0.25
"""A frame that comes later than this comes without its masks: reading and counting them costs most."""


def times_of(names: tuple[str, ...]) -> NDArray:
    """Return the times of frames, float64 [n], seconds from the first: from their names, or else at `RATE_HZ`."""
    try:
        times = np.array([float(name) for name in names])
    except ValueError:
        times = np.zeros(0)
    steps = np.diff(times)
    if len(steps) and (steps > 0).all() and STEPS_S[0] <= np.median(steps) < STEPS_S[1] and "." in names[0]:
        return times - times[0]
    return np.arange(len(names)) / RATE_HZ


class PlayedSequence:
    """The frames of a sequence as they come. Frames that cannot be read are left out and counted."""

    def __init__(self, sequence: FrameSource, *, at_pace: bool = True, network: Network | None = None) -> None:
        """Begin with the first ``take``.

        Args:
            sequence: with masks of its own, unless a network makes them.
            at_pace: frames come at their own times; otherwise each as soon as it is asked for, and none is late.
            network: the masks come from it, so frames have colour and no masks.
        """
        self.sequence = sequence
        self.name, self.simulated = sequence.name, sequence.simulated
        self.labels, self.is_thing = (("none",), (False,)) if network else (sequence.labels, sequence.is_thing)
        self.segmentation_source = network.name if network else sequence.segmentation_source
        self.T_map_world: NDArray | None = sequence.T_map_world
        self.unreadable = 0
        self._times = times_of(sequence.frame_names)
        self._at_pace, self._masked = at_pace, network is None
        self._next, self._began_s, self._closed = 0, 0.0, False

    @property
    def ended(self) -> bool:
        """The last frame has come."""
        return self._closed or self._next >= len(self.sequence)

    def take(self, timeout_s: float) -> Shot | None:
        """Return the next frame when it is due."""
        if self.ended:
            return None
        if not self._next:
            self._began_s = time.monotonic()
        index, now_s = self._next, time.monotonic()
        due_s = self._began_s + float(self._times[index]) if self._at_pace else now_s
        if due_s > now_s + timeout_s:
            time.sleep(timeout_s)
            return None
        time.sleep(max(due_s - now_s, 0.0))
        self._next += 1
        late = self._at_pace and time.monotonic() - due_s > LATE_S
        try:
            frame = self.sequence.read(index, color=not self._masked)
            segmentation = self.sequence.segmentation(index) if self._masked and not late else None
        except InputError:
            self.unreadable += 1
            return None
        sent_ns = time.time_ns() - int((time.monotonic() - due_s) * 1e9)
        return Shot(frame, segmentation, int(self._times[index] * 1e9), sent_ns)

    def color(self, index: int) -> Any:
        """Read a frame's colour image, uint8 [H, W, 3]."""
        return self.sequence.read(index, color=True).color

    def correction(self) -> Correction | None:
        """Return None: a recording does not change."""
        return None

    def words(self) -> str:
        """Describe how far it is."""
        lost = f", {self.unreadable} could not be read" if self.unreadable else ""
        return f"frame {self._next} of {len(self.sequence)}{lost}"

    def close(self) -> None:
        """Stop."""
        self._closed = True
