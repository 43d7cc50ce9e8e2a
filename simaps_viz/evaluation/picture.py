"""A comparison as one PNG: panels side by side, what is wrong marked, legend and scale bar."""

import io
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from simaps_viz.colors.palette import Color
from simaps_viz.evaluation.coloring import FLOOR, NO_PARTNER, PALETTE
from simaps_viz.evaluation.compare import Comparison, Panel, Verdict
from simaps_viz.io.files import check_output, write_whole

WRONG_RED = (206, 17, 38)
INK = (33, 37, 44)
PALE_INK = (98, 104, 115)
RIM = 0.5
"""Factor that darkens the rim of an instance."""
WIDEST = 3200
"""Pixels; panels get as many pixels a cell as fit."""
WIDEST_PANEL = 1000
_MOST_ACROSS = 4
_SHORTEST_BAR = 60
_DARK = 330
"""Sum of red, green and blue below which marks are white."""


@dataclass(frozen=True)
class _Style:
    """Sizes in pixels, larger on a larger page, so that the words stay readable when the page is shown small."""

    factor: float

    def px(self, pixels: float) -> int:
        return round(pixels * self.factor)

    def font(self, size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
        return _font(self.px(size))

    def length(self, text: str, size: int) -> int:
        """Width of a line of text."""
        return int(np.ceil(self.font(size).getlength(text)))

    @property
    def margin(self) -> int:
        return self.px(24)

    @property
    def head(self) -> int:
        """Height of a panel's title and subtitle."""
        return self.px(TITLE + SUBTITLE + 16)


TITLE, SUBTITLE, ROW_TITLE, LEGEND = 24, 15, 18, 15
"""Font sizes, before they grow with the page."""


def save_picture(comparison: Comparison, path: Path) -> None:
    """Write the comparison as PNG, replacing an earlier file only once the new one is complete.

    Raises:
        InputError: the file cannot be written, or is not called .png.
    """
    path = Path(path)
    check_output(path, ".png")
    buffer = io.BytesIO()
    Image.fromarray(render(comparison)).save(buffer, format="PNG", optimize=True)
    write_whole(path, buffer.getbuffer(), "the picture")


def panel_image(panel: Panel, scale: int) -> NDArray:
    """Paint a panel with its marks, north up.

    Args:
        panel: what to paint.
        scale: pixels along a cell's edge.

    Returns:
        uint8 [rows * scale, cols * scale, 3], RGB.
    """
    colors, ids, missed = (np.ascontiguousarray(a[::-1]) for a in (panel.colors, panel.instance, panel.missed))
    image, ids, missed = (a.repeat(scale, axis=0).repeat(scale, axis=1) for a in (colors, ids, missed))
    of_id = np.full(int(ids.max(initial=0)) + 1, -1, np.int8)
    for number, verdict in panel.verdicts.items():
        if number < len(of_id):
            of_id[number] = _ORDER.index(verdict)
    verdict = np.where(ids > 0, of_id[ids], -1)
    row, col = np.arange(ids.shape[0])[:, None], np.arange(ids.shape[1])[None]
    dot = max(2, scale // 2)
    marked = (verdict == _ORDER.index(Verdict.MERGED)) & ((row + col) % 10 < 4)
    marked |= (verdict == _ORDER.index(Verdict.PIECE)) & (row % (4 * dot) < dot) & (col % (4 * dot) < dot)
    dark = image[marked].astype(int).sum(axis=-1, keepdims=True) < _DARK
    image[marked] = np.where(dark, 255, INK)
    rim = _rim(ids)
    image[rim] = (image[rim] * RIM).astype(np.uint8)
    wrong = np.isin(verdict, [_ORDER.index(Verdict.MERGED), _ORDER.index(Verdict.WRONG)])
    image[_outline(wrong, scale)] = WRONG_RED
    image[_outline(missed, scale) & ((row + col) % 12 < 7)] = WRONG_RED
    return image


def render(comparison: Comparison) -> NDArray:
    """Lay out the whole picture: the reference, the rows of panels, the legend. uint8 [H, W, 3], RGB."""
    rows, cols = comparison.spec.shape
    across, lines = _layout(comparison)
    scale = int(np.clip(min(WIDEST_PANEL // cols, WIDEST // (across * cols)), 2, 8))
    style = _Style(float(np.clip(across * cols * scale / 1700, 1.0, 1.8)))
    gap, row_head = style.px(24), style.px(ROW_TITLE + 12)
    words = [style.length(panel.subtitle, SUBTITLE) for panel in comparison.panels]
    wide, high = max(cols * scale, *words), rows * scale
    width = 2 * style.margin + across * wide + (across - 1) * gap
    heights = [(row_head if title else 0) + style.head + high + gap for title, _ in lines]
    page = Image.new("RGB", (width, 2 * style.margin + sum(heights) + style.px(60)), (255, 255, 255))
    draw = ImageDraw.Draw(page)
    y = style.margin
    for (title, panels), height in zip(lines, heights, strict=True):
        draw.text((style.margin, y), title, fill=PALE_INK, font=style.font(ROW_TITLE))
        top = y + (row_head if title else 0)
        for at, panel in enumerate(panels):
            if panel is not None:
                _place(page, draw, panel, (style.margin + at * (wide + gap), top), scale, style)
        y += height
    _scale_bar(draw, (style.margin, y + style.px(8)), scale / comparison.spec.cell_size_m, style)
    _legend(page, draw, comparison.has_truth, y, style)
    return np.asarray(page)


_ORDER = list(Verdict)


@cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _layout(comparison: Comparison) -> tuple[int, list[tuple[str, list[Panel | None]]]]:
    """Return panels across, and lines of (title, panels); the reference starts every row."""
    rows = comparison.rows or (("", ()),)
    longest = 1 + max(len(panels) for _, panels in rows)
    across = longest if longest <= _MOST_ACROSS else -(-longest // -(-longest // _MOST_ACROSS))
    lines: list[tuple[str, list[Panel | None]]] = []
    for title, panels in rows:
        shown: list[Panel | None] = [comparison.reference, *panels]
        shown += [None] * (-len(shown) % across)
        for start in range(0, len(shown), across):
            lines.append((title if start == 0 else "", shown[start : start + across]))
    return across, lines


def _place(
    page: Image.Image, draw: ImageDraw.ImageDraw, panel: Panel, at: tuple[int, int], scale: int, style: _Style
) -> None:
    (x, y), top = at, at[1] + style.head
    draw.text((x, y), panel.title, fill=INK, font=style.font(TITLE))
    draw.text((x, y + style.px(TITLE + 7)), panel.subtitle, fill=PALE_INK, font=style.font(SUBTITLE))
    image = Image.fromarray(panel_image(panel, scale))
    page.paste(image, (x, top))
    draw.rectangle((x - 1, top - 1, x + image.width, top + image.height), outline=(214, 218, 226))


def _rim(ids: NDArray) -> NDArray:
    """Bool: pixels of an instance that touch another, or none."""
    padded = np.pad(ids, 1)
    inner = padded[1:-1, 1:-1]
    sides = (padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:])
    return (inner > 0) & np.logical_or.reduce([inner != side for side in sides])


def _outline(mask: NDArray, scale: int) -> NDArray:
    """Bool: a thick line along the inside of a mask's outer borders; holes of a few cells get none."""
    reach = 3 * scale
    pad = 2 * reach + 2  # so that the picture's edge is a border like any other
    padded = np.pad(mask, pad).astype(np.uint8)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    size = 2 * max(2, scale // 2) + 1
    inside = cv2.erode(closed, np.ones((size, size), np.uint8))
    return (closed > inside)[pad:-pad, pad:-pad]


def _scale_bar(draw: ImageDraw.ImageDraw, at: tuple[int, int], pixels_per_m: float, style: _Style) -> None:
    length_m = next((m for m in (1, 2, 5, 10, 20) if m * pixels_per_m >= style.px(_SHORTEST_BAR)), 50)
    (x, y), length = at, round(length_m * pixels_per_m)
    draw.rectangle((x, y, x + length, y + style.px(5)), fill=INK)
    draw.text((x, y + style.px(12)), f"{length_m} m", fill=INK, font=style.font(LEGEND))


def _legend(page: Image.Image, draw: ImageDraw.ImageDraw, has_truth: bool, y: int, style: _Style) -> None:
    """Explain colours and marks, right of the scale bar, wrapping where the page ends."""
    left = style.margin + style.px(190)
    x, size = left, style.px(20)
    for panel, words in _legend_entries(has_truth):
        length = size + style.px(34) + style.length(words, LEGEND)
        if x > left and x + length > page.width - style.margin:
            x, y = left, y + style.px(32)
        swatch = panel_image(panel, 2)
        page.paste(Image.fromarray(swatch).resize((size, size), Image.Resampling.NEAREST), (x, y + style.px(2)))
        draw.text((x + size + style.px(8), y + style.px(3)), words, fill=INK, font=style.font(LEGEND))
        x += length


def _legend_entries(has_truth: bool) -> list[tuple[Panel, str]]:
    plain, other = PALETTE[1], NO_PARTNER
    if not has_truth:
        return [
            (_swatch(plain), "same colour: same object, by overlap with the first map"),
            (_swatch(other), "nothing there on the first map"),
        ]
    return [
        (_swatch(plain), "colour of the true object it overlaps most"),
        (_swatch(plain, Verdict.MERGED), "merges several true objects"),
        (_swatch(plain, Verdict.PIECE), "only a piece of one"),
        (_swatch(plain, Verdict.WRONG), "matches none"),
        (_swatch(other, Verdict.WRONG), "lies on none"),
        (_swatch(FLOOR, missed=True), "true object missed"),
    ]


def _swatch(color: Color, verdict: Verdict = Verdict.UNJUDGED, *, missed: bool = False) -> Panel:
    """Make a panel of one instance that fills it."""
    cells = np.full((11, 11), 0 if missed else 1, np.int32)
    colors = np.full((*cells.shape, 3), color, np.uint8)
    return Panel("", "", colors, cells, {1: verdict}, {}, np.full(cells.shape, missed))
