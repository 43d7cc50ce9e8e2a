"""Method components: every 8-connected patch of a class is one instance; nothing is joined."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from simaps_viz.mapping.method import Method
from simaps_viz.mapping.partition import empty_log
from simaps_viz.structures import CellGraph, Grid, MergeLog


class Components(Method):
    """Cells get their class by votes; patches are the communities."""

    def communities(
        self, grid: Grid, graphs: Sequence[CellGraph], parameters: Mapping[str, Any]
    ) -> tuple[NDArray, MergeLog]:
        """Number the patches."""
        del graphs, parameters
        return component_communities(grid), empty_log()


COMPONENTS = Components("components")


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
