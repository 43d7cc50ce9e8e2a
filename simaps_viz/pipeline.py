"""The order of the stages: frames in, a SIMap out, everything told to those who watch."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource, read_ahead
from simaps_viz.errors import InputError
from simaps_viz.events import (
    BuildFinished,
    BuildStarted,
    CommunitiesFound,
    Event,
    FrameProjected,
    MergesFound,
    Observer,
)  # fmt: skip
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.components import component_communities
from simaps_viz.mapping.evidence import EvidenceSettings, pair_graphs
from simaps_viz.mapping.graph import class_graphs
from simaps_viz.mapping.partition import applied_steps, empty_log
from simaps_viz.mapping.partition_evidence import partition_evidence
from simaps_viz.mapping.pooling import PoolSettings
from simaps_viz.mapping.readings import Readings, gather_readings
from simaps_viz.mapping.simap import (
    JOINING,
    Origin,
    assemble,
    check_joining,
    count_views,
    joining_threshold,
    partition_grid,
)
from simaps_viz.mapping.votes import VoteSettings, vote_labels
from simaps_viz.structures import CellGraph, Frame, Grid, MergeLog, Segment, Segmentation, SIMap

Method = Literal["evidence", "paper", "components"]


@dataclass(frozen=True)
class BuildConfig:
    """How a map is built."""

    method: Method = "evidence"
    """How cells become instances."""
    k_percent: float = 5.0
    """Method paper: communities join while more than this share of one's cells neighbour the other."""
    affinity: float = 0.6
    """Method evidence: communities join while more than this share of their witnesses saw them as one."""
    resolution: float = 1.0
    """Louvain's: higher gives more and smaller communities."""
    seed: int = 0
    """Of Louvain's random order."""
    min_cells: int = 4
    """What covers fewer cells is not called an instance; 4 cells of 5 cm are a cup."""
    literal: bool = False
    """Method paper, its literal reading: depth jumps inside a segment link cells too."""
    projection: ProjectionSettings = field(default_factory=ProjectionSettings)
    """Which pixels count, and how fine the grid is."""
    votes: VoteSettings = field(default_factory=VoteSettings)
    """Methods evidence and components: how frames vote for the class of a cell."""
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    """Method evidence: which pairs of cells are looked at."""
    pooling: PoolSettings = field(default_factory=PoolSettings)
    """Method evidence: what is believed before any evidence."""

    def __post_init__(self) -> None:
        check_joining("k_percent", self.k_percent)
        check_joining("affinity", self.affinity)
        if not 0.0 < self.resolution < float("inf"):
            raise InputError(f"resolution: expected a number above 0, found {self.resolution:g}")
        ranges = self.evidence.ranges
        if len(set(ranges)) != len(ranges) or not all(1 <= r <= 1000 for r in ranges):
            raise InputError(f"ranges of evidence: expected different numbers of cells from 1, found {ranges}")
        if self.min_cells < 1:
            raise InputError(f"smallest instance: expected at least 1 cell, found {self.min_cells}")
        if not 0.005 <= self.projection.cell_size_m <= 1.0:
            raise InputError(f"cell size: expected 0.005 to 1 m, found {self.projection.cell_size_m:g} m")

    def parameters(self) -> dict[str, Any]:
        """Give what the map file keeps of it: what its method uses."""
        kept: dict[str, Any] = {"min_cells": self.min_cells, **asdict(self.projection)}
        if self.method in JOINING:
            name = JOINING[self.method]
            kept |= {name: getattr(self, name), "resolution": self.resolution, "seed": self.seed}
        if self.method == "paper":
            return {**kept, "literal": self.literal}
        kept["votes"] = asdict(self.votes)
        if self.method == "evidence":
            evidence = {**asdict(self.evidence), "ranges": list(self.evidence.ranges)}  # as JSON gives it back
            kept |= {"evidence": evidence, "pooling": asdict(self.pooling)}
        return kept


def build_map(
    sequence: FrameSource,
    config: BuildConfig | None = None,
    observers: Sequence[Observer] = (),
    *,
    communities_every: int = 0,
) -> SIMap:
    """Build a Semantic Instance Map.

    Args:
        sequence: posed RGB-D frames with their segmentation.
        config: how.
        observers: told everything, in order; colour is decoded only if there are any.
        communities_every: tell observers the communities after every so many frames; 0 = only at the end.

    Raises:
        InputError: a frame is missing or damaged (named), or the configuration makes no sense.
    """
    config = config or BuildConfig()

    def tell(event: Event) -> None:
        for observer in observers:
            observer.on_event(event)

    tell(_started(sequence))
    accumulator = empty_accumulator(sequence, config, watched=_wants_color(observers))
    T_map_camera = sequence.T_map_world @ sequence.poses
    segments: list[tuple[Segment, ...]] = []
    links_told = 0
    for frame, segmentation in read_ahead(sequence, color=_wants_color(observers)):
        seen = accumulator.add_frame(frame, segmentation, T_map_camera[frame.index])
        segments.append(segmentation.segments)
        if observers:
            tell(_projected(frame, segmentation, T_map_camera[frame.index], accumulator, seen, links_told))
            links_told = accumulator.links.size
            if communities_every and (frame.index + 1) % communities_every == 0:
                found = _partition(accumulator, segments, config)
                tell(CommunitiesFound(found.grid, found.community, frame.index, final=False))

    found = _partition(accumulator, segments, config)
    tell(CommunitiesFound(found.grid, found.community, len(sequence) - 1, final=True))
    threshold = joining_threshold(config.method, config.parameters())
    tell(MergesFound(found.grid, found.community, found.log, applied_steps(found.log, threshold)))
    simap = assemble(
        found.grid, found.graphs, found.community, found.log,
        count_views(found.grid, found.community, found.readings),
        Origin(
            T_map_world=sequence.T_map_world,
            method=config.method,
            parameters=config.parameters(),
            provenance=_provenance(sequence) | found.facts,
            frame_names=sequence.frame_names,
            T_map_camera=T_map_camera,
        ),
    )  # fmt: skip
    tell(BuildFinished(simap))
    return simap


@dataclass(frozen=True, eq=False)
class _Found:
    """What the frames so far make."""

    grid: Grid
    graphs: tuple[CellGraph, ...]
    community: NDArray
    log: MergeLog
    readings: Readings
    facts: dict[str, Any]
    """For the map's provenance."""


def _partition(accumulator: MapAccumulator, segments: Sequence[tuple[Segment, ...]], config: BuildConfig) -> _Found:
    grid = accumulator.snapshot()
    readings = gather_readings(accumulator.readings, segments, accumulator.origin_cell, grid)
    if config.method == "paper":
        grid, graphs = graphs_so_far(accumulator)
        community, log = partition_grid(grid, graphs, resolution=config.resolution, seed=config.seed)
        return _Found(grid, graphs, community, log, readings, {})
    label, disagreement = vote_labels(grid, readings, config.votes)
    grid = replace(grid, label=label)
    facts = {"disagreement": round(disagreement, 6)}
    if config.method == "components":
        return _Found(grid, (), component_communities(grid), empty_log(), readings, facts)
    graphs = pair_graphs(grid, readings, config.evidence)
    community, log = partition_evidence(
        grid, graphs, resolution=config.resolution, seed=config.seed, settings=config.pooling
    )
    return _Found(grid, graphs, community, log, readings, facts)


def empty_accumulator(sequence: FrameSource, config: BuildConfig, *, watched: bool = False) -> MapAccumulator:
    """Give what a build gathers its frames in; links are counted where the method or an observer wants them."""
    reach = -1 if config.literal else 2
    links = watched or config.method == "paper"
    return MapAccumulator(sequence.labels, sequence.is_thing, config.projection, reach_cells=reach, links=links)


def _wants_color(observers: Sequence[Observer]) -> bool:
    return any(getattr(observer, "wants_color", True) for observer in observers)


def _started(sequence: FrameSource) -> BuildStarted:
    return BuildStarted(
        name=sequence.name,
        frame_names=sequence.frame_names,
        T_map_world=sequence.T_map_world,
        segmentation_source=sequence.segmentation_source,
        simulated=sequence.simulated,
    )


def _projected(
    frame: Frame,
    segmentation: Segmentation,
    T_map_camera: NDArray,
    accumulator: MapAccumulator,
    seen: NDArray,
    links_told: int,
) -> FrameProjected:
    origin = np.array(accumulator.origin_cell, dtype=np.int32)
    edges, labels, _ = accumulator.links.entries(links_told)
    return FrameProjected(
        frame=frame,
        segmentation=segmentation,
        T_map_camera=T_map_camera,
        cells=(seen - origin).astype(np.int32),
        new_edges=edges - np.tile(origin, 2),
        new_edge_labels=labels,
        snapshot=accumulator.snapshot,
    )


def graphs_so_far(accumulator: MapAccumulator) -> tuple[Grid, tuple[CellGraph, ...]]:
    """Give the map as it is now, and the cell graph of each of its thing classes."""
    grid = accumulator.snapshot()
    edges, labels, counts = accumulator.links.entries()
    return grid, class_graphs(grid, edges - np.tile(np.array(accumulator.origin_cell), 2), labels, counts)


def _provenance(sequence: FrameSource) -> dict[str, Any]:
    return {
        "sequence": str(sequence.path),
        "name": sequence.name,
        "segmentation": sequence.segmentation_source,
        "simulated": sequence.simulated,
        "frames": len(sequence),
        "simaps_version": version("simaps-viz"),
    }
