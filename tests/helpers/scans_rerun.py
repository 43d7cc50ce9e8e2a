"""A writer of rerun recordings: the camera moves below a fixed entity; depth and colour are entities of their own."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from scans import COLORS, FRAMES, Y_UP, Sample, camera, look, map_pose, steps, write_reference

from simaps_viz.geometry import invert_pose
from simaps_viz.structures import Intrinsics

T_WORLD_RIG = np.array([[0, 0, 1, 2.0], [1, 0, 0, 0.0], [0, 1, 0, -1.0], [0, 0, 0, 1.0]])


def rerun_rrd(folder: Path, depth_image: Callable[[np.ndarray], Any] | None = None) -> Sample:
    k = camera()
    large = Intrinsics(128, 96, k.fx * 2, k.fy * 2, k.cx * 2 + 0.5, k.cy * 2 + 0.5)
    path = folder / "seats.rrd"
    stream = rr.RecordingStream("seats", send_properties=False)
    stream.save(path)
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    stream.log("/rig", rr.Transform3D(translation=T_WORLD_RIG[:3, 3], mat3x3=T_WORLD_RIG[:3, :3]), static=True)
    for name, c in (("depth", k), ("color", large)):
        stream.log(
            f"/rig/camera/{name}",
            rr.Pinhole(image_from_camera=c.matrix(), width=c.width, height=c.height, camera_xyz=rr.ViewCoordinates.RDF),
            static=True,
        )
    for i in range(FRAMES):
        stream.set_time("frame", sequence=10 * i)
        T = invert_pose(T_WORLD_RIG) @ Y_UP.pose(i)
        stream.log("/rig/camera", rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))
        stream.log("/rig/camera/color", rr.Image(COLORS[look(large, map_pose(i))[1]]))
        stream.set_time("frame", sequence=10 * i + 1)  # depth comes a little later
        depth = steps(look(k, map_pose(i))[0])
        stream.log("/rig/camera/depth", depth_image(depth) if depth_image else rr.DepthImage(depth, meter=1000.0))
        stream.flush()  # a chunk of its own
    stream.disconnect()

    def pose(index: float) -> np.ndarray:
        T = (invert_pose(T_WORLD_RIG) @ Y_UP.pose(index)).astype(np.float32).astype(np.float64)
        return T_WORLD_RIG @ T

    reference = write_reference(folder / "reference", k, Y_UP, pose=pose)
    return Sample(path, reference, exact_color=False)
