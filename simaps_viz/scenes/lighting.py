"""Soft light: sun through the windows, lamps, and light that comes from everywhere less what is near.

Light from all around ("ambient") and sun shadows are ray cast at half resolution with a direction pattern that
repeats every 4 x 4 samples; averaging over one period along each surface removes the pattern. Cheap, without
noise that flickers from frame to frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from simaps_viz.scenes.materials import MIP_LEVELS, TEXELS, TILE_SIZE_M, Texture, texture_atlas
from simaps_viz.scenes.scene import Scene

if TYPE_CHECKING:
    from simaps_viz.scenes.render import Surfaces

PERIOD = 4
"""Side of the square of half-resolution samples that share all directions."""
RAYS_PER_SAMPLE = 3
NEAR_M = 1.2
"""Things closer than this take ambient light away, the closer the more."""
TO_SUN = np.array([-0.60, -0.62, 0.50], dtype=np.float32) / np.float32(np.linalg.norm([-0.60, -0.62, 0.50]))
SUN_COLOR = np.array([2.6, 2.25, 1.75], dtype=np.float32)
AMBIENT_COLOR = np.array([0.60, 0.60, 0.61], dtype=np.float32)
LAMP_COLOR = np.array([0.62, 0.52, 0.38], dtype=np.float32)
EXPOSURE = 1.45


class Light:
    """The scene's light sources and the search tree their shadows are cast in."""

    def __init__(self, scene: Scene, shadow_tree: EmbreeScene) -> None:
        self.tree = shadow_tree
        self.face_color = scene.color[~scene.lets_light_through]
        lamps = [o.bounds_m.mean(axis=0) * [1, 1, 0] + [0, 0, 2.15] for o in scene.objects if o.label == "lamp"]
        self.lamps_m = np.array([*lamps, *CEILING_LIGHTS_M], dtype=np.float32).reshape(-1, 3)
        self.directions = _pattern()
        warm = np.array([[0.0, 0.0, 1.0]], dtype=np.float32)
        self.tree.run(warm, -warm)


CEILING_LIGHTS_M = ((2.1, 7.7, 2.5), (5.5, 7.6, 2.5), (8.7, 7.6, 2.5), (10.6, 6.6, 2.5), (10.0, 2.6, 2.5))
"""Plain lights without a visible lamp."""


def _pattern() -> NDArray:
    """Spread directions over the upper half sphere, density by cosine: float32 [16, RAYS_PER_SAMPLE, 3]."""
    count = PERIOD * PERIOD * RAYS_PER_SAMPLE
    i = np.arange(count)
    radius, angle = np.sqrt((i + 0.5) / count), i * 2.399963229728653
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], -1)
    by_sample = directions.reshape(RAYS_PER_SAMPLE, PERIOD * PERIOD, 3).swapaxes(0, 1)
    shuffled = (np.arange(PERIOD * PERIOD) * 7) % (PERIOD * PERIOD)
    return by_sample[shuffled].astype(np.float32)


def _tangents(normals: NDArray) -> tuple[NDArray, NDArray]:
    """Complete unit normals [n, 3] to orthonormal frames (Duff et al., 2017)."""
    x, y, z = normals.T
    sign = np.where(z < 0, np.float32(-1), np.float32(1))
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], -1)
    second = np.stack([b, sign + y * y * a, -y], -1)
    return first, second


def _cast_light(points_m: NDArray, normals: NDArray, light: Light) -> NDArray:
    """Gather what reaches half-resolution samples [3, h, w].

    Returns:
        float32 [5, h, w]: light from all around (RGB, 0-1), the sun seen (0 or 1), light of the lamps.
    """
    h, w = points_m.shape[1:]
    v, u = np.mgrid[:h, :w]
    sample = ((v % PERIOD) * PERIOD + u % PERIOD).ravel()
    n = np.ascontiguousarray(normals.reshape(3, -1).T)
    origin = np.ascontiguousarray(points_m.reshape(3, -1).T) + n * np.float32(0.004)
    first, second = _tangents(n)
    gathered = np.zeros((h * w, 5), dtype=np.float32)
    for k in range(RAYS_PER_SAMPLE):
        d = light.directions[sample, k]
        rays = first * d[:, :1] + second * d[:, 1:2] + n * d[:, 2:]
        reach = np.full(h * w, NEAR_M, dtype=np.float32)
        hits = light.tree.run(origin, rays, reach, query="INTERSECT", output=True)
        near = np.where(hits["primID"] >= 0, 1.0 - hits["tfar"] / NEAR_M, 0.0).astype(np.float32)[:, None]
        bounced = light.face_color[np.maximum(hits["primID"], 0)]
        gathered[:, :3] += 1.0 - near + near * 0.45 * bounced
    gathered[:, :3] /= RAYS_PER_SAMPLE
    gathered[:, 3] = _visible_sun(origin, n, light.directions[sample, 0], light)
    gathered[:, 4] = _lamp_light(origin, n, light) * (0.35 + 0.65 * gathered[:, 1])
    return np.ascontiguousarray(gathered.T).reshape(5, h, w)


def _towards_sun(normals: NDArray) -> NDArray:
    """Return the cosine between normals [n, 3] and the direction to the sun (BLAS would start threads of its own)."""
    return np.einsum("ij,j->i", normals, TO_SUN)


def _visible_sun(origin: NDArray, normals: NDArray, directions: NDArray, light: Light) -> NDArray:
    """Report where the sun is seen: float32 [n], 0 or 1; its disc is widened for soft shadow edges."""
    facing = np.flatnonzero(_towards_sun(normals) > 0)
    seen = np.zeros(len(origin), dtype=np.float32)
    if len(facing):
        rays = TO_SUN + np.float32(0.025) * directions[facing]
        seen[facing] = light.tree.run(origin[facing], rays, query="OCCLUDED") < 0  # 0 is blocked, -1 is free
    return seen


@dataclass(frozen=True, eq=False)
class _Geometry:
    """Where samples lie, to tell which of them belong to one smooth surface."""

    points_m: NDArray
    """float32 [3, h, w]."""
    normals: NDArray
    """float32 [3, h, w]."""
    tolerance_m: NDArray
    """float32 [h, w], how far off the tangent plane still counts as the same surface."""

    def part(self, window: tuple[slice, slice]) -> _Geometry:
        """Cut out rows and columns."""
        return _Geometry(self.points_m[:, *window], self.normals[:, *window], self.tolerance_m[window])

    def padded(self, pad: tuple[tuple[int, int], tuple[int, int]]) -> _Geometry:
        """Repeat the border."""
        p, n = (np.pad(a, ((0, 0), *pad), mode="edge") for a in (self.points_m, self.normals))
        return _Geometry(p, n, np.pad(self.tolerance_m, pad, mode="edge"))

    def same_surface(self, other: _Geometry) -> NDArray:
        """Return which samples lie on one smooth surface with the other's: float32 [h, w], 0 or 1."""
        (nx, ny, nz), (mx, my, mz) = self.normals, other.normals
        (px, py, pz), (qx, qy, qz) = self.points_m, other.points_m
        off_plane = np.abs(nx * (qx - px) + ny * (qy - py) + nz * (qz - pz))
        return ((off_plane < self.tolerance_m) & (nx * mx + ny * my + nz * mz > 0.8)).astype(np.float32)


def _average_pattern(values: NDArray, geometry: _Geometry) -> NDArray:
    """Average [c, h, w] over one period of the pattern, along the same surface only; first rows, then columns."""
    h, w = values.shape[1:]
    low, high = PERIOD // 2, PERIOD - PERIOD // 2 - 1
    for across in (False, True):
        pad = ((0, 0), (low, high)) if across else ((low, high), (0, 0))
        values_pad, geometry_pad = np.pad(values, ((0, 0), *pad), mode="edge"), geometry.padded(pad)
        total, weight = np.zeros_like(values), np.zeros((h, w), dtype=np.float32)
        for i in range(PERIOD):
            window = np.s_[:, i : i + w] if across else np.s_[i : i + h, :]
            same = geometry.same_surface(geometry_pad.part(window))
            total += values_pad[:, *window] * same
            weight += same
        values = total / np.maximum(weight, 1e-6)
    return values


def _upsample(half: NDArray, geometry: _Geometry) -> NDArray:
    """Bring half-resolution values [c, h, w] to full resolution, taking only samples of the same surface."""
    height, width = geometry.tolerance_m.shape
    full = np.zeros((len(half), height, width), dtype=np.float32)
    full[:, ::2, ::2] = half
    pad = ((0, 1), (0, 1))
    half_pad = np.pad(half, ((0, 0), *pad), mode="edge")
    corners = geometry.part(np.s_[::2, ::2]).padded(pad)
    for dv, du in ((0, 1), (1, 0), (1, 1)):
        mine = geometry.part(np.s_[dv::2, du::2])
        rows, cols = mine.tolerance_m.shape
        total = 1e-3 * half_pad[:, :rows, :cols]
        weight = np.full((rows, cols), 1e-3, dtype=np.float32)
        for i in range(dv + 1):
            for j in range(du + 1):
                window = np.s_[i : i + rows, j : j + cols]
                same = mine.same_surface(corners.part(window))
                total += half_pad[:, *window] * same
                weight += same
        full[:, dv::2, du::2] = total / weight
    return full


def _room(points_m: NDArray) -> NDArray:
    """Number the room of each point: 0 café, 1 lounge, 2 office (lamps do not shine through walls)."""
    return np.where(points_m[..., 0] < 7.2, 0, np.where(points_m[..., 1] < 4.7, 1, 2))


def _lamp_light(points_m: NDArray, normals: NDArray, light: Light) -> NDArray:
    """Sum the light of the room's lamps, without shadows: float32 [n]."""
    total = np.zeros(len(points_m), dtype=np.float32)
    rooms, lamp_rooms = _room(points_m), _room(light.lamps_m)
    for room in range(3):
        index = np.flatnonzero(rooms == room)
        p, n = points_m[index], normals[index]
        lit = np.zeros(len(index), dtype=np.float32)
        for lamp in light.lamps_m[lamp_rooms == room]:
            to_lamp = lamp - p
            squared = np.einsum("ij,ij->i", to_lamp, to_lamp)
            cosine = np.einsum("ij,ij->i", to_lamp, n) / np.sqrt(squared + 1e-6)
            lit += np.maximum(0.25 + 0.75 * cosine, 0.0) / (0.5 + squared)
        total[index] = lit
    return total


def _pattern_factor(surfaces: Surfaces, scene: Scene, focal_px: float) -> NDArray:
    """Look up the texture of every pixel, laid along the world's axes: float32 [n]."""
    face = surfaces.face.ravel()
    texture = scene.texture[face]
    tile = np.array([TILE_SIZE_M.get(t, 1.0) for t in Texture], dtype=np.float32)[texture]
    axis = scene.main_axis[face]
    x, y, z = surfaces.points_m.reshape(-1, 3).T
    u = np.where(axis == 0, y, x) / tile
    v = np.where(axis == 2, y, z) / tile
    texels_per_pixel = surfaces.depth_m.ravel() / focal_px * TEXELS / tile
    level = np.clip(np.log2(np.maximum(texels_per_pixel, 1.0)), 0, MIP_LEVELS - 1).astype(np.int8)
    column = (u * TEXELS).astype(np.int32) % TEXELS
    row = (v * TEXELS).astype(np.int32) % TEXELS
    return texture_atlas()[level, texture, row, column]


def _sky(rays: NDArray) -> NDArray:
    """Colour the view through a window by the ray's slope [n, 3]: street, haze, sky."""
    slope = rays[:, 2] / np.sqrt(rays[:, 0] ** 2 + rays[:, 1] ** 2)
    stops = [-0.6, -0.15, 0.0, 0.12, 0.8]
    red, green, blue = [0.42, 0.55, 0.95, 0.98, 0.55], [0.42, 0.58, 0.97, 1.02, 0.78], [0.36, 0.47, 0.96, 1.08, 1.15]
    return np.stack([np.interp(slope, stops, channel) for channel in (red, green, blue)], -1).astype(np.float32)


def shade(surfaces: Surfaces, scene: Scene, light: Light, *, focal_px: float) -> NDArray:
    """Shade a cast picture: uint8 [H, W, 3], RGB."""
    shape = surfaces.points_m.shape
    n = surfaces.normals.reshape(-1, 3)
    p_planes, n_planes = (np.ascontiguousarray(a.transpose(2, 0, 1)) for a in (surfaces.points_m, surfaces.normals))
    geometry = _Geometry(p_planes, n_planes, 0.004 + 0.006 * surfaces.depth_m)
    half = geometry.part(np.s_[::2, ::2])
    gathered = _average_pattern(_cast_light(half.points_m, half.normals, light), half)
    around = _upsample(gathered, geometry).reshape(5, -1).T
    face = surfaces.face.ravel()
    sun = around[:, 3] * np.maximum(_towards_sun(n), 0.0)
    from_above = (0.86 + 0.14 * n[:, 2])[:, None]
    arriving = AMBIENT_COLOR * from_above * around[:, :3] + LAMP_COLOR * around[:, 4:] + SUN_COLOR * sun[:, None]
    albedo = scene.color[face] * _pattern_factor(surfaces, scene, focal_px)[:, None]
    leaving = albedo * arriving
    texture = scene.texture[face]
    glows = texture == int(Texture.GLOW)
    leaving[glows] = scene.color[face[glows]] * 1.3
    sky = texture == int(Texture.SKY)
    leaving[sky] = _sky(surfaces.rays.reshape(-1, 3)[sky])
    leaving[~surfaces.hit.ravel()] = 0.0
    return _develop(leaving).reshape(shape)


def _develop(linear: NDArray) -> NDArray:
    """Expose light [n, 3]: a soft shoulder instead of clipping, then sRGB's curve; uint8."""
    exposed = 1.0 - np.exp(-EXPOSURE * linear)
    curve = np.arange(4097) / 4096.0
    srgb = np.where(curve <= 0.0031308, 12.92 * curve, 1.055 * curve ** (1 / 2.4) - 0.055)
    return np.round(255 * srgb).astype(np.uint8)[(exposed * 4096.0).astype(np.int32)]
