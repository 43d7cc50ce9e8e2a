"""Universal segmentation networks exported from transformers: MaskFormer, Mask2Former, OneFormer, EoMT.

All give a class and a mask for each of some hundred queries. How a picture has to be brought into the network's input,
and how the queries become segments, is in the file's metadata when `simaps export-network` wrote it; of other exports
it is looked for in ``preprocessor_config.json`` beside the file.

Two rules turn queries into one segment for each pixel, and both are here:

``transformers``: each mask's probability is weighted by its query's confidence, every pixel goes to the query with the
highest product, and a query keeps all of its pixels when they are more than 80 % of those where its *weighted* mask
reaches 0.5. So every pixel of the picture that any kept query wins is given away, however improbable.

``original``: the pixel is given away only where the winning mask's own probability reaches 0.5, and the share is taken
of the unweighted mask: ``(argmax == k) & (p >= 0.5)``. So the published code of MaskFormer, Mask2Former and EoMT does.

transformers numbers segments so that a thing found after a second piece of stuff can get the number of an earlier
thing; here every thing has its own number.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.manifest import read_json, shown
from simaps_viz.errors import InputError
from simaps_viz.segmentation.class_names import ClassNames
from simaps_viz.segmentation.protocol import Threshold
from simaps_viz.segmentation.session import Placement, Session, channels_first, lay, resize_masks, stretch, top_left
from simaps_viz.structures import Segment, Segmentation

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


IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
MASK2FORMER_GRID = (384, 384)
"""transformers resizes Mask2Former's mask logits to this before all else."""


@dataclass(frozen=True)
class Picture:
    """How a picture is brought into the network's input."""

    fit: Literal["stretch", "pad"] = "stretch"
    """stretch: over the whole input. pad: keep its shape, upper left, zeros (after normalising) around it."""
    mean: tuple[float, ...] = IMAGENET_MEAN
    """Mean of the three channels, in 0 .. 1."""
    std: tuple[float, ...] = IMAGENET_STD
    rescale: float = 1.0 / 255.0


@dataclass(frozen=True)
class MaskPorts:
    """What the network's inputs and outputs are called."""

    image: str
    classes: str
    masks: str
    class_count: int
    """Without "no object"."""
    size: tuple[int, int]
    """Height and width of the input."""
    dtype: type = np.float32
    grid: tuple[int, int] | None = None
    """Resize the mask logits to this first; None = not."""


class MaskClassifier:
    """A mask-classification network: knows things and stuff."""

    def __init__(
        self, session: Session, ports: MaskPorts, names: ClassNames, picture: Picture, settings: PanopticSettings
    ) -> None:
        self._session, self._ports, self._picture, self._settings = session, ports, picture, settings
        self._names = names
        self.labels, self.is_thing = names.labels, names.is_thing
        self._stuff = frozenset(i for i, thing in enumerate(names.is_thing) if not thing)
        self.name = session.path.name
        self.key = f"mask-classification {session.digest} {names.labels} {names.is_thing} {ports} {picture} {settings}"

    @property
    def thresholds(self) -> tuple[Threshold, ...]:
        """What decides which queries count."""
        return (
            Threshold("score", "Score", self._settings.score, "Least confidence of a segment's class."),
            Threshold("mask", "Mask", self._settings.mask, "Least probability of a pixel of a mask."),
            Threshold("overlap", "Overlap", self._settings.overlap, "Drop what others cover so much that less than "
                      "this share of its mask is left."),
        )  # fmt: skip

    def adjusted(self, thresholds: Mapping[str, float]) -> "MaskClassifier":
        """Return the same network with other thresholds."""
        settings = replace(self._settings, **thresholds)
        return MaskClassifier(self._session, self._ports, self._names, self._picture, settings)

    def prepare(self, color: NDArray) -> NDArray:
        """Resize and normalise an image, uint8 [H, W, 3], RGB; gives [1, 3, h, w]."""
        size, place = self._ports.size, self._place(*color.shape[:2])
        canvas = lay(color, place, into=size, fill=0, smooth=True)
        picture = self._picture
        tensor = channels_first(
            canvas,
            scale=tuple(picture.rescale / std for std in picture.std),
            offset=tuple(-mean / std for mean, std in zip(picture.mean, picture.std, strict=True)),
        )
        tensor[:, :, place.height :], tensor[:, :, :, place.width :] = 0.0, 0.0
        return tensor.astype(self._ports.dtype, copy=False)

    def infer(self, prepared: NDArray) -> list[NDArray]:
        """Run the network."""
        return self._session.run({self._ports.image: prepared}, [self._ports.classes, self._ports.masks])

    def decode(self, outputs: list[NDArray], height: int, width: int) -> Segmentation:
        """Make segments of the queries."""
        class_logits, mask_logits = (np.asarray(value[0], dtype=np.float32) for value in outputs)
        queries = confident_queries(class_logits, self._settings.score)
        probability = self._probability(mask_logits[queries.kept], height, width)
        ids, found = panoptic_map(probability, queries, self._stuff, self._settings)
        segments = tuple(
            Segment(s.id, self.labels[s.class_index], round(s.score, 4), self.is_thing[s.class_index]) for s in found
        )
        return Segmentation(ids, segments)

    def _place(self, height: int, width: int) -> Placement:
        fit = stretch if self._picture.fit == "stretch" else top_left
        return fit(height, width, into=self._ports.size)

    def _probability(self, logits: NDArray, height: int, width: int) -> NDArray:
        """Return each query's mask in the picture, float32 [n, height, width].

        With the rule of transformers probabilities are resized, else logits: each as their code does it.
        """
        if not len(logits):
            return np.zeros((0, height, width), dtype=np.float32)
        if self._picture.fit == "pad":
            place = self._place(height, width)
            logits = resize_masks(logits, *self._ports.size)[:, : place.height, : place.width]
        elif self._ports.grid:
            logits = resize_masks(logits, *self._ports.grid)
        if self._settings.rule == "transformers":
            return resize_masks(sigmoid(logits), height, width)
        return sigmoid(resize_masks(logits, height, width))


def sigmoid(logits: NDArray) -> NDArray:
    """Return 1 / (1 + exp(-x)), float32, without overflow."""
    return (0.5 * (1.0 + np.tanh(0.5 * logits))).astype(np.float32)


def picture_beside(network: Path) -> Picture:
    """Read ``preprocessor_config.json`` beside a network, as transformers writes it; ImageNet's numbers without one.

    Raises:
        InputError: it is damaged.
    """
    path = network.with_name("preprocessor_config.json")
    return picture_in(str(path), read_json(path)) if path.is_file() else Picture()


def picture_in(source: str, config: Any) -> Picture:
    """Take what is needed from the settings of an image processor of transformers.

    Raises:
        InputError: the numbers are not there or make no sense.
    """
    if not isinstance(config, dict):
        raise InputError(f"{source}: expected an image processor's settings, found {shown(config)}")
    size = config.get("size")
    fixed = isinstance(size, dict) and "height" in size
    normalized = config.get("do_normalize", True)
    mean = config.get("image_mean", IMAGENET_MEAN) if normalized else (0.0,) * 3
    std = config.get("image_std", IMAGENET_STD) if normalized else (1.0,) * 3
    rescale = config.get("rescale_factor", 1.0 / 255.0) if config.get("do_rescale", True) else 1.0
    try:
        means, stds, factor = tuple(map(float, mean)), tuple(map(float, std)), float(rescale)
    except (TypeError, ValueError, OverflowError):
        means, stds, factor = (), (), 0.0
    finite = bool(np.isfinite([*means, *stds, factor]).all())
    if len(means) != 3 or len(stds) != 3 or not all(s > 0 for s in stds) or not finite:
        raise InputError(f"{source}: expected image_mean and image_std of three numbers, found {shown([mean, std])}")
    return Picture("stretch" if fixed else "pad", means, stds, factor)
