"""Objects by the contours of a cleaned mask."""

import numpy as np
import pytest

from simaps_viz.baselines.vlmaps import PUBLISHED, ContourSettings, contour_objects
from simaps_viz.errors import InputError

RAW = ContourSettings(closing=0, sigma=0.0, dilation=0, min_box_cells=0)


def mask(*boxes: tuple[int, int, int, int], shape: tuple[int, int] = (30, 40)) -> np.ndarray:
    """Boxes are (row, col, rows, cols)."""
    found = np.zeros(shape, bool)
    for row, col, rows, cols in boxes:
        found[row : row + rows, col : col + cols] = True
    return found


def test_untouched_masks_give_their_components_numbered_by_their_first_cell():
    cells = mask((20, 0, 5, 5), (2, 20, 6, 6), (2, 3, 4, 4))
    objects = contour_objects(cells, RAW)
    np.testing.assert_array_equal(objects > 0, cells)
    assert objects[2, 3] == 1 and objects[2, 20] == 2 and objects[20, 0] == 3
    assert [int((objects == i).sum()) for i in (1, 2, 3)] == [16, 36, 25]


def test_holes_belong_to_the_contour_around_them():
    cells = mask((5, 5, 9, 9))
    cells[8:11, 8:11] = False
    assert int((contour_objects(cells, RAW) == 1).sum()) == 81


@pytest.mark.parametrize(("gap", "objects"), [(4, 1), (6, 1), (7, 2), (9, 2)])
def test_closing_bridges_gaps_up_to_twice_its_size(gap, objects):
    cells = mask((5, 2, 10, 10), (5, 12 + gap, 10, 10))
    closing = ContourSettings(closing=3, sigma=0.0, dilation=0, min_box_cells=0)
    assert contour_objects(cells, closing).max() == objects
    assert contour_objects(cells, RAW).max() == 2


def test_dilation_takes_in_a_rim_and_blur_takes_specks_away():
    dilated = contour_objects(mask((5, 5, 6, 6)), ContourSettings(0, 0.0, 1, 0))
    assert int((dilated == 1).sum()) == 36 + 4 * 6
    speck = mask((5, 5, 6, 6), (20, 20, 1, 1))
    assert contour_objects(speck, ContourSettings(0, 0.8, 0, 0)).max() == 1
    assert contour_objects(speck, RAW).max() == 1  # its box has no area


def test_small_boxes_are_dropped_and_the_others_numbered_without_gaps():
    cells = mask((1, 1, 4, 4), (10, 10, 5, 5))
    objects = contour_objects(cells, ContourSettings(0, 0.0, 0, min_box_cells=9))
    assert objects[2, 2] == 0 and objects[12, 12] == 1 and objects.max() == 1


def test_the_rim_of_the_map_changes_nothing():
    cells = mask((0, 0, 10, 10))
    away = mask((10, 10, 10, 10))
    settings = PUBLISHED
    corner, middle = contour_objects(cells, settings), contour_objects(away, settings)
    np.testing.assert_array_equal(corner[:10, :10], middle[10:20, 10:20])
    assert contour_objects(mask(), settings).max() == 0


def test_bad_settings_are_named():
    with pytest.raises(InputError, match=r"found -1, 1, 0\.8 and 10"):
        ContourSettings(closing=-1, sigma=0.8, dilation=1, min_box_cells=10)
