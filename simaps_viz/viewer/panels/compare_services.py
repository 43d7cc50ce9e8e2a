"""What the comparison on the page needs from the rest of the program: plain callables and plain data."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from numpy.typing import NDArray

from simaps_viz.events import Progress
from simaps_viz.structures import GridSpec, SIMap

Named = tuple[str, SIMap]
"""A map and what it is called on the page."""
TRUTH = "truth"
"""Key of the source that is the ground truth."""


class SideLike(Protocol):
    """One of two maps, on the window they share."""

    @property
    def title(self) -> str:
        """What it is called."""
        ...

    @property
    def colors(self) -> NDArray:
        """uint8 [rows, cols, 3], row 0 at the south."""
        ...

    @property
    def instance(self) -> NDArray:
        """int32 [rows, cols], 0 = none."""
        ...

    @property
    def ground(self) -> NDArray:
        """uint8 [rows, cols], what lies where no instance does: 0 unseen, 1 floor, 2 clutter, 3 wall."""
        ...

    @property
    def names(self) -> Mapping[int, str]:
        """{id: class and number among its class, such as "chair 4"}, of all instances."""
        ...

    @property
    def ignored(self) -> int:
        """Objects too small to be compared."""
        ...

    @property
    def least_cells(self) -> int:
        """An object with fewer cells is too small."""
        ...

    @property
    def count(self) -> int:
        """Instances on the map."""
        ...


class ItemLike(Protocol):
    """One difference."""

    @property
    def kind(self) -> str:
        """One of merged, split, missed, extra, label, outline."""
        ...

    @property
    def left(self) -> Sequence[int]:
        """Ids on the left map."""
        ...

    @property
    def right(self) -> Sequence[int]:
        """Ids on the right map."""
        ...

    @property
    def label(self) -> str:
        """Class on the reference."""
        ...

    @property
    def other_label(self) -> str:
        """Class on the other map."""
        ...

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax), map frame."""
        ...


class ScoreLike(Protocol):
    """How good a map is by the truth."""

    @property
    def pq(self) -> float | None:
        """Panoptic quality."""
        ...

    @property
    def true(self) -> int:
        """Objects asked for."""
        ...

    @property
    def found(self) -> int:
        """Objects on the map that count."""
        ...

    @property
    def matched(self) -> int:
        """Objects found."""
        ...

    @property
    def over(self) -> int:
        """True objects split."""
        ...

    @property
    def under(self) -> int:
        """Found objects that merge several."""
        ...


class TwoMapsLike(Protocol):
    """Two maps laid over one another."""

    @property
    def spec(self) -> GridSpec:
        """The window."""
        ...

    @property
    def left(self) -> SideLike:
        """The map on the left."""
        ...

    @property
    def right(self) -> SideLike:
        """The map on the right."""
        ...

    @property
    def reference(self) -> Literal["left", "right"]:
        """Whose objects the differences speak of."""
        ...

    @property
    def items(self) -> Sequence[ItemLike]:
        """The differences, the gravest first."""
        ...

    @property
    def counts(self) -> Mapping[str, int]:
        """{kind: how many}."""
        ...

    @property
    def same(self) -> int:
        """Objects that agree."""
        ...

    @property
    def score(self) -> ScoreLike | None:
        """Of the map that is not the truth; None without truth."""
        ...


@dataclass(frozen=True)
class Source:
    """A map that can be had besides the one on the page."""

    key: str
    title: str
    """Such as "Method paper" or "Ground truth"."""
    hint: str = ""
    """Such as what it is simulated with."""


@dataclass(frozen=True)
class CompareServices:
    """Plain functions behind the comparison; what is None is left out."""

    compare: Callable[[Named, Named, Literal["left", "right"] | None], TwoMapsLike]
    """(left, right, which is the truth) -> the comparison; may raise SIMapsError."""
    sources: tuple[Source, ...] = ()
    """What ``make`` can make."""
    make: Callable[[str, SIMap, Progress, threading.Event], SIMap] | None = None
    """(key, map on the page, told how far it is, set to give up) -> that map, from a cache if it was made before. Slow;
    called on a thread of its own. Raises `Cancelled` when it was told to give up."""
    rejoin: Callable[[SIMap, float, float], SIMap] | None = None
    """(map, K or evidence in percent, Louvain resolution) -> the map partitioned so; fast."""
    load: Callable[[str, bytes], SIMap] | None = None
    """(file name, content) -> the map of that file; may raise SIMapsError."""


class Cancelled(Exception):  # noqa: N818 - nothing went wrong
    """The work was given up because a person asked for it."""
