"""Occupancy maps as ROS map servers read them: a PGM picture and a YAML file that says where it lies.

Row 0 of the picture is north (largest y), as map_server flips it; ``origin`` is the outer corner of the
south-west cell.
"""

import json
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.navigation.planner import Planner
from simaps_viz.structures import GridSpec

FREE: Final = 254
UNKNOWN: Final = 205
OCCUPIED: Final = 0
"""Grey values map_saver writes; with the thresholds below they read as 0, -1 and 100."""
FREE_THRESH: Final = 0.196
"""Nav2's usual 0.25 would read 205 as free."""
OCCUPIED_THRESH: Final = 0.65


def ros_files(planner: Planner, stem: Path) -> dict[Path, bytes]:
    """Return STEM.yaml and STEM.pgm: occupied where the robot would touch something, unknown where nothing was seen."""
    return map_pair(planner.spec, occupancy_grey(planner), stem, mode="trinary")


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


def pgm(picture: NDArray) -> bytes:
    """Encode uint8 [height, width] as binary PGM (P5), the top row first."""
    height, width = picture.shape
    return f"P5\n{width} {height}\n255\n".encode() + np.ascontiguousarray(picture).tobytes()


def _number(value: float) -> str:
    """Write a float so that YAML 1.1 reads the very same: never with an exponent."""
    return np.format_float_positional(value, trim="0")
