"""The rules behind the pictures, without rerun."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from simaps_viz.recorder.map_log import (
    CLASS_BASE,
    Merging,
    height_entries,
    merge_order,
    object_picture,
    on_picture,
    picture_corner,
    shown_steps,
)
from simaps_viz.structures import GridSpec, MergeLog


@given(steps=st.integers(0, 600), applied=st.integers(0, 600), most=st.integers(0, 300))
@example(steps=2, applied=2, most=3)
@example(steps=7, applied=4, most=8)
def test_shown_steps(steps: int, applied: int, most: int) -> None:
    applied = min(applied, steps)
    shown = shown_steps(steps, applied, most)
    assert (np.diff(shown) > 0).all()
    assert {0, applied} <= set(shown.tolist()) <= set(range(steps + 1))
    assert len(shown) <= max(most, 2)
    if most >= steps + 1:
        assert shown.tolist() == list(range(steps + 1)), "there is room for all"
    elif most >= applied + 2:
        assert shown[: applied + 1].tolist() == list(range(applied + 1)), "the applied steps come first"
        assert shown[-1] == steps


def test_merge_order_keeps_each_part_in_order() -> None:
    assert merge_order(np.array([True, False, True, False, True])).tolist() == [0, 2, 4, 1, 3]
    assert merge_order(np.zeros(0, bool)).tolist() == []


@given(st.data())
def test_groups_are_called_by_their_smallest_community(data: st.DataObject) -> None:
    """Against sets that are united one pair at a time."""
    count = data.draw(st.integers(2, 12))
    pairs = data.draw(st.lists(st.tuples(st.integers(1, count), st.integers(1, count)), max_size=15))
    source, target = (np.array([p[i] for p in pairs], np.int32) for i in (0, 1))
    log = MergeLog(np.ones(len(pairs), np.int16), source, target, np.ones(len(pairs), np.float32))
    merging = Merging(log, np.arange(len(pairs)), count)
    sets = [{c} for c in range(count + 1)]
    for position, (a, b) in enumerate(pairs):
        assert merging.step(position) == (min(sets[a]), min(sets[b]))
        union = sets[a] | sets[b]
        for member in union:
            sets[member] = union
        assert merging.name_of.tolist() == [min(s) for s in sets]


@given(x0=st.floats(-20, 20), y0=st.floats(-20, 20), rows=st.integers(1, 50), cols=st.integers(1, 50), data=st.data())
def test_cells_lie_under_their_pixels(x0: float, y0: float, rows: int, cols: int, data: st.DataObject) -> None:
    """The pixel that shows a cell, laid down by the picture's corner and size, has its middle on the cell's."""
    spec = GridSpec(rows, cols, 0.05, x0, y0)
    row, col = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, cols - 1))
    marked = np.zeros(spec.shape, np.int32)
    marked[row, col] = 1
    v, u = np.argwhere(object_picture(marked))[0]
    left, top = picture_corner(spec)
    expected = on_picture(spec.centres_of(np.array(row), np.array(col)))
    assert np.allclose([left + (u + 0.5) * 0.05, top + (v + 0.5) * 0.05], expected, atol=1e-5)


def test_high_ids_never_meet_the_classes() -> None:
    picture = object_picture(np.array([[0, 1, CLASS_BASE - 1, CLASS_BASE, 3 * CLASS_BASE]], np.int32))
    assert picture[0, 0] == 0 and picture[0, 1] == 1 and picture[0, 2] == CLASS_BASE - 1
    assert ((picture[0, 1:] > 0) & (picture[0, 1:] < CLASS_BASE)).all()


def test_heights_name_every_value() -> None:
    entries = height_entries()
    assert [e[0] for e in entries] == list(range(102))
    assert entries[1][1] == "0.00 m" and entries[101][1] == "2.00 m"
    assert entries[1][2][:3] == pytest.approx((68, 1, 84), abs=3), "viridis begins in violet"
