"""Shared by the tests of recorder and others."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.events import BuildFinished, BuildStarted, CommunitiesFound, Event, FrameProjected, MergesFound
from simaps_viz.recorder.recorder import RerunRecorder
from simaps_viz.recorder.settings import RecorderSettings
from simaps_viz.structures import (
    Frame,
    Grid,
    GridSpec,
    Instance,
    Intrinsics,
    MergeLog,
    Segment,
    Segmentation,
    SIMap,
    Views,
)

LABELS, IS_THING = ("none", "chair", "floor"), (False, True, False)
CELL_M = 0.1


CAMERA = Intrinsics(width=16, height=12, fx=10.0, fy=10.0, cx=7.5, cy=5.5)


WHOLE = RecorderSettings(
    color_every=1, color_divide=1, depth_every=1, depth_divide=2, segmentation_divide=1, points=4000, edges=100
)


FRAMES = 4


def grid(step: int) -> Grid:
    """4 + step columns, 3 rows: a column of floor is found in the west at each step, so the origin moves.

    Two chair cells in the northern row stay where they are: x from 0.2 to 0.4 m.
    """
    spec = GridSpec(rows=3, cols=4 + step, cell_size_m=CELL_M, x0_m=-CELL_M * step, y0_m=1.0)
    label = np.full(spec.shape, 2, np.int16)
    label[2, 2 + step : 4 + step] = 1
    label[0, -1] = 0
    height = np.where(label == 1, 0.5, 0.0).astype(np.float32)
    height[label == 0] = np.nan
    seen = (label > 0).astype(np.int32)
    return Grid(spec, LABELS, IS_THING, label, height, np.where(label == 1, 0.5, np.nan).astype(np.float32), seen)


def pose(step: int) -> NDArray:
    """Camera at (step, 2, 1), looking north: camera z is y, camera y is -z."""
    T = np.eye(4)
    T[:3, :3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=float)
    T[:3, 3] = (step, 2.0, 1.0)
    return T


def projected(step: int) -> FrameProjected:
    """Depth 2 m everywhere but one invalid pixel; segment 7 is the left half."""
    depth = np.full((CAMERA.height, CAMERA.width), 2.0, np.float32)
    depth[0, 0] = 0.0
    color = np.full((*depth.shape, 3), (200, 100, 50), np.uint8)
    ids = np.zeros(depth.shape, np.int32)
    ids[:, :8] = 7
    edges = np.array([[2, 2 + step, 2, 3 + step]], np.int32)[: 1 if step < 3 else 0]
    return FrameProjected(
        frame=Frame(step, f"{step:04d}", depth, pose(step), CAMERA, color),
        segmentation=Segmentation(ids, (Segment(7, "chair", 0.875),)),
        T_map_camera=pose(step),
        cells=np.argwhere(grid(step).observations > 0).astype(np.int32),
        new_edges=edges,
        new_edge_labels=np.ones(len(edges), np.int16),
        snapshot=lambda: grid(step),
    )


def communities(step: int) -> NDArray:
    """Two chair cells, communities 4 and 9."""
    found = np.zeros(grid(step).spec.shape, np.int32)
    found[2, 2 + step], found[2, 3 + step] = 9, 4
    return found


MERGES = MergeLog(
    np.array([1], np.int16), np.array([9], np.int32), np.array([4], np.int32), np.array([0.5], np.float32)
)


EMPTY = np.zeros(0, np.int32)


def finished() -> SIMap:
    last = grid(FRAMES - 1)
    return SIMap(
        grid=last,
        instance=np.where(communities(FRAMES - 1) > 0, 4, 0).astype(np.int32),
        instances=(Instance(4, "chair", 2, (0.3, 1.25, 0.5), ((0.2, 1.2, 0.5), (0.4, 1.3, 0.5)), 4, 0.875),),
        T_map_world=np.eye(4),
        method="paper",
        parameters={"k_percent": 5.0, "resolution": 1.0},
        provenance={},
        community=communities(FRAMES - 1),
        merges=MERGES,
        graphs=(),
        views=Views(EMPTY, EMPTY, EMPTY, EMPTY, np.zeros(0, np.float32)),
        frame_names=tuple(f"{i:04d}" for i in range(FRAMES)),
        T_map_camera=np.stack([pose(i) for i in range(FRAMES)]),
    )


def story(*, simulated: bool = True) -> Iterator[Event]:
    yield BuildStarted("toy", finished().frame_names, np.eye(4), "made by hand", simulated)
    for step in range(FRAMES):
        yield projected(step)
        if step == 1:
            yield CommunitiesFound(grid(1), communities(1), 1, final=False)
    last = grid(FRAMES - 1)
    yield CommunitiesFound(last, communities(FRAMES - 1), FRAMES - 1, final=True)
    yield MergesFound(last, communities(FRAMES - 1), MERGES, np.array([True]))
    yield BuildFinished(finished())


def record(path: Path, settings: RecorderSettings = WHOLE, *, simulated: bool = True) -> Path:
    with RerunRecorder(path, settings=settings) as recorder:
        for event in story(simulated=simulated):
            recorder.on_event(event)
    return path


def rows(recording: Any, contents: str, *, timeline: str | None = "frame", at: list[int] | None = None) -> dict:
    """Column name without its path -> one value per row; what holds at the times ``at``, or the rows there are."""
    more = {} if at is None else {"using_index_values": np.array(at), "fill_latest_at": True}
    table = recording.reader(index=timeline, contents=contents, **more).to_arrow_table().to_pydict()
    return {name.rsplit(":", 1)[-1]: values for name, values in table.items()}


def image(found: dict, row: int, dtype: type) -> NDArray:
    shape = found["format"][row][0]
    buffer = np.array(found["buffer"][row][0], np.uint8)
    return buffer.view(dtype).reshape(shape["height"], shape["width"])


def palette(found: dict, row: int) -> dict[int, tuple[str, int]]:
    entries = [entry["class_description"]["info"] for entry in found["context"][row][0]]
    return {entry["id"]: (entry["label"], entry["color"]) for entry in entries}


def rgba(color: tuple[int, int, int]) -> int:
    return (color[0] << 24) | (color[1] << 16) | (color[2] << 8) | 255
