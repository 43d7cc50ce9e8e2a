"""The mean embedding of every cell somebody saw: VLMaps' map, without room for the cells nobody saw."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.baselines.embedder import PixelEmbeddings
from simaps_viz.errors import InputError
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.projection import project_pixels
from simaps_viz.structures import Frame

Weighting = Literal["uniform", "distance"]
"""What a point counts: 1, as VLMaps' paper has it, or less the farther away it was seen, as its later program does."""
DISTANCE_VARIANCE_M2 = 0.6
"""Of the distance weight exp(-d^2 / (2 * 0.6 m^2)), d from the camera (ConceptFusion, Jatavallabhula et al., 2023)."""


@dataclass(frozen=True, eq=False)
class CellPoints:
    """The points of a frame that fall on the grid."""

    rows: NDArray
    """int32 [n], counted from the map's origin."""
    cols: NDArray
    """int32 [n], counted from the map's origin."""
    embedding: NDArray
    """int32 [n], row of the frame's embedding table."""
    weights: NDArray
    """float64 [n]."""


def cell_points(
    frame: Frame,
    embeddings: PixelEmbeddings,
    T_map_camera: NDArray,
    settings: ProjectionSettings,
    *,
    stride: int,
    weighting: Weighting,
) -> CellPoints:
    """Put every stride-th pixel of every stride-th row on the grid.

    Raises:
        InputError: the embeddings have another size than the frame.
    """
    if embeddings.index.shape != frame.depth_m.shape:
        expected, found = list(frame.depth_m.shape), list(embeddings.index.shape)
        raise InputError(f"frame {frame.name}: expected embeddings of {expected} pixels, found {found}")
    size, k = settings.cell_size_m, frame.intrinsics
    reach = int(np.ceil(2.0 * settings.far_m / size))  # rays are longer than depth at the corners
    row0, col0 = int(np.floor(T_map_camera[1, 3] / size)) - reach, int(np.floor(T_map_camera[0, 3] / size)) - reach
    side = 2 * reach + 1
    cells = np.full(frame.depth_m.shape, -1, dtype=np.int32)
    heights = np.zeros(frame.depth_m.shape, dtype=np.float32)
    project_pixels(
        frame.depth_m, k.fx, k.fy, k.cx, k.cy, np.ascontiguousarray(T_map_camera, dtype=np.float64),
        settings.near_m, settings.far_m, -settings.below_floor_m, settings.cut_height_m, size,
        row0, col0, side, side, cells, heights,
    )  # fmt: skip
    kept = np.zeros(cells.shape, dtype=bool)
    kept[::stride, ::stride] = True
    v, u = np.nonzero(kept & (cells >= 0) & (embeddings.index >= 0))
    cell = cells[v, u]
    weights = np.ones(len(cell))
    if weighting == "distance":
        depth = frame.depth_m[v, u].astype(np.float64)
        squared = depth**2 * (1.0 + ((u - k.cx) / k.fx) ** 2 + ((v - k.cy) / k.fy) ** 2)
        weights = np.exp(-squared / (2.0 * DISTANCE_VARIANCE_M2))
    return CellPoints(cell // side + row0, cell % side + col0, embeddings.index[v, u], weights)


@njit(cache=True, nogil=True)
def update_means(
    slots: NDArray,  # int32 [n]
    embedding: NDArray,  # int32 [n]
    weights: NDArray,  # float64 [n]
    table: NDArray,  # float32 [rows, D]
    means: NDArray,  # in/out float32 [cells, D]
    totals: NDArray,  # in/out float64 [cells]
) -> None:
    """Move the running mean of each point's cell towards the point's embedding: m += (e - m) w / sum of w."""
    dimension = table.shape[1]
    for i in range(len(slots)):
        slot = slots[i]
        totals[slot] += weights[i]
        share = np.float32(weights[i] / totals[slot])
        mean, vector = means[slot], table[embedding[i]]
        for d in range(dimension):
            mean[d] += (vector[d] - mean[d]) * share


class EmbeddingStore:
    """Running mean embeddings of the cells seen so far, in the order in which they were first seen."""

    def __init__(self, dimension: int) -> None:
        """Start without cells."""
        self.dimension, self.count = dimension, 0
        self._means = np.zeros((0, dimension), dtype=np.float32)
        self._totals = np.zeros(0)
        self._cells = np.zeros((0, 2), dtype=np.int32)
        self._slot_of = np.full((0, 0), -1, dtype=np.int32)
        self._row0 = self._col0 = 0

    @property
    def means(self) -> NDArray:
        """float32 [cells, D]."""
        return self._means[: self.count]

    @property
    def totals(self) -> NDArray:
        """float64 [cells], sum of the weights of a cell's points."""
        return self._totals[: self.count]

    @property
    def cells(self) -> NDArray:
        """int32 [cells, 2], (row, col) counted from the map's origin."""
        return self._cells[: self.count]

    @property
    def held_bytes(self) -> int:
        """What this store takes in memory, its look-up table included; room never written to takes none."""
        return self.means.nbytes + self.totals.nbytes + self.cells.nbytes + self._slot_of.nbytes

    def add(self, points: CellPoints, table: NDArray) -> None:
        """Take in the points of a frame."""
        if len(points.rows) == 0:
            return
        if table.shape[1] != self.dimension:
            raise InputError(
                f"embeddings: expected vectors of {self.dimension} numbers, found vectors of {table.shape[1]}"
            )
        slots = self._slots(points.rows, points.cols)
        update_means(slots, points.embedding, points.weights, table, self._means, self._totals)

    def nearest(self, texts: NDArray) -> NDArray:
        """Return the cosine between every cell's mean and every text, float32 [cells, texts]; 0 for a zero mean.

        Args:
            texts: float32 [texts, D], unit length.
        """
        lengths = np.linalg.norm(self.means, axis=1, keepdims=True)
        return (self.means @ texts.T) / np.maximum(lengths, np.float32(1e-12))

    def _slots(self, rows: NDArray, cols: NDArray) -> NDArray:
        self._make_window(int(rows.min()), int(cols.min()), int(rows.max()) + 1, int(cols.max()) + 1)
        width = self._slot_of.shape[1]
        flat = (rows - self._row0).astype(np.int64) * width + (cols - self._col0)
        slot_of = self._slot_of.reshape(-1)
        new = np.unique(flat[slot_of[flat] < 0])
        last = self.count + len(new)
        self._reserve(last)
        slot_of[new] = np.arange(self.count, last)
        self._cells[self.count : last] = np.stack([new // width + self._row0, new % width + self._col0], axis=1)
        self.count = last
        return slot_of[flat]

    def _reserve(self, wanted: int) -> None:
        """Double the room when it runs out; fresh zeros cost address space, not memory, until a cell is written."""
        if wanted <= len(self._means):
            return
        room = max(wanted, 2 * len(self._means), 1024)
        means, totals, cells = (
            np.zeros((room, self.dimension), np.float32),
            np.zeros(room),
            np.zeros((room, 2), np.int32),
        )
        means[: self.count], totals[: self.count], cells[: self.count] = self.means, self.totals, self.cells
        self._means, self._totals, self._cells = means, totals, cells

    def _make_window(self, row0: int, col0: int, row1: int, col1: int) -> None:
        if self._slot_of.size:
            row0, col0 = min(row0, self._row0), min(col0, self._col0)
            row1 = max(row1, self._row0 + self._slot_of.shape[0])
            col1 = max(col1, self._col0 + self._slot_of.shape[1])
        if (row1 - row0, col1 - col0) == self._slot_of.shape:
            return
        grown = np.full((row1 - row0, col1 - col0), -1, dtype=np.int32)
        if self._slot_of.size:
            top, left = self._row0 - row0, self._col0 - col0
            grown[top : top + self._slot_of.shape[0], left : left + self._slot_of.shape[1]] = self._slot_of
        self._slot_of, self._row0, self._col0 = grown, row0, col0


def dense_bytes(rows: int, cols: int, dimension: int = 512) -> int:
    """Return what VLMaps' own store takes in memory: a float32 vector for every cell of the grid, seen or not.

    1000 x 1000 cells of 512 numbers, the size its published programs allocate, are 2,048 MB (decimal).
    """
    return int(rows) * int(cols) * int(dimension) * np.dtype(np.float32).itemsize  # no int32 may overflow here
