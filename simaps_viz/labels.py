"""Categories and their colours. Colours depend on the name or id alone, so they stay when anything else changes."""

import colorsys
import zlib

import numpy as np
from numpy.typing import NDArray

COCO_THINGS = tuple(
    [
        "person",
        "bicycle",
        "car",
        "motorcycle",
        "airplane",
        "bus",
        "train",
        "truck",
        "boat",
        "traffic light",
        "fire hydrant",
        "stop sign",
        "parking meter",
        "bench",
        "bird",
        "cat",
        "dog",
        "horse",
        "sheep",
        "cow",
        "elephant",
        "bear",
        "zebra",
        "giraffe",
        "backpack",
        "umbrella",
        "handbag",
        "tie",
        "suitcase",
        "frisbee",
        "skis",
        "snowboard",
        "sports ball",
        "kite",
        "baseball bat",
        "baseball glove",
        "skateboard",
        "surfboard",
        "tennis racket",
        "bottle",
        "wine glass",
        "cup",
        "fork",
        "knife",
        "spoon",
        "bowl",
        "banana",
        "apple",
        "sandwich",
        "orange",
        "broccoli",
        "carrot",
        "hot dog",
        "pizza",
        "donut",
        "cake",
        "chair",
        "couch",
        "potted plant",
        "bed",
        "dining table",
        "toilet",
        "tv",
        "laptop",
        "mouse",
        "remote",
        "keyboard",
        "cell phone",
        "microwave",
        "oven",
        "toaster",
        "sink",
        "refrigerator",
        "book",
        "clock",
        "vase",
        "scissors",
        "teddy bear",
        "hair drier",
        "toothbrush",
    ]
)
"""The 80 countable classes of COCO, in their usual order."""

STUFF = frozenset(
    [
        "wall",
        "floor",
        "ceiling",
        "column",
        "wall-brick",
        "wall-stone",
        "wall-tile",
        "wall-wood",
        "wall-other-merged",
        "floor-wood",
        "floor-other-merged",
        "ceiling-merged",
        "window-other",
        "window-blind",
        "sky-other-merged",
        "pavement-merged",
        "rug-merged",
        "cabinet-merged",
        "table-merged",
        "building-other-merged",
        "door-stuff",
        "grass-merged",
        "dirt-merged",
        "road",
        "tree-merged",
    ]
)
"""Uncountable classes by name: plain words and COCO panoptic's; used when a sequence does not say itself."""


def is_thing(label: str) -> bool:
    """Tell whether a class is countable, by its name alone."""
    return label not in STUFF


def class_color(label: str) -> tuple[int, int, int]:
    """Give a class its RGB colour (0-255), from its name; stuff is grey."""
    if label in ("none", ""):
        return (0, 0, 0)
    code = zlib.crc32(label.encode())
    if not is_thing(label):
        grey = 120 + code % 90
        return (grey, grey, grey)
    return _rgb((code % 1009) / 1009.0, 0.55 + (code >> 10) % 3 * 0.15, 0.65 + (code >> 12) % 3 * 0.12)


def instance_color(instance_id: int) -> tuple[int, int, int]:
    """Give an instance its RGB colour (0-255), from its id: golden-angle hues, so close ids differ most."""
    if instance_id <= 0:
        return (0, 0, 0)
    hue = (instance_id * 0.6180339887498949) % 1.0
    return _rgb(hue, (0.75, 0.55, 0.9)[instance_id % 3], (0.92, 0.72, 0.8)[(instance_id // 3) % 3])


def instance_palette(size: int) -> NDArray:
    """Give uint8 [size, 3]: the RGB colour of ids 0 .. size - 1."""
    return np.array([instance_color(i) for i in range(size)], dtype=np.uint8).reshape(size, 3)


def _rgb(hue: float, saturation: float, value: float) -> tuple[int, int, int]:
    r, g, b = colorsys.hsv_to_rgb(hue, saturation, value)
    return (round(r * 255), round(g * 255), round(b * 255))
