"""The link between a page and its docked recorded build: both show the same frame and step, and share clicks."""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.mapping.explain import Joint, recorded_step
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.mapping.timeline import CLASSES, Timeline
from simaps_viz.recorder.settings import SMALL
from simaps_viz.structures import SIMap
from simaps_viz.viewer.server.host import Host

if TYPE_CHECKING:
    from simaps_viz.viewer.page.page import Page

ECHO_S = 1.5
"""For how long a frame that was sent to the recorded build may come back as an echo."""
SETTLE_S = 10.0
"""For how long after a recorded build opened its own jump to the first frame is undone."""
NOTHING_THERE = ("Recorded build", "There is no object of the map where you clicked.")
NO_SUCH_STEP = " The recorded build has no such step: it stays where it is."
PICTURES = {
    "/world/camera/color": SMALL.color_divide,
    "/world/camera/segmentation": SMALL.segmentation_divide,
}
"""Pictures in which a click has a position, and how many times smaller than the frame they are."""
OBJECTS = ("/world/objects", "/map/names")
"""Entities whose instances are those of the finished map, in its order."""
ON_MAP = "/map/"
IN_ROOM = ("/world/cells", "/world/points", "/world/surface")


def position_inside(simap: SIMap, instance_id: int) -> tuple[float, float]:
    """Return the centre of the instance's cell that lies nearest to its middle, map frame, metres.

    Raises:
        InputError: there is no such instance.
    """
    row, col = np.nonzero(simap.instance == simap.by_id(instance_id).id)
    middle = int(np.argmin(np.hypot(row - row.mean(), col - col.mean())))
    return simap.spec.centre_of(float(row[middle]), float(col[middle]))


def clicked_position(
    items: Sequence[Mapping[str, Any]],
    simap: SIMap,
    frame: int,
    *,
    view: Callable[[int], tuple[NDArray, NDArray] | None],
) -> tuple[float, float] | None:
    """Return the position on the map that was clicked in the recorded build.

    Args:
        items: of a ``selection_change`` event of rerun's web viewer.
        simap: the map that was recorded.
        frame: the frame that the recorded build shows.
        view: frame index -> (RGB, segment ids) or None.

    Returns:
        (x, y), map frame, metres; None when nothing of the map was clicked.
    """
    for item in items:
        path, position = str(item.get("entity_path", "")), item.get("position")
        index = item.get("instance_id")
        if path in OBJECTS and isinstance(index, int) and 0 <= index < len(simap.instances):
            return position_inside(simap, simap.instances[index].id)
        numbers = position if isinstance(position, list) and len(position) == 3 else [None, None, None]
        x, y, z = (float(v) if isinstance(v, int | float) else None for v in numbers)
        if x is None or y is None:
            continue
        if path.startswith(ON_MAP):
            return x, -y  # rerun's pictures of the map have y down
        if path in IN_ROOM and z is not None:
            return x, y
        if z is None and path in PICTURES:
            found = _instance_in_picture(simap, frame, view(frame), (x * PICTURES[path], y * PICTURES[path]))
            if found:
                return position_inside(simap, found)
    return None


def in_a_view(items: Sequence[Mapping[str, Any]]) -> bool:
    """Whether something was clicked in a view of the recorded build, and not only chosen by its name."""
    return any(
        isinstance(item.get("position"), list) or (item.get("type") == "view" and not item.get("by_name"))
        for item in items
    )


def _instance_in_picture(
    simap: SIMap, frame: int, seen: tuple[NDArray, NDArray] | None, pixel: tuple[float, float]
) -> int:
    """Return the instance most of whose cells the segment at a pixel (u, v) named, or 0."""
    if seen is None:
        return 0
    (height, width), (rgb_height, rgb_width) = seen[1].shape, seen[0].shape[:2]
    u, v = int(pixel[0] * width / rgb_width), int(pixel[1] * height / rgb_height)
    if not (0 <= u < width and 0 <= v < height) or seen[1][v, u] == 0:
        return 0
    views = simap.views
    mine = (views.frame == frame) & (views.segment == seen[1][v, u])
    owner = np.zeros(int(max(simap.community.max(initial=0), views.community.max(initial=0))) + 1, np.int32)
    owner[simap.community] = simap.instance
    named = np.bincount(owner[views.community[mine]], views.cells[mine], minlength=2)
    named[0] = 0.0
    return int(named.argmax()) if named.any() else 0


class FrameLink:
    """Keeps the frame sliders of page and recorded build in step without a feedback loop.

    The page sends its frame to the recorded build; a frame reported back is taken over unless it only echoes what was
    sent.
    """

    def __init__(self, send: Callable[[int], None], clock: Callable[[], float] = time.monotonic) -> None:
        """Take the function that sends a frame to the recorded build."""
        self._send, self._clock = send, clock
        self._sent: deque[tuple[int, float]] = deque(maxlen=64)
        self._opened_s = float("-inf")

    def push(self, frame: int) -> None:
        """Show a frame in the recorded build."""
        self._sent.append((frame, self._clock()))
        self._send(frame)

    def opened(self, frame: int) -> None:
        """Move a recorded build that was just opened to the page's frame."""
        self._opened_s = self._clock()
        self.push(frame)

    def accept(self, reported: int, current: int, *, touched: bool = True) -> bool:
        """Whether a frame that the recorded build reports was chosen there, and is no echo.

        Args:
            reported: the frame.
            current: that of the page.
            touched: whether anybody has pressed anything there; a build that opens goes to the first frame by itself,
                on a machine with other work long after it opened.
        """
        now = self._clock()
        if reported == current or any(frame == reported and now - at < ECHO_S for frame, at in self._sent):
            return False
        if reported == 0 and (not touched or now - self._opened_s < SETTLE_S):
            self.push(current)
            return False
        self._opened_s = float("-inf")  # somebody scrubs
        return True


@dataclass(frozen=True, eq=False)
class RecordedSteps:
    """The steps that a recorded build has; a page may show the map cut otherwise, with other steps."""

    timeline: Timeline
    """The timeline of the map whose build was recorded."""
    levels: int | None = None
    """Time on "louvain" at which it has the final communities; None = after the last level."""

    def time_of(self, page: Timeline, position: int) -> tuple[str, int] | None:
        """Return the (timeline, time) of the recorded build that shows a position of the page's timeline; None = none.

        Every map begins with the same classes.
        """
        if position <= CLASSES:
            return "louvain", CLASSES
        if page.simap.merges is not self.timeline.simap.merges:
            return None
        if position > page.levels:
            same = np.array_equal(page.done_at(position), self.timeline.done_at(position))
            return page.recorded(position) if same else None
        if position == page.levels:
            return "louvain", self._levels
        return page.recorded(position) if page.levels == self._levels else None

    def position_of(self, page: Timeline, timeline: str, time: int) -> int | None:
        """Return the position on the page's timeline of a time of the recorded build; None = none."""
        if timeline == "louvain" and time <= 0:
            return CLASSES
        at_last = timeline == "louvain" and time >= self._levels
        position = page.levels if at_last else page.position_of(timeline, time)
        return position if self.time_of(page, position) is not None else None

    @property
    def _levels(self) -> int:
        return self.timeline.levels if self.levels is None else self.levels


class RecordingLink:
    """Carries messages between a page and the frame with its recorded build; without a host it does nothing."""

    def __init__(self, host: Host | None, session: str, page: "Page") -> None:
        """Take the host of the recorded build, the session named in its address, and the page it is docked to."""
        self._host, self._session, self._page = host, session, page
        self._link = FrameLink(lambda frame: self._send("frame", frame))
        self._foreign = False
        self.on_switch: Callable[[bool], None] = lambda foreign: None
        """Called with whether the build shown is that of another map."""

    @property
    def url(self) -> str | None:
        """Address of the recorded build for this page; None when there is none."""
        return None if self._host is None else self._host.url_for(self._session)

    @property
    def tied(self) -> bool:
        """Whether page and recorded build are linked: it is the build of this map, and it is done."""
        return self._host is not None and not self._foreign and not self._page.services.building

    def show(self, path: Path | None) -> None:
        """Show another recorded build instead of this map's own, or this map's own again (None).

        Raises:
            InputError: there is no such file.
        """
        if self._host is None:
            return
        address = self._host.front if path is None else self._host.offer(path)
        own = address == self._host.front
        if own and not self._foreign:
            return
        self._push({"show": address})
        self._foreign = not own
        self.on_switch(self._foreign)
        self.opened()

    def show_frame(self, frame: int) -> None:
        """Show a frame in the recorded build."""
        if self.tied:
            self._link.push(frame)

    def show_position(self, position: int) -> None:
        """Show a position of the page's timeline of joining in the recorded build, if it has it."""
        time = self._time_of(position) if self.tied else None
        if time is not None:
            self._send(*time)

    def words(self, position: int) -> str:
        """Explain that the recorded build lacks a position; empty where it has it, or there is none."""
        return NO_SUCH_STEP if self.tied and self._time_of(position) is None else ""

    def has_steps_of(self, simap: SIMap) -> bool | None:
        """Whether the recorded build has the steps of a map's merge log; None = there is no recorded build."""
        return None if self._host is None else simap.merges is self._page.workbench.recorded.merges

    def show_joint(self, joint: Joint) -> None:
        """Go to a step of the recorded map's merge log."""
        recorded = self._page.workbench.recorded
        applied = applied_steps(recorded.merges, joining_threshold(recorded.method, recorded.parameters))
        if self.tied:
            self._send("merge", recorded_step(joint, applied))

    def opened(self) -> None:
        """Move the recorded build, which listens from now on, to the page's frame."""
        if self.tied:
            self._link.opened(self._page.frame)
        elif not self._foreign:
            self._push({"set_time": {"timeline": "frame", "play": "following"}})

    def reported(self, event: dict[str, Any]) -> None:
        """Handle an event of the recorded build.

        A build that was just opened, or changed its timeline, starts at a frame of its own: it is sent the page's frame
        instead. Reports of a stream that is still followed were not chosen by anybody, and move nothing.
        """
        kind, timeline = event.get("type"), event.get("timeline")
        if not self.tied:
            # A streamed build has no time when it opens, and cannot follow; it has one once it reports its timeline.
            if kind == "recording_open" or (kind == "timeline_change" and timeline == "frame"):
                self.opened()
            return
        on_frames = timeline in ("frame", None)
        if kind == "recording_open" or (kind == "timeline_change" and on_frames):
            self.opened()
        elif kind == "selection_change" and isinstance(event.get("items"), list):
            items = [item for item in event["items"] if isinstance(item, dict)]
            self._page.worker.submit("recording click", lambda: self._select(items))
        elif kind == "time_update" and isinstance(event.get("time"), int | float) and not event.get("following"):
            self._time_reported(timeline, int(event["time"]), touched=event.get("touched") is not False)

    def close(self) -> None:
        """Close the connection to the recorded build."""
        if self._host is not None:
            self._host.push(None, self._session)

    def _time_reported(self, timeline: Any, time: int, *, touched: bool) -> None:
        if timeline in ("louvain", "merge"):
            shown = self._page.shared.timeline(self._page.simap)
            position = self._steps.position_of(shown, timeline, time)
            if position is not None:
                self._page.show_step(position, shown, also_recording=False)
        elif (
            timeline in ("frame", None)
            and 0 <= time < len(self._page.simap.frame_names)
            and self._link.accept(time, self._page.frame, touched=touched)
        ):
            self._page.show_frame(time, also_recording=False)

    def _select(self, items: Sequence[Mapping[str, Any]]) -> None:
        """Select the object that was clicked in the recorded build, or report that none was."""
        page = self._page
        position = clicked_position(items, page.workbench.recorded, page.frame, view=page.view)
        if position is not None and page.simap.at(*position) is not None:
            page.pick(position)
        elif in_a_view(items):
            page.say(*NOTHING_THERE)

    @property
    def _steps(self) -> RecordedSteps:
        timeline = self._page.shared.timeline(self._page.workbench.recorded)
        return RecordedSteps(timeline, self._page.services.recorded_levels)

    def _time_of(self, position: int) -> tuple[str, int] | None:
        return self._steps.time_of(self._page.shared.timeline(self._page.simap), position)

    def _send(self, timeline: str, time: int) -> None:
        self._push({"set_time": {"timeline": timeline, "time": time}})

    def _push(self, message: dict[str, Any]) -> None:
        if self._host is not None:
            self._host.push(message, self._session)
