"""A building from plain data: walls with doorways and windows become walls and panes.

World: metres, z up, floor at z = 0, x east, y north. Yaw is counter-clockwise from +x and turns the front of a model
(+x) to where it looks.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from simaps_viz.scenes.materials import CHARCOAL, WHITE, Material, Texture, paint
from simaps_viz.scenes.scene import SceneObject, build
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
