"""Is up where the manifest says, and the floor at its height? Is depth registered to colour?

Up and the floor are compared with what the surfaces themselves say; jumps of depth have to lie where the colour picture
has edges.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import Views
from simaps_viz.checking.recording import Recording
from simaps_viz.datasets.gravity import estimate_gravity
from simaps_viz.errors import InputError
from simaps_viz.geometry import back_project
from simaps_viz.structures import Frame, Intrinsics

FRAMES = 64
FEWEST = 8
"""Frames with edges; in fewer, chance decides."""
WIDTH = 256
"""Both images are brought to about this width, pixels."""
REACH = 0.08
"""Offsets up to this share of the width are tried."""
NARROW_PX, BROAD_PX, PEAK_PX = 0.8, 4.0, 4
"""Widths (standard deviations) between which a peak lies, and what belongs to it all around, pixels of `WIDTH`."""
JUMP = 0.1
"""Share of the depth that makes an edge."""


@dataclass(frozen=True)
class Offset:
    """Where depth edges fit colour edges best."""

    right: float
    """Share of the image's width by which depth has to move to the right."""
    down: float
    """Share of the image's width by which it has to move down."""
    gain: float
    """Mean colour edge strength under depth edges there, over that without moving."""
    sure: float
    """How many times as high as the second highest peak the highest one is."""


def find_offset(recording: Recording, views: Views) -> Offset | None:
    """Compare edges in a few frames; None when they differ in shape or too few frames have edges."""
    if not np.isclose(recording.depth_size[0] / recording.depth_size[1],
                      recording.color_size[0] / recording.color_size[1], rtol=0.02):  # fmt: skip
        return None
    chosen = np.unique(np.linspace(0, len(views.frames) - 1, FRAMES).astype(int))
    table, used = None, 0
    for view in chosen:
        depth = views.steps[view].astype(np.float32)
        height = round(WIDTH * depth.shape[0] / depth.shape[1])
        size = (WIDTH, height)
        edges = _depth_edges(cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST))
        gradient = _color_edges(
            cv2.resize(recording.color(int(views.frames[view])), size, interpolation=cv2.INTER_AREA)
        )
        if edges.sum() < 50:
            continue
        scores, used = _correlate(edges, gradient), used + 1
        table = scores if table is None else table + scores
    if table is None or used < FEWEST or not table.any():
        return None
    strength = cv2.GaussianBlur(table, (0, 0), NARROW_PX)
    # Edges that are the same give a narrow peak; that some parts of the picture have more edges gives broad ones.
    table = strength - cv2.GaussianBlur(table, (0, 0), BROAD_PX)
    reach = table.shape[0] // 2
    row, column = (int(at) for at in np.unravel_index(int(table.argmax()), table.shape))
    rest = table.copy()
    rest[max(row - PEAK_PX, 0) : row + PEAK_PX + 1, max(column - PEAK_PX, 0) : column + PEAK_PX + 1] = 0
    return Offset(
        right=(column - reach) / WIDTH,
        down=(row - reach) / WIDTH,
        gain=float(strength[row, column] / max(float(strength[reach, reach]), 1e-9)),
        sure=float(table[row, column] / max(float(rest.max()), 1e-9)),
    )


def _depth_edges(depth: NDArray) -> NDArray:
    """Mark the nearer side of depth jumps between measured pixels, a few missing ones apart; float32 [h, w]."""
    filled = cv2.dilate(depth, np.ones((3, 3), np.uint8))
    near = np.where(depth > 0, depth, 1e9).astype(np.float32)
    lowest = cv2.erode(near, np.ones((3, 3), np.uint8))
    jump = (depth > 0) & (filled > lowest * (1 + JUMP)) & (depth < lowest * (1 + JUMP / 2))
    return jump.astype(np.float32)


def _color_edges(rgb: NDArray) -> NDArray:
    """Return gradient strength, evened out over the picture, 0-1; float32 [h, w]."""
    gray = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (0, 0), 1.0).astype(np.float32)
    strength = np.hypot(cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1))
    return np.minimum(strength / (np.percentile(strength, 95) + 1e-6), 1.0).astype(np.float32)


def _correlate(edges: NDArray, gradient: NDArray) -> NDArray:
    """Mean gradient under the edges moved by every offset, rows down and columns right, float32 [2r+1, 2r+1]."""
    reach = int(REACH * WIDTH)
    inner = edges[reach:-reach, reach:-reach]
    return cv2.matchTemplate(gradient, inner, cv2.TM_CCORR) / max(float(inner.sum()), 1.0)


TILT_DEG = 3.0
"""Up that is off by more is a fault."""
FLOOR_M = 0.08
"""A floor that is off by more is a fault."""
FLOOR_TILT_DEG = 20.0
"""With up further off there is no sense in looking for the floor along it."""
LEVEL_DEG = 2.5
"""Surfaces within this angle of level count as level; less than ``TILT_DEG``, or a tilt would not show."""
ACROSS = 20
"""Normals are taken between points this share (one in so many) of the image's width apart, so that noise is small."""
STEP = 6
"""Normals are taken at every so-manieth pixel."""
HELD = 0.3
"""How much less the cameras may be held along the found up than along the stated one (cosines); see `_held`."""
MORE_LEVEL = 1.3
"""How much more surface has to be level with the found up than with the stated one before that is called wrong."""


@dataclass(frozen=True, eq=False)
class Level:
    """Up and floor as found."""

    up: NDArray
    """float64 [3], unit, world frame."""
    floor_height_m: float
    """Height of the floor along ``up``."""
    tilt_deg: float | None
    """Between the found up and the stated one; None when none is stated."""
    level_stated: float | None
    """Share of surfaces that are level if the stated up is right (0-1)."""
    level_found: float
    held: bool
    """People could hold cameras so with the found up; else it is a wall or a ceiling, and the floor was not seen."""
    floor_error_m: float | None
    """Found height minus the stated one along the stated up; None when none is stated."""

    @property
    def tilted(self) -> bool:
        """The stated up is wrong: far off, and fewer surfaces are level with it."""
        if self.tilt_deg is None or self.level_stated is None:
            return False
        if not self.held:
            return False
        slopes = self.tilt_deg > TILT_DEG or (self.tilt_deg > TILT_DEG / 3 and self._floor_far)
        return slopes and self.level_found > MORE_LEVEL * self.level_stated + 0.005

    @property
    def floor_wrong(self) -> bool:
        """The stated floor height is wrong, with up right."""
        return self.held and not self.tilted and self._floor_far

    def to_json(self) -> dict:
        """Return up and the floor's height as found."""
        return {"up": [round(float(x), 5) for x in self.up], "floor_height_m": round(self.floor_height_m, 4)}

    @property
    def _floor_far(self) -> bool:
        return self.floor_error_m is not None and abs(self.floor_error_m) > FLOOR_M


def find_level(
    views: Views, poses: NDArray, camera: NDArray, unit_m: float, *, up: NDArray | None, floor_height_m: float | None
) -> Level | None:
    """Find up and the floor in the views' depth.

    Args:
        views: Depth images.
        poses: float64 [n, 4, 4], T_world_camera of all frames; NaN = none.
        camera: float64 [4], fx, fy, cx, cy of the whole image, pixels.
        unit_m: Metres a step of depth.
        up: [3] as stated, or None.
        floor_height_m: As stated, or None.

    Returns:
        None when there are not enough surfaces to tell.
    """
    fx, fy, cx, cy = views.camera(camera)
    height, width = views.steps.shape[1:]
    intrinsics = Intrinsics(width, height, fx, fy, cx, cy)
    frames = [
        Frame(int(index), str(index), (steps * np.float32(unit_m)).astype(np.float32), poses[index], intrinsics)
        for index, steps in zip(views.frames, views.steps, strict=True)
        if np.isfinite(poses[index]).all()
    ]
    stated = None if up is None else np.asarray(up, float) / np.linalg.norm(up)
    axes = np.stack([frame.T_world_camera[:3, :3] for frame in frames]).mean(axis=0) if frames else np.eye(3)
    try:
        found, floor_m = estimate_gravity(frames)
    except InputError:
        return None
    normals = _normals(frames)
    tilt = None if stated is None else float(np.rad2deg(np.arccos(np.clip(found @ stated, -1, 1))))
    floor_error_m = None
    if stated is not None and floor_height_m is not None and tilt is not None and tilt < FLOOR_TILT_DEG:
        floor_error_m = _floor_along(frames, stated, floor_height_m)
    return Level(
        up=found,
        floor_height_m=floor_m,
        tilt_deg=tilt,
        level_stated=None if stated is None else _level_share(normals, stated),
        level_found=_level_share(normals, found),
        held=stated is None or _held(axes, found) > _held(axes, stated) - HELD,
        floor_error_m=floor_error_m,
    )


def _held(axes: NDArray, up: NDArray) -> float:
    """Describe how well cameras are held for an up: its cosine with their mean upper, or left or right, side.

    Args:
        axes: float64 [3, 3], mean of the cameras' rotations; columns are x right, y down, z forward.
        up: [3], unit.
    """
    return float(max(-axes[:, 1] @ up, abs(axes[:, 0] @ up)))


def _floor_along(frames: list[Frame], up: NDArray, floor_height_m: float) -> float | None:
    try:
        return estimate_gravity(frames, up=up)[1] - floor_height_m
    except InputError:
        return None


def _normals(frames: list[Frame]) -> NDArray:
    """Return unit normals towards the camera, world frame, float64 [n, 3], of surfaces that are smooth around."""
    found = []
    for frame in frames:
        k = frame.intrinsics
        points = back_project(frame.depth_m, k.fx, k.fy, k.cx, k.cy)
        away = max(1, k.width // ACROSS)
        corner, right, below = points[:-away, :-away], points[:-away, away:], points[away:, :-away]
        corner, right, below = (each[::STEP, ::STEP] for each in (corner, right, below))
        z = corner[..., 2]
        smooth = (z > 0) & (np.abs(right[..., 2] - z) < 0.15 * z) & (np.abs(below[..., 2] - z) < 0.15 * z)
        normal = np.cross((below - corner)[smooth], (right - corner)[smooth])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
        found.append(normal @ frame.T_world_camera[:3, :3].T)
    return np.concatenate(found)


def _level_share(normals: NDArray, up: NDArray) -> float:
    """Return the share of normals that point up."""
    return float((normals @ up > np.cos(np.deg2rad(LEVEL_DEG))).mean())
