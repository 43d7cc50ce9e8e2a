"""What surfaces are made of: colours (as written in sRGB, kept linear) and small repeating textures."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

TEXELS = 512
"""Side of every texture, texels."""
MIP_LEVELS = 4
"""Coarser copies of each texture (half, quarter …) for far surfaces."""


class Texture(IntEnum):
    """The pattern laid over a surface's colour. SKY and GLOW also shine by themselves."""

    PLAIN = 0
    WOOD = 1
    PLANKS = 2
    TILES = 3
    FABRIC = 4
    CARPET = 5
    BRICK = 6
    PLASTER = 7
    GLOW = 8
    SKY = 9


TILE_SIZE_M: dict[Texture, float] = {
    Texture.WOOD: 1.1,
    Texture.PLANKS: 2.4,
    Texture.TILES: 1.2,
    Texture.FABRIC: 0.25,
    Texture.CARPET: 1.0,
    Texture.BRICK: 1.28,
    Texture.PLASTER: 2.0,
}
"""Side of the square of surface that one copy of the texture covers."""


@dataclass(frozen=True)
class Material:
    """Colour and pattern of one part."""

    color: tuple[float, float, float]
    """Linear RGB reflectance, 0-1."""
    texture: Texture = Texture.PLAIN

    def shifted(self, hue_shift: float, gain: float) -> "Material":
        """Return the same material a little warmer (hue_shift > 0) or cooler, lighter or darker."""
        r, g, b = self.color
        shifted = (r * gain * (1 + hue_shift), g * gain, b * gain * (1 - hue_shift))
        return Material((min(shifted[0], 0.95), min(shifted[1], 0.95), min(shifted[2], 0.95)), self.texture)


def paint(hex_color: str, texture: Texture = Texture.PLAIN) -> Material:
    """Make a material from an sRGB colour such as ``"c8a27a"``."""
    srgb = np.array([int(hex_color[i : i + 2], 16) for i in (0, 2, 4)]) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return Material((float(linear[0]), float(linear[1]), float(linear[2])), texture)


OAK = paint("c69b6d", Texture.WOOD)
WALNUT = paint("7a5238", Texture.WOOD)
BIRCH = paint("dcc39c", Texture.WOOD)
BLACK_METAL = paint("2b2c2e")
STEEL = paint("b4b8bb")
BRASS = paint("b8924f")
WHITE = paint("ecebe6")
CERAMIC = paint("f1eee6")
TERRACOTTA = paint("bd6f4c")
CHARCOAL = paint("3c3f43")
GLASS_GREEN = paint("3f6b52")
GLASS_BROWN = paint("6b3f22")
GLASS_CLEAR = paint("cfdcdd")
SOIL = paint("3a2c22")
LEAF = paint("4f8346")
DARK_LEAF = paint("2f6043")
SAGE = paint("8ea487", Texture.FABRIC)
TEAL = paint("3f7274", Texture.FABRIC)
MUSTARD = paint("cb9a3c", Texture.FABRIC)
RUST = paint("b3593a", Texture.FABRIC)
LINEN = paint("d8cfbf", Texture.FABRIC)
NAVY = paint("34465f", Texture.FABRIC)
GREY_FABRIC = paint("85898c", Texture.FABRIC)
SCREEN = paint("1b2430")
LAMP_GLOW = paint("ffe3b0", Texture.GLOW)


def _noise(rng: np.random.Generator, cells_v: int, cells_u: int) -> NDArray:
    """Make smooth repeating noise, float32 [TEXELS, TEXELS], about -1 to 1, with that many bumps along v and u."""
    coarse = np.tile(rng.uniform(-1, 1, size=(cells_v, cells_u)).astype(np.float32), (3, 3))
    fine = cv2.resize(coarse, (3 * TEXELS, 3 * TEXELS), interpolation=cv2.INTER_CUBIC)
    return fine[TEXELS : 2 * TEXELS, TEXELS : 2 * TEXELS]


def _blocks(rows: int, cols: int, *, shift: float, seam: int) -> tuple[NDArray, NDArray, NDArray]:
    """Lay blocks in rows, every second row shifted by a share of a block.

    Returns:
        Row and column of the block of each texel (int), and whether it lies in a seam (bool), [TEXELS, TEXELS].
    """
    v, u = np.mgrid[:TEXELS, :TEXELS]
    row = v * rows // TEXELS
    width, height = TEXELS / cols, TEXELS / rows
    moved = (u + row * shift * width) % TEXELS
    seams = (moved % width < seam) | (v % height < seam)
    return row, (moved // width).astype(int), seams


def _draw(texture: Texture) -> NDArray:
    """Draw one texture: float32 [TEXELS, TEXELS], factors on the colour, mean near 1."""
    rng = np.random.default_rng(int(texture))
    one = np.ones((TEXELS, TEXELS), dtype=np.float32)
    if texture in (Texture.PLANKS, Texture.TILES, Texture.CARPET, Texture.BRICK):
        return _draw_blocks(texture, rng)
    if texture is Texture.WOOD:
        return one + 0.10 * _noise(rng, 4, 48) + 0.07 * _noise(rng, 8, 160) + 0.05 * _noise(rng, 3, 7)
    if texture is Texture.FABRIC:
        return one + 0.10 * rng.uniform(-1, 1, size=one.shape).astype(np.float32) + 0.04 * _noise(rng, 12, 12)
    if texture is Texture.PLASTER:
        return one + 0.018 * _noise(rng, 9, 9) + 0.012 * _noise(rng, 60, 60)
    return one


def _draw_blocks(texture: Texture, rng: np.random.Generator) -> NDArray:
    """Draw a texture that is laid in rows: planks, tiles, carpet tiles, bricks."""
    if texture is Texture.PLANKS:
        row, col, seams = _blocks(16, 2, shift=0.37, seam=2)
        tone = rng.uniform(0.84, 1.12, size=(16, 3)).astype(np.float32)[row, col]
        return np.where(seams, 0.6, tone * (1.0 + 0.06 * _noise(rng, 220, 6) + 0.05 * _noise(rng, 60, 9)))
    if texture is Texture.TILES:
        row, col, seams = _blocks(4, 4, shift=0.0, seam=4)
        tone = rng.uniform(0.93, 1.05, size=(4, 5)).astype(np.float32)[row, col]
        return np.where(seams, 0.7, tone + 0.02 * _noise(rng, 40, 40))
    if texture is Texture.CARPET:
        row, col, seams = _blocks(2, 2, shift=0.0, seam=2)
        tone = np.where((row + col) % 2 == 0, 1.03, 0.95)
        return np.where(seams, 0.9, tone) + 0.10 * rng.uniform(-1, 1, size=seams.shape)
    row, col, seams = _blocks(16, 5, shift=0.5, seam=5)
    tone = rng.uniform(0.88, 1.08, size=(16, 6)).astype(np.float32)[row, col]
    return np.where(seams, 0.86, tone + 0.03 * _noise(rng, 90, 90))


@cache
def texture_atlas() -> NDArray:
    """Draw all textures once: float32 [MIP_LEVELS, textures, TEXELS, TEXELS], read-only."""
    finest = np.stack([_draw(texture) for texture in Texture]).astype(np.float32)
    levels = [finest]
    for level in range(1, MIP_LEVELS):
        small = TEXELS >> level
        shrunk = [cv2.resize(t, (small, small), interpolation=cv2.INTER_AREA) for t in finest]
        grown = [cv2.resize(t, (TEXELS, TEXELS), interpolation=cv2.INTER_NEAREST) for t in shrunk]
        levels.append(np.stack(grown))
    atlas = np.stack(levels)
    atlas.setflags(write=False)
    return atlas
