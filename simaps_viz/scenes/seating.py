"""Things to sit on. Every model faces +x, stands on z = 0 and has its origin under the middle of its seat."""

import numpy as np

from simaps_viz.scenes.materials import BLACK_METAL, CHARCOAL, OAK, STEEL, WALNUT, Material
from simaps_viz.scenes.shapes import Model, box, curved_panel, cushion, disc, leg, moved, tube, turned


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
