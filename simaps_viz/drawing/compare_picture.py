"""Two maps in one picture: swiped with a line between them, or side by side; differences outlined on both."""

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import plural
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.sheet import INK, fitting, write
from simaps_viz.drawing.texture import MapPicture
from simaps_viz.drawing.theme import LIGHT, Theme, short
from simaps_viz.geometry import shared_cells
from simaps_viz.mapping.method import percent_text
from simaps_viz.structures import GridSpec

if TYPE_CHECKING:
    from simaps_viz.evaluation.two_maps import Item, MapSide, TwoMaps

Mode = Literal["swipe", "side by side", "stacked", "errors"]
"""One map up to a line and the other beyond it; the right one to the east of the left one; to the south of it; one
picture of how little of each object agrees."""

KINDS: Mapping[str, tuple[Color, str]] = {
    "merged": ((196, 0, 40), "several objects are one"),
    "split": ((0, 60, 215), "one object is several"),
    "missed": ((20, 20, 24), "the object is not there"),
    "extra": ((235, 125, 0), "lies on no object of its class"),
    "label": ((175, 60, 200), "the same object, another class"),
    "outline": ((105, 112, 124), "there, but less than half agrees"),
    "edge": ((0, 135, 75), "the same object, its outline is not quite the same"),
    "small": ((90, 15, 105), "too small to be compared, and on no object of its class"),
}
"""Colour and meaning of every kind of difference; distinguishable with any kind of colour vision (see the tests)."""
MAX_NAMED = 5
"""Objects of a difference that are named; the rest is counted."""
LIGHT_MISSED: Color = (238, 240, 244)
"""Colour of missed objects on a dark page."""
HEAT = np.array([(255, 244, 190), (238, 112, 22), (96, 0, 24)], np.float64)
"""Colours of an error of 0, 0.5 and 1, ever darker."""
RIM = 0.55
MAX_PIXELS = 1100
MAX_PIXELS_PER_CELL = 6
GAP = 0.04
"""Between two maps side by side, as a share of a map's width."""
HEAD = 0.055
"""Height of the strip with the titles, as a share of the map's longer side."""


def mark_color(kind: str, theme: Theme = LIGHT) -> Color:
    """Return the colour in which a kind of difference is marked."""
    return LIGHT_MISSED if theme.dark and kind == "missed" else KINDS[kind][0]


def difference_text(kind: str, here: Sequence[str], there: Sequence[str], label: str, iou: float) -> str:
    """Describe a difference: "merged · chairs 4 + 5 → 1", "missed · chair 2", "label · chair 1 → couch 2 · 90% alike".

    Args:
        kind: one of `KINDS`.
        here: names of the objects that take part.
        there: their names on the other map.
        label: class of the first object.
        iou: the largest intersection over union of two of them.
    """
    both = f"{kind} · {together(here or there)}" + (f" → {together(there, known=label)}" if here and there else "")
    return f"{both} · {percent_text(iou)} alike" if kind in ("label", "outline", "edge") else both


def together(names: Sequence[str], *, known: str = "") -> str:
    """Name several objects: "chairs 4 + 5"; only the numbers if their class is ``known``."""
    parts = [name.rpartition(" ") for name in names]
    labels = {label for label, _, _ in parts}
    more = f" + {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    if len(labels) > 1:
        return " + ".join(short(name) for name in names[:MAX_NAMED]) + more
    numbers = " + ".join(number for _, _, number in parts[:MAX_NAMED]) + more
    (label,) = labels or {""}
    if label == known:
        return numbers
    return f"{short(label if len(names) == 1 else plural(2, label).removeprefix('2 '))} {numbers}"


def errors_of(maps: "TwoMaps") -> NDArray:
    """Return how little of the object of each cell agrees with the other map.

    Returns:
        float [rows, cols]: 1 - the intersection over union with the object of the other map that shares most with it;
        1 where that has another class; of the objects of both maps, the larger error; NaN on no object of either.
    """
    left, right = maps.left.instance, maps.right.instance
    areas = [np.bincount(ids.reshape(-1)) for ids in (left, right)]
    *pairs, shared = shared_cells(left, right)
    iou = shared / (areas[0][pairs[0]] + areas[1][pairs[1]] - shared)
    worst = np.full(left.shape, np.nan)
    for side, ids in enumerate((left, right)):
        best = np.zeros(len(areas[side]))
        np.maximum.at(best, pairs[side], iou)
        best[[one for item in maps.items if item.kind == "label" for one in (item.left, item.right)[side]]] = 0.0
        worst = np.fmax(worst, np.where(ids > 0, 1.0 - best[ids], np.nan))
    return worst


class TwoPictures:
    """Both textures, made once; putting them together takes a few milliseconds."""

    def __init__(self, maps: "TwoMaps", theme: Theme = LIGHT) -> None:
        """Paint both maps for a light page or a dark one."""
        self._maps, spec = maps, maps.spec
        self._theme, self._ink = theme, theme.ink if theme.dark else INK
        longest = max(spec.shape)
        self._every = max(1, -(-longest // MAX_PIXELS))  # very large maps are compared more coarsely
        self._scale = 1 if self._every > 1 else int(np.clip(MAX_PIXELS // longest, 1, MAX_PIXELS_PER_CELL))
        self._rows, self._cols = (n // self._every for n in spec.shape)
        self._cell_m = spec.cell_size_m * self._every
        self._head = max(4, round(HEAD * max(self._rows, self._cols)))
        self._gap = max(2, round(GAP * self._cols))
        self._ids = (self._coarse(maps.left.instance), self._coarse(maps.right.instance))
        self._plain = tuple(self._painted(side) for side in (maps.left, maps.right))
        self._halves = self._mark((), None)
        self._errors, self._chosen = self._heated(), None

    def shift_m(self, mode: Mode) -> tuple[float, float]:
        """How far east and north of the left map the right one lies, metres."""
        if mode == "side by side":
            return (self._cols + self._gap) * self._cell_m, 0.0
        return 0.0, -(self._rows + self._head + self._gap) * self._cell_m if mode == "stacked" else 0.0

    def extent_m(self, mode: Mode) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the picture, titles included."""
        return self._spec(mode).extent_m

    def mark(self, items: "Sequence[Item]", chosen: "Item | None") -> None:
        """Outline differences on both maps, and one of them boldly."""
        self._halves, self._chosen = self._mark(items, chosen), chosen

    def picture(self, mode: Mode, share: float = 0.5) -> MapPicture:
        """Put the two together.

        Args:
            mode: how.
            share: swipe: how much of the map, from the west, shows the left one.
        """
        left, right = self._halves
        if mode == "stacked":
            gap = np.full((self._gap * self._scale, left.shape[1], 3), self._theme.unseen, np.uint8)
            heads = [self._titles(mode, left.shape[1], side) for side in (self._maps.left, self._maps.right)]
            parts = [heads[0], left, gap, heads[1], right]
        elif mode == "side by side":
            gap = np.full((left.shape[0], self._gap * self._scale, 3), self._theme.unseen, np.uint8)
            body = np.concatenate([left, gap, right], axis=1)
            parts = [self._titles(mode, body.shape[1]), body]
        elif mode == "errors":
            body, chosen = self._errors.copy(), self._chosen
            for at, ids in enumerate((chosen.left, chosen.right) if chosen is not None else ()):
                self._outline(body, at, ids, mark_color("label"), max(1, self._scale // 2), halo=True)
            parts = [self._titles(mode, body.shape[1]), body]
        else:
            colors = (self._ink, self._theme.page)
            parts = [self._titles(mode, left.shape[1]), _swiped(left, right, share, self._scale, colors)]
        return MapPicture(self._spec(mode), np.ascontiguousarray(np.concatenate(parts)[::-1]))

    def _spec(self, mode: Mode) -> GridSpec:
        spec, cols = self._maps.spec, self._cols
        wide = 2 * cols + self._gap if mode == "side by side" else cols
        below = self._rows + self._head + self._gap if mode == "stacked" else 0
        high = self._rows + self._head + below
        return GridSpec(high, wide, self._cell_m, spec.x0_m, spec.y0_m - below * self._cell_m)

    def _coarse(self, cells: NDArray) -> NDArray:
        n = self._every
        return np.ascontiguousarray(cells[: self._rows * n : n, : self._cols * n : n][::-1])

    def _heated(self) -> NDArray:
        errors, ground = self._coarse(errors_of(self._maps)), self._coarse(self._maps.left.ground)
        heat = np.stack([np.interp(errors, (0.0, 0.5, 1.0), channel) for channel in HEAT.T], axis=2)
        cells = np.where(np.isnan(errors)[..., None], np.array(self._theme.grounds)[ground], heat).astype(np.uint8)
        return cells.repeat(self._scale, axis=0).repeat(self._scale, axis=1)

    def _painted(self, side: "MapSide") -> NDArray:
        n = self._scale
        theme, ids = self._theme, self._coarse(side.instance)
        grounds = np.array(theme.grounds, np.uint8)
        cells = np.where(ids[..., None] > 0, self._coarse(side.colors), grounds[self._coarse(side.ground)])
        image = cells.repeat(n, axis=0).repeat(n, axis=1)
        if n >= 3:
            large = ids.repeat(n, axis=0).repeat(n, axis=1)
            rim = rims_of(large, max(1, n // 4))
            image[rim] = (image[rim] * RIM).astype(np.uint8)
        return image

    def _mark(self, items: "Sequence[Item]", chosen: "Item | None") -> tuple[NDArray, NDArray]:
        thin, bold = max(1, self._scale // 2), max(2, round(0.7 * self._scale))
        result = []
        for at, plain in enumerate(self._plain):
            image = plain.copy()
            for kind in KINDS:
                color = mark_color(kind, self._theme)
                ids = [i for item in items if item.kind == kind for i in (item.right if at else item.left)]
                self._outline(image, at, ids, color, thin)
            if chosen is not None:
                ids = chosen.right if at else chosen.left
                # Thinly how the other map has it, boldly how this one has it.
                self._outline(image, 1 - at, chosen.left if at else chosen.right, self._ink, thin)
                # Where one of the two has nothing, the other's outline shows where it would be.
                on, wanted = (at, ids) if len(ids) else (1 - at, chosen.left if at else chosen.right)
                self._outline(image, on, wanted, mark_color(chosen.kind, self._theme), bold, halo=True)
            result.append(image)
        return result[0], result[1]

    def _outline(
        self, image: NDArray, on: int, ids: Collection[int], color: Color, thick: int, *, halo: bool = False
    ) -> None:
        if not len(ids):
            return
        mask = np.isin(self._ids[on], list(ids)).astype(np.uint8)
        contours, _ = cv2.findContours(
            mask.repeat(self._scale, axis=0).repeat(self._scale, axis=1), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE
        )
        paper = self._theme.page if color == LIGHT_MISSED else (255, 255, 255)
        cv2.drawContours(image, contours, -1, paper, thick + (4 if halo else 2))
        cv2.drawContours(image, contours, -1, color, thick)

    def _titles(self, mode: Mode, width: int, only: "MapSide | None" = None) -> NDArray:
        """Draw a strip with both titles, or with that of ``only`` one map."""
        n = self._scale
        head = np.full((self._head * n, width, 3), self._theme.unseen, np.uint8)
        size = round(0.5 * head.shape[0])
        y, pad = head.shape[0] / 2.0, size // 2
        if only is not None:
            write(head, fitting(only.title, size, width - size, bold=True), (pad, y), size, self._ink, bold=True)
            return head
        room = (width - 4 * pad) // 2
        titles = [self._maps.left.title, self._maps.right.title]
        if mode == "errors":
            titles = [" / ".join(titles), "pale: alike, dark: nothing agrees"]
        left, right = (fitting(title, size, room, bold=True) for title in titles)
        write(head, left, (pad, y), size, self._ink, bold=True)
        if mode == "side by side":
            write(head, right, ((self._cols + self._gap) * n + pad, y), size, self._ink, bold=True)
        else:
            write(head, right, (width - pad, y), size, self._ink, bold=True, anchor="right")
        return head


def _swiped(left: NDArray, right: NDArray, share: float, scale: int, colors: tuple[Color, Color]) -> NDArray:
    cols = left.shape[1]
    at = round(float(np.clip(share, 0.0, 1.0)) * cols)
    body = np.concatenate([left[:, :at], right[:, at:]], axis=1)
    half = max(1, scale // 3)
    body[:, max(0, at - 2 * half) : at + 2 * half] = colors[1]
    body[:, max(0, at - half) : at + half] = colors[0]
    return body


def rims_of(ids: NDArray, thick: int = 1) -> NDArray:
    """Bool: pixels of an instance from which another, or none, is ``thick`` pixels away along its row or column."""
    padded = np.pad(ids, thick)
    high, wide = ids.shape
    inner = padded[thick : thick + high, thick : thick + wide]
    shifts = ((0, thick), (2 * thick, thick), (thick, 0), (thick, 2 * thick))
    return (inner > 0) & np.logical_or.reduce([inner != padded[r : r + high, c : c + wide] for r, c in shifts])
