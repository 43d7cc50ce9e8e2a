"""From the cells of a class to its objects the way VLMaps does it: clean the mask, take the outer contours."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError

_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=np.uint8)


@dataclass(frozen=True)
class ContourSettings:
    """How a mask is cleaned before its contours are taken; lengths in cells.

    The defaults are the best of what was tried on the rendered house (exact masks) and the embedded café (light
    errors) with the simulated encoder: closing 0, 1, 3; sigma 0, 0.8, 1.2; dilation 0, 1; smallest box 4, 10, 50; with
    and without filling; uniform and distance weights; strides 2 and 4. They were chosen on the very scenes they are
    shown on, which favours the baseline. `PUBLISHED` holds VLMaps' own settings, made for finding an object of a class
    rather than for telling its objects apart: panoptic quality of chairs, tables and desks, house / café, is .61 / .29
    with those and .61 / .52 with these. The best on one scene alone were .71 and .53; a smallest box of 50 cells wins
    a little more by dropping whatever is as small as a stool.
    """

    closing: int = 0
    """Dilations by a cross, then as many erosions: holes and gaps up to twice this close."""
    sigma: float = 0.8
    """Standard deviation of the Gaussian blur; the mask is then where it is above one half. 0 = none."""
    dilation: int = 0
    """Final dilations by a cross."""
    min_box_cells: int = 10
    """Contours whose bounding box (height x width, each one less than its cells) is not larger are dropped."""
    fill: bool = True
    """Seen cells inside a contour that are of no thing class themselves become part of the object."""

    def __post_init__(self) -> None:
        if min(self.closing, self.dilation, self.min_box_cells) < 0 or self.sigma < 0.0:
            raise InputError(
                "contours: expected closing, dilation, sigma and smallest box of at least 0, found "
                f"{self.closing}, {self.dilation}, {self.sigma:g} and {self.min_box_cells}"
            )


PUBLISHED = ContourSettings(closing=3, sigma=0.8, dilation=1, min_box_cells=10, fill=False)
"""What VLMaps' published programs use at 5 cm a cell when they look for the nearest object of a class."""


def contour_objects(mask: NDArray, settings: ContourSettings) -> NDArray:
    """Tell the objects of a class apart.

    Args:
        mask: bool [rows, cols], the cells of the class.
        settings: how the mask is cleaned.

    Returns:
        int32 [rows, cols]: number of the contour a cell lies in or on, from 1, by its first cell; 0 = none. Cells of
        the mask that cleaning took away, or whose contour was dropped, lie in none.
    """
    margin = settings.closing + settings.dilation + int(np.ceil(3.0 * settings.sigma)) + 1
    clean = np.pad(mask.astype(np.uint8), margin)
    if settings.closing:
        clean = cv2.morphologyEx(clean, cv2.MORPH_CLOSE, _CROSS, iterations=settings.closing)
    if settings.sigma > 0.0:
        clean = (cv2.GaussianBlur(clean.astype(np.float32), (0, 0), settings.sigma) > 0.5).astype(np.uint8)
    if settings.dilation:
        clean = cv2.dilate(clean, _CROSS, iterations=settings.dilation)
    contours, _ = cv2.findContours(clean, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    drawn = np.zeros(clean.shape, dtype=np.int32)
    for number, contour in enumerate(sorted(contours, key=_first_cell), start=1):
        height, width = np.ptp(contour[:, 0, 1]), np.ptp(contour[:, 0, 0])
        if height * width > settings.min_box_cells:
            cv2.drawContours(drawn, [contour], 0, number, thickness=cv2.FILLED)
    inner = drawn[margin : margin + mask.shape[0], margin : margin + mask.shape[1]]
    numbers = np.unique(inner[inner > 0])
    return np.searchsorted(numbers, inner).astype(np.int32) + (inner > 0).astype(np.int32)


def _first_cell(contour: NDArray) -> tuple[int, int]:
    col, row = min(contour[:, 0].tolist(), key=lambda point: (point[1], point[0]))
    return row, col
