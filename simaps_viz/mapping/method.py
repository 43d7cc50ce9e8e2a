"""What a method is: how the cells of a map get their class, which graph they form, and how they become instances.

A new method is one file with one object of a class derived from `Method`, and one line in `methods.py`. The build asks
it, in this order, to label the cells, to make their graphs and to find communities with the log of their merges; the
page and the explanations ask it what its slider is called and what its scores mean.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.mapping.links import LinkTable
from simaps_viz.mapping.observations import AllReadings
from simaps_viz.mapping.steps import FrameList
from simaps_viz.mapping.votes import spread_labels, vote_labels
from simaps_viz.structures import CellGraph, Grid, GridSpec, MergeLog

if TYPE_CHECKING:
    from simaps_viz.mapping.config import BuildConfig


@dataclass(frozen=True)
class Slider:
    """The parameter that decides how far a method's merge log is followed, and the slider that sets it."""

    parameter: str
    """Its name in `BuildConfig` and in ``SIMap.parameters``."""
    full: float
    """Its value with the slider at 100 %."""
    name: str
    """What error messages call it."""
    unit: str
    """What it is, such as "a percentage"."""
    setting: str
    """A value in words, as a format of one number."""
    title: str
    """Title of the slider."""
    word: str
    """What to call it in the middle of a sentence."""
    hint: str
    """What the page explains about it."""
    reason: str
    """Why two parts were joined, as a format of the step's score in percent."""
    number: str
    """What the score of two parts is, for a legend."""

    def check(self, value: float) -> None:
        """Raise InputError unless the value lies from 0 to ``full``."""
        if not 0.0 <= value <= self.full:
            raise InputError(f"{self.name}: expected {self.unit} from 0 to {self.full:g}, found {value:g}")

    def threshold(self, value: float) -> float:
        """Return the score that a step of the merge log must exceed to be applied."""
        return float(value) / self.full

    def percent(self, value: float) -> float:
        """Return the position of the slider, 0 to 100, for a value."""
        return round(100.0 / self.full * float(value), 6)

    def value(self, percent: float) -> float:
        """Return the value for a position of the slider, 0 to 100."""
        return percent / (100.0 / self.full)


@dataclass(frozen=True, eq=False)
class Gathered:
    """Everything of some frames that their map is made of; the accumulator they were gathered in is not needed."""

    grid: Grid
    """Labelled by the highest pixel of each cell."""
    readings: AllReadings
    frames: FrameList
    links: LinkTable
    origin_cell: tuple[int, int]
    """(row, col), counted from the map's origin, of the grid's cell (0, 0)."""
    unsegmented: NDArray | None = None
    """bool [rows, cols], cells whose top only frames saw that were not segmented; None: all frames were."""


class Method:
    """A way from gathered frames to instances. The defaults are those of a method that joins nothing."""

    slider: Slider | None = None
    """What decides which communities are joined; None: the method keeps no merge log."""
    votes: bool = True
    """Frames vote for the class of a cell; False: its highest pixel names it."""
    counts_links: bool = False
    """Links between cells are counted while frames are gathered; see `links.py`."""
    layered: bool = False
    """The surface at all heights is partitioned, not only the top of each cell; see `space.py`."""
    weights_per_frame: bool = False
    """Edge weights are pixel pairs per frame that saw the cells; False: the share of frames that saw one object."""

    @property
    def weighs_evidence(self) -> bool:
        """Edge weights are the share of frames that saw one object; those of a method not known here are counts."""
        return self.slider is not None and not self.weights_per_frame

    def __init__(self, name: str) -> None:
        """Name the method as ``--method`` and ``SIMap.method`` do."""
        self.name = name

    def parameters(self, config: "BuildConfig") -> dict[str, Any]:
        """Return the settings that only this method uses, JSON-able; a map file keeps them."""
        kept: dict[str, Any] = {}
        if self.slider is not None:
            name = self.slider.parameter
            kept |= {name: getattr(config, name), "resolution": config.resolution, "seed": config.seed}
        if self.votes:
            kept["votes"] = asdict(config.votes)
        return kept

    def label_cells(
        self, grid: Grid, readings: AllReadings, config: "BuildConfig", unsegmented: NDArray | None = None
    ) -> tuple[Grid, dict[str, Any]]:
        """Name the class of every cell; ``unsegmented``: see `Gathered`.

        Returns:
            The grid with its final labels, and notes for the map's provenance.
        """
        if not self.votes:
            return grid, {}
        label, disagreement = vote_labels(grid, readings, config.votes)
        if unsegmented is not None:
            label = spread_labels(label, grid.height_m, unsegmented)
        return replace(grid, label=label), {"disagreement": round(disagreement, 6)}

    def graphs(self, grid: Grid, seen: Gathered, config: "BuildConfig") -> tuple[CellGraph, ...]:
        """Make the graph of each thing class; ``grid`` has its final labels."""
        del grid, seen, config
        return ()

    def communities(
        self, grid: Grid, graphs: Sequence[CellGraph], parameters: Mapping[str, Any]
    ) -> tuple[NDArray, MergeLog]:
        """Find the communities of cells and the log of how they merge, down to score 0.

        Args:
            grid: the map with its final labels.
            graphs: of `graphs`, or of a map file.
            parameters: as a map keeps them, see `BuildConfig.parameters`.

        Returns:
            community int32 [rows, cols], numbered from 1 over the whole map, 0 = none; and the log, class by class.
        """
        raise NotImplementedError(f"method {self.name} finds no communities")

    def level(
        self, graphs: Sequence[CellGraph], spec: GridSpec, parameters: Mapping[str, Any], levels: int
    ) -> list[NDArray]:
        """Return the communities after so many of Louvain's levels: int32 [n] for each graph, numbered from 0."""
        raise NotImplementedError(f"method {self.name} has no levels")

    def score(self, parameters: Mapping[str, Any], same: int, different: int, *, touching: bool, share: float) -> float:
        """Compute the score that two instances would be joined by; NaN for a method without a merge log.

        Args:
            parameters: of the map.
            same: sightings of pairs of their cells as one.
            different: sightings as two.
            touching: some of their cells are neighbours.
            share: part of the cells of one that have an edge to a cell of the other.
        """
        del parameters, same, different, touching, share
        return float("nan")

    def score_text(self, score: float, beside: float | None = None) -> str:
        """Write a score of the merge log; with a digit more where it would read as another one that it is beside."""
        return percent_text(score, beside=beside)

    def needed_text(self, threshold: float) -> str:
        """Describe what a score must exceed."""
        return f"{100.0 * threshold:g} %"


def percent_text(share: float, digits: int = 0, beside: float | None = None) -> str:
    """Write a share in percent; with up to two digits more where it would read as another share that it is beside."""
    if beside is not None and share != beside:
        same = (n for n in range(digits, digits + 2) if f"{100.0 * share:.{n}f}" == f"{100.0 * beside:.{n}f}")
        digits = 1 + max(same, default=digits - 1)
    return f"{100.0 * share:.{digits}f} %"
