"""Furniture and things. Every model faces +x and stands on z = 0, its origin under its middle; metres.

A place names these functions in its JSON file; see `places.py`.
"""

import numpy as np

from simaps_viz.scenes.materials import (
    BLACK_METAL,
    BRASS,
    CERAMIC,
    CHARCOAL,
    DARK_LEAF,
    LAMP_GLOW,
    LEAF,
    OAK,
    SCREEN,
    SOIL,
    STEEL,
    WALNUT,
    WHITE,
    Material,
    Texture,
    paint,
)
from simaps_viz.scenes.shapes import (
    Model,
    Part,
    box,
    curved_panel,
    cushion,
    disc,
    ellipsoid,
    leaf,
    leg,
    moved,
    tube,
    turned,
)

_PANEL = paint("17191c")
_CARDBOARD = paint("b08d62")
_TAPE = paint("d8c7a3")


# Things to sit on: origin under the middle of the seat.


def cafe_chair(wood: Material, seat: Material) -> Model:
    """Make a wooden chair, 0.42 m square, with a bent back rail and a slat."""
    w, d = 0.20, 0.19
    parts = [leg((s * 0.195, t * 0.195, 0), (s * d * 0.86, t * w * 0.86, 0.44), wood) for s in (-1, 1) for t in (-1, 1)]
    parts.append(cushion((0.41, 0.42, 0.03), (0.0, 0, 0.435), wood, radius=0.014))
    parts.append(cushion((0.36, 0.37, 0.03), (0.005, 0, 0.457), seat, radius=0.014))
    for side in (-1, 1):
        parts.append(tube([(-0.165, side * 0.18, 0.44), (-0.2, side * 0.19, 0.82)], [0.015, 0.012], wood))
        parts.append(tube([(-0.16, side * 0.175, 0.2), (0.16, side * 0.175, 0.2)], 0.009, wood))
    parts.append(curved_panel((0.018, 0.40, 0.13), (-0.218, 0, 0.765), wood, sag=0.035, tilt_rad=-0.1))
    parts.append(curved_panel((0.014, 0.37, 0.045), (-0.195, 0, 0.61), wood, sag=0.03, tilt_rad=-0.1))
    return parts


def shell_chair(shell: Material, legs: Material = BLACK_METAL) -> Model:
    """Make a chair with a moulded shell on four slanted metal legs, 0.44 m wide."""
    feet = [(s * 0.2, t * 0.2, 0) for s in (-1, 1) for t in (-1, 1)]
    parts = [leg(foot, (foot[0] * 0.55, foot[1] * 0.6, 0.43), legs, radius=0.012) for foot in feet]
    parts.append(cushion((0.41, 0.43, 0.045), (0.005, 0, 0.45), shell, radius=0.022))
    parts.append(curved_panel((0.028, 0.43, 0.20), (-0.2, 0, 0.55), shell, sag=0.075, tilt_rad=-0.16))
    parts.append(curved_panel((0.024, 0.41, 0.17), (-0.222, 0, 0.715), shell, sag=0.06, tilt_rad=-0.12))
    return parts


def bar_stool(wood: Material) -> Model:
    """Make a round bar stool, seat 0.36 m wide at 0.74 m, with a foot ring and a low back."""
    corners = [(0.17 * np.cos(a), 0.17 * np.sin(a)) for a in np.pi / 4 + np.arange(4) * np.pi / 2]
    parts = [leg((x, y, 0), (x * 0.68, y * 0.68, 0.72), BLACK_METAL, radius=0.013) for x, y in corners]
    ring = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    parts.append(
        tube(np.stack([0.15 * np.cos(ring), 0.15 * np.sin(ring), 0 * ring + 0.28], -1), 0.009, STEEL, closed=True)
    )
    parts.append(turned([(0, 0.715), (0.165, 0.715), (0.18, 0.73), (0.18, 0.745), (0.16, 0.757), (0, 0.75)], wood))
    for side in (-1, 1):
        parts.append(tube([(-0.15, side * 0.1, 0.73), (-0.165, side * 0.11, 0.9)], 0.009, BLACK_METAL))
    parts.append(curved_panel((0.018, 0.28, 0.08), (-0.178, 0, 0.9), wood, sag=0.05))
    return parts


def office_chair(fabric: Material) -> Model:
    """Make a swivel chair on a five-star base with castors, about 0.6 m across."""
    parts: Model = []
    for angle in np.arange(5) * 2 * np.pi / 5 + 0.3:
        tip = np.array([0.28 * np.cos(angle), 0.28 * np.sin(angle), 0.075])
        parts.append(tube(np.array([[0, 0, 0.11], tip]), [0.026, 0.016], BLACK_METAL))
        parts.append(box((0.05, 0.03, 0.055), (tip[0], tip[1], 0.0275), CHARCOAL))
    parts.append(tube([(0, 0, 0.09), (0, 0, 0.43)], [0.032, 0.022], STEEL))
    parts.append(cushion((0.47, 0.48, 0.08), (0, 0, 0.47), fabric, radius=0.035))
    parts.append(tube([(-0.15, 0, 0.42), (-0.28, 0, 0.5), (-0.28, 0, 0.7)], 0.018, BLACK_METAL))
    parts.append(curved_panel((0.055, 0.44, 0.5), (-0.26, 0, 0.83), fabric, sag=0.05, tilt_rad=-0.1))
    for side in (-1, 1):
        parts.append(tube([(-0.05, side * 0.23, 0.45), (-0.02, side * 0.28, 0.66)], 0.014, BLACK_METAL))
        parts.append(cushion((0.26, 0.06, 0.028), (0.0, side * 0.28, 0.67), CHARCOAL, radius=0.012))
    return parts


def couch(seats: int, fabric: Material, pillow: Material, *, legs: Material = WALNUT) -> Model:
    """Make a couch of that many seats (0.66 m each, arms 0.16 m), 0.88 m deep; its back is towards -x."""
    width = seats * 0.66
    parts = [cushion((0.84, width + 0.30, 0.24), (0.0, 0, 0.24), fabric, radius=0.03)]
    for side in (-1, 1):
        parts.append(cushion((0.86, 0.17, 0.52), (0.01, side * (width / 2 + 0.08), 0.38), fabric, radius=0.06))
        for x in (-0.36, 0.36):
            parts.append(leg((x, side * (width / 2), 0), (x, side * (width / 2), 0.13), legs, radius=0.024))
    parts.append(cushion((0.18, width + 0.30, 0.68), (-0.35, 0, 0.46), fabric, radius=0.06))
    for i in range(seats):
        y = (i - (seats - 1) / 2) * 0.66
        parts.append(cushion((0.64, 0.645, 0.16), (0.10, y, 0.42), fabric, radius=0.05))
        parts.append(cushion((0.17, 0.62, 0.42), (-0.19, y, 0.66), fabric, radius=0.07, tilt_rad=-0.18))
    spots = (-1, 1) if seats > 1 else (1,)
    for side in spots:
        throw = cushion((0.12, 0.38, 0.36), (0, 0, 0), pillow, radius=0.055, tilt_rad=-0.4)
        parts += moved([throw], -0.03, side * (width / 2 - 0.24), 0.65, yaw_rad=-side * 0.25)
    return parts


def armchair(fabric: Material, legs: Material = OAK) -> Model:
    """Make a lounge chair with round arms on wooden legs, 0.74 m wide."""
    parts = [leg((s * 0.27, t * 0.27, 0), (s * 0.23, t * 0.23, 0.24), legs) for s in (-1, 1) for t in (-1, 1)]
    parts.append(cushion((0.62, 0.6, 0.12), (0, 0, 0.28), fabric, radius=0.05))
    parts.append(cushion((0.56, 0.50, 0.14), (0.04, 0, 0.39), fabric, radius=0.06))
    parts.append(curved_panel((0.12, 0.70, 0.52), (-0.31, 0, 0.60), fabric, sag=0.16, tilt_rad=-0.15))
    for side in (-1, 1):
        parts.append(cushion((0.52, 0.11, 0.34), (0.02, side * 0.31, 0.42), fabric, radius=0.05))
    return parts


def bench(length: float, wood: Material, *, back: bool) -> Model:
    """Make a bench with a slatted seat at 0.45 m, 0.4 m deep, along y; ``back`` adds a slatted back towards -x."""
    parts: Model = []
    for side in (-1, 1):
        y = side * (length / 2 - 0.18)
        for x in (-0.16, 0.16):
            parts.append(box((0.045, 0.045, 0.42), (x, y, 0.21), BLACK_METAL))
        parts.append(box((0.36, 0.045, 0.03), (0, y, 0.415), BLACK_METAL))
        if back:
            parts.append(box((0.035, 0.045, 0.46), (-0.185, y, 0.64), BLACK_METAL, tilt_rad=-0.1))
    for x in np.linspace(-0.16, 0.16, 4):
        parts.append(cushion((0.092, length, 0.032), (x, 0, 0.446), wood, radius=0.01))
    if back:
        for z in (0.64, 0.79):
            parts.append(
                cushion((0.024, length, 0.10), (-0.165 - 0.1 * (z - 0.5), 0, z), wood, radius=0.01, tilt_rad=-0.1)
            )
    return parts


def stool_pouf(fabric: Material) -> Model:
    """Make a round upholstered footstool, 0.44 m across."""
    profile = [(0, 0.05), (0.2, 0.05), (0.22, 0.09), (0.22, 0.34), (0.2, 0.39), (0.12, 0.405), (0, 0.405)]
    return [turned(profile, fabric), disc(0.17, 0.0, 0.05, BLACK_METAL)]


# Tables, desks, counters and shelves: the length lies along y.


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


# Beds, baths, cookers, storage; models in other sizes.


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


# Kitchen machines, screens and computers.


def refrigerator(body: Material) -> Model:
    """Make a two-door fridge, 0.66 x 0.70 x 1.80 m, with door gaps and bar handles."""
    dark = paint("4a4d50")
    parts = [
        box((0.58, 0.68, 1.72), (-0.035, 0, 0.90), dark),
        box((0.5, 0.62, 0.05), (-0.03, 0, 0.03), CHARCOAL),
        cushion((0.07, 0.70, 0.56), (0.29, 0, 0.36), body, radius=0.02),
        cushion((0.07, 0.70, 1.12), (0.29, 0, 1.225), body, radius=0.02),
        box((0.58, 0.70, 0.02), (-0.035, 0, 1.77), body),
    ]
    for side in (-1, 1):
        parts.append(box((0.58, 0.012, 1.72), (-0.035, side * 0.345, 0.90), body))
    for low, high in ((0.42, 0.6), (0.75, 1.15)):
        parts.append(tube([(0.355, 0.27, low), (0.355, 0.27, high)], 0.012, STEEL))
        for z in (low, high):
            parts.append(tube([(0.32, 0.27, z), (0.357, 0.27, z)], 0.009, STEEL))
    return parts


def microwave() -> Model:
    """Make a microwave, 0.36 x 0.50 x 0.29 m."""
    parts = [
        box((0.34, 0.50, 0.275), (-0.01, 0, 0.15), STEEL),
        box((0.012, 0.36, 0.25), (0.165, -0.06, 0.15), CHARCOAL),
        box((0.006, 0.26, 0.16), (0.173, -0.07, 0.155), _PANEL),
        box((0.012, 0.11, 0.25), (0.165, 0.185, 0.15), _PANEL),
        tube([(0.19, 0.105, 0.06), (0.19, 0.105, 0.24)], 0.009, STEEL),
        box((0.004, 0.08, 0.035), (0.173, 0.185, 0.245), paint("8fe0c0", Texture.GLOW)),
    ]
    for row in range(3):
        for col in range(3):
            parts.append(box((0.005, 0.02, 0.016), (0.173, 0.16 + 0.026 * col, 0.18 - 0.032 * row), STEEL))
    return parts


def toaster(body: Material) -> Model:
    """Make a two-slot toaster, 0.18 x 0.30 x 0.19 m."""
    parts = [
        cushion((0.18, 0.30, 0.17), (0, 0, 0.1), body, radius=0.035),
        box((0.13, 0.24, 0.02), (0, 0, 0.01), CHARCOAL),
    ]
    parts += [box((0.028, 0.22, 0.006), (x, 0, 0.185), _PANEL) for x in (-0.035, 0.035)]
    parts.append(box((0.03, 0.025, 0.012), (0.0, 0.16, 0.12), BLACK_METAL))
    return parts


def coffee_machine(body: Material) -> Model:
    """Make an espresso machine, 0.42 x 0.62 x 0.42 m, with two groups and a cup rail."""
    parts = [
        cushion((0.42, 0.62, 0.09), (0, 0, 0.055), CHARCOAL, radius=0.015),
        cushion((0.22, 0.62, 0.22), (-0.09, 0, 0.20), body, radius=0.02),
        cushion((0.40, 0.62, 0.10), (0, 0, 0.345), body, radius=0.03),
        box((0.2, 0.5, 0.006), (0.09, 0, 0.102), STEEL),
    ]
    for y in (-0.15, 0.15):
        parts += moved([disc(0.034, -0.05, 0.0, STEEL)], 0.11, y, 0.30)
        parts.append(tube([(0.12, y, 0.262), (0.24, y, 0.25)], 0.012, _PANEL))
        parts.append(box((0.004, 0.05, 0.02), (0.2, y, 0.35), paint("ffd089", Texture.GLOW)))
    for side in (-1, 1):
        parts.append(tube([(0.15, side * 0.27, 0.3), (0.17, side * 0.28, 0.14)], 0.007, STEEL))
        parts.append(tube([(side * 0.17, -0.29, 0.425), (side * 0.17, 0.29, 0.425)], 0.006, STEEL))
    return parts


def sink() -> Model:
    """Make a counter-top basin, 0.44 m across, with a tap behind it."""
    bowl = [(0, 0.012), (0.14, 0.02), (0.2, 0.1), (0.205, 0.13), (0.22, 0.13), (0.22, 0.115), (0.15, 0.0), (0, 0.0)]
    spout = [(-0.24, 0, 0.0), (-0.24, 0, 0.24), (-0.21, 0, 0.29), (-0.15, 0, 0.30), (-0.11, 0, 0.27)]
    return [
        turned(bowl, WHITE, sections=40),
        disc(0.025, 0.013, 0.024, CHARCOAL),
        tube(spout, 0.013, STEEL),
        tube([(-0.24, 0.02, 0.14), (-0.24, 0.09, 0.17)], 0.008, STEEL),
    ]


def _picture_on(width: float, height: float, x: float, z: float) -> Model:
    """Make what a screen shows: a dim picture of a few blocks, on the +x side of the plane at ``x``."""
    shown = [
        (0.0, 0.0, 0.96, 0.94, "23405c"),
        (-0.30, 0.28, 0.30, 0.10, "9fc3d8"),
        (-0.20, 0.02, 0.50, 0.05, "6d94ad"),
        (-0.20, -0.10, 0.50, 0.05, "6d94ad"),
        (-0.24, -0.22, 0.42, 0.05, "6d94ad"),
        (0.27, -0.05, 0.26, 0.42, "d9a25f"),
    ]
    return [
        box(
            (0.002, w * width, h * height), (x + 0.001 * (i + 1), y * width, z + v * height), paint(color, Texture.GLOW)
        )
        for i, (y, v, w, h, color) in enumerate(shown)
    ]


def tv(width: float, *, stand: bool) -> Model:
    """Make a television or monitor of that picture width, 16:9; on a foot, or with its lower edge at z = 0.06."""
    height = width * 9 / 16
    lift = 0.09 if stand else 0.06
    z = lift + height / 2
    parts = [
        cushion((0.03, width + 0.025, height + 0.03), (0, 0, z), _PANEL, radius=0.008),
        box((0.035, width * 0.6, height * 0.5), (-0.025, 0, z - 0.03), CHARCOAL),
        box((0.004, width, height), (0.0145, 0, z), SCREEN),
    ]
    parts += _picture_on(width, height, 0.0165, z)
    if stand:
        parts.append(cushion((0.2, width * 0.34, 0.014), (-0.02, 0, 0.007), CHARCOAL, radius=0.006))
        parts.append(box((0.025, 0.06, lift + 0.1), (-0.045, 0, (lift + 0.1) / 2), CHARCOAL))
    return parts


def laptop(body: Material) -> Model:
    """Make an open laptop; its user sits towards +x, so its screen faces +x."""
    parts = [
        cushion((0.23, 0.33, 0.016), (0, 0, 0.010), body, radius=0.006),
        box((0.10, 0.28, 0.003), (-0.035, 0, 0.0185), _PANEL),
        box((0.06, 0.10, 0.002), (0.075, 0, 0.0185), paint("8d9194")),
    ]
    lid = [cushion((0.010, 0.33, 0.215), (0, 0, 0.1075), body, radius=0.004), *_picture_on(0.31, 0.19, 0.005, 0.11)]
    tilt = -0.28
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    for part in lid:
        part.mesh.vertices = part.mesh.vertices @ turn.T + np.array([-0.115, 0, 0.014])
    return parts + lid


def keyboard(body: Material) -> Model:
    """Make a keyboard, 0.14 x 0.44 m; its user sits towards +x."""
    parts = [cushion((0.14, 0.44, 0.018), (0, 0, 0.009), body, radius=0.007)]
    for row in range(5):
        for col in range(14):
            key = paint("dcdcd8" if (row + col) % 9 else "a9b3b8")
            parts.append(box((0.019, 0.024, 0.008), (-0.048 + row * 0.024, -0.195 + col * 0.03, 0.021), key))
    return parts


def computer_mouse() -> Model:
    """Make a computer mouse, 0.10 m long."""
    return [cushion((0.105, 0.062, 0.034), (0, 0, 0.017), WHITE, radius=0.017)]


# Small things: what stands on tables, hangs on walls or is left on the floor.


def cup(glaze: Material) -> Model:
    """Make a coffee cup on a saucer."""
    ear = [(0.036, 0.075), (0.058, 0.068), (0.06, 0.045), (0.034, 0.03)]
    return [
        turned([(0, 0), (0.045, 0.002), (0.078, 0.014), (0.076, 0.018), (0.04, 0.008), (0, 0.008)], glaze),
        turned([(0, 0.01), (0.026, 0.01), (0.041, 0.05), (0.043, 0.085), (0.039, 0.085), (0.036, 0.07)], glaze),
        disc(0.038, 0.062, 0.072, paint("4a2c1a"), sections=20),
        tube([(0, r, z) for r, z in ear], 0.006, glaze, sides=6),
    ]


def bottle(glass: Material, label: Material = WHITE) -> Model:
    """Make a bottle, 0.30 m high, with a paper label and a cap."""
    body = [(0, 0), (0.036, 0), (0.038, 0.01), (0.038, 0.17), (0.032, 0.2), (0.014, 0.235), (0.013, 0.285), (0, 0.285)]
    return [turned(body, glass), disc(0.0388, 0.05, 0.13, label), disc(0.015, 0.275, 0.298, BRASS, sections=14)]


def wine_glass(glass: Material) -> Model:
    """Make a stemmed glass, 0.19 m high."""
    profile = [(0, 0), (0.034, 0), (0.03, 0.004), (0.005, 0.01), (0.005, 0.085), (0.03, 0.105), (0.038, 0.14)]
    return [turned([*profile, (0.033, 0.19), (0.031, 0.19), (0.034, 0.14), (0.0, 0.1)], glass)]


def bowl(glaze: Material, fruit: tuple[Material, ...] = ()) -> Model:
    """Make a bowl, 0.24 m across, with fruit in it."""
    parts = [turned([(0, 0), (0.05, 0), (0.1, 0.045), (0.12, 0.09), (0.113, 0.09), (0.09, 0.045), (0, 0.015)], glaze)]
    for i, material in enumerate(fruit):
        angle = 2.4 * i
        parts.append(ellipsoid((0.036, 0.036, 0.035), (0.045 * np.cos(angle), 0.045 * np.sin(angle), 0.075), material))
    return parts


def cake() -> Model:
    """Make a cake on a stand."""
    stand = [(0, 0), (0.07, 0), (0.02, 0.02), (0.02, 0.07), (0.15, 0.08), (0.15, 0.09), (0, 0.09)]
    parts = [
        turned(stand, CERAMIC),
        disc(0.12, 0.09, 0.16, paint("7b4a2e")),
        disc(0.122, 0.155, 0.178, paint("f2ddd0")),
    ]
    for angle in np.arange(8) * np.pi / 4:
        parts.append(ellipsoid((0.014,) * 3, (0.095 * np.cos(angle), 0.095 * np.sin(angle), 0.187), paint("b3282f")))
    return parts


def vase(glaze: Material, flowers: Material, *, scale: float = 1.0) -> Model:
    """Make a vase with a loose bunch of flowers, about 0.42 m high."""
    profile = [(0, 0), (0.04, 0), (0.065, 0.05), (0.06, 0.11), (0.028, 0.17), (0.036, 0.2), (0.03, 0.2), (0.02, 0.15)]
    parts = [turned(profile, glaze)]
    rng = np.random.default_rng(5)
    for i in range(9):
        angle, lean = 2.4 * i, rng.uniform(0.02, 0.10)
        top = np.array([lean * np.cos(angle), lean * np.sin(angle), rng.uniform(0.3, 0.42)])
        parts.append(tube(np.array([[0, 0, 0.16], top]), 0.003, LEAF, sides=5))
        parts.append(ellipsoid((0.026, 0.026, 0.019), top, flowers, subdivisions=1))
        parts.append(
            leaf(top * 0.7, top * 0.75 + [0.06 * np.cos(angle + 1), 0.06 * np.sin(angle + 1), 0.02], 0.03, LEAF)
        )
    return [Part(part.mesh.apply_scale(scale), part.material) for part in parts]


def book(cover: Material, size: tuple[float, float, float] = (0.16, 0.22, 0.028)) -> Model:
    """Make a lying book: pages between two covers."""
    x, y, z = size
    return [
        box((x - 0.006, y - 0.008, z - 0.008), (-0.002, 0, z / 2), paint("efe8d6")),
        box((x, y, 0.004), (0, 0, z - 0.002), cover),
        box((x, y, 0.004), (0, 0, 0.002), cover),
        box((0.004, y, z), (-x / 2 + 0.002, 0, z / 2), cover),
    ]


def book_row(length: float, seed: int) -> Model:
    """Make a row of standing books of that length along y, their backs towards +x."""
    rng = np.random.default_rng(seed)
    colors = ["7c3b36", "2f5266", "c2964b", "44604a", "b8b0a0", "33363d", "93593a", "5a4a6a", "d8d0bf", "3c7070"]
    parts: Model = []
    y = -length / 2
    while y < length / 2 - 0.05:
        thickness, height, depth = rng.uniform(0.018, 0.045), rng.uniform(0.19, 0.27), rng.uniform(0.14, 0.19)
        cover = paint(colors[rng.integers(len(colors))])
        parts.append(box((depth, thickness - 0.002, height), (0.1 - depth / 2, y + thickness / 2, height / 2), cover))
        y += thickness
    return parts


def clock(rim: Material) -> Model:
    """Make a wall clock, 0.32 m across, its face towards +x, its middle at z = 0."""
    face = [turned([(0, 0), (0.16, 0), (0.16, 0.035), (0.145, 0.035), (0.145, 0.025), (0, 0.025)], rim, sections=40)]
    face.append(disc(0.146, 0.02, 0.027, CERAMIC, sections=40))
    for hour in range(12):
        c, s = np.cos(hour * np.pi / 6), np.sin(hour * np.pi / 6)
        face.append(box((0.014, 0.014, 0.004), (0.122 * c, 0.122 * s, 0.029), CHARCOAL))
    for angle, length in ((0.55, 0.075), (2.2, 0.11)):
        end = (length * np.cos(angle), length * np.sin(angle), 0.031)
        face.append(tube([(0, 0, 0.031), end], 0.005, CHARCOAL, sides=6))
    for part in face:  # from lying face up to hanging face forward
        part.mesh.vertices = part.mesh.vertices[:, [2, 0, 1]]
    return face


def picture(width: float, height: float, colors: tuple[str, str, str]) -> Model:
    """Make a framed picture facing +x, its middle at z = 0."""
    parts = [
        box((0.025, width, height), (0.0125, 0, 0), BLACK_METAL),
        box((0.004, width - 0.04, height - 0.04), (0.026, 0, 0), WHITE),
    ]
    parts.append(box((0.004, width * 0.62, height * 0.62), (0.028, 0, 0), paint(colors[0])))
    parts.append(box((0.004, width * 0.62, height * 0.22), (0.029, 0, -0.2 * height), paint(colors[1])))
    sun = turned([(0, 0), (0.11 * width, 0), (0.11 * width, 0.004), (0, 0.004)], paint(colors[2]))
    sun.mesh.vertices = sun.mesh.vertices[:, [2, 0, 1]] + np.array([0.029, 0.1 * width, 0.1 * height])
    return [*parts, sun]


def pot(radius: float, height: float, glaze: Material) -> Model:
    """Make a flower pot with soil."""
    r, h = radius, height
    profile = [(0, 0), (0.74 * r, 0), (r, h), (0.92 * r, h), (0.9 * r, h - 0.04)]
    return [turned(profile, glaze), disc(0.91 * r, h - 0.05, h - 0.035, SOIL, sections=20)]


def rubber_plant(glaze: Material, *, height: float = 1.5, seed: int = 0) -> Model:
    """Make a tall plant with a few stems of broad leaves in a pot of 0.19 m radius."""
    rng = np.random.default_rng(seed)
    parts = pot(0.19, 0.36, glaze)
    for stem in range(3):
        lean = 2.1 * stem + rng.uniform(0, 0.6)
        top = np.array([0.14 * np.cos(lean), 0.14 * np.sin(lean), height * rng.uniform(0.72, 0.9)])
        base = np.array([0.05 * np.cos(lean), 0.05 * np.sin(lean), 0.32])
        parts.append(tube(np.array([base, top]), [0.014, 0.007], paint("5c4632"), sides=7))
        for i, t in enumerate(np.linspace(0.25, 1.0, 11)):
            angle, length = lean + 2.4 * i, rng.uniform(0.22, 0.32) * (1.15 - 0.35 * t)
            start = base + (top - base) * t
            end = start + np.array([length * np.cos(angle), length * np.sin(angle), rng.uniform(-0.02, 0.14)])
            green = LEAF if rng.random() < 0.5 else DARK_LEAF
            parts.append(leaf(start, end, 0.12, green, droop=0.05))
    return parts


def snake_plant(glaze: Material, *, seed: int = 0) -> Model:
    """Make a plant of upright blades, about 0.8 m high, in a pot of 0.15 m radius."""
    rng = np.random.default_rng(seed)
    parts = pot(0.15, 0.26, glaze)
    for i in range(15):
        angle, r = 2.4 * i, 0.1 * np.sqrt(i / 15)
        base = np.array([r * np.cos(angle), r * np.sin(angle), 0.22])
        reach = r + rng.uniform(0.02, 0.12)
        tip = np.array([reach * np.cos(angle), reach * np.sin(angle), rng.uniform(0.55, 0.85)])
        parts.append(leaf(base, tip, 0.065, DARK_LEAF if i % 3 else paint("7d9b52")))
    return parts


def bushy_plant(glaze: Material, *, radius: float = 0.12, seed: int = 0) -> Model:
    """Make a small dense plant whose leaves hang over its pot; about five pot radii wide at most."""
    rng = np.random.default_rng(seed)
    parts = pot(radius, 1.5 * radius, glaze)
    for i in range(34):
        angle, lift = 2.4 * i, 1.0 - i / 34
        reach = radius * (0.6 + 1.5 * (1 - lift)) * rng.uniform(0.8, 1.1)
        start = np.array([0.2 * reach * np.cos(angle), 0.2 * reach * np.sin(angle), 1.4 * radius])
        tip = np.array([reach * np.cos(angle), reach * np.sin(angle), radius * (1.6 + 2.2 * lift)])
        parts.append(leaf(start, tip, 0.5 * radius, LEAF if i % 2 else DARK_LEAF, droop=0.35 * radius))
    return parts


def pendant_lamp(shade: Material, *, drop: float) -> Model:
    """Make a lamp that hangs ``drop`` metres under the ceiling; z = 0 is the ceiling."""
    profile = [(0.02, -drop + 0.2), (0.05, -drop + 0.19), (0.17, -drop), (0.163, -drop), (0.045, -drop + 0.18)]
    return [
        turned(profile, shade),
        tube([(0, 0, -drop + 0.19), (0, 0, 0)], 0.006, BLACK_METAL, sides=6),
        disc(0.05, -0.025, 0, BLACK_METAL),
        ellipsoid((0.05, 0.05, 0.055), (0, 0, -drop + 0.06), LAMP_GLOW),
    ]


def floor_lamp(shade: Material) -> Model:
    """Make a standing lamp, 1.6 m high."""
    profile = [(0.2, 1.32), (0.14, 1.6), (0.135, 1.6), (0.195, 1.32)]
    parts = [disc(0.15, 0, 0.025, BLACK_METAL), tube([(0, 0, 0.02), (0, 0, 1.5)], 0.012, BRASS), turned(profile, shade)]
    parts.append(ellipsoid((0.05, 0.05, 0.06), (0, 0, 1.45), LAMP_GLOW))
    return parts


def backpack(fabric: Material, trim: Material) -> Model:
    """Make a standing backpack, 0.46 m high."""
    parts = [
        cushion((0.18, 0.30, 0.44), (0, 0, 0.22), fabric, radius=0.07),
        cushion((0.08, 0.23, 0.2), (0.11, 0, 0.14), trim, radius=0.035),
        tube(
            [(-0.02, -0.03, 0.43), (-0.02, -0.03, 0.47), (-0.02, 0.03, 0.47), (-0.02, 0.03, 0.43)], 0.009, trim, sides=6
        ),
    ]
    for side in (-1, 1):
        strap = [(-0.08, side * 0.08, 0.40), (-0.13, side * 0.09, 0.28), (-0.08, side * 0.11, 0.08)]
        parts.append(tube(strap, 0.014, trim, sides=6))
    return parts


def suitcase(shell: Material) -> Model:
    """Make a standing wheeled suitcase, 0.62 m high, with its handle pulled out."""
    parts = [cushion((0.22, 0.40, 0.54), (0, 0, 0.32), shell, radius=0.05)]
    parts += [box((0.008, 0.025, 0.44), (0.111, y, 0.32), CHARCOAL) for y in (-0.12, -0.04, 0.04, 0.12)]
    parts += [box((0.05, 0.03, 0.06), (x, y, 0.03), CHARCOAL) for x in (-0.07, 0.07) for y in (-0.15, 0.15)]
    parts.append(
        tube([(-0.07, -0.09, 0.55), (-0.07, -0.09, 0.85), (-0.07, 0.09, 0.85), (-0.07, 0.09, 0.55)], 0.009, STEEL)
    )
    return parts


def handbag(leather: Material) -> Model:
    """Make a handbag with two handles."""
    parts = [cushion((0.13, 0.32, 0.24), (0, 0, 0.12), leather, radius=0.035)]
    for x in (-0.03, 0.03):
        loop = [(x, -0.09, 0.22), (x, -0.07, 0.33), (x, 0, 0.37), (x, 0.07, 0.33), (x, 0.09, 0.22)]
        parts.append(tube(loop, 0.007, leather, sides=6))
    return parts


def teddy_bear(fur: Material) -> Model:
    """Make a sitting teddy bear, 0.36 m high."""
    parts = [ellipsoid((0.09, 0.1, 0.11), (0, 0, 0.11), fur), ellipsoid((0.08, 0.085, 0.08), (0.01, 0, 0.265), fur)]
    parts.append(ellipsoid((0.035, 0.04, 0.03), (0.08, 0, 0.25), paint("e2cda6")))
    for side in (-1, 1):
        parts.append(ellipsoid((0.03, 0.035, 0.035), (0, side * 0.065, 0.335), fur))
        parts.append(ellipsoid((0.1, 0.042, 0.042), (0.1, side * 0.075, 0.045), fur))
        parts.append(ellipsoid((0.045, 0.04, 0.085), (0.05, side * 0.11, 0.14), fur))
        parts.append(ellipsoid((0.01,) * 3, (0.08, side * 0.032, 0.29), CHARCOAL, subdivisions=1))
    parts.append(ellipsoid((0.013, 0.016, 0.011), (0.115, 0, 0.26), CHARCOAL, subdivisions=1))
    return parts


def trash_can(body: Material) -> Model:
    """Make a waste bin, 0.42 m high."""
    return [turned([(0, 0), (0.13, 0), (0.16, 0.42), (0.15, 0.42), (0.14, 0.36), (0, 0.36)], body)]


def remote_control() -> Model:
    """Make a remote control, 0.18 m long along y."""
    parts = [cushion((0.05, 0.18, 0.02), (0, 0, 0.01), CHARCOAL, radius=0.009)]
    parts += [
        box((0.008, 0.012, 0.004), (x, y, 0.021), STEEL) for x in (-0.013, 0.0, 0.013) for y in (-0.05, -0.02, 0.01)
    ]
    return parts


def rug(width: float, length: float, field: Material, border: Material) -> Model:
    """Make a flat rug with a border, ``width`` along x."""
    return [
        box((width, length, 0.008), (0, 0, 0.004), border),
        box((width - 0.2, length - 0.2, 0.004), (0, 0, 0.009), field),
        *moved([box((width - 0.5, 0.06, 0.002), (0, y, 0.0115), border) for y in (-length / 4, 0.0, length / 4)], 0, 0),
    ]


def coat_stand() -> Model:
    """Make a coat stand, 1.7 m high."""
    parts = [tube([(0, 0, 0.03), (0, 0, 1.68)], 0.018, OAK), disc(0.2, 0, 0.03, OAK)]
    for angle in np.arange(4) * np.pi / 2:
        c, s = np.cos(angle), np.sin(angle)
        parts.append(leg((0, 0, 1.55), (0.16 * c, 0.16 * s, 1.66), OAK, radius=0.011))
    return parts
