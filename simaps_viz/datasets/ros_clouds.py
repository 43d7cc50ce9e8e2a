"""Reads the clouds of a LiDAR in a robot's recording as depth images of the camera that looks the same way."""

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets import ros_messages as ros
from simaps_viz.datasets.association import associate
from simaps_viz.datasets.clouds import CloudSettings, camera_points, depth_of_cloud, gravity_of_clouds
from simaps_viz.datasets.lens import see_through
from simaps_viz.datasets.recording import Recording, whole
from simaps_viz.datasets.rosbag import FACTS, Bag, lens_of, poses_of, time_name
from simaps_viz.errors import InputError
from simaps_viz.geometry import invert_pose

CLOUD_TOLERANCE_S = 0.05
"""A cloud takes the picture nearest to it, within this: half a turn of a LiDAR that turns ten times a second."""
_SAMPLED_FOR_FLOOR = 40


def open_clouds(bag: Bag) -> Recording:
    """Open a bag that has clouds and colour, and poses for both.

    Raises:
        InputError: It lacks colour, a camera or poses that belong together, or has no floor.
    """
    clouds, color = _topics(bag)
    lens = lens_of(bag, color)
    target = lens.intrinsics
    index = bag.index((clouds, color))
    cloud_times, color_times = (np.array([e.stamp_ns for e in index[t]]) for t in (clouds, color))
    start = int(cloud_times[0])
    pairs = associate((cloud_times - start) / 1e9, (color_times - start) / 1e9, tolerance_s=CLOUD_TOLERANCE_S)
    frames = [bag.first(topic).header.frame_id for topic in (color, clouds)]
    (T_world_camera, seen), (T_world_cloud, met) = poses_of(
        bag, [(frames[0], color_times[pairs[:, 1]]), (frames[1], cloud_times[pairs[:, 0]])]
    )
    known = seen & met
    if not known.any():
        raise InputError(
            f"{bag.path}: expected clouds, colour and poses of about the same time, found none among "
            f"{len(cloud_times)} clouds ({clouds}) and {len(color_times)} colour images ({color})"
        )
    pairs, T_world_camera, T_world_cloud = pairs[known], T_world_camera[known], T_world_cloud[known]

    def points(i: int) -> NDArray:
        with whole(bag.path, FACTS.title):
            stored = ros.points(f"{bag.path}: {clouds}", bag.read(clouds, index[clouds][pairs[i, 0]]))
        return camera_points(stored, invert_pose(T_world_camera[i]) @ T_world_cloud[i])

    def picture(i: int) -> NDArray:
        with whole(bag.path, FACTS.title):
            image = ros.color(f"{bag.path}: {color}", bag.read(color, index[color][pairs[i, 1]]))
        return see_through(image, lens.scaled(image.shape[1], image.shape[0]), target, exact=False)

    picked = sorted({int(i) for i in np.linspace(0, len(pairs) - 1, min(len(pairs), _SAMPLED_FOR_FLOOR))})
    _, floor_height_m = gravity_of_clouds(bag.path, [(points(i), T_world_camera[i]) for i in picked], target, FACTS.up)
    left = len(cloud_times) - len(pairs)
    return Recording(
        facts=FACTS,
        path=bag.path,
        name=bag.path.resolve().stem,
        frame_names=tuple(time_name(int(cloud_times[i])) for i in pairs[:, 0]),
        poses=T_world_camera,
        intrinsics=target,
        depth=lambda i: depth_of_cloud(points(i), target, CloudSettings()),
        color=picture,
        floor_height_m=floor_height_m,
        notes=(f"{left} of {len(cloud_times)} clouds have no colour or pose of their time: left out",) if left else (),
    )


def _topics(bag: Bag) -> tuple[str, str]:
    """Choose the clouds with the most messages, and colour images."""
    clouds = max(bag.of_type(ros.CLOUD), key=lambda topic: (bag.topics[topic].msgcount, topic))
    images = bag.of_type(ros.IMAGE, ros.COMPRESSED)
    if not images:
        raise InputError(f"{bag.path}: expected colour images beside the clouds ({clouds}), found none")
    named = [t for t in images if "color" in t.lower() or "rgb" in t.lower()] or images
    return clouds, min(named, key=lambda topic: ("raw" in topic, topic))
