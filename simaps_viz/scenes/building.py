"""A building from plain data: rooms, doorways and windows become floors, walls and panes.

World: metres, z up, floor at z = 0, x east, y north. Yaw is counter-clockwise from +x and turns the front of a model
(+x) to where it looks.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from simaps_viz.scenes.materials import CHARCOAL, WHITE, Material, Texture, paint
from simaps_viz.scenes.scene import Scene, SceneObject, assemble, build, place
from simaps_viz.scenes.shapes import Model, box, moved

WALL_THICKNESS_M = 0.12
CEILING_HEIGHT_M = 2.7
DOOR_HEIGHT_M = 2.1
SKY = paint("cfe0ee", Texture.SKY)


@dataclass(frozen=True)
class Opening:
    """A hole in a wall, from ``start`` to ``end`` along it; a doorway reaches the floor, a window does not."""

    start: float
    end: float
    low: float = 0.0
    high: float = DOOR_HEIGHT_M

    @property
    def is_window(self) -> bool:
        """Return whether the hole has a sill."""
        return self.low > 0


@dataclass(frozen=True)
class WallRun:
    """A straight wall from one point of its middle line to another."""

    name: str
    start: tuple[float, float]
    end: tuple[float, float]
    right: Material
    """Finish of the side that lies right of the direction from start to end."""
    left: Material
    openings: tuple[Opening, ...] = ()

    @property
    def length(self) -> float:
        """Length, metres."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    def place(self, model: Model) -> Model:
        """Move parts from the wall's frame (x to the right, y along, origin at its start) to the world."""
        yaw = np.arctan2(self.end[1] - self.start[1], self.end[0] - self.start[0]) - np.pi / 2
        return moved(model, *self.start, yaw_rad=yaw)


def wall(run: WallRun) -> Model:
    """Build a wall: two skins, trim round its openings, skirting boards."""
    t = WALL_THICKNESS_M
    parts: Model = []

    def block(y0: float, y1: float, z0: float, z1: float) -> None:
        if y1 - y0 < 1e-6 or z1 - z0 < 1e-6:
            return
        for side, finish in ((1, run.right), (-1, run.left)):
            parts.append(box((t / 2, y1 - y0, z1 - z0), (side * t / 4, (y0 + y1) / 2, (z0 + z1) / 2), finish))
            if z0 == 0.0:
                parts.append(box((0.012, y1 - y0, 0.08), (side * (t / 2 + 0.006), (y0 + y1) / 2, 0.04), WHITE))

    at = 0.0
    for hole in sorted(run.openings, key=lambda o: o.start):
        block(at, hole.start, 0.0, CEILING_HEIGHT_M)
        block(hole.start, hole.end, 0.0, hole.low)
        block(hole.start, hole.end, hole.high, CEILING_HEIGHT_M)
        parts.extend(_door_trim(hole) if not hole.is_window else [])
        at = hole.end
    block(at, run.length, 0.0, CEILING_HEIGHT_M)
    return run.place(parts)


def _door_trim(hole: Opening) -> Model:
    """Frame a doorway; the trim lies on the wall and in its reveal, 1 cm thick."""
    t = WALL_THICKNESS_M + 0.03
    middle, width = (hole.start + hole.end) / 2, hole.end - hole.start
    parts = [box((t, 0.01, hole.high), (0, y, hole.high / 2), WHITE) for y in (hole.start + 0.005, hole.end - 0.005)]
    parts.append(box((t, width, 0.01), (0, middle, hole.high - 0.005), WHITE))
    for side in (-1, 1):
        x = side * (WALL_THICKNESS_M / 2 + 0.007)
        for y in (hole.start - 0.03, hole.end + 0.03):
            parts.append(box((0.014, 0.07, hole.high + 0.06), (x, y, (hole.high + 0.06) / 2), WHITE))
        parts.append(box((0.014, width + 0.13, 0.07), (x, middle, hole.high + 0.03), WHITE))
    return parts


def window(run: WallRun, hole: Opening) -> Model:
    """Build one window: frame, bars, sill, and a pane through which the sky shows."""
    width, height = hole.end - hole.start, hole.high - hole.low
    middle, z = (hole.start + hole.end) / 2, (hole.low + hole.high) / 2
    parts = [box((0.004, width, height), (-0.03, middle, z), SKY)]
    for y in (hole.start + 0.025, hole.end - 0.025):
        parts.append(box((0.07, 0.05, height), (-0.02, y, z), CHARCOAL))
    for level in (hole.low + 0.025, hole.high - 0.025):
        parts.append(box((0.07, width, 0.05), (-0.02, middle, level), CHARCOAL))
    bars = max(1, round(width / 0.8))
    for i in range(1, bars):
        parts.append(box((0.04, 0.03, height), (-0.02, hole.start + i * width / bars, z), CHARCOAL))
    parts.append(box((0.04, width, 0.03), (-0.02, middle, hole.low + 0.7 * height), CHARCOAL))
    parts.append(box((0.12, width + 0.08, 0.03), (0.075, middle, hole.low - 0.015), WHITE))
    return run.place(parts)


def slab(x0: float, y0: float, x1: float, y1: float, material: Material, *, top: float) -> Model:
    """Make a floor or ceiling plate, 5 cm thick, its upper side at ``top``."""
    return [box((x1 - x0, y1 - y0, 0.05), ((x0 + x1) / 2, (y0 + y1) / 2, top - 0.025), material)]


def structure(runs: Iterable[WallRun]) -> list[SceneObject]:
    """Build walls, each followed by its windows."""
    objects = []
    for run in runs:
        objects.append(build(run.name, "wall", wall(run)))
        for i, hole in enumerate(o for o in run.openings if o.is_window):
            name = run.name.replace("wall", "window") + f" {i + 1}"
            objects.append(build(name, "window-other", window(run, hole)))
    return objects


Spot = tuple[str, str, Model, float, float, float, float]
"""Name, label, model, x, y, z (metres), yaw (degrees)."""


def place_all(spots: Iterable[Spot]) -> list[SceneObject]:
    """Put models into the world."""
    return [place(name, label, model, x, y, z, yaw_deg=yaw) for name, label, model, x, y, z, yaw in spots]


@dataclass(frozen=True)
class Room:
    """A rectangle between the middle lines of its walls, world frame."""

    name: str
    west: float
    south: float
    east: float
    north: float
    floor: Material
    walls: Material

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        return self.west, self.south, self.east, self.north


@dataclass(frozen=True)
class Hole:
    """A doorway or window by the middle of its foot line; it cuts the wall that runs there."""

    x: float
    y: float
    width: float
    low: float = 0.0
    high: float = DOOR_HEIGHT_M


OUTSIDE = paint("a9a399", Texture.PLASTER)


def furnished(rooms: Sequence[Room], holes: Sequence[Hole], spots: Iterable[Spot]) -> Scene:
    """Build rooms that tile a rectangle, with a plain light in the middle of each, and what stands in them.

    Raises:
        ValueError: a hole lies in no wall.
    """
    west, south = min(room.west for room in rooms), min(room.south for room in rooms)
    east, north = max(room.east for room in rooms), max(room.north for room in rooms)
    objects = [build(f"floor {room.name}", "floor", slab(*room.bounds_m, room.floor, top=0)) for room in rooms]
    above = slab(west, south, east, north, paint("f4f1ea"), top=CEILING_HEIGHT_M + 0.05)
    objects.append(build("ceiling", "ceiling", above))
    lights = tuple(((r.west + r.east) / 2, (r.south + r.north) / 2, 2.5) for r in rooms)
    objects += [*structure(walls_between(rooms, holes)), *place_all(spots)]
    return assemble(objects, rooms_m=tuple(room.bounds_m for room in rooms), lights_m=lights)


def walls_between(rooms: Sequence[Room], holes: Sequence[Hole]) -> list[WallRun]:
    """Return a wall wherever a room borders on another or on the outside; the right side of an outer wall is inner."""
    runs, cut = [], set()
    for upright in (True, False):
        # each line on which rooms end, in pieces on which the same two rooms meet
        for at in sorted({edge for r in rooms for edge in ((r.west, r.east) if upright else (r.south, r.north))}):
            low_side = {_span(r, upright): r for r in rooms if (r.east if upright else r.north) == at}
            high_side = {_span(r, upright): r for r in rooms if (r.west if upright else r.south) == at}
            ends = sorted({end for span in (*low_side, *high_side) for end in span})
            for start, end in pairwise(ends):
                low, high = _covering(low_side, start, end), _covering(high_side, start, end)
                if low is None and high is None:
                    continue
                run, here = _run(low, high, at, start, end, upright, holes)
                runs.append(run)
                cut.update(here)
    if len(cut) < len(holes):
        raise ValueError(f"expected every hole in a wall, found {[h for i, h in enumerate(holes) if i not in cut]}")
    return runs


def _span(room: Room, upright: bool) -> tuple[float, float]:
    return (room.south, room.north) if upright else (room.west, room.east)


def _covering(side: dict[tuple[float, float], Room], start: float, end: float) -> Room | None:
    return next((room for (low, high), room in side.items() if low <= start and end <= high), None)


def _run(
    low: Room | None, high: Room | None, at: float, start: float, end: float, upright: bool, holes: Sequence[Hole]
) -> tuple[WallRun, list[int]]:
    """Make the wall between the room on the lower side (west or south) and the one on the higher side."""
    # Going north, right is east; going east, right is south. An outer wall has its room on the right.
    right, left = (high, low) if upright else (low, high)
    forward = right is not None
    if not forward:
        right, left = left, right
    if right is None:
        raise ValueError("a wall needs a room")
    side = ("west" if upright else "north") if forward else ("east" if upright else "south")
    here = [
        i for i, hole in enumerate(holes)
        if (hole.x if upright else hole.y) == at and start < (hole.y if upright else hole.x) < end
    ]  # fmt: skip
    openings = []
    for hole in (holes[i] for i in here):
        along = (hole.y if upright else hole.x) - start
        middle = along if forward else end - start - along
        openings.append(Opening(middle - hole.width / 2, middle + hole.width / 2, hole.low, hole.high))
    first, last = (start, end) if forward else (end, start)
    ends = ((at, first), (at, last)) if upright else ((first, at), (last, at))
    name = f"wall {right.name} {left.name if left else side}"
    return WallRun(name, *ends, right.walls, left.walls if left else OUTSIDE, tuple(openings)), here
