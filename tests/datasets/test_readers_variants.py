"""Legal variants of each format, as other programs and people write it: the very frames of the usual way."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.typesys import Stores
from scans import write_image
from scans_apps import record3d_folder
from scans_bags import DEPTH, Messages, entries, write_bag1
from scans_folders import (
    amazon,
    arkit,
    bundle_fusion,
    habitat,
    nerfstudio,
    polycam,
    replica,
    scannet,
    sens,
    seven_scenes,
    tum,
)
from scipy.spatial.transform import Rotation
from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.checking.recording import open_recording
from simaps_viz.datasets.calibration import numbers
from simaps_viz.datasets.images import read_color
from simaps_viz.datasets.ros_messages import decode_depth
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.tum import BONN_CAMERA, BONN_NOTE, BONN_WORLD
from simaps_viz.errors import InputError

pytestmark = pytest.mark.slow  # each variant of a format is written and opened anew

TEXT = (".txt", ".json", ".traj", ".pincam")


def as_windows_writes(folder: Path) -> None:
    """Return every text file Windows' line ends, and the mark that its editor puts first."""
    for path in folder.rglob("*"):
        if path.suffix in TEXT:
            path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))


def smaller_scannet(folder: Path) -> None:
    for which in ("depth", "color"):
        (folder / "intrinsic" / f"intrinsic_{which}.txt").rename(folder / f"intrinsics_{which}.txt")
    for path in (folder / "intrinsic").iterdir():
        path.unlink()
    (folder / "intrinsic").rmdir()


def same_frames(found: PosedFrames, expected: PosedFrames, indices: list[int] | None = None) -> None:
    indices = list(range(len(expected))) if indices is None else indices
    assert len(found) == len(indices)
    assert found.intrinsics == expected.intrinsics
    np.testing.assert_allclose(found.poses, expected.poses[indices], atol=1e-12)
    for i, index in enumerate(indices):
        np.testing.assert_allclose(found.read(i).depth_m, expected.read(index).depth_m, atol=1e-6)


@pytest.mark.parametrize(
    ("writer", "change"),
    [
        *((writer, as_windows_writes) for writer in (tum, scannet, replica, nerfstudio, habitat, arkit, polycam)),
        (scannet, smaller_scannet),
    ],
)
def test_other_ways_to_write_the_same(tmp_path: Path, writer: Callable, change: Callable[[Path], None]) -> None:
    usual, other = writer(tmp_path / "usual").path, writer(tmp_path / "other").path
    change(other)
    same_frames(open_sequence(other), open_sequence(usual))


def test_a_sequence_of_our_own_from_a_windows_editor(tmp_path: Path) -> None:
    usual, other = write_tiny_sequence(tmp_path / "usual"), write_tiny_sequence(tmp_path / "other")
    as_windows_writes(tmp_path / "other")
    same_frames(open_sequence(other), open_sequence(usual))
    np.testing.assert_array_equal(open_recording(other).matrices, open_recording(usual).matrices)


def test_the_folder_of_a_scan_with_its_sens_file(tmp_path: Path) -> None:
    file = sens(tmp_path / "usual").path
    folder = tmp_path / "scene0707_00"
    folder.mkdir()
    (folder / "scene0707_00.sens").write_bytes(file.read_bytes())
    (folder / "scene0707_00.txt").write_text("numDepthFrames = 4\n")
    same_frames(open_sequence(folder), open_sequence(file))


def test_frames_without_depth_are_left_out(tmp_path: Path) -> None:
    usual, other = nerfstudio(tmp_path / "usual").path, nerfstudio(tmp_path / "other").path
    content = json.loads((other / "transforms.json").read_text())
    content["frames"].sort(key=lambda frame: frame["file_path"])
    del content["frames"][1]["depth_file_path"]
    content["frames"].reverse()
    (other / "transforms.json").write_text(json.dumps(content))
    found = open_sequence(other)
    same_frames(found, open_sequence(usual), [0, 2, 3])
    assert found.notes == ("1 of 4 frames have no depth: left out",)


def test_a_wrong_unit_far_off_is_found_and_nothing_else_is_blamed(tmp_path: Path) -> None:
    path = nerfstudio(tmp_path).path
    content = json.loads((path / "transforms.json").read_text()) | {"depth_unit_scale_factor": 1e-6}
    (path / "transforms.json").write_text(json.dumps(content))
    right = open_recording(nerfstudio(tmp_path / "right").path)
    off = open_recording(path)
    assert off.unit_m < 1e-5
    factor = right.unit_m / off.unit_m * 1e-3
    np.testing.assert_allclose(off.depth_steps(0) / factor, right.depth_steps(0), atol=0.5)


def test_scannet_s_exporter_may_shrink_the_pictures_alone(tmp_path: Path) -> None:
    usual, other = scannet(tmp_path / "usual").path, scannet(tmp_path / "other").path
    color = np.array(np.loadtxt(other / "intrinsic/intrinsic_color.txt"))
    picture = cv2.imread(str(next((other / "color").iterdir())))
    assert picture is not None
    large, (height, width) = color.copy(), picture.shape[:2]
    large[0] *= 1296 / width
    large[1] *= 968 / height
    large[:2, 2] += (1296 / width - 1) / 2, (968 / height - 1) / 2
    np.savetxt(other / "intrinsic/intrinsic_color.txt", large)
    found, expected = open_sequence(other), open_sequence(usual)
    size = f"{width}x{height}"
    assert found.notes == (f"pictures of {size} pixels, intrinsic_color.txt is of 1296x968: scaled", *expected.notes)
    np.testing.assert_allclose(found.color(1).astype(int), expected.color(1), atol=1)


def test_polycam_s_corrected_cameras_without_a_size_and_a_mac_s_files_beside_them(tmp_path: Path) -> None:
    usual, other = polycam(tmp_path / "usual").path, polycam(tmp_path / "other").path
    for file in (other / "keyframes/corrected_cameras").iterdir():
        content = json.loads(file.read_text())
        del content["width"], content["height"]
        file.write_text(json.dumps(content))
    for file in [file for file in (other / "keyframes").rglob("*") if file.is_file()]:
        file.with_name(f"._{file.name}").write_bytes(b"\0\5\x16\7")
    found, expected = open_sequence(other), open_sequence(usual)
    same_frames(found, expected)
    assert found.notes == expected.notes


def test_bonn_s_poses_are_carried_over_from_the_markers_to_the_camera(tmp_path: Path) -> None:
    """T_ros T T_ros T_m, as the dataset's page has it; its T_m scales by 1.059, which is no motion."""
    usual, other = tum(tmp_path / "usual").path, tum(tmp_path / "other").path
    T_ros = np.array([[-1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(BONN_WORLD, T_ros)
    scaled = [[1.0157, 0.1828, -0.2389], [0.0009, -0.8431, -0.6413], [-0.3009, 0.6147, -0.8085]]
    np.testing.assert_allclose(1.059 * BONN_CAMERA[:3, :3], scaled, atol=2e-3)
    np.testing.assert_allclose(BONN_CAMERA[:, 3], [0.0113, -0.0098, 0.0111, 1.0])
    lines = (other / "groundtruth.txt").read_text().splitlines()
    for i, line in enumerate(lines):
        if not line.startswith("#"):
            time, *row = map(float, line.split())
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = Rotation.from_quat(row[3:]).as_matrix(), row[:3]
            T = T_ros.T @ T @ np.linalg.inv(BONN_CAMERA) @ T_ros.T
            values = *T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat()
            lines[i] = " ".join([f"{time:.4f}", *(f"{value:.15g}" for value in values)])
    (other / "groundtruth.txt").write_text("\n".join(lines))
    other = other.rename(other.with_name("rgbd_bonn_seats"))
    found, expected = open_sequence(other), open_sequence(usual)
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-6)
    assert found.notes[-1].startswith("poses are of markers on the camera") or BONN_NOTE in found.notes
    assert found.intrinsics.fx != expected.intrinsics.fx


def test_a_sens_file_whose_first_pose_is_none_does_not_say_where_up_is(tmp_path: Path) -> None:
    """BundleFusion's begin at the first camera; ScanNet's are turned until z is up."""
    path = sens(tmp_path).path
    assert open_recording(path).up == (0.0, 0.0, 1.0)
    data, at = bytearray(path.read_bytes()), 4 + 8 + 15 + 4 * 64 + 36
    data[at : at + 64] = np.eye(4, dtype="<f4").tobytes()
    path.write_bytes(data)
    assert open_recording(path).up is None


def test_poses_that_are_all_the_same_are_told(tmp_path: Path) -> None:
    path = nerfstudio(tmp_path).path
    content = json.loads((path / "transforms.json").read_text())
    for frame in content["frames"]:
        frame["transform_matrix"] = np.eye(4).tolist()
    (path / "transforms.json").write_text(json.dumps(content))
    told = "all 4 poses are the same: the camera stood still, or none were recorded"
    assert told in open_sequence(path).notes


def test_habitat_with_jpg(tmp_path: Path) -> None:
    usual, other = habitat(tmp_path / "usual").path, habitat(tmp_path / "other").path
    for path in (other / "rgb").glob("*.png"):
        image = cv2.imread(str(path))
        assert image is not None
        cv2.imwrite(str(path.with_suffix(".jpg")), image)
        path.unlink()
    same_frames(open_sequence(other), open_sequence(usual))


def test_a_robot_in_its_own_namespace(tmp_path: Path) -> None:
    make = Messages(Stores.ROS1_NOETIC)
    write_bag1(tmp_path / "usual.bag", entries(make), make)
    write_bag1(tmp_path / "other.bag", [(t, f"/robot_1{topic}", m) for t, topic, m in entries(make)], make)
    same_frames(open_sequence(tmp_path / "other.bag"), open_sequence(tmp_path / "usual.bag"))


STEPS = np.array([[0, 700, 1234], [2500, 5000, 9000]], np.uint16)


def packed(format: str, png: np.ndarray, header: bytes) -> np.ndarray:
    message = Messages(Stores.ROS1_NOETIC).compressed(0.0, header + cv2.imencode(".png", png)[1].tobytes(), format)
    return decode_depth(DEPTH, message)


@pytest.mark.parametrize(
    ("format", "header"),
    [("16UC1; compressedDepth", bytes(12)), ("16UC1; compressedDepth png", bytes(12)), ("16UC1; png compressed ", b"")],
)
def test_compressed_depth_of_sixteen_bits(format: str, header: bytes) -> None:
    np.testing.assert_allclose(packed(format, STEPS, header), STEPS * 0.001, rtol=1e-6)


def test_compressed_depth_of_metres() -> None:
    """Stored are a / z + b, rounded down: fine close by, coarse far away (compressed_depth_image_transport)."""
    quantum, farthest_m = 100.0, 10.0
    a = quantum * (quantum + 1)
    b = 1 - a / farthest_m
    depth = STEPS * 0.001
    with np.errstate(divide="ignore"):
        stored = np.where(depth > 0, a / depth + b, 0).astype(np.uint16)
    found = packed("32FC1; compressedDepth png", stored, struct.pack("<iff", 0, a, b))
    assert found[0, 0] == 0
    assert (np.abs(found - depth) <= depth**2 / a + 1e-6).all()


def test_compressed_depth_that_is_not_read() -> None:
    with pytest.raises(InputError, match="16UC1 or 32FC1, found '8UC1; compressedDepth png'"):
        packed("8UC1; compressedDepth png", STEPS, bytes(12))
    with pytest.raises(InputError, match="one channel of 16 bits, found uint8"):
        packed("16UC1; compressedDepth", STEPS.astype(np.uint8), bytes(12))


@pytest.mark.slow
def test_a_kinects_two_cameras_are_brought_together(tmp_path: Path) -> None:
    """7-Scenes has raw pictures: depth is carried over to the colour camera, 25 mm beside, and takes its pixels."""
    sample = seven_scenes(tmp_path)
    found, expected = open_sequence(sample.path), open_sequence(sample.reference)
    assert found.intrinsics == expected.intrinsics
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-12)
    assert "registered to colour" in found.notes[0] and found.name == "chess seq-01"
    for index in range(len(expected)):
        a, b = found.read(index), expected.read(index)
        seen = (a.depth_m > 0) & (b.depth_m > 0)
        inner = np.s_[40:-40, 50:-50]  # colour sees more to all sides
        assert seen[inner].sum() > 0.97 * (b.depth_m[inner] > 0).sum()
        assert (np.abs(a.depth_m - b.depth_m)[seen] < 0.02).mean() > 0.98
        np.testing.assert_array_equal(found.color(index), expected.color(index))
        assert found.color_file(index) == sample.path / f"frame-{index:06d}.color.png"


@pytest.mark.slow
def test_3dmatchs_copies_of_7_scenes_are_a_kinects_too(tmp_path: Path) -> None:
    """They name its depth camera, 585 pixels, and have JPEG and 0 for no reading, but the pictures are as raw."""
    usual, other = seven_scenes(tmp_path / "usual").path, seven_scenes(tmp_path / "other").path
    for file in other.glob("*.depth.png"):
        raw = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert raw is not None
        cv2.imwrite(str(file), np.where(raw == 65535, 0, raw))
    for file in other.glob("*.color.png"):
        write_image(file.with_suffix(".jpg"), read_color(file))
        file.unlink()
    other = other.rename(other.parent / "rgbd-frames")
    with pytest.raises(InputError, match=r"a camera in camera-intrinsics\.txt \(3x3, pixels\) or info\.txt"):
        open_sequence(other)
    (other.parent / "camera-intrinsics.txt").write_text("585 0 320\r\n0 585 240\r\n0 0 1\r\n")
    same_frames(open_sequence(other), open_sequence(usual))


def test_a_camera_that_is_named_is_colours_and_depths(tmp_path: Path) -> None:
    """SUN3D and most of 3DMatch: depth is registered to colour already, and is not again."""
    path = seven_scenes(tmp_path).path
    (path / "camera-intrinsics.txt").write_text("570.3 0 320\n0 570.3 240\n0 0 1\n")
    found = open_sequence(path)
    assert (found.intrinsics.fx, found.notes) == (570.3, ())
    raw = cv2.imread(str(path / "frame-000000.depth.png"), cv2.IMREAD_UNCHANGED)
    assert raw is not None
    np.testing.assert_allclose(found.read(0).depth_m, np.where(raw == 65535, 0, raw) * 0.001, atol=1e-6)


@pytest.mark.parametrize(
    ("camera", "unit_m"), [("camera-intrinsics.txt", 0.001), ("camera-intrinsics.color.txt", 0.0001)]
)
def test_depth_whose_bits_are_rotated_is_rotated_back(tmp_path: Path, camera: str, unit_m: float) -> None:
    """SUN3D, and MIT and Princeton's Amazon challenge: left by three; depth beyond 8191 steps sets the lowest."""
    path = seven_scenes(tmp_path).path
    (path / camera).write_text("570.3 0 320\n0 570.3 240\n0 0 1\n")
    steps = np.linspace(400, 12_000, 640 * 480).reshape(480, 640).astype(np.uint16)
    steps[:5] = 0
    for file in path.glob("*.depth.png"):
        cv2.imwrite(str(file), steps << 3 | steps >> 13)
    found = open_sequence(path)
    np.testing.assert_allclose(found.read(0).depth_m, steps * unit_m, rtol=1e-5)
    assert any("rotated" in note for note in found.notes)
    for file in path.glob("*.depth.png"):
        cv2.imwrite(str(file), steps)
    plain = open_sequence(path)
    np.testing.assert_allclose(plain.read(0).depth_m, steps * 0.001, rtol=1e-5)
    assert not any("rotated" in note for note in plain.notes)


def test_poses_and_camera_of_the_amazon_challenge_in_one_file(tmp_path: Path) -> None:
    """A frame that the file leaves out is; its world is the robot's, z up; a row that is cut short is told."""
    info = amazon(tmp_path).path / "cam.info.txt"
    found = open_sequence(info.parent)
    np.testing.assert_array_equal(found.T_map_world[2, :3], (0, 0, 1))
    text = info.read_text()
    info.write_text(text[: text.rindex("# Camera-to-world")])
    assert open_sequence(info.parent).frame_names == found.frame_names[:-1]
    info.write_text(text.replace("\n0.0 0.0 1.0\n", "\n0.0 0.0\n", 1))
    with pytest.raises(InputError, match=r"cam.info.txt: Color camera intrinsic matrix: expected a matrix, found rows"):
        open_sequence(info.parent)


def test_the_camera_of_tsdf_fusions_older_sample_is_found(tmp_path: Path) -> None:
    path = seven_scenes(tmp_path).path
    (path / "intrinsics.K.txt").write_text("615.195 0 298.4427\n0 615.195 247.5192\n0 0 1\n")
    found = open_sequence(path)
    assert (found.intrinsics.fx, found.intrinsics.cx) == (615.195, 298.4427)


def test_depth_as_3rscan_writes_it(tmp_path: Path) -> None:
    usual, other = bundle_fusion(tmp_path / "usual").path, bundle_fusion(tmp_path / "other").path
    for file in other.glob("*.depth.png"):
        raw = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert raw is not None
        cv2.imwrite(str(file.with_suffix(".pgm")), raw)
        file.unlink()
    (other.parent / "info.txt").rename(other / "_info.txt")
    found = open_sequence(other)
    same_frames(found, open_sequence(usual))
    assert found.notes == ("1 of 5 frames have no pose, tracking was lost: left out",)
    cut = other / "frame-000001.depth.pgm"
    cut.write_bytes(cut.read_bytes()[:-1])
    with pytest.raises(InputError, match=r"a truncated PGM \(6143 of 6144 bytes of pixels\)"):
        found.read(1)


def test_numbers_as_windows_programs_print_them(tmp_path: Path) -> None:
    words = ["1.#INF", "-1.#INF", "1.#IND", "-1.#IND", "1.#QNAN0", "-nan(ind)", "inf", "-inf", "nan", "1e3"]
    found = numbers("here", words)
    np.testing.assert_array_equal(found, [np.inf, -np.inf, *[np.nan] * 4, np.inf, -np.inf, np.nan, 1000.0])
    for word in ("1.#", "infx", "1,5"):
        with pytest.raises(InputError, match="expected numbers"):
            numbers("here", [word])


def test_columns_named_without_a_comment_mark(tmp_path: Path) -> None:
    """As pandas and some people's scripts write TUM's lists."""
    usual, other = tum(tmp_path / "usual").path, tum(tmp_path / "other").path
    (other / "rgb.txt").write_text("timestamp filename\n" + (other / "rgb.txt").read_text())
    same_frames(open_sequence(other), open_sequence(usual))


def test_a_world_of_record3d_that_starts_at_the_camera_has_no_up(tmp_path):
    path = record3d_folder(tmp_path).path
    assert open_sequence(path).recording.facts.up == (0.0, 1.0, 0.0)
    metadata = json.loads((path / "metadata").read_text())
    turns, places = (np.array(metadata["poses"])[:, part] for part in (slice(4), slice(4, 7)))
    back = Rotation.from_quat(turns[0]).inv()
    turns, places = (back * Rotation.from_quat(turns)).as_quat(), back.apply(places - places[0])
    metadata["poses"] = np.column_stack([turns, places]).tolist()
    (path / "metadata").write_text(json.dumps(metadata))
    assert open_sequence(path).recording.facts.up is None
