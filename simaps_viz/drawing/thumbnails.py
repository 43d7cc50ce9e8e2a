"""Small pictures of an instance as the camera saw it, its mask outlined."""

from collections.abc import Collection, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

OUTLINE = (255, 214, 10)
OTHER_OUTLINE = (205, 92, 255)
DASH = 14
"""Length of the dashes of an outline that two objects share, pixels."""
FONT_SCALE = 1.3
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
    x0, y0, x1, y1 = _window(masks[0] | masks[1] | masks[2])
    scale = WIDTH / (x1 - x0)
    picture = cv2.resize(
        rgb[y0:y1, x0:x1], (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    )
    picture = np.ascontiguousarray(picture)
    for mask, color in zip(masks, (OUTLINE, OUTLINE, OTHER_OUTLINE), strict=True):
        large = cv2.resize(mask[y0:y1, x0:x1], (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
        contours, _ = cv2.findContours(large, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, contours, -1, (20, 20, 20), 6, cv2.LINE_AA)
        cv2.drawContours(picture, contours, -1, color, 3, cv2.LINE_AA)
        if mask is masks[1]:
            dashes = [line[i : i + DASH] for line in contours for i in range(0, len(line), 2 * DASH)]
            cv2.polylines(picture, dashes, False, OTHER_OUTLINE, 3, cv2.LINE_AA)
    return picture


def named(picture: NDArray, name: str) -> NDArray:
    """Write a name into the lower left corner of a thumbnail, as large as it fits; gives a copy."""
    picture = picture.copy()
    (width, _), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, FONT_SCALE, 2)
    scale = FONT_SCALE * min(1.0, (WIDTH - 2 * PAD) / max(width, 1))
    (width, height), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, scale, 2)
    cv2.rectangle(picture, (0, HEIGHT - height - 2 * PAD), (width + 2 * PAD, HEIGHT), (20, 20, 20), -1)
    place = (PAD, HEIGHT - PAD)
    cv2.putText(picture, name, place, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 2, cv2.LINE_AA)
    return picture


def gallery(pictures: Sequence[NDArray]) -> NDArray:
    """Lay out one to three thumbnails: the first large, the others stacked beside it; uint8 [h, w, 3]."""
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
