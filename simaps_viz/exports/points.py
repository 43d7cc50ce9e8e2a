"""The recording's depth pixels as one coloured point cloud, each point with the instance of its cell."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource
from simaps_viz.events import Progress
from simaps_viz.geometry import back_project, transform_points
from simaps_viz.structures import Frame, SIMap

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
class Cloud:
    """Coloured points."""

    xyz_m: NDArray
    """float32 [n, 3], map frame."""
    rgb: NDArray
    """uint8 [n, 3]."""
    instance: NDArray
    """int32 [n], 0 = none."""


def gather_points(
    simap: SIMap, sequence: FrameSource, *, cut_height_m: float = 2.0, progress: Progress | None = None
) -> Cloud:
    """Read points of a map's sequence, thinned; what is higher than the cut is left out, as on the map.

    Raises:
        InputError: a frame cannot be read.
    """
    chosen = sorted({int(i) for i in np.linspace(0, len(sequence) - 1, min(FRAMES, len(sequence)))})
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
    return Cloud(points[kept].astype(np.float32), colors[kept], _instances(simap, points[kept]))


def _one_a_voxel(points: NDArray) -> NDArray:
    """Return the positions, ascending, of the first point in each cube."""
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


def _instances(simap: SIMap, xyz_m: NDArray) -> NDArray:
    spec = simap.spec
    cell = np.floor((xyz_m[:, 1::-1] - (spec.y0_m, spec.x0_m)) / spec.cell_size_m).astype(np.int64)
    inside = np.asarray(((cell >= 0) & (cell < spec.shape)).all(axis=1))
    row, col = np.where(inside[:, None], cell, 0).T
    lies = (xyz_m[:, 2] <= ON_FLOOR_M) & (simap.grid.height_m[row, col] > 2 * ON_FLOOR_M)
    return np.where(inside & ~lies, simap.instance[row, col], 0).astype(np.int32)
