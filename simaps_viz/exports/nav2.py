"""What Nav2 needs of a map: the static map, a keepout mask of the furniture, and an inflated costmap.

The costmap follows Nav2's inflation layer: cost 254 in an obstacle, 253 within the robot's radius of one, then
``252 exp(-scaling (distance - radius))`` out to the inflation radius; written as its costmap publisher scales it to an
occupancy grid (254 -> 100, 253 -> 99, 1..252 -> 1..98, unknown -> 255).
"""

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from simaps_viz.exports.ros import FREE, OCCUPIED, map_pair, ros_files
from simaps_viz.navigation.planner import Planner
from simaps_viz.structures import SIMap

INFLATION_M: Final = 0.55
COST_SCALING: Final = 10.0
"""Per metre; both are the defaults of Nav2's inflation layer."""
LETHAL: Final = 100
INSCRIBED: Final = 99
UNKNOWN: Final = 255


def nav2_files(simap: SIMap, planner: Planner, stem: Path) -> dict[Path, bytes]:
    """Return STEM, STEM-keepout and STEM-costmap, a .yaml and a .pgm each."""
    keepout = np.where(keepout_cells(simap, planner), OCCUPIED, FREE).astype(np.uint8)
    return {
        **ros_files(planner, stem),
        **map_pair(planner.spec, keepout, stem.with_name(f"{stem.name}-keepout"), mode="trinary"),
        **map_pair(planner.spec, inflated(planner), stem.with_name(f"{stem.name}-costmap"), mode="raw"),
    }


def keepout_cells(simap: SIMap, planner: Planner) -> NDArray:
    """Return which cells belong to an object the robot would touch, bool [rows, cols].

    A laser scanner sees only the legs of a table; the mask holds the table.
    """
    return planner.blocked & (simap.instance > 0)


def inflated(planner: Planner) -> NDArray:
    """Return the costmap, uint8 [rows, cols]: 0 free .. 98, 99 the robot would touch, 100 obstacle, 255 never seen.

    Below 99 lie exactly the cells that are free for the planner.
    """
    seen, blocked = ~np.isnan(planner.grid.height_m), planner.blocked
    cost = np.zeros(planner.spec.shape, np.uint8)
    if blocked.any():
        radius_m, cell_m = planner.robot.radius_m, planner.spec.cell_size_m
        distance_m = np.asarray(ndimage.distance_transform_edt(~blocked)) * cell_m - cell_m / 2.0
        nav2_cost = np.floor(252.0 * np.exp(-COST_SCALING * np.maximum(distance_m - radius_m, 0.0)))
        near = (nav2_cost >= 1.0) & (distance_m <= max(INFLATION_M, radius_m))
        cost[near] = (1 + 97 * (nav2_cost[near] - 1) // 251).astype(np.uint8)
        cost[~planner.free] = INSCRIBED
        cost[blocked] = LETHAL
    cost[~seen & ~blocked] = UNKNOWN
    return cost
