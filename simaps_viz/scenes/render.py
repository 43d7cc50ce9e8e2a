"""Render a scene as a depth camera would see it: cast rays with Embree, light what they hit, add the sensor's noise.

Light from all around ("ambient") and sun shadows are ray cast at half resolution with a direction pattern that
repeats every 4 x 4 samples; averaging over one period along each surface removes the pattern. Cheap, without
noise that flickers from frame to frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from simaps_viz.scenes.materials import MIP_LEVELS, TEXELS, TILE_SIZE_M, Texture, texture_atlas
from simaps_viz.scenes.scene import Scene
from simaps_viz.structures import Intrinsics

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
        self.lamps_m = np.array([*lamps, *scene.lights_m], dtype=np.float32).reshape(-1, 3)
        self.rooms_m = scene.rooms_m or ((-np.inf, -np.inf, np.inf, np.inf),)
        self.directions = _pattern()
        warm = np.array([[0.0, 0.0, 1.0]], dtype=np.float32)
        self.tree.run(warm, -warm)


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


def _inside(points_m: NDArray, room_m: tuple[float, float, float, float]) -> NDArray:
    """Return which points [n, 3] lie in a room (west, south, east, north): bool [n]."""
    x, y = points_m[..., 0], points_m[..., 1]
    west, south, east, north = room_m
    return (x >= west) & (y >= south) & (x < east) & (y < north)


def _lamp_light(points_m: NDArray, normals: NDArray, light: Light) -> NDArray:
    """Sum the light of the room's lamps, without shadows (lamps do not shine through walls): float32 [n]."""
    total = np.zeros(len(points_m), dtype=np.float32)
    for room_m in light.rooms_m:
        index = np.flatnonzero(_inside(points_m, room_m))
        p, n = points_m[index], normals[index]
        lit = np.zeros(len(index), dtype=np.float32)
        for lamp in light.lamps_m[_inside(light.lamps_m, room_m)]:
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


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What the rays of one picture hit. All arrays [H, W, ...], float32 unless said otherwise, world frame."""

    depth_m: NDArray
    """[H, W], along the optical axis, 0 = nothing hit or only sky behind a pane."""
    face: NDArray
    """int32 [H, W], 0 where nothing was hit."""
    hit: NDArray
    """bool [H, W]."""
    instance: NDArray
    """uint8 [H, W], 0 = nothing hit."""
    points_m: NDArray
    """[H, W, 3]."""
    normals: NDArray
    """[H, W, 3], shading normals, towards the camera."""
    rays: NDArray
    """[H, W, 3], not unit: 1 along the optical axis."""
    incidence: NDArray
    """[H, W], cosine between the ray and the true surface normal."""


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """One exact picture."""

    color: NDArray
    """uint8 [H, W, 3], RGB."""
    depth_m: NDArray
    """float32 [H, W], metres along the optical axis, 0 = nothing hit or sky."""
    instance: NDArray
    """uint8 [H, W], 0 = nothing hit."""
    incidence: NDArray
    """float32 [H, W], cosine between the ray and the surface normal."""


def embree_scene(triangles_m: NDArray) -> EmbreeScene:
    """Build Embree's search tree over triangles float32 [n, 3, 3]."""
    tree = EmbreeScene()
    TriangleMesh(tree, np.ascontiguousarray(triangles_m, dtype=np.float32))
    return tree


class Renderer:
    """Casts and shades pictures of one scene; safe to use from several threads (Embree releases the lock)."""

    def __init__(self, scene: Scene, intrinsics: Intrinsics) -> None:
        self.scene = scene
        self.intrinsics = intrinsics
        self._tree = embree_scene(scene.triangles_m)
        self._light = Light(scene, embree_scene(scene.triangles_m[~scene.lets_light_through]))
        v, u = np.mgrid[: intrinsics.height, : intrinsics.width]
        x, y = (u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy
        self._camera_rays = np.stack([x, y, np.ones_like(x)], axis=-1).astype(np.float32)
        warm = np.array([[0.0, 0.0, 1.0]], dtype=np.float32)
        self._tree.run(warm, -warm)  # Embree builds its tree at the first ray; do it before threads start

    def cast(self, T_world_camera: NDArray) -> Surfaces:
        """Cast one ray a pixel; T_world_camera float64 [4, 4]."""
        shape = self._camera_rays.shape[:2]
        R_world_camera = T_world_camera[:3, :3].astype(np.float32)
        # einsum, as a matrix product would start BLAS threads within our threads
        rays = np.einsum("ij,kj->ik", self._camera_rays.reshape(-1, 3), R_world_camera)
        origin = T_world_camera[:3, 3].astype(np.float32)
        hits = self._tree.run(np.tile(origin, (len(rays), 1)), rays, query="INTERSECT", output=True)
        hit = hits["primID"] >= 0
        face = np.where(hit, hits["primID"], 0)
        reach = np.where(hit, hits["tfar"], 0.0).astype(np.float32)
        u, v = hits["u"][:, None], hits["v"][:, None]
        corners = self.scene.normals[face]
        normals = corners[:, 0] * (1 - u - v) + corners[:, 1] * u + corners[:, 2] * v
        ray_length = np.sqrt(np.einsum("ij,ij->i", rays, rays))
        facing = -np.einsum("ij,ij->i", self.scene.face_normals[face], rays)
        normals *= np.where(facing < 0, -1.0, 1.0).astype(np.float32)[:, None]
        normals /= np.maximum(np.sqrt(np.einsum("ij,ij->i", normals, normals)), 1e-6)[:, None]
        sky = self.scene.texture[face] == int(Texture.SKY)
        return Surfaces(
            depth_m=np.where(sky, 0.0, reach).astype(np.float32).reshape(shape),
            face=face.reshape(shape),
            hit=hit.reshape(shape),
            instance=np.where(hit, self.scene.instance[face], 0).astype(np.uint8).reshape(shape),
            points_m=(origin + rays * reach[:, None]).reshape(*shape, 3),
            normals=normals.reshape(*shape, 3),
            rays=rays.reshape(*shape, 3),
            incidence=(np.abs(facing) / ray_length).astype(np.float32).reshape(shape),
        )

    def render(self, T_world_camera: NDArray) -> RenderedFrame:
        """Cast and shade one picture."""
        surfaces = self.cast(T_world_camera)
        color = shade(surfaces, self.scene, self._light, focal_px=self.intrinsics.fx)
        return RenderedFrame(color, surfaces.depth_m, surfaces.instance, surfaces.incidence)


@dataclass(frozen=True)
class DepthSensor:
    """How depth is spoiled.

    The axial noise is the fit of Nguyen, Izadi and Lovell (3DIMPVT 2012) for a Kinect, for surfaces that are not
    seen at a grazing angle: ``sigma(z) = 0.0012 + 0.0019 (z - 0.4)^2``, metres.
    """

    enabled: bool = True
    """False gives exact depth, cut to the range."""
    near_m: float = 0.3
    far_m: float = 6.0
    """Nothing is measured beyond."""
    sigma_floor_m: float = 0.0012
    sigma_growth_per_m: float = 0.0019
    lateral_sigma_px: float = 0.6
    """The picture wanders smoothly by this much (standard deviation, at 640 pixels width), so that edges are ragged."""
    lateral_spacing_px: float = 10.0
    """Distance over which it wanders, at 640 pixels width."""
    edge_dropout: float = 0.4
    """Share of pixels lost at depth jumps of more than 5 %."""
    grazing_cosine: float = 0.22
    """Surfaces seen at a flatter angle (cosine to the normal below this) lose pixels, up to ``grazing_dropout``."""
    grazing_dropout: float = 0.85

    def sigma_m(self, z_m: NDArray) -> NDArray:
        """Return the axial standard deviation at depth z, metres."""
        return self.sigma_floor_m + self.sigma_growth_per_m * (z_m - 0.4) ** 2


def sense(
    depth_m: NDArray, incidence: NDArray, instance: NDArray, sensor: DepthSensor, rng: np.random.Generator
) -> tuple[NDArray, NDArray]:
    """Turn exact depth into a measurement, and tell which object each pixel of it was measured on.

    Args:
        depth_m: float32 [H, W], metres along the optical axis, 0 = nothing hit.
        incidence: float32 [H, W], cosine between the ray and the surface normal, 0-1.
        instance: uint8 [H, W], exact instance ids, 0 = nothing hit.
        sensor: How to spoil it.
        rng: Source of all randomness.

    Returns:
        Depth uint16 [H, W], millimetres, 0 = not measured; and instance ids uint8 [H, W] of what was measured: where
        the depth wanders over an edge, the id wanders with it, so that the highest point of a cell has its own id.
    """
    measured = depth_m
    if sensor.enabled:
        height, width = depth_m.shape
        u, v = _wandering(height, width, sensor, rng)
        seen = cv2.remap(depth_m, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        instance = cv2.remap(instance, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        measured = seen + sensor.sigma_m(seen) * rng.standard_normal(depth_m.shape, dtype=np.float32)
        square = np.ones((3, 3), dtype=np.uint8)
        jump = cv2.dilate(depth_m, square) - cv2.erode(depth_m, square) > 0.05 * depth_m
        grazing = np.clip(1.0 - incidence / sensor.grazing_cosine, 0.0, 1.0) * sensor.grazing_dropout
        chance = np.where(jump, np.maximum(grazing, sensor.edge_dropout), grazing)
        lost = (rng.random(depth_m.shape, dtype=np.float32) < chance) | (seen <= 0)
        measured = np.where(lost, 0.0, measured)
    measured = np.where((measured >= sensor.near_m) & (measured <= sensor.far_m), measured, 0.0)
    return np.round(measured * 1000.0).astype(np.uint16), instance


def _wandering(height: int, width: int, sensor: DepthSensor, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Return, for every pixel, the (u, v) it really shows; float32 [H, W] each."""
    scale = width / 640.0
    spacing = max(2.0, sensor.lateral_spacing_px * scale)
    control = (2, int(height / spacing) + 2, int(width / spacing) + 2)
    v, u = np.mgrid[:height, :width].astype(np.float32)
    draws = rng.standard_normal(control, dtype=np.float32) * np.float32(sensor.lateral_sigma_px * scale)
    du, dv = (cv2.resize(draw, (width, height), interpolation=cv2.INTER_CUBIC) for draw in draws)
    return u + du, v + dv
