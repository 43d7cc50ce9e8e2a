"""Layout of the texts on the map: each next to the object that it names, and none over another."""

from collections.abc import Sequence
from typing import NamedTuple

from simaps_viz.structures import Instance, SIMap

LINE_PX = 18.0
"""Height of a text's plate."""
LETTER_PX = 5.6
PLATE_PX = 8.0
"""Width of an empty plate."""
GAP_PX = 3.0
"""Between an object and its text."""
NEAR_M = 4.0
MAX_NEAR = 1000
"""Instances that texts avoid at most, so that the layout of a large map is fast."""
_RINGS = 3
"""By how many lines a text may be moved up or down from its object."""

Box = tuple[float, float, float, float]
"""(xmin, ymin, xmax, ymax), map frame, metres."""


class Label(NamedTuple):
    """A text and the position or object that it names. Metres, map frame."""

    text: str
    x: float
    y: float
    reach_x: float = 0.0
    """Half the object's size from west to east; its text is next to it. With 0 here and in ``reach_y`` it is on the
    position."""
    reach_y: float = 0.0
    away_x: float = 0.0
    """The side on which the text should be, if there is room: a direction, of any length; 0, 0 = above."""
    away_y: float = 0.0

    @property
    def box(self) -> Box:
        """Extent of the object."""
        return self.x - self.reach_x, self.y - self.reach_y, self.x + self.reach_x, self.y + self.reach_y


def label_of(text: str, one: Instance) -> Label:
    """Return a label next to an instance."""
    (x0, y0, _), (x1, y1, _) = one.aabb_m
    return Label(text, (x0 + x1) / 2, (y0 + y1) / 2, (x1 - x0) / 2, (y1 - y0) / 2)


def spread(
    labels: Sequence[Label],
    metres_per_px: float,
    blocked: Sequence[Box] = (),
    *,
    within: Box | None = None,
    named: Label | None = None,
) -> list[tuple[float, float] | None]:
    """Choose the positions of texts, seen from above with north up, so that none covers another.

    A text avoids the objects that others name and what is ``blocked``, where there is room.

    Args:
        labels: the most important first.
        metres_per_px: on the floor; texts keep their size on the screen.
        blocked: what should not be covered.
        within: where texts are seen whole.
        named: a text that stands above its object already, and is not covered.

    Returns:
        the middle of each text, map frame; None where there is no room for it. The first always has a position.
    """
    things = [*blocked, *(label.box for label in labels if label.reach_x or label.reach_y)]
    taken = [] if named is None else [_above(named, metres_per_px)]
    middles: list[tuple[float, float] | None] = []
    for label in labels:
        width, height = text_size(label.text, metres_per_px)
        places = _candidates(label, width, height, metres_per_px)
        boxes = [(x - width / 2, y - height / 2, x + width / 2, y + height / 2) for x, y in places]
        alone = [i for i, box in enumerate(boxes) if not any(_cover(box, other) for other in taken)]
        free = [i for i in alone if not any(_cover(boxes[i], thing) for thing in things)]
        whole = [i for i in (*free, *alone) if within is None or _inside(boxes[i], within)]
        chosen = next(iter([*whole, *free, *alone]), None if middles else 0)
        middles.append(None if chosen is None else places[chosen])
        if chosen is not None:
            taken.append(boxes[chosen])
    return middles


def boxes_near(simap: SIMap, labels: Sequence[Label]) -> list[Box]:
    """Return what the instances of a map cover around what is labelled, for `spread` to leave free."""
    if not labels:
        return []
    west, east = min(one.x for one in labels) - NEAR_M, max(one.x for one in labels) + NEAR_M
    south, north = min(one.y for one in labels) - NEAR_M, max(one.y for one in labels) + NEAR_M
    around = (west, south, east, north)
    boxes = [(*one.aabb_m[0][:2], *one.aabb_m[1][:2]) for one in simap.instances]
    return [box for box in boxes if _cover(box, around)][:MAX_NEAR]


def text_size(text: str, metres_per_px: float) -> tuple[float, float]:
    """Return width and height of a text's plate, metres on the floor."""
    return (len(text) * LETTER_PX + PLATE_PX) * metres_per_px, LINE_PX * metres_per_px


def _candidates(label: Label, width: float, height: float, metres_per_px: float) -> list[tuple[float, float]]:
    """Return the positions that a text may have, best first."""
    x, y, line = label.x, label.y, LINE_PX * metres_per_px
    if not (label.reach_x or label.reach_y or label.away_x or label.away_y):
        return [(x, y + k * line) for k in (0, 1, -1, 2, -2, 3, -3)]
    gap = GAP_PX * metres_per_px
    out_x, out_y = label.reach_x + gap + width / 2, label.reach_y + gap + height / 2
    sides, corners = ((0, 1), (1, 0), (-1, 0), (0, -1)), ((1, 1), (-1, 1), (1, -1), (-1, -1))

    def ranked(sides: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
        return sorted(sides, key=lambda side: -(side[0] * label.away_x + side[1] * label.away_y))

    directions = (*ranked(sides), *ranked(corners))
    return [
        (x + dx * out_x, y + dy * (out_y + ring * line))
        for ring in range(_RINGS)
        for dx, dy in directions
        if dy or not ring
    ]


def _above(label: Label, metres_per_px: float) -> Box:
    """Return the plate of a text above its object, a line high and two letters wider on either side."""
    width, height = text_size(f"{label.text}    ", metres_per_px)
    low = label.y + label.reach_y
    return label.x - width / 2, low, label.x + width / 2, low + 2 * height


def _inside(a: Box, b: Box) -> bool:
    return b[0] <= a[0] and b[1] <= a[1] and a[2] <= b[2] and a[3] <= b[3]


def _cover(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
