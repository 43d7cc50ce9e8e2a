"""What masks get wrong, learned from a map's readings: against the plain twin, and on masks whose errors are known."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_readings import LABELS, drawn_grid, drawn_readings, grid_of, random_readings
from evidence_twins import plain_vote_labels

from simaps_viz.mapping.votes import VoteSettings, vote_labels

LEARNED = VoteSettings(exact_below=0.0, rounds=6)
VOTED = replace(LEARNED, rounds=0)
CLASSES = {"1": "chair", "2": "table", "3": "rug", "_": "floor"}


@pytest.mark.parametrize("rounds", [1, 4])
@pytest.mark.parametrize("seed", range(5))
def test_learned_labels_are_the_twins(seed, rounds):
    settings = replace(LEARNED, rounds=rounds, floor_m=0.04 if seed % 2 else 0.0, stuff=0.625, nothing=0.25)
    grid, readings = random_readings(seed, shape=(9, 11), frames=6)
    found, _ = vote_labels(grid, readings, settings)
    np.testing.assert_array_equal(found, plain_vote_labels(grid, readings, settings)[0])
    assert found.dtype == np.int16 and not found[np.isnan(grid.height_m)].any()
    assert not np.array_equal(found, vote_labels(grid, readings, replace(settings, rounds=0))[0])


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (5, 1)])
def test_narrow_grids_are_the_twins(shape):
    for seed in range(6):
        grid, readings = random_readings(seed, shape=shape)
        np.testing.assert_array_equal(
            vote_labels(grid, readings, LEARNED)[0], plain_vote_labels(grid, readings, LEARNED)[0]
        )


def seen_by(frames: int, things: list[str], missed: dict[str, float], seed: int):
    """Patches of 4 x 4 cells on a floor of 36 x 36, each missed as a whole in so many of the frames."""
    rng = np.random.default_rng(seed)
    drawing = np.full((36, 36), "_")
    patches = {}
    for number, kind in enumerate(things):
        row, col = 2 + 6 * (number // 6), 2 + 6 * (number % 6)
        patches[number] = (slice(row, row + 4), slice(col, col + 4))
        drawing[patches[number]] = kind
    grid = drawn_grid("\n".join("".join(row) for row in drawing))
    looks = []
    for _ in range(frames):
        look = drawing.copy()
        look[drawing == "c"] = "1"
        look[drawing == "t"] = "2"
        for number, kind in enumerate(things):
            if rng.random() < missed[kind]:
                look[patches[number]] = "."
        looks.append("\n".join("".join(row) for row in look))
    return grid, drawn_readings(grid, looks, CLASSES), patches


@pytest.mark.parametrize("seed", range(4))
def test_a_class_that_is_mostly_missed_is_found_where_one_constant_does_not_find_it(seed):
    things = ["c", ".", "t"] * 12  # those in the middle are of no class that the network knows
    grid, readings, patches = seen_by(9, things, {"c": 0.75, "t": 0.1, ".": 0.0}, seed)
    found, voted = (vote_labels(grid, readings, s)[0] for s in (LEARNED, VOTED))
    chairs = [patch for number, patch in patches.items() if things[number] == "c"]
    shown, before = (sum((one[patch] == LABELS.index("chair")).all() for patch in chairs) for one in (found, voted))
    assert shown >= before + 2
    assert (found == LABELS.index("chair")).sum() == 16 * shown, "and nowhere else"
    assert (found[grid.label == LABELS.index("floor")] == LABELS.index("floor")).all()


@pytest.mark.parametrize("seed", range(4))
def test_what_is_invented_here_and_there_wins_nowhere(seed):
    rng = np.random.default_rng(seed)
    grid = drawn_grid("\n".join(["t" * 20] * 20))
    looks = []
    for _ in range(6):
        look = np.full((20, 20), "2")
        look[rng.random((20, 20)) < 0.1] = "1"  # single cells of chair: invented, here and there
        looks.append("\n".join("".join(row) for row in look))
    found, _ = vote_labels(grid, drawn_readings(grid, looks, CLASSES), LEARNED)
    assert (found == LABELS.index("table")).all()


def test_a_height_where_no_floor_is_speaks_against_floor():
    grid = drawn_grid("\n".join(["cccccccc____"] * 8 + ["____________"] * 3 + ["___________c"]))
    chairs, rng = grid.label == LABELS.index("chair"), np.random.default_rng(0)
    looks = []
    for number in range(6):
        look = np.where(chairs & (rng.random(chairs.shape) > 0.2), "1", "_")  # a fifth of the chairs is slipped off
        look[11, 11] = "1" if number < 2 else "_"  # no neighbour is as high as this cell
        looks.append("\n".join("".join(row) for row in look))
    readings = drawn_readings(grid, looks, CLASSES)
    assert vote_labels(grid, readings, VOTED)[0][11, 11] == LABELS.index("floor")
    np.testing.assert_array_equal(vote_labels(grid, readings, LEARNED)[0], grid.label)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("often_m", "never_m"), [(0.0, 0.5), (0.5, 1.5)])
def test_nothing_that_is_taken_for_chairs_at_one_height_is_not_so_at_another(often_m, never_m, seed):
    drawing = np.full((24, 24), "?")
    drawing[:, 12:] = "."
    for row in range(2, 22, 5):
        drawing[row : row + 2, 14:16] = drawing[row : row + 2, 19:21] = "c"
    chairs, invented = drawing == "c", drawing == "?"
    grid = grid_of(chairs.astype(np.int16), np.where(invented, often_m, never_m).astype(np.float32))
    looks, rng = [], np.random.default_rng(seed)
    for number in range(10):
        look = np.where(chairs & (number < 3) | invented & (rng.random(chairs.shape) < 0.2), "1", ".")
        looks.append("\n".join("".join(row) for row in look))
    found, _ = vote_labels(grid, drawn_readings(grid, looks, CLASSES), LEARNED)
    assert found[chairs].all()
    assert found[~chairs].mean() < 0.02


@pytest.mark.parametrize(("on_top", "below"), [(2, 6), (3, 4)])
def test_what_lies_well_below_the_top_does_not_outweigh_what_is_on_it(on_top, below):
    drawing = np.array([list(row) for row in ["tttttttt", "tccttcct", "tccttcct"] * 3])
    grid = drawn_grid("\n".join("".join(row) for row in drawing))
    looks = [np.where(drawing == "c", seen, "2") for seen in "1" * on_top + "3" * below]
    looks = ["\n".join("".join(row) for row in look) for look in looks]
    readings = drawn_readings(grid, looks, {**CLASSES, "3": "table"}, below_m={"3": 0.04})
    np.testing.assert_array_equal(vote_labels(grid, readings, LEARNED)[0], grid.label)


@pytest.mark.parametrize("seed", range(3))
def test_a_class_is_one_that_was_read_there_or_beside(seed):
    grid, readings = random_readings(seed)
    found, voted = (vote_labels(grid, readings, s)[0] for s in (LEARNED, VOTED))
    cols = grid.spec.cols
    for row, col in np.argwhere(found != voted):
        near = voted[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]
        assert found[row, col] in {
            *near.reshape(-1).tolist(),
            *readings.label[readings.cell == row * cols + col].tolist(),
        }
