"""A scene: named objects, each with its triangles, joined into the arrays a ray caster wants."""

import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from simaps_viz.colors.classes import is_thing
from simaps_viz.scenes.materials import Texture
from simaps_viz.scenes.shapes import Model, Part, corner_normals, moved


@dataclass(frozen=True, eq=False)
class SceneObject:
    """One object where it stands, or one piece of the building."""

    name: str
    label: str
    parts: tuple[Part, ...]
    """World frame, metres."""
    T_world_object: NDArray
    """float64 [4, 4], the object's own frame to the world; identity for the building."""

    @property
    def is_thing(self) -> bool:
        """Countable (chair), not stuff (floor)."""
        return is_thing(self.label)

    @property
    def bounds_m(self) -> NDArray:
        """float64 [2, 3], lowest and highest corner, world frame."""
        corners = np.concatenate([part.mesh.bounds for part in self.parts])
        return np.stack([corners.min(axis=0), corners.max(axis=0)])


def place(
    name: str, label: str, model: Model, x: float, y: float, z: float = 0.0, *, yaw_deg: float = 0.0
) -> SceneObject:
    """Put a model into the world and give it a slight tint of its own, which follows from its name."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    hue, gain = rng.uniform(-0.05, 0.05), rng.uniform(0.88, 1.12)
    tinted = [Part(part.mesh, part.material.shifted(hue, gain)) for part in model]
    pose = trimesh.transformations.rotation_matrix(np.deg2rad(yaw_deg), [0, 0, 1])
    pose[:3, 3] = (x, y, z)
    parts = moved(tinted, x, y, z, yaw_rad=float(np.deg2rad(yaw_deg)))
    return SceneObject(name=name, label=label, parts=tuple(parts), T_world_object=pose)


def build(name: str, label: str, model: Model) -> SceneObject:
    """Take a piece of the building as it is, already in the world frame."""
    return SceneObject(name=name, label=label, parts=tuple(model), T_world_object=np.eye(4))


@dataclass(frozen=True, eq=False)
class Scene:
    """All objects and, face by face, their joined triangles. Object ``objects[i]`` has instance id i + 1."""

    objects: tuple[SceneObject, ...]
    triangles_m: NDArray
    """float32 [F, 3, 3], world frame."""
    normals: NDArray
    """float32 [F, 3, 3], shading normal of every corner, unit."""
    face_normals: NDArray
    """float32 [F, 3], true normal of every face, unit."""
    color: NDArray
    """float32 [F, 3], linear RGB reflectance."""
    texture: NDArray
    """uint8 [F], ``materials.Texture``."""
    instance: NDArray
    """uint8 [F], instance id, >= 1."""
    rooms_m: tuple[tuple[float, float, float, float], ...] = ()
    """West, south, east and north end of each room: lamps do not shine from one into another. None: all is one."""
    lights_m: tuple[tuple[float, float, float], ...] = ()
    """Plain lights without a visible lamp, world frame."""

    @cached_property
    def main_axis(self) -> NDArray:
        """The axis (0 x, 1 y, 2 z) along which each face [F] looks most, int8; textures are laid along the others."""
        return np.abs(self.face_normals).argmax(axis=1).astype(np.int8)

    @property
    def lets_light_through(self) -> NDArray:
        """Return which faces [F] cast no shadow, bool: panes and lamps."""
        return np.isin(self.texture, (int(Texture.SKY), int(Texture.GLOW)))

    def table(self) -> dict[str, Any]:
        """Return what ``scene.json`` holds: units, up and the list of instances."""
        rows = []
        for i, scene_object in enumerate(self.objects):
            low, high = scene_object.bounds_m.round(4).tolist()
            rows.append(
                {
                    "id": i + 1,
                    "name": scene_object.name,
                    "label": scene_object.label,
                    "isthing": scene_object.is_thing,
                    "pose": scene_object.T_world_object.round(6).tolist(),
                    "aabb_min": low,
                    "aabb_max": high,
                }
            )
        return {"units": "metre", "up": "+z", "instances": rows}


def assemble(
    objects: list[SceneObject],
    *,
    rooms_m: tuple[tuple[float, float, float, float], ...] = (),
    lights_m: tuple[tuple[float, float, float], ...] = (),
) -> Scene:
    """Join the objects' triangles; raises ValueError when ids would not fit into 8 bits or names repeat."""
    if len(objects) > 255 or len({o.name for o in objects}) != len(objects):
        raise ValueError("a scene holds at most 255 objects, each with a name of its own")
    pieces = [(i + 1, part) for i, o in enumerate(objects) for part in o.parts]
    counts = [len(part.mesh.faces) for _, part in pieces]
    return Scene(
        objects=tuple(objects),
        triangles_m=np.concatenate([part.mesh.triangles for _, part in pieces]).astype(np.float32),
        normals=np.concatenate([corner_normals(part.mesh) for _, part in pieces]),
        face_normals=np.concatenate([part.mesh.face_normals for _, part in pieces]).astype(np.float32),
        color=np.repeat(np.array([part.material.color for _, part in pieces], dtype=np.float32), counts, axis=0),
        texture=np.repeat(np.array([part.material.texture for _, part in pieces], dtype=np.uint8), counts),
        instance=np.repeat(np.array([i for i, _ in pieces], dtype=np.uint8), counts),
        rooms_m=rooms_m,
        lights_m=lights_m,
    )
