"""VLMaps' building loop as its programs run it, one point after another in Python: our own re-implementation.

It is here to be measured against, and as the plain twin of `store`. What VLMaps does on whole arrays
(back-projecting, moving to the map frame) is done on whole arrays here too, and what it does point by point (finding
the cell and the feature pixel, updating the 512-D mean of the cell) point by point. It spares the loop what our
maps have no use for (colours, the overwritten height), so it is rather faster than the original than slower.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simaps_viz.baselines.vlmaps import DISTANCE_VARIANCE_M2, PixelEmbeddings, Weighting
from simaps_viz.geometry import back_project, transform_points
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.structures import Frame


@dataclass
class PointLoopMap:
    """What the loop has gathered; cells are (row, col) counted from the map's origin."""

    points: int = 0
    """Points processed, those outside the range or the cut not counted."""
    means: dict[tuple[int, int], NDArray] = field(default_factory=dict)
    """float32 [D] of every cell."""
    totals: dict[tuple[int, int], float] = field(default_factory=dict)
    """Sum of the weights of its points."""


def vlmaps_point_loop(
    frames: Iterable[tuple[Frame, PixelEmbeddings, NDArray]],
    settings: ProjectionSettings,
    *,
    stride: int,
    weighting: Weighting = "uniform",
) -> PointLoopMap:
    """Gather mean embeddings point by point.

    Args:
        frames: (frame, its embeddings, T_map_camera [4, 4]); embeddings are given, so that nobody's clock counts
            the encoder.
        settings: which pixels count, and how fine the grid is.
        stride: every so many pixels, along both axes, one counts.
        weighting: what a point counts in the mean of its cell.
    """
    gathered = PointLoopMap()
    for frame, embeddings, T_map_camera in frames:
        k = frame.intrinsics
        local = back_project(frame.depth_m, k.fx, k.fy, k.cx, k.cy)[::stride, ::stride].reshape(-1, 3)
        local = local[(local[:, 2] > settings.near_m) & (local[:, 2] < settings.far_m)]
        for point, point_camera in zip(transform_points(T_map_camera, local), local, strict=True):
            if not -settings.below_floor_m < point[2] < settings.cut_height_m:
                continue
            u = round(k.fx * point_camera[0] / point_camera[2] + k.cx)
            v = round(k.fy * point_camera[1] / point_camera[2] + k.cy)
            embedding = embeddings.index[v, u]
            if embedding < 0:
                continue
            weight = 1.0
            if weighting == "distance":
                weight = float(np.exp(-np.sum(np.square(point_camera)) / (2.0 * DISTANCE_VARIANCE_M2)))
            _take_in(gathered, point, embeddings.table[embedding], weight, settings.cell_size_m)
    return gathered


def _take_in(gathered: PointLoopMap, point: NDArray, feature: NDArray, weight: float, cell_size_m: float) -> None:
    cell = (int(np.floor(point[1] / cell_size_m)), int(np.floor(point[0] / cell_size_m)))
    gathered.points += 1
    total = gathered.totals.get(cell)
    if total is None:
        gathered.means[cell] = feature.copy()
        gathered.totals[cell] = weight
    else:
        gathered.means[cell] = (gathered.means[cell] * total + feature * weight) / (total + weight)
        gathered.totals[cell] = total + weight
