"""From the queries of a mask-classification network (a class and a mask each) to one segment for each pixel.

Two rules are in use, and both are here:

``transformers``: each mask's probability is weighted by its query's confidence, every pixel goes to the query with the
highest product, and a query keeps all of its pixels when they are more than 80 % of those where its *weighted* mask
reaches 0.5. So every pixel of the picture that any kept query wins is given away, however improbable.

``original``: the pixel is given away only where the winning mask's own probability reaches 0.5, and the share is taken
of the unweighted mask: ``(argmax == k) & (p >= 0.5)``. So the published code of MaskFormer, Mask2Former and EoMT does.

transformers numbers segments so that a thing found after a second piece of stuff can get the number of an earlier
thing; here every thing has its own number.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError

Rule = Literal["transformers", "original"]


@dataclass(frozen=True)
class PanopticSettings:
    """How queries become segments."""

    rule: Rule = "transformers"
    """See the module."""
    score: float = 0.5
    """A query counts when its class is more confident than this; the original code has 0.8."""
    mask: float = 0.5
    """Least probability of a pixel of a mask."""
    overlap: float = 0.8
    """A query counts when it keeps more than this share of its mask."""

    def __post_init__(self) -> None:
        for name, value in (("score", self.score), ("mask", self.mask), ("overlap", self.overlap)):
            if not 0.0 <= value <= 1.0:
                raise InputError(f"{name} threshold: expected 0 to 1, found {value:g}")


@dataclass(frozen=True, eq=False)
class Queries:
    """The queries that found something."""

    classes: NDArray
    """int64 [n]."""
    scores: NDArray
    """float32 [n], probability of the class."""
    kept: NDArray
    """int64 [n], their places in the network's output."""


@dataclass(frozen=True)
class PanopticSegment:
    """One segment of a panoptic map."""

    id: int
    class_index: int
    score: float


def confident_queries(class_logits: NDArray, score: float) -> Queries:
    """Take the queries whose best class is not "no object" (the last) and is confident enough.

    Args:
        class_logits: float32 [queries, classes + 1].
        score: they have to exceed it.
    """
    shifted = np.exp(class_logits - class_logits.max(axis=1, keepdims=True))
    probability = shifted / shifted.sum(axis=1, keepdims=True)
    best = probability.argmax(axis=1)
    confidence = probability.max(axis=1).astype(np.float32)
    kept = np.flatnonzero((best != class_logits.shape[1] - 1) & (confidence > score))
    return Queries(best[kept], confidence[kept], kept)


def panoptic_map(
    probability: NDArray, queries: Queries, fused: Collection[int], settings: PanopticSettings
) -> tuple[NDArray, tuple[PanopticSegment, ...]]:
    """Return every pixel to one query or to none, and join the stuff of a class.

    Args:
        probability: float32 [n, H, W], each query's mask.
        queries: their classes and scores.
        fused: the classes that are stuff: all of one is one segment, with the score of its first query.
        settings: which rule, and its thresholds.

    Returns:
        int32 [H, W], 0 = nothing, and the segments, numbered from 1.
    """
    ids = np.zeros(probability.shape[1:], dtype=np.int32)
    if not len(probability):
        return ids, ()
    weighted = probability * queries.scores[:, None, None]
    winner = weighted.argmax(axis=0)
    measured = weighted if settings.rule == "transformers" else probability
    inside = measured >= settings.mask
    won = np.bincount(winner.reshape(-1), minlength=len(probability))
    areas = inside.reshape(len(inside), -1).sum(axis=1)
    segments: list[PanopticSegment] = []
    number_of: dict[int, int] = {}
    for k in range(len(probability)):
        # In single precision as in transformers, where 4/5 is more than 0.8: the original code keeps it as well.
        if not won[k] or not areas[k] or float(np.float32(won[k]) / np.float32(areas[k])) <= settings.overlap:
            continue
        pixels = winner == k
        if settings.rule == "original":
            pixels &= inside[k]
            if not pixels.any():
                continue
        label = int(queries.classes[k])
        number = number_of.get(label, 0)
        if not number:
            number = len(segments) + 1
            segments.append(PanopticSegment(number, label, float(queries.scores[k])))
            if label in fused:
                number_of[label] = number
        ids[pixels] = number
    return ids, tuple(segments)
