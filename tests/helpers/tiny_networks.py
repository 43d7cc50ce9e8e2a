"""Small networks of both kinds, as ONNX files with constant answers, whose masks can be told beforehand."""

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sequences import HEIGHT, WIDTH
from tiny_onnx import write_onnx

from simaps_viz.segmentation.protocol import Network
from simaps_viz.structures import Segment, Segmentation

NAMES = ("chair", "dining table", "tv")
PROTOTYPES = 2
Box = tuple[float, float, float, float, int, float]
"""xmin, ymin, xmax, ymax in pixels of the 32 x 32 input, class, score."""


def yolo_rows(boxes: Sequence[Box], *, anchors: int = 24, classes: int = len(NAMES)) -> NDArray:
    """Return float32 [1, 4 + classes + 2, anchors]: the boxes, and anchors that found nothing."""
    rows = np.zeros((1, 4 + classes + PROTOTYPES, anchors), np.float32)
    for i, (x0, y0, x1, y1, label, score) in enumerate(boxes):
        rows[0, :4, i] = (x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0
        rows[0, 4 + label, i] = score
        rows[0, 4 + classes, i] = 1.0
    return rows


def write_yolo(path: Path, boxes: Sequence[Box], *, metadata: dict[str, str] | None = None, **options: Any) -> Path:
    """Write a YOLO-seg network whose masks fill their boxes."""
    prototypes = np.zeros((1, PROTOTYPES, 8, 8), np.float32)
    prototypes[0, 0] = 4.0
    names = {"names": repr(dict(enumerate(NAMES)))} if metadata is None else metadata
    outputs = {"output0": yolo_rows(boxes), "output1": prototypes}
    return write_onnx(path, outputs, metadata=names, **options)


def write_classifier(path: Path, *, family: str = "maskformer", labels: Sequence[str] = ("chair", "floor")) -> Path:
    """Write a mask classifier that finds a chair in the left half and floor in the right."""
    classes = np.full((1, 3, len(labels) + 1), -6.0, np.float32)
    classes[0, 0, 0] = classes[0, 1, 1] = classes[0, 2, -1] = 6.0
    masks = np.full((1, 3, 8, 8), -6.0, np.float32)
    masks[0, 0, :, :4] = masks[0, 1, :, 4:] = 6.0
    names = "{" + ", ".join(f'"{i}": "{label}"' for i, label in enumerate(labels)) + "}"
    metadata = {"simaps.family": family, "id2label": names, "simaps.picture": '{"size": {"height": 32, "width": 32}}'}
    return write_onnx(path, {"class_queries_logits": classes, "masks_queries_logits": masks}, metadata=metadata)


def segment_image(network: Network, color: NDArray) -> Segmentation:
    """Segment one image, uint8 [H, W, 3], RGB: the three steps one after another."""
    return network.decode(network.infer(network.prepare(color)), color.shape[0], color.shape[1])


CHAIR = np.zeros((HEIGHT, WIDTH), bool)
CHAIR[2:14, 2:12] = True


class OwnNetwork:
    """A network of one's own: a chair always in the same place. Counts how often it ran."""

    name, labels, is_thing = "own", ("chair", "lamp"), (True, True)

    def __init__(self, key: str = "1", stop_after: int = 1000) -> None:
        self.key, self.runs, self.stop_after = key, 0, stop_after
        self.threads: dict[str, set[int]] = {"prepare": set(), "infer": set(), "decode": set()}

    def prepare(self, color):
        self.threads["prepare"].add(threading.get_ident())
        return color.shape

    def infer(self, prepared):
        self.threads["infer"].add(threading.get_ident())
        if self.runs >= self.stop_after:
            raise KeyboardInterrupt
        self.runs += 1
        return prepared

    def decode(self, outputs, height, width):
        self.threads["decode"].add(threading.get_ident())
        assert outputs == (height, width, 3) == (HEIGHT, WIDTH, 3)
        return Segmentation(CHAIR.astype(np.int32), (Segment(1, "chair", 0.75),))


class TopNetwork(OwnNetwork):
    """Calls the upper third of a picture a lamp."""

    def decode(self, outputs, height, width):
        assert outputs == (height, width, 3)
        ids = np.zeros((height, width), np.int32)
        ids[: height // 3] = 1
        return Segmentation(ids, (Segment(1, "lamp"),))
