"""Sequences for tests of the check: a drawn room everywhere, and spoiled copies of any sequence."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
FOCAL, WIDTH, HEIGHT = 120.0, 160, 120
BOXES_M = np.array(
    [
        [[-4.0, -3.0, 0.0], [4.0, 3.0, 2.6]],
        [[-2.2, -1.0, 0.0], [-1.2, 0.4, 0.75]],
        [[1.1, 0.9, 0.0], [1.9, 1.5, 1.8]],
        [[0.2, -2.4, 0.0], [1.0, -1.5, 0.45]],
        [[-3.6, 1.8, 0.0], [-2.6, 2.8, 1.1]],
        [[2.7, -1.6, 0.0], [3.6, -0.9, 0.9]],
    ]
)
"""A room (seen from inside) and furniture (from outside): lowest and highest corner."""


@dataclass(frozen=True, eq=False)
class Spoiling:
    """What to do to a copy of a sequence."""

    poses: Callable[[list[str], NDArray], tuple[list[str], NDArray]] | None = None
    camera: Callable[[NDArray], NDArray] | None = None
    """Takes and gives the 3x3 matrix."""
    keys: dict[str, Any] | None = None
    """Keys of the manifest to change."""
    depth: Callable[[NDArray], NDArray] | None = None
    """Takes and gives the stored steps."""


def drawn_room(folder: Path, frames: int = 36, poses: list[NDArray] | None = None) -> Path:
    """Ray-cast a walk (or the poses given) through a furnished room and write it as a sequence; returns its folder."""
    for name in ("color", "depth"):
        (folder / name).mkdir(parents=True)
    lines = []
    for index, pose in enumerate(_walk(frames) if poses is None else poses):
        depth_m, shade = _cast(pose)
        name = f"{index:03d}"
        cv2.imwrite(str(folder / "depth" / f"{name}.png"), np.round(depth_m * 1000).astype(np.uint16))
        cv2.imwrite(str(folder / "color" / f"{name}.png"), np.repeat(shade[..., None], 3, axis=2))
        lines.append(f"{name} " + " ".join(f"{x:.9g}" for x in pose.ravel()))
    (folder / "poses.txt").write_text("\n".join(lines) + "\n")
    (folder / "intrinsics.txt").write_text(f"{FOCAL} 0 {WIDTH / 2 - 0.5}\n0 {FOCAL} {HEIGHT / 2 - 0.5}\n0 0 1\n")
    manifest = {
        "name": "drawn room", "format": "posed-frames/1", "color": "color/{frame}.png", "depth": "depth/{frame}.png",
        "depth_unit_m": 0.001, "intrinsics": "intrinsics.txt", "poses": "poses.txt", "up": [0, 0, 1],
        "floor_height_m": 0.0,
    }  # fmt: skip
    (folder / "sequence.json").write_text(json.dumps(manifest))
    return folder


def spoiled_copy(source: Path, folder: Path, spoiling: Spoiling, *, every: int = 1) -> Path:
    """Write a manifest, poses and camera that refer to the source's images, spoiled; returns the folder."""
    folder.mkdir(parents=True)
    keys = json.loads((source / "sequence.json").read_text())
    keys.pop("segmentation", None)
    names, poses = read_poses(source / keys["poses"])
    names, poses = names[::every], poses[::every]
    camera = np.loadtxt(source / keys["intrinsics"])
    if spoiling.depth is not None:
        (folder / "depth").mkdir()
        for name in names:
            steps = cv2.imread(str(source / keys["depth"].replace("{frame}", name)), cv2.IMREAD_UNCHANGED)
            assert steps is not None
            cv2.imwrite(str(folder / "depth" / f"{name}.png"), spoiling.depth(steps))
    if spoiling.poses is not None:
        names, poses = spoiling.poses(names, poses)
    keys["depth"] = "depth/{frame}.png" if spoiling.depth else os.path.relpath(source / keys["depth"], folder)
    keys["color"] = os.path.relpath(source / keys["color"], folder)
    keys |= {"poses": "poses.txt", "intrinsics": "intrinsics.txt", **(spoiling.keys or {})}
    np.savetxt(folder / "intrinsics.txt", camera if spoiling.camera is None else spoiling.camera(camera))
    lines = [f"{n} " + " ".join(f"{x:.9g}" for x in p.ravel()) for n, p in zip(names, poses, strict=True)]
    (folder / "poses.txt").write_text("\n".join(lines) + "\n")
    (folder / "sequence.json").write_text(json.dumps({k: v for k, v in keys.items() if v is not None}))
    return folder


def thinned(source: Path, folder: Path, every: int) -> Path:
    """Write a sequence of every so many frames of a folder's, its files by reference; returns its folder."""
    where = folder / source.name
    where.mkdir(parents=True)
    for beside in (*source.iterdir(), *source.parent.glob("*.json")):
        if beside.name != "poses.txt":
            (where / os.path.relpath(beside, source)).symlink_to(beside)
    lines = (source / "poses.txt").read_text().splitlines(keepends=True)
    (where / "poses.txt").write_text("".join(lines[::every]))
    return where


def read_poses(path: Path) -> tuple[list[str], NDArray]:
    """Return names and matrices [n, 4, 4] of a pose file."""
    rows = [line.split() for line in path.read_text().splitlines()]
    return [row[0] for row in rows], np.array([[float(x) for x in row[1:]] for row in rows]).reshape(-1, 4, 4)


def turn(matrix: Any) -> NDArray:
    """Return the 4x4 transform of a 3x3 matrix."""
    out = np.eye(4)
    out[:3, :3] = matrix
    return out


def standing(eye: Any, yaw: float, pitch: float) -> NDArray:
    """Return the pose [4, 4] of a camera held upright; radians, positive pitch looks down."""
    forward = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    pose = turn(np.stack([right, np.cross(forward, right), forward], axis=1))
    pose[:3, 3] = eye
    return pose


def tilted(up: Any, degrees: float) -> list[float]:
    """Tilt a direction, unit length, towards a fixed other one."""
    unit = np.array(up, float)
    side = np.cross(unit, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side)
    return list(unit * np.cos(np.deg2rad(degrees)) + side * np.sin(np.deg2rad(degrees)))


def _walk(frames: int, later: float = 0.0) -> list[NDArray]:
    """Return poses of a camera that wanders and looks about, up and down too; never at constant speed.

    ``later`` is how much later than each frame its pose is taken, in frames.
    """
    poses = []
    for t in np.linspace(0, 1, frames) + later / (frames - 1):
        yaw = 2 * np.pi * (1.2 * t + 0.05 * np.sin(9 * t))
        pitch = np.deg2rad(18 + 14 * np.sin(11 * t))
        eye = np.array([0.9 * np.cos(5 * t), 0.7 * np.sin(7 * t), 1.45 + 0.12 * np.sin(13 * t)])
        poses.append(standing(eye, yaw, pitch))
    return poses


def _cast(pose: NDArray) -> tuple[NDArray, NDArray]:
    """Return depth along the optical axis, metres [H, W], and a grey shade by surface, uint8 [H, W]."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack([(u - WIDTH / 2 + 0.5) / FOCAL, (v - HEIGHT / 2 + 0.5) / FOCAL, np.ones(u.shape)], axis=-1)
    rays = rays @ pose[:3, :3].T
    rays = np.where(np.abs(rays) < 1e-9, 1e-9, rays)
    eye = pose[:3, 3]
    depth, shade = np.zeros(u.shape), np.zeros(u.shape)
    for number, (low, high) in enumerate(BOXES_M):
        near, far = (
            np.minimum((low - eye) / rays, (high - eye) / rays),
            np.maximum((low - eye) / rays, (high - eye) / rays),
        )
        enter, leave = near.max(axis=-1), far.min(axis=-1)
        hit = np.full(u.shape, True) if number == 0 else (enter < leave) & (enter > 0) & (enter < depth)
        depth = np.where(hit, leave if number == 0 else enter, depth)
        side = far.argmin(axis=-1) if number == 0 else near.argmax(axis=-1)
        shade = np.where(hit, 35 * number + 20 * side + 15, shade)
    return depth, shade.astype(np.uint8)
