"""Scores of a map against the truth: panoptic quality, average precision, splits and mergers, right classes."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.evaluation.overlaps import Overlaps, ScoringRules, find_overlaps
from simaps_viz.evaluation.truth import Truth
from simaps_viz.structures import SIMap


@dataclass(frozen=True)
class Score:
    """How well the instances of one class, or of all, were found. None stands where there is nothing to judge."""

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
    confidence = _confidence(simap, found.ids)
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


def _confidence(simap: SIMap, ids: NDArray) -> NDArray:
    score_of = {instance.id: instance.score for instance in simap.instances}
    return np.array([score_of.get(i, 0.0) for i in ids.tolist()], dtype=np.float64)


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
