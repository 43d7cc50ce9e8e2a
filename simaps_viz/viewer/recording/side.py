"""What a recorded build may ask of the page beside it, and do there."""

from typing import TYPE_CHECKING, Any

from simaps_viz.viewer.recording.clicks import clicked_place
from simaps_viz.viewer.recording.link import PageSide

if TYPE_CHECKING:
    from simaps_viz.viewer.session import Session


def page_side(session: "Session") -> PageSide:
    """Tie a recording to a page: frames, steps and clicks."""

    def show_frame(frame: int) -> None:
        session.parts.build.set_frame(frame)

    def show_step(timeline: str, time: int) -> None:
        if session.simap.merges is session.common.recorded.merges:
            steps = session.common.shared.timeline(session.simap)
            session.parts.steps.choose(steps.position_of(timeline, time), chosen_here=False)

    def select(items: list[dict[str, Any]]) -> None:
        """Select what was clicked in the recorded build, where that is something of the map."""
        common = session.common
        divide = common.services.picture_divide
        place = clicked_place(items, common.recorded, session.frame, view=session.view, divide=divide)
        if place is not None and session.simap.at(*place) is not None:
            session.pick(place)

    return PageSide(
        frame=lambda: session.frame,
        frames=lambda: len(session.simap.frame_names),
        set_frame=show_frame,
        clicked=lambda items: session.worker.submit("recording click", lambda: select(items)),
        set_step=show_step,
        building=lambda: session.common.building,
    )
