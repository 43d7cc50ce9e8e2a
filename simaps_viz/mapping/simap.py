"""Making a SIMap from its stages, and partitioning it anew without looking at the frames again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.mapping.communities import find_communities
from simaps_viz.mapping.merge import merge_steps
from simaps_viz.mapping.partition import applied_steps, describe_instances, instance_of_community
from simaps_viz.structures import CellGraph, Grid, MergeLog, SIMap, Views


@dataclass(frozen=True, eq=False)
class Origin:
    """Where a map comes from: everything about it that its partition does not touch."""

    T_map_world: NDArray
    method: str
    parameters: Mapping[str, Any]
    provenance: Mapping[str, Any]
    frame_names: tuple[str, ...]
    T_map_camera: NDArray


@dataclass(frozen=True, eq=False)
class SeenCells:
    """For every frame and cell: which segment was highest there. All arrays aligned."""

    cell: NDArray
    """int64 [v], flat cell of the finished grid."""
    frame: NDArray
    """int32 [v]."""
    segment: NDArray
    """int32 [v]."""
    label: NDArray
    """int16 [v], class index of the segment."""
    score: NDArray
    """float32 [v]."""


def partition_grid(
    grid: Grid, graphs: Sequence[CellGraph], *, resolution: float, seed: int
) -> tuple[NDArray, MergeLog]:
    """Run Louvain and the K % rule on every class.

    Returns:
        community int32 [rows, cols], numbered from 1 over the whole map, 0 = none; and the log down to K = 0.
    """
    community = np.zeros(grid.spec.rows * grid.spec.cols, dtype=np.int32)
    steps: list[tuple[int, int, int, float]] = []
    first = 1
    for graph in graphs:
        found = find_communities(graph, resolution=resolution, seed=seed)
        community[graph.cells] = found + first
        steps += [(graph.label, s + first, t + first, share) for s, t, share in merge_steps(found, graph.edges)]
        first += int(found.max()) + 1 if len(found) else 0
    log = MergeLog(
        label=np.array([s[0] for s in steps], dtype=np.int16),
        source=np.array([s[1] for s in steps], dtype=np.int32),
        target=np.array([s[2] for s in steps], dtype=np.int32),
        score=np.array([s[3] for s in steps], dtype=np.float32),
    )
    return community.reshape(grid.spec.shape), log


def count_views(grid: Grid, community: NDArray, seen: SeenCells) -> Views:
    """Sum up, per community, frame and segment, how many cells the segment named; other classes do not count."""
    of_cell = community.reshape(-1)[seen.cell]
    kept = (of_cell > 0) & (grid.label.reshape(-1)[seen.cell] == seen.label)
    key = (of_cell[kept].astype(np.int64) << 40) | (seen.frame[kept].astype(np.int64) << 16) | seen.segment[kept]
    unique, first, cells = np.unique(key, return_index=True, return_counts=True)
    return Views(
        community=(unique >> 40).astype(np.int32),
        frame=((unique >> 16) & 0xFFFFFF).astype(np.int32),
        segment=(unique & 0xFFFF).astype(np.int32),
        cells=cells.astype(np.int32),
        score=seen.score[kept][first].astype(np.float32),
    )


def assemble(
    grid: Grid, graphs: Sequence[CellGraph], community: NDArray, log: MergeLog, views: Views, origin: Origin
) -> SIMap:
    """Put the stages together; the instances follow from the parameters ``k_percent`` and ``min_cells``."""
    applied = applied_steps(log, float(origin.parameters["k_percent"]) / 100.0)
    instance_of = instance_of_community(log, applied, int(community.max(initial=0)))
    cells = np.bincount(instance_of[community].reshape(-1), minlength=len(instance_of))
    instance_of[cells[instance_of] < int(origin.parameters.get("min_cells", 1))] = 0
    instance = instance_of[community]
    return SIMap(
        grid=grid,
        instance=instance,
        instances=describe_instances(grid, instance, views, instance_of),
        T_map_world=origin.T_map_world,
        method=origin.method,
        parameters=dict(origin.parameters),
        provenance=dict(origin.provenance),
        community=community,
        merges=log,
        graphs=tuple(graphs),
        views=views,
        frame_names=origin.frame_names,
        T_map_camera=origin.T_map_camera,
    )


def origin_of(simap: SIMap) -> Origin:
    """Give back what `assemble` was told of a map's origin."""
    return Origin(
        simap.T_map_world, simap.method, simap.parameters, simap.provenance, simap.frame_names, simap.T_map_camera
    )


def repartition(simap: SIMap, *, k_percent: float) -> SIMap:
    """Give the map for another K: a look-up in the merge log.

    Raises:
        InputError: K lies outside 0 to 100.
    """
    if not 0.0 <= k_percent <= 100.0:
        raise InputError(f"K: expected a percentage from 0 to 100, found {k_percent:g}")
    origin = replace(origin_of(simap), parameters={**simap.parameters, "k_percent": float(k_percent)})
    return assemble(simap.grid, simap.graphs, simap.community, simap.merges, simap.views, origin)


def recommunity(simap: SIMap, *, resolution: float, k_percent: float | None = None) -> SIMap:
    """Give the map for another Louvain resolution, from the stored graphs.

    Views are handed on through the cells' shares, as the frames are not at hand: the new communities of an old one
    take its views in proportion to the cells they share with it.

    Raises:
        InputError: the resolution is not above 0, or K lies outside 0 to 100.
    """
    if not resolution > 0.0:
        raise InputError(f"resolution: expected a number above 0, found {resolution:g}")
    seed = int(simap.parameters.get("seed", 0))
    community, log = partition_grid(simap.grid, simap.graphs, resolution=resolution, seed=seed)
    k = float(simap.parameters["k_percent"]) if k_percent is None else float(k_percent)
    if not 0.0 <= k <= 100.0:
        raise InputError(f"K: expected a percentage from 0 to 100, found {k:g}")
    origin = replace(origin_of(simap), parameters={**simap.parameters, "k_percent": k, "resolution": float(resolution)})
    views = _share_views(simap, community)
    return assemble(simap.grid, simap.graphs, community, log, views, origin)


def _share_views(simap: SIMap, community: NDArray) -> Views:
    """Hand the views of the old communities to the new ones by overlap."""
    thing = simap.community > 0
    old_of, new_of = simap.community[thing], community[thing]
    pairs, overlap = np.unique((old_of.astype(np.int64) << 32) | new_of, return_counts=True)
    old, new = pairs >> 32, pairs & 0xFFFFFFFF
    sizes = np.bincount(old_of)
    starts = np.searchsorted(old, simap.views.community)
    spans = np.searchsorted(old, simap.views.community, side="right") - starts
    view = np.repeat(np.arange(len(spans)), spans)
    at = np.arange(len(view)) - np.repeat(np.cumsum(spans) - spans, spans) + np.repeat(starts, spans)
    cells = np.round(simap.views.cells[view] * overlap[at] / np.maximum(sizes[old[at]], 1)).astype(np.int32)
    kept = cells > 0
    return Views(
        community=new[at][kept].astype(np.int32),
        frame=simap.views.frame[view][kept],
        segment=simap.views.segment[view][kept],
        cells=cells[kept],
        score=simap.views.score[view][kept],
    )
