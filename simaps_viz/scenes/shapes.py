"""The solids furniture is made of. Metres; z up; x forward (the side a person uses); every solid is a trimesh."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from simaps_viz.scenes.materials import Material

SMOOTH_ANGLE_RAD = np.deg2rad(48.0)
"""Faces that meet at less than this are shaded as one curved surface."""


@dataclass(frozen=True, eq=False)
class Part:
    """One solid of one material."""

    mesh: trimesh.Trimesh
    material: Material


Model = list[Part]
"""The parts of one object, in its own frame: origin on the floor under its middle."""


def box(size: ArrayLike, centre: ArrayLike, material: Material, *, tilt_rad: float = 0.0) -> Part:
    """Make a box of full sizes (x, y, z), turned by ``tilt_rad`` about its own y axis (top goes towards +x)."""
    transform = trimesh.transformations.rotation_matrix(tilt_rad, [0, 1, 0])
    transform[:3, 3] = np.asarray(centre, dtype=float)
    return Part(trimesh.creation.box(extents=np.asarray(size, dtype=float), transform=transform), material)


def cushion(
    size: ArrayLike, centre: ArrayLike, material: Material, *, radius: float = 0.03, tilt_rad: float = 0.0
) -> Part:
    """Make a box with rounded edges: the hull of eight small spheres in its corners."""
    half = np.asarray(size, dtype=float) / 2
    r = min(radius, float(half.min()) * 0.98)
    ball = trimesh.creation.icosphere(subdivisions=1, radius=r).vertices
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    points = ((signs * (half - r))[:, None, :] + ball[None]).reshape(-1, 3)
    mesh = trimesh.convex.convex_hull(points)
    transform = trimesh.transformations.rotation_matrix(tilt_rad, [0, 1, 0])
    transform[:3, 3] = np.asarray(centre, dtype=float)
    mesh.apply_transform(transform)
    return Part(mesh, material)


def turned(profile: Sequence[tuple[float, float]], material: Material, *, sections: int = 28) -> Part:
    """Turn a profile of (radius, height) points about the z axis, as on a lathe, from bottom to top."""
    mesh = trimesh.creation.revolve(np.asarray(profile, dtype=float), sections=sections)
    return Part(mesh, material)


def disc(radius: float, z_low: float, z_high: float, material: Material, *, sections: int = 32) -> Part:
    """Make an upright cylinder."""
    return turned([(0, z_low), (radius, z_low), (radius, z_high), (0, z_high)], material, sections=sections)


def ellipsoid(radii: ArrayLike, centre: ArrayLike, material: Material, *, subdivisions: int = 2) -> Part:
    """Make an ellipsoid of half axes (x, y, z)."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    mesh.apply_scale(np.asarray(radii, dtype=float))
    mesh.apply_translation(np.asarray(centre, dtype=float))
    return Part(mesh, material)


def loft(rings: NDArray, material: Material) -> Part:
    """Skin a row of closed rings [k, m, 3] and close both ends with fans."""
    k, m = rings.shape[:2]
    ring, corner = np.mgrid[: k - 1, :m]
    a = ring * m + corner
    b = ring * m + (corner + 1) % m
    sides = np.concatenate([np.stack([a, b, b + m], -1).reshape(-1, 3), np.stack([a, b + m, a + m], -1).reshape(-1, 3)])
    caps = []
    for start, hub in ((0, k * m), ((k - 1) * m, k * m + 1)):
        rim = start + np.arange(m)
        caps.append(np.stack([np.full(m, hub), np.roll(rim, -1), rim], -1))
    vertices = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)])
    return Part(trimesh.Trimesh(vertices, np.concatenate([sides, *caps]), process=False), material)


def tube(
    points: ArrayLike, radius: float | Sequence[float], material: Material, *, sides: int = 10, closed: bool = False
) -> Part:
    """Make a round bar along a polyline [n, 3]; one radius for all points or one each; ``closed`` joins the ends."""
    path = np.asarray(points, dtype=float)
    if closed:
        path = np.concatenate([path, path[:1]])
    along = np.gradient(path, axis=0)
    if closed:
        along[0] = along[-1] = path[1] - path[-2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    radii = np.broadcast_to(np.asarray(radius, dtype=float), (len(path),))
    reference = np.array([0.0, 0.0, 1.0]) if np.abs(along[:, 2]).max() < 0.9 else np.array([0.6, 0.8, 0.0])
    if np.abs(along @ reference).max() > 0.97:
        reference = np.array([0.8, -0.6, 0.0])
    across = np.cross(along, reference)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(along, across)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    circle = across[:, None] * np.cos(angle)[None, :, None] + third[:, None] * np.sin(angle)[None, :, None]
    return loft(path[:, None] + radii[:, None, None] * circle, material)


def leg(foot: ArrayLike, head: ArrayLike, material: Material, *, radius: float = 0.017, taper: float = 0.75) -> Part:
    """Make a tapered round leg from the floor (thinner) to the seat or top."""
    return tube(np.array([foot, head], dtype=float), [radius * taper, radius], material)


def curved_panel(
    size: ArrayLike, centre: ArrayLike, material: Material, *, sag: float, tilt_rad: float = 0.0, segments: int = 8
) -> Part:
    """Make a panel of thickness x, width y, height z whose two edges bend forward (+x) by ``sag``: a chair's back."""
    thickness, width, height = np.asarray(size, dtype=float)
    y = np.linspace(-width / 2, width / 2, segments + 1)
    bend = sag * (2 * y / width) ** 2
    t, h = thickness / 2, height / 2
    corners = np.array([[-t, -h], [t, -h], [t, h], [-t, h]])
    rings = np.zeros((segments + 1, 4, 3))
    rings[:, :, 0] = corners[:, 0] + bend[:, None]
    rings[:, :, 1] = y[:, None]
    rings[:, :, 2] = corners[:, 1]
    part = loft(rings, material)
    transform = trimesh.transformations.rotation_matrix(tilt_rad, [0, 1, 0])
    transform[:3, 3] = np.asarray(centre, dtype=float)
    part.mesh.apply_transform(transform)
    return part


def leaf(base: ArrayLike, tip: ArrayLike, width: float, material: Material, *, droop: float = 0.0) -> Part:
    """Make a pointed leaf from base to tip, its middle lifted so that the tip hangs by ``droop`` metres."""
    start, end = np.asarray(base, dtype=float), np.asarray(tip, dtype=float)
    t = np.linspace(0, 1, 6)
    spine = start + (end - start) * t[:, None]
    spine[:, 2] += droop * 4 * t * (1 - t)
    across = np.cross(end - start, [0.0, 0.0, 1.0])
    if np.linalg.norm(across) < 1e-6:
        across = np.array([1.0, 0.0, 0.0])
    across = across / np.linalg.norm(across) * width / 2
    profile = np.array([0.12, 0.75, 1.0, 0.9, 0.55, 0.02])[:, None]
    fold = np.array([0.0, 0.0, 0.18 * width])
    vertices = np.stack([spine + profile * (across + fold), spine, spine - profile * (across - fold)], axis=1)
    faces = []
    for i in range(len(t) - 1):
        for j in range(2):
            a, b = 3 * i + j, 3 * i + j + 1
            faces += [[a, b, b + 3], [a, b + 3, a + 3]]
    return Part(trimesh.Trimesh(vertices.reshape(-1, 3), faces, process=False), material)


def moved(parts: Model, x: float, y: float, z: float = 0.0, *, yaw_rad: float = 0.0) -> Model:
    """Copy a model, turned about z by ``yaw_rad`` and then shifted."""
    pose = trimesh.transformations.rotation_matrix(yaw_rad, [0, 0, 1])
    pose[:3, 3] = (x, y, z)
    return [Part(part.mesh.copy().apply_transform(pose), part.material) for part in parts]


def corner_normals(mesh: trimesh.Trimesh) -> NDArray:
    """Return the shading normal of every corner of every face, float32 [faces, 3, 3].

    A corner's normal is the area-weighted mean over those faces round its vertex that meet this face at less
    than ``SMOOTH_ANGLE_RAD``; so a cylinder's side is smooth and its rim is sharp.
    """
    faces, normals = mesh.faces, mesh.face_normals
    weighted = normals * mesh.area_faces[:, None]
    order = np.argsort(faces.ravel(), kind="stable")
    vertex = faces.ravel()[order]
    face = order // 3
    starts = np.searchsorted(vertex, np.arange(len(mesh.vertices)))
    degree = np.bincount(vertex, minlength=len(mesh.vertices))
    total = np.zeros((len(order), 3))
    for step in range(int(degree.max())):
        other = face[starts[vertex] + np.minimum(step, degree[vertex] - 1)]
        smooth = (step < degree[vertex]) & ((normals[other] * normals[face]).sum(-1) > np.cos(SMOOTH_ANGLE_RAD))
        total += np.where(smooth[:, None], weighted[other], 0.0)
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.where(lengths > 1e-12, total / np.maximum(lengths, 1e-12), normals[face])
    corners = np.zeros((len(order), 3), dtype=np.float32)
    corners[order] = total
    return corners.reshape(-1, 3, 3)
