"""Ray casting with Embree: exact depth and instance ids, and what the light needs to know about every pixel."""

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from simaps_viz.scenes.lighting import Light, shade
from simaps_viz.scenes.materials import Texture
from simaps_viz.scenes.scene import Scene
from simaps_viz.structures import Intrinsics


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
