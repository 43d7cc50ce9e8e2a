"""The observed surface as points: their colours, the layers in which they are drawn, and what a ray or a cell meets."""

from collections.abc import Collection
from typing import Final

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.colors.classes import STRUCTURE
from simaps_viz.colors.instances import color_of_instance, instance_colors
from simaps_viz.drawing.solids import WALL_CUT_M
from simaps_viz.drawing.texture import HEIGHT_TOP_M, ColorMode, shown_class_colors
from simaps_viz.drawing.theme import LIGHT, Theme
from simaps_viz.mapping.in_space import has_voxels, space_points
from simaps_viz.structures import Points, SIMap

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
    """Return {instance: height of its highest point in the cell of a place} from top to floor; none without voxels."""
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
    return found


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
