"""Which time a page shows: one frame of the build, one step of joining, or the finished map, and never two at once."""

from typing import TYPE_CHECKING

from simaps_viz.mapping.why import Joint
from simaps_viz.viewer.moments import Moment, moment
from simaps_viz.viewer.recording.side import show_step_beside

if TYPE_CHECKING:
    from simaps_viz.viewer.session import Session


class PageTime:
    """Keeps the sliders, the camera of the frame, the recording and what is painted of one page together."""

    def __init__(self, session: "Session") -> None:
        """Take the page; nothing is done before it has its panels."""
        self._session = session

    def now(self) -> Moment:
        """Find what the page is to paint."""
        session = self._session
        step = session.parts.steps.step
        frame = session.parts.build.behind if step is None else None
        return moment(session.common.shared, session.simap, frame=frame, step=step)

    def show_frame(self, frame: int, chosen_here: bool) -> None:
        """The build panel shows another frame: the steps rest."""
        self._session.parts.steps.forget()
        if chosen_here:
            self._session.recording.show_frame(frame)
        self._stand_at(frame)

    def show_step(self, step: int, chosen_here: bool) -> None:
        """The panel of steps shows another one, which is of the finished map: the frames rest at the last."""
        session = self._session
        session.parts.build.rest()
        if chosen_here:
            show_step_beside(session, step)
        self._stand_at(session.frame)

    def show_joint(self, joint: Joint) -> None:
        """A step that made the selected object was chosen: it speaks of the finished map."""
        session = self._session
        self._rest()
        if session.simap.merges is session.common.recorded.merges:
            session.recording.show_joint(joint, session.common.recorded)

    def finish(self) -> None:
        """Show the finished map, here and in the recording; what plays stops, also what has yet to show anything."""
        build, steps = self._session.parts.build, self._session.parts.steps
        build.stop()
        steps.stop()
        if not build.at_end or steps.step is not None:
            build.set_frame(len(self._session.simap.frame_names) - 1, chosen_here=True)

    def _rest(self) -> None:
        """Show the finished map without a word to the recording."""
        self._session.parts.build.rest()
        self._session.parts.steps.forget()
        self._stand_at(self._session.frame)

    def _stand_at(self, frame: int) -> None:
        """Draw the camera of a frame, and what was known then; at the last one there is only the map."""
        session = self._session
        poses = session.simap.T_map_camera
        past = frame < min(len(session.simap.frame_names) - 1, len(poses))
        session.scene.show_camera(poses[frame] if past else None)
        session.parts.others.show_frame(frame)
        session.repaint()
