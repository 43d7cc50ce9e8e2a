"""Tables, desks, counters and shelves. Origin on the floor under the middle; the front is +x, the length along y."""

import numpy as np

from simaps_viz.scenes.materials import BLACK_METAL, BRASS, CHARCOAL, STEEL, WHITE, Material, paint
from simaps_viz.scenes.shapes import Model, box, cushion, leg, tube, turned


def round_table(radius: float, top: Material, *, height: float = 0.74) -> Model:
    """Make a round café table on a pedestal with a heavy foot."""
    r, h = radius, height
    slab = [(0, h - 0.03), (r - 0.012, h - 0.03), (r, h - 0.02), (r, h - 0.008), (r - 0.01, h), (0, h)]
    foot = [(0, 0), (0.24, 0), (0.24, 0.012), (0.06, 0.035), (0.035, 0.08), (0.035, h - 0.05), (0.12, h - 0.03)]
    return [turned(slab, top, sections=48), turned(foot, BLACK_METAL)]


def long_table(width: float, length: float, top: Material, *, height: float = 0.74) -> Model:
    """Make a rectangular table with four tapered legs and an apron; ``width`` along x, ``length`` along y."""
    parts = [cushion((width, length, 0.035), (0, 0, height - 0.0175), top, radius=0.012)]
    x, y = width / 2 - 0.07, length / 2 - 0.07
    for s in (-1, 1):
        parts.append(box((0.02, 2 * y, 0.07), (s * x, 0, height - 0.07), top))
        parts.append(box((2 * x, 0.02, 0.07), (0, s * y, height - 0.07), top))
        for t in (-1, 1):
            parts.append(leg((s * x, t * y, 0), (s * x, t * y, height - 0.03), top, radius=0.035, taper=0.6))
    return parts


def coffee_table(width: float, length: float, top: Material) -> Model:
    """Make a low table with a shelf under its top, 0.40 m high."""
    parts = [
        cushion((width, length, 0.035), (0, 0, 0.3825), top, radius=0.014),
        box((width - 0.14, length - 0.14, 0.018), (0, 0, 0.16), top),
    ]
    for s in (-1, 1):
        for t in (-1, 1):
            corner = (s * (width / 2 - 0.06), t * (length / 2 - 0.06))
            parts.append(leg((*corner, 0), (*corner, 0.37), BLACK_METAL, radius=0.016, taper=0.9))
    return parts


def side_table(radius: float, top: Material) -> Model:
    """Make a small round table on three legs, 0.5 m high."""
    angles = np.arange(3) * 2 * np.pi / 3
    legs = [
        leg(
            (radius * np.cos(a), radius * np.sin(a), 0), (0.5 * radius * np.cos(a), 0.5 * radius * np.sin(a), 0.48), top
        )
        for a in angles
    ]
    return [turned([(0, 0.475), (radius, 0.475), (radius, 0.5), (0, 0.5)], top, sections=36), *legs]


def desk(top: Material, *, length: float = 1.4, depth: float = 0.7) -> Model:
    """Make a desk: top at 0.74 m, metal frames, a drawer block at +y; a person sits on its +x side."""
    parts = [cushion((depth, length, 0.03), (0, 0, 0.725), top, radius=0.01)]
    for side in (-1, 1):
        y = side * (length / 2 - 0.06)
        for x in (-1, 1):
            parts.append(box((0.04, 0.04, 0.71), (x * (depth / 2 - 0.06), y, 0.355), BLACK_METAL))
        parts.append(box((depth - 0.16, 0.04, 0.04), (0, y, 0.69), BLACK_METAL))
        parts.append(box((depth - 0.16, 0.04, 0.04), (0, y, 0.06), BLACK_METAL))
    parts.append(box((0.015, length - 0.16, 0.32), (-depth / 2 + 0.06, 0, 0.53), CHARCOAL))
    y = length / 2 - 0.31
    parts.append(box((0.52, 0.38, 0.56), (-0.02, y, 0.34), WHITE))
    for z in (0.15, 0.335, 0.52):
        parts.append(box((0.018, 0.365, 0.172), (0.246, y, z), WHITE))
        parts.append(box((0.016, 0.12, 0.012), (0.262, y, z + 0.06), STEEL))
    return parts


def cabinet(
    size: tuple[float, float, float], body: Material, *, doors: int, top: Material, handle: Material = BRASS
) -> Model:
    """Make a low cabinet of full size (x, y, z) with door fronts on its +x side, a plinth and a worktop."""
    depth, length, height = size
    parts = [
        box((depth - 0.05, length - 0.02, 0.08), (-0.02, 0, 0.04), CHARCOAL),
        box((depth - 0.03, length, height - 0.12), (-0.012, 0, 0.08 + (height - 0.12) / 2), body),
        cushion((depth, length + 0.02, 0.04), (0, 0, height - 0.02), top, radius=0.008),
    ]
    pitch = length / doors
    for i in range(doors):
        y = -length / 2 + (i + 0.5) * pitch
        front = depth / 2 - 0.027 + 0.009
        parts.append(box((0.018, pitch - 0.014, height - 0.15), (front, y, 0.08 + (height - 0.12) / 2), body))
        side = 1 if i % 2 else -1
        handle_y = y - side * (pitch / 2 - 0.05)
        parts.append(box((0.018, 0.012, 0.14), (front + 0.016, handle_y, height - 0.22), handle))
    return parts


def bar_counter(length: float, front: Material, top: Material) -> Model:
    """Make a bar, 1.06 m high, with upright boards on its +x side (where the guests sit) and a foot rail."""
    parts = [
        box((0.5, length, 0.92), (-0.03, 0, 0.55), front),
        box((0.44, length - 0.04, 0.09), (-0.03, 0, 0.045), CHARCOAL),
        cushion((0.66, length + 0.06, 0.05), (0.02, 0, 1.035), top, radius=0.014),
        tube([(0.33, -length / 2 + 0.1, 0.2), (0.33, length / 2 - 0.1, 0.2)], 0.018, BRASS),
    ]
    boards = round(length / 0.12)
    for i in range(boards):
        y = -length / 2 + (i + 0.5) * length / boards
        parts.append(box((0.018, length / boards - 0.012, 0.88), (0.229, y, 0.55), front))
    for y in np.linspace(-length / 2 + 0.25, length / 2 - 0.25, 4):
        parts.append(tube([(0.2, y, 0.2), (0.34, y, 0.2)], 0.01, BRASS))
    return parts


def bookshelf(length: float, height: float, wood: Material, *, boards: int) -> Model:
    """Make an open shelf 0.32 m deep; board tops lie at ``shelf_heights``."""
    back = paint("cbbb9f")
    parts = [box((0.012, length, height - 0.02), (-0.154, 0, height / 2), back)]
    for side in (-1, 1):
        parts.append(box((0.32, 0.026, height), (0, side * (length / 2 - 0.013), height / 2), wood))
    for z in shelf_heights(height, boards):
        parts.append(box((0.31, length - 0.05, 0.024), (0, 0, z - 0.012), wood))
    parts.append(box((0.32, length, 0.026), (0, 0, height - 0.013), wood))
    return parts


def shelf_heights(height: float, boards: int) -> list[float]:
    """Return the height of the top of each board of a bookshelf, the lowest first."""
    return [0.08 + i * (height - 0.08) / boards for i in range(boards)]


def wall_shelf(length: float, wood: Material) -> Model:
    """Make one wall board on brackets, its top at z = 0, its back at x = -0.12."""
    parts = [box((0.24, length, 0.03), (0, 0, -0.015), wood)]
    for y in (-length / 2 + 0.15, length / 2 - 0.15):
        parts.append(box((0.2, 0.02, 0.02), (-0.01, y, -0.04), BLACK_METAL))
        parts.append(box((0.015, 0.02, 0.16), (-0.112, y, -0.1), BLACK_METAL))
    return parts
