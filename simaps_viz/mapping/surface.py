"""The surface of a map: where frames saw something, in voxels of at most 5 cm, and which object it belongs to.

It is kept as runs of steps of height in a cell, with an owner that follows the map: what belongs to the object that the
map shows in its cell still does when objects are joined, cut, renamed or deleted.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.geometry import shared_cells
from simaps_viz.mapping.in_space import column_points
from simaps_viz.mapping.projection import STEPS_PER_M
from simaps_viz.structures import GridSpec, Instance, Points, SIMap

STEP_M = 1.0 / STEPS_PER_M
"""Height of a step."""
UNSEEN = 128
"""Red, green and blue of what was seen without colour."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Runs of steps of height in cells. Arrays aligned, cells ascending."""

    spec: GridSpec
    """The grid of the map."""
    cell: NDArray
    """int32 [n], flat number (row * cols + col)."""
    low: NDArray
    """int8 [n], first step; step k is from 0.05 k to 0.05 (k + 1) metres over the floor."""
    high: NDArray
    """int8 [n], last step."""
    owner: NDArray
    """int32 [n]. 0: what the map shows in the cell. Above 0: a finest community of the map, or a hidden object. Below
    0: class -1 - owner, of no object."""
    color: NDArray = field(default_factory=lambda: np.zeros((3, 0), np.int8))
    """int8 [3, voxels], colour of each step of each run, in their order, see `coded_colors`; [3, 0] = none was seen."""

    @property
    def voxels(self) -> int:
        """Number of voxels."""
        return int((self.high.astype(np.int64) - self.low + 1).sum())


def surface_points(simap: SIMap) -> Points:
    """Return the surface voxels of a map with their colours, classes and instances; see `SIMap.points`."""
    surface = simap.surface
    if surface is None or surface.spec != simap.spec:
        return column_points(simap)
    size = surface.high.astype(np.int64) - surface.low + 1
    run = np.repeat(np.arange(len(size)), size)
    step = surface.low[run] + (np.arange(len(run)) - np.repeat(np.cumsum(size) - size, size))
    spec, s = surface.spec, surface.spec.cell_size_m
    row, col = np.divmod(surface.cell[run], spec.cols)
    positions = np.zeros((len(run), 3), np.float32)
    for axis, values in enumerate((spec.x0_m + (col + 0.5) * s, spec.y0_m + (row + 0.5) * s, (step + 0.5) * STEP_M)):
        positions[:, axis] = values
    classes, instances = (of_run[run] for of_run in owned_runs(simap, surface))
    rgb = decoded_colors(surface.color) if surface.color.size else np.full((len(run), 3), UNSEEN, np.uint8)
    return Points(positions, rgb, classes, instances)


def coded_colors(rgb: NDArray) -> NDArray:
    """Return colours as brightness and two differences, in coarse steps: they take a third of the bytes in a map file.

    Args:
        rgb: uint8 [n, 3].

    Returns:
        int8 [3, n]: (R + 2 G + B) / 4 in steps of 12, R - B in steps of 32, 2 G - R - B in steps of 64, all rounded.
    """
    red, green, blue = rgb.T.astype(np.int16)
    coded = (red + 2 * green + blue + 24) // 48, (red - blue + 16) >> 5, (2 * green - red - blue + 32) >> 6
    return np.stack(coded).astype(np.int8)


def decoded_colors(coded: NDArray) -> NDArray:
    """Return colours as uint8 [n, 3], from what `coded_colors` returned; each is right to about 24 of 255."""
    bright, warm, green = coded.astype(np.int16) * np.array([[12], [32], [64]], np.int16)
    rest = bright - green // 4  # (R + B) / 2
    return np.clip(np.stack([rest + warm // 2, bright + green // 4, rest - warm // 2], axis=1), 0, 255).astype(np.uint8)


def owned_runs(simap: SIMap, surface: Surface) -> tuple[NDArray, NDArray]:
    """Return the class int16 (-1 = none) and the instance int32 (0 = none) of each run."""
    owner, cell = surface.owner, surface.cell
    classes = np.where(owner == 0, simap.grid.label.reshape(-1)[cell], 0).astype(np.int32)
    instances = np.where(owner == 0, simap.instance.reshape(-1)[cell], 0).astype(np.int32)
    classes = np.where(owner < 0, -1 - owner, classes)
    owned = np.flatnonzero(owner > 0)
    if len(owned):
        class_of, instance_of = _of_owner(simap, int(owner.max()))
        classes[owned], instances[owned] = class_of[owner[owned]], instance_of[owner[owned]]
    classes[classes == 0] = -1
    return classes.astype(np.int16), instances


def _of_owner(simap: SIMap, highest: int) -> tuple[NDArray, NDArray]:
    """Return the class and the instance of each finest community and hidden object, int32 [highest + 1] each."""
    community, instance, label = (a.reshape(-1) for a in (simap.community, simap.instance, simap.grid.label))
    cell = np.flatnonzero(community)
    classes, instances = np.zeros(highest + 1, np.int32), np.zeros(highest + 1, np.int32)
    cell = cell[community[cell] <= highest]
    classes[community[cell]], instances[community[cell]] = label[cell], instance[cell]
    for one in simap.hidden:
        if one.id <= highest:
            classes[one.id], instances[one.id] = simap.grid.labels.index(one.label), one.id
    return classes, instances


def surface_among(simap: SIMap, community: NDArray) -> tuple[Surface | None, tuple[Instance, ...]]:
    """Return the surface and the hidden objects of a map whose finest communities are found anew.

    Args:
        simap: the map as it was.
        community: int32 [rows, cols], the new communities.
    """
    surface = simap.surface
    if surface is None:
        return None, ()
    # Each old community goes with the new one that has most of its cells (ties: the smallest), hidden ones move on.
    old, new, cells = shared_cells(simap.community, community)
    order = np.lexsort((-new, -old, cells))  # the largest share is written last
    ids = (simap.community.max(initial=0), surface.owner.max(initial=0), *(one.id for one in simap.hidden))
    highest = int(max(ids))
    after = np.zeros(highest + 1, np.int32)
    after[old[order]] = new[order]
    first = int(community.max(initial=0)) + 1
    hidden = tuple(replace(one, id=first + k) for k, one in enumerate(simap.hidden))
    for one, moved in zip(simap.hidden, hidden, strict=True):
        after[one.id] = moved.id
    owner = surface.owner.copy()
    owner[owner > 0] = after[owner[owner > 0]]
    return replace(surface, owner=owner), hidden
