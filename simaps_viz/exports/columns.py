"""The map as solid columns: every cell stands from the floor to its height; one mesh for each object or class."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.exports.records import color_of, label_colors, node_name
from simaps_viz.structures import GridSpec, SIMap

UNLABELLED: Final = "unlabelled"
UNLABELLED_COLOR: Final = (110, 110, 116)
_SIDES: Final = {  # towards a neighbour (row, col): lower edge from, to, seen from outside left to right, as (x, y)
    (-1, 0): ((0, 0), (1, 0)),
    (0, 1): ((1, 0), (1, 1)),
    (1, 0): ((1, 1), (0, 1)),
    (0, -1): ((0, 1), (0, 0)),
}


@dataclass(frozen=True, eq=False)
class Part:
    """One named mesh."""

    name: str
    label: str
    instance: int
    """0 for a class without instances."""
    color: Color
    vertices: NDArray
    """float64 [n, 3], map frame, metres."""
    faces: NDArray
    """int64 [m, 3], counter-clockwise from outside."""


def parts(simap: SIMap) -> Iterator[Part]:
    """Return a closed mesh for each instance, then one for what is left of each class; cells never seen have none.

    A column reaches from the floor (or from the part's lowest cell, should it lie below) to the height of its cell, so
    an instance's volume is the sum of its cells' areas times their heights. What hangs below a table top is not known.
    Meshes of classes have no underside, which nobody sees.
    """
    for one in simap.instances:
        vertices, faces = _columns(simap, simap.instance == one.id, closed=True)
        yield Part(node_name(one), one.label, one.id, color_of(simap, one), vertices, faces)
    colors = label_colors(simap)
    rest = (simap.instance == 0) & ~np.isnan(simap.grid.height_m)
    for index in np.unique(simap.grid.label[rest]).tolist():
        label = simap.grid.labels[index] if index else UNLABELLED
        name = f"{label}-unassigned" if index and simap.grid.is_thing[index] else label
        color = colors[index] if index else UNLABELLED_COLOR
        yield Part(name, label, 0, color, *_columns(simap, rest & (simap.grid.label == index), closed=False))


def _columns(simap: SIMap, mask: NDArray, *, closed: bool) -> tuple[NDArray, NDArray]:
    """Return vertices and faces of the columns over the cells of a mask; no faces between two columns that touch."""
    row, col = np.nonzero(mask)
    top = simap.grid.height_m[row, col].astype(np.float64)
    base = min(0.0, float(top.min()))
    heights = np.full((simap.spec.rows + 2, simap.spec.cols + 2), base)
    heights[row + 1, col + 1] = top
    lid = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    quads = [_quads(row, col, lid, top)]
    if closed:
        quads.append(_quads(row, col, lid[::-1], np.full(len(top), base)))
    for (d_row, d_col), (left, right) in _SIDES.items():
        foot = heights[row + 1 + d_row, col + 1 + d_col]
        bare = foot < top
        around = np.array([left, right, right, left])
        side = _quads(row[bare], col[bare], around, foot[bare])
        side[:, 2:, 2] = top[bare][:, None]
        quads.append(side)
    corners = np.concatenate(quads).reshape(-1, 3)
    first = np.arange(len(corners) // 4)[:, None] * 4
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    unique, inverse = np.unique(corners, axis=0, return_inverse=True)
    return _in_metres(simap.spec, unique), inverse.reshape(-1)[faces]


def _quads(row: NDArray, col: NDArray, around: NDArray, height: NDArray) -> NDArray:
    """Corners [n, 4, 3]: x and y in cells, z in metres."""
    quads = np.zeros((len(row), 4, 3))
    quads[..., 0] = col[:, None] + around[:, 0]
    quads[..., 1] = row[:, None] + around[:, 1]
    quads[..., 2] = height[:, None]
    return quads


def _in_metres(spec: GridSpec, corners: NDArray) -> NDArray:
    scale = (spec.cell_size_m, spec.cell_size_m, 1.0)
    return corners * scale + (spec.x0_m, spec.y0_m, 0.0)
