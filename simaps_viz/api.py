"""Functions on maps: find instances, plan paths, carry out commands, convert to pandas.

Each is also a method of `SIMap`, which only calls the function here.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from simaps_viz.errors import InputError, needs_extra
from simaps_viz.exports.records import COLUMNS, record
from simaps_viz.language.grounding import Grounding
from simaps_viz.navigation.agent import Answer, answer, planner_of, start_pose
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Instance, Path, Pose2, SIMap

if TYPE_CHECKING:
    import pandas as pd

Point = tuple[float, float]
"""x and y in metres, map frame."""
Place = Point | Pose2 | Instance
"""A position: for an instance, its centre or its cells."""


def find(simap: SIMap, name: str, *, near: Place | str | None = None) -> tuple[Instance, ...]:
    """Find the instances a name means, the closest first.

    Args:
        simap: the map.
        name: a class of the map, or a word the command reader knows for one ("sofa", "seat", "chairs").
        near: a point, a pose, an instance, or the name of objects: distances are between the nearest cells' centres.
            Left out, the order is that of ``SIMap.instances``: class, then id. What is near itself is left out.

    Raises:
        CommandError: the map has nothing of that name; the message says what it has.
        InputError: the name is no text or empty, or ``near`` is no place.
    """
    for what, text in (("name", name), ("near", near)):
        empty = isinstance(text, str) and not text.strip()
        if empty or (what == "name" and not isinstance(text, str)):
            raise InputError(f"{what}: expected the name of objects, found {text!r}")
    grounding = Grounding(simap, Pose2(0.0, 0.0, 0.0))
    found = grounding.members(name)
    if near is None:
        return found
    others = grounding.members(near) if isinstance(near, str) else (near,) if isinstance(near, Instance) else ()
    targets = np.concatenate([grounding.cells_of(o) for o in others]) if others else _point(near)
    tree, itself = KDTree(targets), {other.id for other in others}
    far = {i.id: round(float(tree.query(grounding.cells_of(i))[0].min()), 9) for i in found if i.id not in itself}
    return tuple(sorted((i for i in found if i.id in far), key=lambda i: (far[i.id], i.id)))


def plan(
    simap: SIMap,
    start: Place,
    goal: Place | str,
    *,
    robot: RobotShape | None = None,
) -> Path:
    """Plan the cheapest path of a robot's centre over free floor.

    Args:
        simap: the map.
        start: position of the robot; moved to free floor within 0.5 m if it is not free.
        goal: a point on free floor, or an object: the path then ends at the free cell nearest to it. A name means the
            object of that name closest to the start.
        robot: its shape, by default 0.2 m in radius and 1.5 m high.

    Raises:
        CommandError: the map has nothing of that name.
        PlanningError: there is no path; the message says why.
    """
    planner = planner_of(simap, robot or RobotShape())
    x, y = _point(start)[0].tolist()
    if isinstance(goal, str):
        goal = find(simap, goal, near=(x, y))[0]
    if isinstance(goal, Instance):
        cells = Grounding(simap, Pose2(x, y, 0.0)).cells_of(goal)
        return planner.plan_near((x, y), cells, f"to the {goal.label}")
    goal_x, goal_y = _point(goal)[0].tolist()
    return planner.plan((x, y), (goal_x, goal_y))


def ask(simap: SIMap, command: str, *, pose: Pose2 | None = None, robot: RobotShape | None = None) -> Answer:
    """Carry out a command with a simulated robot, as `simaps query` does: read offline, rehearsed, then driven.

    Args:
        simap: the map.
        command: a command or question in English, or a program (anything that calls ``robot.`` or a function).
        pose: pose of the robot; by default that of the first camera that has free floor near it.
        robot: its shape, by default 0.2 m in radius and 1.5 m high.

    Returns:
        The outcome; that of a question has an ``answer``. A command that is not understood, or cannot be carried out,
        is an answer too: its ``status`` is "refused" or "failed", and its ``reason`` says why.

    Raises:
        InputError: the command is no text, ``pose`` is no `Pose2` of finite numbers, or is left out on a map that
            no camera has seen.
    """
    if not isinstance(command, str):
        raise InputError(f"command: expected text, found {command!r}")
    if pose is not None and not isinstance(pose, Pose2):
        raise InputError(f"pose: expected a Pose2, which has a heading, found {pose!r}")
    return answer(simap, command, start_pose(simap, robot) if pose is None else pose, robot=robot)


def to_pandas(simap: SIMap) -> "pd.DataFrame":
    """Return the instances as a pandas frame, one row each, indexed by id; lengths in metres of the map frame.

    Raises:
        InputError: pandas is not installed.
    """
    with needs_extra("pandas", "to_pandas"):
        import pandas as pd  # noqa: PLC0415 - optional, and slow to import
    columns = [name for name in COLUMNS if name != "outline_wkt"]
    frame = pd.DataFrame([record(simap, one) for one in simap.instances], columns=columns)
    if frame.empty:  # otherwise every column would have dtype object
        text = ("name", "label", "color")
        whole = ("id", "cells", "frames")
        frame = frame.astype({c: "int64" if c in whole else "float64" for c in columns if c not in text})
    return frame.set_index("id")


def _point(where: object) -> NDArray:
    """Return a place as float64 [1, 2]."""
    if isinstance(where, Pose2):
        where = (where.x_m, where.y_m)
    if isinstance(where, Instance):
        where = where.centroid_m[:2]
    try:
        point = np.array(where, np.float64)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise InputError(f"place: expected (x, y) in metres, a pose or an instance, found {where!r}")
    return point[None]
