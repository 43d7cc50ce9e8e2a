"""The toy map with a surface: tables with a top and legs only, and a plant that stands hidden under one of them."""

from dataclasses import replace

import numpy as np
from toy_maps import toy_map

from simaps_viz.mapping.surface import Surface, coded_colors
from simaps_viz.structures import Instance, SIMap

PLANT = 900
"""Id of the hidden plant, under the dining table with the lower id."""
PLANT_CELLS = slice(73, 77), slice(24, 28)
PLANT_TOP_M, TABLE_STEP = 0.45, 15
RED, GREEN, BROWN, GREY = (200, 40, 40), (40, 160, 56), (136, 96, 64), (160, 160, 160)


def toy_with_surface() -> SIMap:
    """Return the toy map with voxels: floor and walls grey, tables brown, the hidden plant green, the rest red."""
    simap = toy_map()
    floor, plant = (simap.grid.labels.index(name) for name in ("floor", "potted plant"))
    tables = [one.id for one in simap.of_class("dining table")]
    hides = np.zeros(simap.spec.shape, bool)
    hides[PLANT_CELLS] = True
    runs = []
    for row, col in np.argwhere(~np.isnan(simap.grid.height_m)).tolist():
        cell, one = row * simap.spec.cols + col, simap.instance[row, col]
        top = int(simap.grid.height_m[row, col] / 0.05 + 1e-4)
        if one in tables:
            runs.append((cell, 0, 0, -1 - floor, GREY))
            if hides[row, col]:
                runs.append((cell, 1, 8, PLANT, GREEN))
            runs.append((cell, top, top, 0, BROWN))
        else:
            runs.append((cell, 0, top, 0, RED if one else GREY))
    cell, low, high, owner = np.array([run[:4] for run in runs], np.int64).T
    rgb = np.repeat(np.array([run[4] for run in runs], np.uint8), high - low + 1, axis=0)
    surface = Surface(
        simap.spec, cell.astype(np.int32), low.astype(np.int8), high.astype(np.int8), owner.astype(np.int32),
        coded_colors(rgb),
    )  # fmt: skip
    x, y = simap.spec.centre_of(74.5, 25.5)
    corners = (x - 0.1, y - 0.1, 0.05), (x + 0.1, y + 0.1, PLANT_TOP_M)
    hidden = Instance(PLANT, simap.grid.labels[plant], 16, (x, y, PLANT_TOP_M), corners, 3, 0.9)
    return replace(simap, surface=surface, hidden=(hidden,))
