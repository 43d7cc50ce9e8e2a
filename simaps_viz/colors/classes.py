"""Names of classes, their colours, which depend on the name alone, and which of them are ground below objects."""

import json
import re
import zlib
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.array_cache import ArrayCache
from simaps_viz.colors.palette import PALETTE, Color, color_of_number
from simaps_viz.geometry import STANDS_FROM_M
from simaps_viz.structures import Grid

_NAMES: dict[str, list[str]] = json.loads(
    resources.files("simaps_viz.colors").joinpath("class_names.json").read_text(encoding="utf-8")
)
COCO_THINGS = tuple(_NAMES["coco_things"])
"""The 80 countable classes of COCO, in their usual order."""
STUFF = frozenset(_NAMES["stuff"])
"""Uncountable classes by name: plain words and those of COCO panoptic; used when a sequence does not say itself."""
ADE20K_STUFF = frozenset(_NAMES["ade20k_stuff"])
"""Uncountable classes of ADE20K, by the first of the names that it has for a class ("floor" of "floor, flooring")."""
COMMON = tuple(_NAMES["indoor"])
"""Classes that are common indoors; each has a colour of its own, the one at its place in the palette."""

STRUCTURE = ("wall", "column", "door", "window")
"""Classes that belong to the building."""
UNSEEN, FLOOR, CLUTTER, WALL = range(4)
"""Kinds of ground; clutter is something that stands there without a name."""

_ground_kinds = ArrayCache()


def is_thing(label: str) -> bool:
    """Whether a class is countable, judged by its name alone."""
    return label not in STUFF


def class_color(label: str) -> Color:
    """Return the colour of a class from its name; stuff is grey.

    Common classes have different colours. ``instances.class_colors`` makes sure that all classes of one map have.
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
    """Return the colour of an instance from its id alone: the palette, over and over.

    ``instances.instance_colors`` chooses another one where a neighbour has the same.
    """
    return (0, 0, 0) if instance_id <= 0 else color_of_number(instance_id)


_PLURALS = {
    "person": "people", "knife": "knives", "shelf": "shelves", "mouse": "mice", "scissors": "scissors", "skis": "skis",
}  # fmt: skip


def plain(label: str) -> str:
    """Return a class name as a person says it: "tv_monitor" -> "tv monitor", "table-merged" -> "table"."""
    words = re.split(r"[\s_\-/]+", label.strip().lower())
    return " ".join(w for w in words if w not in ("merged", "other", "stuff")) or label.strip().lower()


def plural(count: int, noun: str) -> str:
    """Return a number with its noun in English: "1 chair", "4 benches", "2 mice"."""
    if count == 1:
        return f"1 {noun}"
    for one, several in _PLURALS.items():
        if noun.endswith(one):
            return f"{count} {noun.removesuffix(one)}{several}"
    ending = "es" if noun.endswith(("s", "x", "ch", "sh")) else "s"
    return f"{count} {noun}{ending}"


def cells_of_classes(grid: Grid, *names: str) -> NDArray:
    """Return bool [rows, cols]: cells whose class is one of the names, or one of their kinds ("wall-brick")."""
    return np.isin(grid.label, [i for i, label in enumerate(grid.labels) if label.split("-")[0] in names])


def ground_kinds(grid: Grid) -> NDArray:
    """Return what every cell is below the objects: uint8 [rows, cols], UNSEEN, FLOOR, CLUTTER or WALL.

    The result is kept for the next who asks: nobody may write into it.
    """

    def compute() -> NDArray:
        kinds = np.where(np.isnan(grid.height_m), UNSEEN, FLOOR).astype(np.uint8)
        kinds[(grid.height_m >= STANDS_FROM_M) & ~cells_of_classes(grid, "floor")] = CLUTTER
        kinds[cells_of_classes(grid, *STRUCTURE)] = WALL
        return kinds

    return _ground_kinds.get((grid.height_m, grid.label), grid.labels, compute)
