"""Drives through the café, of which things can be moved between two of them: exact masks, depth as a sensor has it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from simaps_viz.live.source import Shot, Source
from simaps_viz.scenes.places import PLACES
from simaps_viz.scenes.render import DepthSensor, Renderer, sense
from simaps_viz.scenes.scene import SceneObject, assemble
from simaps_viz.scenes.walk import sample_walk
from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation

WIDTH, HEIGHT, FOCAL = 160, 120, 110.0
STATIONS = (
    (6.3, 3.5, 4.5, 4.9), (3.2, 3.2, 1.6, 4.4), (3.0, 3.3, 1.6, 1.7), (3.2, 2.9, 4.9, 1.5), (6.2, 2.9, 4.9, 1.5),
    (6.2, 3.4, 4.5, 4.9), (4.2, 3.4, 1.6, 4.3), (3.1, 3.4, 4.4, 4.9), (0.5, 3.0, 1.6, 4.4), (0.6, 3.0, 1.6, 1.7),
    (3.0, 2.6, 3.0, 5.0), (3.2, 6.3, 1.8, 4.3), (3.2, 6.3, 4.4, 4.9),
)  # fmt: skip
"""x, y of the camera, and of what it looks at there: all round the café's tables."""

Move = tuple[float, float]
"""By so many metres along x and y."""


def moved(one: SceneObject, by_m: Move) -> SceneObject:
    """Return an object elsewhere."""
    parts = []
    for part in one.parts:
        mesh = part.mesh.copy()
        mesh.apply_translation((*by_m, 0.0))
        parts.append(replace(part, mesh=mesh))
    return replace(one, parts=tuple(parts))


def cafe_chair(name: str) -> SceneObject:
    """Return an object of the café by its name."""
    return next(one for one in PLACES["cafe"].scene().objects if one.name == name)


@cache
def drive(frames: int, *, moves: tuple[tuple[str, Move], ...] = (), without: tuple[str, ...] = ()) -> tuple[Shot, ...]:
    """Render a drive.

    Args:
        frames: how many.
        moves: (name of an object, by how much it was moved).
        without: names of objects that are not there.
    """
    elsewhere = dict(moves)
    near = [
        one for one in PLACES["cafe"].scene().objects if not one.is_thing or (one.bounds_m[0, :2] < (7.0, 6.0)).all()
    ]
    objects = [moved(one, elsewhere[one.name]) if one.name in elsewhere else one for one in near]
    scene = assemble([one for one in objects if one.name not in without])
    k = Intrinsics(WIDTH, HEIGHT, FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    renderer, poses = Renderer(scene, k), sample_walk(STATIONS, frames).T_world_camera
    labels = [one.label for one in scene.objects]
    things = [one.is_thing for one in scene.objects]
    shots = []
    for i, pose in enumerate(poses):
        seen = renderer.cast(pose)
        rng = np.random.default_rng(i)
        depth, ids = sense(seen.depth_m, seen.incidence, seen.instance, DepthSensor(), rng)
        depth_m = (depth / 1000.0).astype(np.float32)
        segments = tuple(Segment(n, labels[n - 1], 1.0, things[n - 1]) for n in np.unique(ids).tolist() if n)
        frame = Frame(i, f"{i:04d}", depth_m, pose, k)
        shots.append(Shot(frame, Segmentation(ids.astype(np.int32), segments), i * 10**8))
    return tuple(shots)


class Drives(Source):
    """A source that plays drives one after the other."""

    name, segmentation_source, simulated = "café", "renderer", True

    def __init__(
        self, *drives: Sequence[Shot], T_map_world: NDArray | None = None,
        placed: Callable[[NDArray], NDArray] = lambda T: T,
    ) -> None:  # fmt: skip
        """Take the drives; ``placed`` turns each pose of a camera into what the robot takes for it."""
        self.T_map_world = np.eye(4) if T_map_world is None else T_map_world
        self._shots = [shot for one in drives for shot in one]
        self._placed, self._next = placed, 0

    def take(self, timeout_s: float) -> Shot | None:
        """Return the next shot."""
        if self._next == len(self._shots):
            self.ended = True
            return None
        shot, self._next = self._shots[self._next], self._next + 1
        name = f"{self._next:05d}"
        pose = self._placed(shot.frame.T_world_camera)
        return replace(shot, frame=replace(shot.frame, name=name, T_world_camera=pose), stamp_ns=self._next * 10**8)
