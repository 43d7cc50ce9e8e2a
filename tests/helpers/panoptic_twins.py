"""Plain twins of the panoptic rules, pixel by pixel, and the logits they are compared on."""

import importlib
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

CLASSES = 6
STUFF = {4, 5}
SHAPE = (24, 32)
"""Height and width of the pictures, pixels."""


def drawn_logits(seed: int) -> tuple[NDArray, NDArray]:
    """Return class logits [14, 7] and mask logits [14, 16, 20]: blobs that overlap, some sure and some not."""
    rng = np.random.default_rng(seed)
    queries, h, w = 14, 16, 20
    classes = rng.normal(0.0, 1.0, (queries, CLASSES + 1)).astype(np.float32)
    classes[np.arange(queries), rng.integers(0, CLASSES + 1, queries)] += rng.uniform(0.5, 6.0, queries)
    v, u = np.mgrid[:h, :w]
    masks = np.zeros((queries, h, w), np.float32)
    for q in range(queries):
        y, x, r = rng.uniform(0, h), rng.uniform(0, w), rng.uniform(2.0, 7.0)
        masks[q] = (r - np.hypot(v - y, u - x)) * rng.uniform(0.5, 2.0) + rng.normal(0.0, 0.3, (h, w))
    return classes, masks


def bilinear(image: NDArray, height: int, width: int) -> NDArray:
    """Resize one mask: pixel areas cover each other, borders are repeated."""
    rows, cols = image.shape
    out = np.zeros((height, width))
    for i in range(height):
        y = min(max((i + 0.5) * rows / height - 0.5, 0.0), rows - 1.0)
        y0, y1 = int(y), min(int(y) + 1, rows - 1)
        for j in range(width):
            x = min(max((j + 0.5) * cols / width - 0.5, 0.0), cols - 1.0)
            x0, x1 = int(x), min(int(x) + 1, cols - 1)
            top = image[y0, x0] * (1 - (x - x0)) + image[y0, x1] * (x - x0)
            low = image[y1, x0] * (1 - (x - x0)) + image[y1, x1] * (x - x0)
            out[i, j] = top * (1 - (y - y0)) + low * (y - y0)
    return out


def plain_panoptic(
    class_logits: NDArray, probability: NDArray, *, rule: str, score: float, mask: float, overlap: float
) -> tuple[NDArray, list[tuple[int, int]]]:
    """Assign every pixel to a query, then to a segment; return ids and (id, class) of each segment.

    ``probability`` [queries, H, W] is of all queries, those that do not count included.
    """
    alive: list[tuple[int, int, float]] = []
    for q, row in enumerate(class_logits):
        shares = [math.exp(v - max(row)) for v in row]
        best = max(range(len(row)), key=lambda c: row[c])
        confidence = shares[best] / sum(shares)
        if best != len(row) - 1 and confidence > score:
            alive.append((q, best, confidence))
    height, width = probability.shape[1:]
    ids = np.zeros((height, width), np.int32)
    winner = {}
    for i in range(height):
        for j in range(width):
            if alive:
                winner[i, j] = max(range(len(alive)), key=lambda k: alive[k][2] * probability[alive[k][0], i, j])
    segments: list[tuple[int, int]] = []
    fused: dict[int, int] = {}
    for k, (q, label, confidence) in enumerate(alive):
        weight = confidence if rule == "transformers" else 1.0
        inside = {p for p in winner if weight * probability[q][p] >= mask}
        mine = {p for p in winner if winner[p] == k}
        if not mine or not inside or not float(np.float32(len(mine) / len(inside))) > overlap:
            continue
        given = mine if rule == "transformers" else mine & inside
        if not given:
            continue
        if label in fused:
            number = fused[label]
        else:
            number = len(segments) + 1
            segments.append((number, label))
            if label in STUFF:
                fused[label] = number
        for p in given:
            ids[p] = number
    return ids, segments


def by_transformers(family: str, class_logits: NDArray, mask_logits: NDArray, **thresholds: Any) -> Any:
    """Let transformers itself make the map; returns its ids [H, W] and its list of segments."""
    torch, transformers = (importlib.import_module(name) for name in ("torch", "transformers"))
    transformers.logging.set_verbosity_error()
    module = importlib.import_module("transformers.models.mask2former.modeling_mask2former")
    classes, masks = torch.from_numpy(class_logits)[None], torch.from_numpy(mask_logits)[None]
    outputs = module.Mask2FormerForUniversalSegmentationOutput(class_queries_logits=classes, masks_queries_logits=masks)
    sizes: Any = [SHAPE]
    if family == "eomt":
        processor = transformers.EomtImageProcessorPil(size={"shortest_edge": 32, "longest_edge": 32})
        found = processor.post_process_panoptic_segmentation(
            outputs, target_sizes=sizes, stuff_classes=sorted(STUFF), **thresholds
        )[0]
        return found["segmentation"].numpy() + 1, found["segments_info"]
    names = {"mask2former": "Mask2Former", "maskformer": "MaskFormer", "oneformer": "OneFormer"}
    if family == "oneformer":
        _lend_torchvision(torch)
    found = getattr(transformers, f"{names[family]}ImageProcessorPil")().post_process_panoptic_segmentation(
        outputs, target_sizes=sizes, label_ids_to_fuse=STUFF, **thresholds
    )[0]
    return np.maximum(found["segmentation"].numpy(), 0), found["segments_info"]


def _lend_torchvision(torch: Any) -> None:
    """Return transformers' OneFormer the two names of torchvision that it uses without importing them (5.23)."""
    module: Any = importlib.import_module("transformers.models.oneformer.image_processing_pil_oneformer")
    if not hasattr(module, "tvF"):

        def resize(masks: Any, size: tuple[int, int], interpolation: str) -> Any:
            return torch.nn.functional.interpolate(masks, size=size, mode=interpolation, antialias=True)

        module.tvF = SimpleNamespace(resize=resize, InterpolationMode=SimpleNamespace(BILINEAR="bilinear"))
