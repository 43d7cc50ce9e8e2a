"""True worlds made by hand, and a room of plates seen from the ceiling, for the tests of the navigation evaluation."""

import json
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.evaluation.truth import Truth
from simaps_viz.evaluation.world import TrueObject, World
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import GridSpec, SIMap


def world_of(simap: SIMap, robot: RobotShape | None = None) -> World:
    """Take a map made by hand for the truth; every cell of it is four fine cells."""
    robot = robot or RobotShape()
    spec = simap.spec
    names = {i.id: i.label for i in simap.instances}
    truth = Truth(simap.grid, simap.instance, names, simap.T_map_world, "drawn by the test")
    fine = GridSpec(spec.rows * 2, spec.cols * 2, spec.cell_size_m / 2.0, spec.x0_m, spec.y0_m)
    blocked = np.nan_to_num(simap.grid.lowest_m, nan=np.inf) <= robot.height_m
    return World(
        name="toy",
        tops=truth,
        objects=tuple(TrueObject(i, names[i], cells_of(simap, i)) for i in sorted(names)),
        fine=fine,
        occupied=np.kron(blocked, np.ones((2, 2))).astype(bool),
        seen=np.kron(~np.isnan(simap.grid.height_m), np.ones((2, 2))).astype(bool),
        robot=robot,
    )


def cells_of(simap: SIMap, instance_id: int) -> NDArray:
    cells = np.argwhere(simap.instance == instance_id).tolist()
    return np.array([simap.spec.centre_of(row, col) for row, col in cells])


ROOM_M = 8.0, 6.0
PLATE_HEIGHT_M = 0.8
PLATES = {
    1: ("chair", 1.0, 1.0, 0.5, 0.5),
    2: ("chair", 3.5, 1.2, 0.5, 0.5),
    3: ("chair", 6.8, 1.0, 0.5, 0.5),
    4: ("chair", 4.2, 4.6, 0.5, 0.5),
    5: ("dining table", 1.5, 4.0, 1.2, 0.8),
    6: ("dining table", 5.0, 2.4, 0.9, 0.9),
    7: ("couch", 6.5, 4.8, 1.0, 0.6),
    8: ("potted plant", 3.2, 2.8, 0.4, 0.4),
}
"""World-wide id: (class, xmin, ymin, width, depth); plates that hover 0.8 m over the floor."""
FLOOR_ID = 20
_WIDTH, _HEIGHT, _FOCAL, _CAMERA_M = 640, 480, 300.0, 5.5


def write_room(folder: Path) -> Path:
    """Write three frames of the room, seen straight from above, with exact ids; returns the manifest."""
    for name in ("color", "depth", "ids"):
        (folder / name).mkdir(parents=True)
    poses = []
    for index, (x, y) in enumerate([(3.0, 3.0), (5.0, 3.0), (4.0, 3.0)]):
        T_world_camera = np.diag([1.0, -1.0, -1.0, 1.0])
        T_world_camera[:3, 3] = (x, y, _CAMERA_M)
        depth_m, ids = _picture(x, y)
        for kind, image in (("depth", np.round(depth_m * 1000).astype(np.uint16)), ("ids", ids)):
            assert cv2.imwrite(str(folder / kind / f"{index}.png"), image)
        assert cv2.imwrite(str(folder / "color" / f"{index}.png"), np.zeros((_HEIGHT, _WIDTH, 3), np.uint8))
        poses.append(f"{index} " + " ".join(f"{v:.9g}" for v in T_world_camera.ravel()))
    (folder / "poses.txt").write_text("\n".join(poses) + "\n")
    centre = (_WIDTH - 1) / 2, (_HEIGHT - 1) / 2
    (folder / "intrinsics.txt").write_text(f"{_FOCAL} 0 {centre[0]}\n0 {_FOCAL} {centre[1]}\n0 0 1\n")
    rows = [
        {"id": i, "label": label, "isthing": True, "aabb_min": [x, y, 0.0], "aabb_max": [x + w, y + d, PLATE_HEIGHT_M]}
        for i, (label, x, y, w, d) in PLATES.items()
    ]
    rows.append({"id": FLOOR_ID, "label": "floor", "isthing": False, "aabb_min": [0, 0, 0], "aabb_max": [*ROOM_M, 0]})
    (folder / "scene.json").write_text(json.dumps({"instances": rows}))
    manifest = {
        "name": "room of plates",
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
            "instances": "scene.json",
            "source": "drawn by the test",
            "ground_truth": True,
        },
    }
    (folder / "sequence.json").write_text(json.dumps(manifest))
    return folder / "sequence.json"


def _picture(camera_x: float, camera_y: float) -> tuple[NDArray, NDArray]:
    v, u = np.mgrid[:_HEIGHT, :_WIDTH]
    across, down = (u - (_WIDTH - 1) / 2) / _FOCAL, (v - (_HEIGHT - 1) / 2) / _FOCAL

    def seen_at(height_m: float) -> tuple[NDArray, NDArray, float]:
        reach = _CAMERA_M - height_m
        return camera_x + across * reach, camera_y - down * reach, reach

    x, y, reach = seen_at(0.0)
    inside = (x > 0) & (x < ROOM_M[0]) & (y > 0) & (y < ROOM_M[1])
    depth_m = np.where(inside, reach, 0.0)
    ids = np.where(inside, FLOOR_ID, 0).astype(np.uint8)
    x, y, reach = seen_at(PLATE_HEIGHT_M)
    for number, (_, low_x, low_y, width, length) in PLATES.items():
        plate = (x > low_x) & (x < low_x + width) & (y > low_y) & (y < low_y + length)
        depth_m[plate] = reach
        ids[plate] = number
    return depth_m, ids
