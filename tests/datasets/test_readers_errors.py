"""Faulty recordings: one line that names the file, what was expected and what was found."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores
from scans import FRAMES, Sample
from scans_apps import record3d_folder, record3d_zip
from scans_bags import COLOR, DEPTH, Messages, entries, ros1_bag, ros2_mcap, ros2_sqlite, write_bag1
from scans_clouds import kitti360, lidar
from scans_folders import arkit, bundle_fusion, habitat, nerfstudio, polycam, replica, scannet, sens, seven_scenes, tum
from scans_rerun import rerun_rrd
from scans_slam import matrix_lines, pose_lines, redwood, slam_folder, stray_scanner

from simaps_viz import open_sequence
from simaps_viz.cli.main import main
from simaps_viz.errors import InputError

Change = Callable[[Path], object]


def remove(name: str) -> Change:
    return lambda folder: (folder / name).unlink()


def text(name: str, content: str) -> Change:
    return lambda folder: (folder / name).write_text(content)


def cut(name: str = "", share: float = 0.5) -> Change:
    def change(folder: Path) -> None:
        path = folder / name if name else folder
        data = path.read_bytes()
        path.write_bytes(data[: int(len(data) * share)])

    return change


def each(pattern: str, edit: Callable[[Path], object]) -> Change:
    return lambda folder: [edit(file) for file in sorted(folder.glob(pattern))]


def without(member: str) -> Change:
    """Leave a file out of an archive."""

    def change(path: Path) -> None:
        with zipfile.ZipFile(path) as archive:
            kept = {name: archive.read(name) for name in archive.namelist() if name != member}
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in kept.items():
                archive.writestr(name, data)

    return change


def lines(name: str, edit: Callable[[list[str]], list[str]]) -> Change:
    return lambda folder: (folder / name).write_text("\n".join(edit((folder / name).read_text().splitlines())))


def values(name: str, edit: Callable[[dict], object]) -> Change:
    def change(folder: Path) -> None:
        content = json.loads((folder / name).read_text())
        edit(content)
        (folder / name).write_text(json.dumps(content))

    return change


def panorama(content: dict) -> None:
    content["camera_model"] = "EQUIRECTANGULAR"


ARKIT = "41069021_frames"
KITTI_POSES = "data_poses/2013_05_28_drive_0000_sync/cam0_to_world.txt"
FAULTS: list[tuple[Callable[[Path], Sample], Change, str, str, str]] = [
    (tum, lines("groundtruth.txt", lambda x: x[:2]), "groundtruth.txt", "lines of 8 numbers", "none"),
    (tum, lines("groundtruth.txt", lambda x: [f"{y} 0" for y in x]), "groundtruth.txt, line 3", "8 numbers", "9"),
    (tum, lines("groundtruth.txt", lambda x: [y.replace(" 0", " 3") for y in x]), "line 3", "of length 1", ""),
    (tum, lines("depth.txt", lambda x: [y.split()[0] for y in x]), "depth.txt, line 2", "a time and a file", "1 words"),
    (tum, lines("rgb.txt", lambda x: ["5000 " + x[1].split()[1]]), "seats", "of about the same time", "5 depth images"),
    (tum, lines("rgb.txt", lambda x: [y + "s" for y in x]), "rgb.txt", "a time and a file", "4 of which none is there"),
    (bundle_fusion, each("*.pose.txt", lambda file: file.unlink()), "data", "with depth image, colour", "0 poses"),
    (bundle_fusion, each("*.pose.txt", lambda file: file.write_text("2 " * 16)), "pose.txt", "0 0 0 1", "2 2 2 2"),
    (bundle_fusion, each("*.pose.txt", lambda file: file.write_text("-inf " * 16)), "data", "a finite pose", "none"),
    (seven_scenes, lambda f: (f / "../info.txt").write_text("m_depthShift = 0"), "info.txt", "16 numbers and the", "0"),
    (seven_scenes, lambda f: (f / "../camera-intrinsics.txt").write_text("1 2"), "intrinsics.txt", "3x3", "1 line"),
    (scannet, remove("intrinsic/intrinsic_color.txt"), "intrinsic_color.txt", "a text file", "No such file"),
    (scannet, text("scene0000_00.aggregation.json", "{}"), "aggregation.json", '"segGroups"', "{}"),
    (scannet, values("scene0000_00.aggregation.json", lambda c: c["segGroups"].pop()), "0.png", "only ids", "1"),
    (replica, values("../cam_params.json", lambda c: c["camera"].pop("fx")),
     "cam_params.json: camera: fx", "a number", "none"),
    (replica, values("../cam_params.json", lambda c: c["camera"].update(scale=0)), "scale", "more than 0", "0"),
    (replica, values("../cam_params.json", lambda c: c["camera"].update(w=66)), "frame000000.jpg", "66x48", "64x48"),
    (replica, values("../cam_params.json", lambda c: c["camera"].update(scale=9)), "room0", "median depth", "m with"),
    (nerfstudio, values("transforms.json", lambda c: [frame.pop("depth_file_path") for frame in c["frames"]]),
     "transforms.json", "depth_file_path", "none in 4; a map needs depth"),
    (nerfstudio, values("transforms.json", lambda c: c["frames"][2].update(depth_file_path=3)),
     "transforms.json: frame 2", "depth_file_path", "3"),
    (nerfstudio, values("transforms.json", panorama), "camera_model", "OPENCV_FISHEYE", "EQUIRECT"),
    (nerfstudio, values("transforms.json", lambda c: [f.update(transform_matrix=[1]) for f in c["frames"]]),
     "frame_00000", "4x4", "[1]"),
    (nerfstudio, values("transforms.json", lambda c: c.pop("fl_x")), "fl_x", "a number", "none"),
    (nerfstudio, text("transforms.json", "{"), "transforms.json", "JSON", "line 1"),
    (habitat, text("obj2cls_dict.txt", "chair 5"), "obj2cls_dict.txt, line 1", "object:class,name", "chair 5"),
    (arkit, lines(f"{ARKIT}/lowres_wide.traj", lambda x: [y[:9] for y in x]), "lowres_wide.traj, line 1", "7 numbers",
     ""),
    (replica, lines("traj.txt", lambda x: [x[0], *["1 0 0"] * (len(x) - 1)]), "traj.txt, line 2", "16 numbers", "3"),
    (stray_scanner, lines("odometry.csv", lambda x: [x[0], *[y[:9] for y in x[1:]]]), "odometry.csv, line 2",
     "numbers", ""),
    (redwood, text("scene/trajectory.log", "a word\n" * 10), "trajectory.log, line 1", "and a 4x4 matrix", ""),
    (arkit, text(f"{ARKIT}/lowres_wide_intrinsics/41069021_99.999.pincam", "1 2"), "pincam, line 1", "6 numbers", "2"),
    (record3d_zip, cut(), "seats.r3d", "a Record3D archive", "not a zip"),
    (record3d_folder, values("metadata", lambda c: c.update(dw=47)), "rgbd/0.depth", "47x64 depths", "3072"),
    (sens, cut(), "scene0001_00.sens", "5 frames", "cut short in frame"),
    (sens, cut(share=0.001), "scene0001_00.sens", "a whole .sens file", "ends after"),
    (sens, lambda p: p.write_bytes(b"\x03\0\0\0" + p.read_bytes()[4:]), ".sens", "version 4", "version 3"),
]  # fmt: skip


@pytest.mark.parametrize(("writer", "change", "names", "expected", "found"), FAULTS)
def test_faults(tmp_path: Path, writer, change: Change, names: str, expected: str, found: str, capfd) -> None:
    sample = writer(tmp_path)  # is read as it is by test_readers_maps.py
    change(sample.path)
    with pytest.raises(InputError) as caught:
        open_sequence(sample.path)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 400 + len(str(sample.path))
    assert names in message
    before, word, after = message.partition("found")
    assert word and "expected" in before and expected in before and found in after
    assert capfd.readouterr() == ("", ""), "decoders say nothing of their own"


def test_frames_of_other_names_are_shown(tmp_path: Path) -> None:
    """Poses that are not the camera's: `frame-object-000000.pose.txt`, as in wangziyang182/3DMatching."""
    path = bundle_fusion(tmp_path).path
    for file in path.glob("frame-*.pose.txt"):
        file.rename(path / file.name.replace("frame-", "frame-object-"))
    with pytest.raises(InputError, match=r"poses \(frame-object-000000, frame-object-000001, "):
        open_sequence(path)


ONE_BAD: list[tuple[Callable[[Path], Sample], Change, int, str]] = [
    (tum, remove("depth/100.100000.png"), 1, "1 of 5 files of depth.txt are not there (100.100000.png): left out"),
    (seven_scenes, remove("frame-000002.pose.txt"), 2, "1 of 4 frames have no pose (frame-000002): left out"),
    (bundle_fusion, remove("frame-000002.color.jpg"), 2, "1 of 5 frames have no colour image (frame-000002): left out"),
    (bundle_fusion, text("frame-000002.pose.txt", "1 0 0"), 2, "expected a 4x4 matrix, found 3 numbers"),
    (bundle_fusion, text("frame-000001.pose.txt", "nan " * 16), 1, "pose.txt: expected finite numbers, found NaN"),
    (bundle_fusion, text("frame-000001.pose.txt", "-1.#IND " * 16), 1, "pose.txt: expected finite numbers, found NaN"),
    (bundle_fusion, text("frame-000001.pose.txt", "x " * 16), 1, "expected numbers, found 'x'"),
    (scannet, remove("pose/2.txt"), 1, "1 of 5 frames have no pose (2): left out"),
    (scannet, remove("color/10.jpg"), 3, "1 of 5 frames have no colour image (10): left out"),
    (replica, remove("results/frame000003.jpg"), 3, "1 of 4 frames have no colour image (3): left out"),
    (replica, lines("traj.txt", lambda x: x[:-1]), 3, "1 of 4 frames have no pose (3): left out"),
    (replica, lines("traj.txt", lambda x: [x[0], "nan " * 16, *x[2:]]), 1, "traj.txt, line 2: expected finite numbers"),
    (habitat, remove("rgb/000001.png"), 1, "1 of 4 frames have no colour image (1): left out"),
    (habitat, remove("semantic/000001.npy"), 1, "1 of 4 frames have no semantic array (1): left out"),
    (habitat, lines("poses.txt", lambda x: x[:-1]), 3, "1 of 4 frames have no pose (3): left out"),
    (nerfstudio, remove("depths/frame_00002.png"), 2, "1 of 4 frames have no depth image (images/frame_00002.png)"),
    (nerfstudio, values("transforms.json", lambda c: c["frames"][0].update(transform_matrix=[1])), 3, "expected 4x4"),
    (nerfstudio, values("transforms.json", lambda c: c["frames"][3].pop("transform_matrix")), 0, "expected 4x4"),
    (polycam, values("keyframes/corrected_cameras/12345678902.json", lambda c: c.pop("t_12")), 1, "t_12: expected"),
    (polycam, remove("keyframes/corrected_images/12345678902.jpg"), 1, "have no picture (12345678902): left out"),
    (record3d_folder, values("metadata", lambda c: c["poses"].pop()), 3, "1 of 4 frames have no pose (3): left out"),
    (record3d_folder, remove("rgbd/2.depth"), 2, "1 of 4 frames have no depth image (2): left out"),
    (record3d_zip, without("rgbd/2.jpg"), 2, "1 of 4 frames have no picture (2): left out"),
    (record3d_folder, values("metadata", lambda c: c["poses"].__setitem__(1, [0] * 7)), 1, "poses[1]: expected finite"),
    (lidar, remove("clouds/2.ply"), 2, "1 of 4 frames have no cloud (2): left out"),
    (arkit, lines(f"{ARKIT}/lowres_wide.traj", lambda x: ["nan " * 7, *x]), -1, "1 of 9 poses are damaged"),
    (arkit, lines(f"{ARKIT}/lowres_wide.traj", lambda x: [*x, "1 2"]), -1,
     "lowres_wide.traj, line 9: expected 7 numbers, found 2"),
    (tum, lines("groundtruth.txt", lambda x: [*x, "1 2 3"]), -1, "groundtruth.txt, line 29: expected 8 numbers, found"),
    (tum, lines("groundtruth.txt", lambda x: [*x[:9], "x y", *x[9:]]), -1, "groundtruth.txt, line 10: "),
    (tum, lines("depth.txt", lambda x: [*x, "100"]), -1, "1 of 6 lines of depth.txt are damaged"),
    (slam_folder, lines("associations.txt", lambda x: [*x, x[0][:9]]), -1, "lines of associations.txt are damaged"),
    (slam_folder, lines("CameraTrajectory.txt", lambda x: [*x, "9.5 1"]), -1, "expected 8 numbers, found 2"),
    (slam_folder, lambda f: (f / "track.txt").write_text(
        (f / "CameraTrajectory.txt").rename(f / "track.txt").read_text() + "\n9.5 1"), -1, "of 5 poses are damaged"),
    (lidar, lines("poses.txt", lambda x: [x[0], x[1][:20], *x[2:]]), 1, "line 2, frame 1: expected 16 numbers, found "),
    (replica, lines("traj.txt", lambda x: [*x[:-1], x[-1][:20]]), 3, "traj.txt, line 4: expected 16 numbers, found "),
    (replica, lines("traj.txt", lambda x: [x[0], "lost", *x[2:]]), 1, "traj.txt, line 2: expected 16 numbers, found 1"),
    (habitat, lines("poses.txt", lambda x: [*x[:-1], x[-1][:9]]), 3, "poses.txt, line 4: expected 7 numbers, found "),
    (pose_lines, lines("pose.txt", lambda x: [x[0][:9], *x[1:]]), 0, "pose.txt, line 1: expected 7 numbers, found "),
    (matrix_lines, lines("poses.txt", lambda x: [*x[:-1], x[-1][:9]]), 3, "poses.txt, line 4: expected "),
    (kitti360, lines(KITTI_POSES, lambda x: [x[0], x[1][:12], *x[2:]]), 1, "cam0_to_world.txt, line 2: expected 17"),
    (redwood, lines("scene/trajectory.log", lambda x: x[:-1]), 3, "1 of 4 poses are damaged"),
    (redwood, lines("scene/trajectory.log", lambda x: [*x[:7], *x[8:]]), 1, "1 of 4 poses are damaged"),
    (redwood, lines("scene/trajectory.log", lambda x: [*x[:5], *x[6:]]), 1, "trajectory.log, line 6: expected three"),
    (redwood, lines("scene/trajectory.log", lambda x: [*x[:7], x[6], *x[7:]]), 1, "1 of 4 poses are damaged"),
    (redwood, lines("scene/trajectory.log", lambda x: [*x[:7], "1 0", *x[8:]]), 1, "trajectory.log, line 6: expected "),
    (stray_scanner, lines("odometry.csv", lambda x: [*x[:2], x[2][:9], *x[3:]]), 1, "odometry.csv, line 3: expected "),
]  # fmt: skip


@pytest.mark.parametrize(("writer", "change", "lost", "words"), ONE_BAD)
def test_one_bad_item_costs_one_frame(tmp_path: Path, writer, change: Change, lost: int, words: str) -> None:
    """The other frames keep their own pose and pictures; the note says what was left out, and --strict refuses."""
    usual, other = writer(tmp_path / "usual"), writer(tmp_path / "other")
    change(other.path)
    expected, found = open_sequence(usual.path), open_sequence(other.path)
    kept = [index for index in range(len(expected)) if index != lost]
    assert found.frame_names == tuple(expected.frame_names[index] for index in kept)
    np.testing.assert_allclose(found.poses, expected.poses[kept], atol=1e-12)
    for index, same in enumerate(kept):
        np.testing.assert_array_equal(found.read(index).depth_m, expected.read(same).depth_m)
        np.testing.assert_array_equal(found.color(index), expected.color(same))
        if len(expected.labels) > 1:
            np.testing.assert_array_equal(found.segmentation(index).ids, expected.segmentation(same).ids)
    assert any(words in note and "left out" in note for note in found.notes), found.notes
    with pytest.raises(InputError, match="expected all of every frame") as caught:
        open_sequence(other.path, strict=True)
    assert words in str(caught.value)


UNREADABLE: list[tuple[Callable[[Path], Sample], Change]] = [
    (bundle_fusion, cut("frame-000000.depth.png")),
    (habitat, cut("depth/000000.npy")),
    (habitat, lambda f: np.save(f / "semantic/000000.npy", np.full((48, 64), -1))),
    (record3d_folder, cut("rgbd/0.depth")),
    (scannet, cut("color/0.jpg")),
]


@pytest.mark.parametrize(("writer", "change"), UNREADABLE)
def test_a_damaged_first_frame_is_left_out_by_convert(tmp_path: Path, writer, change: Change, capsys) -> None:
    path = writer(tmp_path).path
    whole = open_sequence(path)
    change(path)
    with pytest.raises(InputError):
        open_sequence(path, strict=True)
    out = tmp_path / "out"
    assert main(["convert", str(path), "-o", str(out)]) == 0
    assert "1 of 4 frames cannot be read" in capsys.readouterr().err
    converted = open_sequence(out, strict=True)
    assert converted.frame_names == whole.frame_names[1:]
    np.testing.assert_allclose(converted.poses, whole.poses[1:], atol=1e-12)
    assert not list(out.rglob(f"{whole.frame_names[0]}.*")), "nothing of it is left"
    assert main(["convert", str(path), "-o", str(tmp_path / "strict"), "--strict"]) == 2


def test_four_pictures_of_a_long_replica_path(tmp_path: Path) -> None:
    """What people cut out to try: a few pictures, and the path of all. The numbers in their names say which pose."""
    usual, other = replica(tmp_path / "usual").path, replica(tmp_path / "other").path
    rows = (other / "traj.txt").read_text().splitlines()
    (other / "traj.txt").write_text("\n".join([*rows, *rows * 499]))
    for kind in ("results/frame{}.jpg", "results/depth{}.png"):
        (other / kind.format("000002")).rename(other / kind.format("001002"))
    found, expected = open_sequence(other), open_sequence(usual)
    np.testing.assert_allclose(found.poses, expected.poses[[0, 1, 3, 2]], atol=1e-12)
    assert found.notes[0] == "1996 of 2000 frames have no depth image (2, 4, 5, ...): left out"


def changed(found: list, *, without: str = "", replace: Callable | None = None) -> list:
    """Leave topics out of a bag, or change its messages."""
    kept = [entry for entry in found if not (without and without in entry[1])]
    return [(t, topic, replace(topic, message) if replace else message) for t, topic, message in kept]


BAGS = [
    ({"without": "/tf"}, "expected transforms (/tf) that move 'camera_optical', or poses", "among 4 topics"),
    ({"without": "depth"}, "a topic with depth images", COLOR),
    ({"without": f"{COLOR}/image"}, "a topic with colour images", DEPTH),
    ({"without": "camera_info"}, f"a CameraInfo topic beside {DEPTH}", "none"),
]


@pytest.mark.parametrize(("change", "expected", "found"), BAGS)
def test_bags_that_lack_something(tmp_path: Path, change: dict, expected: str, found: str) -> None:
    make, path = Messages(Stores.ROS1_NOETIC), tmp_path / "drive.bag"
    write_bag1(path, changed(entries(make), **change), make)
    with pytest.raises(InputError) as caught:
        open_sequence(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: expected") and "\n" not in message
    assert expected in message and found in message.partition("found")[2]


@pytest.mark.parametrize("writer", [ros1_bag, ros2_sqlite, ros2_mcap, rerun_rrd])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.9])
def test_robots_recordings_cut_short(tmp_path: Path, writer, share: float) -> None:
    path = writer(tmp_path).path
    file = path if path.is_file() else next(path.glob("*.db3"))
    cut(share=share)(file)
    if writer is ros2_mcap and share == 0.9:  # only the index behind the messages is missing
        assert len(open_sequence(path)) == FRAMES
        return
    with pytest.raises(InputError, match="expected") as caught:
        open_sequence(path)
        assert len(open_sequence(path)) == 4
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_lost_and_unpaired_frames_are_told(tmp_path: Path) -> None:
    notes = {w.__name__: open_sequence(w(tmp_path / w.__name__).path).notes for w in (tum, scannet, sens, polycam)}  # pyright: ignore
    assert notes == {
        "tum": ("1 of 5 depth images have no colour or pose of their time: left out",),
        "scannet": ("1 of 5 frames have no pose, tracking was lost: left out",),
        "sens": ("1 of 5 frames have no pose, tracking was lost: left out",),
        "polycam": ("1 of 5 pictures have no depth: left out",),
    }
    path = tmp_path / "polycam"
    (camera,) = sorted(path.rglob("corrected_cameras/*.json"))[:1]
    camera.unlink()
    assert "1 of 5 pictures have no corrected camera: left out" in open_sequence(camera.parents[2]).notes
