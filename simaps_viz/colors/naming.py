"""Names of colours as cameras see them. They are approximate, as light and white balance move a colour by a name.

The examples and words are data (`color_names.json`); a colour is called like the example nearest to it in CIELAB.
"""

import json
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.errors import InputError

_TABLE = json.loads(resources.files("simaps_viz.colors").joinpath("color_names.json").read_text(encoding="utf-8"))
_NAMES: tuple[str, ...] = tuple(_TABLE["examples"])
_OTHER_NAMES: dict[str, tuple[str, ...]] = {
    **{name: (name,) for name in _NAMES},
    **{name.replace("grey", "gray"): (name,) for name in _NAMES},
    **{word: tuple(names) for word, names in _TABLE["words"].items()},
}
_VAGUE = ("dark", "light", "pale", "bright", "colourful", "colorful")
COLOR_WORDS = frozenset({*_OTHER_NAMES, *_VAGUE})
"""Every word that `has_color` understands, lower case."""

_CLOSE = 4.0
"""Of two examples whose distances differ by less than this, a person might name either."""
_NEARLY = 6.0
"""The same for a vivid colour where nothing else in question has it."""
_LIGHTNESS = 0.8
"""Share with which lightness counts: it depends on the light more than the hue does."""
_VIVID = 30.0
"""Chroma is compressed above about this."""
_DARK, _LIGHT, _COLORFUL = 35.0, 70.0, 32.0
"""CIELAB lightness below and above which a colour is dark or light, and chroma above which it is colourful."""


def lab(rgb: ArrayLike) -> NDArray:
    """Convert sRGB colours [..., 3], 0 to 255, to CIELAB under daylight (D65): L* 0 to 100, a*, b*; float64."""
    share = np.asarray(rgb, np.float64) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                       [0.0193339, 0.1191920, 0.9503041]])  # fmt: skip
    xyz = linear @ to_xyz.T / to_xyz.sum(axis=1)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def _felt(rgb: ArrayLike) -> NDArray:
    """Return CIELAB with less lightness and chroma compressed, as differences between vivid colours are felt less."""
    found = lab(rgb)
    chroma = np.hypot(found[..., 1], found[..., 2])
    share = _VIVID * np.log1p(chroma / _VIVID) / np.maximum(chroma, 1e-9)
    return np.stack([_LIGHTNESS * found[..., 0], share * found[..., 1], share * found[..., 2]], axis=-1)


_EXAMPLES = _felt([rgb for name in _NAMES for rgb in _TABLE["examples"][name]])
_NAME_OF = np.repeat(np.arange(len(_NAMES)), [len(_TABLE["examples"][name]) for name in _NAMES])


def color_name(rgb: tuple[int, int, int]) -> str:
    """Return what a colour is called, approximately: "red", "light brown", "dark grey"."""
    return _NAMES[int(_NAME_OF[_distances(rgb).argmin()])]


def has_color(rgb: tuple[int, int, int], word: str, *, nearly: bool = False) -> bool:
    """Whether a colour may be called by a word; at the edges of names, a colour has several.

    Args:
        rgb: the colour, 0 to 255.
        word: a word of `COLOR_WORDS`, in whatever case.
        nearly: also a vivid colour that a person would call so where nothing else has it.

    Raises:
        InputError: the word is none of them.
    """
    wanted = " ".join(word.lower().split())
    if wanted not in COLOR_WORDS:
        raise InputError(f"colour: expected a word such as red, light brown or dark, found {word[:40]!r}")
    lightness, a, b = lab(rgb).tolist()
    if wanted == "dark":
        return lightness < _DARK
    if wanted in ("light", "pale"):
        return lightness > _LIGHT
    if wanted in _VAGUE:
        return float(np.hypot(a, b)) > _COLORFUL
    distances = _distances(rgb)
    close = _NEARLY if nearly and float(np.hypot(a, b)) > _COLORFUL else _CLOSE
    near = {_NAMES[i] for i in _NAME_OF[distances <= distances.min() + close]}
    return bool(near & set(_OTHER_NAMES[wanted]))


def _distances(rgb: tuple[int, int, int]) -> NDArray:
    """Return the distances, as felt, from a colour to all examples, float64 [examples]."""
    return np.linalg.norm(_felt(rgb) - _EXAMPLES, axis=1)
