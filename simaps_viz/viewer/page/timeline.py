"""The time step that a page shows: a frame of the build, a step of joining, or the finished map."""

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
class Snapshot:
    """A map at a time step, to be painted."""

    simap: SIMap
    until: int | None = None
    """Hide what no frame up to this one had named; used where no history is at hand."""
    classes_only: bool = False
    words: str = ""
    """Describes what the map showed then; empty for the finished map."""
    badge: str = ""
    """Marks a map that is not the finished one: "as of frame 178 of 200"; empty for the finished map."""


def snapshot_at(shared: Shared, simap: SIMap, *, frame: int | None, step: int | None) -> Snapshot:
    """Return a map as it was after a frame, or after a step of joining; the frame counts where both are given.

    Args:
        shared: computes earlier maps and timelines.
        simap: the finished map.
        frame: None = the last one.
        step: position on its `Timeline`; None = the finished map.
    """
    if frame is not None:
        badge = f"as of frame {frame + 1} of {len(simap.frame_names)}"
        look = shared.look_back(simap, frame)
        if look is None:
            return Snapshot(simap, until=frame, words=NO_HISTORY, badge=badge)
        keep_classes(look, simap)
        return Snapshot(look, words=then_text(look), badge=badge)
    if step is None:
        return Snapshot(simap)
    timeline = shared.timeline(simap)
    then = timeline.map_at(step)
    if then is not simap and then.community is not simap.community:
        take_over(then, simap)
    badge = "" if then is simap else timeline.name(step)
    return Snapshot(then, classes_only=step == CLASSES, badge=badge)


def ids_then(then: SIMap, now: SIMap, ids: frozenset[int]) -> frozenset[int]:
    """Return the instances of an earlier map that lie for the most part on given instances of the map of now."""
    if then.instance is now.instance or not ids:
        return ids if then.instance is now.instance else frozenset()
    size = np.bincount(then.instance.ravel())
    on_them = np.bincount(then.instance[np.isin(now.instance, sorted(ids))], minlength=len(size))
    size[0] = 0
    return frozenset(np.flatnonzero((2 * on_them > size) & (size > 0)).tolist())


def then_text(look: SIMap) -> str:
    """Describe an earlier map: its objects, and the area that was seen."""
    seen = float((~np.isnan(look.grid.height_m)).sum()) * look.spec.cell_size_m**2
    found = counts_text(look) if look.instances else "no instances yet"
    return f"{found} · {seen:.1f} m² seen"
