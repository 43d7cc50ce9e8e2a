"""Time and pose: what belongs to one depth picture by its stamp, with the pose that /tf gives for that time.

Poses are interpolated, waited for, and corrected afterwards where the robot corrects itself.

By ROS's convention (REP 105) map to odom says what the odometry has drifted, in steps, and everything below moves
without jumps. So map to odom holds from step to step and is never waited for; all other transforms are interpolated
between the two messages around a picture.
"""

import time
from bisect import bisect_left, insort
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import interpolate_poses
from simaps_viz.datasets.ros_messages import MAX_GAP_S
from simaps_viz.geometry import invert_pose
from simaps_viz.live.source import Correction, Traffic

KEPT_S = 30.0
"""Transforms are kept for so long."""
JUMP_M, JUMP_RAD = 0.1, np.deg2rad(3.0)
"""A step of map to odom as large as either is a correction of what was, and not only of what will be."""
RESET_M, RESET_MPS = 0.5, 5.0
"""Odometry that moves by more than the first at once, and faster than the second, has begun anew."""
MAX_LINKS, MAX_DEPTH = 2000, 50
"""Frames in the tree, and links from a camera to its root; no robot has as many."""
ODOM = "odom"


@dataclass(frozen=True, eq=False)
class CameraPose:
    """Where a camera was."""

    world: str
    """Name of the frame that nothing moves."""
    T_world_odom: NDArray
    """float64 [4, 4]; the identity where the tree has no odom."""
    T_odom_camera: NDArray | None
    """None where the tree has no odom."""
    T_world_camera: NDArray


@dataclass(eq=False)
class _Link:
    parent: str
    fixed: bool
    poses: list[tuple[int, NDArray]] = field(default_factory=list)
    """(ns, T_parent_child), ascending; one where it is fixed."""

    def add(self, stamp_ns: int, T: NDArray) -> None:
        if self.fixed:
            self.poses = [(stamp_ns, T)]
            return
        insort(self.poses, (stamp_ns, T), key=itemgetter(0))
        while self.poses[0][0] < self.poses[-1][0] - KEPT_S * 1e9:
            self.poses.pop(0)

    def at(self, stamp_ns: int) -> NDArray | None:
        """Return T_parent_child then; None = a later message may tell.

        Raises:
            LookupError: no later message can.
        """
        if self.fixed:
            return self.poses[-1][1]
        after = bisect_left(self.poses, stamp_ns, key=itemgetter(0))
        if after == len(self.poses):
            return None
        if self.poses[after][0] == stamp_ns:
            return self.poses[after][1]
        if not after:
            raise LookupError("before the first transform")
        times = np.array([self.poses[i][0] - stamp_ns for i in (after - 1, after)]) / 1e9
        poses = np.stack([self.poses[i][1] for i in (after - 1, after)])
        found, known = interpolate_poses(times, poses, np.zeros(1), max_gap_s=MAX_GAP_S)
        if not known[0]:
            raise LookupError(f"transforms silent for {times[1] - times[0]:.1f} s")
        return found[0]

    def held(self, stamp_ns: int) -> NDArray:
        """Return the last T_parent_child until then, or the first one there is."""
        after = bisect_left(self.poses, stamp_ns + 1, key=itemgetter(0))
        return self.poses[max(after - 1, 0)][1]


class LiveTransforms:
    """The tree of frames of the last seconds, and the steps of map to odom since the beginning."""

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._steps: list[tuple[int, NDArray]] = []
        self._since_ns: int | None = None
        self._assumed = False
        self._base, self._fresh_s = "", -np.inf
        self.epoch = 0
        """Counts how often time or the odometry has begun anew; corrections are of one epoch."""

    def add(self, parent: str, child: str, stamp_ns: int, T_parent_child: NDArray, *, fixed: bool) -> None:
        """Add one transform; a frame keeps its first parent."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if child not in self._links and len(self._links) >= MAX_LINKS:
            return
        link = self._links.setdefault(child, _Link(parent, fixed))
        if link.parent == parent:
            if _is_odom(parent) and link.poses and not fixed:
                before_ns, before = link.poses[-1]
                if (
                    np.linalg.norm(T_parent_child[:3, 3] - before[:3, 3])
                    > RESET_M + RESET_MPS * abs(stamp_ns - before_ns) / 1e9
                ):
                    self._begin_anew()
            newer = not link.poses or stamp_ns > link.poses[-1][0]
            link.add(stamp_ns, T_parent_child)
            if not fixed and (_is_odom(parent) or (not self._base and not _is_odom(child))):
                self._base = child  # what odom carries, or else the first thing that moves
            if child == self._base and newer:
                self._fresh_s = time.monotonic()
            if _is_odom(child):
                self._step(stamp_ns, T_parent_child)

    def forget(self) -> None:
        """Forget all that moves: time has begun anew."""
        self._links = {child: link for child, link in self._links.items() if link.fixed}
        self._begin_anew()

    def pose(self, frame: str, stamp_ns: int) -> CameraPose | None:
        """Return where a frame was at a time; None = a later message may tell.

        Raises:
            LookupError: none can, in words.
        """
        T, below, T_world_odom = np.eye(4), None, np.eye(4)
        name, moves = frame.lstrip("/"), False
        for _ in range(MAX_DEPTH):
            link = self._links.get(name)
            if _is_odom(name):
                below = T
                if link is not None:
                    known = bool(self._steps) and stamp_ns < self._steps[-1][0]
                    T_world_odom = _between(self._steps, np.array([stamp_ns]))[0] if known else link.held(stamp_ns)
                self._assumed |= link is None
            if link is None:
                break
            step = T_world_odom if _is_odom(name) else link.at(stamp_ns)
            if step is None:
                return None
            T, name, moves = step @ T, link.parent, moves or not link.fixed
        else:
            raise LookupError("transforms in a circle")
        return CameraPose(name, T_world_odom, below, T) if moves else None

    def robot(self) -> tuple[str, NDArray, float] | None:
        """Return the world's name, T_world_base [4, 4] now, and how old that is, seconds; None = not known."""
        link = self._links.get(self._base)
        if link is None:
            return None
        T, name = link.poses[-1][1], link.parent
        for _ in range(MAX_DEPTH):
            above = self._links.get(name)
            if above is None:
                return name, T, time.monotonic() - self._fresh_s
            T, name = above.poses[-1][1] @ T, above.parent
        return None

    def correction(self) -> Correction | None:
        """Return what the steps of map to odom since the last call have changed; None = nothing."""
        since_ns, self._since_ns = self._since_ns, None
        if since_ns is None:
            return None
        steps = list(self._steps)
        return Correction(since_ns, self.epoch, lambda stamps: _between(steps, stamps))

    def _step(self, stamp_ns: int, T: NDArray) -> None:
        """Take note of map to odom, where it has changed by a step."""
        if not self._steps:
            self._steps = [(stamp_ns, T)]
            if self._assumed:  # until now odom was taken for the world
                self._since_ns, self._assumed = 0, False
            return
        if self.epoch and len(self._steps) == 1 and _far(self._steps[0][1], T):
            # The robot knows where it is for the first time since its odometry has begun anew.
            self._steps, self._since_ns = [(self._steps[0][0], T), (stamp_ns, T)], 0
            return
        if stamp_ns <= self._steps[-1][0] or not _far(self._steps[-1][1], T):
            return
        since_ns = self._steps[-1][0]
        if len(self._steps) > 1 and not _far(self._steps[-2][1], T):
            # Back where it was: what lay between was no drift but a mistake, which the robot has seen.
            self._steps.pop()
            since_ns = self._steps[-1][0]
        self._steps.append((stamp_ns, T))
        self._since_ns = since_ns if self._since_ns is None else min(self._since_ns, since_ns)

    def _begin_anew(self) -> None:
        self.epoch += 1
        self._steps, self._since_ns = [], None


def _is_odom(frame: str) -> bool:
    return frame.rpartition("/")[2].startswith(ODOM)


def _between(steps: list[tuple[int, NDArray]], stamps: NDArray) -> NDArray:
    """Return T_world_odom, float64 [n, 4, 4], at times in ns: drift grows evenly from step to step.

    Before the first step and after the last one it is theirs.
    """
    times, poses = (np.array([step[i] for step in steps]) for i in (0, 1))
    return interpolate_poses((times - times[0]) / 1e9, poses, (stamps - times[0]) / 1e9, max_gap_s=np.inf)[0]


def _far(one: NDArray, other: NDArray) -> bool:
    D = invert_pose(one) @ other
    turned = np.arccos(np.clip((np.trace(D[:3, :3]) - 1) / 2, -1.0, 1.0))
    return bool(np.linalg.norm(D[:3, 3]) > JUMP_M or turned > JUMP_RAD)


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
