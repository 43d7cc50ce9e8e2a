"""Why the map takes an object for one object, and two for two: all of it read off what the map itself carries.

Two kinds of witnesses are counted. *Sightings* are what the map was made of: with method evidence a sighting is one
frame that saw one pair of cells, in the same segment or in two different ones; with method paper it is a pair of
neighbouring pixels of one segment. *Frames* are easier to look at: a frame counts as having seen two parts as one when
the same segment named both ends of more than half of the pairs of their cells that it saw.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.pooling import PoolSettings
from simaps_viz.mapping.simap import JOINING, joining_threshold
from simaps_viz.mapping.why_frames import SourceFrame, Together, seen_together, source_frames
from simaps_viz.structures import CellGraph, Instance, SIMap

NEIGHBOUR_M = 1.0
"""Objects of one class no farther apart than this are neighbours, whether or not anything was seen of both."""


@dataclass(frozen=True, eq=False)
class Joint:
    """One step of the merge log: two parts became one."""

    step: int
    """Position in ``SIMap.merges``."""
    score: float
    """As in the log: share of the source's cells that neighbour the target (paper), pooled affinity (evidence)."""
    source: NDArray
    """int32 [n], communities of the part that joined, ascending."""
    target: NDArray
    """int32 [n], communities of the part it joined, ascending."""
    source_cells: int
    target_cells: int
    same: int
    """Sightings of pairs of cells, one in each part, as one."""
    different: int
    """As two; always 0 with method paper."""


@dataclass(frozen=True)
class Link:
    """What there is between two instances of one class."""

    other: Instance
    same: int
    """Sightings of pairs of cells, one in each instance, as one."""
    different: int
    """As two; always 0 with method paper."""
    score: float
    """What the method would have joined them by: pooled affinity (evidence), the larger of the two shares of cells that
    neighbour the other (paper), NaN for methods without a merge log."""
    distance_m: float
    """Between the nearest edges of their cells, 0 when they touch."""
    touching: bool
    """Some of their cells are 8-neighbours."""
    ends_m: tuple[tuple[float, float], tuple[float, float]]
    """Centres of the two nearest cells, that of the explained instance first. Map frame."""
    together: Together
    """The frames that saw both."""


@dataclass(frozen=True, eq=False)
class Why:
    """Why an instance is one object."""

    instance: Instance
    method: str
    threshold: float
    """What a joint's score must exceed; infinite for methods without a merge log."""
    cells: NDArray
    """int64 [n], its cells (flat), ascending."""
    community: NDArray
    """int32 [n], finest community of each cell."""
    sureness: NDArray
    """float32 [n], how sure the map is that the cell belongs, NaN = nothing speaks for or against it. Evidence:
    same / (same + different) over all pairs it forms with cells of the instance, 0 to 1. Paper: mean weight of its
    edges to cells of the instance."""
    joints: tuple[Joint, ...]
    """The steps of the merge log that made it, in order."""
    weakest: Joint | None
    """The joint of the lowest score (ties: the last); None when it is a single community."""
    together: Together
    """The frames that saw both parts of the weakest joint."""
    neighbours: tuple[Link, ...]
    """Strongest link first, then nearest."""
    frames: tuple[SourceFrame, ...]
    """All frames that named it; those that named most of its cells first."""

    def cells_of(self, communities: NDArray) -> NDArray:
        """Give the instance's cells that lie in some communities, int64 [m], flat, ascending."""
        return self.cells[np.isin(self.community, communities)]


@dataclass(frozen=True)
class Between:
    """What keeps two instances apart."""

    first: Instance
    second: Instance
    method: str
    threshold: float
    link: Link | None
    """From the first to the second; None when they are of different classes."""
    together: Together
    """The frames that saw both."""


def explain(simap: SIMap, instance_id: int) -> Why:
    """Explain an instance.

    Raises:
        InputError: there is no such instance.
    """
    instance = simap.by_id(instance_id)
    flat = simap.instance.reshape(-1)
    cells = np.flatnonzero(flat == instance_id).astype(np.int64)
    community = simap.community.reshape(-1)[cells]
    graph = _graph_of(simap, cells)
    joints = _joints(simap, cells, community, graph)
    weakest = min(reversed(joints), key=lambda joint: joint.score, default=None)
    together = Together((), ())
    if weakest is not None:
        together = seen_together(simap, weakest.source, weakest.target)
    return Why(
        instance=instance,
        method=simap.method,
        threshold=joining_threshold(simap.method, simap.parameters),
        cells=cells,
        community=community,
        sureness=_sureness(simap, cells, graph),
        joints=joints,
        weakest=weakest,
        together=together,
        neighbours=_neighbours(simap, instance, cells, graph),
        frames=source_frames(simap, community),
    )


def between(simap: SIMap, first_id: int, second_id: int) -> Between:
    """Explain what keeps two instances apart.

    Raises:
        InputError: one of them is not on the map.
    """
    first, second = simap.by_id(first_id), simap.by_id(second_id)
    threshold = joining_threshold(simap.method, simap.parameters)
    if first.label != second.label:
        return Between(first, second, simap.method, threshold, None, frames_that(simap, first_id, second_id))
    cells = np.flatnonzero(simap.instance.reshape(-1) == first_id).astype(np.int64)
    (link,) = _links(simap, cells, _graph_of(simap, cells), (second,))
    return Between(first, second, simap.method, threshold, link, link.together)


def frames_that(simap: SIMap, first_id: int, second_id: int) -> Together:
    """Give the frames that saw two instances at once, as one object or as two.

    Raises:
        InputError: one of them is not on the map.
    """
    parts = [np.unique(simap.community[simap.instance == simap.by_id(i).id]) for i in (first_id, second_id)]
    return seen_together(simap, parts[0], parts[1])


def recorded_step(joint: Joint, applied: NDArray) -> int:
    """Give the time of a joint on timeline "merge" of a recorded build.

    Args:
        joint: a step of the recorded build's merge log.
        applied: bool [steps], those that the recorded build took: they come first on the timeline.
    """
    before = int(applied[: joint.step].sum())
    return 1 + (before if applied[joint.step] else int(applied.sum()) + joint.step - before)


def _graph_of(simap: SIMap, cells: NDArray) -> CellGraph | None:
    """Find the graph that holds the cells; whole instances lie in one."""
    label = simap.grid.label.reshape(-1)[cells[0]]
    for graph in simap.graphs:
        if graph.label != label:
            continue
        at = np.searchsorted(graph.cells, cells[0])
        if at < len(graph.cells) and graph.cells[at] == cells[0]:
            return graph
    return None


def _sureness(simap: SIMap, cells: NDArray, graph: CellGraph | None) -> NDArray:
    if graph is None:
        return np.full(len(cells), np.nan, np.float32)
    mine = np.isin(graph.cells, cells)
    inside = mine[graph.edges].all(axis=1)
    ends = graph.edges[inside].T.reshape(-1)
    if simap.method == "paper":
        parts = graph.weights[inside], np.ones(int(inside.sum()))
    else:
        parts = graph.counts[inside], np.add(graph.counts[inside], graph.different[inside], dtype=np.int64)
    above, below = (np.bincount(ends, np.tile(part, 2), minlength=len(graph.cells)) for part in parts)
    ratio = np.divide(above, below, out=np.full(len(graph.cells), np.nan), where=below > 0)
    result = np.full(len(cells), np.nan, np.float32)
    result[np.searchsorted(cells, graph.cells[mine])] = ratio[mine]
    return result


def _joints(simap: SIMap, cells: NDArray, community: NDArray, graph: CellGraph | None) -> tuple[Joint, ...]:
    """Follow the applied steps inside the instance; the evidence of a step is that of the pairs it brought together."""
    log = simap.merges
    names, sizes = np.unique(community, return_counts=True)
    applied = applied_steps(log, joining_threshold(simap.method, simap.parameters))
    steps = np.flatnonzero(applied & np.isin(log.source, names) & np.isin(log.target, names))
    if len(steps) == 0:
        return ()
    members = {name: np.array([i]) for i, name in enumerate(names.tolist())}
    joined_by = np.full((len(names), len(names)), len(steps), dtype=np.int32)
    cells_in = dict(zip(names.tolist(), sizes.tolist(), strict=True))
    sides = []
    for i, (source, target) in enumerate(zip(log.source[steps].tolist(), log.target[steps].tolist(), strict=True)):
        a, b = members.pop(source), members[target]
        joined_by[a[:, None], b] = i
        members[target] = np.sort(np.concatenate([a, b]))
        sides.append((a, b, cells_in[source], cells_in[target]))
        cells_in[target] += cells_in[source]
    joined_by = np.minimum(joined_by, joined_by.T)
    same, different = _sightings_of_steps(cells, np.searchsorted(names, community), joined_by, len(steps), graph)
    return tuple(
        Joint(
            step=int(step),
            score=float(log.score[step]),
            source=names[a],
            target=names[b],
            source_cells=a_cells,
            target_cells=b_cells,
            same=int(same[i]),
            different=int(different[i]),
        )
        for i, (step, (a, b, a_cells, b_cells)) in enumerate(zip(steps, sides, strict=True))
    )


def _sightings_of_steps(
    cells: NDArray, part: NDArray, joined_by: NDArray, steps: int, graph: CellGraph | None
) -> tuple[NDArray, NDArray]:
    """Sum up, for each step, what was seen of the pairs of cells it brought together."""
    if graph is None:
        return np.zeros(steps), np.zeros(steps)
    part_of = np.full(len(graph.cells), -1)
    part_of[np.searchsorted(graph.cells, cells)] = part
    ends = part_of[graph.edges]
    inside = (ends >= 0).all(axis=1) & (ends[:, 0] != ends[:, 1])
    step = joined_by[ends[inside, 0], ends[inside, 1]]
    same = np.bincount(step, graph.counts[inside], minlength=steps + 1)
    different = np.bincount(step, graph.different[inside], minlength=steps + 1)
    return same, different


def _neighbours(simap: SIMap, instance: Instance, cells: NDArray, graph: CellGraph | None) -> tuple[Link, ...]:
    others = tuple(other for other in simap.of_class(instance.label) if other.id != instance.id)
    links = _links(simap, cells, graph, others, near_m=NEIGHBOUR_M)
    return tuple(sorted(links, key=lambda link: (-np.nan_to_num(link.score), link.distance_m, link.other.id)))


def _links(
    simap: SIMap,
    cells: NDArray,
    graph: CellGraph | None,
    others: tuple[Instance, ...],
    *,
    near_m: float = float("inf"),
) -> tuple[Link, ...]:
    """Measure what there is between an instance's cells and others of its class that are near or have evidence."""
    flat, communities = simap.instance.reshape(-1), simap.community.reshape(-1)
    size = int(flat.max(initial=0)) + 1
    mine = np.unique(communities[cells])
    same, different, share = _between_instances(flat, cells, graph, size)
    found = []
    for other, its_cells, a, b in _nearest(simap, cells, others):
        gap = np.abs(a - b)
        distance_m = float(np.hypot(*np.maximum(gap - 1, 0))) * simap.spec.cell_size_m
        seen = int(same[other.id]), int(different[other.id])
        if distance_m > near_m and sum(seen) == 0:
            continue
        touching = int(gap.max()) <= 1
        found.append(
            Link(
                other=other,
                same=seen[0],
                different=seen[1],
                score=_score(simap, *seen, touching=touching, share=float(share[other.id])),
                distance_m=distance_m,
                touching=touching,
                ends_m=(simap.spec.centre_of(*a.tolist()), simap.spec.centre_of(*b.tolist())),
                together=seen_together(simap, mine, np.unique(communities[its_cells])),
            )
        )
    return tuple(found)


def _nearest(
    simap: SIMap, cells: NDArray, others: tuple[Instance, ...]
) -> Iterator[tuple[Instance, NDArray, NDArray, NDArray]]:
    """Give each other instance, its cells, and the (row, col) of the two nearest cells, the first one of ``cells``."""
    flat = simap.instance.reshape(-1)
    wanted = np.zeros(int(flat.max(initial=0)) + 1, dtype=bool)
    wanted[[other.id for other in others]] = True
    theirs = np.flatnonzero(wanted[flat])
    if len(theirs) == 0:
        return
    here, there = (np.column_stack(np.divmod(side, simap.spec.cols)) for side in (cells, theirs))
    apart, nearest = (np.asarray(answer) for answer in KDTree(here).query(there))
    order = np.lexsort((apart, flat[theirs]))
    owners = flat[theirs][order]
    for other in others:
        own = order[slice(*np.searchsorted(owners, [other.id, other.id + 1]))]
        if len(own):
            yield other, theirs[own], here[nearest[own[0]]], there[own[0]]


def _between_instances(
    flat: NDArray, cells: NDArray, graph: CellGraph | None, size: int
) -> tuple[NDArray, NDArray, NDArray]:
    """Sum up what was seen of the pairs between some cells and every instance.

    Returns:
        float64 [size] each: sightings as one, as two, and the larger of the shares of cells that have an edge to a cell
        of the other side.
    """
    if graph is None:
        return np.zeros(size), np.zeros(size), np.zeros(size)
    mine = np.isin(graph.cells, cells)
    crossing = mine[graph.edges[:, 0]] != mine[graph.edges[:, 1]]
    at, away = graph.edges[crossing].T
    swapped = mine[away]
    at, away = np.where(swapped, away, at), np.where(swapped, at, away)
    owner = flat[graph.cells]
    other = owner[away]
    same = np.bincount(other, graph.counts[crossing], minlength=size)
    different = np.bincount(other, graph.different[crossing], minlength=size)
    reached = np.bincount(np.unique(at.astype(np.int64) * size + other) % size, minlength=size)
    reaching = np.bincount(owner[np.unique(away)], minlength=size)
    sizes = np.maximum(np.bincount(flat, minlength=size), 1)
    return same, different, np.maximum(reached / len(cells), reaching / sizes)


def _score(simap: SIMap, same: int, different: int, *, touching: bool, share: float) -> float:
    """Give what the method would have joined two instances by; see `pool` for the affinity."""
    if simap.method not in JOINING:
        return float("nan")
    if simap.method == "paper":
        return share
    settings = PoolSettings(**simap.parameters.get("pooling", {}))
    m, believed = settings.imagined_pairs, settings.touching_same if touching else 0.0
    pairs = same + different + m
    return (same + m * believed) / pairs if pairs > 0.0 else 0.0
