"""Laser scans: file formats read exactly, clouds seen by the camera as it would see them, faults in one line."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from map_equality import same_maps
from rosbags import rosbag2
from rosbags.typesys import Stores
from scans import FRAMES, Z_UP, camera, look, map_pose, write_depth, write_reference
from scans_bags import Messages, write_bag2
from scans_clouds import (
    DRIVE,
    LIDAR,
    T_LIDAR_CAMERA,
    cloud_entries,
    cloud_of,
    kitti360,
    lidar,
    lidar_poses,
    lzf_pack,
    pcd,
    ply,
    write_scan,
)

from simaps_viz import BuildConfig, build_map, open_sequence
from simaps_viz.datasets.clouds import CloudSettings, depth_of_cloud, gap_pixels, lzf_unpack, read_pcd, read_ply
from simaps_viz.datasets.convert import write_posed_frames
from simaps_viz.errors import InputError
from simaps_viz.geometry import back_project, transform_points
from simaps_viz.structures import Intrinsics

POINTS = np.random.default_rng(3).normal(size=(200, 3)) * [1, 10, 100]


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", ["double", "float"])
def test_ply(tmp_path, form, kind):
    points = POINTS.astype(np.float32).astype(np.float64) if kind == "float" else POINTS
    (tmp_path / "a.ply").write_bytes(ply(points, form, kind))
    np.testing.assert_array_equal(read_ply(tmp_path / "a.ply"), points)


@pytest.mark.parametrize("stored", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("size", [4, 8])
def test_pcd(tmp_path, stored, size):
    points = POINTS.astype(f"f{size}").astype(np.float64)
    (tmp_path / "a.pcd").write_bytes(pcd(points, stored, size))
    np.testing.assert_array_equal(read_pcd(tmp_path / "a.pcd"), points, "and without the one that is NaN")


@pytest.mark.parametrize("stored", ["binary", "binary_compressed"])
def test_pcd_as_pcl_pads_it(tmp_path, stored):
    """The header of an Ouster's cloud (PDAL issue 3254): fields "_" of 1 byte, several times, or not at all."""
    kinds = ("f4", "f4", "f4", "u1", "f4", "u4", "u2", "u1", "u1", "u2", "u1", "u4", "u1")
    counts = (1, 1, 1, 4, 1, 1, 1, 1, 0, 1, 0, 1, 15)
    rng = np.random.default_rng(0)
    columns = [rng.integers(0, 200, (9, n)).astype(f"<{kind}") for kind, n in zip(kinds, counts, strict=True)]
    for i in range(3):
        columns[i][:, 0] = POINTS[:9, i]
    header = f"""# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z _ intensity t reflectivity ring _ noise _ range _
SIZE {" ".join(kind[1] for kind in kinds)}
TYPE F F F U F U U U U U U U U
COUNT {" ".join(map(str, counts))}
WIDTH 9
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 9
DATA {stored}
"""
    by_point = b"".join(column[i].tobytes() for i in range(9) for column in columns)
    body = by_point
    if stored == "binary_compressed":
        packed = lzf_pack(b"".join(column.tobytes() for column in columns))
        body = struct.pack("<II", len(packed), len(by_point)) + packed
    (tmp_path / "a.pcd").write_bytes(header.encode() + body)
    np.testing.assert_array_equal(read_pcd(tmp_path / "a.pcd"), POINTS[:9].astype(np.float32))


@given(st.binary(max_size=700), st.integers(1, 12))
def test_lzf_unpacks_what_was_packed(data, repeats):
    data = data * repeats
    assert lzf_unpack("x", lzf_pack(data), len(data)) == data


@given(st.binary(max_size=200), st.integers(0, 2000))
@settings(max_examples=60)
def test_lzf_never_writes_outside(packed, size):
    try:
        assert len(lzf_unpack("x", packed, size)) == size
    except InputError as error:
        assert "unpacked" in str(error)


@given(st.data())
@settings(max_examples=50, deadline=None)
def test_damaged_clouds_are_refused_or_read(tmp_path_factory, data):
    """Any byte changed, any end cut: points or an InputError, nothing else."""
    kind = data.draw(st.sampled_from(["ply", "ascii.ply", "pcd", "ascii.pcd", "packed.pcd"]))
    whole = {
        "ply": lambda: ply(POINTS[:9]), "ascii.ply": lambda: ply(POINTS[:9], "ascii"), "pcd": lambda: pcd(POINTS[:9]),
        "ascii.pcd": lambda: pcd(POINTS[:9], "ascii"), "packed.pcd": lambda: pcd(POINTS[:9], "binary_compressed"),
    }[kind]()  # fmt: skip
    spoiled = bytearray(whole[: data.draw(st.integers(0, len(whole)))])
    for _ in range(data.draw(st.integers(0, 3)) if spoiled else 0):
        spoiled[data.draw(st.integers(0, len(spoiled) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("cloud") / f"a.{kind}"
    file.write_bytes(bytes(spoiled))
    try:
        points = (read_ply if kind.endswith("ply") else read_pcd)(file)
    except InputError as error:
        assert str(error).startswith(f"{file}: ") and "\n" not in str(error)
    else:
        assert points.shape[1:] == (3,) and np.isfinite(points).all()


K = Intrinsics(40, 30, 40.0, 40.0, 19.5, 14.5)


def test_points_at_pixel_centres_give_the_depth_back():
    depth_m = np.random.default_rng(0).uniform(0.5, 5, (30, 40)).astype(np.float32)
    points = back_project(depth_m, K.fx, K.fy, K.cx, K.cy).reshape(-1, 3)
    rng = np.random.default_rng(1)
    behind = np.vstack([points * 1.5, [[0, 0, -1], [0, 0, 0], [50, 0, 1]]])
    seen = depth_of_cloud(rng.permutation(np.vstack([points, behind])), K, CloudSettings())
    np.testing.assert_array_equal(seen, depth_m)


def test_nothing_shows_through_a_thin_near_surface():
    """A wall at 3 m, a table at 1 m of which every fifth point was met: the wall behind the table is hidden."""
    wall = back_project(np.full((30, 40), 3, np.float32), K.fx, K.fy, K.cx, K.cy)
    table = back_project(np.full((30, 40), 1, np.float32), K.fx, K.fy, K.cx, K.cy)[5:25:5, 10:30:5].reshape(-1, 3)
    seen = depth_of_cloud(np.vstack([wall[::3, ::3].reshape(-1, 3), table]), K, CloudSettings(hidden_pixels=3))
    inside = seen[5:21, 10:26]
    assert set(np.unique(inside)) == {0, 1} and (inside == 1).sum() == len(table)
    assert (seen[:, 33:] == 3).sum() == 30 // 3 * 3 and (seen == 3).any(axis=0).sum() > 4
    filled = depth_of_cloud(table, K, CloudSettings(hidden_pixels=0, fill_pixels=4))
    assert (filled[5:21, 10:26] == 1).all() and (filled[:, 31:] == 0).all()


@pytest.mark.parametrize("every", [1, 2, 3, 5])
def test_gaps_are_measured(every):
    depth_m = np.zeros((60, 80), np.float32)
    depth_m[10:50:every, 5:70:every] = 2
    assert gap_pixels(depth_m) == every // 2
    assert gap_pixels(np.zeros((4, 4), np.float32)) == 0


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> Path:
    return write_reference(tmp_path_factory.mktemp("reference") / "frames", camera(), Z_UP)


def scan(folder: Path, reference: Path, points, suffix: str = "ply", pack=ply, **keys) -> Path:
    clouds = {f"clouds/{i}.{suffix}": pack(points(i)) for i in range(FRAMES)}
    poses = keys.pop("poses_of", lidar_poses())
    return write_scan(folder, reference, clouds, poses, clouds=f"clouds/{{frame}}.{suffix}", **keys)


def in_lidar(i):
    return transform_points(T_LIDAR_CAMERA, cloud_of(i))


WAYS = {
    "packed pcd": {"points": in_lidar, "suffix": "pcd", "pack": lambda p: pcd(p, "binary_compressed")},
    "ascii pcd": {"points": in_lidar, "suffix": "pcd", "pack": lambda p: pcd(p, "ascii", 8)},
    "float ply": {"points": in_lidar, "pack": lambda p: ply(p, "binary_big_endian", "float")},
    "poses of the camera": {"points": in_lidar, "pose": "T_world_camera",
                            "poses_of": [Z_UP.pose(i) for i in range(FRAMES)]},
    "no up": {"points": in_lidar, "up": None},
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("method", ["evidence", "paper"])
def test_the_map_is_that_of_the_same_frames(tmp_path, reference, way, method):
    folder = scan(tmp_path / "scan", reference, **WAYS[way])
    if way == "no up":
        manifest = json.loads((reference / "sequence.json").read_text())
        manifest.pop("up")
        other = reference / "without-up.json"
        other.write_text(json.dumps(manifest))
    expected = open_sequence(other if way == "no up" else reference)
    same_maps(build_map(open_sequence(folder), BuildConfig(method=method)),
              build_map(expected, BuildConfig(method=method)))  # fmt: skip


@pytest.mark.parametrize("told", [False, True])
def test_one_cloud_of_the_whole_place(tmp_path, reference, told):
    """A laser scanner's cloud and posed pictures: what a camera cannot see of it does not get on the map twice."""
    world = np.vstack([transform_points(Z_UP.pose(i), cloud_of(i)) for i in range(FRAMES)])
    folder = write_scan(
        tmp_path / "scan", reference, {"all.ply": ply(world)}, [Z_UP.pose(i) for i in range(FRAMES)],
        clouds="all.ply", points="world", pose="T_world_camera", T_lidar_camera=None,
        **({"floor_height_m": 0.3} if told else {}),
    )  # fmt: skip
    sequence = open_sequence(folder)
    assert abs(sequence.T_map_world[2, 3] + 0.3) < (1e-12 if told else 0.01)
    found, expected = build_map(sequence), build_map(open_sequence(reference))
    assert found.counts() == expected.counts() == {"chair": 2}
    shared = np.zeros(2)
    for one in expected.instances:
        x, y, _ = one.centroid_m
        other = found.at(x, y)
        assert other is not None and np.allclose(other.centroid_m, one.centroid_m, atol=0.05)
        shared += other.cells, one.cells
    assert 0.8 < shared[0] / shared[1] < 1.2


@pytest.mark.parametrize(("share", "options", "method"), [(0.15, {}, "evidence"), (0.15, {"fill_pixels": 3}, "paper")])
def test_thin_clouds_still_give_the_objects(tmp_path, reference, share, options, method):
    """A LiDAR sees a part of the pixels; the floor is still found, and so are both chairs."""
    rng = np.random.default_rng(5)
    folder = scan(tmp_path / "scan", reference, lambda i: in_lidar(i)[rng.random(len(cloud_of(i))) < share], **options)
    sequence = open_sequence(folder)
    filled = (sequence.read(0).depth_m > 0).mean()
    assert (0.9 < filled < 1.0) if options else (filled == pytest.approx(share, abs=0.01))
    assert abs(sequence.T_map_world[2, 3] + Z_UP.floor_height_m) < 0.01
    simap = build_map(sequence, BuildConfig(method=method, min_cells=8))
    assert simap.counts() == {"chair": 2}
    for one, x in zip(sorted(simap.instances, key=lambda i: i.centroid_m[0]), (-0.45, 0.45), strict=True):
        assert np.allclose(one.centroid_m[:2], (x, 0.0), atol=0.1) and abs(one.centroid_m[2] - 0.5) < 0.02


def test_convert_keeps_the_map(tmp_path):
    sample = lidar(tmp_path)
    sequence = open_sequence(sample.path)
    assert sequence.simulated is False and sequence.ground_truth
    write_posed_frames(sequence, tmp_path / "out")
    same_maps(build_map(open_sequence(tmp_path / "out")), build_map(sequence))


@pytest.mark.parametrize("way", ["odometry", "registered"])
def test_bags_with_clouds(tmp_path, reference, way):
    """Poses from odometry; or clouds that a SLAM program has put into the world already."""
    make = Messages(Stores.ROS2_HUMBLE)
    found = cloud_entries(make, odometry=way == "odometry")
    if way == "registered":
        for number, (_, _, message) in enumerate(e for e in found if e[1] == LIDAR):
            message.header.frame_id = "odom"
            table = np.asarray(message.data)[: 32 * message.width].copy().view("<f8").reshape(-1, 4)
            table[:, 1:] = transform_points(Z_UP.pose(number), cloud_of(number))
            message.data[: 32 * message.width] = table.view(np.uint8).ravel()
    write_bag2(tmp_path / "drive", found, make, rosbag2.StoragePlugin.SQLITE3)
    sequence = open_sequence(tmp_path / "drive")
    frames = open_sequence(reference)
    assert len(sequence) == FRAMES and sequence.notes == ()
    for i in range(FRAMES):  # colour is stamped 5 ms after the cloud: a twentieth of the way to the next pose
        np.testing.assert_allclose(sequence.poses[i], Z_UP.pose(i + 0.05), atol=1e-4)
        a, b = sequence.read(i).depth_m, frames.read(i).depth_m
        both = (a > 0) & (b > 0)
        assert both.mean() > 0.9 * (b > 0).mean() and np.median(np.abs(a - b)[both]) < 0.01


@pytest.mark.parametrize("of_imu", [False, True])
def test_kitti360(tmp_path, of_imu):
    """Poses of the camera, or of the IMU and through two calibrations; scans through a third."""
    sample = kitti360(tmp_path, of_imu=of_imu)
    sequence, reference = open_sequence(sample.path), open_sequence(sample.reference)
    assert sequence.frame_names == tuple(f"{5 + i:010d}" for i in range(FRAMES))
    assert any("1 of 5 frames have no pose (9)" in note for note in sequence.notes)
    for i in range(FRAMES):
        a, b = sequence.read(i), reference.read(i)
        np.testing.assert_allclose(a.depth_m, b.depth_m, atol=2e-6)
        np.testing.assert_allclose(a.T_world_camera, b.T_world_camera, atol=1e-8)
        np.testing.assert_allclose(a.intrinsics.matrix(), b.intrinsics.matrix(), rtol=1e-8)
        np.testing.assert_array_equal(sequence.color(i), reference.color(i))
    found = sequence.segmentation(0)
    assert {s.id: (s.label, s.is_thing) for s in found.segments} == {
        26001: ("car", True), 26002: ("car", True), 7000: ("road", False),
    }  # fmt: skip
    expected = reference.segmentation(0).ids.copy()
    expected[0, :2] = 0
    np.testing.assert_array_equal(found.ids, np.array([0, 26001, 26002, 7000])[expected])
    assert not sequence.segmentation(FRAMES - 1).segmented, "no mask of this frame"
    assert abs(sequence.T_map_world[2, 3] + Z_UP.floor_height_m) < 0.01
    assert build_map(sequence).counts() == {"car": 2}
    drive = open_sequence(sample.path / "data_2d_raw" / DRIVE)
    np.testing.assert_array_equal(drive.poses, sequence.poses)


KITTI_FAULTS = [
    ("calibration/perspective.txt", b"S_rect_00: 64 48\n", "a line P_rect_00:", "none"),
    ("calibration/perspective.txt", b"P_rect_00: 1 2\n", "12 numbers", "found 2"),
    ("calibration/calib_cam_to_velo.txt", b"2 0 0 0 0 2 0 0 0 0 2 0\n", "orthonormal", "off by 3"),
    (f"data_poses/{DRIVE}/cam0_to_world.txt", b"5 1 0 0\n", "17 numbers", "found 4"),
    (f"data_3d_raw/{DRIVE}/velodyne_points/data/0000000005.bin", b"12345", "points of 16 bytes", "5 bytes"),
    ("data_2d_raw/another/x", b"", "expected one drive", "found 2; name one, such as"),
]


@pytest.mark.parametrize(("name", "content", "expected", "found"), KITTI_FAULTS)
def test_faults_of_kitti360(tmp_path, name, content, expected, found):
    root = kitti360(tmp_path).path
    (root / name).parent.mkdir(exist_ok=True)
    (root / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_sequence(root)
    assert "\n" not in str(caught.value) and expected in str(caught.value) and found in str(caught.value)


def test_kitti360_without_scans_has_no_depth(tmp_path):
    root = kitti360(tmp_path).path
    (root / "data_3d_raw").rename(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"expected laser scans \(\*\.bin\), as KITTI-360 has no depth images"):
        open_sequence(root)
    masks = root / f"data_2d_semantics/train/{DRIVE}/image_00/instance/0000000005.png"
    (tmp_path / "elsewhere").rename(root / "data_3d_raw")
    write_depth(masks, np.full((48, 64), 45000, np.uint16))
    with pytest.raises(InputError, match="expected class numbers under 45, found 45"):
        open_sequence(root).segmentation(0)


def change(keys):
    def edit(folder: Path) -> None:
        content = json.loads((folder / "lidar.json").read_text()) | keys
        (folder / "lidar.json").write_text(json.dumps({k: v for k, v in content.items() if v is not None}))

    return edit


FAULTS = [
    (change({"format": "posed-clouds/9"}), "lidar.json: format", '"posed-clouds/1"', "posed-clouds/9"),
    (change({"cloud": "x.ply"}), "lidar.json", "only known keys", '"cloud"; did you mean "clouds"'),
    (change({"pose": "T_lidar_world"}), "pose", "T_world_lidar, T_world_camera", "T_lidar_world"),
    (change({"T_lidar_camera": None}), "T_lidar_camera", "4x4 numbers", "null"),
    (change({"T_lidar_camera": [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]}), "T_lidar_camera",
     "an orthonormal rotation", "off by 3"),
    (change({"clouds": "clouds/{frame}.las"}), "clouds", ".ply, .pcd", "las"),
    (change({"clouds": "clouds/0.ply"}), "clouds", '"points": "world"', "clouds/0.ply"),
    (change({"clouds": "/etc/{frame}.ply"}), "clouds", "relative", "/etc"),
    (change({"fill_pixels": 1000}), "fill_pixels", "0 to 64", "1000"),
    (lambda f: (f / "clouds/0.ply").write_bytes(ply(POINTS)[:300]), "0.ply", "200 vertices of 25 bytes", "bytes"),
    (lambda f: (f / "clouds/0.ply").write_bytes(b"solid"), "0.ply", "a PLY file", "another kind"),
    (lambda f: (f / "clouds/0.ply").write_bytes(ply(POINTS).replace(b"ty double z", b"ty double k")), "0.ply",
     "x, y and z", "x, y, red, k"),
    (lambda f: (f / "clouds/0.ply").write_bytes(ply(POINTS).replace(b"vertex 200", b"vertex 999999999999")), "0.ply",
     "a whole number up to", "999999999999"),
]  # fmt: skip


@pytest.mark.parametrize(("edit", "names", "expected", "found"), FAULTS)
def test_faults(tmp_path, edit, names, expected, found):
    folder = lidar(tmp_path).path
    edit(folder)
    with pytest.raises(InputError) as caught:
        open_sequence(folder)
    before, _, after = str(caught.value).partition("found")
    assert "\n" not in str(caught.value) and names in str(caught.value)
    assert "expected" in before and (expected in before or expected in after) and found in after


def test_the_drawn_scene_is_what_the_clouds_hold():
    depth_m, _ = look(camera(), map_pose(0))
    k = camera()
    again = depth_of_cloud(cloud_of(0), k, CloudSettings())
    assert np.abs(again - depth_m).max() <= 0.00051
