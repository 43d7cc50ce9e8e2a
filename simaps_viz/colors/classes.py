"""Categories and their colours. Colours depend on the name or id alone, so they stay when anything else changes."""

import zlib

from simaps_viz.colors.palette import PALETTE, Color, color_of_number

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

COMMON = (
    "chair", "dining table", "tv", "couch", "potted plant", "bed", "laptop", "refrigerator", "bench", "sink", "toilet",
    "book",
)  # fmt: skip
"""Classes of rooms, each with a colour of its own: the one at its place in the palette."""


def is_thing(label: str) -> bool:
    """Return whether a class is countable, by its name alone."""
    return label not in STUFF


def class_color(label: str) -> Color:
    """Return a class its RGB colour (0-255), from its name; stuff is grey.

    Classes that are often together have different ones; ``map_colors.class_colors`` sees to it that all classes of a
    map do.
    """
    if label in ("none", ""):
        return (0, 0, 0)
    if label in COMMON:
        return PALETTE[COMMON.index(label)]
    code = zlib.crc32(label.encode())
    if not is_thing(label):
        grey = 120 + code % 90
        return (grey, grey, grey)
    return PALETTE[code % len(PALETTE)]


def instance_color(instance_id: int) -> Color:
    """Return an instance its RGB colour (0-255), from its id alone: the palette, over and over.

    ``map_colors.instance_colors`` gives another one to an instance whose neighbour has the same.
    """
    return (0, 0, 0) if instance_id <= 0 else color_of_number(instance_id)


def plural(count: int, noun: str) -> str:
    """Describe how many, in English: "1 chair", "4 benches"."""
    if count == 1:
        return f"1 {noun}"
    if noun.endswith("person"):
        return f"{count} {noun[:-6]}people"
    if noun.endswith("knife"):
        return f"{count} {noun[:-2]}ves"
    if noun.endswith("shelf"):
        return f"{count} {noun[:-1]}ves"
    if noun.endswith(("scissors", "skis")):
        return f"{count} {noun}"
    ending = "es" if noun.endswith(("s", "x", "ch", "sh")) else "s"
    return f"{count} {noun}{ending}"
