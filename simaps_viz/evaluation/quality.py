"""Scores of a map: against the truth, or against how many objects of a class a person counted.

Scores against the truth are panoptic quality, average precision, splits and mergers, right classes. All follow from one
table of which found instance lies on which true one, cell by cell.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.evaluation.truth import Truth, check_same_frame, joint_window, whole_cells
from simaps_viz.geometry import moved
from simaps_viz.language.words import Vocabulary
from simaps_viz.structures import Grid, SIMap


@dataclass(frozen=True)
class ScoringRules:
    """What counts."""

    min_true_cells: int = 20
    """A true instance that tops fewer cells is not asked for."""
    min_found_cells: int = 8
    """A found instance of fewer cells is ignored."""
    notable_share: float = 0.25
    """Share of a true instance's cells from which a found one is said to cover it (for splits and mergers)."""

    def __post_init__(self) -> None:
        for name, value in (("true", self.min_true_cells), ("found", self.min_found_cells)):
            if value < 1:
                raise InputError(f"smallest {name} instance: expected at least 1 cell, found {value}")
        if not 0.0 < self.notable_share <= 0.5:
            raise InputError(f"notable share: expected above 0, at most 0.5, found {self.notable_share:g}")


@dataclass(frozen=True, eq=False)
class Objects:
    """One side of the comparison. All arrays are aligned and sorted by id."""

    ids: NDArray
    """int64 [n], > 0."""
    cells: NDArray
    """int64 [n]."""
    label: NDArray
    """int64 [n], index into the names both sides share; the class of most of its cells."""
    counts: NDArray
    """bool [n]: takes part in the scores."""


@dataclass(frozen=True, eq=False)
class Overlaps:
    """True and found instances, and the cells they share."""

    labels: tuple[str, ...]
    """Class names of both sides; index 0 is "none"."""
    true: Objects
    found: Objects
    pairs: NDArray
    """int64 [p, 3]: position in ``true``, position in ``found``, cells they share (> 0)."""
    iou: NDArray
    """float64 [p]: shared cells / cells of either."""
    right_cells: NDArray
    """int64 [labels]: cells on which truth and map name this thing class."""
    either_cells: NDArray
    """int64 [labels]: cells on which truth or map name it."""
    either_thing_cells: int
    """Cells on which truth or map name any thing class."""
    rules: ScoringRules

    @property
    def same_class(self) -> NDArray:
        """Bool [p]: both sides count and have the same class."""
        true, found = self.pairs[:, 0], self.pairs[:, 1]
        both = self.true.counts[true] & self.found.counts[found]
        return both & (self.true.label[true] == self.found.label[found])

    @property
    def matched(self) -> NDArray:
        """Bool [p]: same class, IoU above 0.5. Such a pair is the only one of both its members."""
        return self.same_class & (self.iou > 0.5)

    @property
    def covering(self) -> NDArray:
        """Bool [p]: same class, and the found one has a notable share of the true one's cells."""
        shared, size = self.pairs[:, 2], self.true.cells[self.pairs[:, 0]]
        return self.same_class & (shared >= self.rules.notable_share * size)

    @property
    def split(self) -> NDArray:
        """Bool [true]: covered by two or more found ones."""
        return np.bincount(self.pairs[self.covering, 0], minlength=len(self.true.ids)) >= 2

    @property
    def merged(self) -> NDArray:
        """Bool [found]: covers two or more true ones."""
        return np.bincount(self.pairs[self.covering, 1], minlength=len(self.found.ids)) >= 2


def find_overlaps(simap: SIMap, truth: Truth, rules: ScoringRules | None = None) -> Overlaps:
    """Lay a map on its truth. Windows may differ; every cell of either counts.

    Raises:
        InputError: they lie in different map frames, or their cells do not coincide.
    """
    rules = rules or ScoringRules()
    check_same_frame(simap, truth)
    labels, map_index, truth_index, is_thing = _shared_names(simap, truth)
    window = joint_window(simap.spec, truth.spec)

    def flat(cells: NDArray, spec_of: SIMap | Truth) -> NDArray:
        return moved(cells, whole_cells(spec_of.spec, window), window.shape, 0).reshape(-1)

    found_id, true_id = flat(simap.instance, simap), flat(truth.instance, truth)
    found_label, true_label = map_index[flat(simap.grid.label, simap)], truth_index[flat(truth.label, truth)]
    true, true_at = _objects(true_id, true_label, len(labels))
    found, found_at = _objects(found_id, found_label, len(labels))
    both = (true_at >= 0) & (found_at >= 0)
    key, shared = np.unique(true_at[both] * max(len(found.ids), 1) + found_at[both], return_counts=True)
    pairs = np.stack([*np.divmod(key, max(len(found.ids), 1)), shared], axis=1).astype(np.int64)
    either = true.cells[pairs[:, 0]] + found.cells[pairs[:, 1]] - pairs[:, 2]
    things = is_thing[true_label] | is_thing[found_label]
    return Overlaps(
        labels=labels,
        true=replace(true, counts=true.cells >= rules.min_true_cells),
        found=replace(found, counts=_found_counts(true, found, pairs, rules)),
        pairs=pairs,
        iou=pairs[:, 2] / np.maximum(either, 1),
        right_cells=np.bincount(true_label[things & (true_label == found_label)], minlength=len(labels)),
        either_cells=np.bincount(true_label[things], minlength=len(labels))
        + np.bincount(found_label[things & (true_label != found_label)], minlength=len(labels)),
        either_thing_cells=int(things.sum()),
        rules=rules,
    )


def _shared_names(simap: SIMap, truth: Truth) -> tuple[tuple[str, ...], NDArray, NDArray, NDArray]:
    """Number the classes of both sides together: names, map index -> shared, truth index -> shared, is it a thing."""
    labels = tuple(dict.fromkeys((*truth.labels, *simap.grid.labels)))
    index_of = {name: i for i, name in enumerate(labels)}

    def table(names: Sequence[str]) -> NDArray:
        return np.array([index_of[name] for name in names], dtype=np.int64)

    is_thing = np.zeros(len(labels), dtype=bool)
    is_thing[table(simap.grid.labels)] = simap.grid.is_thing
    is_thing[table(truth.labels)] = truth.grid.is_thing
    return labels, table(simap.grid.labels), table(truth.labels), is_thing


def _objects(instance: NDArray, label: NDArray, labels: int) -> tuple[Objects, NDArray]:
    """Measure the instances of one side; also int64 [cells]: the position of each cell's instance, -1 = none."""
    size = np.bincount(instance)
    ids = np.flatnonzero(size[1:]) + 1
    position = np.full(len(size), -1, dtype=np.int64)
    position[ids] = np.arange(len(ids))
    at = position[instance]
    votes = np.bincount(at[at >= 0] * labels + label[at >= 0], minlength=len(ids) * labels).reshape(len(ids), labels)
    most = votes.argmax(axis=1) if len(ids) else np.zeros(0, dtype=np.int64)
    return Objects(ids, size[ids], most, np.zeros(len(ids), dtype=bool)), at


def _found_counts(true: Objects, found: Objects, pairs: NDArray, rules: ScoringRules) -> NDArray:
    """Bool [found]: large enough, and not mostly on true instances of its class too small to be asked for."""
    small = (true.cells < rules.min_true_cells)[pairs[:, 0]]
    small &= true.label[pairs[:, 0]] == found.label[pairs[:, 1]]
    on_small = np.bincount(pairs[small, 1], weights=pairs[small, 2], minlength=len(found.ids))
    return (found.cells >= rules.min_found_cells) & (on_small <= 0.5 * found.cells)


@dataclass(frozen=True)
class Score:
    """How well the instances of one class, or of all, were found. None where there is nothing to judge."""

    true: int
    """True instances asked for."""
    found: int
    """Found instances that count."""
    matched: int
    """Pairs of one class with IoU above 0.5."""
    iou_sum: float
    """Over the matched pairs."""
    ap50: float | None
    """Average precision at IoU 0.5: found instances ranked by their score; the area under precision over recall,
    precision at a recall being the best at that recall or beyond. Over all classes: the mean of theirs."""
    over: int
    """True instances split: two or more found ones of their class each hold a notable share of their cells."""
    under: int
    """Found instances merged: they hold a notable share of the cells of two or more true ones of their class."""
    right_cells: int
    """Cells on which truth and map name the same thing class."""
    either_cells: int
    """Cells on which truth or map name a thing class."""

    @property
    def pq(self) -> float | None:
        """Panoptic quality: sum of IoU / (matched + half of the unmatched true and found)."""
        total = (self.true + self.found) / 2.0
        return self.iou_sum / total if total else None

    @property
    def sq(self) -> float | None:
        """Segmentation quality: mean IoU of the matched."""
        return self.iou_sum / self.matched if self.matched else None

    @property
    def rq(self) -> float | None:
        """Recognition quality: matched / (matched + half of the unmatched true and found)."""
        total = (self.true + self.found) / 2.0
        return self.matched / total if total else None

    @property
    def label_accuracy(self) -> float | None:
        """Share of the cells that truth or map give to a thing on which both name the same class."""
        return self.right_cells / self.either_cells if self.either_cells else None

    def to_json(self) -> dict[str, Any]:
        """Return numbers by name; null where there is nothing to judge."""
        kept = asdict(self)
        del kept["iou_sum"]
        return {"pq": self.pq, "sq": self.sq, "rq": self.rq, **kept, "label_accuracy": self.label_accuracy}


@dataclass(frozen=True, eq=False)
class Scores:
    """All scores of one map."""

    overall: Score
    """Over all instances of the judged classes together, not the mean of the classes (but for AP50)."""
    by_class: dict[str, Score]
    """The judged classes: those with at least one true instance large enough, by name."""
    invented: dict[str, int]
    """{class: found instances} of classes the truth has no instance of that is large enough; not in ``overall``."""
    overlaps: Overlaps

    def to_json(self) -> dict[str, Any]:
        """Return numbers by name."""
        classes = {name: score.to_json() for name, score in self.by_class.items()}
        return {"overall": self.overall.to_json(), "by_class": classes, "invented": dict(self.invented)}


def score(simap: SIMap, truth: Truth, *, min_true_cells: int = 20, min_found_cells: int = 8) -> Scores:
    """Score a map.

    A true and a found instance match if they have the same class (of most of their cells) and IoU above 0.5
    (Kirillov et al., Panoptic Segmentation, 2019); a match is then unique. Found instances that lie mostly on true
    ones too small to be asked for are ignored, as are classes without a true instance (see ``Scores.invented``).

    Raises:
        InputError: map and truth do not lie on one grid.
    """
    return scores_of(find_overlaps(simap, truth, ScoringRules(min_true_cells, min_found_cells)), simap)


def scores_of(overlaps: Overlaps, simap: SIMap) -> Scores:
    """Sum up overlaps; the map is asked for the scores of its instances."""
    true, found = overlaps.true, overlaps.found
    judged = np.unique(true.label[true.counts])
    score_of = {instance.id: instance.score for instance in simap.instances}
    confidence = np.array([score_of.get(i, 0.0) for i in found.ids.tolist()], dtype=np.float64)
    by_class = {overlaps.labels[i]: _class_score(overlaps, i, confidence) for i in judged.tolist()}
    others, counts = np.unique(found.label[found.counts & ~np.isin(found.label, judged)], return_counts=True)
    invented = {overlaps.labels[i]: n for i, n in zip(others.tolist(), counts.tolist(), strict=True)}
    by_name = dict(sorted(by_class.items()))
    return Scores(_overall(overlaps, by_name), by_name, dict(sorted(invented.items())), overlaps)


def average_precision(hit: NDArray, true: int) -> float:
    """Return the area under precision over recall, precision made non-increasing from the right.

    Args:
        hit: bool [found], ranked best first: this one matches a true instance.
        true: number of true instances, at least 1.
    """
    if not hit.any():
        return 0.0
    precision = np.cumsum(hit) / np.arange(1, len(hit) + 1)
    best_from_here = np.maximum.accumulate(precision[::-1])[::-1]
    return float(best_from_here[hit].sum() / true)


def _class_score(overlaps: Overlaps, label: int, confidence: NDArray) -> Score:
    true, found, pairs = overlaps.true, overlaps.found, overlaps.pairs
    wanted, have = true.counts & (true.label == label), found.counts & (found.label == label)
    matched = overlaps.matched & (true.label[pairs[:, 0]] == label)
    hit = np.zeros(len(found.ids), dtype=bool)
    hit[pairs[matched, 1]] = True
    # Ties go to the larger one, then to the lower id, so that the order never hangs on the sort.
    ranked = np.lexsort((found.ids, -found.cells, -confidence))
    ranked = ranked[have[ranked]]
    return Score(
        true=int(wanted.sum()),
        found=int(have.sum()),
        matched=int(matched.sum()),
        iou_sum=float(overlaps.iou[matched].sum()),
        ap50=average_precision(hit[ranked], int(wanted.sum())),
        over=int((overlaps.split & wanted).sum()),
        under=int((overlaps.merged & have).sum()),
        right_cells=int(overlaps.right_cells[label]),
        either_cells=int(overlaps.either_cells[label]),
    )


def _overall(overlaps: Overlaps, by_class: dict[str, Score]) -> Score:
    scores = list(by_class.values())
    ap50 = [s.ap50 for s in scores if s.ap50 is not None]
    return Score(
        true=sum(s.true for s in scores),
        found=sum(s.found for s in scores),
        matched=sum(s.matched for s in scores),
        iou_sum=float(sum(s.iou_sum for s in scores)),
        ap50=sum(ap50) / len(ap50) if ap50 else None,
        over=sum(s.over for s in scores),
        under=sum(s.under for s in scores),
        right_cells=int(overlaps.right_cells.sum()),
        either_cells=overlaps.either_thing_cells,
    )


MIN_CELLS = 20
"""Found instances of fewer cells are not counted, unless asked for."""


@dataclass(frozen=True)
class CountScore:
    """One class, counted by a person and on the map."""

    label: str
    """Class of the map, or several that are counted together: "coffee table + dining table"."""
    expected: int
    found: int

    @property
    def difference(self) -> int:
        """Found - expected."""
        return self.found - self.expected

    def to_json(self) -> dict[str, Any]:
        """Return numbers by name."""
        return {**asdict(self), "difference": self.difference}


def parse_counts(text: str) -> dict[str, int]:
    """Read "chair=11,table=2".

    Raises:
        InputError: it reads otherwise, or a name comes twice.
    """
    counts: dict[str, int] = {}
    for part in text.split(","):
        name, _, number = (piece.strip() for piece in part.partition("="))
        if not name or not number.isdecimal():
            raise InputError(f'counts: expected name=number, like "chair=11,table=2", found "{part.strip()}"')
        if name in counts:
            raise InputError(f"counts: expected each name once, found {name} again")
        counts[name] = int(number)
    return counts


def score_counts(simap: SIMap, expected: Mapping[str, int], *, min_cells: int = MIN_CELLS) -> tuple[CountScore, ...]:
    """Compare a person's counts with the map's.

    Args:
        simap: the map.
        expected: {name: number}; a name may be a synonym or plural of one of the map's classes ("tables").
        min_cells: do not count instances of fewer cells.

    Returns:
        One for each name, in the given order.

    Raises:
        InputError: the map has no class of that name (its classes are listed), or two names mean one class.
    """
    sizes = [(instance.label, instance.cells) for instance in simap.instances]
    return tuple(
        CountScore(" + ".join(labels), expected[name], sum(label in labels and n >= min_cells for label, n in sizes))
        for name, labels in resolve_classes(things_of(simap.grid), expected).items()
    )


def resolve_classes(things: Sequence[str], names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return {name: countable classes it means, together}; raises InputError like `score_counts`."""
    vocabulary = Vocabulary(things)
    classes: dict[str, tuple[str, ...]] = {}
    for name in names:
        meaning = vocabulary.resolve(name)
        if meaning is None:
            listed = ", ".join(sorted(things)) or "none"
            raise InputError(f'counts: expected a class of the map ({listed}), found "{name}"')
        other = next((n for n, labels in classes.items() if set(labels) & set(meaning.labels)), None)
        if other is not None:
            raise InputError(f'counts: expected names for different classes, found "{other}" and "{name}" to share one')
        classes[name] = meaning.labels
    return classes


def things_of(source: Grid | FrameSource) -> tuple[str, ...]:
    """Return the countable classes of a map's grid or of a sequence."""
    return tuple(name for name, thing in zip(source.labels, source.is_thing, strict=True) if thing)
