"""A tiny posed-frames/1 folder of known geometry, for every test that needs frames.

A camera looks straight down from 2 m at a floor (z = 0) and two chair seats that hover at 1 m, like plates. World and
map frame are the same. With cells of 0.05 m each floor pixel falls on the centre of a cell and each cell of a seat
holds exactly 2 x 2 seat pixels, so a test can say beforehand what every cell has to be.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.geometry import turned, turned_pose

WIDTH, HEIGHT, FOCAL = 32, 24, 40.0
CX, CY = 15.5, 11.5
CAMERA_HEIGHT_M, SEAT_HEIGHT_M, CELL_M = 2.0, 1.0, 0.05
STEP_M = 0.05
"""The camera stands at x = 0, STEP_M, 2 STEP_M, and from there again at 0."""

SEATS_M = {1: (-0.3, -0.1, -0.1, 0.1), 2: (0.1, -0.1, 0.3, 0.1)}
"""World-wide instance id: (xmin, ymin, xmax, ymax) of the seat; 4 x 4 cells each. All of them are in every frame."""
FLOOR_ID = 3
LABELS = {1: "chair", 2: "chair", FLOOR_ID: "floor"}

COLORS = {1: (200, 30, 30), 2: (30, 200, 30), FLOOR_ID: (90, 90, 90)}
"""RGB by world-wide id."""


def frame_name(index: int) -> str:
    """Name of a frame; names start at 10, so that nobody confuses them with indices."""
    return f"{index + 10:04d}"


def tiny_pose(index: int) -> NDArray:
    """Return T_world_camera [4, 4]: x right is world x, y down is world -y, forward is straight down."""
    T_world_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    T_world_camera[:3, 3] = (STEP_M * (index % 3), 0.0, CAMERA_HEIGHT_M)
    return T_world_camera


def tiny_images(index: int) -> tuple[NDArray, NDArray]:
    """Return depth float32 [H, W] in metres and world-wide ids int32 [H, W] of a frame."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    seat_depth_m = CAMERA_HEIGHT_M - SEAT_HEIGHT_M
    x = STEP_M * (index % 3) + (u - CX) / FOCAL * seat_depth_m
    y = -(v - CY) / FOCAL * seat_depth_m
    depth_m = np.full((HEIGHT, WIDTH), CAMERA_HEIGHT_M, np.float32)
    ids = np.full((HEIGHT, WIDTH), FLOOR_ID, np.int32)
    for instance, (xmin, ymin, xmax, ymax) in SEATS_M.items():
        seat = (x > xmin) & (x < xmax) & (y > ymin) & (y < ymax)
        depth_m[seat] = seat_depth_m
        ids[seat] = instance
    return depth_m, ids


def local_ids(index: int) -> dict[int, int]:
    """Return {world-wide id: id in that frame's segmentation}; the chairs swap theirs in odd frames."""
    return {1: 2, 2: 1, FLOOR_ID: FLOOR_ID} if index % 2 else {1: 1, 2: 2, FLOOR_ID: FLOOR_ID}


def write_tiny_sequence(
    folder: Path,
    *,
    frames: int = 3,
    truth: Literal["segments", "instances"] = "segments",
    manifest: dict[str, Any] | None = None,
) -> Path:
    """Write the folder and give the path of its manifest, ``sequence.json``.

    Args:
        folder: Made when missing.
        frames: How many.
        truth: "segments": ids per frame and a table; "instances": world-wide ids and a scene file.
        manifest: Keys to replace in the manifest; a value of None removes the key.
    """
    for name in ("color", "depth", "ids"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    table: dict[str, list[dict[str, Any]]] = {}
    poses = []
    for index in range(frames):
        name = frame_name(index)
        depth_m, instances = tiny_images(index)
        renamed = local_ids(index) if truth == "segments" else {i: i for i in LABELS}
        ids = np.select([instances == i for i in renamed], list(renamed.values())).astype(np.uint8)
        rgb = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        for instance, color in COLORS.items():
            rgb[instances == instance] = color
        _write_image(folder / "color" / f"{name}.png", rgb[..., ::-1])
        _write_image(folder / "depth" / f"{name}.png", np.round(depth_m * 1000).astype(np.uint16))
        _write_image(folder / "ids" / f"{name}.png", ids)
        table[name] = [
            {"id": renamed[i], "label": LABELS[i], "score": 0.9, "area": int((instances == i).sum())} for i in renamed
        ]
        poses.append(f"{name} " + " ".join(f"{value:.9g}" for value in tiny_pose(index).ravel()))
    (folder / "poses.txt").write_text("\n".join(poses) + "\n")
    (folder / "intrinsics.txt").write_text(f"{FOCAL} 0 {CX}\n0 {FOCAL} {CY}\n0 0 1\n")
    (folder / "segments.json").write_text(json.dumps(table))
    scene = [{"id": i, "label": label, "isthing": label != "floor"} for i, label in LABELS.items()]
    (folder / "scene.json").write_text(json.dumps({"instances": scene}))
    return write_manifest(folder, truth=truth, changes=manifest or {})


def write_manifest(folder: Path, *, truth: Literal["segments", "instances"], changes: dict[str, Any]) -> Path:
    """Write only the manifest of the tiny folder, with some of its keys replaced (None removes a key)."""
    tables = {"segments": "segments.json", "instances": "scene.json"}
    keys: dict[str, Any] = {
        "name": "tiny",
        "format": "posed-frames/1",
        "color": "color/{frame}.png",
        "depth": "depth/{frame}.png",
        "depth_unit_m": 0.001,
        "intrinsics": "intrinsics.txt",
        "poses": "poses.txt",
        "pose": "T_world_camera",
        "camera_axes": "x right, y down, z forward",
        "up": [0, 0, 1],
        "floor_height_m": 0.0,
        "segmentation": {
            "ids": "ids/{frame}.png",
            truth: tables[truth],
            "source": "drawn by the test",
            "ground_truth": truth == "instances",
        },
    }
    keys.update(changes)
    path = folder / "sequence.json"
    path.write_text(json.dumps({key: value for key, value in keys.items() if value is not None}, indent=1))
    return path


def _write_image(path: Path, image: NDArray) -> None:
    if not cv2.imwrite(str(path), image):
        raise OSError(path)


def lying(sequence: PosedFrames, turns: int) -> PosedFrames:
    """Return a sequence as a camera held with quarter turns would have stored it, without its masks."""
    recording = sequence.recording
    changed = replace(
        recording,
        poses=np.stack([turned_pose(pose, turns) for pose in recording.poses]),
        intrinsics=recording.intrinsics.turned(turns),
        depth=lambda index: turned(recording.depth(index), turns),
        color=lambda index: turned(recording.color(index), turns),
        color_file=lambda _: None,
        segments=None,
    )
    return PosedFrames(changed)
