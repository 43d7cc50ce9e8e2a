"""The toy map with a log of edits, and the same room built anew on another grid."""

from dataclasses import replace

from toy_maps import TOY_SPEC, TOY_THINGS, TOY_WALLS, map_of_boxes, toy_map

from simaps_viz.mapping import edits
from simaps_viz.mapping.mending import EditLog

TOY = toy_map()
WHEN = "2026-11-21T19:30:00Z"


def a_log():
    log = EditLog().add(edits.merge(TOY, 3, 4), who="Ann", when=WHEN)
    log = log.add(edits.split(TOY, 8, (3.6, 0.0), (3.6, 1.0)), who="Bo", when=WHEN)
    log = log.add(edits.relabel(TOY, 5, "día bed"), who="Ann", when=WHEN)
    return log.add(edits.delete(TOY, 9), who="Ann", when=WHEN).undo()


def shifted_toy():
    """The same room, on a grid that grew by 3 cells to the west and lost chair 3."""
    spec = replace(TOY_SPEC, cols=TOY_SPEC.cols + 3, x0_m=TOY_SPEC.x0_m - 3 * 0.05)
    move = [replace(box, col=box.col + 3) for box in (*TOY_THINGS, *TOY_WALLS)]
    things, walls = move[: len(TOY_THINGS)], move[len(TOY_THINGS) :]
    return map_of_boxes(spec, [*things[:1], *things[2:]], walls)
