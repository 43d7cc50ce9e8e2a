"""Bags as robots record them: cameras side by side, bodies' axes, late colour, localisation once a second."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags import rosbag2
from rosbags.typesys import Stores
from scans import COLORS, FRAMES, INTERVAL_S, LEANING, START_S, Z_UP, World, camera, look, map_pose, steps
from scans_bags import T_BASE_CAMERA, Messages, write_bag2

from simaps_viz import open_sequence
from simaps_viz.datasets.calibration import Lens, _pixels
from simaps_viz.datasets.rosbag import T_BODY_OPTICAL
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.geometry import invert_pose
from simaps_viz.structures import Intrinsics

MAKE = Messages(Stores.ROS2_HUMBLE)
K = camera()
WIDE = Intrinsics(200, 150, 150.0, 152.0, 101.0, 74.0)
"""A depth camera that sees all that colour does."""
T_COLOR_DEPTH = np.array([[1, 0, 0, -0.05], [0, 1, 0, 0.002], [0, 0, 1, 0.004], [0, 0, 0, 1.0]])
BENT = (0.12, -0.05, 0.001, -0.0005, 0.01)


@dataclass
class Drive:
    """What a robot records; changed by each test."""

    depth: str = "/camera/depth/image_raw"
    color: str = "/camera/color/image_raw"
    depth_frame: str = "depth_optical"
    color_frame: str = "color_optical"
    depth_camera: Intrinsics = K
    distortion: tuple[float, ...] = ()
    """Of the depth image."""
    T_color_depth: np.ndarray | None = None
    """Said by /tf_static; None = nothing is."""
    T_depth_camera: np.ndarray | None = None
    """Where depth is taken from, seen from colour, in truth; None = from the same place."""
    T_base_color: np.ndarray | None = None
    mounted: str | None = None
    """The frame that /tf_static puts on the base; None = colour's."""
    late_s: Callable[[int], float] = lambda _: 0.005
    slam: World | None = None
    """Poses are said on a topic of the camera's own, in this world, and not by /tf."""
    repeated: bool = False
    """Static transforms are repeated on /tf, as ROS 1 does."""
    corrections_s: float | None = None
    """map to odom comes so often; None = never."""
    more: Callable[[], list[tuple[float, str, Any]]] = list
    without: str = ""
    """A topic that was not recorded."""
    mocap: bool = False
    """The base is on a topic of TransformStamped, not on /tf."""

    def write(self, path: Path) -> Path:
        base = T_BASE_CAMERA if self.T_base_color is None else self.T_base_color
        found = [
            (START_S - 0.5, "/tf_static", MAKE.transform(0.0, "base_link", self.mounted or self.color_frame, base)),
            *self.more(),
        ]
        if self.T_color_depth is not None:
            T = MAKE.transform(0.0, self.color_frame, self.depth_frame, self.T_color_depth)
            found.append((START_S - 0.5, "/tf_static", T))
        for topic, k, frame, D in ((self.depth, self.depth_camera, self.depth_frame, self.distortion),
                                   (self.color, K, self.color_frame, ())):  # fmt: skip
            info = f"{topic.rpartition('/')[0]}/camera_info"
            found.append((START_S - 0.4, info, self.info(k, frame, D)))
        if self.repeated:
            once = [message for _, topic, message in found if topic == "/tf_static"]
            found = [entry for entry in found if entry[1] != "/tf_static"]
            for tick in range(-20, 1):
                for message in once:
                    again = message.transforms[0]
                    time_s = START_S + tick * 0.1
                    T = MAKE.transform(time_s, again.header.frame_id, again.child_frame_id, base)
                    found.append((time_s, "/tf", T))
        for tick in range(-4, 4 * FRAMES + 1):
            time_s = START_S + tick * INTERVAL_S / 4
            if self.slam is not None:
                pose = MAKE.odometry(time_s, self.slam.pose(tick / 4)).pose.pose
                stamped = MAKE.make("geometry_msgs/msg/PoseStamped", header=MAKE.header(time_s, "map"), pose=pose)
                found.append((time_s, "/orb_slam/camera_pose", stamped))
                continue
            T = Z_UP.pose(tick / 4) @ invert_pose(T_BASE_CAMERA)
            moved = MAKE.transform(time_s, "odom", "base_link", T)
            found.append((time_s, "/vicon/rig/rig", moved.transforms[0]) if self.mocap else (time_s, "/tf", moved))
        for n in range(0 if self.corrections_s is None else 4):
            assert self.corrections_s is not None
            time_s = START_S - 0.6 + n * self.corrections_s
            found.append((time_s, "/tf", MAKE.transform(time_s, "map", "odom", np.eye(4))))
        for i in range(FRAMES):
            time_s = START_S + i * INTERVAL_S
            T = map_pose(i) if self.T_depth_camera is None else map_pose(i) @ self.T_depth_camera
            raw = steps(look(self.depth_camera, T)[0]).astype("<u2")
            if self.distortion:
                raw = bend(raw, Lens(self.depth_camera, self.distortion))
            rgb = np.ascontiguousarray(COLORS[look(K, map_pose(i))[1]])
            color_s = time_s + self.late_s(i)
            found += [(time_s + 0.03, self.depth, MAKE.image(time_s, raw, "16UC1", self.depth_frame)),
                      (color_s + 0.03, self.color, MAKE.image(color_s, rgb, "rgb8", self.color_frame))]  # fmt: skip
        path.parent.mkdir(exist_ok=True, parents=True)
        found = [entry for entry in found if entry[1] != self.without]
        write_bag2(path, sorted(found, key=lambda e: e[0]), MAKE, rosbag2.StoragePlugin.SQLITE3)
        return path

    def info(self, k: Intrinsics, frame: str, D: tuple[float, ...]) -> Any:
        message = MAKE.camera_info(START_S)
        message.header.frame_id, message.width, message.height = frame, k.width, k.height
        message.k, message.d = k.matrix().ravel(), np.array(D or (0.0,) * 5)
        message.p = np.hstack([k.matrix() * [[0.8], [0.8], [1]], np.zeros((3, 1))]).ravel()
        return message


def bend(image: np.ndarray, lens: Lens) -> np.ndarray:
    """Distort a picture: every pixel of the straight one goes where the lens shows its ray, nearest last."""
    u, v = (np.rint(x).astype(int) for x in _pixels(lens, lens.intrinsics))
    out = np.zeros_like(image)
    inside = (u >= 0) & (v >= 0) & (u < image.shape[1]) & (v < image.shape[0])
    out[v[inside], u[inside]] = image[inside]
    return out


def expect_frames(sequence: PosedFrames, *, share: float = 1.0, error_m: float = 0.0006) -> None:
    """Depth, colour and poses are those of the colour camera."""
    np.testing.assert_allclose(sequence.poses, [Z_UP.pose(i) for i in range(FRAMES)], atol=1e-9)
    for i in range(FRAMES):
        expected, ids = look(sequence.intrinsics, map_pose(i))
        frame = sequence.read(i, color=True)
        both = (frame.depth_m > 0) & (expected > 0)
        assert both.sum() >= share * (expected > 0).sum()
        assert (np.abs(frame.depth_m - expected)[both] <= error_m).mean() >= min(share, 0.97)
        assert frame.color is not None
        assert (np.abs(frame.color.astype(int) - COLORS[ids]).max(axis=-1) < 40)[expected > 0].mean() > 0.9


def test_depth_beside_colour_is_registered_where_transforms_say_how(tmp_path):
    drive = Drive(depth_camera=WIDE, T_color_depth=T_COLOR_DEPTH, T_depth_camera=T_COLOR_DEPTH)
    sequence = open_sequence(drive.write(tmp_path / "drive"))
    assert sequence.intrinsics == K
    assert "is registered to colour (/camera/color/image_raw) by the transforms between" in sequence.notes[0]
    expect_frames(sequence, share=0.9, error_m=0.03)


def test_registered_depth_is_no_finer_than_it_was_measured(tmp_path):
    coarse = Intrinsics(32, 24, 24.0, 24.0, 16.0, 12.0)
    drive = Drive(depth_camera=coarse, T_color_depth=T_COLOR_DEPTH, T_depth_camera=T_COLOR_DEPTH)
    sequence = open_sequence(drive.write(tmp_path / "drive"))
    assert sequence.intrinsics.fx == pytest.approx(24.0, rel=0.05) and sequence.intrinsics.width == 26
    assert (sequence.read(0).depth_m > 0).mean() > 0.8


def test_frames_nothing_connects_are_taken_as_one_camera_s_and_it_is_said(tmp_path):
    sequence = open_sequence(Drive(mounted="depth_optical").write(tmp_path / "drive"))
    assert sequence.notes == (
        "no transforms between 'depth_optical' (/camera/depth/image_raw) and "
        "'color_optical' (/camera/color/image_raw): taken as one camera's",
    )
    expect_frames(sequence)


def test_azure_s_depth_to_rgb_goes_before_raw_depth_and_infrared(tmp_path):
    """The driver publishes both, and infrared as 16-bit grey: Azure_Kinect_ROS_Driver's docs/usage.md."""

    def raw() -> list[tuple[float, str, Any]]:
        found = []
        for i in range(FRAMES):
            time_s = START_S + i * INTERVAL_S
            ones = np.ones((24, 32), "<u2")
            found += [(time_s, "/depth/image_raw", MAKE.image(time_s, ones, "16UC1", "depth_camera_link")),
                      (time_s, "/ir/image_raw", MAKE.image(time_s, ones, "mono16", "depth_camera_link"))]  # fmt: skip
        return found

    drive = Drive("/depth_to_rgb/image_raw", "/rgb/image_raw", "rgb_camera_link", "rgb_camera_link", more=raw)
    sequence = open_sequence(drive.write(tmp_path / "drive"))
    expect_frames(sequence)
    assert sequence.notes == (), "rgb_camera_link has a camera's axes: it looks ahead, not at the sky"


@pytest.mark.parametrize("depth", ["/camera/aligned_depth_to_color/image_raw", "/camera/depth_registered/image_raw"])
def test_aligned_depth_is_as_bent_as_its_own_camera_info_says(tmp_path, depth):
    drive = Drive(depth=depth, depth_frame="color_optical", depth_camera=WIDE, distortion=BENT)
    sequence = open_sequence(drive.write(tmp_path / "drive"))
    assert sequence.intrinsics == WIDE
    for i in range(FRAMES):
        expected = look(WIDE, map_pose(i))[0]
        found = sequence.read(i).depth_m
        both = (found > 0) & (expected > 0)
        assert (np.abs(found - expected)[both] < 0.03).mean() > 0.97 and both.sum() > 0.9 * (expected > 0).sum()


def test_rectified_pictures_have_the_camera_of_p(tmp_path):
    drive = Drive(depth="/camera/depth/image_rect_raw", depth_frame="color_optical", distortion=BENT)
    drive.distortion = ()
    assert open_sequence(drive.write(tmp_path / "drive")).intrinsics.fx == pytest.approx(0.8 * K.fx)


def test_a_body_s_axes_are_turned_into_a_camera_s(tmp_path):
    """Gazebo's camera plugins name camera_link, whose x looks ahead (REP 103)."""
    names = {"depth_frame": "camera_link", "color_frame": "camera_link"}
    drive = Drive(**names, T_base_color=T_BASE_CAMERA @ invert_pose(T_BODY_OPTICAL))  # pyright: ignore[reportArgumentType]
    sequence = open_sequence(drive.write(tmp_path / "drive"))
    assert sequence.notes == ("frame 'camera_link' has a body's axes (x forward, z up), not a camera's: turned",)
    expect_frames(sequence)


def test_a_localisation_once_a_second_leaves_no_gaps(tmp_path):
    sequence = open_sequence(Drive(corrections_s=1.0, depth_frame="color_optical").write(tmp_path / "drive"))
    assert len(sequence) == FRAMES and sequence.notes == ()
    expect_frames(sequence)


def test_static_transforms_that_ros1_repeats_and_drops(tmp_path):
    """static_transform_publisher of ROS 1 says them ten times a second on /tf; when it stops, they still hold."""
    drive = Drive(depth_frame="color_optical", repeated=True)
    expect_frames(open_sequence(drive.write(tmp_path / "drive")))
    drive.slam = LEANING
    sequence = open_sequence(drive.write(tmp_path / "slam"))
    np.testing.assert_allclose(sequence.poses, [LEANING.pose(i) for i in range(FRAMES)], atol=1e-9)


def test_poses_of_a_camera_in_the_world_of_visual_slam(tmp_path):
    """Its world has the first camera's axes, not z up: up is estimated."""
    sequence = open_sequence(Drive(depth_frame="color_optical", slam=LEANING).write(tmp_path / "drive"))
    np.testing.assert_allclose(sequence.poses, [LEANING.pose(i) for i in range(FRAMES)], atol=1e-9)
    for i, T_map_camera in enumerate(sequence.T_map_world @ sequence.poses):
        assert T_map_camera[2, 3] == pytest.approx(map_pose(i)[2, 3], abs=0.01)
        assert T_map_camera[2, 2] == pytest.approx(map_pose(i)[2, 2], abs=0.01)


@pytest.mark.parametrize(
    ("name", "taken"),
    [("/kinect2/hd/image_depth_rect", True), ("/kinect2/sd/image_ir_rect", False), ("/cam/ir/image_raw", False)],
)
def test_infrared_is_no_depth(tmp_path, name, taken):
    """iai_kinect2 and Azure's driver publish infrared as 16-bit grey beside depth."""
    drive = Drive(depth=name, color=f"{name.rpartition('/')[0]}/image_color_rect", depth_frame="color_optical")
    path = drive.write(tmp_path / "drive")
    if taken:
        assert open_sequence(path).intrinsics.fx == pytest.approx(0.8 * K.fx), "rectified: the camera is P"
    else:
        with pytest.raises(InputError, match="expected a topic with depth images"):
            open_sequence(path)


def test_a_bag_without_static_transforms_says_what_it_lacks(tmp_path):
    """rosbag2 started later than a latched publisher: the most frequent gap of real bags."""
    drive = Drive(depth_frame="color_optical", mounted="elsewhere")
    path = drive.write(tmp_path / "drive")
    moves = "6 topics: /tf moves 'base_link', but no transform leads from there to the camera"
    with pytest.raises(InputError, match=rf"that move 'color_optical', or poses, found neither among {moves}"):
        open_sequence(path)


def test_a_bag_without_poses_is_called_so(tmp_path):
    """realsense-viewer records pictures and cameras alone."""
    path = Drive(depth_frame="color_optical", without="/tf").write(tmp_path / "drive")
    with pytest.raises(InputError, match=r"found neither among 5 topics: it has no poses at all, and a SLAM program"):
        open_sequence(path)


def test_motion_capture_on_a_topic_of_its_own(tmp_path):
    """vicon_bridge says TransformStamped; its subject is what the camera sits on."""
    sequence = open_sequence(Drive(depth_frame="color_optical", mocap=True).write(tmp_path / "drive"))
    assert sequence.notes == ("no /tf moves the camera: poses are of /vicon/rig/rig (TransformStamped)",)
    expect_frames(sequence)


@pytest.mark.parametrize("other", ["depth", "color"])
def test_the_camera_of_one_frame_is_not_taken_for_that_of_another(tmp_path, other):
    """Depth beside colour has another lens, though its pictures may be as large."""
    info = f"/camera/{other}/camera_info"
    drive = Drive(T_color_depth=T_COLOR_DEPTH, T_depth_camera=T_COLOR_DEPTH, without=info)
    with pytest.raises(InputError, match=rf"expected {info}, as /camera/{other}/image_raw is in another frame"):
        open_sequence(drive.write(tmp_path / "apart"))
    drive = Drive(depth_frame="color_optical", without=info)
    expect_frames(open_sequence(drive.write(tmp_path / "registered")))


def test_another_camera_s_depth_is_named(tmp_path):
    def left() -> list[tuple[float, str, Any]]:
        ones, rgb = np.ones((24, 32), "<u2"), np.ones((24, 32, 3), np.uint8)
        return [(START_S, "/left/aligned_depth_to_color/image_raw", MAKE.image(START_S, ones, "16UC1", "left_optical")),
                (START_S, "/left/color/image_raw", MAKE.image(START_S, rgb, "rgb8", "left_optical"))]  # fmt: skip

    depth = "/camera/aligned_depth_to_color/image_raw"
    sequence = open_sequence(Drive(depth, depth_frame="color_optical", more=left).write(tmp_path / "drive"))
    others = "/left/aligned_depth_to_color/image_raw"
    assert sequence.notes == (f"depth of one camera ({depth}) is read, not that of others ({others})",)
    expect_frames(sequence)


def test_late_colour_says_how_late_it_is_and_what_is_allowed(tmp_path):
    drive = Drive(depth_frame="color_optical", late_s=lambda i: 0.005 if i != 2 else 0.034)
    sequence = open_sequence(drive.write(tmp_path / "some"))
    late = "the nearest is 34 to 34 ms away, 20 ms are allowed"
    assert sequence.notes == (f"1 of 4 depth images have no colour of their time ({late}): left out",)
    assert len(sequence) == 3
    with pytest.raises(InputError, match=f"none among 4 depth images .*: {late}"):
        open_sequence(Drive(depth_frame="color_optical", late_s=lambda _: 0.034).write(tmp_path / "all"))
