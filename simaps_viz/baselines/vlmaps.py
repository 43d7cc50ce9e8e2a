"""The baseline VLMaps (Huang et al., "Visual Language Maps for Robot Navigation", ICRA 2023), re-implemented.

Every valid depth pixel is back-projected with its pixel embedding; a cell of the top-down grid keeps the mean of the
embeddings of all points that fell in it, whatever their height; the nearest of the words asked for names the cell.
The method knows classes, not objects. ``vlmaps`` is just that: all cells of a class are one instance, however far
apart they lie. ``vlmaps+components`` tells objects apart the way VLMaps' programs do when they need a position: the
cleaned mask of the class, contour by contour (see `contours`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.baselines.contours import ContourSettings, contour_objects
from simaps_viz.baselines.embedder import OTHER, Embedder
from simaps_viz.baselines.simulated_lseg import SimulatedLSeg
from simaps_viz.baselines.store import EmbeddingStore, Weighting, cell_points, dense_bytes
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
    wants_color,
)  # fmt: skip
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.observations import Readings, gather_readings
from simaps_viz.mapping.partition import describe_instances, empty_log
from simaps_viz.mapping.simap import count_views
from simaps_viz.structures import Frame, Grid, Segment, Segmentation, SIMap

BASELINES: Mapping[str, bool] = {"vlmaps": False, "vlmaps+components": True}
"""The methods of this module by name: whether each tells the objects of a class apart."""


@dataclass(frozen=True)
class VLMapsConfig:
    """How a VLMaps baseline is built."""

    projection: ProjectionSettings = field(default_factory=ProjectionSettings)
    """Which pixels count, and how fine the grid is: as in every other method."""
    stride: int = 4
    """Every so many pixels, along both axes, one is back-projected with its embedding (VLMaps: one of 100 pixels)."""
    weighting: Weighting = "distance"
    """What a point counts in the mean of its cell; on both scenes tried, the best map by distance is the better one."""
    seed: int = 0
    """Of the simulated encoder."""
    min_cells: int = 4
    """What covers fewer cells is not called an instance, as in the other methods."""
    contours: ContourSettings = field(default_factory=ContourSettings)
    """How ``vlmaps+components`` tells objects apart."""

    def __post_init__(self) -> None:
        if self.stride < 1:
            raise InputError(f"stride: expected at least 1 pixel, found {self.stride}")
        if self.weighting not in ("uniform", "distance"):
            raise InputError(f"weighting: expected uniform or distance, found {self.weighting!r}")
        if self.min_cells < 1:
            raise InputError(f"smallest instance: expected at least 1 cell, found {self.min_cells}")

    def parameters(self, *, components: bool) -> dict[str, Any]:
        """Return what the map file keeps of it."""
        kept = {k: v for k, v in asdict(self).items() if k not in ("projection", "contours")}
        contours = {f"contour_{k}": v for k, v in asdict(self.contours).items()} if components else {}
        return {**kept, **contours, **asdict(self.projection)}


def build_vlmaps(
    sequence: FrameSource,
    config: VLMapsConfig | None = None,
    *,
    components: bool = False,
    embedder: Embedder | None = None,
    observers: Sequence[Observer] = (),
) -> SIMap:
    """Build a map the way VLMaps does.

    The map has no graphs and an empty merge log: there is nothing to move K over. Its views say which segments saw an
    instance's cells; the method itself never looked at segments, only, through the encoder, at classes.

    Args:
        sequence: posed RGB-D frames with their segmentation.
        config: how.
        components: one instance for each contour of the class's cleaned mask; False: one for each class.
        embedder: gives pixels and words their vectors; a simulated LSeg when left out.
        observers: told everything, in order.

    Raises:
        InputError: a frame is missing or damaged (named), or the configuration makes no sense.
    """
    config = config or VLMapsConfig()
    encoder = embedder or SimulatedLSeg(sequence.labels, config.seed)

    def tell(event: Event) -> None:
        for observer in observers:
            observer.on_event(event)

    tell(_started(sequence, encoder))
    gathered = VLMapsAccumulator(sequence.labels, sequence.is_thing, config, encoder)
    T_map_camera = sequence.T_map_world @ sequence.poses
    for frame, segmentation in read_ahead(sequence, color=encoder.wants_color or wants_color(observers)):
        seen = gathered.add_frame(frame, segmentation, T_map_camera[frame.index])
        if observers:
            tell(_projected(frame, segmentation, T_map_camera[frame.index], gathered, seen))

    grid, instance = split_classes(gathered.grid(), config, components=components)
    tell(CommunitiesFound(grid, instance, len(sequence) - 1, final=True))
    tell(MergesFound(grid, instance, empty_log(), np.zeros(0, dtype=bool)))
    simap = _assemble(sequence, config, gathered, grid, instance, components=components)
    tell(BuildFinished(simap))
    return simap


class VLMapsAccumulator:
    """Takes frames one by one; heights and observations as in every map, labels from the mean embeddings."""

    def __init__(
        self, labels: tuple[str, ...], is_thing: tuple[bool, ...], config: VLMapsConfig, embedder: Embedder
    ) -> None:
        """Start empty.

        Args:
            labels: class names, index 0 is "none".
            is_thing: aligned with ``labels``.
            config: how points are gathered.
            embedder: gives pixels and words their vectors.
        """
        self.config, self.embedder = config, embedder
        self.store = EmbeddingStore(embedder.dimension)
        self._heights = MapAccumulator(labels, is_thing, config.projection, links=False)
        self._segments: list[tuple[Segment, ...]] = []
        self._texts = embedder.text([OTHER, *labels[1:]])

    def add_frame(self, frame: Frame, segmentation: Segmentation, T_map_camera: NDArray) -> NDArray:
        """Put a frame on the map.

        Returns:
            int32 [n, 2]: (row, col), counted from the map's origin, of the cells it saw.
        """
        embeddings = self.embedder.pixels(frame, segmentation)
        points = cell_points(
            frame, embeddings, T_map_camera, self.config.projection,
            stride=self.config.stride, weighting=self.config.weighting,
        )  # fmt: skip
        self.store.add(points, embeddings.table)
        self._segments.append(segmentation.segments)
        return self._heights.add_frame(frame, segmentation, T_map_camera)

    def grid(self) -> Grid:
        """Copy the map as it is now; a cell no sampled point fell in has no label."""
        grid = self._heights.snapshot()
        label = np.zeros(grid.spec.shape, dtype=np.int16)
        row, col = (self.store.cells - np.array(self.origin_cell, dtype=np.int32)).T
        label[row, col] = self.store.nearest(self._texts).argmax(axis=1)
        return _relabelled(grid, label)

    def seen(self, grid: Grid) -> Readings:
        """Return which segments saw the cells of the finished map."""
        return gather_readings(self._heights.readings, self._segments, self.origin_cell, grid)

    @property
    def origin_cell(self) -> tuple[int, int]:
        """(row, col), counted from the map's origin, of cell (0, 0) of `grid`."""
        return self._heights.origin_cell


def split_classes(grid: Grid, config: VLMapsConfig, *, components: bool) -> tuple[Grid, NDArray]:
    """Turn classes into instances.

    Returns:
        The grid, whose labels change only where ``config.contours.fill`` gives an object the cells inside its
        contour; and instances int32 [rows, cols], numbered from 1 class by class, 0 = none.
    """
    label, instance = grid.label.copy(), np.zeros(grid.spec.shape, dtype=np.int32)
    things = np.array(grid.is_thing)
    for index in np.flatnonzero(things).tolist():
        mine = grid.label == index
        if not mine.any():
            continue
        objects = contour_objects(mine, config.contours) if components else mine.astype(np.int32)
        taken = mine
        if components and config.contours.fill:
            taken = mine | (~things[label] & (grid.observations > 0))
        objects = _without_small(np.where(taken, objects, 0), config.min_cells)
        label[objects > 0] = index
        instance[objects > 0] = objects[objects > 0] + int(instance.max())
    return _relabelled(grid, label), instance


def _assemble(
    sequence: FrameSource,
    config: VLMapsConfig,
    gathered: "VLMapsAccumulator",
    grid: Grid,
    instance: NDArray,
    *,
    components: bool,
) -> SIMap:
    views = count_views(grid, instance, gathered.seen(grid))
    itself = np.arange(int(instance.max(initial=0)) + 1)
    return SIMap(
        grid=grid,
        instance=instance,
        instances=describe_instances(grid, instance, views, itself),
        T_map_world=sequence.T_map_world,
        method=next(name for name, apart in BASELINES.items() if apart == components),
        parameters=config.parameters(components=components),
        provenance=_provenance(sequence, gathered.embedder, gathered.store, grid),
        community=instance,
        merges=empty_log(),
        graphs=(),
        views=views,
        frame_names=sequence.frame_names,
        T_map_camera=sequence.T_map_world @ sequence.poses,
    )


def _without_small(objects: NDArray, min_cells: int) -> NDArray:
    """Drop objects of fewer cells and number the others from 1 without gaps."""
    kept = np.bincount(objects.reshape(-1)) >= min_cells
    kept[0] = False
    return np.where(kept, np.cumsum(kept), 0).astype(np.int32)[objects]


def _relabelled(grid: Grid, label: NDArray) -> Grid:
    return Grid(grid.spec, grid.labels, grid.is_thing, label, grid.height_m, grid.lowest_m, grid.observations)


def _started(sequence: FrameSource, encoder: Embedder) -> BuildStarted:
    return BuildStarted(
        name=sequence.name,
        frame_names=sequence.frame_names,
        T_map_world=sequence.T_map_world,
        segmentation_source=f"{sequence.segmentation_source}; {encoder.description}",
        simulated=sequence.simulated or encoder.simulated,
    )


def _projected(
    frame: Frame, segmentation: Segmentation, T_map_camera: NDArray, gathered: VLMapsAccumulator, seen: NDArray
) -> FrameProjected:
    return FrameProjected(
        frame=frame,
        segmentation=segmentation,
        T_map_camera=T_map_camera,
        cells=(seen - np.array(gathered.origin_cell, dtype=np.int32)).astype(np.int32),
        new_edges=np.zeros((0, 4), dtype=np.int32),
        new_edge_labels=np.zeros(0, dtype=np.int16),
        snapshot=gathered.grid,
    )


def _provenance(sequence: FrameSource, encoder: Embedder, store: EmbeddingStore, grid: Grid) -> dict[str, Any]:
    return {
        "sequence": str(sequence.path),
        "name": sequence.name,
        "segmentation": f"{sequence.segmentation_source}; {encoder.description}",
        "simulated": sequence.simulated or encoder.simulated,
        "frames": len(sequence),
        "simaps_version": version("simaps-viz"),
        "embeddings": encoder.description,
        "embedder": dict(encoder.parameters),
        "embedding_bytes_dense": dense_bytes(grid.spec.rows, grid.spec.cols, encoder.dimension),
        "embedding_bytes_held": store.held_bytes,
    }
