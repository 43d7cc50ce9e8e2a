"""Sends goals to Nav2 as its action NavigateToPose, over a link that can call services (rmw_zenoh).

An action is three services and two topics below its name: send_goal (goal's id, pose, behaviour tree: accepted or not),
cancel_goal, get_result, and status and feedback. Each goal is sent once, with an id of its own; Nav2 gives up a goal
when the next one comes. A goal that nobody wants any more is cancelled as soon as it is known to have been accepted.
"""

import os
import struct
import threading
import time
from dataclasses import dataclass, field

from simaps_viz.live.robot import RobotLink, message_types

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
