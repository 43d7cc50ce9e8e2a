"""Pictures of frames: a frame with its masks, the frames that show an object best, and small pictures of it.

Things are filled and stuff is hatched, so that they are not told apart by colour alone.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import class_color
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.sheet import fitting, width_of, write
from simaps_viz.mapping.partition import owner_of_community
from simaps_viz.structures import Segment, Segmentation, SIMap, Views

ColorBy = Literal["class", "confidence"]

STRIPES_PX = 8
"""Width of a stripe and of the gap after it, where stuff is."""
DASH_PX = 7
HALO = (20, 20, 20)


@dataclass(frozen=True)
class MaskStyle:
    """How masks are drawn."""

    color_by: ColorBy = "class"
    opacity: float = 0.5
    """Opacity of the fill, 0 to 1; outlines are always opaque."""
    names: bool = True
    """Write class and confidence on each segment."""
    hidden: frozenset[str] = frozenset()
    """Classes that are left out."""
    width: int = 560
    """Width of the picture, pixels; the height follows from it."""
    colors: Mapping[str, Color] = field(default_factory=dict)
    """Colours of classes, as the map has them; classes that are not listed have `class_color`."""
    most_names: int | None = None
    """Write the names of only so many segments, the largest; None = of all."""
    font_px: int = 20
    """It is shown at about half its size in the panel."""


def segment_color(segment: Segment, style: MaskStyle) -> Color:
    """Return the RGB colour of a segment: that of its class, or how sure the network is, from dark blue to yellow."""
    return named_color(segment.label, style.colors) if style.color_by == "class" else confidence_color(segment.score)


def named_color(label: str, colors: Mapping[str, Color]) -> Color:
    """Return the colour of a class: the map's, or else its own."""
    return colors.get(label) or class_color(label)


def confidence_color(score: float) -> Color:
    """Return the RGB colour of a confidence in [0, 1]: the map "cividis", made for any kind of colour vision."""
    level = np.full((1, 1), round(255 * min(max(score, 0.0), 1.0)), np.uint8)
    b, g, r = cv2.applyColorMap(level, cv2.COLORMAP_CIVIDIS)[0, 0].tolist()
    return (r, g, b)


def paint_masks(rgb: NDArray, masks: Segmentation, style: MaskStyle) -> NDArray:
    """Lay masks over a colour image.

    Args:
        rgb: uint8 [H, W, 3].
        masks: of the same frame; may be of another size.
        style: how.

    Returns:
        uint8 [h, style.width, 3], RGB.
    """
    height = max(1, round(rgb.shape[0] * style.width / rgb.shape[1]))
    shrinks = style.width < rgb.shape[1]
    picture = cv2.resize(rgb, (style.width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    ids = cv2.resize(masks.ids, (style.width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    shown = [s for s in masks.segments if s.label not in style.hidden]
    picture = _filled(picture, ids, shown, style)

    # Outlines and names of the large segments first, so that those of small ones lie on top.
    parts = [(segment, *_cut(ids, segment.id)) for segment in shown]
    found = [(segment, mask, left, top) for segment, mask, left, top in parts if mask.size]
    found.sort(key=lambda part: -int(np.count_nonzero(part[1])))
    for segment, mask, left, top in found:
        _outline(picture, mask, (left, top), segment, style)
    if style.names:
        _write_names(picture, found[: style.most_names], style)
    return picture


def _filled(picture: NDArray, ids: NDArray, shown: Sequence[Segment], style: MaskStyle) -> NDArray:
    size = int(ids.max(initial=0)) + 1
    colors, fills = np.zeros((size, 3), np.uint8), np.zeros(size, np.uint8)
    for segment in shown:
        if segment.id < size:
            colors[segment.id] = segment_color(segment, style)
            fills[segment.id] = 1 if segment.is_thing else 2
    blended = cv2.addWeighted(picture, 1.0 - style.opacity, colors[ids], style.opacity, 0.0)
    v, u = np.ogrid[: ids.shape[0], : ids.shape[1]]
    kind, striped = fills[ids], (u + v) % (2 * STRIPES_PX) < STRIPES_PX
    return np.ascontiguousarray(np.where(((kind == 1) | ((kind == 2) & striped))[..., None], blended, picture))


def _cut(ids: NDArray, number: int) -> tuple[NDArray, int, int]:
    """Return a segment's mask, uint8, cut to its box with a border of 1, and the box's corner; empty when it is not."""
    mask = (ids == number).astype(np.uint8)
    left, top, width, height = cv2.boundingRect(mask)
    if not width:
        return np.zeros((0, 0), np.uint8), 0, 0
    cut = mask[top : top + height, left : left + width]
    return cv2.copyMakeBorder(cut, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0), left - 1, top - 1


def _outline(picture: NDArray, mask: NDArray, corner: tuple[int, int], segment: Segment, style: MaskStyle) -> None:
    lines, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE, offset=corner)
    color = segment_color(segment, style)
    if segment.is_thing:
        cv2.drawContours(picture, lines, -1, HALO, 4, cv2.LINE_AA)
        cv2.drawContours(picture, lines, -1, color, 2, cv2.LINE_AA)
        return
    dashes = [line[i : i + DASH_PX] for line in lines for i in range(0, len(line), 2 * DASH_PX)]
    cv2.polylines(picture, dashes, False, color, 2, cv2.LINE_AA)


def _write_names(picture: NDArray, found: Sequence[tuple[Segment, NDArray, int, int]], style: MaskStyle) -> None:
    """Name segments, large ones first; a name that would cover another goes below it, or is left out."""
    taken: list[tuple[float, float, float, float]] = []
    size = style.font_px
    for segment, mask, left, top in found:
        text = fitting(segment_name(segment), size, picture.shape[1] - 8)
        wide, high = width_of(text, size) + 8, size + 6
        x, y = _deepest(mask)
        x0 = min(max(left + x - wide / 2, 0), picture.shape[1] - wide)
        for shift in (0, 1, -1, 2, -2):
            y0 = min(max(top + y - high / 2 + shift * high, 0), picture.shape[0] - high)
            if not any(x0 < b[2] and b[0] < x0 + wide and y0 < b[3] and b[1] < y0 + high for b in taken):
                taken.append((x0, y0, x0 + wide, y0 + high))
                color = named_color(segment.label, style.colors)
                _plate(picture, text, (x0, y0, wide, high), color, thing=segment.is_thing)
                break


def segment_name(segment: Segment) -> str:
    """Write class and confidence: "chair 0.83"; stuff, which is nothing that can be counted, in brackets."""
    return f"{segment.label} {segment.score:.2f}" if segment.is_thing else f"({segment.label} {segment.score:.2f})"


def _plate(picture: NDArray, text: str, box: tuple[float, float, float, float], color: Color, *, thing: bool) -> None:
    x, y, wide, high = (round(value) for value in box)
    area = picture[y : y + high, x : x + wide]
    area[:] = area // 5 + np.array([12, 12, 12], np.uint8)
    if thing:
        area[-2:] = color
    write(picture, text, (x + 4, y + high / 2 - 1), high - 6, (255, 255, 255))


def _deepest(mask: NDArray) -> tuple[float, float]:
    """Return the (x, y) of a mask that is farthest from its edge."""
    depth = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
    _, _, _, place = cv2.minMaxLoc(depth)
    return float(place[0]), float(place[1])


@dataclass(frozen=True)
class BestView:
    """A frame that shows an instance well."""

    frame: int
    """Index into ``SIMap.frame_names``."""
    segments: tuple[int, ...]
    """Ids in that frame's segmentation."""
    cells: int
    """Cells of the instance that the frame named."""


STRAY = 0.05
"""A segment with less than this share of what the largest one named of an instance is none of its masks."""


def best_views(simap: SIMap, instance_id: int, most: int = 3) -> list[BestView]:
    """Return the frames that named most cells of an instance, best first (ties: the earlier frame).

    Frames next to one another show the same, so one within a twentieth of the sequence of a better one is passed over
    while there are others.
    """
    views = simap.views
    owner = owner_of_community(simap)[views.community]
    mine = owner == instance_id
    frames, cells = views.frame[mine], views.cells[mine]
    names = np.unique(frames)
    totals = np.array([int(cells[frames == f].sum()) for f in names])
    ranked = [int(names[i]) for i in np.lexsort((names, -totals))]

    # The best that are apart from one another, then the best of the others.
    apart = len(simap.frame_names) // 20
    chosen: list[int] = []
    for frame in ranked:
        if len(chosen) < most and all(abs(frame - other) > apart for other in chosen):
            chosen.append(frame)
    chosen += [f for f in ranked if f not in chosen][: most - len(chosen)]
    chosen.sort(key=ranked.index)
    return [BestView(f, _own_segments(views, owner, instance_id, f), int(cells[frames == f].sum())) for f in chosen]


def _own_segments(views: Views, owner: NDArray, instance_id: int, frame: int) -> tuple[int, ...]:
    """Return the segments with which a frame named an instance: those that named more of it than of any other.

    Stray cells at its edge make no mask of a neighbour its own, also where these are all that the mask named on top.
    Where there is no such segment, all that named it.
    """
    here = views.frame == frame
    segments, at = np.unique(views.segment[here], return_inverse=True)
    owners, whose = np.unique(owner[here], return_inverse=True)
    named = np.zeros((len(segments), len(owners)))
    np.add.at(named, (at, whose), views.cells[here])
    mine = named[:, np.searchsorted(owners, instance_id)]
    named[:, owners == 0] = 0.0
    most = (mine > STRAY * mine.max()) & (mine >= named.max(axis=1))
    return tuple(segments[most if most.any() else mine > 0].tolist())


def communities_unseen_until(simap: SIMap, frame: int) -> NDArray:
    """Return the finest communities that no segment had named up to and with a frame, int32 [n]."""
    known = np.unique(simap.views.community[simap.views.frame <= frame])
    every = np.unique(simap.community[simap.community > 0])
    return np.setdiff1d(every, known).astype(np.int32)


OUTLINE = (255, 214, 10)
OTHER_OUTLINE = (205, 92, 255)
DASH = 14
"""Length of the dashes of an outline that two objects share, pixels."""
NAME_PX, MIN_NAME_PX = 36, 16
PAD = 10
WIDTH = 360
"""Width of a thumbnail, pixels."""
HEIGHT = 270
GAP = 6
BETWEEN = 128
"""Grey between thumbnails, and where there is none: neither glaring on a dark page nor black on a light one."""


def outlined(rgb: NDArray, ids: NDArray, segments: Collection[int], others: Collection[int] = ()) -> NDArray:
    """Cut a picture to the surroundings of some segments and outline them.

    Args:
        rgb: uint8 [H, W, 3].
        ids: int32 [H, W], the frame's segmentation; may be of another size than the picture.
        segments: ids to outline.
        others: ids to outline in another colour; those that are among ``segments`` too are dashed in it.

    Returns:
        uint8 [HEIGHT, WIDTH, 3], RGB.
    """
    height, width = rgb.shape[:2]
    if ids.shape != (height, width):
        ids = cv2.resize(ids.astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST).astype(np.int32)
    mine, shared, theirs = set(segments) - set(others), set(segments) & set(others), set(others) - set(segments)
    masks = [np.isin(ids, list(group)).astype(np.uint8) for group in (mine, shared, theirs)]

    # Cut and enlarge the surroundings.
    x0, y0, x1, y1 = _window(masks[0] | masks[1] | masks[2])
    scale = WIDTH / (x1 - x0)
    picture = cv2.resize(
        rgb[y0:y1, x0:x1], (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    )
    picture = np.ascontiguousarray(picture)

    # A dark line below each outline keeps it visible on any picture.
    for mask, color in zip(masks, (OUTLINE, OUTLINE, OTHER_OUTLINE), strict=True):
        large = cv2.resize(mask[y0:y1, x0:x1], (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
        contours, _ = cv2.findContours(large, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, contours, -1, HALO, 6, cv2.LINE_AA)
        cv2.drawContours(picture, contours, -1, color, 3, cv2.LINE_AA)
        if mask is masks[1]:
            dashes = [line[i : i + DASH] for line in contours for i in range(0, len(line), 2 * DASH)]
            cv2.polylines(picture, dashes, False, OTHER_OUTLINE, 3, cv2.LINE_AA)
    return picture


def named(picture: NDArray, name: str) -> NDArray:
    """Return a copy of a thumbnail with a name in its lower left corner, smaller or cut if it is too long."""
    picture, room = picture.copy(), WIDTH - 2 * PAD
    size = max(MIN_NAME_PX, round(NAME_PX * min(1.0, room / max(width_of(name, NAME_PX), 1))))
    text = fitting(name, size, room)
    picture[HEIGHT - size - PAD :, : width_of(text, size) + 2 * PAD] = HALO
    write(picture, text, (PAD, HEIGHT - (size + PAD) / 2), size, (255, 255, 255))
    return picture


def gallery(pictures: Sequence[NDArray]) -> NDArray:
    """Lay out one to three thumbnails: the first large, the others stacked to its right; uint8 [h, w, 3]."""
    first, others = pictures[0], pictures[1:3]
    height, width = 2 * HEIGHT + GAP, round((2 * HEIGHT + GAP) * WIDTH / HEIGHT)
    page = np.full((height, width + GAP + WIDTH if others else width, 3), BETWEEN, np.uint8)
    page[:, :width] = cv2.resize(first, (width, height), interpolation=cv2.INTER_LINEAR)
    for row, picture in enumerate(others):
        top = row * (HEIGHT + GAP)
        page[top : top + HEIGHT, width + GAP :] = picture
    return page


def _window(mask: NDArray) -> tuple[int, int, int, int]:
    """Return the part (x0, y0, x1, y1) to show: the mask with room around it, 4:3, never beyond the picture."""
    height, width = mask.shape
    rows, cols = np.nonzero(mask)
    if len(rows) == 0:
        return _fit(width / 2, height / 2, width, width, height)
    wide = max((np.ptp(cols) + 1) * 1.8, (np.ptp(rows) + 1) * 1.8 * WIDTH / HEIGHT, width / 3)
    return _fit((cols.min() + cols.max()) / 2, (rows.min() + rows.max()) / 2, wide, width, height)


def _fit(x: float, y: float, wide: float, width: int, height: int) -> tuple[int, int, int, int]:
    wide = min(wide, width, height * WIDTH / HEIGHT)
    w, h = max(1, int(wide)), max(1, int(wide * HEIGHT / WIDTH))
    x0 = int(np.clip(x - w / 2, 0, width - w))
    y0 = int(np.clip(y - h / 2, 0, height - h))
    return x0, y0, x0 + w, y0 + h
