"""From gathered frames to a map: the same whether they are all frames of a sequence or the first of many."""

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.mapping.accumulator import MapAccumulator
from simaps_viz.mapping.config import BuildConfig
from simaps_viz.mapping.method import Gathered
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.observations import AllReadings
from simaps_viz.mapping.partition import applied_steps, instance_of_community, look_up
from simaps_viz.mapping.simap import Origin, assemble, count_views, joining_threshold
from simaps_viz.mapping.space import SpaceSettings, find_surface
from simaps_viz.mapping.steps import FrameList
from simaps_viz.structures import CellGraph, Grid, MergeLog, SIMap

_MAX_NAMED = 20  # skipped frames that a map names; more are counted


@dataclass(frozen=True, eq=False)
class SequenceFacts:
    """What a map keeps of the sequence it was built from, besides its frames."""

    name: str
    path: str
    labels: tuple[str, ...]
    is_thing: tuple[bool, ...]
    segmentation_source: str
    simulated: bool
    T_map_world: NDArray
    """float64 [4, 4]."""

    def to_json(self) -> dict[str, Any]:
        """Return it JSON-able; floats come back exactly."""
        kept = {k: getattr(self, k) for k in ("name", "path", "segmentation_source", "simulated")}
        return kept | {
            "labels": list(self.labels),
            "is_thing": list(self.is_thing),
            "T_map_world": np.asarray(self.T_map_world).tolist(),
        }


def facts_from_json(values: Mapping[str, Any]) -> SequenceFacts:
    """Rebuild what `SequenceFacts.to_json` returned; raises KeyError, TypeError or ValueError for anything else."""
    words = [values["name"], values["path"], values["segmentation_source"], *values["labels"]]
    if not all(isinstance(word, str) for word in words) or not all(type(one) is bool for one in values["is_thing"]):
        raise ValueError("a name that is not a string, or an is_thing that is not true or false")
    if len(values["labels"]) != len(values["is_thing"]) or values["labels"][:1] != ["none"]:
        raise ValueError("labels that do not begin with none, or that is_thing is not aligned with")
    try:
        T_map_world = np.array(values["T_map_world"], dtype=np.float64).reshape(4, 4)
    except OverflowError as error:  # a whole number of hundreds of digits
        raise ValueError("a map frame of numbers that are too large") from error
    if not np.isfinite(T_map_world).all():
        raise ValueError("a map frame that is not finite")
    return SequenceFacts(
        name=values["name"],
        path=values["path"],
        labels=tuple(values["labels"]),
        is_thing=tuple(values["is_thing"]),
        segmentation_source=values["segmentation_source"],
        simulated=bool(values["simulated"]),
        T_map_world=T_map_world,
    )


_OBSTACLE_IN, _THING_IN = 5, 20
"""An obstacle, or a thing, that stands in a cell is seen there in one of so many frames at least."""


def gathered(accumulator: MapAccumulator) -> Gathered:
    """Return what was gathered so far, for `apply_method`."""
    grid = accumulator.snapshot()
    return Gathered(
        grid, accumulator.readings_on(grid), accumulator.frames, accumulator.links, accumulator.origin_cell,
        accumulator.unsegmented_cells(),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Found:
    """Everything of a map but its instances, which follow from a threshold."""

    grid: Grid
    graphs: tuple[CellGraph, ...]
    community: NDArray
    """int32 [rows, cols], 0 = none."""
    log: MergeLog
    readings: AllReadings
    origin_cell: tuple[int, int]
    """(row, col), counted from the map's origin, of the grid's cell (0, 0)."""
    notes: dict[str, Any]
    """For the map's provenance."""


class HasClasses(Protocol):
    """Anything that knows the classes of a sequence: `SequenceFacts`, a `FrameSource`, a worker's job."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Class names, index 0 is "none"."""
        ...

    @property
    def is_thing(self) -> tuple[bool, ...]:
        """Aligned with ``labels``."""
        ...


def empty_accumulator(
    classes: HasClasses, config: BuildConfig, *, links: bool = False, steps: bool = False
) -> MapAccumulator:
    """Make the accumulator that frames are gathered in.

    Args:
        classes: of the sequence.
        config: how the map is built.
        links: count links even if the method does without; an observer may want them.
        steps: keep what each frame added, for a build log.
    """
    return MapAccumulator(
        classes.labels, classes.is_thing, config.projection, reach_cells=-1 if config.literal else 2,
        links=links or method_of(config.method).counts_links, steps=steps,
    )  # fmt: skip


def apply_method(seen: Gathered, config: BuildConfig) -> Found:
    """Name the cells of what was gathered, and find its communities and how they merge."""
    method = method_of(config.method)
    grid, notes = method.label_cells(seen.grid, seen.readings, config, seen.unsegmented)
    grid = without_passers_by(grid, seen.readings, config.projection.obstacle_height_m)
    graphs = method.graphs(grid, seen, config)
    community, log = method.communities(grid, graphs, config.parameters())
    return Found(grid, graphs, community, log, seen.readings, seen.origin_cell, notes)


def without_passers_by(grid: Grid, readings: AllReadings, obstacle_m: float) -> Grid:
    """Return the grid without obstacles that most frames saw through: people who walked by, and stray pixels of depth.

    An obstacle goes where fewer than one in five of the frames that saw a cell had anything at ``obstacle_m`` or higher
    there; where the cell's class is a thing, fewer than one in twenty, as dark chairs return little depth. Frames of a
    live map that came without masks are not asked: they have no readings.
    """
    # A frame counts one, one that hit something takes off as many as a hit outweighs: above 0, too few have hit.
    take_off = np.where(grid.is_thing, _THING_IN, _OBSTACLE_IN).astype(np.int32)
    balance = np.zeros(grid.label.size, np.int32)
    for part in readings.batches():
        _ask(part.cell, part.height_m >= obstacle_m, take_off, grid.label.reshape(-1), balance)
    lowest = grid.lowest_m.copy()
    lowest[balance.reshape(lowest.shape) > 0] = np.nan
    return replace(grid, lowest_m=lowest)


@njit(cache=True, nogil=True)
def _ask(
    cell: NDArray,  # int32 [v], of each reading
    hit: NDArray,  # bool [v]
    take_off: NDArray,  # int32 [labels]
    label: NDArray,  # int16 [cells]
    balance: NDArray,  # in/out int32 [cells]
) -> None:
    """Add 1 to a cell for each of its readings, and take off what the cell's class has for each that is a hit."""
    for i in range(len(cell)):
        balance[cell[i]] += 1
        if hit[i]:
            balance[cell[i]] -= take_off[label[cell[i]]]


def objects_of(found: Found, config: BuildConfig) -> NDArray:
    """Join communities as the configuration says; instances of fewer than ``min_cells`` cells are kept.

    Returns:
        int32 [rows, cols], 0 = none.
    """
    applied = applied_steps(found.log, joining_threshold(config.method, config.parameters()))
    return look_up(instance_of_community(found.log, applied, int(found.community.max(initial=0))), found.community)


def map_of(found: Found, frames: FrameList, facts: SequenceFacts, config: BuildConfig) -> SIMap:
    """Make the map of what `apply_method` found in some frames."""
    simap = assemble(
        found.grid, found.graphs, found.community, found.log,
        count_views(found.grid, found.community, found.readings),
        Origin(
            T_map_world=facts.T_map_world,
            method=config.method,
            parameters=config.parameters(),
            provenance=_provenance(facts, frames) | found.notes,
            frame_names=tuple(frames.names),
            T_map_camera=frames.poses,
        ),
    )  # fmt: skip
    if not method_of(config.method).layered:
        return simap
    surface, hidden = find_surface(simap, frames, found.origin_cell, space_settings(simap, found.notes, config))
    return replace(simap, surface=surface, hidden=hidden)


def space_settings(simap: SIMap, notes: Mapping[str, Any], config: BuildConfig) -> SpaceSettings:
    """Return how the surface of a map is partitioned. Masks that count as exact are not weighed against each other."""
    votes, labels = config.votes, simap.grid.labels
    weight = np.where(simap.grid.is_thing, 1.0, votes.stuff)
    weight[0] = votes.nothing
    exact = notes.get("disagreement", 1.0) < votes.exact_below
    if exact:
        weight = np.ones(len(labels))
    return SpaceSettings(
        config.projection.below_floor_m, weight, config.resolution, config.seed, config.pooling, config.affinity,
        config.min_cells, exact,
    )  # fmt: skip


def map_so_far(accumulator: MapAccumulator, facts: SequenceFacts, config: BuildConfig) -> SIMap:
    """Make the map of the frames gathered so far, exactly as a build of these frames alone would.

    Costs what finding instances costs at the end of a build: 0.05 to 0.1 s for a room or a flat.
    """
    return map_of(apply_method(gathered(accumulator), config), accumulator.frames, facts, config)


def skipped_frames(frames: FrameList) -> dict[str, str]:
    """Return {name: reason} of the frames that could not be read."""
    return {frames.names[bisect_left(frames.indices, index)]: why for index, why in frames.skipped.items()}


def _provenance(facts: SequenceFacts, frames: FrameList) -> dict[str, Any]:
    known: dict[str, Any] = {
        "sequence": facts.path,
        "name": facts.name,
        "segmentation": facts.segmentation_source,
        "simulated": facts.simulated,
        "frames": len(frames),
        "simaps_version": version("simaps-viz"),
    }
    skipped = list(skipped_frames(frames))
    if skipped:
        known["skipped"] = {"frames": len(skipped), "names": skipped[:_MAX_NAMED]}
    return known
