"""PLY of the scene, binary: coloured columns, the recording's points, or surface voxels; map frame, metres, z up.

PLY knows no objects, so every vertex carries the id of its instance, and the header names them in comments.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import node_name
from simaps_viz.exports.scene import Cloud, cloud_asked_for, parts
from simaps_viz.mapping.in_space import has_voxels, space_points
from simaps_viz.structures import SIMap

_COLORED = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
_VERTEX = np.dtype([*_COLORED, ("alpha", "u1"), ("instance", "<i4")])
_VOXEL = np.dtype([*_COLORED, ("class", "<i4"), ("instance", "<i4")])
_FACE = np.dtype([("corners", "u1"), ("vertices", "<i4", 3)])
_TYPES = {"<f4": "float", "|u1": "uchar", "<i4": "int"}


class PLY(Exporter):
    """The scene as binary PLY."""

    endings = own_endings = (".ply",)
    options = ("points",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return the scene as points where a sequence is given, else as columns."""
        cloud = cloud_asked_for(simap, options)
        return {path: ply_bytes(simap) if cloud is None else ply_points_bytes(simap, cloud)}


class Instances(Exporter):
    """The surface voxels with class and instance, as binary PLY."""

    endings = (".ply",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return one vertex for each surface voxel: x, y, z, red, green, blue, class (-1 none), instance (0 none)."""
        points = space_points(simap)
        made_of = "observed surface voxels" if has_voxels(simap) else "filled columns: the map has no voxels"
        classes = (f"class {i} {' '.join(name.split())}" for i, name in enumerate(simap.grid.labels) if i)
        columns = (*points.positions.T, *points.colors.T, points.classes, points.instances)
        return {path: _ply([made_of, *classes], _table(_VOXEL, *columns))}


def ply_bytes(simap: SIMap) -> bytes:
    """Return the scene as a mesh; instance 0 is what belongs to no instance."""
    meshes = list(parts(simap))
    vertices = [_table(_VERTEX, *p.vertices.T, *p.color, 255, p.instance) for p in meshes]
    starts = np.cumsum([0, *(len(v) for v in vertices[:-1])])
    faces = np.concatenate([p.faces + start for p, start in zip(meshes, starts, strict=True)])
    return _ply(_names(simap), np.concatenate(vertices), _table(_FACE, 3, faces))


def ply_points_bytes(simap: SIMap, cloud: Cloud) -> bytes:
    """Return the recording's points in their own colours."""
    return _ply(_names(simap), _table(_VERTEX, *cloud.xyz_m.T, *cloud.rgb.T, 255, cloud.instance))


def _names(simap: SIMap) -> list[str]:
    return [f"instance {one.id} {' '.join(node_name(one).split())}" for one in simap.instances]  # a line each


def _table(dtype: np.dtype, *columns: NDArray | int) -> NDArray:
    """Return the rows of a dtype, of which each column is an array or one number for all."""
    rows = np.zeros(max(np.shape(column)[0] for column in columns if np.ndim(column)), dtype)
    for name, column in zip(dtype.names or (), columns, strict=True):
        rows[name] = column
    return rows


def _ply(comments: Iterable[str], vertices: NDArray, faces: NDArray | None = None) -> bytes:
    types = vertices.dtype
    header = [
        "ply", "format binary_little_endian 1.0", "comment map frame: metres, x east, y north, z up",
        *(f"comment {comment}" for comment in comments), f"element vertex {len(vertices)}",
        *(f"property {_TYPES[types[name].str]} {name}" for name in types.names or ()),
    ]  # fmt: skip
    if faces is not None:
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    body = vertices.tobytes() + (faces.tobytes() if faces is not None else b"")
    return ("\n".join([*header, "end_header"]) + "\n").encode() + body
