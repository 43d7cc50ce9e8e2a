"""The 3-D view: the blocks of a map of tops, the points of an observed surface, and what a ray meets of either."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.colors.classes import STRUCTURE, cells_of_classes
from simaps_viz.colors.instances import color_of_instance, instance_colors
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.texture import HEIGHT_TOP_M, ColorMode, shown_class_colors
from simaps_viz.drawing.theme import LIGHT, Theme
from simaps_viz.geometry import STANDS_FROM_M
from simaps_viz.mapping.in_space import has_voxels, space_points
from simaps_viz.structures import Instance, Points, SIMap

WALL_CUT_M = 0.6
"""Walls are cut off here, as in a doll's house, or one could not look in."""
COLOR_STEP = 8
"""Colours closer than this share a mesh."""
HEIGHT_STEP_M = 0.05
"""Heights closer than this are one, so that flat tops become few large faces."""
MAX_CELLS = 1_000_000
"""A larger map is shown in coarser blocks."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh of one colour."""

    color: Color
    vertices: NDArray
    """float32 [n, 3], map frame, metres."""
    faces: NDArray
    """uint32 [m, 3], counter-clockwise from outside."""


def block_heights(simap: SIMap) -> NDArray:
    """Return float32 [rows, cols]: how high each cell stands in the 3-D view, metres; 0 = floor or unseen."""
    height = np.nan_to_num(simap.grid.height_m, nan=0.0)
    height = np.where(height >= STANDS_FROM_M, np.rint(height / HEIGHT_STEP_M) * HEIGHT_STEP_M, 0.0)
    walls = cells_of_classes(simap.grid, *STRUCTURE) | (simap.grid.label == 0)
    return np.where(walls, np.minimum(height, WALL_CUT_M), height).astype(np.float32)


def solids(simap: SIMap, colors: NDArray) -> list[Solid]:
    """Return the blocks: only faces that can be seen; equal faces of cells in a row are joined to one.

    Args:
        simap: the map.
        colors: uint8 [rows, cols, 3], from ``cell_colors``.
    """
    # Very large maps get coarser blocks.
    coarse = int(np.ceil(np.sqrt(colors.shape[0] * colors.shape[1] / MAX_CELLS)))
    height, colors = _coarser(block_heights(simap), colors, coarse)
    # The lids, and the sides towards each of the four neighbours.
    padded, key = np.pad(height, 1), np.pad(_keys(colors), 1)
    quads, owners = zip(_tops(padded, key), *(_sides(padded, key, towards) for towards in _CORNERS), strict=True)
    corners, owner = np.concatenate(quads), np.concatenate(owners)
    spec = simap.spec
    size = spec.cell_size_m * coarse
    corners[..., 0] = spec.x0_m + (corners[..., 0] - 1) * size
    corners[..., 1] = spec.y0_m + (corners[..., 1] - 1) * size

    # One mesh for each colour: two triangles a quad.
    order = np.argsort(owner, kind="stable")
    corners, owner = corners[order].astype(np.float32), owner[order]
    if len(owner) == 0:
        return []
    values, shown = np.unique(key[1:-1, 1:-1], return_index=True)
    bounds = np.flatnonzero(np.diff(owner)) + 1
    found = []
    for mine, one in zip(np.split(corners, bounds), owner[np.r_[0, bounds]], strict=True):
        first = np.arange(len(mine), dtype=np.uint32)[:, None] * 4
        faces = np.concatenate([first + np.array(corner) for corner in ((0, 1, 2), (0, 2, 3))]).astype(np.uint32)
        r, g, b = colors.reshape(-1, 3)[shown[np.searchsorted(values, one)]].tolist()
        found.append(Solid((r, g, b), mine.reshape(-1, 3), faces))
    return found


def _keys(colors: NDArray) -> NDArray:
    rounded = (colors // COLOR_STEP).astype(np.int32)
    return rounded[..., 0] << 16 | rounded[..., 1] << 8 | rounded[..., 2]


def _coarser(height: NDArray, colors: NDArray, factor: int) -> tuple[NDArray, NDArray]:
    """Make one block of ``factor`` x ``factor`` cells: as high as its highest, in that one's colour."""
    if factor <= 1:
        return height, colors
    rows, cols = (-(-n // factor) for n in height.shape)
    room = ((0, rows * factor - height.shape[0]), (0, cols * factor - height.shape[1]))
    tiles = np.pad(height, room).reshape(rows, factor, cols, factor).swapaxes(1, 2).reshape(rows, cols, -1)
    best = tiles.argmax(axis=2)
    row = np.arange(rows)[:, None] * factor + best // factor
    col = np.arange(cols)[None, :] * factor + best % factor
    picked = colors[np.minimum(row, height.shape[0] - 1), np.minimum(col, height.shape[1] - 1)]
    return tiles.max(axis=2), picked


def _runs(row: NDArray, col: NDArray, *alike: NDArray) -> tuple[NDArray, NDArray]:
    """Find where cells, sorted by row then column, go on without a gap and alike.

    Returns:
        the position of each run's first cell, and one past its last column.
    """
    goes_on = (np.diff(row) == 0) & (np.diff(col) == 1)
    for values in alike:
        goes_on &= np.diff(values) == 0
    first = np.flatnonzero(np.r_[True, ~goes_on]) if len(row) else np.zeros(0, int)
    last = np.r_[first[1:] - 1, len(row) - 1] if len(first) else first
    return first, col[last] + 1


def _tops(height: NDArray, key: NDArray) -> tuple[NDArray, NDArray]:
    """Return the corners [n, 4, 3] of the lids, in cells and metres of height, and their colour keys."""
    row, col = np.nonzero(height > 0)
    top, owner = height[row, col], key[row, col]
    first, end = _runs(row, col, top, owner)
    row, col, top = row[first], col[first], top[first]
    ring = ((col, row), (end, row), (end, row + 1), (col, row + 1))
    return np.stack([np.column_stack([x, y, top]) for x, y in ring], axis=1).astype(np.float64), owner[first]


_CORNERS = {
    (0, 1): ((1, 0), (1, 1)),
    (1, 0): ((1, 1), (0, 1)),
    (0, -1): ((0, 1), (0, 0)),
    (-1, 0): ((0, 0), (1, 0)),
}
"""Towards a neighbour (row, col): the two corners (x, y) of a cell that it touches, counter-clockwise from above."""


def _sides(height: NDArray, key: NDArray, towards: tuple[int, int]) -> tuple[NDArray, NDArray]:
    """Return corners [n, 4, 3] of the sides that face a neighbour, from that neighbour's lid up, and their keys."""
    d_row, d_col = towards
    inner = height[1:-1, 1:-1]
    beyond = height[1 + d_row : height.shape[0] - 1 + d_row, 1 + d_col : height.shape[1] - 1 + d_col]
    upright = d_col != 0
    along, across = np.nonzero((beyond < inner).T) if upright else np.nonzero(beyond < inner)
    row, col = (across + 1, along + 1) if upright else (along + 1, across + 1)
    top, foot, owner = height[row, col], height[row + d_row, col + d_col], key[row, col]
    first, end = _runs(along, across, top, foot, owner)
    row, col, top, foot = row[first], col[first], top[first], foot[first]
    length = end - across[first]
    (ax, ay), (bx, by) = (
        (x * (1 if upright else length), y * (length if upright else 1)) for x, y in _CORNERS[towards]
    )
    ring = ((ax, ay, foot), (bx, by, foot), (bx, by, top), (ax, ay, top))
    return np.stack([np.column_stack([col + x, row + y, z]) for x, y, z in ring], axis=1).astype(np.float64), owner[
        first
    ]


def ray_on_floor(origin: ArrayLike, direction: ArrayLike) -> tuple[float, float] | None:
    """Meet a ray (map frame, metres) with the floor z = 0; None when it never comes down to it."""
    o, d = np.asarray(origin, np.float64), np.asarray(direction, np.float64)
    if o[2] * d[2] >= 0.0:
        return None
    hit = o - d * (o[2] / d[2])
    return float(hit[0]), float(hit[1])


def ray_on_blocks(simap: SIMap, origin: ArrayLike, direction: ArrayLike) -> tuple[float, float] | None:
    """Meet a ray with the blocks of the 3-D view; where it meets none, with the floor.

    The ray is followed from the highest block down in steps of half a cell; the answer is good to a cell.
    """
    o, d = np.asarray(origin, np.float64), np.asarray(direction, np.float64)
    floor = ray_on_floor(o, d)
    if floor is None:
        return None

    # Points along the ray, from the height of the highest block down to the floor.
    d = d / np.linalg.norm(d)
    height = block_heights(simap)
    top = float(height.max(initial=0.0))
    start = max(0.0, (top - o[2]) / d[2])
    stop = -o[2] / d[2]
    steps = np.arange(start, stop, simap.spec.cell_size_m / 2.0)
    points = o + steps[:, None] * d

    # The first that is inside a block.
    row, col = simap.spec.cells_of(points[:, :2])
    inside = (row >= 0) & (row < simap.spec.rows) & (col >= 0) & (col < simap.spec.cols)
    met = np.zeros(len(steps), bool)
    met[inside] = points[inside, 2] <= height[row[inside], col[inside]]
    if not met.any():
        return floor
    first = points[int(met.argmax())]
    return float(first[0]), float(first[1])


BUILDING: Final = (*STRUCTURE, "curtain", "ceiling")
SHADE: Final = 0.45
"""How much of the light and dark of the surface is left where it is coloured by what it belongs to."""
DIMMED: Final = 0.4
"""How much of its colour is left to what is not emphasised: more than on the flat map, where outlines help."""
LAYER_M: Final = 0.1
"""Points are drawn in layers of this height, each a node that can be hidden."""
HIT_M: Final = 0.04
"""A ray meets a point that it passes this closely, a little more than half a voxel of 5 cm."""
NEAR_M: Final = 0.12
"""Where it meets none, it takes the one it passes closest, within this."""
BESIDE_M: Final = 0.15
"""Points of an object farther than this from its box were strewn there by errors of masks."""


def point_colors(
    simap: SIMap, points: Points, mode: ColorMode, *, lit: Collection[int] | None = None, theme: Theme = LIGHT
) -> NDArray:
    """Colour every point, uint8 [n, 3]: as seen ("photo"), by height, or by what it belongs to ("instance", "class").

    Args:
        simap: the map of the points.
        points: what to colour.
        mode: a colour mode of the map; points have no "observations" and are then shown as seen.
        lit: ids of the instances that keep their colour while all else is dimmed; None dims nothing.
        theme: of the page; what belongs to nothing is floor or clutter.
    """
    if mode == "height":
        grey = (np.clip(points.positions[:, 2] / HEIGHT_TOP_M, 0.0, 1.0) * 255).astype(np.uint8)
        colors = cv2.cvtColor(cv2.applyColorMap(grey.reshape(-1, 1), cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)
        colors = colors.reshape(-1, 3)
    elif mode in ("instance", "class"):
        shown = shown_class_colors(simap)
        of_class = np.array([shown.get(name, theme.clutter) for name in simap.grid.labels], np.uint8)
        for name, color in {"none": theme.clutter, "floor": theme.floor, "wall": theme.wall}.items():
            if name in simap.grid.labels:
                of_class[simap.grid.labels.index(name)] = color
        colors = of_class[np.maximum(points.classes, 0)]
        if mode == "instance":
            table = _instance_table(simap, int(points.instances.max(initial=0)))
            colors = np.where((points.instances > 0)[:, None], table[points.instances], colors)
        light = points.colors @ np.array([0.299, 0.587, 0.114], np.float32)
        light = 1.0 - SHADE + 2.0 * SHADE * np.minimum(light / max(2.0 * float(light.mean()), 1.0), 1.0)
        colors = np.minimum(colors * light[:, None], 255).astype(np.uint8)
    else:
        colors = points.colors
    if lit is None:
        return np.ascontiguousarray(colors)
    keep = np.isin(points.instances, np.fromiter(lit, np.int32, len(lit)))
    pale = colors.astype(np.float32) * DIMMED + np.array(theme.unseen, np.float32) * (1.0 - DIMMED)
    return np.where(keep[:, None], colors, pale.astype(np.uint8))


def _instance_table(simap: SIMap, highest: int) -> NDArray:
    """Return uint8 [highest + 1, 3]: the colour of each id; those no cell shows have that of their number."""
    known = instance_colors(simap)
    table = np.zeros((max(highest + 1, len(known)), 3), np.uint8)
    table[: len(known)] = known
    for number in range(len(known), len(table)):
        table[number] = color_of_instance(simap, number)
    return table


def layers(simap: SIMap, points: Points) -> list[tuple[float, bool, NDArray]]:
    """Split points into layers by height: (lower end in metres, whether it is building, indices int64 [k]).

    What is building (walls, doors, what has no class) is apart from furniture, as it is cut lower in a view from above.
    """
    parts_of_it = [name.split("-")[0] in BUILDING for name in simap.grid.labels]  # COCO has window-blind and more
    building = np.array(parts_of_it)[np.maximum(points.classes, 0)]
    building |= (points.classes < 0) & (points.instances == 0)
    level = np.floor(points.positions[:, 2] / LAYER_M + 1e-4).astype(np.int64) * 2 + building
    order = np.argsort(level, kind="stable")
    values, starts = np.unique(level[order], return_index=True)
    parts = np.split(order, starts[1:]) if len(order) else []
    return [(float(v // 2) * LAYER_M, bool(v % 2), part) for v, part in zip(values, parts, strict=True)]


def is_shown(low_m: float, building: bool, cut_m: float, whole_walls: bool) -> bool:
    """Whether a layer is shown that begins at a height, while everything is cut at another and walls are low."""
    limit = cut_m if whole_walls or not building else min(cut_m, WALL_CUT_M)
    return low_m < limit - 1e-6


def ray_on_points(positions: NDArray, origin: ArrayLike, direction: ArrayLike) -> int | None:
    """Return the index of the first point that a ray meets, else of the one it passes closest; None if none is near.

    Args:
        positions: float [n, 3], metres.
        origin: of the ray, same frame.
        direction: of any length.
    """
    start, along = np.asarray(origin, np.float64), np.asarray(direction, np.float64)
    along = along / np.linalg.norm(along)
    offset = positions - start
    reach = offset @ along
    apart = np.sqrt(np.maximum(np.einsum("ij,ij->i", offset, offset) - reach**2, 0.0))
    apart[reach <= 0.0] = np.inf
    met = np.flatnonzero(apart <= HIT_M)
    if len(met):
        return int(met[reach[met].argmin()])
    nearest = int(apart.argmin()) if len(apart) else 0
    return nearest if len(apart) and apart[nearest] <= NEAR_M else None


def stack_at(simap: SIMap, x_m: float, y_m: float) -> dict[int, float]:
    """Return {instance: height of its highest point in the cell of a place} from top to floor; none without voxels.

    The first is the one that the map shows there, whatever else was seen as high. Points that masks have strewn beside
    the box of their object do not put it there.
    """
    if not has_voxels(simap):
        return {}
    points, half = space_points(simap), simap.spec.cell_size_m / 2
    row, col = simap.spec.cell_of(x_m, y_m)
    x, y = simap.spec.centre_of(row, col)
    positions = points.positions
    here = (np.abs(positions[:, 0] - x) < half) & (np.abs(positions[:, 1] - y) < half) & (points.instances > 0)
    found: dict[int, float] = {}
    for at in np.flatnonzero(here)[np.argsort(-positions[here, 2], kind="stable")].tolist():
        found.setdefault(int(points.instances[at]), float(positions[at, 2]))
    found = {number: z for number, z in found.items() if _stands_at(simap.by_id(number), x, y)}
    on_top = int(simap.instance[row, col]) if simap.spec.contains(row, col) else 0
    return {on_top: found.get(on_top, float(simap.grid.height_m[row, col])), **found} if on_top else found


def _stands_at(one: Instance, x_m: float, y_m: float) -> bool:
    """Whether a place is in the box of an object, seen from above, or at most `BESIDE_M` from it."""
    if one.box is None:
        return False
    (x, y, _), sides_m, yaw = one.box.center_m, one.box.size_m, one.box.yaw_rad
    along = (x_m - x) * np.cos(yaw) + (y_m - y) * np.sin(yaw)
    across = (y_m - y) * np.cos(yaw) - (x_m - x) * np.sin(yaw)
    return bool(abs(along) <= sides_m[0] / 2 + BESIDE_M and abs(across) <= sides_m[1] / 2 + BESIDE_M)


def instance_near(simap: SIMap, place_m: tuple[float, float, float]) -> int | None:
    """Return the instance of the point nearest to a place in space; None where that belongs to nothing."""
    points = space_points(simap)
    nearest = int(((points.positions - np.asarray(place_m)) ** 2).sum(axis=1).argmin())
    return int(points.instances[nearest]) or None


def place_of(simap: SIMap, instance_id: int) -> tuple[float, float, float] | None:
    """Return the point of an instance nearest to the middle of its points; None where it has none."""
    points = space_points(simap)
    mine = points.positions[points.instances == instance_id]
    if len(mine) == 0:
        return None
    x, y, z = mine[int(((mine - mine.mean(axis=0)) ** 2).sum(axis=1).argmin())].tolist()
    return x, y, z
