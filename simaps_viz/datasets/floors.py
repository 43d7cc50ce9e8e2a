"""The floors that a recording goes over, the frames of each, and where the camera goes from one to the next."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.gravity import faces_up, sample_surface
from simaps_viz.datasets.source import FrameSource, OtherMasks
from simaps_viz.errors import InputError
from simaps_viz.geometry import spread, transform_points
from simaps_viz.structures import Frame, Segmentation

STOREY_M = 1.8
"""Two floors are at least so far apart, and so are the lowest and the highest camera of a recording of two floors."""
SAMPLED = 200
"""Frames in which floors are looked for."""
BIN_M, CELL_M = 0.02, 0.2
"""Surface is counted in cells of this side, at heights of this step."""
REACH = 2
"""Steps below and above that count as one height."""
FLOOR_SHARE, MIN_M2 = 0.15, 4.0
"""Area of a floor: a share of the largest floor's, and square metres; a landing of the stairs is smaller."""
PEAK = 3.0
"""Times the mean area of the heights around, which a floor has; on a ramp all heights have the same."""
MIN_FRAMES = 0.02
"""Share of the frames that are on a floor."""
OVER_FLOOR_M = 0.1
"""A camera is on a floor when it is so much higher; lower ones see the ceiling below it, from the stairs."""
LEVEL_M = 0.25
"""A camera that is at most so much off its usual height over the floor is on the last step, or beside the stairs."""
CLEAR_M = 0.4
"""So much farther on, it is clear of them: there a robot can stand."""
MAX_STEP_M = 1.5
"""From frame to frame, on the stairs; where the camera is farther off, its path has a gap and nothing is known."""
SAME_STAIRS_M = 1.5
"""Climbs that begin and end so close to each other are over the same stairs."""


def find_floors(sequence: FrameSource) -> tuple[float, ...]:
    """Find the heights of the floors that the camera walks over.

    A floor is a large level surface with cameras above it. Where the camera's own height changes by less than a storey
    there is one floor, and no frame is read.

    Args:
        sequence: posed frames; its map frame says which way is up.

    Returns:
        Heights in metres, map frame, ascending; (0.0,) where there is one floor, the map's own.
    """
    cameras_m = _camera_heights(sequence)
    if len(cameras_m) == 0 or np.ptp(cameras_m) < STOREY_M:
        return (0.0,)
    floors = _levels(_upward_points(sequence))
    if len(floors):
        frames = np.bincount(floor_of_cameras(cameras_m, floors), minlength=len(floors))
        floors = floors[frames >= MIN_FRAMES * len(cameras_m)]
    if len(floors) < 2:
        return (0.0,)
    # The map's own floor is as exact as can be; the others are measured from it.
    own = float(floors[np.abs(floors).argmin()])
    return tuple((floors - (own if abs(own) < STOREY_M / 2 else 0.0)).round(4).tolist())


def floor_of_cameras(cameras_m: NDArray, floors: Sequence[float] | NDArray) -> NDArray:
    """Return the floor that each camera is over, int [n], by its place in ``floors``.

    Args:
        cameras_m: [n], heights of the cameras.
        floors: heights of the floors, ascending.
    """
    return np.maximum(np.searchsorted(np.asarray(floors) + OVER_FLOOR_M, cameras_m, side="right") - 1, 0)


def split_floors(sequence: FrameSource, floors: Sequence[float]) -> list["SomeFrames"]:
    """Return the frames over each floor, in a map frame whose floor is that one; x and y are those of the sequence.

    Args:
        sequence: posed frames.
        floors: heights as `find_floors` returns them.
    """
    on = floor_of_cameras(_camera_heights(sequence), floors)
    parts = []
    for number, height_m in enumerate(floors):
        T_map_world = sequence.T_map_world.copy()
        T_map_world[2, 3] -= height_m
        parts.append(SomeFrames(sequence, np.flatnonzero(on == number).tolist(), T_map_world))
        parts[-1].name = f"{sequence.name}, floor {number + 1}"
    return parts


def find_stairs(sequence: FrameSource, floors: Sequence[float]) -> list[tuple[int, NDArray, NDArray]]:
    """Return where the camera goes from a floor to the next one above, or down from there.

    Args:
        sequence: posed frames.
        floors: heights as `find_floors` returns them.

    Returns:
        Of each stairs: the lower floor by its place in ``floors``; where the camera was last level below and first
        level above, float64 [2] each, x and y in metres, map frame. In the order in which they were first used.
    """
    path = (sequence.T_map_world @ sequence.poses)[:, :3, 3]
    on = floor_of_cameras(path[:, 2], floors)
    over_m = path[:, 2] - np.asarray(floors)[on]
    usual_m = [float(np.median(over_m[on == number])) for number in range(len(floors))]

    def level(at: int, by: int, lower: int) -> int | None:
        """Return the first camera, from one by one, at its usual height and clear of the stairs.

        None where it turns back before, or its path ends.
        """
        floor, reached = on[at], None
        while 0 <= at < len(on) and on[at] == floor:
            off_m = over_m[at] - usual_m[floor]
            if reached is None and (off_m if floor == lower else -off_m) <= LEVEL_M:
                reached = at
            if reached is not None and np.hypot(*(path[at] - path[reached])[:2]) >= CLEAR_M:
                return at
            at += by
        return reached

    found: list[tuple[int, NDArray, NDArray]] = []
    for before in np.flatnonzero(np.abs(np.diff(on)) == 1).tolist():
        lower = int(min(on[before], on[before + 1]))
        first, last = level(before, -1, lower), level(before + 1, 1, lower)
        if first is None or last is None:
            continue
        if np.linalg.norm(np.diff(path[first : last + 1], axis=0), axis=1).max() > MAX_STEP_M:
            continue
        foot, head = (first, last) if on[first] == lower else (last, first)
        ends = path[[foot, head], :2]
        if not any(n == lower and np.linalg.norm(ends - (a, b), axis=1).max() < SAME_STAIRS_M for n, a, b in found):
            found.append((lower, ends[0], ends[1]))
    return found


class SomeFrames(OtherMasks):
    """Some frames of a sequence, in its map frame or one of their own: a `FrameSource`."""

    def __init__(self, sequence: FrameSource, indices: Sequence[int], T_map_world: NDArray | None = None) -> None:
        """Take the frames at these indices."""
        super().__init__(sequence)
        self.complete = sequence
        self.indices: tuple[int, ...] = tuple(indices)
        self.frame_names = tuple(sequence.frame_names[i] for i in self.indices)
        self.poses = sequence.poses[list(self.indices)]
        self.T_map_world = sequence.T_map_world if T_map_world is None else T_map_world
        self.segmentation_source: str = sequence.segmentation_source

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Read a frame, under its number here."""
        return replace(self._sequence.read(self.indices[index], color=color), index=index)

    def color(self, index: int) -> NDArray:
        """Read a frame's colour image, uint8 [H, W, 3], RGB."""
        color = self.read(index, color=True).color
        assert color is not None  # it was asked for
        return color

    def segmentation(self, index: int) -> Segmentation:
        """Read a frame's segmentation."""
        return self._sequence.segmentation(self.indices[index])


def indices_of(names: Sequence[str], sequence: FrameSource) -> list[int] | None:
    """Return where frames of these names are in a sequence; None where they are its first ones, or not all there.

    The frames of a floor's map are some of those of the recording that it was built from.
    """
    if tuple(names) == sequence.frame_names[: len(names)]:
        return None
    at = {name: index for index, name in enumerate(sequence.frame_names)}
    found = [at[name] for name in names if name in at]
    return found if len(found) == len(names) else None


def _camera_heights(sequence: FrameSource) -> NDArray:
    """Return the height of each camera, float64 [n], metres, map frame."""
    return (sequence.T_map_world @ sequence.poses)[:, 2, 3]


def _upward_points(sequence: FrameSource) -> NDArray:
    """Return points of surface that faces up, float64 [n, 3], map frame, from frames all over the sequence."""
    up, found = sequence.T_map_world[2, :3], [np.zeros((0, 3))]
    for index in spread(len(sequence), SAMPLED):
        with suppress(InputError):  # the build reports what cannot be read
            surface = sample_surface([sequence.read(index)])
            found.append(transform_points(sequence.T_map_world, surface.points[faces_up(surface, up)]))
    return np.concatenate(found)


def _levels(points: NDArray) -> NDArray:
    """Return the heights of large level surfaces, float64, ascending, a storey or more apart: the lowest of each."""
    if not len(points):
        return np.zeros(0)
    # The area at a height is that of the cells with surface there: what was looked at longer is not larger.
    low = np.floor(points[:, 2].min() / BIN_M)
    step = (points[:, 2] // BIN_M - low).astype(np.int64)
    column, row = ((points[:, :2] - points[:, :2].min(axis=0)) // CELL_M).astype(np.int64).T
    per_step = int((column.max() + 1) * (row.max() + 1))
    step_of, cell = np.divmod(np.unique(step * per_step + row * (column.max() + 1) + column), per_step)
    steps = np.arange(step.max() + 1)
    begin, end = np.searchsorted(step_of, [steps - REACH, steps + REACH + 1])
    area_m2 = np.array([len(np.unique(cell[a:b])) for a, b in zip(begin, end, strict=True)]) * CELL_M**2
    levels: list[float] = []
    for first in np.flatnonzero(area_m2 >= max(FLOOR_SHARE * area_m2.max(), MIN_M2)).tolist():
        top = first + int(area_m2[first : first + 4 * REACH].argmax())
        around = area_m2[max(0, top - round(STOREY_M / 2 / BIN_M)) : top + round(STOREY_M / 2 / BIN_M)]
        centre_m = (low + top + 0.5) * BIN_M
        if area_m2[top] < PEAK * around.mean() or (levels and centre_m < levels[-1] + STOREY_M):
            continue
        near = np.abs(points[:, 2] - centre_m) < (REACH + 0.5) * BIN_M
        levels.append(float(np.median(points[near, 2])))
    return np.array(levels)
