"""Faulty recordings: one line that names the file, what was expected and what was found."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores
from scans import FRAMES, Sample
from scans_apps import record3d_folder, record3d_zip
from scans_bags import COLOR, DEPTH, Messages, entries, ros1_bag, ros2_mcap, ros2_sqlite, write_bag1
from scans_folders import arkit, habitat, nerfstudio, polycam, replica, scannet, sens, seven_scenes, tum
from scans_rerun import rerun_rrd

from simaps_viz import open_sequence
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
FAULTS: list[tuple[Callable[[Path], Sample], Change, str, str, str]] = [
    (tum, remove("rgb/100.096000.png"), "100.096000.png", "a colour file for each of 4 frames", "none for 1"),
    (tum, lines("groundtruth.txt", lambda x: x[:2]), "groundtruth.txt", "lines of 8 numbers", "none"),
    (tum, lines("groundtruth.txt", lambda x: [*x, "1 2 3"]), "groundtruth.txt, line 29", "8 numbers", "3"),
    (tum, lines("groundtruth.txt", lambda x: [*x, "200 0 0 0 0 0 0 3"]), "line 29", "quaternion of length 1", "3"),
    (tum, lines("depth.txt", lambda x: [*x, "100"]), "depth.txt, line 7", "a time and a file", "1 words"),
    (tum, lines("rgb.txt", lambda x: ["5000 " + x[1].split()[1]]), "seats", "of about the same time", "5 depth images"),
    (seven_scenes, remove("frame-000002.pose.txt"), "frame-000002.pose.txt", "a text file", "No such file"),
    (seven_scenes, remove("frame-000002.color.png"), "frame-000002.color.png", "a colour file", "none for 1"),
    (seven_scenes, text("frame-000002.pose.txt", "1 0 0"), "frame-000002.pose.txt", "a 4x4 matrix", "3 numbers"),
    (seven_scenes, text("frame-000001.pose.txt", "2 " * 16), "frame-000001.pose.txt", "0 0 0 1", "2 2 2 2"),
    (seven_scenes, text("frame-000001.pose.txt", "x " * 16), "frame-000001.pose.txt", "numbers", "'x'"),
    (seven_scenes, cut("frame-000000.depth.png"), "frame-000000.depth.png", "a whole image", "truncated PNG"),
    (scannet, remove("intrinsic/intrinsic_color.txt"), "intrinsic_color.txt", "a text file", "No such file"),
    (scannet, remove("pose/2.txt"), "pose/2.txt", "a text file", "No such file"),
    (scannet, text("scene0000_00.aggregation.json", "{}"), "aggregation.json", '"segGroups"', "{}"),
    (scannet, values("scene0000_00.aggregation.json", lambda c: c["segGroups"].pop()), "0.png", "only ids", "1"),
    (replica, remove("results/frame000003.jpg"), "results", "4 colour images", "3"),
    (replica, lines("traj.txt", lambda x: x[:-1]), "traj.txt", "4 poses", "3"),
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
    (nerfstudio, values("transforms.json", lambda c: c["frames"][0].update(transform_matrix=[1])),
     "frame_00003", "4x4", "1 numbers"),
    (nerfstudio, values("transforms.json", lambda c: c.pop("fl_x")), "fl_x", "a number", "none"),
    (nerfstudio, text("transforms.json", "{"), "transforms.json", "JSON", "line 1"),
    (habitat, remove("rgb/000001.png"), "rgb", "4 colour images", "3"),
    (habitat, remove("semantic/000001.npy"), "semantic", "4 semantic arrays", "3"),
    (habitat, cut("depth/000000.npy"), "depth/000000.npy", "a complete NumPy array", "truncated"),
    (habitat, text("obj2cls_dict.txt", "chair 5"), "obj2cls_dict.txt, line 1", "object:class,name", "chair 5"),
    (habitat, lambda f: np.save(f / "semantic/000000.npy", np.full((48, 64), -1)), "000000.npy", "0 to 65535", "int64"),
    (habitat, lambda f: np.save(f / "semantic/000000.npy", np.zeros((4, 64), int)), "000000.npy", "64x48", "64x4"),
    (arkit, lines(f"{ARKIT}/lowres_wide.traj", lambda x: [*x, "1 2"]), "lowres_wide.traj, line 9", "7 numbers", "2"),
    (arkit, text(f"{ARKIT}/lowres_wide_intrinsics/41069021_99.999.pincam", "1 2"), "pincam, line 1", "6 numbers", "2"),
    (polycam, values("keyframes/corrected_cameras/12345678902.json", lambda c: c.pop("t_12")),
     "12345678902.json: t_12", "a number", "none"),
    (polycam, remove("keyframes/corrected_images/12345678902.jpg"), "12345678902.jpg", "a colour file", "none for 1"),
    (record3d_zip, cut(), "seats.r3d", "a Record3D archive", "not a zip"),
    (record3d_folder, values("metadata", lambda c: c["poses"].pop()), "metadata", "4 poses", "3"),
    (record3d_folder, cut("rgbd/0.depth"), "rgbd/0.depth", "LZFSE floats", "truncated"),
    (record3d_folder, remove("rgbd/0.depth"), "rgbd/0.depth", "a file a frame", "No such file"),
    (record3d_folder, values("metadata", lambda c: c.update(dw=47)), "rgbd/0.depth", "47x64 depths", "3072"),
    (sens, cut(), "scene0001_00.sens", "5 frames", "cut short in frame"),
    (sens, cut(share=0.001), "scene0001_00.sens", "a whole .sens file", "ends after"),
    (sens, lambda p: p.write_bytes(b"\x03\0\0\0" + p.read_bytes()[4:]), ".sens", "version 4", "version 3"),
]  # fmt: skip


@pytest.mark.parametrize(("writer", "change", "names", "expected", "found"), FAULTS)
def test_faults(tmp_path: Path, writer, change: Change, names: str, expected: str, found: str, capfd) -> None:
    sample = writer(tmp_path)
    open_sequence(sample.path)
    change(sample.path)
    with pytest.raises(InputError) as caught:
        open_sequence(sample.path)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 400 + len(str(sample.path))
    assert names in message
    before, word, after = message.partition("found")
    assert word and "expected" in before and expected in message and found in after
    assert capfd.readouterr() == ("", ""), "decoders say nothing of their own"


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


@pytest.mark.parametrize("index", [-1, 4])
def test_no_such_frame(tmp_path: Path, index: int) -> None:
    sequence = open_sequence(replica(tmp_path).path)
    for read in (sequence.read, sequence.color, sequence.segmentation):
        with pytest.raises(InputError, match=f"a frame index from 0 to 3, found {index}"):
            read(index)
