"""A simulated office building of any size, rendered frame by frame as it is asked for; nothing of it lies on disk.

Rooms of 10 m x 10 m, each with a strip of corridor, stand side by side. A room follows from the seed and its place
alone, a frame from its index alone, so the building takes no more memory when it is larger. Depth and masks are exact:
what is simulated is the place, not a sensor's faults.
"""

import math
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation

_INSIDE_M = 0.004  # a ray that meets a side ends this far inside, so that the point lies in the cell it met


@njit(cache=True, nogil=True)
def cast_rays(
    T_world_camera: NDArray,  # float64 [4, 4]
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    height_m: NDArray,  # float32 [rows, cols]
    cell_ids: NDArray,  # int32 [rows, cols]
    origin_m: tuple[float, float],  # x, y of the corner of cell (0, 0)
    cell_m: float,
    far_m: float,
    depth_m: NDArray,  # out float32 [H, W]
    ids: NDArray,  # out int32 [H, W]
) -> None:
    """Render a height field; what lies farther than ``far_m`` along the optical axis stays 0 in both pictures.

    A. Amanatides and A. Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987, in two dimensions.
    """
    T = T_world_camera
    rows, cols = height_m.shape
    x0, y0, z0 = (T[0, 3] - origin_m[0]) / cell_m, (T[1, 3] - origin_m[1]) / cell_m, T[2, 3]
    for v in range(depth_m.shape[0]):
        b = (v - cy) / fy
        for u in range(depth_m.shape[1]):
            a = (u - cx) / fx
            dx = (T[0, 0] * a + T[0, 1] * b + T[0, 2]) / cell_m
            dy = (T[1, 0] * a + T[1, 1] * b + T[1, 2]) / cell_m
            dz = T[2, 0] * a + T[2, 1] * b + T[2, 2]
            inside = _INSIDE_M / (cell_m * math.sqrt(dx * dx + dy * dy) + 1e-12)
            col, row = math.floor(x0), math.floor(y0)
            step_col, step_row = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
            next_x = ((col + (1 if dx > 0 else 0)) - x0) / dx if dx != 0.0 else math.inf
            next_y = ((row + (1 if dy > 0 else 0)) - y0) / dy if dy != 0.0 else math.inf
            apart_x = abs(1.0 / dx) if dx != 0.0 else math.inf
            apart_y = abs(1.0 / dy) if dy != 0.0 else math.inf
            t = 0.0
            while t < far_m and 0 <= row < rows and 0 <= col < cols:
                top = height_m[row, col]
                leaves = min(next_x, next_y)
                if z0 + dz * t < top:  # meets its side
                    depth_m[v, u], ids[v, u] = t + inside, cell_ids[row, col]
                    break
                if z0 + dz * leaves <= top:  # meets its top
                    at = (top - z0) / dz
                    if at < far_m:
                        depth_m[v, u], ids[v, u] = at, cell_ids[row, col]
                    break
                t = leaves
                if next_x < next_y:
                    col, next_x = col + step_col, next_x + apart_x
                else:
                    row, next_y = row + step_row, next_y + apart_y


LABELS: Final = ("none", "chair", "table", "desk", "couch", "cabinet", "potted plant", "floor", "wall")
CELL_M: Final = 0.1
CELLS: Final = 100
"""Along each side of a room."""
ROOM_M: Final = CELL_M * CELLS
_WALL_M, _CHAIR_M, _BACK_M = 2.5, 0.45, 0.9
_HEIGHT_M = {"table": 0.74, "desk": 0.72, "couch": 0.8, "cabinet": 1.2, "potted plant": 1.1}
_CORRIDOR = 24
_QUARTERS = ((28, 3), (28, 52), (64, 52), (64, 3))  # lowest row and column of the four parts of a room
_PART = (33, 45)
"""Rows and columns of such a part."""


@dataclass(eq=False)
class Room:
    """One room as a height field; row = y."""

    height_m: NDArray = field(default_factory=lambda: np.zeros((CELLS, CELLS), np.float32))
    """float32 [n, n], 0 = floor."""
    object: NDArray = field(default_factory=lambda: np.zeros((CELLS, CELLS), np.int32))
    """int32 [n, n], 1 for the first of ``names``, 0 = floor or wall."""
    names: list[str] = field(default_factory=list)
    """Class of each object."""

    def put(self, name: str, row: int, col: int, rows: int, cols: int, height_m: float = 0.0) -> None:
        """Stand a box on the floor."""
        self.names.append(name)
        part = np.s_[row : row + rows, col : col + cols]
        self.object[part], self.height_m[part] = len(self.names), height_m or _HEIGHT_M[name]

    def put_chair(self, row: int, col: int, back: str) -> None:
        """Stand a chair of 0.5 m x 0.5 m on the floor, its back to a side ("n", "e", "s" or "w")."""
        self.put("chair", row, col, 5, 5, _CHAIR_M)
        side = {"n": np.s_[row + 4, col : col + 5], "s": np.s_[row, col : col + 5]}
        side |= {"e": np.s_[row : row + 5, col + 4], "w": np.s_[row : row + 5, col]}
        self.height_m[side[back]] = _BACK_M


def furnish(rng: np.random.Generator) -> Room:
    """Make a room: a strip of corridor in the south, a wall with a door, four groups of furniture."""
    room = Room()
    for wall in (np.s_[_CORRIDOR, :44], np.s_[_CORRIDOR, 56:], np.s_[99, :], np.s_[_CORRIDOR:, 0]):
        room.height_m[wall] = _WALL_M
    for row, col in _QUARTERS:
        group = (_table_with_chairs, _desk, _couches, _cabinets, _nothing)[rng.choice(5, p=(0.35, 0.3, 0.15, 0.1, 0.1))]
        group(room, row, col, rng)
    return room


def _table_with_chairs(room: Room, row: int, col: int, rng: np.random.Generator) -> None:
    chairs = int(rng.integers(1, 4))  # on each long side
    length, deep = 7 * chairs + 1, 9
    row += int(rng.integers(6, _PART[0] - deep - 6))
    col += int(rng.integers(0, _PART[1] - length))
    room.put("table", row, col, deep, length)
    for i in range(chairs):
        room.put_chair(row - 6, col + 1 + 7 * i, "s")
        room.put_chair(row + deep + 1, col + 1 + 7 * i, "n")


def _desk(room: Room, row: int, col: int, rng: np.random.Generator) -> None:
    for at in range(int(rng.integers(1, 3))):  # desks side by side may touch
        left = col + 2 + at * int(rng.integers(14, 22))
        room.put("desk", row + 12, left, 7, 14)
        room.put_chair(row + 6, left + 4 + int(rng.integers(0, 3)), "s")


def _couches(room: Room, row: int, col: int, rng: np.random.Generator) -> None:
    room.put("couch", row + 20, col + 8, 9, int(rng.integers(16, 24)))
    room.put("table", row + 9, col + 12, 6, 10, 0.45)
    room.put("potted plant", row + 23, col + 3, 4, 4)


def _cabinets(room: Room, row: int, col: int, rng: np.random.Generator) -> None:
    for at in range(int(rng.integers(1, 4))):
        room.put("cabinet", row + 27, col + 2 + 12 * at, 5, 10)


def _nothing(room: Room, row: int, col: int, rng: np.random.Generator) -> None:
    pass


FRAMES_A_ROOM: Final = 80
"""12 along its corridor, 4 through its door, 16 all around from each of four places."""
MAX_M: Final = 1000.0
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
        if not ROOM_M <= side_m <= MAX_M:
            raise InputError(f"building: expected a side from {ROOM_M:g} to {MAX_M:g} m, found {side_m:g} m")
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
        """Return the camera; the rest follows from the rooms and the seed, which the path names."""
        return repr(self.intrinsics).encode()

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Render a frame; there is no colour."""
        depth, _ = self._render(index)
        return Frame(index, self.frame_names[index], depth, self.poses[index], self.intrinsics)

    def segmentation(self, index: int) -> Segmentation:
        """Return the exact masks; ids mean nothing in other frames."""
        _, ids = self._render(index)
        known = self._around(*self._room_of(index)).segments
        return Segmentation(ids, tuple(known[int(i)] for i in np.flatnonzero(np.bincount(ids.reshape(-1))) if i > 0))

    def origin_of(self, row: int, col: int) -> tuple[float, float]:
        """Return the south-west corner (x, y) of a room, metres."""
        half = self.rooms * ROOM_M / 2.0
        return col * ROOM_M - half, row * ROOM_M - half

    def truth_of(self, row: int, col: int, cell_size_m: float) -> tuple[NDArray, list[str], tuple[float, float]]:
        """Return what stands in a room: int32 [n, n], 1 for the first name, 0 = nothing; the names; the corner (x, y).

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
    """Return the camera's (x, y) in its room, metres, and where it looks, radians from +x."""
    if step < _CORRIDOR:
        return (step + 0.5) * ROOM_M / _CORRIDOR, 1.2, (0.6, -0.6, np.pi - 0.6)[step % 3]
    if step < _CORRIDOR + _DOOR:
        return 5.0, 1.2 + 0.8 * (step - _CORRIDOR), np.pi / 2.0
    place, turn = divmod(step - _CORRIDOR - _DOOR, _AROUND)
    return (*_PLACES_M[place], 2.0 * np.pi * (turn + 0.25 * place) / _AROUND)


def _camera(x: float, y: float, yaw_rad: float) -> NDArray:
    """Return the pose of a level camera that looks a little down, float64 [4, 4]."""
    forward = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    right = np.array([np.sin(yaw_rad), -np.cos(yaw_rad), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    pose = np.eye(4)
    pose[:3, 0] = right
    pose[:3, 1] = -up * np.cos(_DOWN_RAD) - forward * np.sin(_DOWN_RAD)
    pose[:3, 2] = forward * np.cos(_DOWN_RAD) - up * np.sin(_DOWN_RAD)
    pose[:3, 3] = x, y, _CAMERA_M
    return pose
