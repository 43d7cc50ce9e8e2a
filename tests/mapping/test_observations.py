"""What each frame saw on top of each cell, against its plain twin."""

from dataclasses import replace

import numpy as np
import pytest
from evidence_twins import plain_readings
from random_frames import IS_THING, LABELS, random_frames

from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.observations import FrameReadings, Readings, gather_readings
from simaps_viz.structures import Grid, Segmentation


def gathered(parts, labels=LABELS, things=IS_THING) -> tuple[Grid, Readings, tuple[int, int]]:
    accumulator = MapAccumulator(labels, things, ProjectionSettings(), links=False)
    for frame, segmentation, T_map_camera in parts:
        accumulator.add_frame(frame, segmentation, T_map_camera)
    grid, origin = accumulator.snapshot(), accumulator.origin_cell
    segments = [segmentation.segments for _, segmentation, _ in parts]
    return grid, gather_readings(accumulator.readings, segments, origin, grid.labels, grid.spec.cols), origin


def walked(parts):
    """The same frames, each taken 11 m further, so that the window has to grow and its origin to move."""
    for step, (frame, segmentation, T_map_camera) in enumerate(parts):
        T = T_map_camera.copy()
        T[:2, 3] += step * np.array([-11.0, 5.0])
        yield frame, segmentation, T


@pytest.mark.parametrize("move", [list, lambda parts: list(walked(parts))])
@pytest.mark.parametrize("seed", range(3))
def test_readings_are_the_twins(seed, move):
    parts = move(random_frames(seed))
    grid, found, (row0, col0) = gathered(parts)
    twin = {(frame, cell): rest for frame, cell, *rest in plain_readings(parts)}
    rows, cols = np.divmod(found.cell, grid.spec.cols)
    keys = [(int(f), (int(r) + row0, int(c) + col0)) for f, r, c in zip(found.frame, rows, cols, strict=True)]
    assert len(keys) == len(set(keys)) == len(twin) and set(keys) == set(twin)
    for i, key in enumerate(keys):
        segment, label, score, height = twin[key]
        assert (int(found.segment[i]), grid.labels[found.label[i]]) == (segment, label)
        assert found.score[i] == np.float32(score) and found.height_m[i] == pytest.approx(height, abs=1e-5)


def test_readings_agree_with_the_grid_they_lie_on():
    grid, found, _ = gathered(random_frames(7, frames=6))
    top = np.full(grid.label.size, -np.inf, np.float32)
    np.maximum.at(top, found.cell, found.height_m)
    assert np.array_equal(np.where(np.isinf(top), np.nan, top), grid.height_m.reshape(-1), equal_nan=True)
    assert np.array_equal(np.bincount(found.cell, minlength=top.size), grid.observations.reshape(-1))
    assert (np.diff(found.frame) >= 0).all() and set(found.frame.tolist()) == set(range(6))
    first = {}  # ties of the top go to the earlier frame
    for cell, label, height in zip(found.cell.tolist(), found.label.tolist(), found.height_m, strict=True):
        if height == top[cell]:
            first.setdefault(cell, label)
    assert [first.get(cell, 0) for cell in range(top.size)] == grid.label.reshape(-1).tolist()
    assert [a.dtype for a in (found.cell, found.frame, found.segment, found.label, found.score, found.height_m)] == [
        np.int32, np.int32, np.int32, np.int16, np.float32, np.float32,
    ]  # fmt: skip


def test_where_keeps_all_columns_together():
    _, found, _ = gathered(random_frames(3))
    some = found.where(found.segment == 2)
    assert 0 < len(some) < len(found) and (some.segment == 2).all()
    names = ("cell", "frame", "segment", "label", "score", "height_m")
    left, right = (set(zip(*(getattr(r, n).tolist() for n in names), strict=True)) for r in (some, found))
    assert left == {row for row in right if row[2] == 2}


def test_nothing_to_read():
    grid, none_at_all, _ = gathered([])
    assert len(none_at_all) == 0 and none_at_all.cell.dtype == np.int32 and grid.spec.shape == (1, 1)
    frame, segmentation, T = random_frames(0, frames=1)[0]
    blind = (replace(frame, depth_m=np.zeros_like(frame.depth_m)), segmentation, T)
    assert len(gathered([blind])[1]) == 0
    bare = (frame, Segmentation(np.zeros_like(segmentation.ids), ()), T)
    _, found, _ = gathered([bare])
    assert len(found) > 0 and not found.segment.any() and not found.label.any() and not found.score.any()


def test_a_frame_without_its_segments_is_never_passed_over():
    none = np.zeros(0, np.int32)
    nothing = FrameReadings(none, none, none, none.astype(np.float32))
    grid, _, _ = gathered([])
    with pytest.raises(ValueError, match="zip"):
        gather_readings([nothing, nothing], [()], (0, 0), grid.labels, grid.spec.cols)
