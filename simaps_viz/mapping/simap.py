"""Assemble a SIMap, and partition it anew without looking at the frames again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.appearance import Appearance
from simaps_viz.errors import InputError
from simaps_viz.mapping.method import Slider
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.observations import AllReadings, Readings
from simaps_viz.mapping.paper import K_PERCENT
from simaps_viz.mapping.partition import (
    applied_steps,
    count_ids,
    describe_instances,
    group_views,
    instance_of_community,
    look_up,
)
from simaps_viz.mapping.surface import Surface, surface_among
from simaps_viz.structures import CellGraph, Grid, Instance, MergeLog, SIMap, Views


@dataclass(frozen=True, eq=False)
class Origin:
    """Where a map comes from: everything about it that its partition does not touch."""

    T_map_world: NDArray
    method: str
    parameters: Mapping[str, Any]
    provenance: Mapping[str, Any]
    frame_names: tuple[str, ...]
    T_map_camera: NDArray
    appearance: Appearance | None = None
    room: NDArray | None = None
    room_names: Mapping[int, str] = field(default_factory=dict)
    surface: Surface | None = None
    hidden: tuple[Instance, ...] = ()


def joining_threshold(method: str, parameters: Mapping[str, Any]) -> float:
    """Return the score that a step of the merge log must exceed: K / 100, or the affinity; infinite without a log."""
    slider = method_of(method).slider
    return slider.threshold(parameters[slider.parameter]) if slider is not None else float("inf")


def joining_percent(simap: SIMap) -> float:
    """Return the slider's position for a map, 0 to 100: K, or 100 x the affinity; 0 for a map that has neither."""
    slider = slider_of(simap)
    return slider.percent(simap.parameters.get(slider.parameter, 0.0))


def joining_at(simap: SIMap, percent: float) -> dict[str, float]:
    """Return the parameter that a position of the slider sets, as `repartition` and `recommunity` take it."""
    slider = slider_of(simap)
    return {slider.parameter: slider.value(percent)}


def slider_of(simap: SIMap) -> Slider:
    """Return the slider of a map's method; that of K for a method without one, whose page hides it."""
    return method_of(simap.method).slider or K_PERCENT


def count_views(grid: Grid, community: NDArray, seen: AllReadings) -> Views:
    """Sum up, per community, frame and segment, how many cells the segment named; other classes do not count.

    ``community`` is int32 [rows, cols] of the grid, 0 = none.
    """
    parts = [_views_of(grid, community, part) for part in seen.batches()]
    frames = np.concatenate([part.frame for part in parts])
    both = np.concatenate([part.community for part in parts]), frames, np.concatenate([p.segment for p in parts])
    order = np.arange(len(frames)) if len(parts) == 1 else np.lexsort(both[::-1])  # no frame is in two parts
    return Views(
        community=both[0][order],
        frame=frames[order],
        segment=both[2][order],
        cells=np.concatenate([part.cells for part in parts])[order],
        score=np.concatenate([part.score for part in parts])[order],
    )


def _views_of(grid: Grid, community: NDArray, seen: Readings) -> Views:
    of_cell = community.reshape(-1)[seen.cell]
    kept = (of_cell > 0) & (grid.label.reshape(-1)[seen.cell] == seen.label)
    of_cell, frame, segment = of_cell[kept], seen.frame[kept], seen.segment[kept]
    groups = group_views(of_cell, frame, segment)
    first = groups.first
    return Views(
        community=of_cell[first].astype(np.int32),
        frame=frame[first].astype(np.int32),
        segment=segment[first].astype(np.int32),
        cells=groups.size.astype(np.int32),
        score=seen.score[kept][first].astype(np.float32),
    )


def assemble(
    grid: Grid, graphs: Sequence[CellGraph], community: NDArray, log: MergeLog, views: Views, origin: Origin
) -> SIMap:
    """Put the stages together; the instances follow from ``k_percent`` or ``affinity``, and ``min_cells``.

    ``community`` is int32 [rows, cols], 0 = none, and is kept, not copied.
    """
    applied = applied_steps(log, joining_threshold(origin.method, origin.parameters))
    instance_of = instance_of_community(log, applied, int(community.max(initial=0)))
    cells = np.bincount(instance_of, count_ids(community, len(instance_of)))
    instance_of[cells[instance_of] < int(origin.parameters.get("min_cells", 1))] = 0
    instance = look_up(instance_of, community)
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
        appearance=origin.appearance,
        room=origin.room,
        room_names=origin.room_names,
        surface=origin.surface,
        hidden=origin.hidden,
    )


def origin_of(simap: SIMap) -> Origin:
    """Return the origin that a map was assembled with."""
    return Origin(
        simap.T_map_world, simap.method, simap.parameters, simap.provenance, simap.frame_names, simap.T_map_camera,
        simap.appearance, simap.room, simap.room_names, simap.surface, simap.hidden,
    )  # fmt: skip


def repartition(simap: SIMap, **value: float) -> SIMap:
    """Return the map for another value of its method's slider: a look-up in the merge log.

    Args:
        simap: the map.
        value: ``k_percent`` from 0 to 100 (method paper) or ``affinity`` from 0 to 1 (method evidence).

    Raises:
        InputError: the map's method has no such parameter, or the value is out of range.
    """
    return assemble(
        simap.grid, simap.graphs, simap.community, simap.merges, simap.views,
        replace(origin_of(simap), parameters=_joined(simap, value)),
    )  # fmt: skip


def recommunity(simap: SIMap, *, resolution: float, **value: float) -> SIMap:
    """Return the map for another Louvain resolution, from the stored graphs.

    Views are handed on through the cells' shares, as the frames are not at hand: the new communities of an old one
    take its views in proportion to the cells they share with it. What lies below other things stays with the community
    that got most of its object's cells, and hidden objects get new ids.

    Raises:
        InputError: the resolution is not above 0, the map's method has none, or as for `repartition`.
    """
    if not resolution > 0.0:
        raise InputError(f"resolution: expected a number above 0, found {resolution:g}")
    parameters = {**_joined(simap, value), "resolution": float(resolution)}
    community, log = method_of(simap.method).communities(simap.grid, simap.graphs, parameters)
    surface, hidden = surface_among(simap, community)
    origin = replace(origin_of(simap), parameters=parameters, surface=surface, hidden=hidden)
    return assemble(simap.grid, simap.graphs, community, log, _share_views(simap, community), origin)


def _joined(simap: SIMap, value: Mapping[str, float]) -> dict[str, Any]:
    """Return the map's parameters with another value of its method's slider, checked."""
    slider = method_of(simap.method).slider
    wrong = [name for name in value if slider is None or name != slider.parameter]
    if slider is None or wrong:
        has = f"{slider.parameter} only" if slider else "no slider, and no communities to find anew"
        raise InputError(f"method {simap.method}: expected a map that has {(wrong or ['a merge log'])[0]}, found {has}")
    for one in value.values():
        slider.check(one)
    return {**simap.parameters, **{name: float(one) for name, one in value.items()}}


def _share_views(simap: SIMap, community: NDArray) -> Views:
    """Split the views of the old communities among the new ones by overlap."""
    thing = simap.community > 0
    old_of, new_of = simap.community[thing], community[thing]
    pairs, overlap = np.unique((old_of.astype(np.int64) << 32) | new_of, return_counts=True)
    old, new = pairs >> 32, pairs & 0xFFFFFFFF
    first = np.searchsorted(old, np.arange(int(simap.community.max(initial=0)) + 2))
    view, at, cells = _share(simap.views.community, simap.views.cells, first, overlap, np.bincount(old_of))
    return Views(
        community=new[at].astype(np.int32),
        frame=simap.views.frame[view],
        segment=simap.views.segment[view],
        cells=cells,
        score=simap.views.score[view],
    )


@njit(cache=True, nogil=True)
def _share(
    community: NDArray,  # int32 [views], old
    cells: NDArray,  # int32 [views]
    first: NDArray,  # int64 [old communities + 2]
    overlap: NDArray,  # int64 [overlaps], cells
    sizes: NDArray,  # int64 [old communities + 1], cells
) -> tuple[NDArray, NDArray, NDArray]:
    """Split the cells of every view by overlap; ``overlap[first[c] : first[c + 1]]`` are those of old community c.

    Returns:
        view int32, overlap int32 and cells int32 of each share that rounds to at least one cell.
    """
    room = 0
    for view in range(len(community)):
        room += first[community[view] + 1] - first[community[view]]
    view_of = np.zeros(room, dtype=np.int32)
    at_of = np.zeros(room, dtype=np.int32)
    shared = np.zeros(room, dtype=np.int32)
    n = 0
    for view in range(len(community)):
        old = community[view]
        for at in range(first[old], first[old + 1]):
            share = np.rint(cells[view] * overlap[at] / sizes[old])
            if share > 0.0:
                view_of[n], at_of[n], shared[n] = view, at, np.int32(share)
                n += 1
    return view_of[:n], at_of[:n], shared[:n]
