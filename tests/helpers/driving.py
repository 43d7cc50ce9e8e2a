"""A map, a command, and a place from where the command leads farther than one goal."""

from toy_maps import toy_map

from simaps_viz.live.drive import LEASH_M
from simaps_viz.navigation.agent import answer
from simaps_viz.structures import Pose2

COMMAND = "go to the chair"
SIMAP = toy_map()


def free_start():
    """A place from where the chair can be reached, and the path there."""
    grid = SIMAP.grid
    for row in range(0, grid.spec.rows, 3):
        for col in range(0, grid.spec.cols, 3):
            x, y = grid.spec.centre_of(row, col)
            found = answer(SIMAP, COMMAND, Pose2(x, y, 0.0))
            if found.status == "ok" and found.path_length_m > 2 * LEASH_M:
                return x, y, found
    raise AssertionError("no place on this map is far from the chair")


START = free_start()
