"""A simulated house of two storeys with straight stairs, and a camera that walks through it. Nothing of it is real."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.scenes import demo, furniture
from simaps_viz.scenes.building import slab
from simaps_viz.scenes.materials import OAK, WALNUT, WHITE, paint
from simaps_viz.scenes.places import Place
from simaps_viz.scenes.render import Renderer
from simaps_viz.scenes.scene import Scene, assemble, build, place
from simaps_viz.scenes.shapes import box
from simaps_viz.scenes.walk import Walk, camera_pose
from simaps_viz.structures import Frame, Segmentation

STOREY_M = 3.0
"""From one floor's upper side to the other's."""
WIDE_M, DEEP_M = 8.0, 6.0
FOOT_M, HEAD_M = (2.0, 1.0), (6.0, 1.0)
"""Where the stairs begin and end, x and y; they climb east, along the south wall."""
CHAIRS_BELOW, CHAIRS_ABOVE = ((1.5, 4.5), (3.0, 4.5)), ((4.0, 4.8),)
TABLE, BED = (5.8, 4.0), (1.8, 4.2)
CAMERA_M = 1.5


@cache
def house() -> Scene:
    """Return the scene: floors and walls of both storeys, 16 steps, furniture."""
    top, fabric = STOREY_M, paint("6d4a63")
    x0, y0, x1, y1 = FOOT_M[0], 0.4, HEAD_M[0], 1.6  # of the stairs, and of the hole above them
    above = [
        *slab(0, 0, x0, DEEP_M, OAK, top=top), *slab(x1, 0, WIDE_M, DEEP_M, OAK, top=top),
        *slab(x0, 0, x1, y0, OAK, top=top), *slab(x0, y1, x1, DEEP_M, OAK, top=top),
    ]  # fmt: skip
    high = 2 * top
    walls = [
        box((0.1, DEEP_M, high), (-0.05, DEEP_M / 2, high / 2), WHITE),
        box((0.1, DEEP_M, high), (WIDE_M + 0.05, DEEP_M / 2, high / 2), WHITE),
        box((WIDE_M, 0.1, high), (WIDE_M / 2, -0.05, high / 2), WHITE),
        box((WIDE_M, 0.1, high), (WIDE_M / 2, DEEP_M + 0.05, high / 2), WHITE),
    ]
    run = (x1 - x0) / 16
    steps = [
        box((run, y1 - y0, (i + 1) * top / 16), (x0 + (i + 0.5) * run, 1.0, (i + 1) * top / 32), WALNUT)
        for i in range(16)
    ]
    objects = [
        build("floor below", "floor", slab(0, 0, WIDE_M, DEEP_M, OAK, top=0.0)),
        build("floor above", "floor", above),
        build("ceiling", "ceiling", slab(0, 0, WIDE_M, DEEP_M, WHITE, top=high)),
        build("walls", "wall", walls),
        build("stairs", "stairs", steps),
        *(place(f"chair {x}", "chair", furniture.cafe_chair(WALNUT, OAK), x, y) for x, y in CHAIRS_BELOW),
        place("table", "dining table", furniture.long_table(0.9, 1.6, OAK), *TABLE),
        *(place(f"chair above {x}", "chair", furniture.cafe_chair(WALNUT, OAK), x, y, top) for x, y in CHAIRS_ABOVE),
        place("bed", "bed", furniture.bed(1.6, 2.0, WALNUT, fabric), *BED, top),
    ]  # fmt: skip
    return assemble(objects, lights_m=((4.0, 3.0, 2.5), (4.0, 3.0, 5.5)))


def _leg(start, end, count) -> list[NDArray]:
    """Return poses from one point to another, (x, y, z, yaw in degrees), that many."""
    return [np.array(start) + (np.array(end) - start) * t for t in np.linspace(0.0, 1.0, count, endpoint=False)]


def _round(x: float, y: float, z: float, frames: int) -> list[NDArray]:
    return [np.array([x, y, z, a]) for a in np.linspace(0.0, 360.0, frames, endpoint=False)]


def poses(*, back: bool = False, sway_m: float = 0.0) -> NDArray:
    """Return T_world_camera [n, 4, 4] of a walk below, up the stairs, above; ``back``: and down again.

    Args:
        back: walk down the stairs and below once more.
        sway_m: the camera's height goes up and down by so much.
    """
    low, high = CAMERA_M, STOREY_M + CAMERA_M
    below = [*_round(4.0, 3.0, low, 16), *_round(2.2, 3.2, low, 12), *_round(6.6, 2.4, low, 12)]
    stairs = [
        *_leg((1.0, 2.4, low, -60.0), (1.0, 1.0, low, 0.0), 5), *_leg((1.0, 1.0, low, 0.0), (*FOOT_M, low, 0.0), 4),
        *_leg((*FOOT_M, low, 0.0), (*HEAD_M, high, 0.0), 20), *_leg((*HEAD_M, high, 0.0), (7.0, 1.0, high, 0.0), 4),
    ]  # fmt: skip
    above = [*_round(7.0, 2.2, high, 12), *_round(4.0, 3.0, high, 16), *_round(1.0, 2.4, high, 12)]
    way = [*below, *stairs, *above]
    if back:
        turn = np.array([0.0, 0.0, 0.0, 180.0])
        way += [*(one + turn for one in stairs[::-1]), *_round(3.4, 3.4, low, 12)]
    swayed = [one[2] + sway_m * np.sin(0.9 * i) for i, one in enumerate(way)]
    return np.stack([
        camera_pose(np.array([x, y, z]), np.deg2rad(yaw), np.deg2rad(28.0))
        for (x, y, _, yaw), z in zip(way, swayed, strict=True)
    ])  # fmt: skip


class Cast:
    """The frames of a camera in a scene, without noise, each cast when it is read: a `FrameSource`."""

    name, path, simulated, segmentation_source = "cast", Path("cast"), True, "renderer"

    def __init__(self, scene: Scene, cameras: NDArray) -> None:
        self._renderer = Renderer(scene, demo.DemoSettings(width=96, height=72).intrinsics())
        self.poses, self.T_map_world = cameras, np.eye(4)
        self.frame_names = tuple(f"{i:06d}" for i in range(len(cameras)))
        kinds = {one.label: one.is_thing for one in scene.objects}
        self.labels, self.is_thing = ("none", *sorted(kinds)), (False, *(kinds[label] for label in sorted(kinds)))

    def __len__(self) -> int:
        return len(self.poses)

    def described(self) -> bytes:
        return b""

    def read(self, index: int, *, color: bool = False) -> Frame:
        seen = self._renderer.cast(self.poses[index])
        return Frame(index, self.frame_names[index], seen.depth_m, self.poses[index], self._renderer.intrinsics)

    def segmentation(self, index: int) -> Segmentation:
        raise AssertionError("floors are found without masks")


def write_two_storeys(folder: Path, **walk) -> Path:
    """Render the house into a folder, small, and return its manifest, whose masks are exact.

    Args:
        folder: new.
        walk: of `poses`.
    """
    cameras = poses(**walk)

    class Walked(Place):
        def walk(self, frames: int) -> Walk:
            return Walk(cameras)

    settings = demo.DemoSettings(frames=len(cameras), width=160, height=120)
    demo._render(folder, Walked("house", "A house of two storeys", house, list), settings, lambda *_: None)
    return folder / "sequence.json"


def turned_sequence(path: Path, T_new_world: NDArray) -> PosedFrames:
    """Return the sequence in another world frame, which does not say which way is up."""
    recording = open_sequence(path).recording
    facts = replace(recording.facts, up=None)
    return PosedFrames(replace(recording, facts=facts, floor_height_m=None, poses=T_new_world @ recording.poses))
