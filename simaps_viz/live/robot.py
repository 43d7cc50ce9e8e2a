"""A robot as a live source: its topics chosen, its messages decoded, and what belongs together made a shot.

What belongs to one depth picture by its stamp is put together, with the pose that /tf gives for that time. Poses are
interpolated, waited for, and corrected afterwards where the robot corrects itself.

By ROS's convention (REP 105) map to odom says what the odometry has drifted, in steps, and everything below moves
without jumps. So map to odom holds from step to step, however long it is silent, and is never waited for; all other
transforms are interpolated between the two messages around a picture. Where these are silent for seconds, pictures
wait, and are placed if the robot stood or kept its speed; otherwise nobody knows its way, and they are dropped.
"""

import json
import struct
import threading
import time
from bisect import bisect_left, insort
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, logm

from simaps_viz.colors.classes import STUFF
from simaps_viz.datasets.association import interpolate_poses
from simaps_viz.datasets.calibration import Lens, see_through
from simaps_viz.datasets.ros_messages import (
    MAX_GAP_S,
    TF_TYPES,
    decode_color,
    decode_depth,
    decode_ids,
    decode_lens,
    decode_pose,
    raw_stamp_ns,
    stamp_ns,
)
from simaps_viz.datasets.rosbag import time_name
from simaps_viz.errors import InputError, one_line
from simaps_viz.geometry import invert_pose
from simaps_viz.io.limits import MAX_SEGMENT_ID
from simaps_viz.live.links import RobotLink, message_types
from simaps_viz.live.source import Correction, Shot, Source, Traffic
from simaps_viz.live.topics import ODOMETRY, STRING, Chosen, TopicNames, choose_topics
from simaps_viz.structures import Frame, Segment, Segmentation

KEPT_S = 30.0
"""Transforms are kept for so long."""
JUMP_M, JUMP_RAD = 0.1, np.deg2rad(3.0)
"""A step of map to odom as large as either is a correction of what was, and not only of what will be."""
RESET_M, RESET_MPS = 0.5, 5.0
"""Odometry that moves by more than the first at once, and faster than the second, has begun anew."""
BRIDGE_S, STEADY_NS = 4.0, 300_000_000
"""Silence of transforms up to the first is bridged where the robot's speed in the second before and after it agrees."""
MAX_STEPS = 200
"""Steps of map to odom that are known; all that may still be corrected are among them."""
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
        if known[0]:
            return found[0]
        if times[1] - times[0] <= BRIDGE_S:
            if self.poses[-1][0] - self.poses[after][0] < STEADY_NS:
                return None  # how it goes on there will tell
            if (bridged := self._bridged(after, stamp_ns)) is not None:
                return bridged
        raise LookupError(f"transforms silent for more than {MAX_GAP_S:g} s")

    def _bridged(self, after: int, stamp_ns: int) -> NDArray | None:
        """Return T_parent_child within the silence before a message; None where the way there is anyone's guess.

        It is known of what stood, or went on as it had, straight or on an arc: the speed before the silence and that
        after it, kept up through it, both lead from its one end to the other.
        """
        at = [bisect_left(self.poses, self.poses[after - 1][0] - STEADY_NS, key=itemgetter(0)), after - 1, after]
        at.append(bisect_left(self.poses, self.poses[after][0] + STEADY_NS, key=itemgetter(0)))
        times = [self.poses[i][0] for i in at]
        past, begin, end, later = (self.poses[i][1] for i in at)
        way, silent_ns = invert_pose(begin) @ end, times[2] - times[1]
        for one, other, took_ns in ((past, begin, times[1] - times[0]), (end, later, times[3] - times[2])):
            if not took_ns or _far(_part_of(invert_pose(one) @ other, silent_ns / took_ns), way):
                return None
        return begin @ _part_of(way, (stamp_ns - times[1]) / silent_ns)

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
        del self._steps[:-MAX_STEPS]
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


def _part_of(T: NDArray, share: float) -> NDArray:
    """Return what a motion comes to in a share of its time, float64 [4, 4]: along one screw, so an arc stays an arc."""
    return np.real(np.asarray(expm(share * np.asarray(logm(T)))))


def _far(one: NDArray, other: NDArray) -> bool:
    D = invert_pose(one) @ other
    turned = np.arccos(np.clip((np.trace(D[:3, :3]) - 1) / 2, -1.0, 1.0))
    return bool(np.linalg.norm(D[:3, 3]) > JUMP_M or turned > JUMP_RAD)


TOLERANCE_NS = 20_000_000
"""Pictures of one time differ by no more."""
WAIT_S = {"color": 0.5, "masks": 2.0, "pose": BRIDGE_S + 1.0}
"""How long a depth picture waits for the others."""
HELD = 150
"""Messages of a topic that are held: five seconds at 30 Hz."""
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


Clock = Callable[[], float]


class Assembler:
    """Takes messages in the order they come, and returns bundles in that of their stamps. Not for several threads."""

    def __init__(
        self, wanted: tuple[str, ...], transforms: LiveTransforms, traffic: Traffic, clock: Clock = time.monotonic
    ) -> None:
        """Begin with nothing.

        Args:
            wanted: of "color" and "masks", what is waited for.
            transforms: where poses come from.
            traffic: counts what is dropped, and why.
            clock: by which messages arrive and wait, seconds.
        """
        self._wanted, self._transforms, self._traffic, self._clock = wanted, transforms, traffic, clock
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
            waited_s = self._clock() - depth.arrived_s
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


OFFER_S = 10.0
"""What is missing or unclear among the topics becomes an error when it is still so after this time."""
LABELS_S = 3.0
"""Pictures wait so long for the first table of labels."""
LISTEN_S = 1.0
"""When no more topics were announced for so long, these are all."""
MAX_LABELS, MAX_LABEL = 10_000, 100
"""Ids with a label, and characters of one."""

MAX_FRAME = 200
"""Characters of the name of a frame."""


def raw_frame(data: bytes) -> str:
    """Read the frame of a message that starts with a header, without decoding its picture."""
    (length,) = struct.unpack_from("<I" if data[1] & 1 else ">I", data, 12)
    return data[16 : 16 + min(length - 1, MAX_FRAME)].decode()


def topics_of(link: RobotLink) -> dict[str, str]:
    """Connect, and return {topic: type} of what a robot offers once nothing more is announced.

    Raises:
        InputError: there is no connection, or it offers nothing.
    """
    offered: dict[str, str] = {}
    link.open(offered.update, lambda topic, data, sent_ns: None)
    end_s, quiet_s, before = time.monotonic() + OFFER_S, time.monotonic(), -1
    while time.monotonic() < end_s and (not offered or time.monotonic() - quiet_s < LISTEN_S):
        if len(offered) != before:
            before, quiet_s = len(offered), time.monotonic()
        time.sleep(0.05)
    state = link.state
    link.close()
    if not offered:
        raise InputError(f"{link.address}: expected a robot with topics, found none ({state or 'nothing announced'})")
    return offered


class RobotSource(Source):
    """Makes shots of what a robot sends. Malformed messages are left out and counted; one that ends may come back."""

    def __init__(
        self, link: RobotLink, named: TopicNames, *, color: bool, traffic: Traffic, clock: Clock = time.monotonic
    ) -> None:
        """Connect.

        Args:
            link: to the robot.
            named: topics that a person names.
            color: colour is needed, as a network looks at it, and masks are not, as it makes them.
            traffic: counts what is left out.
            clock: by which messages wait for each other, seconds.
        """
        self._clock = clock
        self.name, self.link, self._named, self._color, self._traffic = link.address, link, named, color, traffic
        if color:
            self._named = replace(named, masks_topic="-", labels_topic="-")
        self.chosen: Chosen | None = None
        self.offered: dict[str, str] = {}
        self._types = message_types()
        self._transforms = LiveTransforms()
        self._assembler: Assembler | None = None
        self._lens: Lens | None = None
        self._labels: dict[int, Segment] = {}
        self._unclear: str = ""
        self._kinds: dict[str, str] = {}
        self._arrived = threading.Condition()
        self._began_s = self._chosen_s = self._offered_s = time.monotonic()
        link.open(self._on_topics, self._on_message)

    def take(self, timeout_s: float) -> Shot | None:
        """Return the next shot.

        Raises:
            InputError: the robot lacks a topic, or it is unclear which one is meant.
        """
        end_s = time.monotonic() + timeout_s
        with self._arrived:
            while not self.ended:
                self._find_topics()
                bundle = self._assembler.take() if self._assembler is not None and self._is_ready() else None
                if bundle is not None or time.monotonic() >= end_s:
                    break
                self._arrived.wait(max(min(end_s - time.monotonic(), 0.02), 0.001))
            else:
                bundle = None
            unclear = self._unclear if self.chosen is None and time.monotonic() - self._began_s > OFFER_S else ""
        if unclear:
            raise InputError(f"{self.name}: {unclear}")
        return None if bundle is None else self._checked("a picture", lambda: self._shot(bundle))

    def correction(self) -> Correction | None:
        """Return what the robot has corrected of its poses."""
        with self._arrived:
            return self._transforms.correction()

    def robot(self) -> tuple[str, NDArray, float] | None:
        """Return the world's name, T_world_base [4, 4] now, and how old that is, seconds; None = not known."""
        with self._arrived:
            return self._transforms.robot()

    def words(self) -> str:
        """Describe what is missing."""
        if state := self.link.state:
            return state
        if self.chosen is None:
            return self._unclear or "connected, waiting for topics"
        if self._lens is None:
            return f"waiting for {self.chosen.info}"
        return "connected"

    def close(self) -> None:
        """Disconnect."""
        with self._arrived:
            self.ended = True
            self._arrived.notify_all()
        self.link.close()

    def _is_ready(self) -> bool:
        """Whether the camera is known, and what ids mean, or nobody seems to tell."""
        unknown = self.chosen is not None and self.chosen.labels and not self._labels
        return self._lens is not None and (not unknown or time.monotonic() - self._chosen_s > LABELS_S)

    def _on_topics(self, offered: dict[str, str]) -> None:
        """Take note of what is announced, from the link's thread; topics come one by one."""
        with self._arrived:
            self.offered, self._offered_s = offered, time.monotonic()

    def _find_topics(self) -> None:
        """Choose topics once no more are announced, and subscribe to them."""
        if self.chosen is not None or not self.offered or time.monotonic() - self._offered_s < LISTEN_S:
            return
        try:
            chosen = choose_topics(self.offered, self._named, color=self._color)
        except InputError as error:
            self._unclear = str(error)
            return
        self._choose(chosen)
        self.link.subscribe(chosen.all)

    def _choose(self, chosen: Chosen) -> None:
        self.chosen, self._unclear, self._chosen_s = chosen, "", time.monotonic()
        self.segmentation_source = f"masks of {chosen.masks}" if chosen.masks else "none"
        self._kinds = {t: k for k in ("color", "depth", "masks") if (t := getattr(chosen, k))}
        wanted = tuple(kind for kind in ("color", "masks") if kind in self._kinds.values())
        self._assembler = Assembler(wanted, self._transforms, self._traffic, self._clock)

    def _on_message(self, topic: str, data: bytes, sent_ns: int) -> None:
        """Take a message, from the link's thread: pictures are decoded later, all else at once."""
        with self._arrived:
            chosen = self.chosen
            if chosen is None or self.ended or self._assembler is None:
                return
            self._checked(topic, lambda: self._take_in(chosen, topic, data, sent_ns))
            self._arrived.notify_all()

    def _take_in(self, chosen: Chosen, topic: str, data: bytes, sent_ns: int) -> None:
        kind = self.offered.get(topic, "")
        assert self._assembler is not None
        if topic in self._kinds:
            taken_ns = raw_stamp_ns(data, ros2=True)
            message = Message(taken_ns, (kind, data), sent_ns, raw_frame(data), self._clock())
            self._assembler.add(self._kinds[topic], message)
        elif topic == chosen.info:
            if self._lens is None:
                rectified = any(part in chosen.depth for part in ("rect", "aligned", "registered"))
                self._lens = decode_lens(topic, self._types.deserialize_cdr(data, kind), rectified=rectified)
        elif topic == chosen.labels:
            self._take_labels(self._types.deserialize_cdr(data, STRING).data)
        elif kind in TF_TYPES:
            for one in self._types.deserialize_cdr(data, TF_TYPES[0]).transforms:
                self._transforms.add(
                    one.header.frame_id, one.child_frame_id, stamp_ns(one.header),
                    decode_pose(topic, one.transform), fixed=topic.endswith("tf_static"),
                )  # fmt: skip
        elif kind == ODOMETRY:
            one = self._types.deserialize_cdr(data, kind)
            pose = decode_pose(topic, one.pose.pose)
            self._transforms.add(one.header.frame_id, one.child_frame_id, stamp_ns(one.header), pose, fixed=False)

    def _take_labels(self, text: str) -> None:
        """Take what ids mean: JSON, {"<id>": {"label", "score", "is_thing"}}; what is not said again stays."""
        table = json.loads(text)
        if not isinstance(table, dict) or len(table) > MAX_LABELS:
            raise InputError(f"labels: expected an object of at most {MAX_LABELS} ids, found {text[:40]!r}")
        found = {}
        for key, about in table.items():
            number, label, score = int(key), about["label"], float(about.get("score", 1.0))
            if not (isinstance(label, str) and 0 < len(label) <= MAX_LABEL and label != "none" and label.isprintable()):
                raise InputError(f"labels: expected a name of at most {MAX_LABEL} characters, found {label!r}")
            if not (1 <= number <= MAX_SEGMENT_ID and 0.0 <= score <= 1.0):
                raise InputError(f"labels: expected ids from 1 and scores from 0 to 1, found {key!r} and {score:g}")
            found[number] = Segment(number, label, score, bool(about.get("is_thing", label not in STUFF)))
        if len(self._labels | found) > MAX_LABELS:
            raise InputError(f"labels: expected at most {MAX_LABELS} ids in all, found {len(self._labels | found)}")
        self._labels.update(found)

    def _shot(self, bundle: Bundle) -> Shot:
        lens, chosen, depth = self._lens, self.chosen, bundle.depth
        assert lens is not None and chosen is not None
        target = lens.intrinsics
        depth_m = decode_depth(chosen.depth, self._types.deserialize_cdr(depth.data[1], depth.data[0]))
        lens_here = lens.scaled(depth_m.shape[1], depth_m.shape[0])
        color = None
        if bundle.color is not None:
            kind, data = bundle.color.data
            color = decode_color(chosen.color, self._types.deserialize_cdr(data, kind))
            color = see_through(color, lens.scaled(color.shape[1], color.shape[0]), target, exact=False)
        frame = Frame(
            0, time_name(depth.stamp_ns), see_through(depth_m, lens_here, target, exact=True),
            bundle.pose.T_world_camera, target, color,
        )  # fmt: skip
        masks = None
        if bundle.masks is not None:
            kind, data = bundle.masks.data
            ids = decode_ids(chosen.masks, self._types.deserialize_cdr(data, kind))
            masks = self._segmentation(see_through(ids, lens.scaled(ids.shape[1], ids.shape[0]), target, exact=True))
        elif not chosen.masks and not self._color:
            masks = Segmentation(np.zeros(frame.depth_m.shape, np.int32), ())  # nobody will ever name anything
        pose = bundle.pose
        return Shot(frame, masks, depth.stamp_ns, depth.sent_ns, pose.T_odom_camera, self._transforms.epoch)

    def _segmentation(self, ids: NDArray) -> Segmentation:
        """Return the masks whose ids have a label; the others count as nothing."""
        labels, highest = self._labels, int(ids.max(initial=0))
        # Counting is faster than sorting, where there are not too many ids.
        numbers = np.flatnonzero(np.bincount(ids.reshape(-1))) if highest < ids.size else np.unique(ids)
        segments = tuple(labels[n] for n in numbers.tolist() if n in labels)
        unknown = [n for n in numbers.tolist() if n and n not in labels]
        if unknown:
            ids = np.where(np.isin(ids, unknown), 0, ids).astype(np.int32)
        return Segmentation(np.ascontiguousarray(ids), segments)

    def _checked(self, what: str, decode: Callable[[], Any]) -> Any:
        """Call something that decodes a message; return None, and count it, when it is malformed."""
        try:
            return decode()
        except Exception as error:  # unpackers may raise anything on malformed messages
            self._traffic.drop(f"malformed, {what}: {one_line(error)}"[:120])
            return None
