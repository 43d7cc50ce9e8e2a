"""What is sent to the robot: the map, its objects and planned paths; and goals, if a person allows it twice.

Foxglove's bridge cannot latch what its clients publish, so maps are sent again every so often.

Goals need --drive and the page's switch. The command is rehearsed on the map first. The robot then gets goals that lie
at most `LEASH_M` ahead of it on the rehearsed path, one after the other, as it comes closer: so a robot that loses us
stops at the next of them. They are goals of Nav2's action NavigateToPose where the robot announces it and the link can
call it (rmw_zenoh), and else on `GOAL`. The robot's own navigation avoids obstacles and limits speed; velocities are
never published.

An action is three services and two topics below its name: send_goal (goal's id, pose, behaviour tree: accepted or not),
cancel_goal, get_result, and status and feedback. Each goal is sent once, with an id of its own; Nav2 gives up a goal
when the next one comes. A goal that nobody wants any more is cancelled as soon as it is known to have been accepted.
"""

import os
import struct
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from simaps_viz.colors.instances import instance_colors
from simaps_viz.errors import SIMapsError
from simaps_viz.events import BuildFinished, Event, FrameProjected
from simaps_viz.geometry import invert_pose, transform_points
from simaps_viz.live.links import RobotLink, message_types
from simaps_viz.live.robot import RobotSource
from simaps_viz.navigation.agent import answer, outcome_text, planner_of
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Pose2, SIMap

MAP, OBJECTS, PATH = "/si_map", "/si_map/objects", "/si_map/path"
OUT = {
    MAP: "nav_msgs/msg/OccupancyGrid", OBJECTS: "visualization_msgs/msg/MarkerArray", PATH: "nav_msgs/msg/Path",
}  # fmt: skip
"""All that is published without --drive, {topic: type}."""
GOAL, GOAL_TYPE = "/goal_pose", "geometry_msgs/msg/PoseStamped"
EVERY_S = 2.0
"""The map is sent at most so often."""
FREE, OCCUPIED, UNKNOWN = 0, 100, -1
CUBE, TEXT, ADD, DELETE_ALL = 1, 9, 0, 3


class Messages:
    """Makes ROS messages of maps and poses, in the robot's world."""

    def __init__(self, world: str, T_world_map: NDArray) -> None:
        """Take the name of the world, and float64 [4, 4], map frame to world."""
        self.world, self.T_world_map = world, T_world_map
        self._turned = Rotation.from_matrix(T_world_map[:3, :3]).as_quat()
        self._types = message_types()

    def grid(self, simap: SIMap) -> bytes:
        """Return the OccupancyGrid of a map: occupied where the robot would touch something."""
        planner, spec = planner_of(simap, RobotShape()), simap.spec
        cells = np.where(planner.blocked, OCCUPIED, np.where(np.isnan(simap.grid.height_m), UNKNOWN, FREE))
        info = self._make(
            "nav_msgs/msg/MapMetaData", map_load_time=self._now(), resolution=spec.cell_size_m, width=spec.cols,
            height=spec.rows, origin=self._pose(np.array([spec.x0_m, spec.y0_m, 0.0]), 0.0),
        )  # fmt: skip
        return self._cdr(OUT[MAP], header=self._header(), info=info, data=cells.astype(np.int8).ravel())

    def objects(self, simap: SIMap) -> bytes:
        """Return the MarkerArray of a map's instances: a box and a name each; earlier ones are deleted."""
        colors, markers = instance_colors(simap), [self._marker(0, action=DELETE_ALL)]
        for one in simap.instances:
            low, high = (np.array(corner) for corner in one.aabb_m)
            low[2] = 0.0
            size = np.maximum(high - low, simap.spec.cell_size_m)
            r, g, b = (colors[one.id] / 255.0).tolist()
            markers.append(self._marker(2 * one.id, kind=CUBE, at=(low + high) / 2, size=size, color=(r, g, b, 0.5)))
            above = np.array([*one.centroid_m[:2], high[2] + 0.15])
            text = f"{one.label} {one.id}"
            markers.append(self._marker(2 * one.id + 1, kind=TEXT, at=above, size=np.full(3, 0.15), text=text))
        return self._cdr(OUT[OBJECTS], markers=markers)

    def path(self, points_m: NDArray) -> bytes:
        """Return the Path along points, float64 [n, 2], map frame."""
        ahead = np.diff(points_m, axis=0, append=points_m[-1:])
        yaws = np.arctan2(ahead[:, 1], ahead[:, 0])
        poses = [self._stamped(np.array([x, y, 0.0]), yaw) for (x, y), yaw in zip(points_m, yaws, strict=True)]
        return self._cdr(OUT[PATH], header=self._header(), poses=poses)

    def goal(self, pose: Pose2) -> bytes:
        """Return a pose of the map frame as PoseStamped."""
        one = self._stamped(np.array([pose.x_m, pose.y_m, 0.0]), pose.yaw_rad)
        return bytes(self._types.serialize_cdr(one, GOAL_TYPE))

    def _marker(
        self, number: int, *, kind: int = CUBE, action: int = ADD, at: NDArray | None = None,
        size: NDArray | None = None, color: Sequence[float] = (1.0, 1.0, 1.0, 1.0), text: str = "",
    ) -> Any:  # fmt: skip
        vector = self._types.types["geometry_msgs/msg/Vector3"]
        never = self._make("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
        picture = self._make("sensor_msgs/msg/CompressedImage", header=self._header(), format="", data=_no_bytes())
        mesh = self._make("visualization_msgs/msg/MeshFile", filename="", data=_no_bytes())
        return self._make(
            "visualization_msgs/msg/Marker", header=self._header(), ns="si_map", id=number, type=kind, action=action,
            pose=self._pose(np.zeros(3) if at is None else at, 0.0),
            scale=vector(*(np.ones(3) if size is None else size).tolist()),
            color=self._types.types["std_msgs/msg/ColorRGBA"](*color), lifetime=never, frame_locked=False,
            points=[], colors=[], texture_resource="", texture=picture, uv_coordinates=[], text=text,
            mesh_resource="", mesh_file=mesh, mesh_use_embedded_materials=False,
        )  # fmt: skip

    def _pose(self, at_m: NDArray, yaw_rad: float) -> Any:
        """Return a Pose of the world from a place and a yaw of the map frame."""
        (x, y, z, w), s, c = self._turned, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)
        turned = map(float, (x * c + y * s, y * c - x * s, z * c + w * s, w * c - z * s))
        point = self._types.types["geometry_msgs/msg/Point"](*transform_points(self.T_world_map, at_m).tolist())
        return self._make(
            "geometry_msgs/msg/Pose", position=point,
            orientation=self._types.types["geometry_msgs/msg/Quaternion"](*turned),
        )  # fmt: skip

    def _stamped(self, at_m: NDArray, yaw_rad: float) -> Any:
        return self._make(GOAL_TYPE, header=self._header(), pose=self._pose(at_m, float(yaw_rad)))

    def _header(self) -> Any:
        return self._make("std_msgs/msg/Header", stamp=self._now(), frame_id=self.world)

    def _now(self) -> Any:
        sec, nanosec = divmod(time.time_ns(), 10**9)
        return self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._types.types[kind](**fields)

    def _cdr(self, kind: str, **fields: Any) -> bytes:
        return bytes(self._types.serialize_cdr(self._make(kind, **fields), kind))


def messages_for(source: RobotSource, T_map_world: NDArray) -> Messages | None:
    """Return what makes messages in a robot's world; None while that is not known."""
    robot = source.robot()
    return None if robot is None else Messages(robot[0], invert_pose(T_map_world))


class MapPublisher:
    """Observes a live build, and publishes its map and objects now and then; nothing else."""

    wants_color = False

    def __init__(self, source: RobotSource) -> None:
        self._source, self._next_s = source, 0.0
        self._worker = ThreadPoolExecutor(1, "live-publish")
        self._busy: Future[None] | None = None
        for topic, kind in OUT.items():
            source.link.advertise(topic, kind)
            message_types().get_msgdef(kind)  # compiled before frames come, whom it would hold up

    def on_event(self, event: Event) -> None:
        """Publish the map where it is due, while frames go on, and the finished one."""
        if isinstance(event, BuildFinished):
            self._worker.submit(self._publish, event.simap).result()
        elif isinstance(event, FrameProjected) and event.map_so_far is not None:
            free = self._busy is None or self._busy.done()
            if free and (now_s := time.monotonic()) >= self._next_s and (simap := event.map_so_far()) is not None:
                self._busy = self._worker.submit(self._publish, simap)
                self._next_s = now_s + EVERY_S

    def _publish(self, simap: SIMap) -> None:
        make = messages_for(self._source, simap.T_map_world)
        if make is not None:
            self._source.link.publish(MAP, make.grid(simap))
            self._source.link.publish(OBJECTS, make.objects(simap))


def _no_bytes() -> NDArray:
    return np.zeros(0, np.uint8)


FRESH_S = 0.5
"""A pose older than this moves nothing."""
LEASH_M = 1.5
"""A goal lies at most so far ahead."""
STEP_M = 0.5
"""The next one is sent when it is so much farther than the last."""
ARRIVED_M = 0.35
STRAYED_M = 2.0
"""A robot so far from its path is stopped."""
TICK_S = 0.1
LOST_S = 2.0
"""Without a page, a connection or a pose for so long the robot is stopped, and does not go on by itself."""
SETTLE_S = 1.0
"""A page that closes waits so long for the robot to hear of it."""
SAMPLE_M = 0.1


def resampled(path_m: NDArray) -> NDArray:
    """Return the points of a path at most `SAMPLE_M` apart, float64 [n, 2]."""
    lengths = np.linalg.norm(np.diff(path_m, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.union1d(along, np.arange(0.0, along[-1], SAMPLE_M))
    return np.stack([np.interp(at, along, path_m[:, axis]) for axis in (0, 1)], axis=1)


class Driver:
    """Drives one robot; methods may be called from any thread, and return at once but for the rehearsal."""

    def __init__(
        self, source: RobotSource, simap: Callable[[], SIMap], watched: Callable[[], bool], *, allowed: bool
    ) -> None:
        """Take the robot.

        Args:
            source: the robot.
            simap: returns the newest map.
            watched: whether a page is open.
            allowed: --drive was given; otherwise nothing is ever sent.
        """
        self.allowed, self.switched = allowed, False
        self._source, self._simap, self._watched = source, simap, watched
        self._lock = threading.RLock()
        self._said = ""
        self._path: NDArray | None = None
        self._end: Pose2 | None = None
        self._done_m = self._sent_m = 0.0
        self._silent_s: float | None = None
        self._closed = threading.Event()
        self._make: Messages | None = None
        self._nav2, self._by_action = Nav2(source.link), False
        if allowed:
            for topic, kind in ((GOAL, GOAL_TYPE), (PATH, OUT[PATH])):  # with --no-publish nobody else announces paths
                source.link.advertise(topic, kind)
            threading.Thread(target=self._run, name="drive", daemon=True).start()

    def words(self) -> str:
        """Describe what the robot does, or why it does not."""
        nav2 = self._nav2
        if not self._by_action:
            return self._said
        freed = f"It has had to free itself {nav2.recoveries} times." if nav2.recoveries else ""
        unsure = "" if nav2.settle(0.0) else "Nav2 has not confirmed it yet."
        return " ".join(filter(None, (self._said, freed, unsure, nav2.trouble)))

    def switch(self, on: bool) -> None:
        """Allow driving, or stop."""
        with self._lock:
            self.switched = on and self.allowed
            if not on and self._path is not None:
                self.stop()

    def go(self, command: str) -> None:
        """Rehearse a command on the map, and let the robot drive its path."""
        with self._lock:
            refusal = self._refusal()
            if refusal:
                self._said = refusal
                return
            pose = self._pose()
            simap = self._simap()
        assert pose is not None
        self._said = "Rehearsing …"
        try:
            found = answer(simap, command, pose)
        except SIMapsError as error:
            self._said = str(error)
            return
        with self._lock:
            # The rehearsal has taken time: everything is asked again before the first goal.
            refusal = self._refusal()
            if refusal or found.status != "ok" or len(found.path_m) < 2:
                self._said = refusal or outcome_text(found)
                return
            self._make = messages_for(self._source, simap.T_map_world)
            assert self._make is not None
            self._path, self._end = resampled(np.asarray(found.path_m)), found.final_pose
            self._done_m, self._sent_m, self._silent_s = 0.0, 0.0, None
            self._nav2.replace()
            self._by_action = self._nav2.is_there
            self._source.link.publish(PATH, self._make.path(self._path))
            self._said = f"Driving: {outcome_text(found)}"
            self._advance()

    def stop(self) -> None:
        """Stop: no goal follows, and those of the action are cancelled; without it its own place becomes its goal."""
        with self._lock:
            self._path = None
            pose, make, nav2 = self._pose(), self._make, self._nav2
            if make is None:
                return
            nav2.stop()
            if self._by_action:
                stopped = not self._source.link.state
            else:
                stopped = pose is not None and self._source.link.publish(GOAL, make.goal(pose))
            self._said = "Stopped." if stopped else f"Stopped: it ends at the last goal it has, within {LEASH_M:g} m."

    def close(self) -> None:
        """Stop for good."""
        if self._path is not None:
            self.stop()
        self._closed.set()
        self._nav2.settle(SETTLE_S)

    def _run(self) -> None:
        while not self._closed.wait(TICK_S):
            with self._lock:
                self._nav2.catch_up()
                if self._path is not None:
                    self._tick()

    def _tick(self) -> None:
        refusal, now_s = self._refusal(), time.monotonic()
        if not refusal:
            self._silent_s = None
        elif self._silent_s is None:
            self._silent_s, self._said = now_s, f"Waiting: {refusal}"  # the robot ends at the goal that it has
        elif now_s - self._silent_s > LOST_S:
            self.stop()
            self._said = f"Stopped: {refusal}"
        if refusal:
            return
        self._advance()

    def _advance(self) -> None:
        """Send the next goal on the path, where the robot is close enough to the last one."""
        pose, path, end, make = self._pose(), self._path, self._end, self._make
        if pose is None or path is None or end is None or make is None:
            return
        at = np.array([pose.x_m, pose.y_m])
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        near = (along >= self._done_m - STEP_M) & (along <= self._done_m + LEASH_M)
        off_m = np.where(near, np.linalg.norm(path - at, axis=1), np.inf)
        closest = int(off_m.argmin())
        if off_m[closest] > STRAYED_M:
            self.stop()
            self._said = "Stopped: the robot has left its path."
            return
        self._done_m = max(self._done_m, float(along[closest]))
        total_m = float(along[-1])
        ended = self._nav2.ended() if self._by_action else None
        if ended:
            self.stop()
            self._said = f"Stopped: {ended}"
            return
        arrived = ended == "" if self._by_action else np.linalg.norm(path[-1] - at) <= ARRIVED_M
        if self._sent_m >= total_m and arrived:
            self._path, self._said = None, "Arrived."
            return
        next_m = min(self._done_m + LEASH_M, total_m)
        if next_m >= self._sent_m + STEP_M or (next_m >= total_m > self._sent_m) or not self._sent_m:
            x, y = (float(np.interp(next_m, along, path[:, axis])) for axis in (0, 1))
            before = max(int(np.searchsorted(along, next_m)) - 1, 0)
            ahead = path[min(before + 1, len(path) - 1)] - path[before]
            goal = end if next_m >= total_m else Pose2(x, y, float(np.arctan2(ahead[1], ahead[0])))
            data = make.goal(goal)
            sent = self._nav2.send(data) if self._by_action else self._source.link.publish(GOAL, data)
            self._sent_m = next_m if sent else self._sent_m

    def _refusal(self) -> str:
        """Return why nothing may be sent now; "" = it may."""
        if not self.allowed:
            return "The robot is not driven: simaps live was started without --drive."
        if not self.switched:
            return "The switch is off."
        if self._source.link.state:
            return f"No connection to the robot ({self._source.link.state})."
        if not self._watched():
            return "No page is open."
        if self._pose() is None:
            return f"No pose of the robot younger than {FRESH_S:g} s."
        return ""

    def _pose(self, fresh_s: float = FRESH_S) -> Pose2 | None:
        """Return where the robot is on the map; None where that is not known, or older than so many seconds."""
        robot = self._source.robot()
        if robot is None or robot[2] > fresh_s:
            return None
        T = self._simap().T_map_world @ robot[1]
        return Pose2(float(T[0, 3]), float(T[1, 3]), float(np.arctan2(T[1, 0], T[0, 0])))


ACTION = "/navigate_to_pose/_action"
SEND, CANCEL, RESULT, STATUS, FEEDBACK = (
    f"{ACTION}/{name}" for name in ("send_goal", "cancel_goal", "get_result", "status", "feedback")
)
SEND_TYPE = "nav2_msgs::action::dds_::NavigateToPose_SendGoal_"
SEND_HASHES = ("RIHS01_a4fcb3bee1bf32e21a0e541a943b221aa0826996e2c98f079b47022b256f48b5", "TypeHashNotSupported")
"""Of the goal as Nav2 has it from Humble on; a goal of another form is not sent. Humble announces no hashes."""
STATUS_TYPE = "action_msgs/msg/GoalStatusArray"
ASKED, ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED, REJECTED = range(8)
"""States of a goal: those of action_msgs/GoalStatus from 1 to 6, and two of ours."""
ANSWER_S = 2.0
"""A goal whose answer takes longer ends the ride."""
LATE_S = 600.0
"""An answer that comes so late is still heard, so that its goal can be cancelled."""
CANCEL_S = 2.0
"""A cancel without an answer for so long is sent again."""
CANCEL_REJECTED = 1
MAX_TEXT = 200


@dataclass(eq=False)
class _Goal:
    state: int = ASKED
    wanted: bool = True
    cancelled: bool = False
    """A cancel is on its way, or answered."""
    why: str | None = None
    """Why it was given up, once that is known."""
    asked_s: float = field(default_factory=time.monotonic)

    @property
    def is_over(self) -> bool:
        return self.state >= SUCCEEDED


class Nav2:
    """The client of one robot's NavigateToPose; methods may be called from any thread, and do not wait."""

    def __init__(self, link: RobotLink) -> None:
        """Listen to what the action says of its goals."""
        self._link, self._types = link, message_types()
        self._changed = threading.Condition(threading.RLock())
        self._goals: dict[bytes, _Goal] = {}
        self._newest = b""
        self.recoveries = 0
        """How often the robot had to free itself on the way to its goal."""
        self.trouble = ""
        """What a person has to know of a cancel, in words."""
        link.listen(STATUS, self._take_status)
        link.listen(FEEDBACK, self._take_feedback)

    @property
    def is_there(self) -> bool:
        """Whether the robot announces the action, in a form that is known, and can cancel."""
        services = self._link.services
        return CANCEL in services and SEND in services and services[SEND] in ((SEND_TYPE, one) for one in SEND_HASHES)

    def send(self, pose: bytes) -> bool:
        """Send a goal, a PoseStamped as CDR; False while the answer to the one before is awaited, or unconnected."""
        with self._changed:
            before = self._goals.get(self._newest)
            if before is not None and before.wanted and before.state == ASKED:
                return False
            goal_id, newest = os.urandom(16), self._newest
            self._goals[goal_id], self._newest = _Goal(), goal_id
            # The id's 16 bytes leave the pose aligned as it is; an empty string means the usual behaviour tree.
            request = pose[:4] + goal_id + pose[4:] + struct.pack("<Ix", 1)
            if not self._link.call(SEND, request, lambda data: self._answered(goal_id, data), LATE_S):
                del self._goals[goal_id]
                self._newest = newest
                return False
            self.recoveries, self.trouble = 0, ""
            return True

    def replace(self) -> None:
        """Begin a new ride: what was asked for and is not accepted yet is not wanted, and Nav2 gives up the rest."""
        with self._changed:
            self._newest = b""
            for goal in self._goals.values():
                goal.wanted &= goal.state != ASKED

    def stop(self) -> None:
        """Cancel what was accepted now, and what is accepted later as soon as it is."""
        with self._changed:
            for goal in self._goals.values():
                goal.wanted = False
            self.catch_up()

    def catch_up(self) -> None:
        """Send the cancels that could not be sent before, for want of a connection or of an answer."""
        with self._changed:
            for goal_id, goal in list(self._goals.items()):
                if not goal.wanted and ACCEPTED <= goal.state <= EXECUTING and not goal.cancelled:
                    request = b"\0\1\0\0" + goal_id + bytes(8)  # no time: this goal alone, whenever it was accepted
                    take = lambda data, goal_id=goal_id: self._cancel_answered(goal_id, data)  # noqa: E731
                    goal.cancelled = self._link.call(CANCEL, request, take, CANCEL_S)

    def settle(self, timeout_s: float) -> bool:
        """Wait until no goal is left that has to be cancelled; False when that took too long."""
        with self._changed:
            return self._changed.wait_for(
                lambda: all(goal.wanted or goal.is_over or goal.state == CANCELING for goal in self._goals.values()),
                timeout_s,
            )

    def ended(self) -> str | None:
        """Return how the newest goal has ended: "" = it was reached, else why not; None = not yet."""
        with self._changed:
            goal = self._goals.get(self._newest)
            if goal is None or (goal.state == ABORTED and goal.why is None):
                return None
            if goal.state == ASKED and time.monotonic() - goal.asked_s > ANSWER_S:
                return "Nav2 does not answer."
            return {
                SUCCEEDED: "", CANCELED: "the goal was cancelled on the robot.", REJECTED: "Nav2 refuses the goal.",
                ABORTED: f"Nav2 has given up{goal.why}.",
            }.get(goal.state)  # fmt: skip

    def _answered(self, goal_id: bytes, data: bytes | None) -> None:
        """Take the answer to a goal; without one only the status can tell that it was accepted."""
        with self._changed:
            if data is not None and len(data) > 4:
                self._now(goal_id, ACCEPTED if data[4] == 1 else REJECTED)

    def _now(self, goal_id: bytes, state: int) -> None:
        """Take note of a goal's state; states only go forward."""
        goal = self._goals.get(goal_id)
        if goal is None or state <= goal.state:
            return
        first, goal.state = goal.state == ASKED, state
        if first and state != REJECTED and goal_id == self._newest and goal.wanted:
            # Nav2 has given up the goals before; of those only what may still be accepted has to be cancelled.
            self._goals = {one: g for one, g in self._goals.items() if one == goal_id or g.state == ASKED}
        if state == ABORTED and goal.wanted and goal_id == self._newest:
            take = lambda data: self._take_result(goal, data)  # noqa: E731
            if not self._link.call(RESULT, b"\0\1\0\0" + goal_id, take, ANSWER_S):
                goal.why = ""
        if goal.is_over and not goal.wanted:
            del self._goals[goal_id]
        self.catch_up()
        self._changed.notify_all()

    def _cancel_answered(self, goal_id: bytes, data: bytes | None) -> None:
        with self._changed:
            goal = self._goals.get(goal_id)
            if goal is None:
                return
            if data is None or len(data) < 5:
                goal.cancelled = False
            elif data[4] == CANCEL_REJECTED:
                self.trouble = "Nav2 refuses to cancel: use the robot's own stop."
                self._now(goal_id, CANCELING)  # all that can be done
            else:
                self._now(goal_id, CANCELING if data[4] == 0 else CANCELED)  # else it is unknown, or over already

    def _take_status(self, data: bytes) -> None:
        try:
            found = [(bytes(one.goal_info.goal_id.uuid), int(one.status))
                     for one in self._types.deserialize_cdr(data, STATUS_TYPE).status_list]  # fmt: skip
        except Exception:  # unpackers may raise anything on malformed messages
            return
        with self._changed:
            for goal_id, state in found:
                if ACCEPTED <= state <= ABORTED:
                    self._now(goal_id, state)

    def _take_feedback(self, data: bytes) -> None:
        """Read the number of recoveries; what follows it differs between versions."""
        try:
            (length,) = struct.unpack_from("<I", data, 28)  # after the id, and the time of the current pose
            at = -(-(28 + length) // 8) * 8 + 4 + 56 + 16  # of its frame's name; the pose; two durations
            (recoveries,) = struct.unpack_from("<h", data, at)
        except struct.error:
            return
        with self._changed:
            if data[4:20] == self._newest:
                self.recoveries = recoveries

    def _take_result(self, goal: _Goal, data: bytes | None) -> None:
        with self._changed:
            goal.why = goal.why or error_of(data or b"")


def error_of(data: bytes) -> str:
    """Return why a goal was given up, of a GetResult response: " (error 9002: …)".

    Humble says nothing, Iron a number, and Nav2 since then a text, too: each version has added to the end.
    """
    if len(data) < 8:
        return ""
    (code,) = struct.unpack_from("<H", data, 6)
    if len(data) < 12:
        return f" (error {code})"
    (length,) = struct.unpack_from("<I", data, 8)
    text = data[12 : 12 + min(length, MAX_TEXT)].rstrip(b"\0").decode(errors="replace")
    return f" (error {code}: {''.join(one for one in text if one.isprintable())})"
