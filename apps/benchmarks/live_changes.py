"""What is reported when a live map goes on with an earlier one, and one chair was moved in between; all simulated."""

import tempfile
import threading
from collections import Counter
from pathlib import Path

import numpy as np
from benchmarks.two_drives import Drives, cafe_chair, drive
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.live.run import LiveRequest, LiveRun
from simaps_viz.mapping.changes import Change, changes_in
from simaps_viz.structures import SIMap

FRAMES = 120
CHAIR, BY_M = "west chair 1", (1.7, -1.1)
NEAR_M = 0.25
"""The chair is where it is reported, give or take so much."""
ELSEWHERE = np.array([[-0.8, -0.6, 0, 9.0], [0.6, -0.8, 0, 4.0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
"""Where the robot's world lies when it is started the next day."""


class Unsteady:
    """Poses that are off, each by another amount, along and about an axis of its own."""

    def __init__(self, off_m: float, off_deg: float, seed: int) -> None:
        """Take standard deviations."""
        self._off_m, self._off_rad, self._random = off_m, np.deg2rad(off_deg), np.random.default_rng(seed)

    def __call__(self, T_world_camera: NDArray) -> NDArray:
        """Return a pose that is taken for this one."""
        axes = self._random.normal(size=(2, 3))
        along, about = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        found = T_world_camera.copy()
        found[:3, 3] += along * self._random.normal(0.0, self._off_m)
        turn = Rotation.from_rotvec(about * self._random.normal(0.0, self._off_rad))
        found[:3, :3] = turn.as_matrix() @ found[:3, :3]
        return found


def drives(off_m: float, off_deg: float, seed: int) -> tuple[bool, Counter[str]]:
    """Return whether a chair's move is reported between two drives, and the kinds of all else that is."""
    here = cafe_chair(CHAIR).bounds_m.mean(axis=0)[:2]
    earlier = _map_of(Drives(drive(FRAMES), placed=Unsteady(off_m, off_deg, seed)), None)
    after = drive(FRAMES, moves=((CHAIR, BY_M),))
    source = Drives(after, T_map_world=ELSEWHERE, placed=Unsteady(off_m, off_deg, seed + 1000))
    found = changes_in(_map_of(source, earlier))
    right = [one for one in found if _is(one, here, here + BY_M)]
    return len(right) == 1, Counter(f"{one.kind} {one.label}" for one in found if one not in right)


def _is(one: Change, from_m: NDArray, at_m: NDArray) -> bool:
    if one.kind != "moved" or one.label != "chair" or one.at_m is None or one.from_m is None:
        return False
    return bool(np.linalg.norm(one.at_m - at_m) < NEAR_M and np.linalg.norm(one.from_m - from_m) < NEAR_M)


def _map_of(source: Drives, earlier: SIMap | None) -> SIMap:
    with tempfile.TemporaryDirectory() as folder:
        request = LiveRequest(source, BuildConfig(), Path(folder) / "m.npz", earlier=earlier)
        return LiveRun(request).run((), threading.Event())
