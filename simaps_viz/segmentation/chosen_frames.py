"""Choose the frames that a network looks at: those that show what no other frame has shown, or not from there.

A network is nearly the whole cost of a build, and neighbouring frames of a walk show nearly the same. What a frame
shows is found without a network, in its depth: small cubes of space, and from which side it sees each of them.
"""

import heapq

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.geometry import back_project, transform_points

AUTO = "auto"
SHARE = 0.3
"""Of all frames, at most so many are chosen."""
CUBE_M = 0.2
SIDES = 8
"""Sectors of the compass that a cube is seen from."""
OFTEN = 8
"""A view that was chosen so often is worth nothing more: votes and evidence need several witnesses."""
FAR_M, HIGH_M = 6.0, 2.0
"""Depth that is looked at, and height over the floor, as a map's by default."""
POINTS = 3000
"""Pixels of a frame that are looked at."""
_MIDDLE = 1 << 14
_CUBES = np.array([_MIDDLE**2 * 4, _MIDDLE * 2, 1], np.int64)


def check_every(every: str) -> None:
    """Raise InputError unless this is "auto" or a whole number from 1."""
    if every != AUTO and not (every.isdecimal() and int(every) >= 1):
        raise InputError(f"--segment-every: expected auto or a whole number from 1, found {every!r}")


def choose_frames(sequence: FrameSource, every: str, progress: Progress | None = None) -> list[int] | None:
    """Choose the frames that a network looks at.

    Args:
        sequence: posed frames.
        every: "auto", by what they show; or a number n, every n-th.
        progress: notified of every frame whose depth was looked at.

    Returns:
        Indices, ascending; None: all of them.

    Raises:
        InputError: ``every`` is something else.
    """
    check_every(every)
    if every != AUTO:
        return list(range(0, len(sequence), int(every))) if int(every) > 1 else None
    views = []
    for index in range(len(sequence)):
        views.append(_views(sequence, index))
        if progress:
            progress("choosing frames", index + 1, len(sequence))
    return choose_views(views, max(1, int(SHARE * len(sequence))))


def choose_views(views: list[NDArray], most: int) -> list[int]:
    """Choose frames one by one, each time the one that adds most; ties go to the earlier.

    The first sight of a view is worth 1, the n-th 1/n, and none after `OFTEN` anything.

    Args:
        views: int64 [k], different, of each frame: what it shows.
        most: how many are chosen at most.

    Returns:
        Indices, ascending.
    """
    counts = [len(view) for view in views]
    known, number = np.unique(np.concatenate([np.zeros(0, np.int64), *views]), return_inverse=True)
    shown = np.split(number.astype(np.int32), np.cumsum(counts)[:-1]) if views else []
    worth = np.append(1.0 / np.arange(1, OFTEN + 1), 0.0)
    seen = np.zeros(len(known), np.int32)
    # What a frame adds only falls as others are chosen: one that is still ahead when counted anew is the best.
    waiting = [(-float(count), index) for index, count in enumerate(counts) if count]
    heapq.heapify(waiting)
    chosen: list[int] = []
    while waiting and len(chosen) < most:
        _, index = heapq.heappop(waiting)
        added = -float(worth[np.minimum(seen[shown[index]], OFTEN)].sum())
        if waiting and (added, index) > waiting[0]:
            heapq.heappush(waiting, (added, index))
        elif added < 0.0:
            chosen.append(index)
            seen[shown[index]] += 1
    return sorted(chosen)


def _views(sequence: FrameSource, index: int) -> NDArray:
    """Return what a frame shows as numbers, int64 [k]: a cube and the side it is seen from; none if it is damaged."""
    try:
        frame = sequence.read(index)
    except InputError:
        return np.zeros(0, np.int64)
    # every n-th pixel of every n-th row is a picture of a smaller camera
    k, step = frame.intrinsics, max(1, round(float(np.sqrt(frame.depth_m.size / POINTS))))
    depth = np.ascontiguousarray(frame.depth_m[::step, ::step])
    points = back_project(depth, k.fx / step, k.fy / step, k.cx / step, k.cy / step)
    T_map_camera = sequence.T_map_world @ frame.T_world_camera
    points = transform_points(T_map_camera, points[(depth > 0.0) & (depth < FAR_M)])
    points = points[points[:, 2] < HIGH_M]
    away = points[:, :2] - T_map_camera[:2, 3]
    side = np.floor((np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi) + 0.5) * SIDES).astype(np.int64) % SIDES
    cube = np.clip(np.floor(points / CUBE_M), -_MIDDLE, _MIDDLE - 1).astype(np.int64) + _MIDDLE
    return np.unique((cube @ _CUBES) * SIDES + side)
