"""One page's tie to its docked recording: the same frame in both, and clicks."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.mapping.why import Joint, recorded_step
from simaps_viz.structures import SIMap
from simaps_viz.viewer.panels.build import FrameLink
from simaps_viz.viewer.server.host import Host


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
