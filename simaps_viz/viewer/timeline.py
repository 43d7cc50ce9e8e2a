"""Which time a page shows: one frame of the build, one step of joining, or the finished map, and never two at once."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simaps_viz.colors.instances import keep_classes, take_over
from simaps_viz.drawing.legend import counts_text
from simaps_viz.mapping.explain import Joint
from simaps_viz.mapping.timeline import CLASSES
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.shared import Shared
from simaps_viz.viewer.recording.link import show_step_beside

if TYPE_CHECKING:
    from simaps_viz.viewer.session import Session


NO_HISTORY = (
    "No history of this map is at hand, so objects appear when first named. It is there after building with --history,"
    " or once a build that is watched is done."
)


@dataclass(frozen=True, eq=False)
class Moment:
    """What to paint."""

    simap: SIMap
    until: int | None = None
    """Leave out what no frame up to this one had named, where the history is not at hand."""
    classes_only: bool = False
    words: str = ""
    """What was known then; empty for the finished map."""
    badge: str = ""
    """What the map is not to be taken for: "as of frame 178 of 200"; empty for the finished one."""


def moment(shared: Shared, simap: SIMap, *, frame: int | None, step: int | None) -> Moment:
    """Find what a map was after a frame, or is after a step; the frame counts where both are given.

    Args:
        shared: computes.
        simap: the finished map.
        frame: None = the last one.
        step: position on its `Timeline`; None = the finished map.
    """
    if frame is not None:
        badge = f"as of frame {frame + 1} of {len(simap.frame_names)}"
        look = shared.look_back(simap, frame)
        if look is None:
            return Moment(simap, until=frame, words=NO_HISTORY, badge=badge)
        keep_classes(look, simap)
        return Moment(look, words=then_text(look), badge=badge)
    if step is None:
        return Moment(simap)
    timeline = shared.timeline(simap)
    then = timeline.map_at(step)
    if then is not simap and then.community is not simap.community:
        take_over(then, simap)
    badge = "" if then is simap else f"at step {step} of {timeline.last}"
    return Moment(then, classes_only=step == CLASSES, badge=badge)


def then_text(look: SIMap) -> str:
    """Describe what was on a map at some time."""
    seen = float((~np.isnan(look.grid.height_m)).sum()) * look.spec.cell_size_m**2
    found = counts_text(look) if look.instances else "no instances yet"
    return f"{found} · {seen:.1f} m² seen"


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
