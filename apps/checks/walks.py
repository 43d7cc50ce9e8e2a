"""Simulated recordings of a camera in the hand, as a Kinect and motion capture would have made them, kept in memory."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from simaps_viz.checking.recording import Recording
from simaps_viz.scenes.places import place_of
from simaps_viz.scenes.render import TO_SUN, DepthSensor, Renderer, Surfaces, sense
from simaps_viz.structures import Intrinsics

FULL_WALK = 2400
"""Frames that the walk through all rooms takes at 30 a second in the hand."""
CAMERA = Intrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
"""A Kinect's, at half its resolution."""
DISPARITY_PX, BASELINE_FOCAL = 0.125, 0.075 * 575.0
"""Steps of a Kinect's disparity, pixels, and its baseline (m) times its focal length (pixels)."""
FRAME_S = 1 / 30


@dataclass(frozen=True)
class Hand:
    """How a recording was made."""

    name: str
    frames: int = 600
    start: int = 0
    """Frame of the full walk to begin at."""
    back: bool = False
    """Walk to and fro between the start and a third of the frames on, so that places are seen again."""
    every: int = 1
    """Take every so-manieth frame of the full walk."""
    late_s: float = 0.0
    """Poses are those of so much after the depth image."""
    sway_m: float = 0.012
    sway_deg: float = 2.5
    """How the hand moves on top of the walk, standard deviations; a wave of about a second."""
    capture_m: float = 0.0
    capture_deg: float = 0.0
    """Noise of the poses, standard deviations."""
    kinect: bool = False
    """Depth in steps of disparity, bent by a percent or so, and colour taken up to half a frame away and blurred."""
    person: bool = False
    """Someone walks through the picture."""
    seed: int = 0


CAPTURED = Hand(
    "motion capture", frames=420, back=True, sway_m=0.04, sway_deg=5.0, capture_m=0.001, capture_deg=0.1, kinect=True
)
HANDS = (
    Hand("long walk in the hand", frames=900, every=2, seed=1),
    replace(CAPTURED, start=150, seed=2),
    replace(CAPTURED, name="motion capture, 10 ms off", start=900, late_s=0.010, seed=3),
    replace(CAPTURED, name="motion capture, 20 ms off", start=1500, late_s=-0.020, seed=4),
    replace(CAPTURED, name="motion capture, a person", start=2000, person=True, seed=5),
)


def recorded(hand: Hand, cache: Path) -> Recording:
    """Return a simulated recording; its pictures are rendered on first use and kept in ``cache``."""
    path = cache / f"{hand.name.replace(' ', '-').replace(',', '')}.npz"
    if not path.is_file():
        cache.mkdir(parents=True, exist_ok=True)
        depth, color, poses = _render(hand)
        np.savez(path, depth=depth, color=color, poses=poses)
    with np.load(path) as kept:
        depth, color, poses = kept["depth"], kept["color"], kept["poses"]
    size = (CAMERA.width, CAMERA.height)
    return Recording(
        path=path, name=hand.name, names=tuple(f"{1000 + i * hand.every * FRAME_S:.6f}" for i in range(len(poses))),
        matrices=poses, camera=np.array([CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]), color_size=size,
        depth_size=size, unit_m=0.001, depth_steps=lambda i: depth[i], color=lambda i: color[i], up=(0.0, 0.0, 1.0),
        floor_height_m=0.0,
    )  # fmt: skip


def _render(hand: Hand) -> tuple[NDArray, NDArray, NDArray]:
    """Return depth uint16 [n, H, W], mm; colour uint8 [n, H, W, 3]; and poses as recorded, float64 [n, 4, 4]."""
    rng = np.random.default_rng(hand.seed)
    renderer, track = Renderer(place_of("cafe").scene(), CAMERA), _Track(hand, rng)
    bend = cv2.resize(rng.normal(0, 0.006, (4, 5)), (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_CUBIC)
    depths, colors, poses = [], [], []
    for frame in range(hand.frames):
        now = frame * FRAME_S * hand.every
        pose = track.at(now)
        cast = renderer.cast(pose)
        exact, color = cast.depth_m, _shaded(cast, renderer)
        if hand.kinect:
            moved = renderer.cast(track.at(now + rng.uniform(-0.5, 0.5) * FRAME_S))
            color = _blurred(_shaded(moved, renderer), track, now)
            exact = exact * (1 + bend * exact / 3).astype(np.float32)
        if hand.person:
            exact, color = _with_person(exact, color, pose, track, now)
        depth, _ = sense(exact, cast.incidence, cast.instance, DepthSensor(far_m=5.0), rng)
        depths.append(_quantised(depth) if hand.kinect else depth)
        colors.append(color)
        poses.append(_captured(track.at(now + hand.late_s), hand, rng))
    return np.stack(depths), np.stack(colors), np.stack(poses)


def _shaded(cast: Surfaces, renderer: Renderer) -> NDArray:
    """Return each surface in its colour, lit from one side; uint8 [H, W, 3], RGB. It has the edges that matter."""
    light = 0.55 + 0.45 * np.abs(cast.normals @ TO_SUN)
    return np.clip(255 * renderer.scene.color[cast.face] * light[..., None], 0, 255).astype(np.uint8)


class _Track:
    """Where the camera is at any time."""

    def __init__(self, hand: Hand, rng: np.random.Generator) -> None:
        self.hand, self.walk = hand, place_of("cafe").walk(FULL_WALK).T_world_camera
        self.phase, self.pace = rng.uniform(0, 2 * np.pi, (6, 3)), rng.uniform(0.3, 1.6, (6, 3))

    def at(self, time_s: float) -> NDArray:
        """Return T_world_camera [4, 4]."""
        at = time_s / FRAME_S
        if self.hand.back:
            third = self.hand.frames * self.hand.every / 3
            at = third * (1 - np.cos(np.pi * at / third)) / 2
        at = float(np.clip(at + self.hand.start, 0, len(self.walk) - 1))
        first = min(int(at), len(self.walk) - 2)
        a, b = self.walk[first], self.walk[first + 1]
        turn = Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).as_rotvec() * (at - first)
        sway = np.sin(2 * np.pi * self.pace * time_s + self.phase).sum(axis=1) / np.sqrt(1.5)
        pose = np.eye(4)
        wobble = Rotation.from_rotvec(np.deg2rad(self.hand.sway_deg) * sway[3:]).as_matrix()
        pose[:3, :3] = a[:3, :3] @ Rotation.from_rotvec(turn).as_matrix() @ wobble
        pose[:3, 3] = a[:3, 3] + (at - first) * (b[:3, 3] - a[:3, 3]) + self.hand.sway_m * sway[:3]
        return pose


def _captured(pose: NDArray, hand: Hand, rng: np.random.Generator) -> NDArray:
    noisy = pose.copy()
    noisy[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(rng.normal(0, np.deg2rad(hand.capture_deg), 3)).as_matrix()
    noisy[:3, 3] += rng.normal(0, hand.capture_m, 3)
    return noisy


def _quantised(depth: NDArray) -> NDArray:
    """Round depth, uint16 mm, to steps of disparity."""
    disparity = BASELINE_FOCAL / np.maximum(depth, 1) * 1000
    disparity = np.maximum(np.round(disparity / DISPARITY_PX), 1) * DISPARITY_PX
    return np.where(depth > 0, np.minimum(np.round(1000 * BASELINE_FOCAL / disparity), 65535), 0).astype(np.uint16)


def _blurred(color: NDArray, track: _Track, now: float) -> NDArray:
    """Blur a picture along the way it moves within half a frame's exposure."""
    a, b = track.at(now), track.at(now + FRAME_S / 2)
    turn = Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).as_rotvec()
    along = CAMERA.fx * np.array([turn[1], -turn[0]])
    length = round(float(np.linalg.norm(along)))
    if length < 2:
        return color
    kernel = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
    reach = along / np.linalg.norm(along) * length / 2
    start, end = (tuple(round(v) for v in length + side * reach) for side in (-1, 1))
    cv2.line(kernel, start, end, 1.0)
    return cv2.filter2D(color, -1, kernel / kernel.sum())


def _with_person(depth: NDArray, color: NDArray, pose: NDArray, track: _Track, now: float) -> tuple[NDArray, NDArray]:
    """Put an upright cylinder, 0.25 m in radius and 1.75 m high, in the picture, walking to and fro across it."""
    forward = track.at(0.0)[:3, 2] * [1, 1, 0]
    side = np.array([-forward[1], forward[0], 0.0])
    centre = pose[:3, 3] * [1, 1, 0] + 1.8 * forward + 1.2 * np.sin(0.9 * now) * side
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], -1) @ pose[:3, :3].T
    to_eye = (pose[:3, 3] - centre)[:2]
    a, b = (rays[..., :2] ** 2).sum(-1), (rays[..., :2] * to_eye).sum(-1)
    root = b**2 - a * (to_eye @ to_eye - 0.25**2)
    z = (-b - np.sqrt(np.maximum(root, 0))) / a
    height = pose[2, 3] + z * rays[..., 2]
    seen = (root > 0) & (z > 0.3) & (height > 0) & (height < 1.75) & ((depth == 0) | (z < depth))
    shade = np.array([90, 70, 60]) * (0.6 + 0.4 * np.sin(9 * height))[..., None]
    return np.where(seen, z, depth).astype(np.float32), np.where(seen[..., None], shade, color).astype(np.uint8)
