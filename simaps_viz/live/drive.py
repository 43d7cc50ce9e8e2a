"""Lets the real robot drive where a command leads, if a person allows it twice: by --drive and by the page's switch.

The command is rehearsed on the map first. The robot then gets goals that lie at most `LEASH_M` ahead of it on the
rehearsed path, one after the other, as it comes closer: so a robot that loses us stops at the next of them. They are
goals of Nav2's action NavigateToPose where the robot announces it and the link can call it, and else on `GOAL`. The
robot's own navigation avoids obstacles and limits speed; velocities are never published.
"""

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import SIMapsError
from simaps_viz.live.nav2 import Nav2
from simaps_viz.live.out import GOAL, GOAL_TYPE, OUT, PATH, Messages, messages_for
from simaps_viz.live.robot import RobotSource
from simaps_viz.navigation.agent import answer, outcome_text
from simaps_viz.structures import Pose2, SIMap

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
