"""The class of a cell by votes: against the plain twin, and rule by rule on cells that can be counted by hand."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_readings import LABELS, drawn_grid, drawn_readings, grid_of, random_readings, readings_of
from evidence_twins import plain_vote_labels

from simaps_viz.mapping.observations import Readings
from simaps_viz.mapping.votes import SPREAD, VoteSettings, spread_labels, vote_labels
from simaps_viz.structures import Grid

BINARY = VoteSettings(stuff=0.625, nothing=0.5, exact_below=0.0, rounds=0)
"""Weights with short binary fractions, so that sums do not depend on rounding."""
ALONE = VoteSettings(exact_below=0.0, neighbours=0.0, floor_m=0.0, nothing=0.5, stuff=0.6, window_m=0.06, rounds=0)
"""No neighbours, no floor: what the readings of a cell say by themselves."""
CLASSES = {"1": "chair", "2": "table", "3": "rug", "_": "floor"}


@pytest.mark.parametrize(
    "settings",
    [
        BINARY,
        replace(BINARY, neighbours=0.0),
        replace(BINARY, neighbours=0.5, height_scale_m=0.05, floor_m=0.0),
        replace(BINARY, scores=False, window_m=0.02),
        replace(BINARY, stuff=0.0, nothing=0.0, window_m=0.2, floor_m=0.1),
    ],
)
@pytest.mark.parametrize("seed", range(6))
def test_labels_and_disagreement_are_the_twins(seed, settings):
    grid, readings = random_readings(seed, shape=(9, 11) if seed % 2 else (12, 14))
    found, disagreement = vote_labels(grid, readings, settings)
    wanted, share = plain_vote_labels(grid, readings, settings)
    assert found.dtype == np.int16 and np.array_equal(found, wanted)
    assert disagreement == pytest.approx(share, abs=1e-12) and 0.05 < disagreement < 0.9
    assert not np.array_equal(found, grid.label), "votes must change something, or nothing is compared"
    assert not found[np.isnan(grid.height_m)].any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (6, 1)])
def test_narrow_grids_are_the_twins(shape):
    for seed in range(10):
        grid, readings = random_readings(seed, shape=shape)
        found, disagreement = vote_labels(grid, readings, BINARY)
        wanted, share = plain_vote_labels(grid, readings, BINARY)
        assert np.array_equal(found, wanted) and disagreement == pytest.approx(share, abs=1e-12)


def test_no_readings_give_no_names():
    grid = grid_of(np.zeros((2, 3), np.int16), np.full((2, 3), np.nan, np.float32))
    found, disagreement = vote_labels(grid, readings_of(np.zeros((0, 6))), VoteSettings(exact_below=0.0))
    assert found.tolist() == [[0, 0, 0], [0, 0, 0]] and disagreement == 0.0


def one_class(grid: Grid, readings: Readings) -> Readings:
    seen = readings.label > 0
    return replace(readings, label=np.where(seen, 1, 0).astype(np.int16)).where(seen)


def test_where_all_say_one_class_it_is_that_class_wherever_anything_was_seen():
    grid, readings = random_readings(4)
    readings = one_class(grid, readings)
    near = readings.height_m > grid.height_m.reshape(-1)[readings.cell] - np.float32(0.06)
    found, disagreement = vote_labels(grid, readings, replace(BINARY, floor_m=0.0))
    assert disagreement == 0.0
    assert np.array_equal(np.flatnonzero(found), np.unique(readings.cell[near]))


def named(looks, settings=ALONE, *, cell="c", **marks) -> str:
    """The class of one cell seen by frames, one character each."""
    grid = drawn_grid(cell)
    found, _ = vote_labels(grid, drawn_readings(grid, list(looks), CLASSES, **marks), settings)
    return LABELS[found[0, 0]]


@pytest.mark.parametrize(
    ("looks", "name"),
    [
        ("112", "chair"),
        ("221", "table"),
        ("211", "chair"),
        ("12", "chair"),  # a tie goes to the class met first
        ("21", "table"),
        ("1.", "chair"),  # nothing is a vote of 0.5
        ("1...", "none"),
        ("1..", "chair"),
        (".1.", "none"),  # 1 to 1: met first
        ("1_", "chair"),  # stuff is a vote of 0.6
        ("1__", "floor"),
        ("11___", "chair"),  # 2 to 1.8
        ("11____", "floor"),
        ("_..", "none"),
        ("_.", "floor"),
    ],
)
def test_votes_of_one_cell(looks, name):
    assert named(looks) == name


def test_votes_weigh_as_much_as_their_segment_is_confident():
    scores = {"1": 0.9, "2": 0.4}
    assert named("122", scores=scores) == "chair"
    assert named("1222", scores=scores) == "table"
    assert named("122", replace(ALONE, scores=False), scores=scores) == "table"
    assert named("1_", scores={"1": 0.5, "_": 1.0}) == "floor"
    assert named("1_", scores={"1": 0.5, "_": 0.8}) == "chair"
    assert named("1.", scores={"1": 0.4}) == "none"


def test_what_lies_too_far_below_the_top_has_no_vote():
    assert named("122", below_m={"2": 0.07}) == "chair"
    assert named("122", below_m={"2": 0.05}) == "table"
    assert named("122", replace(ALONE, window_m=0.08), below_m={"2": 0.07}) == "table"


def test_neighbours_of_the_same_height_lend_their_votes_and_others_do_not():
    grid = drawn_grid("ccc\nccc\nccc")
    looks = ["111\n121\n111"] * 3
    readings = drawn_readings(grid, looks, CLASSES)
    for neighbours, name in ((0.0, "table"), (0.1, "table"), (0.2, "chair"), (1.0, "chair")):
        found, _ = vote_labels(grid, readings, replace(ALONE, neighbours=neighbours))
        assert LABELS[found[1, 1]] == name  # 3 votes of its own, 3 x (4 + 4 x 0.7) = 20.4 around
    step = np.where(np.arange(9) == 4, 0.60, 0.45).astype(np.float32).reshape(3, 3)
    higher = grid_of(grid.label, step)
    found, _ = vote_labels(higher, drawn_readings(higher, looks, CLASSES), replace(ALONE, neighbours=1.0))
    assert LABELS[found[1, 1]] == "table" and (np.delete(found.reshape(-1), 4) == LABELS.index("chair")).all()


def test_diagonal_neighbours_lend_seven_tenths():
    grid = drawn_grid("cc\ncc")
    side = drawn_readings(grid, ["11\n?2", "?2\n??"], CLASSES)
    corner = drawn_readings(grid, ["21\n?2", "1?\n??"], CLASSES)
    settings = replace(ALONE, neighbours=1.0, height_scale_m=1.0)
    # bottom right: its own table; above chair 1 and table 1; across chair 1 at 0.7.
    assert LABELS[vote_labels(grid, side, settings)[0][1, 1]] == "table"
    # bottom right: table 1 + 0.7 across; chair 1 above + 0.7 across: a tie, its own class first.
    assert LABELS[vote_labels(grid, corner, settings)[0][1, 1]] == "table"
    more = drawn_readings(grid, ["21\n?2", "11\n??"], CLASSES)
    assert LABELS[vote_labels(grid, more, settings)[0][1, 1]] == "chair"


def test_a_cell_nobody_voted_on_borrows_no_name():
    grid = drawn_grid("c.c")
    found, _ = vote_labels(grid, drawn_readings(grid, ["1?1"] * 3, CLASSES), replace(ALONE, neighbours=1.0))
    assert found.tolist() == [[1, 0, 1]]


def test_a_class_that_stands_gets_no_cell_of_the_floor():
    grid = drawn_grid("ccc___")
    looks = ["11111_", "11111_", "1111__"]
    spilled = drawn_readings(grid, looks, CLASSES)
    # Of five chair cells three are high: chairs stand. Where nobody else has a vote, nothing is left.
    assert vote_labels(grid, spilled, replace(ALONE, floor_m=0.04))[0].tolist() == [[1, 1, 1, 0, 2, 2]]
    assert vote_labels(grid, spilled, ALONE)[0].tolist() == [[1, 1, 1, 1, 1, 2]]


def test_a_class_that_lies_keeps_the_floor_and_half_is_lying():
    rug = drawn_grid("rrrr__")
    flat = drawn_readings(rug, ["3333__"] * 3, CLASSES)
    assert vote_labels(rug, flat, replace(ALONE, floor_m=0.04))[0].tolist() == [[4, 4, 4, 4, 2, 2]]
    half = drawn_grid("cc__")
    chairs = drawn_readings(half, ["1111"] * 3, CLASSES)
    assert vote_labels(half, chairs, replace(ALONE, floor_m=0.04))[0].tolist() == [[1, 1, 1, 1]]


def test_exact_masks_leave_the_name_to_the_highest_pixel():
    grid, readings = random_readings(2)
    _, disagreement = vote_labels(grid, readings, BINARY)
    above = np.nextafter(disagreement, 1.0)
    exact, told = vote_labels(grid, readings, replace(BINARY, exact_below=above))
    assert told == disagreement and np.array_equal(exact, grid.label)
    voted, _ = vote_labels(grid, readings, replace(BINARY, exact_below=disagreement))  # "less than"
    assert np.array_equal(voted, plain_vote_labels(grid, readings, BINARY)[0])
    never, told = vote_labels(grid, readings, replace(BINARY, enabled=False))
    assert told == disagreement and np.array_equal(never, grid.label)


def test_disagreement_counts_near_readings_of_cells_with_at_least_three():
    grid = drawn_grid("cccc")
    readings = drawn_readings(grid, ["1121", "12.1", "?121", "?2?1"], CLASSES)
    # Cell 0: two readings, left out. Cell 1: 1 2 1 2. Cell 2: 2 . 2. Cell 3: all 1.
    assert vote_labels(grid, readings, ALONE)[1] == pytest.approx(1 - (2 + 2 + 4) / 11)
    below = drawn_readings(grid, ["1121", "12.1", "?121", "?2?1"], CLASSES, below_m={"2": 0.1})
    # Without the far ones cells 1 and 2 are left with two readings and one.
    assert vote_labels(grid, below, ALONE)[1] == 0.0


def twice(readings: Readings) -> Readings:
    """Every frame shown once more right after itself."""
    order = np.concatenate([np.tile(np.flatnonzero(readings.frame == f), 2) for f in np.unique(readings.frame)])
    doubled = readings.where(order)
    second = np.concatenate([np.repeat([0, 1], int((readings.frame == f).sum())) for f in np.unique(readings.frame)])
    return replace(doubled, frame=(doubled.frame * 2 + second).astype(np.int32))


@pytest.mark.parametrize("seed", range(5))
def test_showing_every_frame_twice_leaves_the_labels_as_they_are(seed):
    grid, readings = random_readings(seed)
    doubled = twice(readings)
    assert len(doubled) == 2 * len(readings) and (np.diff(doubled.frame) >= 0).all()
    assert np.array_equal(vote_labels(grid, doubled, BINARY)[0], vote_labels(grid, readings, BINARY)[0])


@pytest.mark.parametrize("seed", range(5))
def test_other_indices_of_the_classes_only_rename(seed):
    grid, readings = random_readings(seed)
    new = np.array([0, *np.roll([4, 2, 1, 3], seed)])
    old = np.argsort(new)
    other = replace(
        grid_of(new[grid.label].astype(np.int16), grid.height_m),
        labels=tuple(grid.labels[i] for i in old),
        is_thing=tuple(grid.is_thing[i] for i in old),
    )
    renamed = replace(readings, label=new[readings.label].astype(np.int16))
    found, _ = vote_labels(other, renamed, VoteSettings())
    assert np.array_equal(found, new[vote_labels(grid, readings, VoteSettings())[0]])


@pytest.mark.parametrize("seed", range(3))
def test_numbers_of_segments_and_the_order_within_a_frame_change_nothing(seed):
    grid, readings = random_readings(seed)
    rng = np.random.default_rng(seed)
    shuffled = np.concatenate([rng.permutation(np.flatnonzero(readings.frame == f)) for f in range(5)])
    other = replace(readings, segment=np.where(readings.segment > 0, 99 - readings.segment, 0)).where(shuffled)
    assert np.array_equal(vote_labels(grid, other, BINARY)[0], vote_labels(grid, readings, BINARY)[0])


def plain_spread(label, height_m, unsegmented):
    """What `spread_labels` does, cell by cell."""
    named = np.where(unsegmented, 0, label)
    for step_m in (step_m for step_m, rings in SPREAD for _ in range(rings)):
        before = named.copy()
        for row, col in np.argwhere(unsegmented & (before == 0)):
            around = [
                (abs(height_m[r, c] - height_m[row, col]), i, before[r, c])
                for i, (r, c) in enumerate((row + dr, col + dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1))
                if 0 <= r < label.shape[0] and 0 <= c < label.shape[1] and before[r, c] > 0
            ]
            around = [one for one in around if one[0] < np.float32(step_m)]
            if around:
                named[row, col] = min(around)[2]
    return named


@pytest.mark.parametrize("seed", range(8))
def test_a_surface_keeps_its_name_where_nobody_looked(seed):
    rng = np.random.default_rng(seed)
    shape = (13, 17)
    height_m = (rng.integers(0, 6, shape) * 0.02).astype(np.float32)
    height_m[rng.random(shape) < 0.1] = np.nan
    label = rng.integers(0, 4, shape).astype(np.int16)
    unsegmented = rng.random(shape) < 0.7
    found = spread_labels(label, height_m, unsegmented)
    np.testing.assert_array_equal(found, plain_spread(label, height_m, unsegmented))
    np.testing.assert_array_equal(found[~unsegmented], label[~unsegmented])
    assert not found[unsegmented & np.isnan(height_m)].any() and (found[unsegmented] > 0).any()


def test_a_surface_goes_on_far_where_it_is_flat_and_less_far_over_steps():
    height_m = np.full((1, 40), 0.7, np.float32)
    label, unsegmented = np.zeros_like(height_m, np.int16), np.ones_like(height_m, bool)
    label[0, 0], unsegmented[0, 0] = 2, False
    assert (spread_labels(label, height_m, unsegmented) > 0).sum() == 1 + sum(rings for _, rings in SPREAD)
    height_m[0, 3:] += 0.05  # the steps after the first two cells are taken last, and only a few cells far
    assert (spread_labels(label, height_m, unsegmented) > 0).sum() == 3 + 2 + 1
    height_m[0, 3:] += 0.5  # the border of what nobody looked at is one cell wide
    assert (spread_labels(label, height_m, unsegmented) > 0).sum() == 3 + 1


def test_what_surely_goes_on_is_named_before_what_is_only_near():
    height_m = np.array([[0.72, 0.70, 0.70, 0.74, 0.745]], np.float32)
    label, unsegmented = np.array([[1, 0, 0, 0, 2]], np.int16), np.array([[False, True, True, True, False]])
    np.testing.assert_array_equal(spread_labels(label, height_m, unsegmented), [[1, 1, 1, 2, 2]])
