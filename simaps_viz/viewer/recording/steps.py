"""Which time of a recorded build shows a position on a page's timeline, and the other way round."""

from dataclasses import dataclass

import numpy as np

from simaps_viz.mapping.timeline import CLASSES, Timeline


@dataclass(frozen=True, eq=False)
class RecordedSteps:
    """The steps that a recording has. A page may show the map cut otherwise, whose steps are others."""

    timeline: Timeline
    """Of the map whose build was recorded."""
    levels: int | None = None
    """At which time of "louvain" it has the final communities; None = after as many levels as there are."""

    def time_of(self, page: Timeline, position: int) -> tuple[str, int] | None:
        """Give the timeline of the recording that shows a position of the page's, and its time; None = there is none.

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
        """Give the position of a time of the recording; None = the page has none."""
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
