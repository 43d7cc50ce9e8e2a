"""Choose the frames that a network looks at: those that together show the map's cells best.

A network is nearly the whole cost of a build, and neighbouring frames of a walk show nearly the same. What a frame
shows is found without a network, in its depth: which cells of the map it sees, and how near to the top of each.
"""

import heapq
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.config import BuildConfig
from simaps_viz.structures import Segmentation

AUTO = "auto"
SHARE = 0.3
"""Of all frames, at most so many are chosen."""
BELOW_M, WORTH = (0.015, 0.03, 0.06), (1.0, 0.2, 0.05)
"""What a frame says of a cell is worth less, the further below the cell's top its highest pixel there lies: it may show
another surface."""


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
    # 1. The map of all frames, without classes, says how high each cell is.
    seen = MapAccumulator(("none",), (False,), ProjectionSettings(), links=False)
    for index in range(len(sequence)):
        try:
            frame = sequence.read(index)
        except InputError as error:
            seen.skip_frame(index, sequence.frame_names[index], sequence.poses[index], str(error))
        else:
            nothing = Segmentation(np.zeros(frame.depth_m.shape, np.int32), ())
            seen.add_frame(frame, nothing, sequence.T_map_world @ frame.T_world_camera)
        if progress:
            progress("choosing frames", index + 1, len(sequence))
    # 2. A frame shows the cells whose tops it saw, or nearly.
    grid = seen.snapshot()
    top, (row0, col0) = grid.height_m, seen.origin_cell
    views, worth = [], []
    for readings in (frame.readings for frame in seen.frames):
        rows, cols = readings.rows - row0, readings.cols - col0
        below = np.digitize(top[rows, cols] - readings.height_m, BELOW_M)
        near = below < len(WORTH)
        views.append((rows * grid.spec.cols + cols)[near])
        worth.append(np.array(WORTH, np.float32)[below[near]])
    return choose_views(views, worth, max(1, int(SHARE * len(sequence))))


def config_for(every: str, config: BuildConfig) -> BuildConfig:
    """Return how a map of chosen frames is built: a belief weighs as many frames less as fewer are looked at."""
    check_every(every)
    share = SHARE if every == AUTO else 1.0 / int(every)
    pooling = replace(config.pooling, imagined_pairs=share * config.pooling.imagined_pairs)
    return replace(config, pooling=pooling)


def choose_views(views: list[NDArray], worth: list[NDArray], most: int) -> list[int]:
    """Choose frames one by one, each time the one that adds most; ties go to the earlier.

    A cell that the chosen frames have shown with so much worth in all is known to 1 - exp(-worth): the first frame that
    shows its top adds .63, the second .23, the third .09.

    Args:
        views: whole numbers [k] from 0, different, of each frame: the cells that it shows.
        worth: floats [k] above 0, of each frame: how well it shows them.
        most: how many are chosen at most.

    Returns:
        Indices, ascending.
    """
    unknown = np.ones(1 + max((int(view.max(initial=-1)) for view in views), default=-1))
    # What a frame adds only falls as others are chosen: one that is still ahead when counted anew is the best.
    waiting = [(float(np.expm1(-well).sum()), index) for index, well in enumerate(worth) if len(well)]
    heapq.heapify(waiting)
    chosen: list[int] = []
    while waiting and len(chosen) < most:
        _, index = heapq.heappop(waiting)
        added = float(unknown[views[index]] @ np.expm1(-worth[index].astype(np.float64)))
        if waiting and (added, index) > waiting[0]:
            heapq.heappush(waiting, (added, index))
        elif added < 0.0:
            chosen.append(index)
            unknown[views[index]] *= np.exp(-worth[index])
    return sorted(chosen)
