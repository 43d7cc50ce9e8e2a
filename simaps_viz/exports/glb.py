"""Binary glTF of the scene with a named node for every instance.

glTF is y up; the map is z up. The geometry stays in the map frame (metres, z up), and the node ``map``, the parent
of all others, rotates it: x stays, map z becomes glTF y, map y (north) becomes glTF -z.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import node_name, record, space_record
from simaps_viz.exports.scene import UNLABELLED, Cloud, cloud_asked_for, parts, surfaces
from simaps_viz.mapping.in_space import all_instances, has_voxels
from simaps_viz.structures import SIMap

T_GLTF_MAP: Final = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
ROOT: Final = "map"


class GLB(Exporter):
    """The scene as binary glTF."""

    endings = own_endings = (".glb",)
    options = ("points",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return the scene as points where a sequence is given, else as meshes."""
        cloud = cloud_asked_for(simap, options)
        return {path: glb_bytes(simap) if cloud is None else glb_points_bytes(simap, cloud)}


def glb_bytes(simap: SIMap) -> bytes:
    """Return the scene with a node for each instance ("chair-7") and each other class ("floor").

    They are the faces of its voxels, coloured as seen, or on a map without voxels columns.
    """
    import trimesh  # noqa: PLC0415 - slow to import, and only two formats need it
    from trimesh.visual import TextureVisuals  # noqa: PLC0415 - as above
    from trimesh.visual.material import PBRMaterial  # noqa: PLC0415 - as above

    scene = _scene()
    extras = {one.id: {**record(simap, one), **space_record(one)} for one in all_instances(simap)}
    if has_voxels(simap):
        for part in surfaces(simap):
            mesh = trimesh.Trimesh(part.vertices, part.faces, process=False, vertex_colors=_linear(part.rgb))
            _add(scene, mesh, part.name, extras.get(part.instance, {"label": part.label}))
        return _export(scene)
    for part in parts(simap):
        material = PBRMaterial(
            name=part.name, baseColorFactor=_linear(part.color), metallicFactor=0.0, roughnessFactor=0.9
        )
        mesh = trimesh.Trimesh(part.vertices, part.faces, process=False, visual=TextureVisuals(material=material))
        _add(scene, mesh, part.name, extras.get(part.instance, {"label": part.label}))
    return _export(scene)


def glb_points_bytes(simap: SIMap, cloud: Cloud) -> bytes:
    """Return the recording's points in their own colours, a node for each instance and one for the rest."""
    import trimesh  # noqa: PLC0415 - as above

    scene = _scene()
    for one in simap.instances:
        mine = cloud.instance == one.id
        if mine.any():
            points = trimesh.PointCloud(cloud.xyz_m[mine], colors=cloud.rgb[mine])
            _add(scene, points, node_name(one), record(simap, one))
    rest = cloud.instance == 0
    if rest.any():
        _add(scene, trimesh.PointCloud(cloud.xyz_m[rest], colors=cloud.rgb[rest]), UNLABELLED, {})
    return _export(scene)


def _scene() -> Any:
    import trimesh  # noqa: PLC0415 - as above

    scene = trimesh.Scene()
    scene.graph.update(frame_from=scene.graph.base_frame, frame_to=ROOT, matrix=T_GLTF_MAP)
    return scene


def _add(scene: Any, geometry: Any, name: str, extras: dict[str, Any]) -> None:
    geometry.metadata.update(extras)
    scene.add_geometry(geometry, node_name=name, geom_name=name, parent_node_name=ROOT)


def _export(scene: Any) -> bytes:
    return bytes(scene.export(file_type="glb"))


def _linear(color: Color | NDArray) -> NDArray:
    """Return RGB, [..., 3], as RGBA uint8 in linear light, which glTF factors and colours are in (IEC 61966-2-1)."""
    c = np.asarray(color) / 255.0
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    opaque = np.ones((*c.shape[:-1], 1))
    return np.round(np.concatenate([linear, opaque], axis=-1) * 255.0).astype(np.uint8)
