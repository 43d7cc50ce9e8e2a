"""Twelve colours that can be distinguished with any kind of colour vision."""

from numpy.typing import NDArray

Color = tuple[int, int, int]
"""RGB, 0-255."""

PALETTE: tuple[Color, ...] = (
    (230, 159, 0), (0, 114, 178), (240, 228, 66), (119, 51, 119), (0, 158, 115), (255, 102, 136), (51, 238, 255),
    (153, 51, 68), (136, 119, 255), (187, 238, 170), (86, 180, 233), (170, 0, 0),
)  # fmt: skip
"""Five are Okabe and Ito's; the others were searched for so that no two are closer than MIN_APART.
Neighbours in this list differ most."""

MIN_APART = 11.0
"""CIEDE2000 between any two colours of PALETTE, seen with normal vision and without the red, green or blue cones
(Machado, Oliveira and Fernandes 2009)."""
ALIKE_BELOW = 18.0
"""CIEDE2000 below which colours of objects that touch are easily confused."""
ALIKE = (
    (0, 2), (0, 4), (0, 5), (1, 3), (1, 4), (1, 8), (2, 9), (3, 7), (4, 5), (4, 7), (4, 10), (5, 9), (6, 9), (6, 10),
    (7, 11), (8, 10), (9, 10),
)  # fmt: skip
"""Places of the colours of PALETTE that are closer than that for some kind of vision."""


def color_of_number(number: int) -> Color:
    """Return the colour of a number from 1 on: the palette, over and over."""
    return PALETTE[(number - 1) % len(PALETTE)]


def as_color(row: NDArray) -> Color:
    """Return the colour that an array holds, uint8 [3]."""
    r, g, b = row.tolist()
    return (r, g, b)
