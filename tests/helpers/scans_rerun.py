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


def rerun_rrd(
    folder: Path,
    depth_image: Callable[[np.ndarray], Any] | None = None,
    *,
    axes: Any = rr.ViewCoordinates.RDF,
    T_axes: np.ndarray | None = None,
    named: bool = False,
    uptime: bool = False,
) -> Sample:
    """Write a recording, and the frames that are in it.

    Args:
        folder: where to.
        depth_image: makes what is logged of depth in millimetres.
        axes: of the cameras.
        T_axes: OpenCV's axes in these.
        named: frames have names, as rerun's importer of MCAP writes them.
        uptime: the rig is said over a timeline that is not the first by name.
    """
    k = camera()
    large = Intrinsics(128, 96, k.fx * 2, k.fy * 2, k.cx * 2 + 0.5, k.cy * 2 + 0.5)
    path = folder / "seats.rrd"
    stream = rr.RecordingStream("seats", send_properties=False)
    stream.save(path)
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    timelines = ("frame", "uptime") if uptime else ("frame",)

    def moved(entity: str, T: np.ndarray, parent: str, child: str, **keywords: bool) -> None:
        frames: dict[str, Any] = {"parent_frame": parent, "child_frame": child} if named else {}
        transform = rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3], **frames)
        stream.log(f"/tf/{child}" if named else entity, transform, **keywords)

    if uptime:
        stream.set_time("uptime", sequence=0)
    moved("/rig", T_WORLD_RIG, "map", "rig", static=not uptime)
    planes: dict[str, Any] = {"parent_frame": "camera", "child_frame": "camera_image_plane"} if named else {}
    entities = {name: f"/{name}/image" if named else f"/rig/camera/{name}" for name in ("depth", "color")}
    for name, c in (("depth", k), ("color", large)):
        stream.log(
            f"/{name}/camera_info" if named else entities[name],
            rr.Pinhole(image_from_camera=c.matrix(), width=c.width, height=c.height, camera_xyz=axes, **planes),
            static=True,
        )
        if named:
            stream.log(entities[name], rr.CoordinateFrame("camera_image_plane"), static=True)
    for i in range(FRAMES):
        for timeline in timelines:
            stream.set_time(timeline, sequence=10 * i)
        T = invert_pose(T_WORLD_RIG) @ Y_UP.pose(i)
        moved("/rig/camera", T if T_axes is None else T @ invert_pose(T_axes), "rig", "camera")
        stream.log(entities["color"], rr.Image(COLORS[look(large, map_pose(i))[1]]))
        for timeline in timelines:
            stream.set_time(timeline, sequence=10 * i + 1)  # depth comes a little later
        depth = steps(look(k, map_pose(i))[0])
        stream.log(entities["depth"], depth_image(depth) if depth_image else rr.DepthImage(depth, meter=1000.0))
        stream.flush()  # a chunk of its own
    stream.disconnect()

    def pose(index: float) -> np.ndarray:
        T = (invert_pose(T_WORLD_RIG) @ Y_UP.pose(index)).astype(np.float32).astype(np.float64)
        return T_WORLD_RIG @ T

    reference = write_reference(folder / "reference", k, Y_UP, pose=pose)
    return Sample(path, reference, exact_color=False)
