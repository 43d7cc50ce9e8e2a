"""A small picture of what a build has seen so far, made in a few milliseconds: its classes, and where the camera is."""

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import class_color
from simaps_viz.drawing.theme import LIGHT, Theme
from simaps_viz.geometry import STANDS_FROM_M
from simaps_viz.structures import Grid

MOST_PIXELS = 200
"""Along the longer side; larger maps show every so many-th cell."""
CAMERA = (220, 60, 40)


def sketch_png(grid: Grid, camera_m: NDArray, theme: Theme = LIGHT) -> bytes:
    """Paint the cells by their classes, what is unseen left transparent.

    Args:
        grid: what was seen so far.
        camera_m: [2 or more], x and y of the camera, map frame, metres.
        theme: whose colours the floor and what nobody could name have.

    Returns:
        PNG, RGBA, north up, one pixel for each cell that is shown.
    """
    step = max(1, -(-max(grid.spec.shape) // MOST_PIXELS))
    label, height = grid.label[::step, ::step], grid.height_m[::step, ::step]
    palette = np.array([(*class_color(name), 255) for name in grid.labels], np.uint8)
    for name, color in {"floor": theme.floor, "wall": theme.wall}.items():
        if name in grid.labels:
            palette[grid.labels.index(name), :3] = color
    pixels = palette[label]
    pixels[label == 0] = (*theme.floor, 255)
    pixels[(label == 0) & (height >= STANDS_FROM_M)] = (*theme.clutter, 255)
    pixels[np.isnan(height)] = 0
    spec = grid.spec
    at = (np.asarray(camera_m[:2]) - (spec.x0_m, spec.y0_m)) / (spec.cell_size_m * step)
    pixels = np.ascontiguousarray(pixels)
    cv2.circle(pixels, (int(at[0]), int(at[1])), max(2, max(label.shape) // 50), (*CAMERA, 255), -1)
    return cv2.imencode(".png", cv2.cvtColor(pixels[::-1], cv2.COLOR_RGBA2BGRA))[1].tobytes()
