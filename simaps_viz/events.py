"""The events of a build, in the order they happen. Observers only watch: nothing they do changes the map."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from numpy.typing import NDArray

from simaps_viz.structures import Frame, Grid, MergeLog, Segmentation, SIMap

Progress = Callable[[str, int, int], None]
"""Called with (stage, steps done, steps in all) by the working thread; an exception it raises ends the work."""


@dataclass(frozen=True, eq=False)
class BuildStarted:
    """The sequence is open and checked; no frame has been read."""

    name: str
    frame_names: tuple[str, ...]
    T_map_world: NDArray
    segmentation_source: str
    """Origin of the masks in words, e.g. "renderer" or "simulated network errors, light, seed 0"."""
    simulated: bool
    """The segmentation (or the frames) are simulated and must be labelled so wherever they are shown."""


@dataclass(frozen=True, eq=False)
class FrameProjected:
    """One frame is on the grid."""

    frame: Frame
    segmentation: Segmentation
    T_map_camera: NDArray
    cells: NDArray
    """int32 [n, 2], (row, col) on the grid ``snapshot`` gives now: the cells this frame saw."""
    new_edges: NDArray
    """int32 [m, 4], (row_a, col_a, row_b, col_b) of cell pairs first linked by this frame, same grid."""
    new_edge_labels: NDArray
    """int16 [m], class index of each."""
    snapshot: Callable[[], Grid]
    """Copies the map as it is now; call it before returning."""
    map_so_far: Callable[[], SIMap | None] | None = None
    """Computes the complete map of the frames so far, as a build of these alone would (0.05 to 0.1 s for a flat); call
    it before returning. None where the method cannot. A live map is that of the frames a moment ago, and None before
    the first is made."""
    kept: bool = True
    """False: a live frame that shows only what is free and what is not, and is none of the map's."""


@dataclass(frozen=True, eq=False)
class FrameSkipped:
    """One frame could not be read and is left out."""

    index: int
    name: str
    reason: str
    """Why, naming the file."""


@dataclass(frozen=True, eq=False)
class FrameGathered:
    """One frame that another process has read is on the grid; its images are not in this process."""

    index: int
    name: str


@dataclass(frozen=True, eq=False)
class CommunitiesFound:
    """The finest communities are found: at intervals while building (``final`` False) and once at the end.

    Methods evidence and paper find them with Louvain, and join them afterwards; with other methods each is an instance.
    """

    grid: Grid
    community: NDArray
    """int32 [rows, cols], 0 = none."""
    frame_index: int
    """The last frame that is on the map."""
    final: bool
    instance: NDArray | None = None
    """int32 [rows, cols], 0 = none: the instances at the chosen K or affinity; None unless they are computed."""


@dataclass(frozen=True, eq=False)
class MergesFound:
    """The complete merge log, and which of its steps the map takes.

    It goes down to K = 0 (method paper) or affinity 0 (method evidence); the log of other methods is empty.
    """

    grid: Grid
    community: NDArray
    """int32 [rows, cols], finest communities, 0 = none."""
    log: MergeLog
    applied: NDArray
    """bool [steps]: whether the step is taken at the chosen K or affinity, which take a prefix of each class."""


@dataclass(frozen=True, eq=False)
class BuildFinished:
    """The map is done."""

    simap: SIMap


Event = (
    BuildStarted | FrameProjected | FrameGathered | FrameSkipped | CommunitiesFound | MergesFound | BuildFinished
)  # fmt: skip


class Observer(Protocol):
    """Something that watches a build: the recorder, a progress bar, the viewer."""

    @property
    def wants_color(self) -> bool:
        """Whether it uses the frames' colours, which are decoded only for observers that do.

        Such an observer gets every frame, with the links it makes: a resumed build reads all frames again for it, and
        no other process may gather them. An observer without this property is taken to want them.
        """
        ...

    def on_event(self, event: Event) -> None:
        """Take one event; called in order, from the building thread."""
        ...


def notify(observers: Iterable[Observer], event: Event) -> None:
    """Notify observers of an event, in order."""
    for observer in observers:
        observer.on_event(event)


def wants_color(observers: Iterable[Observer]) -> bool:
    """Whether one of the observers wants the frames' colours, see `Observer.wants_color`."""
    return any(getattr(observer, "wants_color", True) for observer in observers)
