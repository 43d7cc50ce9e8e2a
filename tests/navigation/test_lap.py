"""Loops all around things: closed, drivable in straight lines, and wound around what they are meant to go around."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_maps import Box, map_from_drawing, map_of_boxes

from simaps_viz.errors import CommandError, PlanningError
from simaps_viz.navigation.agent import planner_of
from simaps_viz.navigation.planner import RobotShape, clear_length
from simaps_viz.navigation.robot import MAX_OFF_M, lap
from simaps_viz.structures import GridSpec, SIMap

SHAPE = RobotShape()
OPEN = GridSpec(140, 140, 0.05, -1.0, 2.0)


def winding(points: np.ndarray, centre: np.ndarray) -> float:
    """Counter-clockwise turns of a polyline around a point, by summing the angles of its sides."""
    a, b = points[:-1] - centre, points[1:] - centre
    return float(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum() / (2.0 * np.pi))


def cells_of(simap: SIMap, number: int) -> np.ndarray:
    rows, cols = np.nonzero(simap.instance == number)
    return np.array([simap.spec.centre_of(r, c) for r, c in zip(rows.tolist(), cols.tolist(), strict=True)])


def loop(simap: SIMap, start: tuple[float, float], ids: list[int], turns: float = 1.0) -> np.ndarray:
    return np.array(lap(planner_of(simap, SHAPE), start, [cells_of(simap, i) for i in ids], "the thing", turns))


def is_drivable(simap: SIMap, points: np.ndarray) -> bool:
    """By the definition: every point of the line, taken densely, lies in a free cell."""
    free, spec = planner_of(simap, SHAPE).free, simap.spec
    share = np.linspace(0.0, 1.0, 400)[:, None]
    dense = np.concatenate([a + share * (b - a) for a, b in pairwise(points)])
    return all(free[spec.cell_of(x, y)] for x, y in dense.tolist())


@settings(max_examples=25, deadline=None)
@given(
    st.integers(20, 100), st.integers(20, 100), st.integers(1, 30), st.integers(1, 30),
    st.sampled_from([1.0, 2.0, -1.0, 3.0]), st.booleans(),
)  # fmt: skip
def test_a_lap_winds_as_often_as_said_and_ends_where_it_began(
    row: int, col: int, rows: int, cols: int, turns: float, low: bool
) -> None:
    """Around boxes of any shape, also one so low that the robot could drive over it."""
    box = Box("dining table", row, col, rows, cols, 0.7, lowest_m=float("nan") if low else 0.12)
    simap = map_of_boxes(OPEN, [box])
    start = (-0.7, 2.3)
    points = loop(simap, start, [1], turns)
    thing = cells_of(simap, 1)
    assert points[0].tolist() == points[-1].tolist()
    assert is_drivable(simap, points)
    for corner in (thing[0], thing[-1], thing.mean(axis=0)):
        assert winding(points, corner) == pytest.approx(-turns, abs=1e-9)
    # It hugs what it goes around: no further off than the robot needs, beside the box.
    gap = np.abs(points[:, None] - thing[None]).max(axis=2).min(axis=1)
    assert gap.max() <= SHAPE.radius_m + 0.15
    nearest = np.hypot(*(points - start).T).min()
    assert np.hypot(*(points[0] - start)) <= nearest + 0.05


def test_a_part_of_a_lap() -> None:
    simap = map_of_boxes(OPEN, [Box("chair", 60, 60, 8, 8, 0.8)])
    whole, half = loop(simap, (0.0, 3.0), [1]), loop(simap, (0.0, 3.0), [1], 0.5)
    length = np.linalg.norm(np.diff(whole, axis=0), axis=1).sum()
    assert np.linalg.norm(np.diff(half, axis=0), axis=1).sum() == pytest.approx(length / 2.0)
    assert -0.7 < winding(half, cells_of(simap, 1).mean(axis=0)) < -0.3
    assert is_drivable(simap, half)


def test_around_a_table_with_its_chairs_and_around_several_things_together() -> None:
    room = map_from_drawing(
        """
        .............
        .............
        .....c.......
        .............
        ....TTTTT....
        ....TTTTT....
        .............
        .............
        .............
        ...a....b....
        .............
        .............
        """,
        {"T": "dining table", "a": "chair", "b": "chair", "c": "chair"},
        cells=8,
    )
    by_place = {tuple(np.round(i.centroid_m[:2], 1)): i.id for i in room.instances}
    table, chair, left, right = (by_place[at] for at in ((2.6, 2.8), (2.2, 3.8), (1.4, 1.0), (3.4, 1.0)))
    around = loop(room, (0.2, 0.2), [table])
    assert winding(around, cells_of(room, table).mean(axis=0)) == pytest.approx(-1.0)
    assert winding(around, cells_of(room, chair).mean(axis=0)) == pytest.approx(-1.0), "no way between the two"
    both = loop(room, (0.2, 1.8), [left, right])
    for number in (left, right):
        assert winding(both, cells_of(room, number).mean(axis=0)) == pytest.approx(-1.0)
    assert winding(both, cells_of(room, table).mean(axis=0)) == pytest.approx(0.0, abs=1e-9)
    assert is_drivable(room, both)


def test_a_thing_against_a_wall_and_a_way_too_long_are_refused_in_words() -> None:
    wall = Box("wall", 0, 0, 2, 140, 2.0)
    against = map_of_boxes(OPEN, [Box("tv", 4, 60, 8, 16, 0.7)], [wall])
    with pytest.raises(PlanningError, match="there is no way all around the thing: something stands against it"):
        loop(against, (1.0, 6.0), [1])
    # A wall that ends far from the thing: there is a way around both, through the next room.
    long = map_of_boxes(OPEN, [Box("tv", 72, 68, 4, 4, 0.7)], [Box("wall", 70, 10, 2, 120, 2.0)])
    assert MAX_OFF_M < 3.05, "the wall ends further off"
    with pytest.raises(PlanningError, match="something stands against it"):
        loop(long, (1.0, 3.0), [1])


def test_turns_are_checked() -> None:
    simap = map_of_boxes(OPEN, [Box("chair", 60, 60, 8, 8, 0.8)])
    for turns in (0.0, 21.0, -20.5):
        with pytest.raises(CommandError, match="a lap takes up to 20 turns"):
            loop(simap, (0.0, 3.0), [1], turns)


def test_each_leg_is_clear_by_the_planner_s_own_measure() -> None:
    simap = map_of_boxes(OPEN, [Box("couch", 50, 40, 10, 40, 0.8), Box("chair", 66, 58, 6, 6, 0.8)])
    points = loop(simap, (4.0, 8.0), [1])
    planner, spec = planner_of(simap, SHAPE), simap.spec
    cells = (points - (spec.x0_m, spec.y0_m)) / spec.cell_size_m
    assert all(clear_length(planner.free, *a, *b) >= 1.0 for a, b in pairwise(cells))
