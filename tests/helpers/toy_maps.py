"""Small exact maps made by hand: every cell, distance and merge step of them can be checked on paper.

``toy_map()``, 6 x 5 m, x from -1 to 5, y from -2 to 3, seen from above (north up, one letter a piece of furniture)::

    +------------------------+-----------------------+
    |                        |       CCCCCC          |   C  couch
    |     TTTTTT  1          |                       |   T  dining table (id 6: two communities, 6 and 7)
    |     TTTTTT  1          |                       |   1  chair (id 1: two communities, 1 and 2)
    |                                                |
    |        > start                   UUUUU         |   U  dining table (id 8)
    |                                                |
    |    3                   |          4            |   3, 4  chairs (ids 3 and 4)
    |??                      |                  P    |   P  potted plant (id 9);  ?  never seen
    +------------------------+-----------------------+
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import CellGraph, Grid, GridSpec, Instance, MergeLog, Pose2, SIMap, Views

LABELS = ("none", "chair", "couch", "dining table", "potted plant", "tv", "floor", "wall")
_NO_THINGS = ("none", "floor", "wall")
TOY_SPEC = GridSpec(rows=100, cols=120, cell_size_m=0.05, x0_m=-1.0, y0_m=-2.0)
TOY_POSE = Pose2.from_heading(0.5, 0.5, 90.0)
"""In the west room, looking east at the doorway."""
FRAMES = tuple(f"{i:06d}" for i in range(5))


@dataclass(frozen=True)
class Box:
    """A block of cells of one object (or of wall)."""

    label: str
    row: int
    col: int
    rows: int
    cols: int
    height_m: float
    """Height of its top."""
    parts: int = 1
    """Number of communities, side by side along the columns."""
    lowest_m: float = 0.12
    """Lowest pixel at least 0.1 m over the floor."""

    @property
    def block(self) -> tuple[slice, slice]:
        return slice(self.row, self.row + self.rows), slice(self.col, self.col + self.cols)


TOY_THINGS = (
    Box("chair", 74, 41, 8, 8, 0.85, parts=2),
    Box("chair", 20, 12, 8, 8, 0.85),
    Box("chair", 24, 92, 8, 8, 0.85),
    Box("couch", 84, 80, 10, 24, 0.70),
    Box("dining table", 70, 20, 12, 18, 0.75, parts=2),
    Box("dining table", 40, 88, 12, 16, 0.75),
    Box("potted plant", 8, 108, 6, 6, 1.10),
)
TOY_WALLS = (
    Box("wall", 0, 0, 2, 120, 2.0),
    Box("wall", 98, 0, 2, 120, 2.0),
    Box("wall", 0, 0, 100, 2, 2.0),
    Box("wall", 0, 118, 100, 2, 2.0),
    Box("wall", 2, 60, 38, 2, 2.0),
    Box("wall", 60, 60, 38, 2, 2.0),
)
TOY_UNSEEN = (Box("none", 2, 2, 10, 10, np.nan),)
TOY_BRIDGES = (((27, 19), (74, 41)),)
"""One wrong edge between chairs 3 and 1: at K = 0 they become one."""


def toy_map(*, k_percent: float = 5.0) -> SIMap:
    """Return the map drawn above, method paper.

    The merge log, in order: 2 -> 1 (share 0.25), 3 -> 1 (share 1/64); 7 -> 6 (share 1/9).
    So there are 3 chairs and 2 tables while 1.57 < K < 11.1, 3 tables from 11.2, 4 chairs from K = 25, 2 chairs at 0.
    """
    return map_of_boxes(
        TOY_SPEC, (*TOY_THINGS,), TOY_WALLS, unseen=TOY_UNSEEN, bridges=TOY_BRIDGES, k_percent=k_percent
    )


def map_from_drawing(
    drawing: str, things: Mapping[str, str] | None = None, *, cells: int = 4, cell_size_m: float = 0.05
) -> SIMap:
    """Make a map from a drawing, north up: ``#`` wall, ``.`` floor, ``?`` never seen, other letters one object each.

    Args:
        drawing: lines of one length.
        things: {letter: label}; the letters' connected blocks must be rectangles.
        cells: how many cells wide and high a character is.
        cell_size_m: edge of a cell; the origin is (0, 0).
    """
    lines = [line.strip() for line in drawing.strip().splitlines()][::-1]
    letters = np.array([list(line) for line in lines])
    spec = GridSpec(letters.shape[0] * cells, letters.shape[1] * cells, cell_size_m, 0.0, 0.0)
    boxes = {"#": ("wall", 2.0), "?": ("none", np.nan)}
    single = {
        mark: [Box(label, r * cells, c * cells, cells, cells, h) for r, c in np.argwhere(letters == mark)]
        for mark, (label, h) in boxes.items()
    }
    found = []
    for mark, label in (things or {}).items():
        where = np.argwhere(letters == mark)
        low, size = where.min(axis=0) * cells, (np.ptp(where, axis=0) + 1) * cells
        found.append(Box(label, int(low[0]), int(low[1]), int(size[0]), int(size[1]), 0.8))
    return map_of_boxes(spec, found, single["#"], unseen=single["?"])


def furnished_map(plan: Mapping[str, Any]) -> SIMap:
    """Make a map of size_m, walls [x0, y0, x1, y1] and things [class, x0, y0, x1, y1, height], metres from (0, 0)."""

    def box(label: str, corners: Sequence[float], height_m: float) -> Box:
        left, low, right, top = (round(value / TOY_SPEC.cell_size_m) for value in corners)
        return Box(label, low, left, top - low, right - left, height_m)

    cols, rows = (round(size / TOY_SPEC.cell_size_m) for size in plan["size_m"])
    return map_of_boxes(
        GridSpec(rows, cols, TOY_SPEC.cell_size_m, 0.0, 0.0),
        [box(thing[0], thing[1:5], thing[5]) for thing in plan["things"]],
        [box("wall", wall, 2.5) for wall in plan["walls"]],
        labels=("none", *sorted({thing[0] for thing in plan["things"]}), "floor", "wall"),
    )


def map_of_boxes(
    spec: GridSpec,
    things: Sequence[Box],
    walls: Sequence[Box] = (),
    *,
    unseen: Sequence[Box] = (),
    bridges: Sequence[tuple[tuple[int, int], tuple[int, int]]] = (),
    k_percent: float = 5.0,
    labels: tuple[str, ...] = LABELS,
) -> SIMap:
    """Make a whole map of blocks of cells on a seen floor; communities are numbered in the order of ``things``."""
    community = np.zeros(spec.shape, np.int32)
    parts_of = []
    for thing in things:
        first = int(community.max()) + 1
        numbers = first + np.arange(thing.cols) * thing.parts // thing.cols
        community[thing.block] = numbers
        parts_of.append(tuple(range(first, first + thing.parts)))
    grid = _grid(spec, things, walls, unseen, labels)
    graphs = _graphs(grid, community, bridges)
    merges = _merge_log(grid, things, parts_of, community, bridges)
    views = _views(community, len(FRAMES))
    first_of = _instance_of_community(merges, int(community.max()), k_percent)
    instance = first_of[community].astype(np.int32)
    return SIMap(
        grid=grid,
        instance=instance,
        instances=_instances(grid, instance, first_of, views),
        T_map_world=np.eye(4),
        method="paper",
        parameters={"k_percent": k_percent, "resolution": 1.0},
        provenance={"sequence": "toy", "segmentation": "simulated by hand", "simulated": True},
        community=community,
        merges=merges,
        graphs=graphs,
        views=views,
        frame_names=FRAMES,
        T_map_camera=_cameras(spec),
    )


def _grid(
    spec: GridSpec, things: Sequence[Box], walls: Sequence[Box], unseen: Sequence[Box], labels: tuple[str, ...]
) -> Grid:
    label = np.full(spec.shape, labels.index("floor"), np.int16)
    height = np.zeros(spec.shape, np.float32)
    lowest = np.full(spec.shape, np.nan, np.float32)
    observations = np.full(spec.shape, 5, np.int32)
    for box in (*walls, *things):
        label[box.block] = labels.index(box.label)
        height[box.block] = box.height_m
        lowest[box.block] = box.lowest_m
    for box in unseen:
        label[box.block], height[box.block] = 0, np.nan
        lowest[box.block], observations[box.block] = np.nan, 0
    return Grid(spec, labels, tuple(name not in _NO_THINGS for name in labels), label, height, lowest, observations)


def _edges(community: NDArray, label: NDArray) -> NDArray:
    """All pairs of 4-neighbouring cells of one class and one object, as flat cell numbers [m, 2]."""
    rows, cols = community.shape
    flat = np.arange(rows * cols).reshape(rows, cols)
    inside = community > 0
    pairs = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        keep = inside[a] & inside[b] & (label[a] == label[b])
        pairs.append(np.column_stack([flat[a][keep], flat[b][keep]]))
    return np.concatenate(pairs)


def _graphs(grid: Grid, community: NDArray, bridges: Sequence) -> tuple[CellGraph, ...]:
    flat_label = grid.label.ravel()
    cols = grid.spec.cols
    extra = np.array([[ra * cols + ca, rb * cols + cb] for (ra, ca), (rb, cb) in bridges], np.int64).reshape(-1, 2)
    pairs = np.concatenate([_edges(community, grid.label), np.sort(extra, axis=1)])
    counts = np.r_[np.full(len(pairs) - len(extra), 10), np.ones(len(extra))].astype(np.int64)
    graphs = []
    for label in np.unique(flat_label[community.ravel() > 0]):
        cells = np.flatnonzero(flat_label == label).astype(np.int64)
        keep = flat_label[pairs[:, 0]] == label
        edges = np.searchsorted(cells, pairs[keep]).astype(np.int32)
        order = np.lexsort((edges[:, 1], edges[:, 0]))
        kept = counts[keep][order]
        seen = np.full(len(cells), 5, np.int32)
        graphs.append(CellGraph(int(label), cells, edges[order], kept, np.zeros_like(kept), seen))
    return tuple(graphs)


def _merge_log(
    grid: Grid, things: Sequence[Box], parts_of: Sequence[tuple[int, ...]], community: NDArray, bridges: Sequence
) -> MergeLog:
    """Every object's parts join (share: one column of cells), then the bridges (share: one cell), class by class."""
    steps: list[tuple[int, int, float, int, int]] = []
    for thing, parts in zip(things, parts_of, strict=True):
        label = grid.labels.index(thing.label)
        steps += [(label, 0, -thing.parts / thing.cols, part, parts[0]) for part in parts[1:]]
    for a, b in bridges:
        ends = sorted(int(community[cell]) for cell in (a, b))
        cells = int((community == ends[1]).sum())
        steps.append((int(grid.label[a]), 1, -1.0 / cells, ends[1], ends[0]))
    steps.sort()
    label, _, score, source, target = zip(*steps, strict=True) if steps else ((), (), (), (), ())
    return MergeLog(
        np.array(label, np.int16),
        np.array(source, np.int32),
        np.array(target, np.int32),
        -np.array(score, np.float32),
    )


def _instance_of_community(merges: MergeLog, communities: int, k_percent: float) -> NDArray:
    """[communities + 1]: the instance (smallest community) each community belongs to; 0 stays 0."""
    owner = np.arange(communities + 1)
    for source, target, score in zip(merges.source, merges.target, merges.score, strict=True):
        if score * 100.0 > k_percent:
            a, b = owner[source], owner[target]
            owner[(owner == a) | (owner == b)] = min(a, b)
    return owner


def _views(community: NDArray, frames: int) -> Views:
    """Community c is seen in every frame but number c mod 5, as segment 10 + c."""
    names, sizes = np.unique(community[community > 0], return_counts=True)
    rows = [
        (c, f, 10 + c, n, 0.5 + 0.1 * f) for c, n in zip(names, sizes, strict=True) for f in range(frames) if f != c % 5
    ]
    columns = list(zip(*rows, strict=True)) or [()] * 5
    first = [np.array(column, np.int32) for column in columns[:4]]
    return Views(first[0], first[1], first[2], first[3], np.array(columns[4], np.float32))


def _instances(grid: Grid, instance: NDArray, first_of: NDArray, views: Views) -> tuple[Instance, ...]:
    spec, found = grid.spec, []
    for number in np.unique(instance[instance > 0]):
        row, col = np.nonzero(instance == number)
        x, y = spec.x0_m + (col + 0.5) * spec.cell_size_m, spec.y0_m + (row + 0.5) * spec.cell_size_m
        top = grid.height_m[row, col].astype(float)
        half = spec.cell_size_m / 2
        seen = first_of[views.community] == number
        found.append(
            Instance(
                id=int(number),
                label=grid.labels[grid.label[row[0], col[0]]],
                cells=len(row),
                centroid_m=(float(x.mean()), float(y.mean()), float(top.mean())),
                aabb_m=(
                    (float(x.min() - half), float(y.min() - half), float(top.min())),
                    (float(x.max() + half), float(y.max() + half), float(top.max())),
                ),
                frames=len(np.unique(views.frame[seen])),
                score=float(np.average(views.score[seen], weights=views.cells[seen])),
            )
        )
    return tuple(sorted(found, key=lambda i: (grid.labels.index(i.label), i.id)))


def _cameras(spec: GridSpec) -> NDArray:
    """Five cameras 1.2 m high on a west-east line through the middle, looking level, each turned 72 degrees further."""
    xmin, ymin, xmax, ymax = spec.extent_m
    poses = np.tile(np.eye(4), (len(FRAMES), 1, 1))
    for i, x in enumerate(np.linspace(xmin + 0.2 * (xmax - xmin), xmax - 0.2 * (xmax - xmin), len(FRAMES))):
        yaw = 2.0 * np.pi * i / len(FRAMES)
        forward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        down = np.array([0.0, 0.0, -1.0])
        poses[i, :3, :3] = np.column_stack([np.cross(down, forward), down, forward])
        poses[i, :3, 3] = (x, (ymin + ymax) / 2.0, 1.2)
    return poses
