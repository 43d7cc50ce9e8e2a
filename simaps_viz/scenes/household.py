"""Beds, baths, cookers, storage; models in other sizes. Origin on the floor under the middle; the front is +x."""

import numpy as np

from simaps_viz.scenes.materials import BLACK_METAL, CERAMIC, CHARCOAL, LAMP_GLOW, STEEL, WHITE, Material, paint
from simaps_viz.scenes.shapes import Model, Part, box, cushion, disc, ellipsoid, leg, moved, tube, turned

_CARDBOARD = paint("b08d62")
_TAPE = paint("d8c7a3")


def resized(model: Model, x: float, y: float, z: float) -> Model:
    """Scale a model along its axes."""
    return [Part(part.mesh.copy().apply_scale((x, y, z)), part.material) for part in model]


def bed(width: float, length: float, frame: Material, blanket: Material, *, height: float = 0.32) -> Model:
    """Make a bed on legs, its headboard towards -x; boxes of ``height`` less 6 cm go under it."""
    parts = [
        box((length, width, 0.06), (0, 0, height - 0.03), frame),
        cushion((length - 0.08, width - 0.04, 0.2), (0.01, 0, height + 0.1), WHITE, radius=0.06),
        cushion((length * 0.68, width + 0.02, 0.12), (length * 0.15, 0, height + 0.17), blanket, radius=0.05),
        cushion((0.05, width, 0.55), (-length / 2 - 0.01, 0, height + 0.26), frame, radius=0.02),
    ]
    for x in (-length / 2 + 0.06, length / 2 - 0.06):
        parts += [box((0.06, 0.06, height), (x, side * (width / 2 - 0.05), height / 2), frame) for side in (-1, 1)]
    pillows = max(1, round(width / 0.85))
    for i in range(pillows):
        y = (i - (pillows - 1) / 2) * width / pillows
        parts.append(
            cushion((0.4, min(0.7, width / pillows - 0.1), 0.13), (-length / 2 + 0.3, y, height + 0.25), CERAMIC)
        )
    return parts


def bathtub(length: float, width: float) -> Model:
    """Make a bathtub along y with a tap at its +y end; its inside is open."""
    shell, depth = paint("f3f2ee"), 0.55
    x, y = width / 2, length / 2
    parts = [box((width, length, 0.14), (0, 0, 0.07), shell)]
    for side in (-1, 1):
        parts.append(cushion((0.08, length, depth), (side * (x - 0.04), 0, depth / 2), shell, radius=0.025))
        parts.append(cushion((width, 0.1, depth), (0, side * (y - 0.05), depth / 2), shell, radius=0.025))
    parts.append(tube([(0, y - 0.05, depth), (0, y - 0.05, depth + 0.14), (0, y - 0.16, depth + 0.12)], 0.014, STEEL))
    return parts


def toilet() -> Model:
    """Make a toilet with a cistern at its back, 0.68 m deep."""
    return [
        cushion((0.34, 0.26, 0.38), (0.05, 0, 0.19), WHITE, radius=0.09),
        *resized([turned([(0, 0.36), (0.2, 0.36), (0.22, 0.4), (0.2, 0.43), (0, 0.43)], WHITE)], 1.2, 0.9, 1.0),
        cushion((0.17, 0.4, 0.42), (-0.27, 0, 0.6), WHITE, radius=0.03),
        box((0.13, 0.2, 0.4), (-0.24, 0, 0.2), WHITE),
        disc(0.022, 0.8, 0.818, STEEL, sections=16),
    ]


def cooker(body: Material) -> Model:
    """Make an oven with four hot plates on top, 0.60 x 0.60 x 0.90 m."""
    parts = [
        box((0.56, 0.6, 0.86), (-0.02, 0, 0.43), body),
        box((0.6, 0.6, 0.04), (0, 0, 0.88), CHARCOAL),
        box((0.02, 0.5, 0.42), (0.27, 0, 0.4), paint("16181b")),
        tube([(0.3, -0.22, 0.66), (0.3, 0.22, 0.66)], 0.011, STEEL),
    ]
    for x in (-0.14, 0.14):
        parts += [moved([disc(0.09, 0.9, 0.908, BLACK_METAL, sections=24)], x, y)[0] for y in (-0.14, 0.14)]
    parts += [
        ellipsoid((0.02, 0.018, 0.018), (0.28, y, 0.78), STEEL, subdivisions=1) for y in np.linspace(-0.2, 0.2, 5)
    ]
    return parts


def washing_machine() -> Model:
    """Make a washing machine, 0.58 x 0.60 x 0.85 m."""
    door = turned([(0, 0), (0.12, 0), (0.17, 0.02), (0.19, 0.05), (0.15, 0.05), (0.13, 0.03), (0, 0.03)], STEEL)
    door.mesh.vertices = door.mesh.vertices[:, [2, 0, 1]] + np.array([0.27, 0.0, 0.42])
    parts = [cushion((0.56, 0.6, 0.85), (0, 0, 0.425), WHITE, radius=0.015), door]
    parts.append(box((0.01, 0.56, 0.1), (0.28, 0, 0.77), paint("c3c8cb")))
    return parts


def table_lamp(shade: Material, *, height: float = 0.42) -> Model:
    """Make a lamp for a bedside or desk."""
    h = height
    profile = [(0.13, 0.55 * h), (0.08, h), (0.075, h), (0.125, 0.55 * h)]
    return [
        disc(0.07, 0, 0.02, BLACK_METAL),
        tube([(0, 0, 0.01), (0, 0, 0.8 * h)], 0.01, STEEL),
        turned(profile, shade),
        ellipsoid((0.035, 0.035, 0.04), (0, 0, 0.7 * h), LAMP_GLOW, subdivisions=1),
    ]


def carton(x: float, y: float, z: float, cardboard: Material = _CARDBOARD) -> Model:
    """Make a closed cardboard box of that size with a strip of tape."""
    return [
        box((x, y, z), (0, 0, z / 2), cardboard),
        box((x + 0.002, 0.05, 0.002), (0, 0, z), _TAPE),
        box((x - 0.01, 0.003, 0.002), (0, 0.05, z + 0.001), CHARCOAL),
    ]


def stool(seat: float, height: float, wood: Material, *, square: bool = False) -> Model:
    """Make a stool of that seat width on four legs."""
    r = seat / 2
    parts = [
        leg((s * 0.85 * r, t * 0.85 * r, 0), (s * 0.62 * r, t * 0.62 * r, height - 0.02), wood, radius=0.018)
        for s in (-1, 1)
        for t in (-1, 1)
    ]
    top = cushion((seat, seat, 0.04), (0, 0, height - 0.02), wood, radius=0.015) if square else disc(
        r, height - 0.04, height, wood
    )  # fmt: skip
    return [*parts, top]


def ladder_chair(wood: Material, seat: Material, *, width: float = 0.44, back: float = 0.98) -> Model:
    """Make a straight chair with a high back of slats."""
    w = width / 2 - 0.025
    parts = [box((0.04, 0.04, 0.44), (0.18, side * w, 0.22), wood) for side in (-1, 1)]
    parts += [box((0.04, 0.04, back), (-0.19, side * w, back / 2), wood, tilt_rad=-0.04) for side in (-1, 1)]
    parts.append(cushion((0.42, width, 0.05), (0, 0, 0.45), seat, radius=0.02))
    parts += [box((0.02, 2 * w, 0.05), (-0.19, 0, z), wood) for z in np.linspace(0.6, back - 0.04, 4)]
    return parts


def low_back_chair(metal: Material, shell: Material, *, width: float = 0.5) -> Model:
    """Make a stacking chair of bent metal tube with a flat seat and a low back."""
    w = width / 2 - 0.03
    parts: Model = []
    for side in (-1, 1):
        bend = [(0.2, 0.0), (0.17, 0.44), (-0.17, 0.44), (-0.22, 0.0)]
        parts.append(tube([(x, side * w, z) for x, z in bend], 0.013, metal, sides=8))
        parts.append(tube([(-0.17, side * w, 0.44), (-0.23, side * w, 0.74)], 0.013, metal, sides=8))
    parts.append(cushion((0.42, width - 0.04, 0.035), (0.0, 0, 0.455), shell, radius=0.016))
    parts.append(cushion((0.035, width - 0.04, 0.2), (-0.22, 0, 0.68), shell, radius=0.016, tilt_rad=-0.15))
    return parts


def rack(length: float, height: float, depth: float, metal: Material, *, boards: int) -> Model:
    """Make an open metal rack without a back; board tops lie at ``tables.shelf_heights``."""
    parts: Model = []
    for x in (-depth / 2 + 0.02, depth / 2 - 0.02):
        parts += [box((0.035, 0.035, height), (x, s * (length / 2 - 0.018), height / 2), metal) for s in (-1, 1)]
    for i in range(boards):
        z = 0.08 + i * (height - 0.08) / boards
        parts.append(box((depth, length - 0.01, 0.025), (0, 0, z - 0.0125), metal))
    parts.append(box((depth, length, 0.025), (0, 0, height - 0.0125), metal))
    return parts


def tray(color: Material) -> Model:
    """Make a tray with a plate and a glass on it, 0.32 x 0.44 m."""
    return [
        cushion((0.32, 0.44, 0.016), (0, 0, 0.008), color, radius=0.007),
        *moved(
            [turned([(0, 0), (0.07, 0), (0.12, 0.02), (0.115, 0.022), (0.07, 0.006), (0, 0.006)], CERAMIC)],
            0,
            -0.06,
            0.016,
        ),
        *moved([disc(0.032, 0, 0.11, paint("cfdcdd"), sections=16)], 0.09, 0.14, 0.016),
    ]


def basket(color: Material) -> Model:
    """Make a laundry basket, 0.5 m high, open at the top."""
    return [turned([(0, 0), (0.17, 0), (0.22, 0.5), (0.21, 0.5), (0.16, 0.02), (0, 0.02)], color)]


def whiteboard(width: float, height: float) -> Model:
    """Make a board for a wall, facing +x, its middle at z = 0."""
    return [
        box((0.02, width, height), (0.01, 0, 0), STEEL),
        box((0.004, width - 0.05, height - 0.05), (0.022, 0, 0), paint("f4f5f3")),
        box((0.05, width * 0.5, 0.012), (0.03, 0, -height / 2), STEEL),
    ]
