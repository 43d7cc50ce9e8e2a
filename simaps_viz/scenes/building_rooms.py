"""The rooms of the simulated building: walls, a door, and furniture as boxes on cells of 10 cm."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

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
