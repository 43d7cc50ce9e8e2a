"""What a page shows of the build: a frame, a step of joining, or the finished map, and never two at once."""

from dataclasses import dataclass

import numpy as np

from simaps_viz.colors.instances import keep_classes, take_over
from simaps_viz.drawing.legend import counts_text
from simaps_viz.mapping.timeline import CLASSES
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.shared import Shared

NO_HISTORY = (
    "No history of this map is at hand, so objects appear when first named. It is there after building with --history,"
    " or once a build that is watched is done."
)


@dataclass(frozen=True)
class TimeStep:
    """Where the page is on its two timelines."""

    frame: int
    """Index of the frame of the build."""
    step: int | None = None
    """Position on the `Timeline` of joining, of the finished map; None = the finished map."""


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
