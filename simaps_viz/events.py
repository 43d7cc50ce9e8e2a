"""What a build tells those who watch it. Observers only look: nothing they do changes the map."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from numpy.typing import NDArray

from simaps_viz.structures import Frame, Grid, MergeLog, Segmentation, SIMap

Progress = Callable[[str, int, int], None]
"""Called with (what is being done, steps done, steps in all) by the thread that works; what it raises ends that."""


@dataclass(frozen=True, eq=False)
class BuildStarted:
    """The sequence is open and checked; no frame has been read."""

    name: str
    frame_names: tuple[str, ...]
    T_map_world: NDArray
    segmentation_source: str
    """In words, e.g. "renderer" or "simulated network errors, light, seed 0"."""
    simulated: bool
    """The segmentation (or the frames) are simulated and must be called so wherever shown."""


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
    map_so_far: Callable[[], SIMap] | None = None
    """Makes the whole map of the frames so far, as a build of these alone would (0.05 to 0.1 s for a flat); call it
    before returning. None where the method cannot."""


@dataclass(frozen=True, eq=False)
class FrameSkipped:
    """One frame could not be read and is left out."""

    index: int
    name: str
    reason: str
    """In words, naming the file."""


@dataclass(frozen=True, eq=False)
class FrameGathered:
    """One frame is on the grid that another process has read; its pictures are not here."""

    index: int
    name: str


@dataclass(frozen=True, eq=False)
class CommunitiesFound:
    """The finest communities are there: every so often while building (``final`` False) and once at the end.

    Methods evidence and paper find them with Louvain, and join them afterwards; of other methods each is an instance.
    """

    grid: Grid
    community: NDArray
    """int32 [rows, cols], 0 = none."""
    frame_index: int
    """The last frame it knows of."""
    final: bool
    instance: NDArray | None = None
    """int32 [rows, cols], 0 = none: the objects they make at the chosen K or affinity; None where nobody asked."""


@dataclass(frozen=True, eq=False)
class MergesFound:
    """The whole merge log, and how many steps of it the map takes.

    It goes down to K = 0 (method paper) or affinity 0 (method evidence); other methods join nothing, theirs is empty.
    """

    grid: Grid
    community: NDArray
    """int32 [rows, cols], finest communities, 0 = none."""
    log: MergeLog
    applied: NDArray
    """bool [steps]: belongs to the prefix, of each class, that the chosen K or affinity takes."""


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
        """Whether it looks at the frames' pictures: their colours are decoded only if somebody does.

        Who wants them is shown every frame, with the links it makes: a build that goes on with its log reads all frames
        again for it, and none may be gathered elsewhere. One that does not say is taken to want them.
        """
        ...

    def on_event(self, event: Event) -> None:
        """Take one event; called in order, from the building thread."""
        ...


def wants_color(observers: Iterable[Observer]) -> bool:
    """Return whether one of those who watch wants the frames' colours, see `Observer.wants_color`."""
    return any(getattr(observer, "wants_color", True) for observer in observers)
