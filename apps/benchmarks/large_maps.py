"""Made-up maps as large as asked for, to see what the page does with them. Simulated: no camera saw them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.mapping.projection import STEPS_PER_M
from simaps_viz.mapping.simap import Origin, assemble
from simaps_viz.mapping.surface import Surface
from simaps_viz.structures import CellGraph, Grid, GridSpec, MergeLog, SIMap, Views

CLASSES = ("chair", "dining table", "couch", "potted plant", "bed", "tv", "book", "lamp", "bench", "shelf")
LABELS = ("none", *CLASSES, "floor", "wall")
CELL_SIZE_M = 0.05
FRAMES = 40
WALL_EVERY = 100
"""Cells between walls."""
PARTS = 2
"""Finest communities of an object, side by side."""
VIEWS = 4
"""Frames that saw a community."""


def large_map(rows: int, cols: int, objects: int, *, seed: int = 0, edges: bool = True) -> SIMap:
    """Make a map of boxes on a jittered lattice, each of two communities; method paper, so that K joins them.

    Args:
        rows: cells from south to north.
        cols: cells from west to east.
        objects: about how many; the lattice decides.
        seed: of sizes, places and classes.
        edges: whether the cell graphs get edges, which take most of the memory.

    Returns:
        A map whose provenance says that it is simulated.
    """
    rng = np.random.default_rng(seed)
    spec = GridSpec(rows, cols, CELL_SIZE_M, 0.0, 0.0)
    number, part = _boxes(spec, objects, rng)
    count = int(number.max(initial=0))
    kind = rng.integers(1, 1 + len(CLASSES), count + 1)
    community = np.where(number > 0, (number - 1) * PARTS + 1 + part, 0).astype(np.int32)
    grid = _grid(spec, number, kind, rng)
    return assemble(
        grid,
        tuple(_graphs(grid, number, community, edges)),
        community,
        _merges(kind, count, rng),
        _views(community, count, rng),
        Origin(
            T_map_world=np.eye(4),
            method="paper",
            parameters={"k_percent": 5.0, "resolution": 1.0},
            provenance={"sequence": "large", "name": f"{rows} x {cols} cells", "simulated": True,
                        "segmentation": "simulated"},
            frame_names=tuple(f"{i:06d}" for i in range(FRAMES)),
            T_map_camera=_cameras(spec),
        ),
    )  # fmt: skip


def surfaced(simap: SIMap) -> SIMap:
    """Give a map the surface that cameras would see of its columns: their tops, and their sides above neighbours."""
    top = np.floor(np.nan_to_num(simap.grid.height_m) * STEPS_PER_M + 0.01).astype(np.int8)
    p = np.pad(top, 1, mode="edge")
    foot = np.minimum.reduce([p[:-2, 1:-1], p[2:, 1:-1], p[1:-1, :-2], p[1:-1, 2:]])
    cell = np.arange(top.size, dtype=np.int32)
    low = np.minimum(foot + 1, top).astype(np.int8)
    return replace(simap, surface=Surface(simap.spec, cell, low.reshape(-1), top.reshape(-1), np.zeros_like(cell)))


def _boxes(spec: GridSpec, objects: int, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Return int32 [rows, cols]: the object of each cell, 0 = none; and the part of it, 0 .. PARTS - 1."""
    pitch = max(int(np.sqrt(spec.rows * spec.cols / max(objects, 1))), 3)
    down, across = max(spec.rows // pitch, 1), max(spec.cols // pitch, 1)
    number, part = np.zeros(spec.shape, np.int32), np.zeros(spec.shape, np.int8)
    size = rng.integers(max(2, pitch // 3), pitch, (down, across, 2))
    shift = rng.random((down, across, 2))
    for i in range(down):
        for j in range(across):
            h, w = (int(n) for n in size[i, j])
            r = i * pitch + int(shift[i, j, 0] * (pitch - h))
            c = j * pitch + int(shift[i, j, 1] * (pitch - w))
            number[r : r + h, c : c + w] = i * across + j + 1
            part[r : r + h, c + w // 2 : c + w] = 1
    return number, part


def _grid(spec: GridSpec, number: NDArray, kind: NDArray, rng: np.random.Generator) -> Grid:
    label = np.full(spec.shape, LABELS.index("floor"), np.int16)
    height = np.zeros(spec.shape, np.float32)
    for wall in (np.s_[::WALL_EVERY], np.s_[:, ::WALL_EVERY]):
        label[wall], height[wall] = LABELS.index("wall"), 2.0
    there = number > 0
    label[there] = kind[number[there]]
    height[there] = rng.uniform(0.3, 1.4, len(kind)).astype(np.float32)[number[there]]
    lowest = np.where(height > 0, np.float32(0.1), np.float32(np.nan))
    is_thing = tuple(name in CLASSES for name in LABELS)
    return Grid(spec, LABELS, is_thing, label, height, lowest, np.full(spec.shape, 5, np.int32))


def _graphs(grid: Grid, number: NDArray, community: NDArray, edges: bool) -> list[CellGraph]:
    flat = np.arange(number.size).reshape(number.shape)
    pairs = [np.zeros((0, 2), np.int64)]
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])) if edges else ():
        same = (number[a] > 0) & (number[a] == number[b])
        pairs.append(np.column_stack([flat[a][same], flat[b][same]]))
    every, label, within = np.concatenate(pairs), grid.label.reshape(-1), community.reshape(-1)
    graphs = []
    for kind in np.unique(label[within > 0]).tolist():
        cells = np.flatnonzero((label == kind) & (within > 0)).astype(np.int64)
        ends = np.searchsorted(cells, every[label[every[:, 0]] == kind]).astype(np.int32)
        ends = ends[np.lexsort((ends[:, 1], ends[:, 0]))]
        counts = np.full(len(ends), 10, np.int64)
        graphs.append(
            CellGraph(int(kind), cells, ends, counts, np.zeros_like(counts), np.full(len(cells), 5, np.int32))
        )
    return graphs


def _merges(kind: NDArray, count: int, rng: np.random.Generator) -> MergeLog:
    """The second part of each object joins its first, at a share that K can forbid."""
    share = rng.uniform(0.02, 0.6, count).astype(np.float32)
    order = np.lexsort((-share, kind[1:]))
    first = (order * PARTS + 1).astype(np.int32)
    return MergeLog(kind[1:][order].astype(np.int16), first + 1, first, share[order])


def _views(community: NDArray, count: int, rng: np.random.Generator) -> Views:
    cells = np.bincount(community.reshape(-1), minlength=count * PARTS + 1)
    names = np.repeat(np.flatnonzero(cells[1:]) + 1, VIEWS).astype(np.int32)
    frame = rng.integers(0, FRAMES, len(names)).astype(np.int32)
    return Views(names, frame, names, cells[names].astype(np.int32), np.full(len(names), 0.9, np.float32))


def _cameras(spec: GridSpec) -> NDArray:
    """Cameras 1.5 m high along the middle, looking level to the east."""
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    xmin, ymin, xmax, ymax = spec.extent_m
    poses[:, :3, :3] = np.column_stack([(0, -1, 0), (0, 0, -1), (1, 0, 0)])
    poses[:, 0, 3] = np.linspace(xmin + 1.0, xmax - 1.0, FRAMES)
    poses[:, 1, 3], poses[:, 2, 3] = (ymin + ymax) / 2.0, 1.5
    return poses
