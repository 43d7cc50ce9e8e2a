"""Sheets: pictures with titles, panels, legends and scale bars, for evaluations, checks and files to share.

Words are drawn by OpenCV 5, whose own font has bold letters and many scripts; before OpenCV 5 by Pillow, whose own
font has plain letters only. x counts to the right and y down from the top left corner, in pixels.
"""

import io
import unicodedata
from functools import cache
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from simaps_viz.colors.palette import Color
from simaps_viz.io.files import check_output, write_whole

INK: Color = (26, 30, 38)
PALE_INK: Color = (90, 97, 108)
RULE: Color = (214, 218, 226)
"""Of thin lines: frames and grids."""
PAPER: Color = (255, 255, 255)
TITLE, SUBTITLE, WORDS = 24, 15, 15
"""Font sizes, before they grow with the sheet."""
SHORTEST_BAR = 60
"""Pixels of a scale bar, before they grow with the sheet."""

Box = tuple[float, float, float, float]
"""(left, top, right, bottom), pixels; right and bottom are excluded."""
Anchor = Literal["left", "centre", "right"]

_CAPITAL = 0.36
"""Half the height of a capital, as a share of the font size."""


def write(
    image: NDArray,
    text: str,
    at: tuple[float, float],
    size: int,
    color: Color,
    *,
    bold: bool = False,
    anchor: Anchor = "left",
) -> None:
    """Write one line into a picture, in place.

    Args:
        image: uint8 [H, W, 3], contiguous.
        text: the line.
        at: (x, y) of its left end, middle or right end; y is its middle.
        size: of the font, pixels.
        color: RGB like the picture.
        bold: in bold letters.
        anchor: what x means.
    """
    wide = width_of(text, size, bold=bold)
    x = at[0] - {"left": 0.0, "centre": wide / 2.0, "right": float(wide)}[anchor]
    x, y = round(x), round(at[1] + _CAPITAL * size)
    font = _font()
    if font is not None:
        cv2.putText(image, text, (x, y), color, font, size, 700 if bold else 400, 0, (0, 1 << 20))
        return
    top = max(0, y - 2 * size)
    strip = image[top : y + size]
    if strip.size:
        canvas = Image.fromarray(strip)
        ImageDraw.Draw(canvas).text(
            (x, y - top), _plain(text), fill=color, font=_plain_font(size), anchor="ls", stroke_width=int(bold)
        )
        strip[:] = np.asarray(canvas)


def width_of(text: str, size: int, *, bold: bool = False) -> int:
    """Return how wide a line is, pixels."""
    font = _font()
    if font is None:
        return int(np.ceil(_plain_font(size).getlength(_plain(text))))
    x, _, wide, _ = cv2.getTextSize((1 << 20, 200), text, (0, 0), font, size, 700 if bold else 400)
    return int(x + wide)


def fitting(text: str, size: int, room: float, *, bold: bool = False) -> str:
    """Shorten a line to at most so many pixels; what is left out is shown by dots."""
    if width_of(text, size, bold=bold) <= room:
        return text
    keep = len(text)
    while keep > 1 and width_of(text[:keep].rstrip() + "…", size, bold=bold) > room:
        keep -= 1
    return text[:keep].rstrip() + "…"


def wrapped(text: str, size: int, room: float) -> list[str]:
    """Break a text at its spaces into lines of at most so many pixels; all but the first are indented."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines[-1].strip() else f"{lines[-1]}{word}"
        if lines[-1].strip() and width_of(longer, size) > room:
            longer = f"   {word}"
            lines.append("")
        lines[-1] = longer
    return lines


def png_bytes(pixels: NDArray) -> bytes:
    """Encode a picture, uint8 [H, W, 3], RGB, as PNG."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def save_png(pixels: NDArray, path: Path) -> None:
    """Write a picture as PNG, replacing an earlier file only once the new one is complete.

    Raises:
        InputError: the file cannot be written, or is not called .png.
    """
    check_output(path, ".png")
    write_whole(path, png_bytes(pixels), "the picture")


class Sheet:
    """A white picture to draw on. Lengths can grow with it, so that words stay readable when it is shown small."""

    def __init__(self, width: int, height: int, growth: float = 1.0) -> None:
        """Begin with an empty sheet of so many pixels."""
        self.growth = growth
        self.begin(width, height)

    def begin(self, width: int, height: int) -> None:
        """Begin anew with an empty sheet of so many pixels."""
        self.pixels = np.full((height, width, 3), PAPER, np.uint8)
        """uint8 [H, W, 3], RGB."""

    def copy(self) -> "Sheet":
        """Return another sheet with the same on it."""
        other = Sheet(0, 0, self.growth)
        other.pixels = self.pixels.copy()
        return other

    @property
    def width(self) -> int:
        """Pixels from left to right."""
        return self.pixels.shape[1]

    @property
    def height(self) -> int:
        """Pixels from top to bottom."""
        return self.pixels.shape[0]

    def px(self, length: float) -> int:
        """Return a length as it is on this sheet, pixels."""
        return round(length * self.growth)

    def text(
        self,
        text: str,
        at: tuple[float, float],
        size: int,
        color: Color = INK,
        *,
        bold: bool = False,
        anchor: Anchor = "left",
        room: float | None = None,
    ) -> int:
        """Write a line, shortened to ``room`` pixels; ``size`` grows with the sheet. Returns its width, pixels."""
        size = self.px(size)
        text = text if room is None else fitting(text, size, room, bold=bold)
        write(self.pixels, text, at, size, color, bold=bold, anchor=anchor)
        return width_of(text, size, bold=bold)

    def fill(self, box: Box, color: ArrayLike) -> None:
        """Fill a rectangle."""
        left, top, right, bottom = (max(0, round(value)) for value in box)
        self.pixels[top:bottom, left:right] = color

    def paste(self, image: NDArray, at: tuple[int, int], *, framed: bool = False) -> None:
        """Lay a picture, uint8 [h, w, 3], on the sheet with its top left corner at ``at``; the rest is cut."""
        (x, y), (height, width) = at, image.shape[:2]
        if framed:
            self.fill((x - 1, y - 1, x + width + 1, y + height + 1), RULE)
        room = self.pixels[y : y + height, x : x + width]
        room[:] = image[: room.shape[0], : room.shape[1]]

    def panel_head(self, *, subtitle: bool) -> int:
        """Return how far below a panel's top its picture begins, pixels."""
        return self.px(TITLE + 16 + (SUBTITLE if subtitle else 0))

    def panel(self, image: NDArray, at: tuple[int, int], title: str, subtitle: str = "") -> None:
        """Draw a title, a subtitle if there is one, and below them a framed picture; ``at``: top left corner."""
        x, y = at
        room = image.shape[1]
        if subtitle:
            room = max(room, self.text(subtitle, (x, y + self.px(TITLE + 7 + SUBTITLE / 2)), SUBTITLE, PALE_INK))
        self.text(title, (x, y + self.px(TITLE / 2)), TITLE, room=room)
        self.paste(image, (x, y + self.panel_head(subtitle=bool(subtitle))), framed=True)

    def swatch(self, sample: ArrayLike, words: str, at: tuple[float, float], size: int = 14, color: Color = INK) -> int:
        """Explain a colour, or a pattern.

        Args:
            sample: the colour, uint8 [3], or the pattern, uint8 [n, n, 3].
            words: what it means.
            at: (x, y) of the left end; y is the middle.
            size: width and height of the sample; grows with the sheet.
            color: of the words.

        Returns:
            the width of sample and words, pixels.
        """
        (x, y), side = (round(at[0]), round(at[1])), self.px(size)
        pixels = np.asarray(sample, np.uint8)
        pixels = pixels.reshape(1, 1, 3) if pixels.ndim == 1 else pixels
        self.paste(cv2.resize(pixels, (side, side), interpolation=cv2.INTER_NEAREST), (x, y - side // 2), framed=True)
        gap = self.px(8)
        return side + gap + self.text(words, (x + side + gap, y), WORDS, color)

    def scale_bar(self, at: tuple[int, int], pixels_per_m: float) -> int:
        """Draw a bar of a round length and an arrow to the north, for a map that is north up.

        Args:
            at: (x, y) of the bar's left end; y is its middle.
            pixels_per_m: scale of the map.

        Returns:
            x where the drawing ends.
        """
        px, (x, y) = self.px, at
        length_m = next((m for m in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0) if m * pixels_per_m >= px(SHORTEST_BAR)), 50.0)
        end = x + round(length_m * pixels_per_m)
        self.fill((x, y - px(2), end, y + px(2)), INK)
        for tick in (x, end):
            self.fill((tick - px(1), y - px(7), tick + px(1), y + px(7)), INK)
        north = end + px(30) + self.text(f"{length_m:g} m", (end + px(8), y), 16)
        tip, foot = (north, y - px(11)), (north, y + px(11))
        cv2.arrowedLine(self.pixels, foot, tip, INK, max(1, px(2)), cv2.LINE_AA, 0, 0.45)
        return north + px(8) + self.text("N", (north + px(8), y), 16, bold=True)

    def badge(self, text: str, at: tuple[int, int], size: int, ink: Color, paper: Color) -> int:
        """Write a word in bold on a plate whose right edge is at x and whose middle is at y; returns its width."""
        pad, half = round(0.45 * self.px(size)), round(0.85 * self.px(size))
        wide = width_of(text, self.px(size), bold=True) + 2 * pad
        (right, y) = at
        self.fill((right - wide, y - half, right, y + half), paper)
        self.text(text, (right - wide + pad, y), size, ink, bold=True)
        return wide


@cache
def _font() -> Any:
    """Return OpenCV's own font; None before OpenCV 5."""
    return cv2.FontFace("sans") if hasattr(cv2, "FontFace") else None


@cache
def _plain_font(size: int) -> Any:
    return ImageFont.load_default(size)


def _plain(text: str) -> str:
    """Replace what Pillow's own font lacks."""
    for fancy, simple in (("–", "-"), ("…", "..."), ("→", "->"), ("·", "-"), ("“", '"'), ("”", '"')):
        text = text.replace(fancy, simple)
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
