"""A robot as a live source: its topics chosen, its messages decoded, and what belongs together made a shot.

What belongs to one depth picture by its stamp is put together, with the pose that /tf gives for that time. Poses are
interpolated, waited for, and corrected afterwards where the robot corrects itself.

By ROS's convention (REP 105) map to odom says what the odometry has drifted, in steps, and everything below moves
without jumps. So map to odom holds from step to step and is never waited for; all other transforms are interpolated
between the two messages around a picture.
"""

import json
import struct
import threading
import time
from bisect import bisect_left, insort
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
from simaps_viz.live.source import Correction, Shot, Traffic
from simaps_viz.live.topics import ODOMETRY, STRING, Chosen, TopicNames, choose_topics
from simaps_viz.structures import Frame, Segment, Segmentation

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

JOIN_S = 6.0
"""A link's thread is waited for so long."""

OnMessage = Callable[[str, bytes, int], None]
"""(topic, CDR bytes, when it was sent in ns or 0)"""
OnReply = Callable[[bytes | None], None]
"""(CDR bytes of an answer; None = no more comes)"""


class RobotLink:
    """A connection to a robot, whatever the protocol; it connects again by itself."""

    def __init__(self, address: str) -> None:
        """Take an address; ``open`` connects."""
        self.address, self._state = address, "connecting"
        self._wanted: tuple[str, ...] = ()
        self._listeners: dict[str, Callable[[bytes], None]] = {}
        self._lock = threading.RLock()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def state(self) -> str:
        """Return what is wrong with the connection, in words; "" = nothing."""
        return self._state

    def open(self, on_topics: Callable[[dict[str, str]], None], on_message: OnMessage) -> None:
        """Connect, and keep calling back from one thread: with {topic: type} when it changes, and messages."""
        self._on_topics, self._on_message = on_topics, on_message
        self._thread = threading.Thread(target=self._run, name="robot-link", daemon=True)
        self._thread.start()

    def subscribe(self, topics: tuple[str, ...]) -> None:
        """Receive these topics from now on, also after connecting again."""
        with self._lock:
            self._wanted = topics
            self._subscribe()

    def advertise(self, topic: str, kind: str) -> None:
        """Announce that a topic will be published, now and after connecting again."""
        raise NotImplementedError

    def publish(self, topic: str, data: bytes) -> bool:
        """Publish CDR bytes on an announced topic; False when there is no connection."""
        raise NotImplementedError

    @property
    def services(self) -> dict[str, tuple[str, str]]:
        """Return {service: (type, its hash)} of what can be called, as Zenoh's keys have them."""
        return {}

    def call(self, service: str, request: bytes, take: OnReply, timeout_s: float) -> bool:
        """Call a service with CDR bytes, and ``take`` its answer, then None; False where it cannot be called."""
        return False

    def listen(self, topic: str, take: Callable[[bytes], None]) -> None:
        """Also receive a topic that no frame needs, where services can be called; before ``open`` or later."""
        with self._lock:
            self._listeners[topic] = take
            self._subscribe()

    def close(self) -> None:
        """Disconnect."""
        self._closed.set()
        self._hang_up()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        """Connect again and again until ``_closed``, calling back; then end the connection."""
        raise NotImplementedError

    def _subscribe(self) -> None:
        """Subscribe to what is wanted and not subscribed to, where there is a connection; under the lock."""
        raise NotImplementedError

    def _hang_up(self) -> None:
        """End the connection, where its thread does not look at ``_closed`` by itself."""


def raw_frame(data: bytes) -> str:
    """Read the frame of a message that starts with a header, without decoding its picture."""
    (length,) = struct.unpack_from("<I" if data[1] & 1 else ">I", data, 12)
    return data[16 : 16 + min(length - 1, MAX_FRAME)].decode()


@cache
def message_types() -> Any:
    """Return rosbags' types of messages, which have not changed since Foxy, so a robot's own are not needed.

    They are one object for all: it compiles each type when it is first used, which takes a tenth of a second.
    """
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - only robots need it

    return get_typestore(Stores.ROS2_JAZZY)


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


class RobotSource:
    """Makes shots of what a robot sends. Malformed messages are left out and counted."""

    simulated = False
    T_map_world: NDArray | None = None

    def __init__(self, link: RobotLink, named: TopicNames, *, color: bool, traffic: Traffic) -> None:
        """Connect.

        Args:
            link: to the robot.
            named: topics that a person names.
            color: colour is needed, as a network looks at it, and masks are not, as it makes them.
            traffic: counts what is left out.
        """
        self.name, self.link, self._named, self._color, self._traffic = link.address, link, named, color, traffic
        if color:
            self._named = replace(named, masks_topic="-", labels_topic="-")
        self.labels, self.is_thing = ("none",), (False,)
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
        self._closed = False
        self._began_s = self._chosen_s = self._offered_s = time.monotonic()
        link.open(self._on_topics, self._on_message)

    @property
    def segmentation_source(self) -> str:
        """Name the topic of the masks."""
        return f"masks of {self.chosen.masks}" if self.chosen is not None and self.chosen.masks else "none"

    @property
    def ended(self) -> bool:
        """Whether it was closed: a robot may always come back."""
        return self._closed

    def take(self, timeout_s: float) -> Shot | None:
        """Return the next shot.

        Raises:
            InputError: the robot lacks a topic, or it is unclear which one is meant.
        """
        end_s = time.monotonic() + timeout_s
        with self._arrived:
            while not self._closed:
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
            self._closed = True
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
        self._kinds = {t: k for k in ("color", "depth", "masks") if (t := getattr(chosen, k))}
        wanted = tuple(kind for kind in ("color", "masks") if kind in self._kinds.values())
        self._assembler = Assembler(wanted, self._transforms, self._traffic)

    def _on_message(self, topic: str, data: bytes, sent_ns: int) -> None:
        """Take a message, from the link's thread: pictures are decoded later, all else at once."""
        with self._arrived:
            chosen = self.chosen
            if chosen is None or self._closed or self._assembler is None:
                return
            self._checked(topic, lambda: self._take_in(chosen, topic, data, sent_ns))
            self._arrived.notify_all()

    def _take_in(self, chosen: Chosen, topic: str, data: bytes, sent_ns: int) -> None:
        kind = self.offered.get(topic, "")
        assert self._assembler is not None
        if topic in self._kinds:
            message = Message(raw_stamp_ns(data, ros2=True), (kind, data), sent_ns, raw_frame(data))
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
        if not isinstance(table, dict) or len(table) + len(self._labels) > MAX_LABELS:
            raise InputError(f"labels: expected an object of at most {MAX_LABELS} ids, found {text[:40]!r}")
        found = {}
        for key, about in table.items():
            number, label, score = int(key), about["label"], float(about.get("score", 1.0))
            if not (isinstance(label, str) and 0 < len(label) <= MAX_LABEL and label != "none" and label.isprintable()):
                raise InputError(f"labels: expected a name of at most {MAX_LABEL} characters, found {label!r}")
            if not (1 <= number <= MAX_SEGMENT_ID and 0.0 <= score <= 1.0):
                raise InputError(f"labels: expected ids from 1 and scores from 0 to 1, found {key!r} and {score:g}")
            found[number] = Segment(number, label, score, bool(about.get("is_thing", label not in STUFF)))
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
