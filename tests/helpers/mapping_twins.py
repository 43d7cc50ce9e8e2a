"""Plain, slow twins of the mapping kernels: what the fast ones have to agree with, written from DESIGN's words."""

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import Frame, Segmentation

Cell = tuple[int, int]


class PlainMap:
    """The map of some frames, one pixel at a time, in dictionaries keyed by (row, col) from the map's origin."""

    def __init__(self, *, cell_size_m=0.05, near=0.1, far=6.0, cut=2.0, below=0.3, obstacle=0.1, reach=2) -> None:
        self.size, self.near, self.far, self.cut, self.below = cell_size_m, near, far, cut, below
        self.obstacle, self.reach = obstacle, reach
        self.top: dict[Cell, float] = {}
        self.label: dict[Cell, str] = {}
        self.lowest: dict[Cell, float] = {}
        self.frames: dict[Cell, set[int]] = defaultdict(set)
        self.links: dict[tuple[str, Cell, Cell], int] = defaultdict(int)
        self.readings: set[tuple[int, Cell, int]] = set()

    def add(self, frame: Frame, segmentation: Segmentation, T_map_camera: NDArray) -> None:
        k, names = frame.intrinsics, {s.id: s for s in segmentation.segments}
        height, width = frame.depth_m.shape
        cells: dict[tuple[int, int], Cell] = {}
        frame_top: dict[Cell, tuple[float, int]] = {}
        for v in range(height):
            for u in range(width):
                z = float(frame.depth_m[v, u])
                if not self.near < z < self.far:
                    continue
                ray = np.array([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z, 1.0])
                x, y, h = (T_map_camera @ ray)[:3]
                if not -self.below < h < self.cut:
                    continue
                cell = (int(np.floor(y / self.size)), int(np.floor(x / self.size)))
                segment = int(segmentation.ids[v, u])
                cells[v, u] = cell
                self.frames[cell].add(frame.index)
                if cell not in self.top or h > self.top[cell]:
                    self.top[cell] = h
                    self.label[cell] = names[segment].label if segment else "none"
                if cell not in frame_top or h > frame_top[cell][0]:
                    frame_top[cell] = (h, segment)
                if h >= self.obstacle:
                    self.lowest[cell] = min(h, self.lowest.get(cell, np.inf))
        for cell, (_, segment) in frame_top.items():
            self.readings.add((frame.index, cell, segment))
        for (v, u), cell in cells.items():
            segment = int(segmentation.ids[v, u])
            if segment == 0 or not names[segment].is_thing:
                continue
            for other in ((v, u - 1), (v - 1, u)):
                if other not in cells or cells[other] == cell or segmentation.ids[other] != segment:
                    continue
                a, b = sorted((cell, cells[other]))
                if self.reach >= 0 and max(abs(a[0] - b[0]), abs(a[1] - b[1])) > self.reach:
                    continue
                self.links[names[segment].label, a, b] += 1


def plain_merge_steps(community: NDArray, edges: NDArray) -> list[tuple[int, int, float]]:
    """The K % rule, counted anew for every step."""
    mine = community.copy()
    steps = []
    while True:
        best = None
        for c1 in np.unique(mine):
            members = set(np.flatnonzero(mine == c1).tolist())
            touching: dict[int, set[int]] = defaultdict(set)
            for a, b in edges.tolist():
                for here, there in ((a, b), (b, a)):
                    if here in members and mine[there] != c1:
                        touching[int(mine[there])].add(here)
            for c2, cells in touching.items():
                offer = (-len(cells) / len(members), int(c1), c2)
                if best is None or offer < best:
                    best = offer
        if best is None:
            return steps
        share, c1, c2 = best
        steps.append((c1, c2, -share))
        mine[mine == c1] = c2
