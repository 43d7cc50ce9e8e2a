"""From a click in the recorded build to a place on the map."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.structures import SIMap

PICTURES = "/world/camera/"
OBJECTS = ("/world/objects", "/map/names")
"""Entities whose instances are those of the finished map, in its order."""
ON_MAP = "/map/"
IN_ROOM = ("/world/cells", "/world/points")


def place_inside(simap: SIMap, instance_id: int) -> tuple[float, float]:
    """Return the centre of the instance's cell that lies nearest to its middle, map frame, metres.

    Raises:
        InputError: there is no such instance.
    """
    row, col = np.nonzero(simap.instance == simap.by_id(instance_id).id)
    middle = int(np.argmin(np.hypot(row - row.mean(), col - col.mean())))
    return simap.spec.centre_of(float(row[middle]), float(col[middle]))


def clicked_place(
    items: Sequence[Mapping[str, Any]],
    simap: SIMap,
    frame: int,
    *,
    view: Callable[[int], tuple[NDArray, NDArray] | None],
    divide: Mapping[str, int],
) -> tuple[float, float] | None:
    """Return the place on the map that was clicked in the recorded build.

    Args:
        items: of a ``selection_change`` event of rerun's web viewer.
        simap: the map that was recorded.
        frame: the frame that the recorded build shows.
        view: frame index -> (RGB, segment ids) or None.
        divide: entity path -> how many times smaller than the frame its recorded picture is; a click in a picture
            that is not named here gives no place.

    Returns:
        (x, y), map frame, metres; None when nothing of the map was clicked.
    """
    for item in items:
        path, position = str(item.get("entity_path", "")), item.get("position")
        index = item.get("instance_id")
        if path in OBJECTS and isinstance(index, int) and 0 <= index < len(simap.instances):
            return place_inside(simap, simap.instances[index].id)
        numbers = position if isinstance(position, list) and len(position) == 3 else [None, None, None]
        x, y, z = (float(v) if isinstance(v, int | float) else None for v in numbers)
        if x is None or y is None:
            continue
        if path.startswith(ON_MAP):
            return x, -y  # rerun's pictures of the map have y down
        if path in IN_ROOM and z is not None:
            return x, y
        if path.startswith(PICTURES) and z is None and path in divide:
            found = _instance_in_picture(simap, frame, view(frame), (x * divide[path], y * divide[path]))
            if found:
                return place_inside(simap, found)
    return None


def in_a_view(items: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether something was clicked in one of the recording's views, and not only chosen by its name."""
    return any(
        isinstance(item.get("position"), list) or (item.get("type") == "view" and not item.get("by_name"))
        for item in items
    )


def _instance_in_picture(
    simap: SIMap, frame: int, seen: tuple[NDArray, NDArray] | None, pixel: tuple[float, float]
) -> int:
    """Return the instance most of whose cells the segment at a pixel (u, v) named, or 0."""
    if seen is None:
        return 0
    (height, width), (rgb_height, rgb_width) = seen[1].shape, seen[0].shape[:2]
    u, v = int(pixel[0] * width / rgb_width), int(pixel[1] * height / rgb_height)
    if not (0 <= u < width and 0 <= v < height) or seen[1][v, u] == 0:
        return 0
    views = simap.views
    mine = (views.frame == frame) & (views.segment == seen[1][v, u])
    owner = np.zeros(int(max(simap.community.max(initial=0), views.community.max(initial=0))) + 1, np.int32)
    owner[simap.community] = simap.instance
    named = np.bincount(owner[views.community[mine]], views.cells[mine], minlength=2)
    named[0] = 0.0
    return int(named.argmax()) if named.any() else 0
