"""The order of the stages: frames in, a SIMap out, everything told to those who watch."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
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
from simaps_viz.mapping.graph import class_graphs
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import Origin, SeenCells, assemble, count_views, partition_grid
from simaps_viz.structures import CellGraph, Frame, Grid, Segmentation, SIMap


@dataclass(frozen=True)
class BuildConfig:
    """How a map is built."""

    method: Literal["paper"] = "paper"
    """How cells become instances."""
    k_percent: float = 5.0
    """Communities join while more than this share of one's cells neighbour the other."""
    resolution: float = 1.0
    """Louvain's: higher gives more and smaller communities."""
    seed: int = 0
    """Of Louvain's random order."""
    min_cells: int = 4
    """What covers fewer cells is not called an instance; 4 cells of 5 cm are a cup."""
    literal: bool = False
    """The paper's literal reading: depth jumps inside a segment link cells too."""
    projection: ProjectionSettings = field(default_factory=ProjectionSettings)
    """Which pixels count, and how fine the grid is."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.k_percent <= 100.0:
            raise InputError(f"K: expected a percentage from 0 to 100, found {self.k_percent:g}")
        if not self.resolution > 0.0:
            raise InputError(f"resolution: expected a number above 0, found {self.resolution:g}")
        if self.min_cells < 1:
            raise InputError(f"smallest instance: expected at least 1 cell, found {self.min_cells}")
        if not 0.005 <= self.projection.cell_size_m <= 1.0:
            raise InputError(f"cell size: expected 0.005 to 1 m, found {self.projection.cell_size_m:g} m")

    def parameters(self) -> dict[str, Any]:
        """Give what the map file keeps of it."""
        kept = {**asdict(self), **asdict(self.projection)}
        del kept["projection"], kept["method"]
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
    accumulator = empty_accumulator(sequence, config)
    T_map_camera = sequence.T_map_world @ sequence.poses
    segments: list[Segmentation] = []
    links_told = 0
    for frame, segmentation in read_ahead(sequence, color=_wants_color(observers)):
        seen = accumulator.add_frame(frame, segmentation, T_map_camera[frame.index])
        segments.append(Segmentation(ids=_NO_IDS, segments=segmentation.segments))
        if observers:
            tell(_projected(frame, segmentation, T_map_camera[frame.index], accumulator, seen, links_told))
            links_told = accumulator.links.size
            if communities_every and (frame.index + 1) % communities_every == 0:
                grid, graphs = graphs_so_far(accumulator)
                community, _ = partition_grid(grid, graphs, resolution=config.resolution, seed=config.seed)
                tell(CommunitiesFound(grid, community, frame.index, final=False))

    grid, graphs = graphs_so_far(accumulator)
    community, log = partition_grid(grid, graphs, resolution=config.resolution, seed=config.seed)
    tell(CommunitiesFound(grid, community, len(sequence) - 1, final=True))
    tell(MergesFound(grid, community, log, applied_steps(log, config.k_percent / 100.0)))
    views = count_views(grid, community, _seen_cells(accumulator, segments, sequence.labels, grid))
    origin = Origin(
        T_map_world=sequence.T_map_world,
        method=config.method,
        parameters=config.parameters(),
        provenance=_provenance(sequence),
        frame_names=sequence.frame_names,
        T_map_camera=T_map_camera,
    )
    simap = assemble(grid, graphs, community, log, views, origin)
    tell(BuildFinished(simap))
    return simap


def empty_accumulator(sequence: FrameSource, config: BuildConfig) -> MapAccumulator:
    """Give what a build gathers its frames in."""
    reach = -1 if config.literal else 2
    return MapAccumulator(sequence.labels, sequence.is_thing, config.projection, reach_cells=reach)


_NO_IDS = np.zeros((0, 0), dtype=np.int32)


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


def _seen_cells(
    accumulator: MapAccumulator, segments: Sequence[Segmentation], labels: Sequence[str], grid: Grid
) -> SeenCells:
    row0, col0 = accumulator.origin_cell
    index_of: Mapping[str, int] = {name: i for i, name in enumerate(labels)}
    cell, frame, segment, label, score = [], [], [], [], []
    for i, (seen, segmentation) in enumerate(zip(accumulator.views, segments, strict=True)):
        highest = max((s.id for s in segmentation.segments), default=0)
        label_of, score_of = np.zeros(highest + 1, np.int16), np.zeros(highest + 1, np.float32)
        for s in segmentation.segments:
            label_of[s.id], score_of[s.id] = index_of[s.label], s.score
        cell.append((seen.rows.astype(np.int64) - row0) * grid.spec.cols + (seen.cols - col0))
        frame.append(np.full(len(seen.rows), i, dtype=np.int32))
        segment.append(seen.segments)
        label.append(label_of[seen.segments])
        score.append(score_of[seen.segments])
    joined = [np.concatenate([np.zeros(0, a[0].dtype), *a]) if a else np.zeros(0, np.int32)
              for a in (cell, frame, segment, label, score)]  # fmt: skip
    return SeenCells(*joined)


def _provenance(sequence: FrameSource) -> dict[str, Any]:
    return {
        "sequence": str(sequence.path),
        "name": sequence.name,
        "segmentation": sequence.segmentation_source,
        "simulated": sequence.simulated,
        "frames": len(sequence),
        "simaps_version": version("simaps-viz"),
    }
