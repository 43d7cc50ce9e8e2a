"""The map as a picture: a Semantic Instance Map, a colour mode and what is emphasised, to an RGB image.

Row 0 of every image is the map's southernmost row, which is what viser wants for an image lying on the floor.
"""

from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.array_cache import ArrayCache
from simaps_viz.colors.classes import COMMON, cells_of_classes, class_color, ground_kinds
from simaps_viz.colors.instances import class_colors, instance_colors
from simaps_viz.colors.palette import PALETTE, Color
from simaps_viz.drawing.theme import LIGHT, Theme
from simaps_viz.geometry import STANDS_FROM_M
from simaps_viz.mapping.in_space import space_points
from simaps_viz.structures import Grid, GridSpec, SIMap

ColorMode = Literal["instance", "class", "height", "observations", "photo"]
COLOR_MODES: tuple[ColorMode, ...] = get_args(ColorMode)

UNSEEN, FLOOR, CLUTTER, WALL = LIGHT.unseen, LIGHT.floor, LIGHT.clutter, LIGHT.wall
"""Colours of the light page."""
GROUND = 4
"""Kinds of ground: unseen, floor, clutter, wall, in this order."""
BORDER = 0.55
"""Factor that darkens the rim of an object."""
STRIPE = 0.7
"""Factor that darkens a pattern of a class."""
PATTERNS: tuple[Callable[[NDArray, NDArray], NDArray], ...] = (
    lambda row, col: np.zeros(np.broadcast_shapes(row.shape, col.shape), bool),
    lambda row, col: (row + col) % 4 < 2,
    lambda row, col: (row - col) % 4 < 2,
    lambda row, col: (row + 0 * col) % 4 < 2,
    lambda row, col: (0 * row + col) % 4 < 2,
    lambda row, col: (row // 2 + col // 2) % 2 == 1,
)
"""Which cells of a class are darker: none, stripes in four directions, squares; the legend has the same."""
FADED = 0.22
"""How much of its colour is left to what is not emphasised."""
FAINT = 0.25
"""How much of its colour is left to what is doubtful."""
TINT = 0.25
"""Share of its object's colour in a cell of the photo, at first."""
HEIGHT_TOP_M = 2.0

MAX_TEXTURE_PIXELS = 1600
MAX_PIXELS_PER_CELL = 6

MAX_SKETCH_PIXELS = 200
"""Along the longer side; larger maps show every so many-th cell."""
CAMERA = (220, 60, 40)

_grounds, _photos = ArrayCache(), ArrayCache()


@dataclass(frozen=True, eq=False)
class MapPicture:
    """A picture that is shown on the floor instead of a map's own."""

    spec: GridSpec
    """Which part of the floor it covers."""
    pixels: NDArray
    """uint8 [rows * n, cols * n, 3 or 4], RGB or RGBA, row 0 at the south; n = 1, 2, ..."""


def pixels_per_cell(simap: SIMap) -> int:
    """Choose how many pixels a cell's edge gets, so that cells stay crisp when the map is enlarged."""
    return int(np.clip(MAX_TEXTURE_PIXELS // max(simap.spec.shape), 1, MAX_PIXELS_PER_CELL))


def cell_colors(
    simap: SIMap,
    mode: ColorMode,
    *,
    lit: Collection[int] | None = None,
    hidden: Collection[int] = (),
    theme: Theme = LIGHT,
) -> NDArray:
    """Colour every cell.

    Args:
        simap: the map.
        mode: what the colours mean.
        lit: ids of the instances that keep their full colour while all else is dimmed; None dims nothing.
        hidden: communities (finest, as in ``SIMap.community``) drawn as if nobody had named them.
        theme: of the page.

    Returns:
        uint8 [rows, cols, 3], RGB.
    """
    if mode in ("height", "observations", "photo"):
        colors = photo(simap, theme) if mode == "photo" else _ramp_colors(simap, mode, theme)
        if lit is None:
            return colors
        keep = np.isin(simap.instance, np.fromiter(lit, np.int32, len(lit)))
        return np.where(keep[..., None], colors, _fade(colors, theme))
    base, grounds = _ground(simap, mode)
    index = base.astype(np.int32)
    np.add(simap.instance, grounds - 1, out=index, where=simap.instance > 0)
    if len(hidden):
        unborn = np.zeros(int(simap.community.max(initial=0)) + 1, bool)
        unborn[[c for c in hidden if c < len(unborn)]] = True
        index[unborn[simap.community] & (simap.instance > 0)] = 1
    palette = _palette(simap, mode, grounds, lit, theme)
    if mode == "class":
        _draw_patterns(simap, index, len(palette) // 2)
    return _looked_up(palette, index)


def _draw_patterns(simap: SIMap, index: NDArray, size: int) -> None:
    """Let cells of classes that share their colour with others look up the darker one, ``size`` places on, in place."""
    patterns = class_patterns(simap)
    if not any(patterns.values()):
        return
    places = np.zeros(size, np.uint8)
    grounds = GROUND + len(simap.grid.labels)
    places[GROUND:grounds] = [patterns.get(name, 0) for name in simap.grid.labels]
    for one in simap.instances:
        places[grounds - 1 + one.id] = patterns[one.label]
    row, col = np.ogrid[: index.shape[0], : index.shape[1]]
    of_cell = places.take(index)
    for pattern in sorted({*patterns.values()} - {0}):
        np.add(index, size, out=index, where=(of_cell == pattern) & PATTERNS[pattern](row, col))


def class_patterns(simap: SIMap) -> dict[str, int]:
    """Choose what tells classes of one colour apart: places in `PATTERNS`, in the order of names, common ones first."""
    colors, things, used = shown_class_colors(simap), class_colors(simap), Counter[Color]()
    patterns = {}
    for name in sorted(colors, key=lambda name: (name not in things, name not in COMMON, name)):
        patterns[name] = used[colors[name]] % len(PATTERNS)
        used[colors[name]] += 1
    return patterns


def _palette(simap: SIMap, mode: ColorMode, grounds: int, lit: Collection[int] | None, theme: Theme) -> NDArray:
    """Return uint8 [n, 3]: the colours of the grounds, then those of ids 1, 2, ...; of classes all again, darker."""
    colors = instance_colors(simap)[1:]
    palette = np.concatenate([np.zeros((grounds, 3), np.uint8), colors])
    palette[:GROUND] = theme.grounds
    if mode == "class":
        of_class = shown_class_colors(simap)
        palette[GROUND:grounds] = [of_class.get(name, class_color(name)) for name in simap.grid.labels]
        for one in simap.instances:
            palette[grounds - 1 + one.id] = of_class[one.label]
    size = len(palette)
    if mode == "class":
        palette = np.concatenate([palette, (palette * STRIPE).astype(np.uint8)])
    if lit is not None:
        keep = np.zeros(len(palette), bool)
        places = np.fromiter(lit, np.int64, len(lit)) + grounds - 1
        keep[places[places < size]] = True
        keep[size:] = keep[: len(palette) - size]
        palette = np.where(keep[:, None], palette, _fade(palette, theme))
    return palette


def shown_class_colors(simap: SIMap) -> dict[str, Color]:
    """Choose a colour for every class that a map's frames name: that of `class_colors` where there is one.

    Classes that cannot be counted, or that are not on the map, get the colour that the fewest others have.
    """
    colors = class_colors(simap)
    used = Counter(colors.values())
    for name in sorted(set(simap.grid.labels) - set(colors) - {""}):
        start = PALETTE.index(class_color(name)) if class_color(name) in PALETTE else 0
        around = (*PALETTE[start:], *PALETTE[:start])
        colors[name] = min(around, key=lambda color: used[color])
        used[colors[name]] += 1
    return colors


def _looked_up(palette: NDArray, index: NDArray) -> NDArray:
    """Return palette[index], uint8 [rows, cols, 3]; a colour is moved as one number, which is several times faster."""
    packed = np.full((len(palette), 4), 255, np.uint8)
    packed[:, :3] = palette
    pixels = packed.view(np.uint32)[:, 0].take(index, mode="clip")
    return cv2.cvtColor(pixels.view(np.uint8).reshape(*index.shape, 4), cv2.COLOR_RGBA2RGB)


def _fade(colors: NDArray, theme: Theme) -> NDArray:
    return (colors.astype(np.float32) * FADED + np.array(theme.unseen, np.float32) * (1.0 - FADED)).astype(np.uint8)


def map_image(
    simap: SIMap,
    mode: ColorMode = "instance",
    *,
    lit: Collection[int] | None = None,
    hidden: Collection[int] = (),
    scale: int = 1,
    theme: Theme = LIGHT,
    tint: float = TINT,
) -> NDArray:
    """Paint the map, coloured as by `cell_colors`; ``scale``: pixels along a cell's edge, a darker rim from 3 on.

    On a photo ``tint`` is the share of its object's colour in a cell, 0 to 1.

    Returns:
        uint8 [rows * scale, cols * scale, 3], RGB, row 0 at the south.
    """
    colors = cell_colors(simap, mode, lit=lit, hidden=hidden, theme=theme)
    if scale == 1 and mode != "photo":
        return colors
    image = cv2.resize(colors, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    if scale >= 3 and mode in ("instance", "class"):
        _draw_rims(image, (colors * BORDER).astype(np.uint8), simap.instance, scale)
    elif mode == "photo":
        # Objects are tinted and outlined in their colours, as a photo alone does not tell them apart.
        own = cell_colors(simap, "instance", lit=lit, hidden=hidden, theme=theme)
        tinted = (colors * (1.0 - tint) + own * tint).astype(np.uint8)
        tinted = np.where((simap.instance > 0)[..., None], tinted, colors)
        image = cv2.resize(tinted, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
        _draw_rims(image, own, simap.instance, scale, width=max(1, scale // 3))
    return image


def color_modes(simap: SIMap) -> tuple[ColorMode, ...]:
    """Return the colour modes of a map: "photo" only where it knows the colours of its surface."""
    seen = simap.surface is not None and simap.surface.color.size > 0
    return COLOR_MODES if seen else tuple(mode for mode in COLOR_MODES if mode != "photo")


def photo(simap: SIMap, theme: Theme = LIGHT) -> NDArray:
    """Return the room from above as it looked: uint8 [rows, cols, 3], the colour of the highest voxel of each cell.

    Cells without a point are as if unseen.
    """
    points, spec = space_points(simap), simap.spec

    def compute() -> NDArray:
        row, col = spec.cells_of(points.positions[:, :2])
        inside = np.flatnonzero((row >= 0) & (row < spec.rows) & (col >= 0) & (col < spec.cols))
        order = inside[np.argsort(points.positions[inside, 2], kind="stable")]  # the highest is written last
        image = np.zeros((*spec.shape, 4), np.uint8)
        image[row[order], col[order], :3] = points.colors[order]
        image[row[order], col[order], 3] = 255
        return image

    image = _photos.get((points.positions, points.colors), None, compute)
    return np.where(image[..., 3:] > 0, image[..., :3], np.array(theme.unseen, np.uint8))


def outline_segments(simap: SIMap, *ids: int, z_m: float = 0.0) -> NDArray:
    """Return the lines around each of the instances, float32 [n, 2, 3], map frame, metres; n = 0 without cells.

    Edges of cells that follow each other straight on are one line: what draws them is asked for far fewer.
    """
    inside = np.isin(simap.instance, ids) if ids else np.zeros((1, 1), bool)
    rows, cols = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if not len(rows):
        return np.zeros((0, 2, 3), np.float32)
    there = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    inside = np.pad(np.where(inside[there], simap.instance[there], 0), 1)
    row, start, end = _straight(inside[1:, :] != inside[:-1, :])
    level = np.stack([np.stack([start, row], -1), np.stack([end, row], -1)], 1)
    col, start, end = _straight((inside[:, 1:] != inside[:, :-1]).T)
    upright = np.stack([np.stack([col, start], -1), np.stack([col, end], -1)], 1)
    spec = simap.spec
    corners = np.add(np.concatenate([level, upright]), (cols[0], rows[0])) * spec.cell_size_m + (spec.x0_m, spec.y0_m)
    return np.concatenate([corners, np.full((*corners.shape[:2], 1), z_m)], axis=2).astype(np.float32)


def _straight(edges: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return the runs of true in each row of a padded picture bool [rows, cols]: row, first corner, corner after it."""
    steps = np.diff(edges.astype(np.int8), axis=1)  # the padding is never true
    row, start = np.nonzero(steps == 1)
    return row, start, np.nonzero(steps == -1)[1]


def fade_objects(image: NDArray, simap: SIMap, faint: Collection[int], theme: Theme) -> None:
    """Let objects keep a quarter of their colour, without rims, in a map's picture [rows * scale, cols * scale, 3]."""
    if not faint:
        return
    scale, cols = image.shape[1] // simap.spec.cols, simap.spec.cols
    # The middle pixel of a cell has its colour, the outer ones may be a rim.
    row, col = np.nonzero(np.isin(simap.instance, sorted(faint)))
    own = image[scale // 2 :: scale, scale // 2 :: scale][row, col]
    colors = (own * FAINT + np.array(theme.floor) * (1.0 - FAINT)).astype(np.uint8)
    image.reshape(-1, scale, cols, scale, 3)[row, :, col] = colors[:, None, None]


def _ground(simap: SIMap, mode: ColorMode) -> tuple[NDArray, int]:
    """Return what is below each cell's object, int16 [rows, cols], places in the palette; and how many there are.

    It depends on the grid alone, so it is kept while K moves.
    """
    grid = simap.grid

    def compute() -> NDArray:
        kinds = ground_kinds(grid).astype(np.int16)
        if mode == "class":
            stuff = (grid.label > 0) & ~cells_of_classes(grid, "floor", "wall")
            kinds[stuff] = GROUND + grid.label[stuff]
        return kinds

    kept = _grounds.get((grid.height_m, grid.label), mode, compute)
    return kept, GROUND + (len(grid.labels) if mode == "class" else 0)


def _ramp_colors(simap: SIMap, mode: ColorMode, theme: Theme) -> NDArray:
    if mode == "height":
        height = simap.grid.height_m
        return _ramp(height / HEIGHT_TOP_M, np.isnan(height), theme)
    seen = simap.grid.observations
    most = max(int(seen.max(initial=1)), 1)
    return _ramp(np.log1p(seen) / np.log1p(most), seen == 0, theme)


def _ramp(values: NDArray, unseen: NDArray, theme: Theme) -> NDArray:
    grey = (np.clip(np.nan_to_num(values), 0.0, 1.0) * 255).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)
    colors[unseen] = theme.unseen
    return colors


def _draw_rims(image: NDArray, colors: NDArray, instance: NDArray, scale: int, width: int = 1) -> None:
    """Set, in place, the pixels of an instance that touch another or none to the colour of their cell in ``colors``.

    Works on cells and writes only their outermost pixel rows and columns, ``width`` of them: a fraction of the picture.
    """
    rows, cols = instance.shape
    pixels = image.reshape(rows, scale, cols, scale, 3)
    rims = colors[:, :, None, :]
    padded = np.pad(instance, 1)
    for at in range(width):
        sides = (
            (pixels[:, at], padded[:-2, 1:-1]),
            (pixels[:, -1 - at], padded[2:, 1:-1]),
            (pixels[:, :, :, at].swapaxes(1, 2), padded[1:-1, :-2]),
            (pixels[:, :, :, -1 - at].swapaxes(1, 2), padded[1:-1, 2:]),
        )
        for side, neighbour in sides:
            edge = (instance > 0) & (instance != neighbour)
            np.copyto(side, rims, where=edge[:, :, None, None])


def sketch_png(grid: Grid, camera_m: NDArray) -> bytes:
    """Paint the cells by their classes, what is unseen left transparent.

    Args:
        grid: what was seen so far.
        camera_m: [2 or more], x and y of the camera, map frame, metres.

    Returns:
        PNG, RGBA, north up, one pixel for each cell that is shown.
    """
    step = max(1, -(-max(grid.spec.shape) // MAX_SKETCH_PIXELS))
    label, height = grid.label[::step, ::step], grid.height_m[::step, ::step]
    palette = np.array([(*class_color(name), 255) for name in grid.labels], np.uint8)
    for name, color in {"floor": LIGHT.floor, "wall": LIGHT.wall}.items():
        if name in grid.labels:
            palette[grid.labels.index(name), :3] = color
    pixels = palette[label]
    pixels[label == 0] = (*LIGHT.floor, 255)
    pixels[(label == 0) & (height >= STANDS_FROM_M)] = (*LIGHT.clutter, 255)
    pixels[np.isnan(height)] = 0
    spec = grid.spec
    at = (np.asarray(camera_m[:2]) - (spec.x0_m, spec.y0_m)) / (spec.cell_size_m * step)
    pixels = np.ascontiguousarray(pixels)
    cv2.circle(pixels, (int(at[0]), int(at[1])), max(2, max(label.shape) // 50), (*CAMERA, 255), -1)
    return cv2.imencode(".png", cv2.cvtColor(pixels[::-1], cv2.COLOR_RGBA2BGRA))[1].tobytes()
