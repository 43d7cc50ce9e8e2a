"""What frames saw through is no obstacle."""

import numpy as np

from simaps_viz.mapping.finalize import without_passers_by
from simaps_viz.mapping.observations import Readings
from simaps_viz.structures import Grid, GridSpec


def test_an_obstacle_that_nearly_all_frames_saw_through_goes_and_a_dark_thing_stays() -> None:
    # Cells: a wall, somebody walking by, a dark chair, a stray pixel on a chair's place, floor.
    hits, seen = [20, 3, 2, 0, 0], 20
    label = np.array([[1, 1, 2, 2, 1]], np.int16)
    lowest = np.array([[0.1, 0.5, 0.4, 0.3, np.nan]], np.float32)
    grid = Grid(
        GridSpec(1, 5, 0.05, 0.0, 0.0), ("none", "wall", "chair"), (False, False, True), label,
        np.full((1, 5), 2.0, np.float32), lowest, np.full((1, 5), seen, np.int32),
    )  # fmt: skip
    cell = np.repeat(np.arange(5, dtype=np.int32), seen)
    height = np.concatenate([np.where(np.arange(seen) < n, 0.1, 0.0999) for n in hits]).astype(np.float32)
    nothing = np.zeros(len(cell), np.int32)
    readings = Readings(cell, nothing, nothing, nothing.astype(np.int16), nothing.astype(np.float32), height)

    cleared = without_passers_by(grid, readings, 0.1)

    np.testing.assert_array_equal(cleared.lowest_m, np.array([[0.1, np.nan, 0.4, np.nan, np.nan]], np.float32))
    np.testing.assert_array_equal(grid.lowest_m, lowest)
    assert cleared.label is grid.label


def test_it_is_counted_as_shares_of_frames_would_count() -> None:
    rng = np.random.default_rng(3)
    label = rng.integers(0, 3, (40, 50)).astype(np.int16)
    lowest = np.where(rng.random(label.shape) < 0.8, np.float32(0.5), np.float32(np.nan))
    is_thing = (False, False, True)
    spec = GridSpec(rows=40, cols=50, cell_size_m=0.05, x0_m=0.0, y0_m=0.0)
    grid = Grid(spec, ("none", "wall", "chair"), is_thing, label, lowest, lowest, np.ones(label.shape, np.int32))
    cell = rng.integers(0, label.size, 60_000).astype(np.int32)
    nothing, height = (
        np.zeros(len(cell), np.int32),
        np.where(rng.random(len(cell)) < 0.12, 0.1, 0.05).astype(np.float32),
    )
    readings = Readings(cell, nothing, nothing, nothing.astype(np.int16), nothing.astype(np.float32), height)

    cleared = without_passers_by(grid, readings, 0.1)

    asked = np.bincount(cell, minlength=label.size).reshape(label.shape)
    hits = np.bincount(cell[height >= np.float32(0.1)], minlength=label.size).reshape(label.shape)
    passing = hits < np.where(np.array(is_thing)[label], 0.05, 0.2) * asked
    assert 0.2 < passing.mean() < 0.9 and (hits * 5 == asked).sum() > 20
    np.testing.assert_array_equal(cleared.lowest_m, np.where(passing, np.float32(np.nan), lowest))
