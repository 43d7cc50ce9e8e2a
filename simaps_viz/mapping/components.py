"""Connected components of the label map: the baseline that knows classes but not which segment saw what."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from simaps_viz.structures import Grid


def component_communities(grid: Grid) -> NDArray:
    """Number the 8-connected patches of every thing class, class by class; int32 [rows, cols], from 1, 0 = none."""
    community = np.zeros(grid.spec.shape, dtype=np.int32)
    first = 0
    for index in np.unique(grid.label):
        if index == 0 or not grid.is_thing[index]:
            continue
        found = np.zeros(grid.spec.shape, dtype=np.int32)
        count = int(ndimage.label(grid.label == index, structure=np.ones((3, 3)), output=found))  # pyright: ignore
        community[found > 0] = found[found > 0] + first
        first += count
    return community
