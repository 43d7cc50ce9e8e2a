"""The plain twin of the sparse accumulator: one dense window, every pixel by itself."""

import numpy as np

from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.projection import project_pixels


class DenseTwin:
    """Holds every cell from ``low`` to ``high`` (row and column alike), seen or not."""

    def __init__(self, labels, settings: ProjectionSettings, low: int, high: int) -> None:
        side = high - low
        self.labels, self.settings, self.low, self.side = labels, settings, low, side
        self.label = np.zeros((side, side), np.int16)
        self.top = np.full((side, side), -np.inf, np.float32)
        self.lowest = np.full((side, side), np.inf, np.float32)
        self.observations = np.zeros((side, side), np.int32)
        self.seen: list[list[tuple[int, int, int, float]]] = []
        """(row, col, segment, height) of the cells of each frame, in the order in which they were met."""

    def add_frame(self, frame, segmentation, T_map_camera) -> None:
        s, k = self.settings, frame.intrinsics
        cells = np.full(frame.depth_m.shape, -1, np.int32)
        heights = np.zeros(frame.depth_m.shape, np.float32)
        project_pixels(
            frame.depth_m, k.fx, k.fy, k.cx, k.cy, T_map_camera, s.near_m, s.far_m, -s.below_floor_m, s.cut_height_m,
            s.cell_size_m, self.low, self.low, self.side, self.side, cells, heights,
        )  # fmt: skip
        name = {segment.id: segment.label for segment in segmentation.segments}
        best: dict[int, tuple[np.float32, int]] = {}
        ids = segmentation.ids.reshape(-1).tolist()
        for cell, height, segment in zip(cells.reshape(-1).tolist(), heights.reshape(-1), ids, strict=True):
            if cell < 0:
                continue
            if cell not in best or height > best[cell][0]:
                best[cell] = (height, segment)
            if height >= s.obstacle_height_m:
                at = divmod(cell, self.side)
                self.lowest[at] = min(self.lowest[at], height)
        for cell, (height, segment) in best.items():
            at = divmod(cell, self.side)
            self.observations[at] += 1
            if height > self.top[at]:
                self.top[at] = height
                self.label[at] = self.labels.index(name[segment]) if segment else 0
        self.seen.append([
            (cell // self.side + self.low, cell % self.side + self.low, segment, float(height))
            for cell, (height, segment) in best.items()
        ])  # fmt: skip

    def cut(self):
        """Return the layers of what was seen, and the cell they start at."""
        rows, cols = np.nonzero(self.observations)
        part = np.s_[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
        layers = [self.label[part]]
        for layer in (self.top[part], self.lowest[part]):
            layers.append(np.where(np.isinf(layer), np.float32(np.nan), layer))
        return [*layers, self.observations[part]], (int(rows.min()) + self.low, int(cols.min()) + self.low)
