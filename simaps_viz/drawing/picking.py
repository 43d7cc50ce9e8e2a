"""From a click to a place on the map, and from an instance to the frames that show it best."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.drawing.solids import block_heights
from simaps_viz.structures import SIMap


def ray_on_floor(origin: ArrayLike, direction: ArrayLike) -> tuple[float, float] | None:
    """Meet a ray (map frame, metres) with the floor z = 0; None when it never comes down to it."""
    o, d = np.asarray(origin, np.float64), np.asarray(direction, np.float64)
    if o[2] * d[2] >= 0.0:
        return None
    hit = o - d * (o[2] / d[2])
    return float(hit[0]), float(hit[1])


def ray_on_blocks(simap: SIMap, origin: ArrayLike, direction: ArrayLike) -> tuple[float, float] | None:
    """Meet a ray with the blocks of the 3-D view; where it meets none, with the floor.

    The ray is followed from the highest block down in steps of half a cell; the answer is good to a cell.
    """
    o, d = np.asarray(origin, np.float64), np.asarray(direction, np.float64)
    floor = ray_on_floor(o, d)
    if floor is None:
        return None
    d = d / np.linalg.norm(d)
    height = block_heights(simap)
    top = float(height.max(initial=0.0))
    start = max(0.0, (top - o[2]) / d[2])
    stop = -o[2] / d[2]
    steps = np.arange(start, stop, simap.spec.cell_size_m / 2.0)
    points = o + steps[:, None] * d
    col = np.floor((points[:, 0] - simap.spec.x0_m) / simap.spec.cell_size_m).astype(int)
    row = np.floor((points[:, 1] - simap.spec.y0_m) / simap.spec.cell_size_m).astype(int)
    inside = (row >= 0) & (row < simap.spec.rows) & (col >= 0) & (col < simap.spec.cols)
    met = np.zeros(len(steps), bool)
    met[inside] = points[inside, 2] <= height[row[inside], col[inside]]
    if not met.any():
        return floor
    first = points[int(met.argmax())]
    return float(first[0]), float(first[1])


def owner_of_community(simap: SIMap) -> NDArray:
    """Return int32 [communities + 1]: the instance that each finest community belongs to now, 0 = none."""
    size = max(int(simap.community.max(initial=0)), int(simap.views.community.max(initial=0))) + 1
    owner = np.zeros(size, np.int32)
    inside = simap.community > 0
    owner[simap.community[inside]] = simap.instance[inside]
    owner[0] = 0
    return owner


@dataclass(frozen=True)
class BestView:
    """A frame that shows an instance well."""

    frame: int
    """Index into ``SIMap.frame_names``."""
    segments: tuple[int, ...]
    """Ids in that frame's segmentation."""
    cells: int
    """Cells of the instance that the frame named."""


def best_views(simap: SIMap, instance_id: int, most: int = 3) -> list[BestView]:
    """Return the frames that named most cells of an instance, best first (ties: the earlier frame).

    Frames next to one another show the same, so one within a twentieth of the sequence of a better one is passed over
    while there are others.
    """
    views = simap.views
    mine = owner_of_community(simap)[views.community] == instance_id
    frames, cells, segments = views.frame[mine], views.cells[mine], views.segment[mine]
    names = np.unique(frames)
    totals = np.array([int(cells[frames == f].sum()) for f in names])
    ranked = [int(names[i]) for i in np.lexsort((names, -totals))]
    apart = len(simap.frame_names) // 20
    chosen: list[int] = []
    for frame in ranked:
        if len(chosen) < most and all(abs(frame - other) > apart for other in chosen):
            chosen.append(frame)
    chosen += [f for f in ranked if f not in chosen][: most - len(chosen)]
    chosen.sort(key=ranked.index)
    return [
        BestView(f, tuple(int(s) for s in np.unique(segments[frames == f])), int(cells[frames == f].sum()))
        for f in chosen
    ]


def communities_unseen_until(simap: SIMap, frame: int) -> NDArray:
    """Return the finest communities that no segment had named up to and with a frame, int32 [n]."""
    known = np.unique(simap.views.community[simap.views.frame <= frame])
    every = np.unique(simap.community[simap.community > 0])
    return np.setdiff1d(every, known).astype(np.int32)
