"""What a recorded build may ask of the page beside it, and do there."""

from typing import TYPE_CHECKING, Any

from simaps_viz.viewer.recording.clicks import clicked_place, in_a_view
from simaps_viz.viewer.recording.link import PageSide
from simaps_viz.viewer.recording.steps import RecordedSteps

if TYPE_CHECKING:
    from simaps_viz.viewer.session import Session


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
    """Say that the recording does not show a position of the page's timeline; empty where it does, or there is none."""
    return NO_SUCH_STEP if session.recording.tied and _time_beside(session, position) is None else ""


def _time_beside(session: "Session", position: int) -> tuple[str, int] | None:
    return _recorded_steps(session).time_of(session.common.shared.timeline(session.simap), position)


def _recorded_steps(session: "Session") -> RecordedSteps:
    common = session.common
    return RecordedSteps(common.shared.timeline(common.recorded), common.services.recorded_levels)
