"""What a build has gathered so far: a window of the endless grid that grows, and the cell links."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.mapping.links import LinkTable
from simaps_viz.mapping.projection import project_pixels, raise_cells
from simaps_viz.mapping.readings import FrameReadings
from simaps_viz.structures import Frame, Grid, GridSpec, Segmentation

_GROWTH_M = 8.0  # grow by at least this much at a time, so that growing is rare


@dataclass(frozen=True)
class ProjectionSettings:
    """Which pixels count, and how fine the grid is."""

    cell_size_m: float = 0.05
    """Side of a cell."""
    near_m: float = 0.1
    """Depth at or below this is not believed."""
    far_m: float = 6.0
    """Depth at or above this is not believed."""
    cut_height_m: float = 2.0
    """Pixels at or above this height over the floor (lamps, the ceiling) are left out."""
    below_floor_m: float = 0.3
    """Pixels more than this below the floor are left out."""
    obstacle_height_m: float = 0.1
    """What lies lower than this does not stop a robot."""


class MapAccumulator:
    """Takes frames one by one, in order; `snapshot` gives the map they make."""

    def __init__(
        self,
        labels: tuple[str, ...],
        is_thing: tuple[bool, ...],
        settings: ProjectionSettings,
        *,
        reach_cells: int = 2,
        links: bool = True,
    ) -> None:
        """Start empty.

        Args:
            labels: class names, index 0 is "none".
            is_thing: aligned with ``labels``; only things get links.
            settings: which pixels count.
            reach_cells: link cells at most this far apart; -1 = any distance.
            links: count links at all; method evidence can do without.
        """
        self.labels, self.is_thing, self.settings, self.reach_cells = labels, is_thing, settings, reach_cells
        self._links_wanted = links
        self.links = LinkTable()
        self.readings: list[FrameReadings] = []
        self._index_of = {name: i for i, name in enumerate(labels)}
        self._row0 = self._col0 = self._rows = self._cols = 0
        self._seen: tuple[int, int, int, int] | None = None  # row0, col0, row1, col1 from the origin, half open
        self._allocate(0, 0, 0, 0)

    def add_frame(self, frame: Frame, segmentation: Segmentation, T_map_camera: NDArray) -> NDArray:
        """Put a frame on the grid and count its links.

        Returns:
            int32 [n, 2]: (row, col), counted from the map's origin, of the cells it saw.
        """
        self._make_room(T_map_camera[:2, 3])
        s, k = self.settings, frame.intrinsics
        cells = np.full(frame.depth_m.shape, -1, dtype=np.int32)
        heights = np.zeros(frame.depth_m.shape, dtype=np.float32)
        project_pixels(
            frame.depth_m, k.fx, k.fy, k.cx, k.cy, np.ascontiguousarray(T_map_camera, dtype=np.float64),
            s.near_m, s.far_m, -s.below_floor_m, s.cut_height_m, s.cell_size_m,
            self._row0, self._col0, self._rows, self._cols, cells, heights,
        )  # fmt: skip
        label_of_id, graph_label_of_id = self._tables(segmentation)
        touched = self._touched
        n = raise_cells(
            cells, heights, segmentation.ids, label_of_id, s.obstacle_height_m,
            self._label, self._top, self._lowest, self._observations,
            self._frame_top, self._frame_segment, self._stamp, frame.index, touched,
        )  # fmt: skip
        if self._links_wanted:
            self.links.add_frame(
                cells, segmentation.ids, graph_label_of_id,
                row0=self._row0, col0=self._col0, cols=self._cols, reach=self.reach_cells,
            )  # fmt: skip
        return self._note_readings(touched[:n])

    def snapshot(self) -> Grid:
        """Copy the map as it is now, cut to what has been seen."""
        row0, col0, row1, col1 = self._seen or (0, 0, 1, 1)
        cut = (slice(row0 - self._row0, row1 - self._row0), slice(col0 - self._col0, col1 - self._col0))
        shape = (row1 - row0, col1 - col0)
        size = self.settings.cell_size_m
        spec = GridSpec(*shape, cell_size_m=size, x0_m=round(col0 * size, 9), y0_m=round(row0 * size, 9))
        if self._seen is None:
            nothing = np.full(shape, np.nan, dtype=np.float32)
            zero = np.zeros(shape, dtype=np.int32)
            return Grid(spec, self.labels, self.is_thing, zero.astype(np.int16), nothing, nothing.copy(), zero)
        top, lowest = self._window(self._top)[cut], self._window(self._lowest)[cut]
        return Grid(
            spec=spec,
            labels=self.labels,
            is_thing=self.is_thing,
            label=self._window(self._label)[cut].copy(),
            height_m=np.where(np.isinf(top), np.float32(np.nan), top),
            lowest_m=np.where(np.isinf(lowest), np.float32(np.nan), lowest),
            observations=self._window(self._observations)[cut].copy(),
        )

    @property
    def origin_cell(self) -> tuple[int, int]:
        """(row, col), counted from the map's origin, of cell (0, 0) of `snapshot`'s grid."""
        return (self._seen[0], self._seen[1]) if self._seen else (0, 0)

    def _window(self, flat: NDArray) -> NDArray:
        return flat.reshape(self._rows, self._cols)

    def _tables(self, segmentation: Segmentation) -> tuple[NDArray, NDArray]:
        """Give int16 tables from segment id to class index: of all segments, and of things only (0 elsewhere)."""
        highest = max((s.id for s in segmentation.segments), default=0)
        label_of_id = np.zeros(highest + 1, dtype=np.int16)
        graph_label_of_id = np.zeros(highest + 1, dtype=np.int16)
        for segment in segmentation.segments:
            index = self._index_of[segment.label]
            label_of_id[segment.id] = index
            if self.is_thing[index]:
                graph_label_of_id[segment.id] = index
        return label_of_id, graph_label_of_id

    def _note_readings(self, touched: NDArray) -> NDArray:
        rows = touched // self._cols + self._row0
        cols = touched % self._cols + self._col0
        self.readings.append(FrameReadings(rows, cols, self._frame_segment[touched], self._frame_top[touched]))
        if len(touched):
            seen = self._seen or (int(rows[0]), int(cols[0]), int(rows[0]), int(cols[0]))
            self._seen = (
                min(seen[0], int(rows.min())),
                min(seen[1], int(cols.min())),
                max(seen[2], int(rows.max()) + 1),
                max(seen[3], int(cols.max()) + 1),
            )
        return np.stack([rows, cols], axis=1)

    def _make_room(self, camera_xy_m: NDArray) -> None:
        """Grow the window until it holds everything a camera standing there can see."""
        size, far = self.settings.cell_size_m, self.settings.far_m * 2.0  # rays are longer than depth at the corners
        low = np.floor((camera_xy_m - far) / size).astype(int)
        high = np.ceil((camera_xy_m + far) / size).astype(int) + 1
        row0, col0, row1, col1 = self._row0, self._col0, self._row0 + self._rows, self._col0 + self._cols
        if self._rows and low[1] >= row0 and low[0] >= col0 and high[1] <= row1 and high[0] <= col1:
            return
        step = int(np.ceil(_GROWTH_M / size))
        if self._rows == 0:
            row0, col0, row1, col1 = low[1], low[0], high[1], high[0]
        else:
            row0 = min(row0, low[1] - step) if low[1] < row0 else row0
            col0 = min(col0, low[0] - step) if low[0] < col0 else col0
            row1 = max(row1, high[1] + step) if high[1] > row1 else row1
            col1 = max(col1, high[0] + step) if high[0] > col1 else col1
        self._allocate(int(row0), int(col0), int(row1 - row0), int(col1 - col0))

    def _allocate(self, row0: int, col0: int, rows: int, cols: int) -> None:
        self._label = self._moved(getattr(self, "_label", None), 0, np.int16, row0, col0, rows, cols)
        self._top = self._moved(getattr(self, "_top", None), -np.inf, np.float32, row0, col0, rows, cols)
        self._lowest = self._moved(getattr(self, "_lowest", None), np.inf, np.float32, row0, col0, rows, cols)
        self._observations = self._moved(getattr(self, "_observations", None), 0, np.int32, row0, col0, rows, cols)
        self._stamp = self._moved(getattr(self, "_stamp", None), -1, np.int32, row0, col0, rows, cols)
        self._frame_top = np.zeros(rows * cols, dtype=np.float32)
        self._frame_segment = np.zeros(rows * cols, dtype=np.int32)
        self._touched = np.zeros(rows * cols, dtype=np.int32)
        self._row0, self._col0, self._rows, self._cols = row0, col0, rows, cols

    def _moved(
        self, old: NDArray | None, empty: float, dtype: type, row0: int, col0: int, rows: int, cols: int
    ) -> NDArray:
        """Copy a layer of the old window to where it lies in a larger one."""
        grown = np.full((rows, cols), empty, dtype=dtype)
        if old is not None and self._rows:
            top, left = self._row0 - row0, self._col0 - col0
            grown[top : top + self._rows, left : left + self._cols] = self._window(old)
        return grown.reshape(-1)
