"""What is sent to the robot as long as nobody lets it drive: the map, its objects and planned paths.

Foxglove's bridge cannot latch what its clients publish, so everything is sent again every so often.
"""

import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from simaps_viz.colors.instances import instance_colors
from simaps_viz.events import BuildFinished, Event, FrameProjected
from simaps_viz.geometry import invert_pose, transform_points
from simaps_viz.live.robot import RobotSource, message_types
from simaps_viz.navigation.agent import planner_of
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Pose2, SIMap

MAP, OBJECTS, PATH = "/si_map", "/si_map/objects", "/si_map/path"
OUT = {
    MAP: "nav_msgs/msg/OccupancyGrid", OBJECTS: "visualization_msgs/msg/MarkerArray", PATH: "nav_msgs/msg/Path",
}  # fmt: skip
"""All that is published without --drive, {topic: type}."""
GOAL, GOAL_TYPE = "/goal_pose", "geometry_msgs/msg/PoseStamped"
EVERY_S = 2.0
"""The map is sent at most so often."""
FREE, OCCUPIED, UNKNOWN = 0, 100, -1
CUBE, TEXT, ADD, DELETE_ALL = 1, 9, 0, 3


class Messages:
    """Makes ROS messages of maps and poses, in the robot's world."""

    def __init__(self, world: str, T_world_map: NDArray) -> None:
        """Take the name of the world, and float64 [4, 4], map frame to world."""
        self.world, self.T_world_map = world, T_world_map
        self._turned = Rotation.from_matrix(T_world_map[:3, :3]).as_quat()
        self._types = message_types()

    def grid(self, simap: SIMap) -> bytes:
        """Return the OccupancyGrid of a map: occupied where the robot would touch something."""
        planner, spec = planner_of(simap, RobotShape()), simap.spec
        cells = np.where(planner.blocked, OCCUPIED, np.where(np.isnan(simap.grid.height_m), UNKNOWN, FREE))
        info = self._make(
            "nav_msgs/msg/MapMetaData", map_load_time=self._now(), resolution=spec.cell_size_m, width=spec.cols,
            height=spec.rows, origin=self._pose(np.array([spec.x0_m, spec.y0_m, 0.0]), 0.0),
        )  # fmt: skip
        return self._cdr(OUT[MAP], header=self._header(), info=info, data=cells.astype(np.int8).ravel())

    def objects(self, simap: SIMap) -> bytes:
        """Return the MarkerArray of a map's instances: a box and a name each; earlier ones are deleted."""
        colors, markers = instance_colors(simap), [self._marker(0, action=DELETE_ALL)]
        for one in simap.instances:
            low, high = (np.array(corner) for corner in one.aabb_m)
            low[2] = 0.0
            size = np.maximum(high - low, simap.spec.cell_size_m)
            r, g, b = (colors[one.id] / 255.0).tolist()
            markers.append(self._marker(2 * one.id, kind=CUBE, at=(low + high) / 2, size=size, color=(r, g, b, 0.5)))
            above = np.array([*one.centroid_m[:2], high[2] + 0.15])
            text = f"{one.label} {one.id}"
            markers.append(self._marker(2 * one.id + 1, kind=TEXT, at=above, size=np.full(3, 0.15), text=text))
        return self._cdr(OUT[OBJECTS], markers=markers)

    def path(self, points_m: NDArray) -> bytes:
        """Return the Path along points, float64 [n, 2], map frame."""
        ahead = np.diff(points_m, axis=0, append=points_m[-1:])
        yaws = np.arctan2(ahead[:, 1], ahead[:, 0])
        poses = [self._stamped(np.array([x, y, 0.0]), yaw) for (x, y), yaw in zip(points_m, yaws, strict=True)]
        return self._cdr(OUT[PATH], header=self._header(), poses=poses)

    def goal(self, pose: Pose2) -> bytes:
        """Return a pose of the map frame as PoseStamped."""
        one = self._stamped(np.array([pose.x_m, pose.y_m, 0.0]), pose.yaw_rad)
        return bytes(self._types.serialize_cdr(one, GOAL_TYPE))

    def _marker(
        self, number: int, *, kind: int = CUBE, action: int = ADD, at: NDArray | None = None,
        size: NDArray | None = None, color: Sequence[float] = (1.0, 1.0, 1.0, 1.0), text: str = "",
    ) -> Any:  # fmt: skip
        vector = self._types.types["geometry_msgs/msg/Vector3"]
        never = self._make("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
        picture = self._make("sensor_msgs/msg/CompressedImage", header=self._header(), format="", data=_no_bytes())
        mesh = self._make("visualization_msgs/msg/MeshFile", filename="", data=_no_bytes())
        return self._make(
            "visualization_msgs/msg/Marker", header=self._header(), ns="si_map", id=number, type=kind, action=action,
            pose=self._pose(np.zeros(3) if at is None else at, 0.0),
            scale=vector(*(np.ones(3) if size is None else size).tolist()),
            color=self._types.types["std_msgs/msg/ColorRGBA"](*color), lifetime=never, frame_locked=False,
            points=[], colors=[], texture_resource="", texture=picture, uv_coordinates=[], text=text,
            mesh_resource="", mesh_file=mesh, mesh_use_embedded_materials=False,
        )  # fmt: skip

    def _pose(self, at_m: NDArray, yaw_rad: float) -> Any:
        """Return a Pose of the world from a place and a yaw of the map frame."""
        (x, y, z, w), s, c = self._turned, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)
        turned = map(float, (x * c + y * s, y * c - x * s, z * c + w * s, w * c - z * s))
        point = self._types.types["geometry_msgs/msg/Point"](*transform_points(self.T_world_map, at_m).tolist())
        return self._make(
            "geometry_msgs/msg/Pose", position=point,
            orientation=self._types.types["geometry_msgs/msg/Quaternion"](*turned),
        )  # fmt: skip

    def _stamped(self, at_m: NDArray, yaw_rad: float) -> Any:
        return self._make(GOAL_TYPE, header=self._header(), pose=self._pose(at_m, float(yaw_rad)))

    def _header(self) -> Any:
        return self._make("std_msgs/msg/Header", stamp=self._now(), frame_id=self.world)

    def _now(self) -> Any:
        sec, nanosec = divmod(time.time_ns(), 10**9)
        return self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._types.types[kind](**fields)

    def _cdr(self, kind: str, **fields: Any) -> bytes:
        return bytes(self._types.serialize_cdr(self._make(kind, **fields), kind))


def messages_for(source: RobotSource, T_map_world: NDArray) -> Messages | None:
    """Return what makes messages in a robot's world; None while that is not known."""
    robot = source.robot()
    return None if robot is None else Messages(robot[0], invert_pose(T_map_world))


class MapPublisher:
    """Observes a live build, and publishes its map and objects now and then; nothing else."""

    wants_color = False

    def __init__(self, source: RobotSource) -> None:
        self._source, self._next_s = source, 0.0
        self._worker = ThreadPoolExecutor(1, "live-publish")
        self._busy: Future[None] | None = None
        for topic, kind in OUT.items():
            source.link.advertise(topic, kind)
            message_types().get_msgdef(kind)  # compiled before frames come, whom it would hold up

    def on_event(self, event: Event) -> None:
        """Publish the map where it is due, while frames go on, and the finished one."""
        if isinstance(event, BuildFinished):
            self._worker.submit(self._publish, event.simap).result()
        elif isinstance(event, FrameProjected) and event.map_so_far is not None:
            free = self._busy is None or self._busy.done()
            if free and (now_s := time.monotonic()) >= self._next_s:
                self._busy = self._worker.submit(self._publish, event.map_so_far())
                self._next_s = now_s + EVERY_S

    def _publish(self, simap: SIMap) -> None:
        make = messages_for(self._source, simap.T_map_world)
        if make is not None:
            self._source.link.publish(MAP, make.grid(simap))
            self._source.link.publish(OBJECTS, make.objects(simap))


def _no_bytes() -> NDArray:
    return np.zeros(0, np.uint8)
