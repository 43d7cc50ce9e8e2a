"""Maps as ROS reads them: a PGM picture and a YAML file that says where it lies; for Nav2, three such pairs.

Row 0 of the picture is north (largest y), as map_server flips it; ``origin`` is the outer corner of the south-west
cell.

Nav2 gets the static map, a keepout mask of the furniture, and an inflated costmap. The costmap follows Nav2's inflation
layer: cost 254 in an obstacle, 253 within the robot's radius of one, then ``252 exp(-scaling (distance - radius))`` out
to the inflation radius; written as its costmap publisher scales it to an occupancy grid (254 -> 100, 253 -> 99,
1..252 -> 1..98, unknown -> 255).
"""

import json
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.navigation.agent import planner_of
from simaps_viz.navigation.planner import Planner
from simaps_viz.structures import GridSpec, SIMap

FREE: Final = 254
UNKNOWN: Final = 205
OCCUPIED: Final = 0
"""Grey values map_saver writes; with the thresholds below they read as 0, -1 and 100."""
FREE_THRESH: Final = 0.196
"""Nav2's usual 0.25 would read 205 as free."""
OCCUPIED_THRESH: Final = 0.65
INFLATION_M: Final = 0.55
COST_SCALING: Final = 10.0
"""Per metre; both are the defaults of Nav2's inflation layer."""
LETHAL: Final = 100
INSCRIBED: Final = 99
UNKNOWN_COST: Final = 255


class ROSMap(Exporter):
    """One occupancy map."""

    endings = own_endings = (".yaml", ".pgm")

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return STEM.yaml and STEM.pgm.

        Cells are occupied where the robot would touch something, and unknown where nothing was seen.
        """
        planner = planner_of(simap, options.robot)
        return map_pair(planner.spec, occupancy_grey(planner), path.with_suffix(""), mode="trinary")


def occupancy_grey(planner: Planner) -> NDArray:
    """Return uint8 [rows, cols], grey values, row 0 in the south: the planner's obstacles, not grown by the radius."""
    seen = ~np.isnan(planner.grid.height_m)
    return np.where(planner.blocked, OCCUPIED, np.where(seen, FREE, UNKNOWN)).astype(np.uint8)


def map_pair(spec: GridSpec, grey: NDArray, stem: Path, *, mode: Literal["trinary", "raw"]) -> dict[Path, bytes]:
    """Return the two files of one map.

    Args:
        spec: where the cells lie.
        grey: uint8 [rows, cols], row 0 in the south.
        stem: their path without an ending.
        mode: how map_server turns grey values into occupancy.
    """
    picture, about = (stem.with_name(stem.name + ending) for ending in (".pgm", ".yaml"))
    text = (
        f"image: {json.dumps(picture.name, ensure_ascii=False)}\n"
        f"mode: {mode}\n"
        f"resolution: {_number(spec.cell_size_m)}\n"
        f"origin: [{_number(spec.x0_m)}, {_number(spec.y0_m)}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESH}\n"
        f"free_thresh: {FREE_THRESH}\n"
    )
    return {about: text.encode(), picture: pgm(grey[::-1])}


class Nav2Maps(Exporter):
    """The static map, the keepout mask and the costmap."""

    endings = (".yaml", ".pgm")

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return STEM, STEM-keepout and STEM-costmap, a .yaml and a .pgm each."""
        planner, stem = planner_of(simap, options.robot), path.with_suffix("")
        # Objects the robot would touch: a laser scanner sees only the legs of a table; the mask holds the table.
        keepout = np.where(planner.blocked & (simap.instance > 0), OCCUPIED, FREE).astype(np.uint8)
        return {
            **map_pair(planner.spec, occupancy_grey(planner), stem, mode="trinary"),
            **map_pair(planner.spec, keepout, stem.with_name(f"{stem.name}-keepout"), mode="trinary"),
            **map_pair(planner.spec, inflated(planner), stem.with_name(f"{stem.name}-costmap"), mode="raw"),
        }


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
    cost[~seen & ~blocked] = UNKNOWN_COST
    return cost


def pgm(picture: NDArray) -> bytes:
    """Encode uint8 [height, width] as binary PGM (P5), the top row first."""
    height, width = picture.shape
    return f"P5\n{width} {height}\n255\n".encode() + np.ascontiguousarray(picture).tobytes()


def _number(value: float) -> str:
    """Write a float so that YAML 1.1 reads the very same: never with an exponent."""
    return np.format_float_positional(value, trim="0")
