"""Kitchen machines, screens and computers. Fronts face +x; origin under the middle."""

import numpy as np

from simaps_viz.scenes.materials import BLACK_METAL, CHARCOAL, SCREEN, STEEL, WHITE, Material, Texture, paint
from simaps_viz.scenes.shapes import Model, box, cushion, disc, moved, tube, turned

_PANEL = paint("17191c")


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
