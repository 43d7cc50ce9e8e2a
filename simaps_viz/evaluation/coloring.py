"""Colour many objects with few colours, so that near ones differ as far as the palette permits."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors import palette
from simaps_viz.colors.classes import ground_kinds
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.structures import Grid

NO_PARTNER: Color = (150, 153, 158)
"""An instance that overlaps no true one."""
PALETTE: tuple[Color, ...] = tuple(c for c in palette.PALETTE if c[0] <= 1.5 * max(c[1:]))
"""The page's colours without the reds, which are left to what marks an error (`picture.WRONG_RED`)."""


def distinct_colors(instance: NDArray) -> dict[int, Color]:
    """Choose a colour for every instance, the largest first: the one whose nearest user is farthest away.

    Args:
        instance: int [rows, cols], 0 = none.
    """
    flat = instance.reshape(-1)
    where = np.flatnonzero(flat)
    size = np.bincount(flat[where])
    ids = np.flatnonzero(size)
    row, col = np.divmod(where, instance.shape[1])
    middle = np.stack([np.bincount(flat[where], weights=axis)[ids] / size[ids] for axis in (row, col)], axis=1)
    order = np.lexsort((ids, -size[ids]))
    nearest = np.full((len(ids), len(PALETTE)), np.inf)
    chosen: dict[int, Color] = {}
    for at in order.tolist():
        # An unused colour is infinitely far; among those the first, so that the choice is always the same.
        color = int(np.argmax(nearest[at]))
        chosen[int(ids[at])] = PALETTE[color]
        apart = np.hypot(*(middle - middle[at]).T)
        nearest[:, color] = np.minimum(nearest[:, color], apart)
    return chosen


def partners(cells: NDArray, reference: NDArray) -> dict[int, int]:
    """Return {id: the id of the reference with which it shares most cells}, the lower of equals; none without any.

    Args:
        cells: int [rows, cols], 0 = none.
        reference: the same window.
    """
    both = (cells > 0) & (reference > 0)
    pairs, shared = np.unique(np.stack([cells[both], reference[both]], axis=1), axis=0, return_counts=True)
    best: dict[int, int] = {}
    for at in np.argsort(-shared, kind="stable").tolist():
        best.setdefault(int(pairs[at, 0]), int(pairs[at, 1]))
    return best


def paint(grid: Grid, instance: NDArray, colors: Mapping[int, Color]) -> NDArray:
    """Colour every cell: instances in their colours (or grey), the ground below them pale.

    Returns:
        uint8 [rows, cols, 3], RGB, row 0 at the south.
    """
    picture = np.array(LIGHT.grounds, np.uint8)[ground_kinds(grid)]
    palette = np.full((int(instance.max(initial=0)) + 1, 3), NO_PARTNER, np.uint8)
    for number, color in colors.items():
        if number < len(palette):
            palette[number] = color
    picture[instance > 0] = palette[instance[instance > 0]]
    return picture
