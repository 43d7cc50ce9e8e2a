"""Why the map takes an object for one object, and two objects for two: explained from what the map itself holds.

Two kinds of evidence are counted. *Sightings* are what the map was made of: with method evidence, a sighting is one
frame that saw one pair of cells, in the same segment or in two different ones; with method paper, it is a pair of
neighbouring pixels of one segment. *Frames* are easier to look at: a frame counts as having seen two parts as one when
the same segment named both ends of more than half of the pairs of their cells that it saw.

`explain` and `between` collect the evidence; the functions at the end put it into words.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from simaps_viz.colors.classes import plural
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.pooling import PoolSettings, affinity
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.structures import SURE_SCORE, CellGraph, Instance, SIMap

NEIGHBOUR_M = 1.0
"""Objects of one class no farther apart than this are neighbours, whether or not any frame saw both."""
PIECE = 0.05
"""A part with a smaller share of the object is a piece: the weakest joint is one of larger parts, if there are any."""


@dataclass(frozen=True)
class PairFrame:
    """A frame that saw two parts at once."""

    frame: int
    """Index into ``SIMap.frame_names``."""
    first: tuple[int, ...]
    """Ids, in that frame's segmentation, of the segments that named cells of the first part. Where the frame saw two
    objects, only those that named more of the first part than of the second."""
    second: tuple[int, ...]
    """The same for the second part."""
    cells: int
    """Number of cells it saw of the part of which it saw fewer."""


@dataclass(frozen=True)
class Together:
    """The frames that saw two parts at once, those that saw most of both first (ties: the earlier frame first)."""

    as_one: tuple[PairFrame, ...]
    as_two: tuple[PairFrame, ...]

    def __len__(self) -> int:
        return len(self.as_one) + len(self.as_two)


@dataclass(frozen=True)
class SourceFrame:
    """A frame whose segments named cells of an instance."""

    frame: int
    """Index into ``SIMap.frame_names``."""
    segments: tuple[int, ...]
    """Ids in that frame's segmentation."""
    cells: int
    """Number of the instance's cells that it named."""
    as_one: bool
    """Whether one segment named both ends of more than half of the pairs of cells it saw."""


@dataclass(frozen=True, eq=False)
class Joint:
    """One step of the merge log: two parts became one."""

    step: int
    """Position in ``SIMap.merges``."""
    score: float
    """From the log: share of the source's cells that neighbour the target (paper), pooled affinity (evidence)."""
    source: NDArray
    """int32 [n], communities of the part that joined, ascending."""
    target: NDArray
    """int32 [n], communities of the part it joined, ascending."""
    source_cells: int
    target_cells: int
    same: int
    """Sightings of a pair of cells, one in each part, as one object."""
    different: int
    """Sightings as two objects; always 0 with method paper."""


@dataclass(frozen=True)
class Link:
    """The evidence on two instances of one class."""

    other: Instance
    same: int
    """Sightings of a pair of cells, one in each instance, as one object."""
    different: int
    """Sightings as two objects; always 0 with method paper."""
    score: float
    """The score that decides whether the method joins them: pooled affinity (evidence), the larger of the two shares of
    cells that neighbour the other instance (paper), NaN for methods without a merge log."""
    distance_m: float
    """Distance between the nearest edges of their cells, 0 when they touch."""
    touching: bool
    """Whether some of their cells are 8-neighbours."""
    ends_m: tuple[tuple[float, float], tuple[float, float]]
    """Centres of the two nearest cells, that of the explained instance first, map frame."""
    together: Together
    """The frames that saw both."""


@dataclass(frozen=True, eq=False)
class Why:
    """Why an instance is one object."""

    instance: Instance
    method: str
    threshold: float
    """What a joint's score must exceed; infinite for methods without a merge log."""
    pooling: PoolSettings
    """What method evidence imagines beforehand."""
    cells: NDArray
    """int64 [n], its cells (flat), ascending."""
    community: NDArray
    """int32 [n], finest community of each cell."""
    sureness: NDArray
    """float32 [n], how sure the map is that each cell belongs to the instance, NaN = no evidence. Method evidence:
    same / (same + different) over all pairs of the cell with cells of the instance, 0 to 1. Method paper: mean weight
    of its edges to cells of the instance."""
    joints: tuple[Joint, ...]
    """The steps of the merge log that made the instance, in order."""
    weakest: Joint | None
    """The joint of the lowest score (ties: the last) that is larger than a `PIECE`, if there is one, else the one with
    the largest piece; None when it is a single community."""
    together: Together
    """The frames that saw both parts of the weakest joint."""
    neighbours: tuple[Link, ...]
    """Strongest link first, then nearest."""
    frames: tuple[SourceFrame, ...]
    """All frames that named it, those that named most of its cells first."""

    def cells_of(self, communities: NDArray) -> NDArray:
        """Return the instance's cells in some communities, int64 [m], flat, ascending."""
        return self.cells[np.isin(self.community, communities)]


@dataclass(frozen=True)
class Between:
    """What keeps two instances apart."""

    first: Instance
    second: Instance
    method: str
    threshold: float
    pooling: PoolSettings
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
    weakest = weakest_of(joints, len(cells))
    together = Together((), ())
    if weakest is not None:
        together = seen_together(simap, weakest.source, weakest.target)
    return Why(
        instance=instance,
        method=simap.method,
        threshold=joining_threshold(simap.method, simap.parameters),
        pooling=_pooling(simap),
        cells=cells,
        community=community,
        sureness=_sureness(simap, cells, graph),
        joints=joints,
        weakest=weakest,
        together=together,
        neighbours=_neighbours(simap, instance, cells, graph),
        frames=source_frames(simap, community),
    )


def weakest_of(joints: Sequence[Joint], cells: int) -> Joint | None:
    """Return the weakest joint of an object of so many cells, see `Why.weakest`."""
    large = [joint for joint in joints if _smaller(joint) >= PIECE * cells]
    if large:
        return min(reversed(large), key=lambda joint: joint.score)
    return max(joints, key=_smaller, default=None)


def weaker_pieces(why: Why) -> bool:
    """Whether small pieces joined with a lower score than that of the weakest joint."""
    return why.weakest is not None and any(joint.score < why.weakest.score for joint in why.joints)


def weakest_name(why: Why) -> str:
    """Return what the weakest joint is called beside the scores of others, of which small pieces may have less."""
    if why.weakest is not None and _smaller(why.weakest) < PIECE * len(why.cells):
        return "joint of the largest piece"
    return "weakest of the larger parts" if weaker_pieces(why) else "weakest joint"


def _smaller(joint: Joint) -> int:
    """Return the number of cells of the smaller part."""
    return min(joint.source_cells, joint.target_cells)


def between(simap: SIMap, first_id: int, second_id: int) -> Between:
    """Explain what keeps two instances apart.

    Raises:
        InputError: one of them is not on the map.
    """
    first, second = simap.by_id(first_id), simap.by_id(second_id)
    threshold = joining_threshold(simap.method, simap.parameters)
    if first.label != second.label:
        together = frames_of_both(simap, first_id, second_id)
        return Between(first, second, simap.method, threshold, _pooling(simap), None, together)
    cells = np.flatnonzero(simap.instance.reshape(-1) == first_id).astype(np.int64)
    (link,) = _links(simap, cells, _graph_of(simap, cells), (second,))
    return Between(first, second, simap.method, threshold, _pooling(simap), link, link.together)


def recorded_step(joint: Joint, applied: NDArray) -> int:
    """Return the time of a joint on timeline "merge" of a recorded build.

    Args:
        joint: a step of the recorded build's merge log.
        applied: bool [steps], which steps the recorded build applied: these come first on the timeline.
    """
    before = int(applied[: joint.step].sum())
    return 1 + (before if applied[joint.step] else int(applied.sum()) + joint.step - before)


def frames_of_both(simap: SIMap, first_id: int, second_id: int) -> Together:
    """Return the frames that saw two instances at once, as one object or as two.

    Raises:
        InputError: one of them is not on the map.
    """
    parts = [np.unique(simap.community[simap.instance == simap.by_id(i).id]) for i in (first_id, second_id)]
    return seen_together(simap, parts[0], parts[1])


def seen_together(simap: SIMap, first: NDArray, second: NDArray) -> Together:
    """Return the frames that saw two groups of communities at once: those that saw one object, those that saw two.

    A frame sees a pair of cells, one in each group, as one where the same segment names both.

    Args:
        simap: the map.
        first: int [n], ids of the communities of one group.
        second: int [m], ids of the communities of the other group, none of which is in the first.
    """
    views = simap.views
    size = max(int(simap.community.max(initial=0)), int(views.community.max(initial=0))) + 1
    group = np.zeros(size, dtype=np.int8)
    group[first], group[second] = 1, 2
    # the views of both groups, in frames that saw both
    of_view = group[views.community]
    kept = np.flatnonzero(of_view)
    kept = kept[_in_both(views.frame[kept], of_view[kept])]
    # how many cells of each group each segment of each frame named
    key = views.frame[kept].astype(np.int64) << 32 | views.segment[kept]
    names, at = np.unique(key, return_inverse=True)
    cells = [np.bincount(at, views.cells[kept] * (of_view[kept] == g), minlength=len(names)) for g in (1, 2)]
    frame, segment = names >> 32, names & 0xFFFFFFFF
    as_one: list[PairFrame] = []
    as_two: list[PairFrame] = []
    for f in np.unique(frame):
        here = slice(*np.searchsorted(frame, [f, f + 1]))
        a, b, ids = cells[0][here], cells[1][here], segment[here]
        # a segment of a cells of one group and b of the other names a * b of the pairs as one
        one = 2.0 * (a @ b) > a.sum() * b.sum()
        first, second = a > 0, b > 0
        if not one:  # a few stray cells of the other part do not make a segment name both
            nearer = a / a.sum() - b / b.sum()
            first, second = (nearer > 0, nearer < 0) if nearer.any() else (first, second)
        seen = PairFrame(int(f), _int_tuple(ids[first]), _int_tuple(ids[second]), int(min(a.sum(), b.sum())))
        (as_one if one else as_two).append(seen)
    return Together(*(tuple(sorted(side, key=lambda one: (-one.cells, one.frame))) for side in (as_one, as_two)))


def _in_both(frame: NDArray, group: NDArray) -> NDArray:
    """Return whether each entry belongs to a frame that has entries of group 1 and of group 2."""
    if len(frame) == 0:
        return np.zeros(0, dtype=bool)
    seen = [np.bincount(frame[group == g], minlength=int(frame.max()) + 1) > 0 for g in (1, 2)]
    return (seen[0] & seen[1])[frame]


def source_frames(simap: SIMap, community: NDArray) -> tuple[SourceFrame, ...]:
    """Return the frames whose segments named cells of some communities, int [n], those that named most first."""
    views = simap.views
    mine = np.isin(views.community, community)
    frames, segments, cells = views.frame[mine], views.segment[mine], views.cells[mine]
    if not mine.any():
        return ()
    # cells named by each segment of each frame, then per frame: their sum, and the sum of their squares
    pairs, at = np.unique(frames.astype(np.int64) << 32 | segments, return_inverse=True)
    named = np.bincount(at, cells)
    names, starts = np.unique(pairs >> 32, return_index=True)
    totals, squares = np.add.reduceat(named, starts), np.add.reduceat(named**2, starts)
    ids = np.split(pairs & 0xFFFFFFFF, starts[1:])
    return tuple(
        SourceFrame(int(names[i]), _int_tuple(ids[i]), int(totals[i]), bool(2.0 * squares[i] > totals[i] ** 2))
        for i in np.lexsort((names, -totals))
    )


def _int_tuple(values: NDArray) -> tuple[int, ...]:
    return tuple(int(value) for value in values)


def _graph_of(simap: SIMap, cells: NDArray) -> CellGraph | None:
    """Return the graph that holds the cells of an instance, which are all in one; None where there is none."""
    label = simap.grid.label.reshape(-1)[cells[0]]
    for graph in simap.graphs:
        if graph.label != label:
            continue
        at = np.searchsorted(graph.cells, cells[0])
        if at < len(graph.cells) and graph.cells[at] == cells[0]:
            return graph
    return None


def _sureness(simap: SIMap, cells: NDArray, graph: CellGraph | None) -> NDArray:
    """Return how sure the map is that each cell belongs to the instance, see `Why.sureness`."""
    if graph is None:
        return np.full(len(cells), np.nan, np.float32)
    mine = np.isin(graph.cells, cells)
    inside = mine[graph.edges].all(axis=1)
    ends = graph.edges[inside].T.reshape(-1)
    if method_of(simap.method).weights_per_frame:
        parts = graph.weights[inside], np.ones(int(inside.sum()))
    else:
        parts = graph.counts[inside], np.add(graph.counts[inside], graph.different[inside], dtype=np.int64)
    above, below = (np.bincount(ends, np.tile(part, 2), minlength=len(graph.cells)) for part in parts)
    ratio = np.divide(above, below, out=np.full(len(graph.cells), np.nan), where=below > 0)
    result = np.full(len(cells), np.nan, np.float32)
    result[np.searchsorted(cells, graph.cells[mine])] = ratio[mine]
    return result


def _pooling(simap: SIMap) -> PoolSettings:
    return PoolSettings(**simap.parameters.get("pooling", {}))


def _joints(simap: SIMap, cells: NDArray, community: NDArray, graph: CellGraph | None) -> tuple[Joint, ...]:
    """Return the applied steps inside the instance; the evidence of a step is that of the pairs it brought together."""
    log = simap.merges
    names, sizes = np.unique(community, return_counts=True)
    applied = applied_steps(log, joining_threshold(simap.method, simap.parameters))
    steps = np.flatnonzero(applied & np.isin(log.source, names) & np.isin(log.target, names))
    if len(steps) == 0:
        return ()
    # replay the steps: which communities each part has, and by which step each pair of communities was joined
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
    """Return, for each step, the sightings as one and as two of the pairs of cells it brought together."""
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
    """Return the links from an instance's cells to other instances of its class that are near, or were seen with it."""
    flat, communities = simap.instance.reshape(-1), simap.community.reshape(-1)
    size = int(flat.max(initial=0)) + 1
    mine = np.unique(communities[cells])
    same, different, share = _between_instances(flat, cells, graph, size)
    # an instance that is neither near nor was seen with this one is no link
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
    """Yield each other instance, its cells, and (row, col) of the two nearest cells, that of ``cells`` first."""
    flat = simap.instance.reshape(-1)
    wanted = np.zeros(int(flat.max(initial=0)) + 1, dtype=bool)
    wanted[[other.id for other in others]] = True
    theirs = np.flatnonzero(wanted[flat])
    if len(theirs) == 0:
        return
    here, there = (np.column_stack(np.divmod(side, simap.spec.cols)) for side in (cells, theirs))
    apart, nearest = (np.asarray(answer) for answer in KDTree(here).query(there))
    # cells by owner, the nearest of each owner first
    order = np.lexsort((apart, flat[theirs]))
    owners = flat[theirs][order]
    for other in others:
        own = order[slice(*np.searchsorted(owners, [other.id, other.id + 1]))]
        if len(own):
            yield other, theirs[own], here[nearest[own[0]]], there[own[0]]


def _between_instances(
    flat: NDArray, cells: NDArray, graph: CellGraph | None, size: int
) -> tuple[NDArray, NDArray, NDArray]:
    """Return the evidence on some cells and every instance.

    Returns:
        Three arrays, float64 [size]: sightings as one, sightings as two, and the larger of the two shares of cells that
        have an edge to the other side.
    """
    if graph is None:
        return np.zeros(size), np.zeros(size), np.zeros(size)
    # edges with one end among the cells, turned so that this end comes first
    mine = np.isin(graph.cells, cells)
    crossing = mine[graph.edges[:, 0]] != mine[graph.edges[:, 1]]
    at, away = graph.edges[crossing].T
    swapped = mine[away]
    at, away = np.where(swapped, away, at), np.where(swapped, at, away)
    # evidence by the instance of the other end
    owner = flat[graph.cells]
    other = owner[away]
    same = np.bincount(other, graph.counts[crossing], minlength=size)
    different = np.bincount(other, graph.different[crossing], minlength=size)
    # cells of either side that have an edge to the other, each cell counted once
    reached = np.bincount(np.unique(at.astype(np.int64) * size + other) % size, minlength=size)
    reaching = np.bincount(owner[np.unique(away)], minlength=size)
    sizes = np.maximum(np.bincount(flat, minlength=size), 1)
    return same, different, np.maximum(reached / len(cells), reaching / sizes)


def _score(simap: SIMap, same: int, different: int, *, touching: bool, share: float) -> float:
    """Return the score that decides whether the method joins two instances; see `pooling.affinity`."""
    return method_of(simap.method).score(simap.parameters, same, different, touching=touching, share=share)


def score_text(method: str, score: float, threshold: float | None = None) -> str:
    """Return a score of the merge log as its method reads it: "19.6 %" of cells (paper), "87 %" of evidence."""
    return method_of(method).score_text(score, threshold)


def needed_text(method: str, threshold: float) -> str:
    """Return the threshold that a score must exceed: "K = 5 %", "60 %"."""
    return method_of(method).needed_text(threshold)


def summary(why: Why, *, by_hand: bool = False) -> str:
    """Explain why an instance is one object, what decided first, and why it has its class.

    Args:
        why: the evidence.
        by_hand: whether people edited the instance; the map's own reason to join its parts does not count then.
    """
    if by_hand:
        return "One object because people made it so by hand, see below."
    return " ".join(filter(None, [_one_object(why), _class_of(why.instance), _weakest(why)]))


def _class_of(one: Instance) -> str:
    """Return the sentence why an instance has its class."""
    if one.frames == 0:
        return ""
    sure = f"{'only ' if one.score < SURE_SCORE else ''}{100.0 * one.score:.0f} % sure on average"
    return f"Class {one.label} because the masks of {plural(one.frames, 'frame')} say so, {sure}."


def joint_words(why: Why, joint: Joint) -> str:
    """Describe the evidence on which a step of the merge log joined its parts."""
    if method_of(why.method).weights_per_frame:
        return f"{score_text(why.method, joint.score, why.threshold)} of the part that joined neighbours the other"
    score = score_text(why.method, joint.score, why.threshold)
    if joint.same + joint.different == 0:
        return f"no frame saw both, but they touch → {score}"
    return f"{_sightings(joint.same, joint.different)} → {score}"


def together_words(together: Together) -> str:
    """Describe how many frames saw two parts at once, and as one object or two."""
    one, two = len(together.as_one), len(together.as_two)
    if one + two == 0:
        return "no frame saw both"
    if one + two == 1:
        return f"seen together in 1 frame, as {'one' if one else 'two'}"
    if one == 0 or two == 0:
        return f"seen together in {one + two} frames, each time as {'one' if one else 'two'}"
    first, then = sorted(((one, "one"), (two, "two")), key=lambda side: -side[0])
    return f"seen together in {one + two} frames: as {first[1]} in {first[0]}, as {then[1]} in {then[0]}"


def link_words(method: str, threshold: float, link: Link) -> str:
    """Describe what keeps two instances of a class apart: "seen together in ... → 11 %, below the 60 % needed"."""
    seen = together_words(link.together)
    if method_of(method).slider is None:
        touch = "their cells touch" if link.touching else "their cells do not touch"
        return f"{touch}; {seen}"
    if method_of(method).weights_per_frame:
        if link.score == 0.0:
            return f"{seen}; no cell of one neighbours a cell of the other"
        share = f"{score_text(method, link.score, threshold)} of the cells of one neighbour the other"
        return f"{seen}; {share}, {_below(method, threshold, link)}"
    if link.same + link.different == 0 and not link.touching:
        why = "too far apart to compare their cells, or open floor between"
        compared = "nothing speaks for one" if len(link.together) == 0 else why
        return f"{compared}; {seen}"
    score = score_text(method, link.score, threshold)
    return f"{score} of what frames saw of their cells says one object, {_below(method, threshold, link)}; {seen}"


def between_words(found: Between, first: str, second: str) -> str:
    """Describe what keeps two instances apart, in sentences.

    Args:
        found: the evidence.
        first: name of the first instance, such as "chair 18".
        second: name of the second instance.
    """
    link = found.link
    if link is None:
        return (
            f"{first} and {second} are of different classes, and the map joins cells of one class only. "
            f"{together_words(found.together).capitalize()}."
        )
    apart = "touch" if link.touching else f"are {link.distance_m:.2f} m apart"
    words = link_words(found.method, found.threshold, link)
    return f"{first} and {second} {apart}: {words}.{_pooled(found, link)}"


def _one_object(why: Why) -> str:
    seen = len(why.frames)
    as_one = sum(frame.as_one for frame in why.frames)
    if seen == 0:
        return "One object because its cells belong together; no frame is known to have named it."
    if as_one == 0:
        return f"One object although none of the {plural(seen, 'frame')} that saw it shows it as one."
    whole = all(len(frame.segments) == 1 for frame in why.frames if frame.as_one)
    entire = all(frame.cells >= len(why.cells) for frame in why.frames if frame.as_one)
    it = "it" if entire else f"what {'it' if seen == 1 else 'they'} saw of it"
    it = it if whole else f"most of {it}"
    which = f"{as_one} of the {seen} frames"
    if as_one == seen:
        which = "the 1 frame" if seen == 1 else f"all {seen} frames"
    reason = "because" if 2 * as_one > seen else "although only"
    return f"One object {reason} {which} that saw it {'shows' if which == 'the 1 frame' else 'show'} {it} as one."


def _weakest(why: Why) -> str:
    if method_of(why.method).slider is None:
        return f"Method {why.method} has no joints to question: it knows no merge log."
    if why.weakest is None:
        return "It is a single patch that was never joined from parts."
    weakest, method = why.weakest, why.method
    # Small pieces may have joined with less than the larger parts: then the lowest score is said, too.
    least = min(why.joints, key=lambda joint: joint.score)
    unseen = "" if least.same + least.different or method_of(method).weights_per_frame else " for what only touches it"
    lowest = score_text(method, least.score, why.threshold) + unseen if weaker_pieces(why) else ""
    if _smaller(weakest) < PIECE * len(why.cells):
        pieces = f"only pieces of at most {plural(_smaller(weakest), 'cell')} joined it"
        return f"Nearly all of it is one patch; {pieces}{lowest and f', the least sure with {lowest}'}."
    says = "" if method_of(method).weights_per_frame else " for one object"
    its = "The weakest joint of its larger parts" if weaker_pieces(why) else "Its weakest joint"
    text = f"{its} ({weakest.target_cells} + {plural(weakest.source_cells, 'cell')}) has "
    score, needed = score_text(method, weakest.score, why.threshold), needed_text(method, why.threshold)
    text += f"{score}{says}, above the {needed} needed: "
    less = lowest and f" Small pieces joined with less, down to {lowest}."
    if len(why.together) == 0:
        alone = "" if method_of(method).weights_per_frame else f", which counts as {score_text(method, weakest.score)}"
        return f"{text}no frame saw both parts, but they touch{alone}.{less}"
    return f"{text}{together_words(why.together)}.{_pooled(why, weakest)}{less}"


def _pooled(found: Why | Between, evidence: Joint | Link) -> str:
    """Return the sentence with what a score is computed from, see `pooling.affinity`."""
    same, different = evidence.same, evidence.different
    if method_of(found.method).weights_per_frame or same + different == 0:
        return ""
    pairs, share = found.pooling.imagined_pairs, found.pooling.touching_same
    apart, touching = (affinity(same, different, touches, pairs, share) for touches in (False, True))
    if abs(touching - evidence.score) < abs(apart - evidence.score):
        imagined = f"{pairs:g} imagined of parts that touch, {pairs * share:.1f} of them as one"
    else:
        imagined = f"{pairs:g} imagined, as two, of parts that do not touch"
    score = score_text(found.method, evidence.score, found.threshold)
    return f" The {score} is counted cell by cell: {_sightings(same, different)}, and {imagined}."


def _below(method: str, threshold: float, link: Link) -> str:
    needed, side = needed_text(method, threshold), "above" if link.score > threshold else "below"
    just = "just " if score_text(method, link.score) == needed else ""  # 59.8 % is nearly 60 %
    return f"{just}{side} the {needed} needed"


def _sightings(same: int, different: int) -> str:
    return f"{same:,} {'sighting' if same == 1 else 'sightings'} as one, {different:,} as two"
