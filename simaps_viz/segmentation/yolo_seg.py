"""YOLO-seg exports (Ultralytics YOLOv8, 11 and later): boxes, class scores, and masks as sums of prototypes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.segmentation.class_names import ClassNames
from simaps_viz.segmentation.protocol import Threshold
from simaps_viz.segmentation.session import Placement, Session, channels_first, lay, letterbox
from simaps_viz.structures import Segment, Segmentation

GREY = 114
"""What Ultralytics fills the rest of the input with."""
_MAX_CANDIDATES = 3000
"""Boxes that enter the suppression, best first."""


@dataclass(frozen=True)
class YoloSettings:
    """Which detections count."""

    score: float = 0.25
    """Least confidence."""
    iou: float = 0.5
    """Overlap above which the less confident of two boxes of a class is dropped."""
    mask: float = 0.5
    """Least probability of a pixel of a mask."""
    min_area_px: int = 30
    """Smaller masks are dropped, picture pixels."""


@dataclass(frozen=True)
class YoloPorts:
    """What the network's inputs and outputs are called and how they are laid out."""

    image: str
    boxes: str
    prototypes: str
    classes: int | None
    """None where the file does not tell: exports that end in a suppression of their own."""
    size: tuple[int, int]
    """Height and width of the input."""
    dtype: type = np.float32
    suppressed: bool = False
    """Rows are (xmin, ymin, xmax, ymax, score, class, coefficients): already suppressed."""


@dataclass(frozen=True, eq=False)
class Detections:
    """Boxes with their masks' coefficients."""

    boxes: NDArray
    """float32 [n, 4], xmin, ymin, xmax, ymax, pixels of the input."""
    scores: NDArray
    """float32 [n]."""
    classes: NDArray
    """int64 [n]."""
    coefficients: NDArray
    """float32 [n, prototypes]."""

    def of(self, index: NDArray) -> "Detections":
        """Return some of them."""
        return Detections(self.boxes[index], self.scores[index], self.classes[index], self.coefficients[index])


class YoloSeg:
    """A YOLO-seg network: knows things only."""

    def __init__(self, session: Session, ports: YoloPorts, names: ClassNames, settings: YoloSettings) -> None:
        self._session, self._ports, self._names, self._settings = session, ports, names, settings
        self.labels, self.is_thing = names.labels, names.is_thing
        self.name = session.path.name
        self.key = f"yolo-seg {session.digest} {names.labels} {settings}"

    @property
    def thresholds(self) -> tuple[Threshold, ...]:
        """What decides which detections count."""
        boxes = Threshold("iou", "Box overlap", self._settings.iou, "Of two boxes of a class that overlap more than "
                          "this (IoU), the less confident one goes.")  # fmt: skip
        return (
            Threshold("score", "Score", self._settings.score, "Least confidence of a detection."),
            Threshold("mask", "Mask", self._settings.mask, "Least probability of a pixel of a mask."),
            *(() if self._ports.suppressed else (boxes,)),
        )

    def adjusted(self, thresholds: Mapping[str, float]) -> "YoloSeg":
        """Return the same network with other thresholds."""
        return YoloSeg(self._session, self._ports, self._names, replace(self._settings, **thresholds))

    def prepare(self, color: NDArray) -> NDArray:
        """Letterbox an image, uint8 [H, W, 3], RGB, and give [1, 3, h, w] in 0 .. 1."""
        size = self._ports.size
        canvas = lay(color, letterbox(*color.shape[:2], into=size), into=size, fill=GREY)
        return channels_first(canvas, scale=(1.0 / 255.0,) * 3).astype(self._ports.dtype, copy=False)

    def infer(self, prepared: NDArray) -> list[NDArray]:
        """Run the network."""
        return self._session.run({self._ports.image: prepared}, [self._ports.boxes, self._ports.prototypes])

    def decode(self, outputs: list[NDArray], height: int, width: int) -> Segmentation:
        """Make masks of the boxes that count; smaller ones lie on top, of equally large ones the surer."""
        rows, prototypes = (np.asarray(value[0], dtype=np.float32) for value in outputs)
        found = self._detections(rows)
        place = letterbox(height, width, into=self._ports.size)
        masks = detection_masks(found, prototypes, place, self._ports.size, (height, width), self._settings.mask)
        return self._paint(found, masks, height, width)

    def _detections(self, rows: NDArray) -> Detections:
        if self._ports.suppressed:
            kept = rows[rows[:, 4] >= self._settings.score]
            last = int(kept[:, 5].max(initial=0))
            if last >= len(self.labels):
                raise InputError(
                    f"{self._names.source}: expected a class name for each class that {self.name} finds, "
                    f"{last + 1} or more, found {len(self.labels)}"
                )
            return Detections(kept[:, :4], kept[:, 4], kept[:, 5].astype(np.int64), kept[:, 6:])
        found = raw_detections(rows, len(self.labels), self._settings.score)
        return found.of(suppress(found, self._settings.iou))

    def _paint(self, found: Detections, masks: list[tuple[int, int, NDArray]], height: int, width: int) -> Segmentation:
        areas = np.array([int(np.count_nonzero(mask)) for _, _, mask in masks], dtype=np.int64)
        order = [i for i in np.argsort(-areas, kind="stable") if areas[i] >= self._settings.min_area_px]
        ids = np.zeros((height, width), dtype=np.int32)
        for number, i in sorted(enumerate(order, start=1), key=lambda one: (-areas[one[1]], found.scores[one[1]])):
            top, left, mask = masks[i]
            ids[top : top + mask.shape[0], left : left + mask.shape[1]][mask] = number
        left_over = np.bincount(ids.reshape(-1), minlength=len(order) + 1)
        segments = tuple(
            Segment(
                number,
                self.labels[c := int(found.classes[i])],
                round(min(1.0, float(found.scores[i])), 4),
                self.is_thing[c],
            )
            for number, i in enumerate(order, start=1)
            if left_over[number]
        )
        return Segmentation(ids, segments)


def raw_detections(rows: NDArray, classes: int, score: float) -> Detections:
    """Take the boxes whose best class is confident enough.

    Args:
        rows: float32 [4 + classes + prototypes, anchors]: centre x, centre y, width, height in pixels of the input,
            class scores 0 .. 1, coefficients.
        classes: how many there are.
        score: least confidence.
    """
    best = rows[4 : 4 + classes].max(axis=0)
    kept = np.flatnonzero(best >= score)
    if len(kept) > _MAX_CANDIDATES:
        kept = kept[np.argsort(-best[kept], kind="stable")[:_MAX_CANDIDATES]]
    found = rows[:, kept].T
    middle, half = found[:, :2], found[:, 2:4] / 2
    boxes = np.concatenate([middle - half, middle + half], axis=1)
    return Detections(boxes, best[kept], found[:, 4 : 4 + classes].argmax(axis=1), found[:, 4 + classes :])


def suppress(found: Detections, iou: float) -> NDArray:
    """Drop boxes that overlap a more confident one of their class; give the indices of the rest, best first."""
    order = np.argsort(-found.scores, kind="stable")
    boxes, classes = found.boxes[order], found.classes[order]
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    alive, kept = np.ones(len(order), dtype=np.bool_), []
    for i in range(len(order)):
        if not alive[i]:
            continue
        kept.append(i)
        sides = np.minimum(boxes[i, 2:], boxes[i:, 2:]) - np.maximum(boxes[i, :2], boxes[i:, :2])
        shared = np.prod(np.clip(sides, 0.0, None), axis=1)
        alive[i:] &= ~((shared > iou * (areas[i] + areas[i:] - shared)) & (classes[i:] == classes[i]))
    return order[np.array(kept, dtype=np.int64)]


def detection_masks(
    found: Detections, prototypes: NDArray, place: Placement, size: tuple[int, int], shape: tuple[int, int], mask: float
) -> list[tuple[int, int, NDArray]]:
    """Return each detection's mask inside its box: (top, left, bool [h, w]) in the picture.

    A pixel belongs to the mask where sigmoid(coefficients . prototypes), read bilinearly, exceeds ``mask``; logits are
    compared instead, which is the same.

    Args:
        found: the detections.
        prototypes: float32 [n, h, w].
        place: where the picture lies in the input.
        size: height and width of the input.
        shape: height and width of the picture.
        mask: a probability.
    """
    rows, cols = prototypes.shape[1:]
    threshold = math.log(mask / (1.0 - mask))
    boxes = place.to_picture(found.boxes)
    low = np.clip(np.floor(boxes[:, :2] + 0.5), 0, [shape[1], shape[0]]).astype(int)
    high = np.clip(np.floor(boxes[:, 2:] + 0.5), 0, [shape[1], shape[0]]).astype(int)
    shrink_x, shrink_y = cols / size[1], rows / size[0]
    step_x, step_y = place.scale_x * shrink_x, place.scale_y * shrink_y
    masks = []
    for row, (left, top), (right, bottom) in zip(found.coefficients, low, high, strict=True):
        if right <= left or bottom <= top:
            masks.append((0, 0, np.zeros((0, 0), dtype=np.bool_)))
            continue
        # Pixel centres lie at whole numbers here, hence the halves.
        first_x = ((left + 0.5) * place.scale_x + place.left) * shrink_x - 0.5
        first_y = ((top + 0.5) * place.scale_y + place.top) * shrink_y - 0.5
        x0, x1 = _reach(first_x, step_x * (right - left), cols)
        y0, y1 = _reach(first_y, step_y * (bottom - top), rows)
        # Not @: with so little to multiply, BLAS spends a hundred times longer waking its threads on a busy machine.
        logit = np.einsum("p,pyx->yx", row, prototypes[:, y0:y1, x0:x1])
        to_prototype = np.array([[step_x, 0.0, first_x - x0], [0.0, step_y, first_y - y0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        read = cv2.warpAffine(
            logit, to_prototype, (int(right - left), int(bottom - top)), flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        masks.append((int(top), int(left), read > threshold))
    return masks


def _reach(first: float, length: float, size: int) -> tuple[int, int]:
    """Return the first and the last + 1 prototype pixel of a row or column that bilinear reading needs."""
    low = min(max(math.floor(first) - 1, 0), size - 1)
    return low, max(min(math.ceil(first + length) + 2, size), low + 1)
