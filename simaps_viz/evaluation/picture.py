"""A comparison as one PNG: panels side by side, what is wrong marked, legend and scale bar."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.drawing.sheet import INK, PALE_INK, WORDS, Sheet, save_png, width_of
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.evaluation.coloring import NO_PARTNER, PALETTE
from simaps_viz.evaluation.compare import Comparison, Panel, Verdict

WRONG_RED = (206, 17, 38)
RIM = 0.5
"""Factor that darkens the rim of an instance."""
MAX_WIDTH, MAX_PANEL_WIDTH = 3200, 1000
"""Pixels; panels get as many pixels a cell as fit."""
MAX_ACROSS = 4
ROW_TITLE, SWATCH = 18, 20
BAR_WIDTH = 240
"""Room for the scale bar, left of the legend, pixels."""
_DARK = 330
"""Sum of red, green and blue below which marks are white."""
_ORDER = list(Verdict)


def save_picture(comparison: Comparison, path: Path) -> None:
    """Write the comparison as PNG, replacing an earlier file only once the new one is complete.

    Raises:
        InputError: the file cannot be written, or is not called .png.
    """
    save_png(render(comparison), path)


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
    """Lay out the complete picture: the reference, the rows of panels, the legend. uint8 [H, W, 3], RGB."""
    rows, cols = comparison.spec.shape
    across, lines = _layout(comparison)

    # A large picture is shown small: words and distances grow with it.
    scale = int(np.clip(min(MAX_PANEL_WIDTH // cols, MAX_WIDTH // (across * cols)), 2, 8))
    growth = float(np.clip(across * cols * scale / 1700, 1.0, 1.8))
    sheet = Sheet(0, 0, growth)
    gap = sheet.px(24)
    row_title, head = sheet.px(ROW_TITLE + 12), sheet.panel_head(subtitle=True)
    wide = max(cols * scale, *(width_of(panel.subtitle, sheet.px(WORDS)) for panel in comparison.panels))
    heights = [(row_title if title else 0) + head + rows * scale + gap for title, _ in lines]
    width = (across + 1) * gap + across * wide
    legend = _legend_places(comparison.has_truth, sheet, width)
    sheet.begin(width, 2 * gap + sum(heights) + sheet.px(28) + max(y for _, y in legend))

    y = gap
    for (title, panels), height in zip(lines, heights, strict=True):
        sheet.text(title, (gap, y + sheet.px(ROW_TITLE / 2)), ROW_TITLE, PALE_INK)
        top = y + (row_title if title else 0)
        for at, panel in enumerate(panels):
            if panel is not None:
                place = (gap + at * (wide + gap), top)
                sheet.panel(panel_image(panel, scale), place, panel.title, panel.subtitle)
        y += height
    y += sheet.px(12)
    sheet.scale_bar((gap, y), scale / comparison.spec.cell_size_m)
    for (sample, words), (x, down) in zip(_legend_entries(comparison.has_truth), legend, strict=True):
        sheet.swatch(panel_image(sample, 2), words, (x, y + down), SWATCH)
    return sheet.pixels


def _layout(comparison: Comparison) -> tuple[int, list[tuple[str, list[Panel | None]]]]:
    """Return panels across, and lines of (title, panels); the reference starts every row."""
    rows = comparison.rows or (("", ()),)
    longest = 1 + max(len(panels) for _, panels in rows)
    across = longest if longest <= MAX_ACROSS else -(-longest // -(-longest // MAX_ACROSS))
    lines: list[tuple[str, list[Panel | None]]] = []
    for title, panels in rows:
        shown: list[Panel | None] = [comparison.reference, *panels]
        shown += [None] * (-len(shown) % across)
        for start in range(0, len(shown), across):
            lines.append((title if start == 0 else "", shown[start : start + across]))
    return across, lines


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


def _legend_places(has_truth: bool, sheet: Sheet, width: int) -> list[tuple[int, int]]:
    """Return where the legend's entries are, pixels from the left and down from the first line, wrapped at a width."""
    left = sheet.px(BAR_WIDTH)
    places, x, down = [], left, 0
    for _, words in _legend_entries(has_truth):
        length = sheet.px(SWATCH + 34) + width_of(words, sheet.px(WORDS))
        if x > left and x + length > width - sheet.px(24):
            x, down = left, down + sheet.px(32)
        places.append((x, down))
        x += length
    return places


def _legend_entries(has_truth: bool) -> list[tuple[Panel, str]]:
    plain, other = PALETTE[1], NO_PARTNER
    if not has_truth:
        return [
            (_sample(plain), "same colour: same object, by overlap with the first map"),
            (_sample(other), "nothing there on the first map"),
        ]
    return [
        (_sample(plain), "colour of the true object it overlaps most"),
        (_sample(plain, Verdict.MERGED), "merges several true objects"),
        (_sample(plain, Verdict.PIECE), "only a piece of one"),
        (_sample(plain, Verdict.WRONG), "matches none"),
        (_sample(other, Verdict.WRONG), "lies on none"),
        (_sample(LIGHT.floor, missed=True), "true object missed"),
    ]


def _sample(color: Color, verdict: Verdict = Verdict.UNJUDGED, *, missed: bool = False) -> Panel:
    """Make a panel of one instance that fills it."""
    cells = np.full((11, 11), 0 if missed else 1, np.int32)
    colors = np.full((*cells.shape, 3), color, np.uint8)
    return Panel("", "", colors, cells, {1: verdict}, {}, np.full(cells.shape, missed))
