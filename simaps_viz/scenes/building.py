"""A simulated office building of any size, rendered frame by frame as it is asked for; nothing of it lies on disk.

Rooms of 10 m x 10 m, each with a strip of corridor, stand side by side. A room follows from the seed and its place
alone, a frame from its index alone, so the building takes no more memory when it is larger. Depth and masks are exact:
what is simulated is the place, not a sensor's faults.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.scenes.building_rays import cast_rays
from simaps_viz.scenes.building_rooms import CELL_M, CELLS, LABELS, ROOM_M, Room, furnish
from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation

FRAMES_A_ROOM: Final = 80
"""12 along its corridor, 4 through its door, 16 all around from each of four places."""
LARGEST_M: Final = 1000.0
_CORRIDOR, _DOOR, _AROUND = 12, 4, 16
_PLACES_M = ((2.7, 4.4), (7.3, 4.4), (7.3, 7.9), (2.7, 7.9))
_CAMERA_M = 1.5
_DOWN_RAD = np.deg2rad(28.0)
_FAR_M = 6.5
_WIDTH, _HEIGHT, _FOCAL = 120, 90, 78.0
_FLOOR, _WALL, _OBJECTS = 1, 2, 3  # ids in a frame: the two stuffs, then the objects of the rooms around


@dataclass(frozen=True, eq=False)
class _Around:
    """The rooms around a camera as one height field."""

    height_m: NDArray
    """float32 [3 n, 3 n], row = y; of what stands on each cell, 0 = floor."""
    ids: NDArray
    """int32 [3 n, 3 n], as in the frames."""
    segments: dict[int, Segment]
    """By id."""
    origin_m: tuple[float, float]


class SimulatedBuilding:
    """A sequence of frames through a simulated building; every `FrameSource` can be this."""

    is_thing = tuple(name not in ("none", "floor", "wall") for name in LABELS)
    labels = LABELS
    segmentation_source = "exact masks of a simulated building"
    simulated = True
    T_map_world = np.eye(4)
    intrinsics = Intrinsics(_WIDTH, _HEIGHT, _FOCAL, _FOCAL, (_WIDTH - 1) / 2, (_HEIGHT - 1) / 2)

    def __init__(self, side_m: float = 500.0, frames: int | None = None, *, seed: int = 0) -> None:
        """Plan a building of about ``side_m`` x ``side_m``, its middle at the origin.

        Args:
            side_m: rounded to whole rooms.
            frames: the first so many; None = until every room was visited, 80 frames each. More start over.
            seed: of the furniture.

        Raises:
            InputError: the side is not from one room to 1000 m, or there are no frames.
        """
        if not ROOM_M <= side_m <= LARGEST_M:
            raise InputError(f"building: expected a side from {ROOM_M:g} to {LARGEST_M:g} m, found {side_m:g} m")
        if frames is not None and frames < 1:
            raise InputError(f"building: expected at least 1 frame, found {frames}")
        self.rooms = round(side_m / ROOM_M)
        self.seed, self.frames = seed, self.rooms**2 * FRAMES_A_ROOM if frames is None else frames
        self.name = f"simulated building, {self.rooms * ROOM_M:g} m x {self.rooms * ROOM_M:g} m"
        self.path = Path(f"simulated-building-{self.rooms}-rooms-seed-{seed}")
        self._around = lru_cache(maxsize=8)(self._look_around)
        self._render = lru_cache(maxsize=16)(self._rendered)
        self.frame_names = tuple(f"{index:06d}" for index in range(self.frames))
        """Numbers."""
        self.poses = self._posed()
        """float64 [n, 4, 4], T_world_camera."""
        self.room = lru_cache(maxsize=64)(self._furnished)
        """Gives the `Room` at (row, col)."""

    def __len__(self) -> int:
        return self.frames

    def _posed(self) -> NDArray:
        one = np.stack([_camera(*_place(step)) for step in range(FRAMES_A_ROOM)])
        index = np.arange(len(self))
        poses = one[index % FRAMES_A_ROOM]
        rows, cols = self._rooms_of(index)
        poses[:, :2, 3] += np.stack([cols, rows], axis=1) * ROOM_M - self.rooms * ROOM_M / 2.0
        return poses

    def described(self) -> bytes:
        """Give the camera; the rest follows from the rooms and the seed, which the path names."""
        return repr(self.intrinsics).encode()

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Render a frame; there is no colour."""
        depth, _ = self._render(index)
        return Frame(index, self.frame_names[index], depth, self.poses[index], self.intrinsics)

    def segmentation(self, index: int) -> Segmentation:
        """Give the exact masks; ids mean nothing in other frames."""
        _, ids = self._render(index)
        known = self._around(*self._room_of(index)).segments
        return Segmentation(ids, tuple(known[int(i)] for i in np.flatnonzero(np.bincount(ids.reshape(-1))) if i > 0))

    def origin_of(self, row: int, col: int) -> tuple[float, float]:
        """Give the south-west corner (x, y) of a room, metres."""
        half = self.rooms * ROOM_M / 2.0
        return col * ROOM_M - half, row * ROOM_M - half

    def truth_of(self, row: int, col: int, cell_size_m: float) -> tuple[NDArray, list[str], tuple[float, float]]:
        """Give what stands in a room: int32 [n, n], 1 for the first name, 0 = nothing; the names; the corner (x, y).

        Raises:
            InputError: cells of that size do not fit the furniture, which stands on cells of 0.1 m.
        """
        times = round(CELL_M / cell_size_m)
        if times < 1 or abs(times * cell_size_m - CELL_M) > 1e-9:
            raise InputError(f"building: expected cells of 0.1 m or a whole part of it, found {cell_size_m:g} m")
        room = self.room(row, col)
        return room.object.repeat(times, axis=0).repeat(times, axis=1), room.names, self.origin_of(row, col)

    def _rooms_of(self, index: NDArray) -> tuple[NDArray, NDArray]:
        """Rooms are visited corridor by corridor, eastwards and westwards in turn."""
        row, col = np.divmod(index // FRAMES_A_ROOM % self.rooms**2, self.rooms)
        return row, np.where(row % 2 == 0, col, self.rooms - 1 - col)

    def _room_of(self, index: int) -> tuple[int, int]:
        row, col = self._rooms_of(np.array(index))
        return int(row), int(col)

    def _furnished(self, row: int, col: int) -> Room:
        return furnish(np.random.default_rng((self.seed, row, col)))

    def _look_around(self, row: int, col: int) -> _Around:
        height = np.full((3 * CELLS, 3 * CELLS), 2.5, dtype=np.float32)
        ids = np.full((3 * CELLS, 3 * CELLS), _WALL, dtype=np.int32)
        segments = {_FLOOR: Segment(_FLOOR, "floor", 1.0, False), _WALL: Segment(_WALL, "wall", 1.0, False)}
        free = _OBJECTS
        for r in range(max(row - 1, 0), min(row + 2, self.rooms)):
            for c in range(max(col - 1, 0), min(col + 2, self.rooms)):
                room = self.room(r, c)
                top, left = (r - row + 1) * CELLS, (c - col + 1) * CELLS
                part = np.s_[top : top + CELLS, left : left + CELLS]
                height[part] = room.height_m
                stuff = np.where(room.height_m > 0, _WALL, _FLOOR)
                ids[part] = np.where(room.object > 0, room.object + free - 1, stuff)
                segments |= {free + i: Segment(free + i, name) for i, name in enumerate(room.names)}
                free += len(room.names)
        x, y = self.origin_of(row, col)
        return _Around(height, ids, segments, (x - ROOM_M, y - ROOM_M))

    def _rendered(self, index: int) -> tuple[NDArray, NDArray]:
        around, k = self._around(*self._room_of(index)), self.intrinsics
        depth = np.zeros((k.height, k.width), dtype=np.float32)
        ids = np.zeros((k.height, k.width), dtype=np.int32)
        cast_rays(
            self.poses[index], k.fx, k.fy, k.cx, k.cy, around.height_m, around.ids, around.origin_m, CELL_M, _FAR_M,
            depth, ids,
        )  # fmt: skip
        return depth, ids


def _place(step: int) -> tuple[float, float, float]:
    """Give the camera's (x, y) in its room, metres, and where it looks, radians from +x."""
    if step < _CORRIDOR:
        return (step + 0.5) * ROOM_M / _CORRIDOR, 1.2, (0.6, -0.6, np.pi - 0.6)[step % 3]
    if step < _CORRIDOR + _DOOR:
        return 5.0, 1.2 + 0.8 * (step - _CORRIDOR), np.pi / 2.0
    place, turn = divmod(step - _CORRIDOR - _DOOR, _AROUND)
    return (*_PLACES_M[place], 2.0 * np.pi * (turn + 0.25 * place) / _AROUND)


def _camera(x: float, y: float, yaw_rad: float) -> NDArray:
    """Give the pose of a level camera that looks a little down, float64 [4, 4]."""
    forward = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    right = np.array([np.sin(yaw_rad), -np.cos(yaw_rad), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    pose = np.eye(4)
    pose[:3, 0] = right
    pose[:3, 1] = -up * np.cos(_DOWN_RAD) - forward * np.sin(_DOWN_RAD)
    pose[:3, 2] = forward * np.cos(_DOWN_RAD) - up * np.sin(_DOWN_RAD)
    pose[:3, 3] = x, y, _CAMERA_M
    return pose
