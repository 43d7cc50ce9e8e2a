"""PLY of the scene, binary: coloured columns, or the recording's points; map frame, metres, z up.

PLY knows no objects, so every vertex carries the id of its instance, and the header names them in comments.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import node_name
from simaps_viz.exports.scene import Cloud, cloud_asked_for, parts
from simaps_viz.structures import SIMap

_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgba", "u1", 4), ("instance", "<i4")])
_FACE = np.dtype([("corners", "u1"), ("vertices", "<i4", 3)])


class PLY(Exporter):
    """The scene as binary PLY."""

    endings = own_endings = (".ply",)
    options = ("points",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return the scene as points where a sequence is given, else as columns."""
        cloud = cloud_asked_for(simap, options)
        return {path: ply_bytes(simap) if cloud is None else ply_points_bytes(simap, cloud)}


def ply_bytes(simap: SIMap) -> bytes:
    """Return the scene as a mesh; instance 0 is what belongs to no instance."""
    meshes = list(parts(simap))
    vertices = [_vertices(p.vertices, np.tile(p.color, (len(p.vertices), 1)), p.instance) for p in meshes]
    starts = np.cumsum([0, *(len(v) for v in vertices[:-1])])
    faces = np.concatenate([p.faces + start for p, start in zip(meshes, starts, strict=True)])
    record = np.zeros(len(faces), _FACE)
    record["corners"], record["vertices"] = 3, faces
    return _ply(simap, np.concatenate(vertices), record)


def ply_points_bytes(simap: SIMap, cloud: Cloud) -> bytes:
    """Return the recording's points in their own colours."""
    return _ply(simap, _vertices(cloud.xyz_m, cloud.rgb, cloud.instance), None)


def _vertices(xyz_m: NDArray, rgb: NDArray, instance: NDArray | int) -> NDArray:
    record = np.zeros(len(xyz_m), _VERTEX)
    record["xyz"], record["rgba"][:, :3], record["rgba"][:, 3] = xyz_m, rgb, 255
    record["instance"] = instance
    return record


def _ply(simap: SIMap, vertices: NDArray, faces: NDArray | None) -> bytes:
    names = {one.id: " ".join(node_name(one).split()) for one in simap.instances}  # a line each
    comments: Iterable[str] = (f"comment instance {number} {name}" for number, name in names.items())
    header = [
        "ply", "format binary_little_endian 1.0", "comment map frame: metres, x east, y north, z up", *comments,
        f"element vertex {len(vertices)}", *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {channel}" for channel in ("red", "green", "blue", "alpha")), "property int instance",
    ]  # fmt: skip
    if faces is not None:
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    body = vertices.tobytes() + (faces.tobytes() if faces is not None else b"")
    return ("\n".join([*header, "end_header"]) + "\n").encode() + body
