"""What a live map is made of: pictures with their time and pose, one after the other, until nothing comes any more.

A recorded sequence can be played as such a source: its frames come at their own times, as if recorded now.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource, named_times
from simaps_viz.errors import InputError
from simaps_viz.segmentation.protocol import Network
from simaps_viz.structures import Frame, Segmentation

MAX_REASONS = 20
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


class Source:
    """Where frames come from. ``take`` is called by one thread, all else by any."""

    name: str
    """Address or name, for the map and for people."""
    labels: tuple[str, ...] = ("none",)
    """Class names known beforehand, index 0 is "none"; more may come with the frames."""
    is_thing: tuple[bool, ...] = (False,)
    """Aligned with ``labels``."""
    segmentation_source = "none"
    """In words."""
    simulated = False
    """Frames or masks are simulated."""
    T_map_world: NDArray | None = None
    """float64 [4, 4], world to map frame; None: z is up, and the floor has to be found."""
    ended = False
    """Nothing more will come."""

    def take(self, timeout_s: float) -> Shot | None:
        """Return the next shot; None where none has come in that time, or it is of no use.

        Raises:
            InputError: none ever will.
        """
        raise NotImplementedError

    def correction(self) -> Correction | None:
        """Return what has been corrected since the last call; None = nothing: recordings and phones never say so."""
        return None

    def words(self) -> str:
        """Describe the state of the connection in a few words; "" where there is none."""
        return ""

    def close(self) -> None:
        """Stop; ``take`` returns at once from now on."""
        self.ended = True


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
        """Count something that was left out; of more than `MAX_REASONS`, as of a broken sender, not each by itself."""
        if len(self.dropped) >= MAX_REASONS and why not in self.dropped:
            why = "other reasons"
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


RATE_HZ = 30.0
"""Of sequences whose frames have no time of their own."""
LATE_S = 0.25
"""A frame that comes later than this comes without its masks: reading and counting them costs most."""


def times_of(names: tuple[str, ...]) -> NDArray:
    """Return the times of frames, float64 [n], seconds from the first: from their names, or else at `RATE_HZ`."""
    times = named_times(names)
    return np.arange(len(names)) / RATE_HZ if times is None else times - times[0]


class PlayedSequence(Source):
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
        self.T_map_world = sequence.T_map_world
        self.unreadable = 0
        self._times = times_of(sequence.frame_names)
        self._at_pace, self._masked = at_pace, network is None
        self._next, self._began_s, self.ended = 0, 0.0, not len(sequence)

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
        self.ended |= self._next >= len(self.sequence)
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

    def words(self) -> str:
        """Describe how far it is."""
        lost = f", {self.unreadable} could not be read" if self.unreadable else ""
        return f"frame {self._next} of {len(self.sequence)}{lost}"
