"""One page's tie to its docked recording: the same frame in both, and clicks."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simaps_viz.mapping.explain import Joint, recorded_step
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.mapping.timeline import CLASSES, Timeline
from simaps_viz.structures import SIMap
from simaps_viz.viewer.panels.build import FrameLink
from simaps_viz.viewer.recording.clicks import clicked_place, in_a_view
from simaps_viz.viewer.server.host import Host

if TYPE_CHECKING:
    from simaps_viz.viewer.session import Session


@dataclass(frozen=True, eq=False)
class RecordedSteps:
    """The steps that a recording has. A page may show the map cut otherwise, whose steps are others."""

    timeline: Timeline
    """Of the map whose build was recorded."""
    levels: int | None = None
    """At which time of "louvain" it has the final communities; None = after as many levels as there are."""

    def time_of(self, page: Timeline, position: int) -> tuple[str, int] | None:
        """Return the timeline of the recording that shows a position of the page's, and its time; None = there is none.

        Every map begins with the same classes.
        """
        if position <= CLASSES:
            return "louvain", CLASSES
        if page.simap.merges is not self.timeline.simap.merges:
            return None
        if position > page.levels:
            return page.recorded(position) if self._same_done(page, position) else None
        if position == page.levels:
            return "louvain", self._levels
        return page.recorded(position) if page.levels == self._levels else None

    def position_of(self, page: Timeline, timeline: str, time: int) -> int | None:
        """Return the position of a time of the recording; None = the page has none."""
        if timeline == "louvain" and time <= 0:
            return CLASSES
        at_last = timeline == "louvain" and time >= self._levels
        position = page.levels if at_last else page.position_of(timeline, time)
        return position if self.time_of(page, position) is not None else None

    @property
    def _levels(self) -> int:
        return self.timeline.levels if self.levels is None else self.levels

    def _same_done(self, page: Timeline, position: int) -> bool:
        return np.array_equal(page.done_at(position), self.timeline.done_at(position))


@dataclass(frozen=True)
class PageSide:
    """What the link asks of the page, and tells it; none of these may take long."""

    frame: Callable[[], int]
    """The frame that the page shows."""
    frames: Callable[[], int]
    """How many there are."""
    set_frame: Callable[[int], None]
    """The recording shows another frame."""
    clicked: Callable[[list[dict[str, Any]]], None]
    """Something was clicked in the recording: the items of rerun's ``selection_change``."""
    set_step: Callable[[str, int], None] = lambda timeline, time: None
    """The recording shows a time of another timeline, "louvain" or "merge"."""
    building: Callable[[], bool] = lambda: False
    """The build goes on: the recording runs ahead, and nothing ties the two."""


class RecordingLink:
    """Carries messages between a page and the frame that holds its recording; without a host it does nothing."""

    def __init__(self, host: Host | None, session: str, page: PageSide) -> None:
        """Take where the recording is served, and the session that its address names."""
        self._host, self._session, self._page = host, session, page
        self._link = FrameLink(lambda frame: self._send("frame", frame))
        self._foreign = False
        self.on_switch: Callable[[bool], None] = lambda foreign: None
        """Told whether the build of another map is shown now."""

    @property
    def url(self) -> str | None:
        """Address of the recording for this page; None when there is none."""
        return None if self._host is None else self._host.url_for(self._session)

    @property
    def tied(self) -> bool:
        """Page and recording go together: it is the build of this map, and it is done."""
        return self._host is not None and not self._foreign and not self._page.building()

    def show(self, path: Path | None) -> None:
        """Show another recording in the place of this map's, or this map's own again (None).

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
        """Show a frame in the recording."""
        if self.tied:
            self._link.push(frame)

    def show_step(self, timeline: str, time: int) -> None:
        """Show a time of timeline "louvain" or "merge" in the recording."""
        if self.tied:
            self._send(timeline, time)

    def show_joint(self, joint: Joint, recorded: SIMap) -> None:
        """Go to a step of the recorded map's merge log."""
        applied = applied_steps(recorded.merges, joining_threshold(recorded.method, recorded.parameters))
        self.show_step("merge", recorded_step(joint, applied))

    def opened(self) -> None:
        """The recording begins to listen: bring it to the page's frame."""
        if self.tied:
            self._link.opened(self._page.frame())
        elif not self._foreign:
            self._push({"set_time": {"timeline": "frame", "play": "following"}})

    def said(self, event: dict[str, Any]) -> None:
        """Take what the recording tells.

        A recording that has just been opened, or has changed its timeline, starts where it likes: it is told the
        page's frame instead. What a stream that was followed tells late is nobody's scrubbing.
        """
        if not self.tied:
            # A streamed one has no time yet when it opens, and cannot follow; it has once it tells of its timeline.
            if event.get("type") == "recording_open" or _comes_to_frames(event):
                self.opened()
            return
        kind, timeline = event.get("type"), event.get("timeline")
        on_frames = timeline in ("frame", None)
        if kind == "recording_open" or (kind == "timeline_change" and on_frames):
            self.opened()
        elif kind == "selection_change" and isinstance(event.get("items"), list):
            self._page.clicked([item for item in event["items"] if isinstance(item, dict)])
        elif kind == "time_update" and isinstance(event.get("time"), int | float) and not event.get("following"):
            self._time_told(timeline, int(event["time"]))

    def close(self) -> None:
        """End the connection over which the recording listens."""
        if self._host is not None:
            self._host.hang_up(self._session)

    def _time_told(self, timeline: Any, time: int) -> None:
        if timeline in ("louvain", "merge"):
            self._page.set_step(timeline, time)
        elif (
            timeline in ("frame", None)
            and 0 <= time < self._page.frames()
            and self._link.accept(time, self._page.frame())
        ):
            self._page.set_frame(time)

    def _send(self, timeline: str, time: int) -> None:
        self._push({"set_time": {"timeline": timeline, "time": time}})

    def _push(self, message: dict[str, Any]) -> None:
        if self._host is not None:
            self._host.push(message, self._session)


def _comes_to_frames(event: dict[str, Any]) -> bool:
    return event.get("type") == "timeline_change" and event.get("timeline") == "frame"


NOTHING_THERE = ("Recorded build", "There is no object of the map where you clicked.")
NO_SUCH_STEP = " The recorded build on the left has no such step: it stays where it is."


def page_side(session: "Session") -> PageSide:
    """Tie a recording to a page: frames, steps and clicks."""

    def show_frame(frame: int) -> None:
        session.parts.build.set_frame(frame)

    def show_step(timeline: str, time: int) -> None:
        position = _recorded_steps(session).position_of(session.common.shared.timeline(session.simap), timeline, time)
        if position is not None:
            session.parts.steps.choose(position, chosen_here=False)

    def select(items: list[dict[str, Any]]) -> None:
        """Select what was clicked in the recorded build, or say that it is nothing of the map."""
        common = session.common
        divide = common.services.picture_divide
        place = clicked_place(items, common.recorded, session.frame, view=session.view, divide=divide)
        if place is not None and session.simap.at(*place) is not None:
            session.pick(place)
        elif in_a_view(items):
            session.say(*NOTHING_THERE)

    return PageSide(
        frame=lambda: session.frame,
        frames=lambda: len(session.simap.frame_names),
        set_frame=show_frame,
        clicked=lambda items: session.worker.submit("recording click", lambda: select(items)),
        set_step=show_step,
        building=lambda: session.common.building,
    )


def show_step_beside(session: "Session", position: int) -> None:
    """Show a position of the page's timeline in the recording too, where it has it."""
    time = _time_beside(session, position)
    if time is not None:
        session.recording.show_step(*time)


def words_beside(session: "Session", position: int) -> str:
    """Why the recording does not show a position of the page's timeline; empty where it does, or there is none."""
    return NO_SUCH_STEP if session.recording.tied and _time_beside(session, position) is None else ""


def _time_beside(session: "Session", position: int) -> tuple[str, int] | None:
    return _recorded_steps(session).time_of(session.common.shared.timeline(session.simap), position)


def _recorded_steps(session: "Session") -> RecordedSteps:
    common = session.common
    return RecordedSteps(common.shared.timeline(common.recorded), common.services.recorded_levels)
