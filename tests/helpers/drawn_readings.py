"""Small grids, readings and frames, drawn or random, for method evidence. The first line of a drawing is row 0."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.mapping.evidence import EvidenceSettings, pair_graphs
from simaps_viz.mapping.observations import Readings
from simaps_viz.mapping.pooling import partition_evidence
from simaps_viz.mapping.simap import Origin, assemble, count_views
from simaps_viz.structures import Frame, Grid, GridSpec, Segmentation, SIMap

LABELS = ("none", "chair", "floor", "table", "rug")
IS_THING = (False, True, False, True, True)
MARKS = {".": 0, "c": 1, "_": 2, "t": 3, "r": 4, "?": 0}
"""Class of each character of a drawn grid; "." is seen but unnamed, "?" never seen."""
TOPS_M = {".": 0.30, "c": 0.45, "_": 0.0, "t": 0.75, "r": 0.01, "?": np.nan}


def drawn_grid(drawing: str, tops_m: Mapping[str, float] | None = None) -> Grid:
    """Make a grid; every character is a cell, see ``MARKS``."""
    marks = np.array([list(line.strip()) for line in drawing.strip().splitlines()])
    heights = {**TOPS_M, **(tops_m or {})}
    top = np.vectorize(heights.__getitem__)(marks).astype(np.float32)
    return grid_of(np.vectorize(MARKS.__getitem__)(marks).astype(np.int16), top)


def grid_of(label: NDArray, top: NDArray, labels: tuple[str, ...] = LABELS, things=IS_THING) -> Grid:
    """Make a grid of its labels and tops."""
    seen = (~np.isnan(top)).astype(np.int32)
    return Grid(GridSpec(label.shape[0], label.shape[1], 0.05, 0.0, 0.0), labels, things, label, top, top.copy(), seen)


def drawn_readings(
    grid: Grid,
    looks: Sequence[str],
    classes: Mapping[str, str],
    *,
    scores: Mapping[str, float] | None = None,
    below_m: Mapping[str, float] | None = None,
) -> Readings:
    """Make readings; every look is a frame, every character of it the segment seen there.

    Args:
        grid: what is looked at.
        looks: drawings of the grid's shape; "?" is out of sight, "." in sight but in no segment.
        classes: {character: class}.
        scores: {character: confidence}, else 1.
        below_m: {character: how far below the cell's top it was seen}, else 0.
    """
    rows: list[tuple[float, ...]] = []
    top = grid.height_m.reshape(-1)
    for frame, look in enumerate(looks):
        seen = "".join(look.split())
        assert len(seen) == top.size
        for cell, mark in enumerate(seen):
            if mark == "?":
                continue
            segment = 0 if mark == "." else ord(mark)
            label = 0 if mark == "." else LABELS.index(classes[mark])
            score = 0.0 if mark == "." else (scores or {}).get(mark, 1.0)
            rows.append((cell, frame, segment, label, score, top[cell] - (below_m or {}).get(mark, 0.0)))
    return readings_of(np.array(rows).reshape(-1, 6))


def readings_of(rows: NDArray) -> Readings:
    """Make readings of a table [v, 6]: cell, frame, segment, label, score, height."""
    types = (np.int32, np.int32, np.int32, np.int16, np.float32, np.float32)
    return Readings(*(rows[:, i].astype(dtype) for i, dtype in enumerate(types)))


def random_readings(
    seed: int, *, shape: tuple[int, int] = (12, 14), frames: int = 5, classes: int = len(LABELS)
) -> tuple[Grid, Readings]:
    """Blocky classes and segments that mostly agree; scores are eighths, heights steps of 3 cm."""
    rng = np.random.default_rng(seed)
    rows, cols = shape

    def blocky(low: int, high: int) -> NDArray:
        wide = np.kron(rng.integers(low, high, (-(-rows // 3), -(-cols // 4))), np.ones((3, 4), int))
        return wide[:rows, :cols].reshape(-1)

    label = blocky(0, classes)
    top = (blocky(0, 8) * 0.03).astype(np.float32)
    top[rng.random(top.size) < 0.05] = np.nan
    label[np.isnan(top)] = 0
    table = []
    for frame in range(frames):
        segment_of, class_of = blocky(0, 7), rng.integers(1, classes, 7)
        for cell in np.flatnonzero(~np.isnan(top) & (rng.random(top.size) < 0.7)):
            segment = int(segment_of[cell])
            named = int(label[cell]) if segment and label[cell] and rng.random() < 0.7 else int(class_of[segment])
            named = named if segment else 0
            number = segment * len(LABELS) + named if segment else 0  # one segment, one class
            score = rng.integers(1, 9) / 8 if segment else 0.0
            table.append((cell, frame, number, named, score, top[cell] - rng.choice([0.0, 0.0, 0.03, 0.09])))
    return grid_of(label.reshape(shape).astype(np.int16), top.reshape(shape)), readings_of(
        np.array(table).reshape(-1, 6)
    )


def evidence_map(
    grid: Grid,
    readings: Readings,
    *,
    settings: EvidenceSettings | None = None,
    affinity: float = 0.6,
    resolution: float = 1.0,
) -> SIMap:
    """Partition a grid by method evidence, with nothing too small to be an instance."""
    graphs = pair_graphs(grid, readings, settings or EvidenceSettings())
    community, log = partition_evidence(grid, graphs, resolution=resolution, seed=0)
    parameters = {"affinity": affinity, "resolution": resolution, "seed": 0, "min_cells": 1}
    frames = int(readings.frame.max(initial=-1)) + 1
    origin = Origin(
        np.eye(4), "evidence", parameters, {}, tuple(map(str, range(frames))), np.tile(np.eye(4), (frames, 1, 1))
    )
    return assemble(grid, graphs, community, log, count_views(grid, community, readings), origin)


@dataclass(frozen=True, eq=False)
class MemorySource:
    """Frames at hand as a `FrameSource`; world and map frame are the same."""

    parts: Sequence[tuple[Frame, Segmentation, NDArray]]
    labels: tuple[str, ...]
    is_thing: tuple[bool, ...]
    name: str = "memory"
    path: Path = Path("memory")
    segmentation_source: str = "made by the test"
    simulated: bool = True

    @property
    def frame_names(self) -> tuple[str, ...]:
        return tuple(frame.name for frame, _, _ in self.parts)

    @property
    def poses(self) -> NDArray:
        return np.array([T for _, _, T in self.parts])

    @property
    def T_map_world(self) -> NDArray:
        return np.eye(4)

    def __len__(self) -> int:
        return len(self.parts)

    def described(self) -> bytes:
        return repr(self.parts[0][0].intrinsics).encode()

    def read(self, index: int, *, color: bool = False) -> Frame:
        return self.parts[index][0]

    def segmentation(self, index: int) -> Segmentation:
        return self.parts[index][1]
