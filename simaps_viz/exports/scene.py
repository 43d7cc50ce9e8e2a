"""The scene in 3-D, as binary glTF and as PLY: the map as solid columns or surface voxels, or the recording's points.

As columns, every cell reaches from the floor to its height, one mesh for each instance or class. As points, the depth
pixels of the recording are one coloured cloud, each point with the instance of its cell.

glTF has a named node for every instance. It is y up; the map is z up. The geometry stays in the map frame (metres, z
up), and the node ``map``, the parent of all others, rotates it: x stays, map z becomes glTF y, map y (north) becomes
glTF -z. PLY, in the map frame, knows no objects, so every vertex carries the id of its instance, and the header names
them in comments.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.instances import color_of_instance
from simaps_viz.colors.palette import Color
from simaps_viz.datasets.source import FrameSource
from simaps_viz.events import Progress
from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import label_colors, node_name, record, space_record
from simaps_viz.geometry import back_project, spread, transform_points
from simaps_viz.mapping.in_space import VOXEL_M as VOXEL_EDGE_M
from simaps_viz.mapping.in_space import all_instances, has_voxels, space_points
from simaps_viz.structures import Frame, GridSpec, SIMap

UNLABELLED: Final = "unlabelled"
UNLABELLED_COLOR: Final = (110, 110, 116)
_SIDES: Final = {  # towards a neighbour (row, col): lower edge from, to, seen from outside left to right, as (x, y)
    (-1, 0): ((0, 0), (1, 0)),
    (0, 1): ((1, 0), (1, 1)),
    (1, 0): ((1, 1), (0, 1)),
    (0, -1): ((0, 1), (0, 0)),
}
FRAMES: Final = 60
"""Spread evenly over the recording."""
STRIDE: Final = 2
"""Every other pixel of every other row."""
VOXEL_M: Final = 0.02
"""One point is kept in each cube of this edge: the first."""
NEAR_M, FAR_M, BELOW_M = 0.1, 6.0, 0.3
ON_FLOOR_M: Final = 0.05
"""Points no higher than this belong to no instance, unless it is as flat itself."""


@dataclass(frozen=True, eq=False)
class Part:
    """One named mesh."""

    name: str
    label: str
    instance: int
    """0 for a class without instances."""
    color: Color
    vertices: NDArray
    """float64 [n, 3], map frame, metres."""
    faces: NDArray
    """int64 [m, 3], counter-clockwise from outside."""


def parts(simap: SIMap) -> Iterator[Part]:
    """Yield a closed mesh for each instance, then one for the rest of each class; cells never seen have none.

    A column reaches from the floor (or from the part's lowest cell, should it lie below) to the height of its cell, so
    an instance's volume is the sum of its cells' areas times their heights. What hangs below a table top is not known.
    Meshes of classes have no underside, which is never visible.
    """
    for one in simap.instances:
        vertices, faces = _columns(simap, simap.instance == one.id, closed=True)
        yield Part(node_name(one), one.label, one.id, color_of_instance(simap, one.id), vertices, faces)
    colors = label_colors(simap)
    rest = (simap.instance == 0) & ~np.isnan(simap.grid.height_m)
    for index in np.unique(simap.grid.label[rest]).tolist():
        label = simap.grid.labels[index] if index else UNLABELLED
        name = f"{label}-unassigned" if index and simap.grid.is_thing[index] else label
        color = colors[index] if index else UNLABELLED_COLOR
        yield Part(name, label, 0, color, *_columns(simap, rest & (simap.grid.label == index), closed=False))


@dataclass(frozen=True, eq=False)
class Surface:
    """One named mesh of voxels, coloured as seen."""

    name: str
    label: str
    instance: int
    vertices: NDArray
    """float64 [n, 3], map frame, metres."""
    rgb: NDArray
    """uint8 [n, 3]."""
    faces: NDArray
    """int64 [m, 3], counter-clockwise from outside."""


def surfaces(simap: SIMap) -> Iterator[Surface]:
    """Yield a mesh for each instance of a map with voxels, then one for the rest of each class: the voxels' faces."""
    points = space_points(simap)
    size = min(VOXEL_EDGE_M, simap.spec.cell_size_m)
    scale = np.array([size, size, VOXEL_EDGE_M])
    start = np.array([simap.spec.x0_m, simap.spec.y0_m, 0.0])
    voxel = np.floor((points.positions - start) / scale).astype(np.int64)
    group = np.where(points.instances > 0, points.instances, -1 - np.maximum(points.classes, 0))
    order = np.argsort(group, kind="stable")
    values, starts = np.unique(group[order], return_index=True)
    parts = dict(zip(values.tolist(), np.split(order, starts[1:]), strict=True)) if len(order) else {}
    names = {one.id: one for one in all_instances(simap)}
    for number in sorted(parts, key=lambda n: (n < 0, abs(n))):
        mine, one = parts[number], names.get(number)
        label = one.label if one else simap.grid.labels[-1 - number] if number < -1 else UNLABELLED
        name = node_name(one) if one else f"{label}-unassigned" if _is_thing(simap, label) else label
        corners, rgb, faces = _faces(voxel[mine], points.colors[mine])
        yield Surface(name, label, max(number, 0), corners * scale + start, rgb, faces)


def _is_thing(simap: SIMap, label: str) -> bool:
    return label in simap.grid.labels and simap.grid.is_thing[simap.grid.labels.index(label)]


def _faces(voxel: NDArray, rgb: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return corners [n, 3], colours [n, 3] and triangles of the faces between voxels (int64 [v, 3]) and none."""
    low = voxel.min(axis=0) - 1
    size = voxel.max(axis=0) - low + 2
    key = np.ravel_multi_index(tuple((voxel - low).T), tuple(size))
    taken = np.sort(key)
    quads, owners = [], []
    for axis in range(3):
        step = int(np.prod(size[axis + 1 :]))
        for sign in (-1, 1):
            beyond = key + sign * step
            at = np.minimum(np.searchsorted(taken, beyond), len(taken) - 1)
            bare = np.flatnonzero(taken[at] != beyond)
            ring = np.zeros((4, 3), np.int64)
            ring[:, (axis + 1) % 3], ring[:, (axis + 2) % 3] = (0, 1, 1, 0), (0, 0, 1, 1)
            ring[:, axis] = sign > 0
            quads.append(voxel[bare][:, None] + (ring if sign > 0 else ring[::-1]))
            owners.append(bare)
    corners, owner = np.concatenate(quads), np.repeat(np.concatenate(owners), 4)
    unique, inverse = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    # A corner has the mean colour of the voxels round it.
    count = np.bincount(inverse, minlength=len(unique))
    mean = np.stack([np.bincount(inverse, rgb[owner, c], len(unique)) / count for c in range(3)], axis=1)
    quad = inverse.reshape(-1, 4)
    return unique, np.rint(mean).astype(np.uint8), np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])


def _columns(simap: SIMap, mask: NDArray, *, closed: bool) -> tuple[NDArray, NDArray]:
    """Return vertices and faces of the columns over the cells of a mask; no faces between two columns that touch."""
    row, col = np.nonzero(mask)
    top = simap.grid.height_m[row, col].astype(np.float64)
    base = min(0.0, float(top.min()))
    heights = np.full((simap.spec.rows + 2, simap.spec.cols + 2), base)
    heights[row + 1, col + 1] = top
    lid = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    quads = [_quads(row, col, lid, top)]
    if closed:
        quads.append(_quads(row, col, lid[::-1], np.full(len(top), base)))
    for (d_row, d_col), (left, right) in _SIDES.items():
        foot = heights[row + 1 + d_row, col + 1 + d_col]
        bare = foot < top
        around = np.array([left, right, right, left])
        side = _quads(row[bare], col[bare], around, foot[bare])
        side[:, 2:, 2] = top[bare][:, None]
        quads.append(side)
    corners = np.concatenate(quads).reshape(-1, 3)
    first = np.arange(len(corners) // 4)[:, None] * 4
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    unique, inverse = np.unique(corners, axis=0, return_inverse=True)
    return _in_metres(simap.spec, unique), inverse.reshape(-1)[faces]


def _quads(row: NDArray, col: NDArray, around: NDArray, height: NDArray) -> NDArray:
    """Return corners, float64 [n, 4, 3]: x and y in cells, z in metres."""
    quads = np.zeros((len(row), 4, 3))
    quads[..., 0] = col[:, None] + around[:, 0]
    quads[..., 1] = row[:, None] + around[:, 1]
    quads[..., 2] = height[:, None]
    return quads


def _in_metres(spec: GridSpec, corners: NDArray) -> NDArray:
    scale = (spec.cell_size_m, spec.cell_size_m, 1.0)
    return corners * scale + (spec.x0_m, spec.y0_m, 0.0)


@dataclass(frozen=True, eq=False)
class Cloud:
    """Coloured points."""

    xyz_m: NDArray
    """float32 [n, 3], map frame."""
    rgb: NDArray
    """uint8 [n, 3]."""
    instance: NDArray
    """int32 [n], 0 = none."""


def cloud_asked_for(simap: SIMap, options: ExportOptions) -> Cloud | None:
    """Read the points of the sequence in the options, cut at the height at which the map was; None without one."""
    if options.points_of is None:
        return None
    cut_height_m = float(simap.parameters.get("cut_height_m", 2.0))
    return gather_points(simap, options.points_of, cut_height_m=cut_height_m, progress=options.progress)


def gather_points(
    simap: SIMap, sequence: FrameSource, *, cut_height_m: float = 2.0, progress: Progress | None = None
) -> Cloud:
    """Read the points of a map's sequence, thinned out; points above the cut are left out, as on the map.

    Raises:
        InputError: a frame cannot be read.
    """
    chosen = spread(len(sequence), FRAMES)
    xyz, rgb = [np.zeros((0, 3))], [np.zeros((0, 3), np.uint8)]
    for done, index in enumerate(chosen, start=1):
        points, colors = _of_frame(sequence.read(index, color=True), simap.T_map_world, cut_height_m)
        kept = _one_a_voxel(points)
        xyz.append(points[kept])
        rgb.append(colors[kept])
        if progress is not None:
            progress("reading points", done, len(chosen))
    points, colors = np.concatenate(xyz), np.concatenate(rgb)
    kept = _one_a_voxel(points)
    return Cloud(points[kept].astype(np.float32), colors[kept], _instance_at(simap, points[kept]))


def _one_a_voxel(points: NDArray) -> NDArray:
    """Return the indices, ascending, of the first point in each cube."""
    x, y, z = np.floor(points / VOXEL_M).astype(np.int64).T + (1 << 20)  # 20 km each way
    return np.sort(np.unique(x << 42 | y << 21 | z, return_index=True)[1])


def _of_frame(frame: Frame, T_map_world: NDArray, cut_height_m: float) -> tuple[NDArray, NDArray]:
    depth, K = frame.depth_m[::STRIDE, ::STRIDE], frame.intrinsics
    camera = back_project(depth, K.fx / STRIDE, K.fy / STRIDE, K.cx / STRIDE, K.cy / STRIDE)
    points = transform_points(T_map_world @ frame.T_world_camera, camera)
    height_m = points[..., 2]
    kept = np.logical_and.reduce([depth >= NEAR_M, depth <= FAR_M, height_m <= cut_height_m, height_m >= -BELOW_M])
    assert frame.color is not None  # it was asked for
    return points[kept], frame.color[::STRIDE, ::STRIDE][kept]


def _instance_at(simap: SIMap, xyz_m: NDArray) -> NDArray:
    spec = simap.spec
    cell = np.floor((xyz_m[:, 1::-1] - (spec.y0_m, spec.x0_m)) / spec.cell_size_m).astype(np.int64)
    inside = np.asarray(((cell >= 0) & (cell < spec.shape)).all(axis=1))
    row, col = np.where(inside[:, None], cell, 0).T
    lies = (xyz_m[:, 2] <= ON_FLOOR_M) & (simap.grid.height_m[row, col] > 2 * ON_FLOOR_M)
    return np.where(inside & ~lies, simap.instance[row, col], 0).astype(np.int32)


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
