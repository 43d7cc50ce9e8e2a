"""Log one frame of the camera: pose, colour, depth, segments and points."""

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from simaps_viz.colors.classes import class_color, instance_color
from simaps_viz.events import FrameProjected
from simaps_viz.geometry import transform_points
from simaps_viz.recorder.map_pictures import Entry, annotations
from simaps_viz.recorder.settings import RecorderSettings
from simaps_viz.structures import Intrinsics, Segmentation

NEAR_M, FAR_M = 0.1, 6.0
BELOW_FLOOR_M = 0.3
DEPTH_UNITS_PER_M = 1000.0
IMAGE_PLANE_M = 0.5
"""How far in front of the camera its picture hangs in the 3-D view."""
FRUSTUM_COLOR = (22, 110, 235)


class CameraLog:
    """Logs one frame after another to ``/world/camera`` and ``/world/points``."""

    def __init__(self, stream: rr.RecordingStream, settings: RecorderSettings) -> None:
        self._stream, self._settings = stream, settings
        self._pinholes: dict[str, tuple[Intrinsics, int]] = {}

    def log(self, event: FrameProjected) -> None:
        """Log the parts of a frame that the settings select; the timeline is set already."""
        frame, keep = event.frame, self._settings
        T = event.T_map_camera
        self._stream.log("/world/camera", rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))
        if frame.color is not None and frame.index % keep.color_every == 0:
            self._pinhole("color", frame.intrinsics, keep.color_divide)
            jpeg = encode_jpeg(frame.color, keep.color_divide, keep.jpeg_quality)
            self._stream.log("/world/camera/color", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))
        if frame.index % keep.depth_every == 0:
            self._pinhole("depth", frame.intrinsics, keep.depth_divide)
            self._stream.log(
                "/world/camera/depth",
                rr.DepthImage(
                    depth_picture(frame.depth_m, keep.depth_divide),
                    meter=DEPTH_UNITS_PER_M,
                    colormap="turbo",
                    depth_range=(0.0, FAR_M * DEPTH_UNITS_PER_M),
                ),
            )
        self._pinhole("segmentation", frame.intrinsics, keep.segmentation_divide)
        self._stream.log(
            "/world/camera/segmentation",
            rr.SegmentationImage(segment_picture(event.segmentation, keep.segmentation_divide), opacity=1.0),
            annotations(segment_entries(event.segmentation)),
        )
        points, colors = cloud(event, most=keep.points, cut_height_m=keep.cut_height_m)
        self._stream.log("/world/points", rr.Points3D(points, colors=colors, radii=0.02))

    def _pinhole(self, name: str, intrinsics: Intrinsics, divide: int) -> None:
        """Describe how a picture was taken, from now on; each has a size, so a camera model, of its own."""
        if self._pinholes.get(name) == (intrinsics, divide):
            return
        self._pinholes[name] = (intrinsics, divide)
        matrix = intrinsics.matrix()
        matrix[:2] /= divide
        pinhole = rr.Pinhole(
            image_from_camera=matrix,
            width=-(-intrinsics.width // divide),
            height=-(-intrinsics.height // divide),
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=IMAGE_PLANE_M,
            color=FRUSTUM_COLOR,
        )
        self._stream.log(f"/world/camera/{name}", pinhole)


def encode_jpeg(color: NDArray, divide: int, quality: int) -> bytes:
    """Shrink and compress a picture, uint8 [H, W, 3] RGB."""
    if divide > 1:
        size = (-(-color.shape[1] // divide), -(-color.shape[0] // divide))
        color = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", color[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def depth_picture(depth_m: NDArray, divide: int) -> NDArray:
    """Thin a depth image out, uint16 [H / divide, W / divide], millimetres, 0 = invalid."""
    kept = np.nan_to_num(depth_m[::divide, ::divide], posinf=0.0, neginf=0.0)
    return np.rint(np.clip(kept * DEPTH_UNITS_PER_M, 0, 65535)).astype(np.uint16)


def segment_picture(segmentation: Segmentation, divide: int) -> NDArray:
    """Thin the segment ids out, uint8 or uint16 [H / divide, W / divide]."""
    kept = segmentation.ids[::divide, ::divide]
    return np.ascontiguousarray(kept.astype(np.uint8 if kept.max(initial=0) < 256 else np.uint16))


def segment_entries(segmentation: Segmentation) -> list[Entry]:
    """Name the segments of one frame; things get the colour of their id, so that neighbours differ, stuff its own."""
    entries: list[Entry] = [(0, "nothing", (30, 32, 36, 255))]
    for segment in segmentation.segments:
        color = instance_color(segment.id) if segment.is_thing else class_color(segment.label)
        entries.append((segment.id, f"{segment.label} {segment.score:.2f}", (*color, 255)))
    return entries


def cloud(event: FrameProjected, *, most: int, cut_height_m: float) -> tuple[NDArray, NDArray]:
    """Back-project an even sample of a frame's pixels, those that can be on the map.

    Args:
        event: the frame.
        most: greatest number of points.
        cut_height_m: points above are dropped.

    Returns:
        float32 [n, 3], map frame, metres, and uint8 [n, 3], RGB: the picture's colours, or those of the classes when
        the picture was not decoded.
    """
    points, v, u = sampled(event, most=most, cut_height_m=cut_height_m)
    return points, _colors(event, v, u)


def sampled(event: FrameProjected, *, most: int, cut_height_m: float) -> tuple[NDArray, NDArray, NDArray]:
    """Return the points of `cloud`, float32 [n, 3], and the row and column of the pixel of each, int [n]."""
    frame, k = event.frame, event.frame.intrinsics
    if most == 0:
        return np.zeros((0, 3), np.float32), np.zeros(0, int), np.zeros(0, int)
    step = max(1, int(np.ceil(np.sqrt(frame.depth_m.size / most))))
    v, u = (axis.reshape(-1) for axis in np.mgrid[step // 2 : k.height : step, step // 2 : k.width : step])
    z = frame.depth_m[v, u].astype(np.float64)
    valid = (z >= NEAR_M) & (z <= FAR_M)
    v, u, z = v[valid], u[valid], z[valid]
    in_camera = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], axis=-1)
    points = transform_points(event.T_map_camera, in_camera)
    kept = np.flatnonzero((points[:, 2] <= cut_height_m) & (points[:, 2] >= -BELOW_FLOOR_M))[:most]
    return points[kept].astype(np.float32), v[kept], u[kept]


def _colors(event: FrameProjected, v: NDArray, u: NDArray) -> NDArray:
    if event.frame.color is not None:
        return event.frame.color[v, u]
    colors = np.zeros((len(v), 3), np.uint8)
    ids = event.segmentation.ids[v, u]
    for segment in event.segmentation.segments:
        colors[ids == segment.id] = class_color(segment.label)
    return colors
