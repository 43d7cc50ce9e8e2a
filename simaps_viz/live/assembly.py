"""Puts together what belongs to one time: depth, colour, masks and the pose of the camera, by their stamps."""

import time
from bisect import bisect_left, insort
from dataclasses import dataclass, field
from typing import Any

from simaps_viz.live.source import Traffic
from simaps_viz.live.transforms import CameraPose, LiveTransforms

TOLERANCE_NS = 20_000_000
"""Pictures of one time differ by no more."""
WAIT_S = {"color": 0.5, "masks": 2.0, "pose": 2.0}
"""How long a depth picture waits for the others."""
HELD = 90
"""Messages of a topic that are held: three seconds at 30 Hz."""
BUSY = 20
"""With more depth pictures waiting than this, the map is behind: they go on without colour and masks."""
BACK_NS = 1_000_000_000
"""Stamps that go back by more than this mean that time has begun anew: a recording that loops, a simulator."""


@dataclass(frozen=True, eq=False)
class Message:
    """A message that was not decoded yet."""

    stamp_ns: int
    data: Any
    sent_ns: int
    frame: str = ""
    arrived_s: float = field(default_factory=time.monotonic)


@dataclass(frozen=True, eq=False)
class Bundle:
    """What belongs to one depth picture."""

    depth: Message
    color: Message | None
    masks: Message | None
    pose: CameraPose


class Assembler:
    """Takes messages in the order they come, and returns bundles in that of their stamps. Not for several threads."""

    def __init__(self, wanted: tuple[str, ...], transforms: LiveTransforms, traffic: Traffic) -> None:
        """Begin with nothing.

        Args:
            wanted: of "color" and "masks", what is waited for.
            transforms: where poses come from.
            traffic: counts what is dropped, and why.
        """
        self._wanted, self._transforms, self._traffic = wanted, transforms, traffic
        self._held: dict[str, list[Message]] = {"depth": [], "color": [], "masks": []}

    def add(self, kind: str, message: Message) -> None:
        """Add a message of a kind: "depth", "color" or "masks"."""
        held = self._held[kind]
        if held and message.stamp_ns < held[-1].stamp_ns - BACK_NS:
            self._begin_anew()
        insort(held, message, key=lambda one: one.stamp_ns)
        if len(held) > HELD:
            held.pop(0)
            if kind == "depth":
                self._traffic.drop("the map is too slow")

    def take(self) -> Bundle | None:
        """Return the next depth picture with what belongs to it; None = there is none, or it waits for something."""
        depths = self._held["depth"]
        while depths:
            depth, busy = depths[0], len(depths) > BUSY
            waited_s = time.monotonic() - depth.arrived_s
            try:
                pose = self._transforms.pose(depth.frame, depth.stamp_ns)
            except LookupError as reason:
                depths.pop(0)
                self._traffic.drop(f"no pose: {reason}")
                continue
            if pose is None:
                if waited_s < WAIT_S["pose"]:
                    return None
                depths.pop(0)
                self._traffic.drop("no pose in time")
                continue
            found: dict[str, Message | None] = {"color": None, "masks": None}
            for kind in self._wanted:
                known, found[kind] = self._partner(kind, depth.stamp_ns)
                if not known and not busy and waited_s < WAIT_S[kind]:
                    return None
            depths.pop(0)
            return Bundle(depth, found["color"], found["masks"], pose)
        return None

    def _partner(self, kind: str, stamp_ns: int) -> tuple[bool, Message | None]:
        """Return whether it is decided which message goes with a depth picture, and that message, if any does."""
        held = self._held[kind]
        after = bisect_left(held, stamp_ns, key=lambda one: one.stamp_ns)
        near = [held[i] for i in (after - 1, after) if 0 <= i < len(held)]
        best = min(near, key=lambda one: abs(one.stamp_ns - stamp_ns), default=None)
        if best is not None and abs(best.stamp_ns - stamp_ns) > TOLERANCE_NS:
            best = None
        exact = best is not None and best.stamp_ns == stamp_ns
        return exact or after < len(held), best

    def _begin_anew(self) -> None:
        for held in self._held.values():
            held.clear()
        self._transforms.forget()
