"""What a live map is made of: pictures with their time and pose, one after the other, until nothing comes any more."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import Frame, Segmentation

DELAYS = 150
"""Shots over which delays and clocks are judged: five seconds at 30 Hz."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One depth picture with everything of its time."""

    frame: Frame
    """Its index means nothing yet; colour only where it is at hand."""
    segmentation: Segmentation | None
    """None: none has come in time, so that the picture shows only what is free and what is not."""
    stamp_ns: int
    """When it was taken, by the clock of its camera."""
    sent_ns: int = 0
    """When it was sent, by the sender's clock; 0 = not known."""
    T_odom_camera: NDArray | None = None
    """float64 [4, 4], the pose in a frame that never jumps; None where there is no such frame."""
    epoch: int = 0
    """Of that frame: it begins anew when the robot does."""


PosesAgain = Callable[[NDArray], NDArray]
"""(stamps, int64 [n], ns) -> T_world_odom, float64 [n, 4, 4], as it is known now."""


@dataclass(frozen=True, eq=False)
class Correction:
    """The robot has learnt that it is, and was, somewhere else: its frames have to be placed again."""

    since_ns: int
    """Frames of this time or later are concerned,"""
    epoch: int
    """and of this epoch."""
    T_world_odom: PosesAgain


class Source(Protocol):
    """Where frames come from. ``take`` is called by one thread, all else by any."""

    @property
    def name(self) -> str:
        """Address or name, for the map and for people."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """Class names known beforehand, index 0 is "none"; more may come with the frames."""
        ...

    @property
    def is_thing(self) -> tuple[bool, ...]:
        """Aligned with ``labels``."""
        ...

    @property
    def segmentation_source(self) -> str:
        """In words."""
        ...

    @property
    def simulated(self) -> bool:
        """Frames or masks are simulated."""
        ...

    @property
    def T_map_world(self) -> NDArray | None:
        """float64 [4, 4], world to map frame; None: z is up, and the floor has to be found."""
        ...

    @property
    def ended(self) -> bool:
        """Nothing more will come."""
        ...

    def take(self, timeout_s: float) -> Shot | None:
        """Return the next shot; None where none has come in that time, or it is of no use."""
        ...

    def correction(self) -> Correction | None:
        """Return what has been corrected since the last call; None = nothing."""
        ...

    def words(self) -> str:
        """Describe the state of the connection in a few words; "" where there is none."""
        ...

    def close(self) -> None:
        """Stop; ``take`` returns at once from now on."""
        ...


@dataclass
class Traffic:
    """Counts of what came: rate, delay, and the offset between the sender's clock and ours."""

    placed: int = 0
    """Shots on the map."""
    named: int = 0
    """Those of them with masks."""
    dropped: dict[str, int] = field(default_factory=dict)
    """{reason in words: how many}."""
    _arrived_s: deque[float] = field(default_factory=lambda: deque(maxlen=DELAYS))
    _delay_s: deque[float] = field(default_factory=lambda: deque(maxlen=DELAYS))

    def drop(self, why: str) -> None:
        """Count something that was left out."""
        self.dropped[why] = self.dropped.get(why, 0) + 1

    def place(self, shot: Shot) -> None:
        """Count a shot that is on the map now."""
        self.placed += 1
        self.named += shot.segmentation is not None
        self._arrived_s.append(time.monotonic())
        if shot.sent_ns:
            self._delay_s.append((time.time_ns() - shot.sent_ns) / 1e9)

    @property
    def rate(self) -> float:
        """Shots a second, over the last ones; 0 when none has come for two seconds."""
        times = list(self._arrived_s)
        if len(times) < 2 or time.monotonic() - times[-1] > 2.0:
            return 0.0
        return (len(times) - 1) / max(times[-1] - times[0], 1e-3)

    @property
    def delay_s(self) -> float | None:
        """Median from sending to the map, seconds, by both clocks; negative where theirs is ahead; None = not known."""
        return float(np.median(list(self._delay_s))) if self._delay_s else None

    def words(self) -> str:
        """Describe it: "29 frames/s · 12 ms behind · 3 dropped (no pose)"."""
        parts = [f"{self.rate:.0f} frames/s"] if self.placed else []
        if (delay_s := self.delay_s) is not None:
            # Beyond a few seconds it is no delay: the clocks differ.
            if abs(delay_s) > 5.0 or delay_s < -0.05:
                parts.append(f"the sender's clock is {abs(delay_s):.1f} s {'behind' if delay_s > 0 else 'ahead'}")
            else:
                parts.append(f"{max(delay_s, 0.0) * 1000:.0f} ms behind")
        if self.placed > self.named:
            parts.append(f"{self.placed - self.named} without masks")
        for why, count in list(self.dropped.items()):
            parts.append(f"{count} dropped ({why})")
        return " · ".join(parts)
