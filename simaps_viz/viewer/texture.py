"""The map as a picture: a Semantic Instance Map, a colour mode and what is emphasised, to an RGB image.

Row 0 of every image is the map's southernmost row, which is what viser wants for an image lying on the floor.
"""

from collections.abc import Collection
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.labels import class_color, instance_palette
from simaps_viz.structures import SIMap

ColorMode = Literal["instance", "class", "height", "observations"]
COLOR_MODES: tuple[ColorMode, ...] = get_args(ColorMode)

UNSEEN = (250, 250, 252)
FLOOR = (229, 233, 239)
CLUTTER = (190, 196, 206)
"""Something stands there, but nobody could name it."""
WALL = (92, 98, 110)
BORDER = 0.55
"""Factor that darkens the rim of an object."""
STRUCTURE = ("wall", "column", "door", "window")
"""Classes that belong to the building."""
FURNITURE_FROM_M = 0.10
HEIGHT_TOP_M = 2.0

MAX_TEXTURE_PIXELS = 1600
MAX_PIXELS_PER_CELL = 6


def pixels_per_cell(simap: SIMap) -> int:
    """Choose how many pixels a cell's edge gets, so that cells stay crisp when the map is enlarged."""
    return int(np.clip(MAX_TEXTURE_PIXELS // max(simap.spec.shape), 1, MAX_PIXELS_PER_CELL))


def cell_colors(simap: SIMap, mode: ColorMode, *, hidden: Collection[int] = ()) -> NDArray:
    """Colour every cell.

    Args:
        simap: the map.
        mode: what the colours mean.
        hidden: communities (finest, as in ``SIMap.community``) drawn as if nobody had named them.

    Returns:
        uint8 [rows, cols, 3], RGB.
    """
    colors = _ground(simap)
    if mode == "height":
        return _ramp(simap.grid.height_m / HEIGHT_TOP_M, cv2.COLORMAP_VIRIDIS, np.isnan(simap.grid.height_m))
    if mode == "observations":
        seen = simap.grid.observations
        most = max(int(seen.max(initial=1)), 1)
        return _ramp(np.log1p(seen) / np.log1p(most), cv2.COLORMAP_VIRIDIS, seen == 0)
    named = simap.instance > 0
    if mode == "class":
        stuff = (simap.grid.label > 0) & ~named & ~is_ground_class(simap, "floor", "wall")
        palette = np.array([class_color(name) for name in simap.grid.labels], np.uint8)
        colors[named | stuff] = palette[simap.grid.label[named | stuff]]
    else:
        colors[named] = instance_palette(int(simap.instance.max(initial=0)) + 1)[simap.instance[named]]
    if len(hidden):
        unborn = np.isin(simap.community, np.fromiter(hidden, np.int32)) & named
        colors[unborn] = FLOOR
    return colors


def map_image(
    simap: SIMap,
    mode: ColorMode = "instance",
    *,
    lit: Collection[int] | None = None,
    hidden: Collection[int] = (),
    scale: int = 1,
) -> NDArray:
    """Paint the map.

    Args:
        simap: the map.
        mode: what the colours mean.
        lit: ids of the instances that keep their full colour while all else is dimmed; None dims nothing.
        hidden: communities not to show yet.
        scale: pixels along a cell's edge; from 3 on, objects get a darker rim.

    Returns:
        uint8 [rows * scale, cols * scale, 3], RGB, row 0 at the south.
    """
    colors = cell_colors(simap, mode, hidden=hidden)
    if lit is not None:
        keep = np.isin(simap.instance, np.fromiter(lit, np.int32, len(lit)))
        faded = colors.astype(np.float32) * 0.22 + np.array(UNSEEN, np.float32) * 0.78
        colors = np.where(keep[..., None], colors, faded.astype(np.uint8))
    if scale == 1:
        return colors
    image = cv2.resize(colors, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    if scale >= 3 and mode in ("instance", "class"):
        _darken_rims(image, colors, simap.instance, scale)
    return image


def outline_segments(simap: SIMap, instance_id: int, z_m: float = 0.0) -> NDArray:
    """Give the cell edges around an instance, float32 [n, 2, 3], map frame, metres; n = 0 when it has no cells."""
    inside = np.pad(simap.instance == instance_id, 1)
    s, x0, y0 = simap.spec.cell_size_m, simap.spec.x0_m, simap.spec.y0_m
    row, col = np.nonzero(inside[1:, :] != inside[:-1, :])
    level = np.stack([np.stack([col - 1, row], -1), np.stack([col, row], -1)], 1)
    row, col = np.nonzero(inside[:, 1:] != inside[:, :-1])
    upright = np.stack([np.stack([col, row - 1], -1), np.stack([col, row], -1)], 1)
    corners = np.concatenate([level, upright]) * s + (x0, y0)
    return np.concatenate([corners, np.full((*corners.shape[:2], 1), z_m)], axis=2).astype(np.float32)


def is_ground_class(simap: SIMap, *names: str) -> NDArray:
    """Give bool [rows, cols]: cells whose class is one of the names, or one of their kinds ("wall-brick")."""
    wanted = [i for i, label in enumerate(simap.grid.labels) if label.split("-")[0] in names]
    return np.isin(simap.grid.label, wanted)


def _ground(simap: SIMap) -> NDArray:
    """Everything that is no object: unseen, floor, wall, unnamed things."""
    height = simap.grid.height_m
    colors = np.full((*simap.spec.shape, 3), UNSEEN, np.uint8)
    colors[~np.isnan(height)] = FLOOR
    colors[(height >= FURNITURE_FROM_M) & ~is_ground_class(simap, "floor")] = CLUTTER
    colors[is_ground_class(simap, *STRUCTURE)] = WALL
    return colors


def _ramp(values: NDArray, colormap: int, unseen: NDArray) -> NDArray:
    grey = (np.clip(np.nan_to_num(values), 0.0, 1.0) * 255).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(grey, colormap), cv2.COLOR_BGR2RGB)
    colors[unseen] = UNSEEN
    return colors


def _darken_rims(image: NDArray, colors: NDArray, instance: NDArray, scale: int) -> None:
    """Darken, in place, the pixels of an instance that touch another or none.

    Works on cells and writes only their outermost pixel rows and columns: a fraction of the picture.
    """
    rows, cols = instance.shape
    pixels = image.reshape(rows, scale, cols, scale, 3)
    dark = (colors * BORDER).astype(np.uint8)[:, :, None, :]
    padded = np.pad(instance, 1)
    sides = (
        (pixels[:, 0], padded[:-2, 1:-1]),
        (pixels[:, -1], padded[2:, 1:-1]),
        (pixels[:, :, :, 0].swapaxes(1, 2), padded[1:-1, :-2]),
        (pixels[:, :, :, -1].swapaxes(1, 2), padded[1:-1, 2:]),
    )
    for side, neighbour in sides:
        edge = (instance > 0) & (instance != neighbour)
        np.copyto(side, dark, where=edge[:, :, None, None])
