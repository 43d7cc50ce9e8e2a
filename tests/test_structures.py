"""The shared structures refuse arrays of another shape or dtype, and cells and headings mean what they say."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simaps_viz.errors import InputError
from simaps_viz.structures import Frame, Grid, GridSpec, Intrinsics, Path, Pose2, Segmentation

CAMERA = Intrinsics(width=4, height=3, fx=5.0, fy=6.0, cx=1.5, cy=1.0)
SPEC = GridSpec(rows=2, cols=3, cell_size_m=0.05, x0_m=-1.0, y0_m=2.0)


def frame(**changes: Any) -> Frame:
    values = {"depth_m": np.zeros((3, 4), np.float32), "color": None} | changes
    return Frame(index=0, name="0007", T_world_camera=np.eye(4), intrinsics=CAMERA, **values)


def grid(**changes: Any) -> Grid:
    values = {
        "label": np.zeros((2, 3), np.int16),
        "height_m": np.zeros((2, 3), np.float32),
        "lowest_m": np.zeros((2, 3), np.float32),
        "observations": np.zeros((2, 3), np.int32),
    }
    return Grid(spec=SPEC, labels=("none",), is_thing=(False,), **(values | changes))


def test_good_arrays_pass_and_are_not_copied() -> None:
    depth_m, color = np.ones((3, 4), np.float32), np.zeros((3, 4, 3), np.uint8)
    made = frame(depth_m=depth_m, color=color)
    assert made.depth_m is depth_m and made.color is color
    ids = np.zeros((3, 4), np.int32)
    assert Segmentation(ids, ()).ids is ids
    assert grid().observations.dtype == np.int32


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: frame(depth_m=np.zeros((4, 3), np.float32)),
            "frame 0007: depth: expected float32 [3, 4], found float32 [4, 3]",
        ),
        (lambda: frame(depth_m=np.zeros((3, 4))), "frame 0007: depth: expected float32 [3, 4], found float64 [3, 4]"),
        (
            lambda: frame(color=np.zeros((3, 4), np.uint8)),
            "frame 0007: color: expected uint8 [3, 4, 3], found uint8 [3, 4]",
        ),
        (
            lambda: frame(color=np.zeros((3, 4, 3))),
            "frame 0007: color: expected uint8 [3, 4, 3], found float64 [3, 4, 3]",
        ),
        (
            lambda: Segmentation(np.zeros((3, 4), np.uint8), ()),
            "segmentation: ids: expected int32 [3, 4], found uint8 [3, 4]",
        ),
        (
            lambda: Segmentation(np.zeros((3, 4, 1), np.int32), ()),
            "segmentation: ids: expected int32 [3, 4], found int32 [3, 4, 1]",
        ),
        (lambda: grid(label=np.zeros((2, 3), np.int32)), "grid: label: expected int16 [2, 3], found int32 [2, 3]"),
        (
            lambda: grid(height_m=np.zeros((3, 2), np.float32)),
            "grid: height_m: expected float32 [2, 3], found float32 [3, 2]",
        ),
        (lambda: grid(lowest_m=np.zeros((2, 3))), "grid: lowest_m: expected float32 [2, 3], found float64 [2, 3]"),
        (
            lambda: grid(observations=np.zeros(6, np.int32)),
            "grid: observations: expected int32 [2, 3], found int32 [6]",
        ),
    ],
)
def test_wrong_arrays_are_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value) == message


def test_camera_matrix() -> None:
    np.testing.assert_array_equal(CAMERA.matrix(), [[5, 0, 1.5], [0, 6, 1], [0, 0, 1]])


@given(row=st.integers(-50, 50), col=st.integers(-50, 50))
def test_the_centre_of_a_cell_lies_in_it(row: int, col: int) -> None:
    assert SPEC.cell_of(*SPEC.centre_of(row, col)) == (row, col)
    assert SPEC.contains(row, col) == (0 <= row < 2 and 0 <= col < 3)


def test_rows_run_north_and_columns_east() -> None:
    assert SPEC.centre_of(0, 0) == pytest.approx((-0.975, 2.025))
    assert SPEC.centre_of(1, 0) == pytest.approx((-0.975, 2.075))
    assert SPEC.centre_of(0, 1) == pytest.approx((-0.925, 2.025))
    assert SPEC.extent_m == pytest.approx((-1.0, 2.0, -0.85, 2.1))


@given(heading_deg=st.floats(0, 359.99))
def test_pose_keeps_its_heading(heading_deg: float) -> None:
    assert Pose2.from_heading(1, 2, heading_deg).heading_deg % 360 == pytest.approx(heading_deg, abs=1e-6)


@pytest.mark.parametrize(
    ("points", "length_m"),
    [(np.zeros((0, 2)), 0.0), (np.ones((1, 2)), 0.0), (np.array([[0.0, 0], [3, 4], [3, 6]]), 7.0)],
)
def test_path_length(points: np.ndarray, length_m: float) -> None:
    assert Path(points).length_m == pytest.approx(length_m)
