"""Scores in space: objects as voxels of 5 cm against the exact ids, their boxes, and what is on and under what.

Truth. A voxel that three depth pixels or more fell into, over all frames, belongs to the id that most of them show;
with fewer it is neither asked for nor held against a map, as one pixel may graze a voxel's corner. A thing with at
least 15 voxels counts. Found is what a map's points fill; an instance of fewer than 6 voxels is ignored.

Overlap. A shell one voxel thin moves to the next layer with a millimetre, so voxels next to one another count as
equal: P is the share of found voxels at most one voxel from a true one, R the reverse, and the overlap is
F / (2 - F) with F their harmonic mean: the intersection over union if the tolerance were none. ``strict`` is without
it, and ``volume_ratio`` says how many voxels were found for each true one, as filled columns would score too well.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from simaps_viz.baselines import association
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource, read_ahead
from simaps_viz.evaluation.evaluate import NOT_SIMULATED, Build, check_lists, masks_source
from simaps_viz.evaluation.report import FORMAT, Measured, TextTable
from simaps_viz.evaluation.truth import check_exact, find_truth, settings_of
from simaps_viz.events import Progress
from simaps_viz.geometry import back_project, transform_points
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.in_space import (
    FRINGE_PERCENT,
    VOXEL_M,
    X_BITS,
    Z_BITS,
    Relations,
    all_instances,
    among,
    box_of,
    column_points,
    has_voxels,
    majority,
    relations,
    space_points,
    voxel_indices,
    voxel_keys,
    voxels_by_instance,
    whole_objects,
    without_strays,
)
from simaps_viz.structures import Box, Points, Segment, SIMap

TRUE_PIXELS, MIN_TRUE, MIN_FOUND = 3, 15, 6
"""Pixels from which a voxel is true; voxels from which a thing counts, and from which an instance does."""
HIDDEN_BELOW: Final = 0.5
"""A thing is hidden if it is on top in less than this share of its cells."""
MIN_SIDE_M: Final = 0.1
"""Sides of boxes are at least this long in the scores: the truth knows a face to a voxel only."""
LOOSE_IOU: Final = 0.1
"""Box overlap from which two objects are one, for relations."""
_AROUND: Final = np.array([(x << X_BITS) + (y << Z_BITS) for x in (-1, 0, 1) for y in (-1, 0, 1)], np.int64)
_AROUND_3D: Final = (_AROUND[:, None] + np.array([-1, 0, 1])).reshape(-1)
_MAX_IDS: Final = 1 << 16


@dataclass(frozen=True, eq=False)
class SpaceTruth:
    """The true objects of a sequence in space."""

    origin_m: tuple[float, float]
    """A corner of the voxels' grid."""
    cut_m: float
    """Height from which nothing was looked at."""
    below_m: float
    """Nor this far below the floor."""
    labels: Mapping[int, str]
    """{id: class} of all things."""
    classes: Mapping[str, bool]
    """{class: whether it is one of things}."""
    void: NDArray
    """int64, sorted keys of voxels that neither count."""
    voxels: Mapping[int, NDArray]
    """{thing: its voxels, sorted keys}, those too small to count included."""
    below: Mapping[int, NDArray]
    """{thing: its voxels in columns that something else tops}."""
    shown: Mapping[int, float]
    """{thing: share of its columns that it tops}."""

    @property
    def counted(self) -> dict[int, NDArray]:
        """The things that are asked for."""
        return {number: keys for number, keys in self.voxels.items() if len(keys) >= MIN_TRUE}

    def asked(self, found: set[str]) -> list[str]:
        """Return the classes that are scored: those of things, and those found that the scene does not have."""
        things = {name for name, thing in self.classes.items() if thing}
        return sorted(things | found - set(self.classes))

    @property
    def hidden(self) -> set[int]:
        """The things of which less than half is on top."""
        return {number for number, share in self.shown.items() if share < HIDDEN_BELOW}


def space_truth(
    exact: FrameSource,
    T_map_world: NDArray,
    origin_m: tuple[float, float],
    settings: ProjectionSettings,
    *,
    frame_names: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> SpaceTruth:
    """Find the true objects in space.

    Args:
        exact: its masks are the truth and hold world-wide ids.
        T_map_world: map frame of the map to be judged.
        origin_m: a corner of that map's grid.
        settings: depth range and heights of that map.
        frame_names: use only these frames; by default all.
        progress: notified of every frame.

    Raises:
        InputError: the masks are not the truth, or a frame is missing or damaged.
    """
    check_exact(exact)
    parts, known = [np.zeros((0, 4), np.int64)], dict[int, Segment]()
    wanted = None if frame_names is None else set(frame_names)
    for done, (frame, segmentation) in enumerate(read_ahead(exact, color=False), 1):
        if progress:
            progress("finding the true objects in space", done, len(exact))
        if wanted is not None and frame.name not in wanted:
            continue
        known.update({segment.id: segment for segment in segmentation.segments})
        K, depth = frame.intrinsics, frame.depth_m
        near = (depth > settings.near_m) & (depth < settings.far_m)
        camera = back_project(depth, K.fx, K.fy, K.cx, K.cy)[near]
        points = transform_points(np.asarray(T_map_world) @ frame.T_world_camera, camera)
        kept = (points[:, 2] < settings.cut_height_m) & (points[:, 2] > -settings.below_floor_m)
        points, ids = points[kept], segmentation.ids[near][kept].astype(np.int64)

        # A row for each voxel and id: how many pixels, and the highest of them, tenths of a millimetre.
        both = voxel_keys(points, origin_m) * _MAX_IDS + ids
        order = np.argsort(both)
        both, tenths = both[order], (points[order, 2] * 1e4).astype(np.int64)
        if len(both):
            starts = np.flatnonzero(np.r_[True, np.diff(both) != 0])
            peak = np.maximum.reduceat(tenths, starts)
            count = np.diff(starts, append=len(both))
            parts.append(np.stack([both[starts] // _MAX_IDS, both[starts] % _MAX_IDS, count, peak], axis=1))
    rows = np.concatenate(parts)
    column, _, top = _highest(np.stack([rows[:, 0] >> Z_BITS, rows[:, 3], rows[:, 1]], axis=1)).T
    key, owner, total = majority(*rows.T[:3])
    sure = total >= TRUE_PIXELS
    void, key, owner = key[~sure], key[sure], owner[sure]
    labels = {number: segment.label for number, segment in sorted(known.items()) if segment.is_thing}
    classes = dict(zip(exact.labels[1:], exact.is_thing[1:], strict=True))
    return _truth_of(origin_m, settings, labels, classes, void, (key, owner), (column, top))


def truth_of_map(simap: SIMap) -> SpaceTruth:
    """Take the objects of a map with a surface for the true ones, so that another map can be scored by it.

    Small patches apart from an object are neither asked for nor held against the other map.
    """
    origin_m, points = origin_of_voxels(simap), space_points(simap)
    key, owner, _ = majority(voxel_keys(points.positions, origin_m), points.instances.astype(np.int64))
    tops = np.flatnonzero(np.diff(key >> Z_BITS, append=-1))  # keys ascend by height within a column
    topped = key[tops] >> Z_BITS, owner[tops]
    labels = {one.id: one.label for one in all_instances(simap)}
    kept = [without_strays(key[owner == number]) for number in labels]
    void = (owner > 0) & ~among(key, _joined(kept))
    classes = dict(zip(simap.grid.labels[1:], simap.grid.is_thing[1:], strict=True))
    owned = key[~void], owner[~void]
    return _truth_of(origin_m, settings_of(simap), labels, classes, key[void], owned, topped)


def origin_of_voxels(simap: SIMap) -> tuple[float, float]:
    """Return a corner of the voxels that a map is scored in, which coincide with its cells of 5 cm."""
    return simap.spec.x0_m % VOXEL_M, simap.spec.y0_m % VOXEL_M


def _truth_of(
    origin_m: tuple[float, float],
    settings: ProjectionSettings,
    labels: Mapping[int, str],
    classes: Mapping[str, bool],
    void: NDArray,
    owned: tuple[NDArray, NDArray],
    topped: tuple[NDArray, NDArray],
) -> SpaceTruth:
    """Describe the things of ``labels`` by who owns each voxel, and who tops each column; keys ascend."""
    (key, owner), (column, top) = owned, topped
    voxels, below, shown = {}, {}, {}
    for number in labels:
        mine = key[owner == number]
        if len(mine):
            voxels[number] = mine
            columns = np.unique(mine >> Z_BITS)
            below[number] = mine[top[np.searchsorted(column, mine >> Z_BITS)] != number]
            shown[number] = float((top[np.searchsorted(column, columns)] == number).mean())
    return SpaceTruth(
        origin_m, settings.cut_height_m, settings.below_floor_m, labels, classes, void, voxels, below, shown
    )


def _highest(rows: NDArray) -> NDArray:
    """Return the row of each column, ascending, with the greatest height; of equals the greatest id. int64 [n, 3]."""
    rows = rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
    return rows[np.r_[np.diff(rows[:, 0]) != 0, True]] if len(rows) else rows


@dataclass(frozen=True)
class SpaceScore:
    """How well instances match the true ones."""

    pq: float | None
    """Panoptic quality, sq x rq; None where nothing is asked for."""
    sq: float
    """Mean overlap of the matches above .5."""
    rq: float
    f1_25: float
    """At an overlap of .25."""
    f1_50: float
    true: int
    found: int
    matched: int


@dataclass(frozen=True)
class Agreement:
    """How many statements are right."""

    f1: float | None
    """None where nothing was asked for or said."""
    right: int
    false: int
    missed: int


@dataclass(frozen=True)
class BoxScore:
    """How well boxes and relations agree with the true ones."""

    best_iou: float
    """Mean over the true things of the best overlap with a box of their class, of classes that were found."""
    f1_25: float
    f1_50: float
    share_50: float
    """Share of all true things matched at .5."""
    on: Agreement
    under: Agreement


@dataclass(frozen=True)
class SpaceScores:
    """Everything measured of one map."""

    overall: SpaceScore
    strict: SpaceScore
    """The same without tolerance."""
    hidden: SpaceScore
    """Of the things of which less than half is on top."""
    by_class: Mapping[str, SpaceScore]
    below_recall: float
    """Of the true voxels in columns that something else tops, the share that the right instance holds."""
    volume_ratio: float
    """Found voxels of the matches for each true one."""
    covered: float
    """Share of the true things' voxels that have any point, whatever it is called."""
    boxes: BoxScore

    def to_json(self) -> dict[str, Any]:
        """Return it JSON-able."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Found:
    """Instances to be judged."""

    voxels: Mapping[int, NDArray]
    """{instance: sorted keys}."""
    objects: Mapping[int, NDArray]
    """The same with all their voxels, small instances too."""
    labels: Mapping[int, str]
    """{instance: class} of all of them."""
    everything: NDArray
    """int64, sorted keys of all voxels with a point, stuff too."""


def found_in(points: Points, names: Sequence[str], truth: SpaceTruth) -> Found:
    """Return the instances of a cloud in the truth's voxels, and those large enough to be judged."""
    height = points.positions[:, 2]
    kept = np.isfinite(points.positions).all(axis=1) & (height < truth.cut_m) & (height > -truth.below_m)
    points = Points(points.positions[kept], points.colors[kept], points.classes[kept], points.instances[kept])
    objects = voxels_by_instance(points, truth.origin_m)
    voxels = {number: keys[~among(keys, truth.void)] for number, keys in objects.items()}
    ids, classes, _ = majority(points.instances.astype(np.int64), points.classes.astype(np.int64))
    labels = {int(n): str(names[int(c)]) if c >= 0 else "" for n, c in zip(ids, classes, strict=True)}
    return Found(
        {number: keys for number, keys in voxels.items() if len(keys) >= MIN_FOUND},
        objects,
        labels,
        np.unique(voxel_keys(points.positions, truth.origin_m)),
    )


def score_space(points: Points, names: Sequence[str], truth: SpaceTruth) -> SpaceScores:
    """Score a cloud with instances.

    Args:
        points: map frame of the truth.
        names: class names that ``points.classes`` refers to.
        truth: from `space_truth`.
    """
    found, counted = found_in(points, names, truth), truth.counted
    small = [(truth.labels[number], keys) for number, keys in truth.voxels.items() if number not in counted]
    near_true = {number: _grown(keys) for number, keys in counted.items()}
    near_found = {number: _grown(keys) for number, keys in found.voxels.items()}
    classes = []
    for label in truth.asked({found.labels[number] for number in found.voxels}):
        true = [number for number in counted if truth.labels[number] == label]
        mine = [number for number in found.voxels if found.labels[number] == label]
        loose, strict = _overlaps(true, mine, counted, found.voxels, near_true, near_found)
        # What matches nothing and lies on a true thing too small to be asked for is excused.
        matched = {b for _, b in best_pairs(loose, 0.5, above=True) + best_pairs(loose, 0.25)}
        excuses = _joined(keys for _, keys in small), _grown(_joined(keys for name, keys in small if name == label))
        asked = [
            b in matched or max(float(among(found.voxels[number], part).mean()) for part in excuses) <= 0.5
            for b, number in enumerate(mine)
        ]
        mine = [number for number, is_asked in zip(mine, asked, strict=True) if is_asked]
        if true or mine:
            classes.append(_Class(label, true, mine, loose[:, asked], strict[:, asked]))

    # The same matches among what is hidden: a false one counts where most of it lies on hidden things.
    hidden_only = [_hidden_part(one, found.voxels, near_true, truth.hidden) for one in classes]
    matches = [(one.true[a], one.mine[b]) for one in classes for a, b in best_pairs(one.loose, 0.5, above=True)]
    partner = {one.true[a]: one.mine[b] for one in classes for a, b in best_pairs(one.loose, 0.25)} | dict(matches)
    held = sum(int(among(truth.below[number], near_found[other]).sum()) for number, other in partner.items())
    below = sum(len(truth.below[number]) for number in counted)
    everything = _joined(counted.values())
    return SpaceScores(
        overall=_Tally.sum([one.tally(one.loose) for one in classes]).score(),
        strict=_Tally.sum([one.tally(one.strict) for one in classes]).score(),
        hidden=_Tally.sum(hidden_only).score(),
        by_class={one.label: one.tally(one.loose).score() for one in classes},
        below_recall=held / max(below, 1),
        volume_ratio=sum(len(found.voxels[b]) for _, b in matches) / max(sum(len(counted[a]) for a, _ in matches), 1),
        covered=float(among(everything, _grown(found.everything)).mean()) if len(everything) else 0.0,
        boxes=_score_boxes(whole_objects(found.objects, found.labels), found.labels, truth),
    )


@dataclass(frozen=True, eq=False)
class _Class:
    """The things and instances of one class, and how far each two overlap."""

    label: str
    true: list[int]
    mine: list[int]
    loose: NDArray
    strict: NDArray

    def tally(self, overlap: NDArray) -> "_Tally":
        hits = [float(overlap[pair]) for pair in best_pairs(overlap, 0.5, above=True)]
        return _Tally(len(self.true), len(self.mine), hits, len(best_pairs(overlap, 0.25)))


def _hidden_part(
    one: _Class, voxels: Mapping[int, NDArray], near_true: Mapping[int, NDArray], hidden: set[int]
) -> "_Tally":
    """Return the tally of a class's hidden things."""
    hides = {a for a, number in enumerate(one.true) if number in hidden}
    matches, matches_25 = best_pairs(one.loose, 0.5, above=True), best_pairs(one.loose, 0.25)
    taken = {b: a for a, b in [*matches_25, *matches]}
    false = [
        taken[b] in hides if b in taken else _lies_on_hidden(voxels[number], near_true, hidden)
        for b, number in enumerate(one.mine)
    ]
    hits = [float(one.loose[a, b]) for a, b in matches if a in hides]
    return _Tally(len(hides), sum(false), hits, sum(a in hides for a, _ in matches_25))


@dataclass(frozen=True)
class _Tally:
    true: int
    found: int
    hits: list[float]
    """Overlaps of the matches above .5."""
    hits_25: int

    @classmethod
    def sum(cls, parts: Sequence["_Tally"]) -> "_Tally":
        hits = [hit for part in parts for hit in part.hits]
        return cls(sum(p.true for p in parts), sum(p.found for p in parts), hits, sum(p.hits_25 for p in parts))

    def score(self) -> SpaceScore:
        both, n = max(self.true + self.found, 1), len(self.hits)
        pq = 2 * sum(self.hits) / both if self.true else None
        sq = float(np.mean(self.hits)) if n else 0.0
        return SpaceScore(pq, sq, 2 * n / both, 2 * self.hits_25 / both, 2 * n / both, self.true, self.found, n)


def best_pairs(overlap: NDArray, least: float, *, above: bool = False) -> list[tuple[int, int]]:
    """Return the one-to-one pairs (row, column) of greatest total overlap among those of at least ``least``.

    Args:
        overlap: float [n, m].
        least: what a pair needs; with ``above``, it needs more than that.
        above: see ``least``.
    """
    if overlap.size == 0:
        return []
    weights = np.where(overlap > least if above else overlap >= least, overlap, 0.0)
    rows, columns = linear_sum_assignment(weights, maximize=True)
    return [(int(a), int(b)) for a, b in zip(rows, columns, strict=True) if weights[a, b] > 0.0]


def _overlaps(
    true: Sequence[int],
    mine: Sequence[int],
    counted: Mapping[int, NDArray],
    found: Mapping[int, NDArray],
    near_true: Mapping[int, NDArray],
    near_found: Mapping[int, NDArray],
) -> tuple[NDArray, NDArray]:
    """Return the tolerant and the strict overlap of each true thing with each instance, float64 [true, mine]."""
    loose, strict = np.zeros((2, len(true), len(mine)))
    for a, number in enumerate(true):
        for b, other in enumerate(mine):
            precision = among(found[other], near_true[number]).mean()
            if precision == 0.0:
                continue
            recall = among(counted[number], near_found[other]).mean()
            f = 2 * precision * recall / (precision + recall)
            loose[a, b] = f / (2 - f)
            both = among(found[other], counted[number]).sum()
            strict[a, b] = both / (len(found[other]) + len(counted[number]) - both)
    return loose, strict


def _lies_on_hidden(keys: NDArray, near_true: Mapping[int, NDArray], hidden: set[int]) -> bool:
    touched = {number: int(among(keys, near).sum()) for number, near in near_true.items()}
    on_hidden = sum(count for number, count in touched.items() if number in hidden)
    return on_hidden > sum(touched.values()) - on_hidden


def _grown(keys: NDArray) -> NDArray:
    """Return the voxels and all that touch them, sorted; `numpy.unique` would hash them, which takes twice as long."""
    keys = np.sort((keys[:, None] + _AROUND_3D).reshape(-1))
    return keys[np.diff(keys, prepend=-1) != 0]


def _joined(parts: Iterable[NDArray]) -> NDArray:
    return np.sort(np.concatenate([np.zeros(0, np.int64), *parts]))


def _score_boxes(objects: Mapping[int, NDArray], labels: Mapping[int, str], truth: SpaceTruth) -> BoxScore:
    """Score boxes and relations, found in the same way as the true ones."""
    counted = truth.counted
    true_boxes, boxes = (
        {n: _fair(box_of(keys, truth.origin_m, trim_percent=trim), truth.cut_m) for n, keys in side.items()}
        for side, trim in ((counted, 0.0), (objects, FRINGE_PERCENT))
    )
    small = [voxel_indices(keys) for number, keys in truth.voxels.items() if number not in counted]

    def in_small(number: int) -> bool:
        at = (np.array(boxes[number].center_m) - (*truth.origin_m, 0.0)) / VOXEL_M - 0.5
        return any(((at >= cells.min(0) - 1) & (at <= cells.max(0) + 1)).all() for cells in small)

    totals, best, partner = np.zeros(4, np.int64), list[float](), dict[int, int]()
    for label in truth.asked({labels[number] for number in objects}):
        true = [number for number in counted if truth.labels[number] == label]
        mine = [number for number in objects if labels[number] == label]
        overlap = np.array([[box_iou(true_boxes[a], boxes[b]) for b in mine] for a in true])
        overlap = overlap.reshape(len(true), len(mine))
        same = {mine[b]: true[a] for a, b in best_pairs(overlap, LOOSE_IOU)}
        partner |= same
        asked = sum(number in same or not in_small(number) for number in mine)
        totals += [len(true), asked, len(best_pairs(overlap, 0.25)), len(best_pairs(overlap, 0.5))]
        best += overlap.max(axis=1).tolist() if mine else []
    true, mine, at_25, at_50 = totals.tolist()
    excused = {number for number in boxes if number not in partner and in_small(number)}
    things = {number: keys for number, keys in objects.items() if truth.classes.get(labels[number], True)}
    on, under = _score_relations(relations(counted), relations(things), partner, excused)
    return BoxScore(
        best_iou=float(np.mean(best)) if best else 0.0,
        f1_25=2 * at_25 / max(true + mine, 1),
        f1_50=2 * at_50 / max(true + mine, 1),
        share_50=at_50 / max(true, 1),
        on=on,
        under=under,
    )


def _score_relations(
    true: Mapping[int, Relations], own: Mapping[int, Relations], partner: Mapping[int, int], excused: set[int]
) -> tuple[Agreement, Agreement]:
    """Score *on*, where any of several that hold an object is right, and *under*.

    Args:
        true: of the true things.
        own: of the instances.
        partner: {instance: the true thing it is}.
        excused: instances that are things too small to count.
    """
    pairs, unknown = _in_true_terms({(a, next(iter(r.on))) for a, r in own.items() if r.on}, partner, excused)
    right = {a for a, b in pairs if b in true[a].on}
    wrong = sum(b not in true[a].on for a, b in pairs)
    on = _agreement(len(right), unknown + wrong, sum(bool(r.on) and a not in right for a, r in true.items()))

    pairs, unknown = _in_true_terms({(a, b) for a, r in own.items() for b in r.under}, partner, excused)
    moot = {(b, a) for a, r in true.items() for b in r.on}  # what is on something has it below
    asked = {(a, b) for a, r in true.items() for b in r.under} - moot
    pairs -= moot
    return on, _agreement(len(pairs & asked), unknown + len(pairs - asked), len(asked - pairs))


def _in_true_terms(
    said: set[tuple[int, int]], partner: Mapping[int, int], excused: set[int]
) -> tuple[set[tuple[int, int]], int]:
    """Return pairs of instances as pairs of true things, and how many have an end that is none."""
    known = {(partner[a], partner[b]) for a, b in said if a in partner and b in partner}
    unknown = [pair for pair in said if not set(pair) <= set(partner) and not set(pair) & excused]
    return known, len(unknown)


def _agreement(right: int, false: int, missed: int) -> Agreement:
    asked = 2 * right + false + missed
    return Agreement(2 * right / asked if asked else None, right, false, missed)


def _fair(box: Box, cut_m: float) -> Box:
    """Return the part of a box below the cut, with no side shorter than the truth is exact."""
    x, y, z = box.center_m
    length, width, height = box.size_m
    high = min(z + height / 2, cut_m)
    low = min(z - height / 2, high)
    sides = (max(length, MIN_SIDE_M), max(width, MIN_SIDE_M), max(high - low, MIN_SIDE_M))
    return Box((x, y, (low + high) / 2), sides, box.yaw_rad)


def box_iou(one: Box, other: Box) -> float:
    """Return the intersection over union of two upright boxes."""
    high = min(one.center_m[2] + one.size_m[2] / 2, other.center_m[2] + other.size_m[2] / 2)
    low = max(one.center_m[2] - one.size_m[2] / 2, other.center_m[2] - other.size_m[2] / 2)
    apart = np.hypot(one.center_m[0] - other.center_m[0], one.center_m[1] - other.center_m[1])
    if high <= low or 2.0 * apart >= np.hypot(*one.size_m[:2]) + np.hypot(*other.size_m[:2]):
        return 0.0
    both = _area(_clipped(one.corners_m[:4, :2], other.corners_m[:4, :2])) * (high - low)
    return both / (float(np.prod(one.size_m)) + float(np.prod(other.size_m)) - both)


def _clipped(ring: NDArray, by: NDArray) -> NDArray:
    """Return the part of a convex polygon inside a counter-clockwise convex one (Sutherland-Hodgman).

    OpenCV's `intersectConvexConvex` finds nothing in common of two boxes that are shifted along one of their sides.
    """
    for start, end in zip(by, np.roll(by, -1, axis=0), strict=True):
        if len(ring) == 0:
            break
        edge = end - start
        side = edge[0] * (ring[:, 1] - start[1]) - edge[1] * (ring[:, 0] - start[0])
        after, side_after = np.roll(ring, -1, axis=0), np.roll(side, -1)
        kept = []
        for point, beyond, here, there in zip(ring, after, side, side_after, strict=True):
            if here >= 0.0:
                kept.append(point)
            if (here >= 0.0) != (there >= 0.0):
                kept.append(point + (beyond - point) * here / (here - there))
        ring = np.array(kept).reshape(-1, 2)
    return ring


def _area(ring: NDArray) -> float:
    x, y = ring.T if len(ring) else np.zeros((2, 0))
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2.0


COLUMNS = "columns"
"""Row of the baseline: the filled columns of a map's cells."""


@dataclass(frozen=True, eq=False)
class SpaceRun:
    """One map, scored in space."""

    method: str
    """Such as "evidence", or "evidence, columns" for what its top-down map knows of space."""
    errors: str
    seed: int
    scores: SpaceScores


@dataclass(frozen=True, eq=False)
class SpaceReport:
    """All runs of one sequence."""

    name: str
    path: Path
    truth_source: str
    runs: tuple[SpaceRun, ...]

    def table(self) -> TextTable:
        """Lay it out: a row for each errors and method, mean ± spread over the seeds."""
        rows = dict.fromkeys((run.errors, run.method) for run in self.runs)
        body = []
        for row in rows:
            scores = [run.scores for run in self.runs if (run.errors, run.method) == row]
            body.append((*row, *(Measured.over([take(s) for s in scores]).text(n) for _, n, take in _COLUMNS)))
        title = f"{self.name}: objects in space (exact ids by {self.truth_source})"
        columns = ("errors", "method", *(name for name, _, _ in _COLUMNS))
        return TextTable(title, columns, tuple(body), words=2, note=LEGEND)

    def to_json(self) -> dict[str, Any]:
        """Return ``format``, ``task``, ``name``, ``sequence``, ``truth``, and ``rows`` with all scores, one a run."""
        rows = [
            {"method": run.method, "errors": run.errors, "seed": run.seed, **run.scores.to_json()} for run in self.runs
        ]
        return {
            "format": FORMAT, "task": "3d", "name": self.name, "sequence": str(self.path),
            "truth": self.truth_source, "rows": rows,
        }  # fmt: skip


_COLUMNS: tuple[tuple[str, int, Callable[[SpaceScores], float | None]], ...] = (
    ("PQ", 3, lambda s: s.overall.pq),
    ("F1 .25", 3, lambda s: s.overall.f1_25),
    ("F1 .5", 3, lambda s: s.overall.f1_50),
    ("true", 0, lambda s: s.overall.true),
    ("found", 0, lambda s: s.overall.found),
    ("strict PQ", 3, lambda s: s.strict.pq),
    ("volume", 2, lambda s: s.volume_ratio),
    ("hidden", 0, lambda s: s.hidden.true),
    ("matched", 0, lambda s: s.hidden.matched),
    ("below", 3, lambda s: s.below_recall),
    ("box F1 .25", 3, lambda s: s.boxes.f1_25),
    ("box F1 .5", 3, lambda s: s.boxes.f1_50),
    ("on F1", 3, lambda s: s.boxes.on.f1),
    ("under F1", 3, lambda s: s.boxes.under.f1),
)
LEGEND = (
    "PQ and F1 on surface voxels of 5 cm; neighbouring voxels count as equal (strict PQ: not). volume: found voxels\n"
    "for each true one; hidden, matched: things of which less than half is on top; below: share of the voxels below\n"
    "something else that the right instance holds. Columns: the cells of the top-down map, filled down to the floor.\n"
    "ConceptGraphs' association is re-implemented here on 5 cm voxels with known classes, without its CLIP vectors."
)


def evaluate_space(
    sequence: PosedFrames,
    methods: Sequence[str],
    *,
    errors: Sequence[str],
    seeds: Sequence[int] = (0,),
    build: Build,
    truth: Path | None = None,
    progress: Progress | None = None,
) -> SpaceReport:
    """Build maps by all methods, from all kinds of masks, and score them in space.

    Args:
        sequence: exact ids, or masks by a network with the exact ids beside them.
        methods: names that ``build`` knows.
        errors: of `evaluate.ERRORS`.
        seeds: of the simulated errors.
        build: builds a map by the method of a name.
        truth: manifest with exact ids, if it is not to be looked for.
        progress: notified of every step.

    Raises:
        InputError: there is no truth, or no such errors, or something is asked for twice or not at all.
    """
    check_lists(methods, errors, seeds)
    exact, runs, truths = find_truth(sequence, truth), [], dict[tuple, SpaceTruth]()
    plan = [(e, s) for e in errors for s in (seeds if e not in NOT_SIMULATED else seeds[:1])]
    for done, (kind, seed) in enumerate(plan):
        source = masks_source(sequence, exact, kind, seed, progress)
        for at, method in enumerate(methods):
            if progress:
                progress("building and scoring maps", done * len(methods) + at, len(plan) * len(methods))
            simap = build(source, method)
            origin_m = origin_of_voxels(simap)
            key = settings_of(simap), np.asarray(simap.T_map_world).tobytes(), *np.round(origin_m, 6)
            if key not in truths:
                truths[key] = space_truth(exact, simap.T_map_world, origin_m, settings_of(simap))
            clouds = {method: space_points(simap)} if has_voxels(simap) else {}
            if at == 0 or not clouds:
                clouds[f"{method}, {COLUMNS}"] = column_points(simap)
            if at == len(methods) - 1:
                clouds[association.NAME] = association.associated_points(
                    source, simap.T_map_world, origin_m, settings_of(simap)
                )
            for name, cloud in clouds.items():
                names = source.labels if name == association.NAME else simap.grid.labels
                runs.append(SpaceRun(name, kind, seed, score_space(cloud, names, truths[key])))
    if progress:
        progress("building and scoring maps", len(plan) * len(methods), len(plan) * len(methods))
    ordered = sorted(runs, key=lambda run: errors.index(run.errors))
    return SpaceReport(sequence.name, sequence.path, exact.segmentation_source, tuple(ordered))
