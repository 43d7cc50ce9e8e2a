"""Small things: what stands on tables, hangs on walls or is left on the floor. Origin under the middle."""

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
    SOIL,
    STEEL,
    WHITE,
    Material,
    paint,
)
from simaps_viz.scenes.shapes import Model, Part, box, cushion, disc, ellipsoid, leaf, leg, moved, tube, turned


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
