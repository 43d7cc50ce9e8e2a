"""How far apart colours are, also for people who lack one kind of cone: simulated vision and CIEDE2000."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

VISIONS = {
    "normal": np.eye(3),
    "no red cones": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "no green cones": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "no blue cones": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
"""Machado, Oliveira and Fernandes 2009, severity 1.0, on linear RGB."""
_TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
_WHITE = np.array([0.95047, 1.0, 1.08883])


def linear(rgb: ArrayLike) -> NDArray:
    """Undo sRGB's gamma; 0-255 to 0-1."""
    c = np.asarray(rgb, float) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb: ArrayLike, vision: str = "normal") -> NDArray:
    """CIELAB (D65) of colours [..., 3], 0-255, as seen."""
    seen = np.clip(linear(rgb) @ VISIONS[vision].T, 0.0, 1.0)
    xyz = seen @ _TO_XYZ.T / _WHITE
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1)


def ciede2000(lab1: NDArray, lab2: NDArray) -> NDArray:
    """CIEDE2000 (CIE 142-2001; the steps of Sharma, Wu and Dalal 2005), k = 1."""
    (L1, a1, b1), (L2, a2, b2) = np.moveaxis(lab1, -1, 0), np.moveaxis(lab2, -1, 0)
    mean_c = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    g = 0.5 * (1 - np.sqrt(mean_c**7 / (mean_c**7 + 25.0**7)))
    a1, a2 = (1 + g) * a1, (1 + g) * a2
    c1, c2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, a)) % 360 for b, a in ((b1, a1), (b2, a2)))
    grey = c1 * c2 == 0
    turn = (h2 - h1 + 180) % 360 - 180
    turn = np.where(h2 - h1 == 180, 180, turn)
    d_h = np.where(grey, 0.0, 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2)))
    h_sum = h1 + h2
    near = np.abs(h1 - h2) <= 180
    h = np.where(grey, h_sum, np.where(near, h_sum / 2, np.where(h_sum < 360, h_sum / 2 + 180, h_sum / 2 - 180)))
    c, lightness = (c1 + c2) / 2, (L1 + L2) / 2
    t = 1 - 0.17 * _cos(h - 30) + 0.24 * _cos(2 * h) + 0.32 * _cos(3 * h + 6) - 0.20 * _cos(4 * h - 63)
    s_l = 1 + 0.015 * (lightness - 50) ** 2 / np.sqrt(20 + (lightness - 50) ** 2)
    s_c, s_h = 1 + 0.045 * c, 1 + 0.015 * c * t
    twist = 60 * np.exp(-(((h - 275) / 25) ** 2))
    r_t = -np.sin(np.radians(twist)) * 2 * np.sqrt(c**7 / (c**7 + 25.0**7))
    x, y, z = (L2 - L1) / s_l, (c2 - c1) / s_c, d_h / s_h
    return np.sqrt(x**2 + y**2 + z**2 + r_t * y * z)


def _cos(degrees: NDArray) -> NDArray:
    return np.cos(np.radians(degrees))


def least_apart(first: ArrayLike, second: ArrayLike) -> float:
    """The smallest CIEDE2000 between colours of the same place in two lists [n, 3], over all visions."""
    return min(float(ciede2000(lab(first, v), lab(second, v)).min()) for v in VISIONS)


def contrast(first: ArrayLike, second: ArrayLike) -> float:
    """Contrast ratio of WCAG 2, 1 to 21."""
    light, dark = sorted((float(linear(c) @ (0.2126, 0.7152, 0.0722)) for c in (first, second)), reverse=True)
    return (light + 0.05) / (dark + 0.05)
