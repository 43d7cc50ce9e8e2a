"""Text in pictures, in any script OpenCV's own font has; north up, pixel (0, 0) at the top left."""

import unicodedata
from functools import cache
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color

REGULAR, BOLD = 400, 700
_CAPITAL = 0.36
"""Half the height of a capital, as a share of the font size."""


def write(
    image: NDArray,
    text: str,
    at: tuple[float, float],
    size: int,
    color: Color,
    *,
    weight: int = REGULAR,
    anchor: Literal["left", "centre", "right"] = "left",
) -> None:
    """Write one line into a picture, in place.

    Args:
        image: uint8 [H, W, 3], contiguous.
        text: the line.
        at: (x, y) of its left end, middle or right end; y is its middle.
        size: of the font, pixels.
        color: RGB like the picture.
        weight: REGULAR or BOLD.
        anchor: what x means.
    """
    wide = width_of(text, size, weight=weight)
    x = at[0] - {"left": 0.0, "centre": wide / 2.0, "right": float(wide)}[anchor]
    place = (round(x), round(at[1] + _CAPITAL * size))
    font = _font()
    if font is None:
        thickness = max(1, round(size / 14)) + (weight > REGULAR)
        cv2.putText(image, _plain(text), place, cv2.FONT_HERSHEY_SIMPLEX, size / 30, color, thickness, cv2.LINE_AA)
    else:
        cv2.putText(image, text, place, color, font, size, weight, 0, (0, 1 << 20))


def width_of(text: str, size: int, *, weight: int = REGULAR) -> int:
    """Return how wide a line would be, pixels."""
    font = _font()
    if font is None:
        return cv2.getTextSize(_plain(text), cv2.FONT_HERSHEY_SIMPLEX, size / 30, max(1, round(size / 14)))[0][0]
    x, _, wide, _ = cv2.getTextSize((1 << 20, 200), text, (0, 0), font, size, weight)
    return int(x + wide)


def fitting(text: str, size: int, most: int, *, weight: int = REGULAR) -> str:
    """Cut a line so that it is at most so many pixels wide; what is cut is shown by dots."""
    if width_of(text, size, weight=weight) <= most:
        return text
    keep = len(text)
    while keep > 1 and width_of(text[:keep].rstrip() + "…", size, weight=weight) > most:
        keep -= 1
    return text[:keep].rstrip() + "…"


def chip(
    image: NDArray, text: str, at: tuple[float, float], size: int, ink: Color, paper: Color, *, bold: bool = False
) -> int:
    """Write a line on a plate of its own whose left edge is at x and whose middle at y; returns the plate's width."""
    weight = BOLD if bold else REGULAR
    pad = round(0.45 * size)
    wide = width_of(text, size, weight=weight) + 2 * pad
    high = round(0.85 * size)
    x, y = round(at[0]), round(at[1])
    box = image[max(0, y - high) : max(0, y + high), max(0, x) : max(0, x + wide)]
    box[:] = np.array(paper, np.uint8)
    write(image, text, (x + pad, y), size, ink, weight=weight)
    return wide


@cache
def _font() -> Any:
    """OpenCV 5 has a font of its own; before that there is only a plain one, for plain letters."""
    return cv2.FontFace("sans") if hasattr(cv2, "FontFace") else None


def _plain(text: str) -> str:
    for fancy, simple in (("–", "-"), ("…", "..."), ("→", "->"), ("·", "-"), ("“", '"'), ("”", '"')):
        text = text.replace(fancy, simple)
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
