"""Small recordings of one scene in every format that is read, and the same frames as posed-frames/1 to compare with.

A camera looks from 1.6 m obliquely at a floor and two chair seats half a metre up. Depth is rounded to millimetres
before anything is written, so that every format can hold it; where one cannot, the frames to compare with have its
unit. Each writer puts the world, the camera axes, the units and the file names as that format has them.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.geometry import invert_pose, map_from_world
from simaps_viz.structures import Intrinsics

SEAT_HEIGHT_M, CAMERA_HEIGHT_M = 0.5, 1.6
SEATS_M = {1: (-0.7, -0.25, -0.2, 0.25), 2: (0.2, -0.25, 0.7, 0.25)}
"""World-wide id: (xmin, ymin, xmax, ymax), map frame."""
FLOOR_ID = 3
LABELS = {1: "chair", 2: "chair", FLOOR_ID: "floor"}
COLORS = np.array([(0, 0, 0), (220, 30, 30), (30, 220, 30), (120, 120, 250)], np.uint8)
"""RGB by id; 0 is nothing."""
FAR_M = 6.0
GL = np.diag([1.0, -1.0, -1.0, 1.0])
FRAMES = 4
INTERVAL_S = 0.1
START_S = 100.0


def camera(width: int = 64, height: int = 48, focal: float = 58.0) -> Intrinsics:
    """Return a camera whose principal point is not in the middle."""
    return Intrinsics(width, height, focal, focal * 1.02, width * 0.51, height * 0.48)


def map_pose(index: float) -> NDArray:
    """Return T_map_camera [4, 4]: two metres south of the seats, looking north and down, turning a little."""
    yaw, pitch = 0.05 * index - 0.1, 0.6
    forward = np.array([np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), -np.sin(pitch)])
    right = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = (0.11 * index - 0.15, -2.0, CAMERA_HEIGHT_M)
    return T


def look(k: Intrinsics, T_map_camera: NDArray) -> tuple[NDArray, NDArray]:
    """Return depth float64 [H, W] in metres, 0 = nothing near, and world-wide ids int32 [H, W]; not to be changed."""
    return _look(k, T_map_camera.tobytes())


@lru_cache(64)
def _look(k: Intrinsics, pose: bytes) -> tuple[NDArray, NDArray]:
    T_map_camera = np.frombuffer(pose).reshape(4, 4)
    v, u = np.mgrid[: k.height, : k.width]
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1) @ T_map_camera[:3, :3].T
    with np.errstate(divide="ignore"):
        depth_m = np.where(rays[..., 2] < 0, T_map_camera[2, 3] / -rays[..., 2], np.inf)
        seat_m = np.where(rays[..., 2] < 0, (T_map_camera[2, 3] - SEAT_HEIGHT_M) / -rays[..., 2], np.inf)
    ids = np.where(depth_m < FAR_M, FLOOR_ID, 0).astype(np.int32)
    depth_m = np.where(depth_m < FAR_M, depth_m, 0.0)
    at = T_map_camera[:3, 3] + rays * np.where(np.isfinite(seat_m), seat_m, 0.0)[..., None]
    for number, (xmin, ymin, xmax, ymax) in SEATS_M.items():
        seat = (
            np.isfinite(seat_m) & (at[..., 0] > xmin) & (at[..., 0] < xmax) & (at[..., 1] > ymin) & (at[..., 1] < ymax)
        )
        ids[seat], depth_m[seat] = number, seat_m[seat]
    depth_m.flags.writeable = ids.flags.writeable = False
    return depth_m, ids


def steps(depth_m: NDArray, unit_m: float = 0.001) -> NDArray:
    """Return depth as uint16 steps."""
    return np.rint(depth_m / unit_m).astype(np.uint16)


@dataclass(frozen=True, eq=False)
class World:
    """Where a format has its world."""

    up: tuple[float, float, float]
    floor_height_m: float = 0.3
    told: bool = True
    """The format says which way is up."""

    def pose(self, index: float) -> NDArray:
        """Return T_world_camera [4, 4] with OpenCV axes."""
        return invert_pose(map_from_world(self.up, self.floor_height_m)) @ map_pose(index)


@dataclass(frozen=True, eq=False)
class Sample:
    """A recording, and the same frames as posed-frames/1."""

    path: Path
    reference: Path
    exact_color: bool = True
    """Colour is seen through the depth camera already, so its every pixel is known."""
    lossless: bool = True


Z_UP, Y_UP = World((0.0, 0.0, 1.0)), World((0.0, 1.0, 0.0))
LEANING = World((0.3, -0.9, 0.2), told=False)


def write_reference(
    folder: Path,
    k: Intrinsics,
    world: World,
    *,
    unit_m: float = 0.001,
    indices: tuple[float, ...] = tuple(range(FRAMES)),
    pose: Callable[[float], NDArray] | None = None,
) -> Path:
    """Write the frames as posed-frames/1; ``up`` is in the manifest if the format tells it, the floor never is."""
    for name in ("color", "depth", "ids"):
        (folder / name).mkdir(parents=True)
    lines = []
    for i, index in enumerate(indices):
        depth_m, ids = look(k, map_pose(index))
        write_image(folder / f"color/{i}.png", COLORS[ids])
        cv2.imwrite(str(folder / f"depth/{i}.png"), steps(depth_m, unit_m))
        cv2.imwrite(str(folder / f"ids/{i}.png"), ids.astype(np.uint8))
        lines.append(f"{i} {row((pose or world.pose)(index))}")
    (folder / "poses.txt").write_text("\n".join(lines))
    (folder / "intrinsics.txt").write_text(f"{k.fx!r} 0 {k.cx!r}\n0 {k.fy!r} {k.cy!r}\n0 0 1\n")
    scene = [{"id": i, "label": label, "isthing": label != "floor"} for i, label in LABELS.items()]
    (folder / "scene.json").write_text(json.dumps({"instances": scene}))
    keys = {
        "name": "reference", "format": "posed-frames/1", "color": "color/{frame}.png", "depth": "depth/{frame}.png",
        "depth_unit_m": unit_m, "intrinsics": "intrinsics.txt", "poses": "poses.txt",
        "segmentation": {"ids": "ids/{frame}.png", "instances": "scene.json"},
    }  # fmt: skip
    (folder / "sequence.json").write_text(json.dumps(keys | ({"up": world.up} if world.told else {})))
    return folder


def row(matrix: NDArray) -> str:
    """Write numbers in one line, with all their digits."""
    return " ".join(repr(float(x)) for x in np.ravel(matrix))


def rows(matrix: NDArray) -> str:
    """Write a matrix line by line, with all its digits."""
    return "\n".join(map(row, matrix)) + "\n"


def write_image(path: Path, rgb: NDArray) -> None:
    """Write an RGB image; a JPEG as good as it gets."""
    path.parent.mkdir(parents=True, exist_ok=True)
    best = [cv2.IMWRITE_JPEG_QUALITY, 100, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    options = best if path.suffix == ".jpg" else []
    if not cv2.imwrite(str(path), rgb[..., ::-1], options):
        raise OSError(path)


def write_depth(path: Path, image: NDArray) -> None:
    """Write a 16-bit image."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), image):
        raise OSError(path)


def quaternion(T: NDArray) -> list[float]:
    """Return x, y, z, w of a pose's rotation, by Shepperd's method."""
    R = T[:3, :3]
    squares = np.array([1 + R[0, 0] - R[1, 1] - R[2, 2], 1 - R[0, 0] + R[1, 1] - R[2, 2],
                        1 - R[0, 0] - R[1, 1] + R[2, 2], 1 + np.trace(R)])  # fmt: skip
    i = int(squares.argmax())
    q = np.array(
        [
            [squares[0], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
            [R[0, 1] + R[1, 0], squares[1], R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], squares[2], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], squares[3]],
        ]
    )[i]
    return [float(x) for x in q / np.linalg.norm(q)]
