"""Connected patches of the label map, against walking from cell to cell."""

import numpy as np
import pytest
from drawn_readings import LABELS, drawn_grid, grid_of, random_readings
from evidence_twins import blocks, plain_patches

from simaps_viz.mapping.components import component_communities


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("speckled", [False, True])
def test_patches_are_the_twins(seed, speckled):
    grid, _ = random_readings(seed)
    if speckled:
        label = np.random.default_rng(seed).integers(0, len(LABELS), grid.spec.shape).astype(np.int16)
        grid = grid_of(label, grid.height_m)
    found, cols = component_communities(grid), grid.spec.cols
    assert found.dtype == np.int32
    wanted = {frozenset(row * cols + col for row, col in cells) for _, cells in plain_patches(grid)}
    assert blocks(found) == wanted and len(wanted) > 2
    numbers = np.unique(found[found > 0])
    assert np.array_equal(numbers, np.arange(1, len(wanted) + 1))
    classes = [int(grid.label[found == number][0]) for number in numbers]
    assert classes == sorted(classes), "class by class"


def test_corners_connect_classes_and_gaps_do_not():
    grid = drawn_grid("c_tt\n_ct_\ncc_t")
    assert len(plain_patches(grid)) == 2
    assert component_communities(grid).tolist() == [[1, 0, 2, 2], [0, 1, 2, 0], [1, 1, 0, 2]]


@pytest.mark.parametrize("drawing", ["_", ".", "?", "._\n_?"])
def test_without_things_there_is_nothing(drawing):
    assert not component_communities(drawn_grid(drawing)).any()


def test_one_cell_and_one_class():
    assert component_communities(drawn_grid("c")).tolist() == [[1]]
    assert component_communities(drawn_grid("cc\ncc")).tolist() == [[1, 1], [1, 1]]
