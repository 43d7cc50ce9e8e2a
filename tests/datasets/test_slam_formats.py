"""Quirks of what SLAM programs and phone apps write, as their sources and real files show them."""

import json
import re
import shutil
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from scans import FRAMES, LEANING, Sample, camera, look, map_pose, row, steps
from scans_apps import record3d_exr
from scans_bags import ros2_sqlite, rvl
from scans_folders import habitat, nerfstudio, sens, tum
from scans_slam import (
    T_BASE_CAMERA,
    colmap,
    instant_ngp,
    matrix_lines,
    pose_lines,
    redwood,
    rtabmap,
    rtabmap_calibration,
    slam_folder,
    stray_scanner,
)
from scipy.spatial.transform import Rotation

from simaps_viz import open_sequence
from simaps_viz.datasets.calibration import Lens, see_through
from simaps_viz.datasets.images import read_depth
from simaps_viz.datasets.open import recognise
from simaps_viz.errors import InputError

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a214614ab2935\nsize 12345\n"
K = camera()


def change(path: Path, query: str, *values: object) -> None:
    with sqlite3.connect(path) as database:
        database.execute(query, values)
    database.close()


def floats_calibration(*between: float) -> bytes:
    place = T_BASE_CAMERA[:3].ravel()
    return np.array([K.fx, K.fy, K.cx, K.cy, *between, *place], "<f4").tobytes()


def test_a_database_without_optimised_poses_says_so(tmp_path):
    sample = rtabmap(tmp_path, optimised=False)
    sequence = open_sequence(sample.path)
    assert sequence.notes == ("poses are odometry's: the database has no optimised ones (Admin.opt_poses)",)
    np.testing.assert_allclose(sequence.poses, open_sequence(sample.reference).poses, atol=3e-7)


def test_nodes_outside_the_optimised_graph_are_left_out(tmp_path):
    assert open_sequence(rtabmap(tmp_path).path).notes == (
        "1 of 5 nodes have no pose in the optimised graph: left out",
    )


def test_a_database_with_depth_as_rvl(tmp_path):
    path = rtabmap(tmp_path).path
    depth = steps(look(K, map_pose(0))[0])
    change(path, "UPDATE Data SET depth = ? WHERE id = 1", b"DEPTHRVL" + struct.pack("<II", 64, 48) + rvl(depth))
    np.testing.assert_allclose(open_sequence(path).read(0).depth_m, depth * 0.001, rtol=1e-6)


@pytest.mark.parametrize("size", [(), (K.width, K.height), (0, 0)])
def test_cameras_as_rtabmap_stored_them_before_version_0_18(tmp_path, size):
    """Floats: focal lengths, principal point, since 0.11.2 the size, the camera's place on the base."""
    sample = rtabmap(tmp_path)
    change(sample.path, "UPDATE Data SET calibration = ?", floats_calibration(*size))
    sequence = open_sequence(sample.path)
    np.testing.assert_allclose(sequence.intrinsics.matrix(), K.matrix(), rtol=1e-6)
    np.testing.assert_allclose(sequence.poses, open_sequence(sample.reference).poses, atol=3e-7)


@pytest.mark.parametrize(
    ("query", "values", "expected"),
    [
        ("DELETE FROM Data", (), "nodes with a picture and depth, found none in 6 nodes; .*Mem/BinDataKept"),
        ("UPDATE Data SET calibration = ?", (rtabmap_calibration(K, kind=1),), "one camera with depth, found stereo"),
        (
            "UPDATE Data SET calibration = ?",
            (rtabmap_calibration(K, cameras=2),),
            "one camera, found 744 bytes for sev",
        ),
        ("UPDATE Data SET calibration = ?", (bytes(16),), "RTAB-Map 0.10 or later, found 16 bytes"),
        ("UPDATE Data SET calibration = ?", (floats_calibration(0.07),), "one camera with depth, found 68 b"),
        ("UPDATE Data SET calibration = ?", (floats_calibration() * 2,), "one camera with depth, found 128"),
        ("UPDATE Admin SET opt_poses = ?", (bytes(40),), "Admin.opt_poses: expected packed numbers"),
        ("DROP TABLE Data", (), "an RTAB-Map database, found .*no such table: Data"),
    ],
)
def test_databases_that_are_not_read(tmp_path, query, values, expected):
    path = rtabmap(tmp_path).path
    change(path, query, *values)
    with pytest.raises(InputError, match=f"rtabmap.db.*expected {expected}|rtabmap.db.*{expected}"):
        open_sequence(path)


def test_the_camera_of_all_pictures_where_the_app_wrote_none_for_each(tmp_path):
    """The app writes the last picture's camera alone; since 2026 each row of odometry.csv has its own."""
    path = stray_scanner(tmp_path).path
    lines = [line.split(",")[:9] for line in (path / "odometry.csv").read_text().splitlines()]
    (path / "odometry.csv").write_text("\n".join(map(",".join, lines)))
    assert open_sequence(path).intrinsics.fx == pytest.approx(K.fx * 1.1, rel=1e-6)


def test_what_a_phone_lost_is_left_out(tmp_path):
    path = stray_scanner(tmp_path).path
    (path / "depth/000001.png").unlink()
    lines = (path / "odometry.csv").read_text().splitlines()
    lines[3] = lines[3].replace(lines[3].split(",")[2], " nan")
    (path / "odometry.csv").write_text("\n".join(lines))
    sequence = open_sequence(path)
    assert sequence.frame_names == ("000000", "000003")
    assert sequence.notes == ("3 of 5 poses have no picture in rgb.mp4, or no depth image: left out",)
    later = np.abs(sequence.color(1).astype(int) - open_sequence(stray_scanner(tmp_path / "b").path).color(3))
    assert later.max() == 0, "the picture of that number, not the second"


def test_stray_scanner_s_depth_before_2022_is_floats_in_metres(tmp_path):
    usual, other = stray_scanner(tmp_path / "usual").path, stray_scanner(tmp_path / "other").path
    for file in (other / "depth").iterdir():
        np.save(file.with_suffix(".npy"), read_depth(file, 0.001))
        file.unlink()
    found, expected = open_sequence(other), open_sequence(usual)
    assert found.frame_names == expected.frame_names
    for i in range(len(expected)):
        np.testing.assert_allclose(found.read(i).depth_m, expected.read(i).depth_m, atol=1e-6)


def test_icl_nuim_s_left_handed_world_and_camera(tmp_path):
    """Its fy is -480: poses are those of a camera whose y points up, in a world turned inside out."""
    usual, other = slam_folder(tmp_path / "usual").path, slam_folder(tmp_path / "other").path
    for path in (usual, other):
        for file in [*path.glob("rgb/*"), *path.glob("depth/*")]:
            picture = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            assert picture is not None
            cv2.imwrite(str(file), cv2.resize(picture, (640, 480), interpolation=cv2.INTER_NEAREST))
    (usual / "office.yaml").unlink()
    np.savetxt(usual / "intrinsics.txt", [[481.2, 0, 319.5], [0, 480.0, 239.5], [0, 0, 1]])
    (other / "office.yaml").unlink()
    flip, lines = np.diag([1.0, -1.0, 1.0]), []
    for line in (other / "CameraTrajectory.txt").read_text().splitlines():
        time, *row = map(float, line.split())
        turned = Rotation.from_matrix(flip @ Rotation.from_quat(row[3:]).as_matrix() @ flip).as_quat()
        lines.append(" ".join(f"{x:.12g}" for x in (time, *(flip @ row[:3]), *turned)))
    (other / "CameraTrajectory.txt").unlink()
    (other / "livingRoom1.gt.freiburg").write_text("\n".join(lines))
    found, expected = open_sequence(other), open_sequence(usual)
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-6)
    assert found.intrinsics == expected.intrinsics and found.notes[0].startswith("camera: ICL-NUIM's;")


def test_orb_slam3_s_times_may_be_nanoseconds(tmp_path):
    usual, other = slam_folder(tmp_path / "usual").path, slam_folder(tmp_path / "other").path
    lines = [line.partition(" ") for line in (other / "CameraTrajectory.txt").read_text().splitlines()]
    nanoseconds = [f"{time.replace('.', '')}00 {rest}" for time, _, rest in lines]  # of seven decimals
    (other / "CameraTrajectory.txt").write_text("\n".join(nanoseconds))
    found, expected = open_sequence(other), open_sequence(usual)
    assert found.frame_names == expected.frame_names and found.notes == expected.notes
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-6)


def test_redwood_s_own_downloads_call_the_poses_something_traj_txt(tmp_path):
    usual, other = redwood(tmp_path / "usual").path, redwood(tmp_path / "other").path
    (log,) = [file for name in ("trajectory.log", "scene/trajectory.log") if (file := other / name).is_file()]
    log.rename(other / "bedroom-traj.txt")
    found, expected = open_sequence(other), open_sequence(usual)
    np.testing.assert_array_equal(found.poses, expected.poses)


def box(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content) + 8) + kind + content


def hide_the_first_picture(path):
    """Give an MP4 the list of edits that iOS writes when the first picture is timed before the video starts."""
    data = path.read_bytes()
    moov, trak, mdia = (data.index(kind) - 4 for kind in (b"moov", b"trak", b"mdia"))
    ticks = struct.unpack(">I", data[(at := data.index(b"stts") + 16) : at + 4])[0]  # of a picture
    edits = box(b"edts", box(b"elst", struct.pack(">IIIiI", 0, 1, 1000, ticks, 1 << 16)))
    start = data.find(b"edts", trak, mdia) - 4
    old = data[start:mdia] if start > 0 else b""
    data = bytearray(data[: mdia - len(old)] + edits + data[mdia:])
    for at in (moov, trak):
        struct.pack_into(">I", data, at, struct.unpack_from(">I", data, at)[0] + len(edits) - len(old))
    path.write_bytes(data)


def test_a_picture_that_a_video_hides_is_the_first_one_all_the_same(tmp_path):
    """Stray Scanner's app numbers pictures from 1 frame before the start of its video (DatasetEncoder.swift)."""
    path = stray_scanner(tmp_path).path
    shown = [open_sequence(path).color(i) for i in range(FRAMES)]
    hide_the_first_picture(path / "rgb.mp4")
    hiding = cv2.VideoCapture(str(path / "rgb.mp4"), cv2.CAP_FFMPEG)
    assert sum(hiding.grab() for _ in range(FRAMES + 2)) == FRAMES - 1
    sequence = open_sequence(path)
    assert len(sequence) == FRAMES
    for i in range(FRAMES):
        np.testing.assert_array_equal(sequence.color(i), shown[i])


def test_a_video_that_ends_early_names_the_picture(tmp_path):
    path = stray_scanner(tmp_path).path
    sequence = open_sequence(path)
    forwards = [sequence.color(i) for i in range(FRAMES)]
    for i in (3, 0, 2):
        np.testing.assert_array_equal(sequence.color(i), forwards[i])
    data = (path / "rgb.mp4").read_bytes()
    (path / "rgb.mp4").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"rgb\.mp4: expected a video, found one that cannot be decoded"):
        open_sequence(path)


TUM_HEAD = "# color images\n# file: 'rgbd_dataset_freiburg1_desk.bag'\n"
ORB3 = (
    'Camera.type: "PinHole"\nCamera1.fx: 500.0\nCamera1.fy: 501.0\nCamera1.cx: 320\nCamera1.cy: 240\nCamera1.k1: 0.1\n'
)


@pytest.mark.parametrize(
    ("name", "content", "focal", "unit_m"),
    [
        ("rgb.txt", TUM_HEAD, 517.3, 0.0002),
        ("calibration.txt", "726.3 726.3 354.6 186.5\n", 726.3, 0.0002),
        ("orb.yaml", ORB3 + "RGBD.DepthMapFactor: 4000.0\n", 500.0, 0.00025),
        ("intrinsics.txt", "600 0 320\n0 600 240\n0 0 1\n", 600.0, 0.0002),
        ("intrinsic.txt", "#fx 0 cx\n#0 fy cy\n#0 0 1\n518.0 0 325.5\n0 519.0 253.5\n0 0 1", 518.0, 0.0002),
    ],
)
def test_who_says_which_camera_it_was(tmp_path, name, content, focal, unit_m):
    path = tum(tmp_path).path.rename(tmp_path / "mine")
    (path / "groundtruth.txt").rename(path / "CameraTrajectory.txt")
    before = (path / name).read_text() if (path / name).is_file() else ""
    (path / name).write_text(content + before)
    sequence = open_sequence(path)
    assert sequence.recording.facts.title == "RGB-D SLAM folder" and len(sequence) == FRAMES
    assert (sequence.intrinsics.fx, sequence.depth_unit_m) == (focal, pytest.approx(unit_m))
    assert sequence.notes[0].startswith(f"camera: {name}")


def test_a_trajectory_without_times_has_a_line_for_each_picture(tmp_path):
    """A picture that is missing costs its frame; whether numbers start at 0 or 1; the camera is not made up."""
    path = pose_lines(tmp_path).path
    known = open_sequence(path)
    assert known.notes[0] == "camera: intrinsics.txt; depth: 0.001 m a step"
    (path / "color/2.png").unlink()
    found = open_sequence(path)
    kept = [i for i in range(len(known)) if i != 1]
    assert found.frame_names == tuple(str(i + 1) for i in kept)
    np.testing.assert_array_equal(found.poses, known.poses[kept])
    for folder in ("color", "depth"):
        for file in sorted((path / folder).iterdir()):
            file.rename(file.with_stem(str(int(file.stem) - 1)))
    np.testing.assert_array_equal(open_sequence(path).poses, found.poses)
    (path / "intrinsics.txt").unlink()
    with pytest.raises(InputError, match=r"joinMap: expected something that says which camera it was, found none of"):
        open_sequence(path)


@pytest.mark.parametrize(
    ("kept", "found"),
    [
        (16, None),
        (12, None),
        (15, "expected lines of 7 numbers (position, quaternion x y z w) or of a matrix of 12 or 16, found 15"),
    ],
)
def test_poses_of_numbered_pictures_may_be_matrices(tmp_path, kept, found):
    path = matrix_lines(tmp_path).path
    known = open_sequence(path)
    assert known.notes[0] == "camera: K.txt; depth: 0.001 m a step" and len(known) == FRAMES
    lines = [[*line.split(), "0"][:kept] for line in (path / "poses.txt").read_text().splitlines()]
    (path / "poses.txt").write_text("\n".join(map(" ".join, lines)))
    if found:
        with pytest.raises(InputError, match=re.escape(found)):
            open_sequence(path)
    else:
        np.testing.assert_array_equal(open_sequence(path).poses, known.poses)


def test_a_reconstruction_of_other_pictures_is_told_from_missing_depth(tmp_path):
    """Both lists of names are said: people leave an older reconstruction beside new pictures."""
    path = colmap(tmp_path).path
    for file in sorted((path / "depth").rglob("*.*")):
        file.rename(file.with_stem(f"new{file.stem}"))
    expected = r"depth: expected depth named as the reconstruction's \d+ pictures \(.+\), found new"
    with pytest.raises(InputError, match=expected):
        open_sequence(path)


def test_no_camera_is_made_up(tmp_path):
    path = tum(tmp_path).path.rename(tmp_path / "mine")
    (path / "groundtruth.txt").rename(path / "KeyFrameTrajectory.txt")
    with pytest.raises(
        InputError, match=r"mine: expected something that says which camera it was, found none of intri"
    ):
        open_sequence(path)
    (path / "KeyFrameTrajectory.txt").unlink()
    with pytest.raises(InputError, match=r"mine: expected a trajectory \(groundtruth.txt, CameraTrajectory.txt"):
        open_sequence(path)


@pytest.mark.parametrize(
    ("name", "head", "focal"),
    [
        ("rgbd_dataset_freiburg3_seats", "", 535.4),
        ("desk", TUM_HEAD, 517.3),
        ("rgbd_dataset_freiburg3_seats", TUM_HEAD, 517.3),
        ("rgbd_bonn_balloon", "", 542.822841),
        ("desk", "", None),
    ],
)
def test_tum_s_own_folders_under_other_names(tmp_path, name, head, focal):
    """TUM's lists name the recording they were made of; people rename the folder ("data")."""
    path = tum(tmp_path / "made").path.rename(tmp_path / name)
    (path / "rgb.txt").write_text(head + (path / "rgb.txt").read_text())
    if focal is None:
        with pytest.raises(InputError, match="expected something that says which camera it was, found none of"):
            open_sequence(path)
    else:
        assert open_sequence(path).intrinsics.fx == focal


def test_a_slam_folder_s_name_does_not_count(tmp_path):
    """People call their own recordings rgbd_dataset_freiburg1_xyz, so that ORB-SLAM's examples take them."""
    path = tum(tmp_path / "made").path
    (path / "groundtruth.txt").rename(path / "CameraTrajectory.txt")
    with pytest.raises(InputError, match="expected something that says which camera it was, found none of"):
        open_sequence(path)


def test_a_tracker_that_writes_a_pose_for_each_picture_lost_those_without(tmp_path):
    """ORB-SLAM writes none while tracking fails (System.cc); a pose between its neighbours' would be made up."""
    path = slam_folder(tmp_path).path
    pairs, poses = ([line.split() for line in (path / name).read_text().splitlines()]
                    for name in ("associations.txt", "CameraTrajectory.txt"))  # fmt: skip
    for i, pair in enumerate(pairs):  # 20 ms apart
        pair[0] = pair[2] = f"{10 + i / 50:.6f}"
    for i, pose in zip((0, 2, 3, 4), poses, strict=True):
        pose[0] = pairs[i][0]
    (path / "associations.txt").write_text("\n".join(map(" ".join, pairs)))
    (path / "CameraTrajectory.txt").write_text("\n".join(map(" ".join, poses)))
    assert "1 of 5 pictures have no pose of their time in CameraTrajectory.txt: left out" in open_sequence(path).notes
    for pose in poses:  # poses of other times are for between them
        pose[0] = f"{float(pose[0]) + 0.001:.6f}"
    (path / "CameraTrajectory.txt").write_text("\n".join(map(" ".join, poses)))
    assert len(open_sequence(path)) == 5


def test_trajectories_of_another_name(tmp_path):
    """CubeSLAM's sample has output_cam_poses.txt and truth_cam_poses.txt; notes and calibrations are no trajectory."""
    path = slam_folder(tmp_path).path
    usual = open_sequence(path)
    (path / "CameraTrajectory.txt").rename(path / "truth_cam_poses.txt")
    (path / "notes.txt").write_bytes(b"caf\xe9\n")
    (path / "objects.txt").write_text("1 2 3 4 5 6 7 8 9\n" * 4)
    np.testing.assert_array_equal(open_sequence(path).poses, usual.poses)
    (path / "output_cam_poses.txt").write_text((path / "truth_cam_poses.txt").read_text())
    with pytest.raises(InputError, match=r"expected a trajectory .* found output_cam_poses\.txt, truth_cam_poses\.txt; "
                       r"call the one that is meant CameraTrajectory\.txt"):  # fmt: skip
        open_sequence(path)


def test_lists_that_number_the_pictures(tmp_path):
    """Lists of key frames say 0, 1, 2 where the trajectory has times (CubeSLAM's sample of TUM's cabinet)."""
    path, usual = slam_folder(tmp_path).path, open_sequence(slam_folder(tmp_path / "usual").path)
    pairs = [line.split() for line in (path / "associations.txt").read_text().splitlines()]
    pairs.pop(1)  # the one without a pose
    (path / "associations.txt").unlink()
    for name, column in (("rgb.txt", 1), ("depth.txt", 3)):
        (path / name).write_text("".join(f"{i} {pair[column]}\n" for i, pair in enumerate(pairs)))
    found = open_sequence(path)
    assert "pictures are listed at other times than poses: paired in their order" in found.notes
    np.testing.assert_array_equal(found.poses, usual.poses)
    for i in range(len(usual)):
        np.testing.assert_array_equal(found.read(i).depth_m, usual.read(i).depth_m)
        np.testing.assert_array_equal(found.color(i), usual.color(i))
    (path / "rgb.txt").write_text("".join(f"{i} {pair[1]}\n" for i, pair in enumerate(pairs[:-1])))
    with pytest.raises(InputError, match="expected depth, colour and pose of about the same time, found none among"):
        open_sequence(path)


def test_lists_with_depth_first_and_missing_files(tmp_path):
    """TUM's associate.py prints whichever list it is called with first."""
    path = slam_folder(tmp_path).path
    lines = [line.split() for line in (path / "associations.txt").read_text().splitlines()]
    (path / "associations.txt").unlink()
    (path / "rgbd_assoc.txt").write_text("\n".join(" ".join([*line[2:], *line[:2]]) for line in lines))
    (path / lines[4][1]).unlink()
    sequence, usual = open_sequence(path), open_sequence(slam_folder(tmp_path / "b").path)
    assert "1 of 5 pairs of rgbd_assoc.txt lack a file: left out" in sequence.notes
    np.testing.assert_array_equal(sequence.poses, usual.poses[:3])
    np.testing.assert_array_equal(sequence.color(1), usual.color(1))


def test_redwood_s_camera_is_open3d_s_where_it_fits(tmp_path):
    path = redwood(tmp_path).path
    (path / "intrinsic.json").unlink()
    with pytest.raises(InputError, match=r"expected intrinsic\.json or .* 64x48 pixels, found none"):
        open_sequence(path)
    for file in (*(path / "depth").iterdir(), *(path / "color").iterdir()):
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert image is not None
        cv2.imwrite(str(file), cv2.resize(image, (640, 480), interpolation=cv2.INTER_NEAREST))
    sequence = open_sequence(path)
    assert sequence.intrinsics.fx == 525.0 and "taken as Open3D's default" in sequence.notes[0]


@pytest.mark.parametrize("head", ["0 0 0", "0\t 0\t 1 "])
def test_logs_whose_heads_name_no_picture(tmp_path, head):
    path = redwood(tmp_path).path
    poses = [f"{head}\n" + "\n".join(map(row, LEANING.pose(i))) for i in range(FRAMES)]
    (path / "scene/trajectory.log").rename(path / "bedroom.log").write_text("\n".join(poses) + "\n")
    (path / "color/000004.png").rename(path / "color/later.txt")
    sequence = open_sequence(path)
    np.testing.assert_allclose(sequence.poses, [LEANING.pose(i) for i in range(FRAMES)], atol=1e-9)


@pytest.mark.parametrize("gone", [5, 7, 9])
def test_a_line_missing_of_a_log_whose_heads_name_no_picture_costs_one_pose(tmp_path, gone):
    path = redwood(tmp_path).path
    poses = "\n".join("0 0 1\n" + "\n".join(map(row, LEANING.pose(i))) for i in range(FRAMES)).splitlines()
    (path / "scene/trajectory.log").write_text("\n".join(poses[:gone] + poses[gone + 1 :]))
    (path / "color/000004.png").unlink()
    sequence = open_sequence(path)
    assert sequence.frame_names == ("000000", "000002", "000003")
    np.testing.assert_allclose(sequence.poses, [LEANING.pose(i) for i in (0, 2, 3)], atol=1e-9)


def test_poses_of_a_log_that_name_the_same_picture_are_left_out(tmp_path):
    path = redwood(tmp_path).path
    log = path / "scene/trajectory.log"
    log.write_text(log.read_text().replace("3 3 4", "2 3 4"))
    sequence = open_sequence(path)
    assert sequence.frame_names == ("000000", "000004")
    assert any("2 of 4 poses name a picture that another one names, too (2)" in note for note in sequence.notes)


def edit(path: Path, **keys: object) -> None:
    content = json.loads((path / "transforms.json").read_text()) | keys
    for frame in content["frames"]:
        for key, value in keys.items():
            if value is None:
                frame.pop(key, None)
    (path / "transforms.json").write_text(json.dumps({k: v for k, v in content.items() if v is not None}))


def test_a_camera_by_its_angle_of_view_alone(tmp_path):
    path = instant_ngp(tmp_path).path
    angle = 2 * np.arctan(K.width / 2 / K.fx)
    edit(path, camera_angle_x=angle, fl_x=None, fl_y=None, cx=None, cy=None, w=None, h=None)
    k = open_sequence(path).intrinsics
    assert (k.fx, k.fy, k.cx, k.cy) == (pytest.approx(K.fx), pytest.approx(K.fx), K.width / 2 - 0.5, K.height / 2 - 0.5)


def test_numbers_without_leading_zeros_are_in_order(tmp_path):
    path = instant_ngp(tmp_path).path
    content = json.loads((path / "transforms.json").read_text())
    for frame, new in zip(content["frames"], (9, 10, 100, 11, 12), strict=True):
        for end in ("", ".depth") if "depth_path" in frame else ("",):
            (path / f"{frame['file_path']}{end}.png").rename(path / f"images/n{new}{end}.png")
        frame.update(
            file_path=f"images/n{new}", **({"depth_path": f"images/n{new}.depth.png"} if "depth_path" in frame else {})
        )
    (path / "transforms.json").write_text(json.dumps(content))
    assert open_sequence(path).frame_names == ("n9", "n10", "n11", "n100")


@pytest.mark.parametrize("keys", [{"camera_model": "OPENCV_FISHEYE"}, {"is_fisheye": True}])
def test_nerfstudio_s_fisheye_cameras(tmp_path, keys):
    """nerfstudio names the model, instant-ngp has a flag; both have OpenCV's four numbers."""
    path = instant_ngp(tmp_path).path
    edit(path, **keys, k1=0.03, k2=-0.01, k3=0.004, k4=-0.001)
    lens = Lens(K, (0.03, -0.01, 0.004, -0.001), fisheye=True)
    raw = cv2.imread(str(path / "images/2.depth.png"), cv2.IMREAD_UNCHANGED)
    assert raw is not None
    expected = see_through(raw.astype(np.float32) * np.float32(10 / 65535), lens, K, exact=True)
    sequence = open_sequence(path)
    assert sequence.intrinsics == K
    np.testing.assert_allclose(sequence.read(2).depth_m, expected, rtol=1e-6)


def tiff(path: Path, depth_m: np.ndarray) -> None:
    assert cv2.imwrite(str(path), depth_m)


def exr(path: Path, depth_m: np.ndarray) -> None:
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"Z": depth_m}).write(str(path))


@pytest.mark.parametrize(("suffix", "write"), [("tiff", tiff), ("tif", tiff), ("exr", exr)])
def test_depth_as_tiff_or_exr(tmp_path: Path, suffix: str, write: Callable[[Path, np.ndarray], None]) -> None:
    sample: Sample = instant_ngp(tmp_path)
    path, usual = sample.path, open_sequence(sample.path)
    content = json.loads((path / "transforms.json").read_text())
    for i, frame in enumerate(content["frames"][:FRAMES]):
        frame.pop("depth_path")
        frame["depth_file_path"] = f"depth/{i}.{suffix}"
        (path / "depth").mkdir(exist_ok=True)
        write(path / frame["depth_file_path"], usual.read(i).depth_m)
    (path / "transforms.json").write_text(json.dumps(content | {"integer_depth_scale": 1.0}))
    sequence = open_sequence(path)
    for i in range(FRAMES):
        np.testing.assert_array_equal(sequence.read(i).depth_m, usual.read(i).depth_m)
    damaged = path / f"depth/0.{suffix}"
    damaged.write_bytes(damaged.read_bytes()[:60])
    with pytest.raises(InputError, match=f"0.{suffix}: expected an? {suffix.upper()[:4].replace('TIF', 'TIF')}"):
        sequence.read(0)


@pytest.mark.parametrize(("suffix", "write"), [("tiff", tiff), ("exr", exr), ("npy", np.save)])
def test_floats_without_a_unit_that_can_only_be_metres(tmp_path: Path, suffix: str, write: Callable) -> None:
    """nerfstudio is told the unit by a flag, so its file does not state it; renderers write metres."""
    path, usual = (nerfstudio(tmp_path / name).path for name in ("floats", "usual"))
    expected, text = open_sequence(usual), (path / "transforms.json").read_text()
    for i, file in enumerate(sorted((path / "depths").iterdir())):
        write(file.with_suffix(f".{suffix}"), expected.read(i).depth_m)
        text = text.replace(file.name, f"{file.stem}.{suffix}").replace(
            f"images/{file.stem}.{suffix}", f"images/{file.name}"
        )
    for unit, notes in (({}, 1), ({"depth_unit_scale_factor": 1.0}, 0)):
        (path / "transforms.json").write_text(json.dumps(json.loads(text) | unit))
        found = open_sequence(path)
        assert [note.partition(":")[0] for note in found.notes] == ["depth is taken as metres"] * notes
        assert found.depth_unit_m == 0.001  # of the images that are written from it
        for i in range(FRAMES):
            np.testing.assert_allclose(found.read(i).depth_m, expected.read(i).depth_m, rtol=1e-6)


def test_depth_that_nerfcapture_has_clipped(tmp_path):
    """Its offline mode writes depth as an 8-bit picture, white beyond a metre (DatasetWriter.swift)."""
    path = instant_ngp(tmp_path).path
    for i in range(FRAMES):
        cv2.imwrite(str(path / f"images/{i}.depth.png"), np.zeros((48, 64, 4), np.uint8))
    edit(path, integer_depth_scale=None, depth_integer_scale=1.0)
    with pytest.raises(
        InputError, match=r"depth\.png: expected a 16-bit depth image with one channel, found 8 bits and 4"
    ):
        open_sequence(path)


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize(
    ("unit_m", "note"), [(0.37, "COLMAP's unit is 0.37 m, by the depth of"), (1.0, "poses are metres")]
)
def test_colmap_s_scale_is_found_in_depth(tmp_path, text, unit_m, note):
    sample = colmap(tmp_path, text=text, unit_m=unit_m)
    sequence = open_sequence(sample.path)
    assert sequence.notes[0].startswith(note)
    assert sequence.notes[1] == "1 of 5 pictures have no depth or are missing: left out"
    np.testing.assert_allclose(sequence.poses, open_sequence(sample.reference).poses, atol=2e-3)


def test_colmap_s_depth_of_other_pictures_is_refused(tmp_path):
    path = colmap(tmp_path).path
    rng = np.random.default_rng(1)
    for file in (path / "depth").iterdir():
        cv2.imwrite(str(file), rng.integers(300, 9000, (48, 64)).astype(np.uint16))
    with pytest.raises(
        InputError, match=r"room: expected one scale between points and depth, found .* in millimetres\?"
    ):
        open_sequence(path)


def own_depth_maps(path: Path, folder: str) -> Path:
    """Turn a sensor's depth into COLMAP's own, of 0.5 m; what is photometric is wrong, but for the first one's."""
    for i, file in enumerate(sorted((path / "depth").iterdir())):
        depth = read_depth(file, 0.002)
        file.unlink()
        kinds = {"geometric": depth, "photometric": depth * 3} if i else {"photometric": depth}
        for kind, values in kinds.items():
            target = path / folder / f"{file.name}.{kind}.bin"
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(b"64&48&1&" + np.where(depth > 0, values, -1).astype("<f4").tobytes())
    if folder != "depth":
        (path / "depth").rmdir()
    return path


@pytest.mark.parametrize("folder", ["stereo/depth_maps", "depth"])
def test_colmap_s_own_depth_maps_have_its_unit(tmp_path, folder):
    sample = colmap(tmp_path, unit_m=0.5)
    sequence = open_sequence(own_depth_maps(sample.path, folder), up=(0.3, -0.9, 0.2))
    reference = open_sequence(sample.reference)
    assert sequence.notes[0].startswith("depth is COLMAP's own, in the reconstruction's unit: 1 is taken as 1 m")
    assert sequence.notes[1:3] == (
        "1 of 5 pictures have no depth or are missing: left out",
        "1 of 4 frames have only a photometric depth map, which is rough",
    )
    np.testing.assert_allclose(sequence.poses[:, :3, :3], reference.poses[:, :3, :3], atol=1e-6)
    np.testing.assert_allclose(sequence.poses[:, :3, 3], reference.poses[:, :3, 3] / 0.5, atol=1e-6)
    for i in range(FRAMES):
        np.testing.assert_allclose(sequence.read(i).depth_m, reference.read(i).depth_m / 0.5, rtol=1e-6)


def test_of_several_reconstructions_of_colmap_s_the_largest_is_read_and_named(tmp_path):
    sample, pieces = colmap(tmp_path), colmap(tmp_path / "small").path
    whole = open_sequence(sample.path)
    (sample.path / "sparse/0").rename(sample.path / "sparse/10")
    small = sample.path / "sparse/2"
    shutil.copytree(pieces / "sparse/0", small)
    images = bytearray((small / "images.bin").read_bytes())
    images[:8] = struct.pack("<Q", 0)
    (small / "images.bin").write_bytes(images[:8])
    found = open_sequence(sample.path)
    assert found.notes[0] == "of 2 reconstructions, which share no frame of reference, the largest is read: sparse/10"
    assert found.notes[1:] == whole.notes
    np.testing.assert_array_equal(found.poses, whole.poses)


def test_a_sensor_s_depth_goes_before_colmap_s_own(tmp_path):
    path = colmap(tmp_path).path
    (path / "depth/IMG_4.png.geometric.bin").write_bytes(b"64&48&1&" + np.ones((48, 64), "<f4").tobytes())
    assert open_sequence(path).notes[0].startswith("COLMAP's unit is 0.5 m")


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (b"64&48&1&" + bytes(4 * 64 * 48 - 1), r"expected 64x48 numbers in 12288 bytes, found 12287 bytes"),
        (
            b"64&48&3&" + bytes(4 * 64 * 48 * 3),
            r"expected a depth map of COLMAP \(width&height&1&...\), found b'64&48&3&",
        ),
        (b"99999&9&1&", r"expected a picture of at most 16384 pixels a side"),
        (b"", r"expected a depth map of COLMAP"),
    ],
)
def test_a_damaged_depth_map_of_colmap_s_is_said(tmp_path, data, found):
    path = own_depth_maps(colmap(tmp_path).path, "stereo/depth_maps")
    files = sorted((path / "stereo/depth_maps").iterdir())
    files[0].write_bytes(data)
    with pytest.raises(InputError, match=rf"IMG_0\.png\.photometric\.bin: {found}"):
        open_sequence(path).read(0)
    for file in files:
        file.write_bytes(data)
    with pytest.raises(InputError, match=found):
        open_sequence(path)


@pytest.mark.parametrize("name", ["rtabmap.db", "drive.bag", "drive.mcap", "scan.r3d", "scan.rrd", "scan.sens"])
def test_a_pointer_of_git_lfs_is_called_so(tmp_path, name):
    """Most recordings in public repositories are such pointers until they are fetched, as rerun's own .rrd files."""
    (tmp_path / name).write_text(POINTER)
    with pytest.raises(InputError, match=f"{name}: expected a recording, found a pointer of Git LFS .* git lfs pull"):
        open_sequence(tmp_path / name)


@pytest.mark.parametrize(
    ("writer", "name"),
    [(instant_ngp, "images/0.png"), (stray_scanner, "rgb.mp4"), (habitat, "depth/000000.npy"), (sens, "*.sens"),
     (record3d_exr, "EXR_RGBD/depth/0.exr"), (ros2_sqlite, "*.db3")],
)  # fmt: skip
def test_pointers_of_git_lfs_in_a_recording(tmp_path, writer, name):
    path = writer(tmp_path).path
    path = path if path.is_dir() else path.parent
    for file in path.glob(re.sub("0+", "*", name)):
        file.write_text(POINTER)
    with pytest.raises(InputError, match=r": expected an? .*, found a pointer of Git LFS to it; .* git lfs pull"):
        open_sequence(path)


def test_readers_know_their_own_alone(tmp_path):
    titles = {}
    for writer in (instant_ngp, redwood, rtabmap, slam_folder, stray_scanner):
        reader = recognise(writer(tmp_path / writer.__name__).path)
        titles[writer.__name__] = reader.facts.title if reader else None
    assert list(titles.values()) == ["nerfstudio, instant-ngp", "Redwood, Open3D", "RTAB-Map", "RGB-D SLAM folder",
                                     "Stray Scanner"]  # fmt: skip
