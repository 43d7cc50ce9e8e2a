"""The kernels against their plain twins, and what DESIGN says of a cell's label, height and count."""

import numpy as np
import pytest
from mapping_twins import PlainMap
from random_frames import IS_THING, LABELS, random_frames

from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.links import LinkTable
from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation


def accumulate(frames, *, reach=2, settings=None) -> MapAccumulator:
    accumulator = MapAccumulator(LABELS, IS_THING, settings or ProjectionSettings(), reach_cells=reach)
    for frame, segmentation, T_map_camera in frames:
        accumulator.add_frame(frame, segmentation, T_map_camera)
    return accumulator


@pytest.mark.parametrize("seed", range(4))
def test_grid_is_the_twins_cell_by_cell(seed):
    frames = random_frames(seed)
    plain = PlainMap()
    for part in frames:
        plain.add(*part)
    accumulator = accumulate(frames)
    grid, (row0, col0) = accumulator.snapshot(), accumulator.origin_cell
    assert grid.spec.x0_m == pytest.approx(col0 * 0.05) and grid.spec.y0_m == pytest.approx(row0 * 0.05)
    seen = {(int(r) + row0, int(c) + col0) for r, c in np.argwhere(grid.observations > 0)}
    assert seen == set(plain.top)
    for (row, col), top in plain.top.items():
        at = (row - row0, col - col0)
        assert grid.height_m[at] == pytest.approx(top, abs=1e-5)
        assert grid.labels[grid.label[at]] == plain.label[row, col]
        assert grid.observations[at] == len(plain.frames[row, col])
        lowest = plain.lowest.get((row, col), np.nan)
        assert grid.lowest_m[at] == pytest.approx(lowest, abs=1e-5, nan_ok=True)
    assert np.isnan(grid.height_m[grid.observations == 0]).all()


@pytest.mark.parametrize("reach", [2, 0, -1])
@pytest.mark.parametrize("seed", range(3))
def test_links_are_the_twins(seed, reach):
    frames = random_frames(seed)
    plain = PlainMap(reach=reach)
    for part in frames:
        plain.add(*part)
    cells, labels, counts = accumulate(frames, reach=reach).links.entries()
    found = {
        (LABELS[label], *sorted(((int(c[0]), int(c[1])), (int(c[2]), int(c[3]))))): int(count)
        for c, label, count in zip(cells, labels, counts, strict=True)
    }
    assert found == dict(plain.links)
    assert len(found) == len(counts)
    assert reach == 0 or found, "the random frames must have links, or nothing is compared"


def test_readings_are_the_twins():
    frames = random_frames(5)
    plain = PlainMap()
    for part in frames:
        plain.add(*part)
    found = {
        (i, (int(r), int(c)), int(s))
        for i, seen in enumerate(accumulate(frames).readings)
        for r, c, s in zip(seen.rows, seen.cols, seen.segments, strict=True)
    }
    assert found == plain.readings


def test_links_survive_growing_the_table(monkeypatch):
    frames = random_frames(1, frames=4)
    whole = accumulate(frames).links.entries()
    small = MapAccumulator(LABELS, IS_THING, ProjectionSettings())
    table = LinkTable(room=128, frame_room=128)
    small.links = table
    for part in frames:
        small.add_frame(*part)
    assert table.size > 128 and len(table._frame.keys) > 128
    for ours, theirs in zip(table.entries(), whole, strict=True):
        assert np.array_equal(ours, theirs)


def test_grid_grows_with_the_walk_and_keeps_what_it_had():
    frames = random_frames(2, frames=2)
    moved = []
    for step, (frame, segmentation, T_map_camera) in enumerate(frames * 3):
        T = T_map_camera.copy()
        T[:2, 3] += step * np.array([-9.0, 14.0])
        moved.append((Frame(step, str(step), frame.depth_m, T, frame.intrinsics), segmentation, T))
    plain = PlainMap()
    for part in moved:
        plain.add(*part)
    accumulator = accumulate(moved)
    grid, (row0, col0) = accumulator.snapshot(), accumulator.origin_cell
    assert grid.spec.rows * 0.05 > 60
    assert int((grid.observations > 0).sum()) == len(plain.top)
    assert all(grid.labels[grid.label[r - row0, c - col0]] == name for (r, c), name in plain.label.items())


def one_pixel_frames(depths, labels):
    """Frames of a single pixel looking down from 3 m, so that height = 3 - depth, always the same cell."""
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = (0.02, 0.02, 3.0)
    for i, (depth, label) in enumerate(zip(depths, labels, strict=True)):
        frame = Frame(i, str(i), np.full((1, 1), depth, np.float32), T, Intrinsics(1, 1, 50.0, 50.0, 0.0, 0.0))
        yield frame, Segmentation(np.ones((1, 1), np.int32), (Segment(1, label),)), T


@pytest.mark.parametrize(
    ("depths", "labels", "label", "top"),
    [
        ([2.5, 2.25], ["chair", "table"], "table", 0.75),
        ([2.25, 2.5], ["chair", "table"], "chair", 0.75),
        ([2.25, 2.25], ["chair", "table"], "chair", 0.75),  # a tie goes to the earlier frame
        ([0.5, 2.5], ["table", "chair"], "chair", 0.5),  # 2.5 m is above the cut
        ([1.0, 2.5], ["table", "chair"], "chair", 0.5),  # 2.0 m is at the cut: out
        ([3.29, 3.31], ["table", "chair"], "table", -0.29),  # 0.31 m below the floor: out
    ],
)
def test_the_highest_pixel_names_the_cell(depths, labels, label, top):
    grid = accumulate(one_pixel_frames(depths, labels)).snapshot()
    assert grid.spec.shape == (1, 1)
    assert grid.labels[grid.label[0, 0]] == label
    assert grid.height_m[0, 0] == pytest.approx(top, abs=1e-6)


def test_nothing_seen_is_an_empty_map():
    grid = accumulate(one_pixel_frames([0.0], ["chair"])).snapshot()
    assert grid.spec.shape == (1, 1) and np.isnan(grid.height_m).all() and not grid.observations.any()
