"""Reading good sequences: exact pixels, poses, labels; tiny ones and, where they are at hand, real ones."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from sequences import (
    CAMERA_HEIGHT_M,
    COLORS,
    CX,
    CY,
    FLOOR_ID,
    FOCAL,
    HEIGHT,
    LABELS,
    WIDTH,
    frame_name,
    local_ids,
    tiny_images,
    tiny_pose,
    write_tiny_sequence,
)

from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.structures import Intrinsics, Segment

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="the sequences in ../shared/data are not here")


def test_folder_and_manifest_open_the_same(tmp_path: Path) -> None:
    manifest = write_tiny_sequence(tmp_path)
    by_folder, by_manifest = open_sequence(tmp_path), open_sequence(manifest)
    assert by_folder.path == by_manifest.path == manifest
    assert by_folder.name == "tiny"
    assert by_folder.frame_names == tuple(map(frame_name, range(3)))
    assert by_folder.intrinsics == Intrinsics(WIDTH, HEIGHT, FOCAL, FOCAL, CX, CY)
    np.testing.assert_allclose(by_folder.poses, [tiny_pose(i) for i in range(3)], atol=1e-12)
    np.testing.assert_array_equal(by_folder.T_map_world, np.eye(4))
    assert not by_folder.gravity_estimated


def test_frames_hold_exact_pixels(tmp_path: Path) -> None:
    sequence = open_sequence(write_tiny_sequence(tmp_path, frames=4))
    assert len(sequence) == 4
    for index in range(4):
        depth_m, instances = tiny_images(index)
        frame = sequence.read(index)
        assert (frame.index, frame.name, frame.color) == (index, frame_name(index), None)
        np.testing.assert_array_equal(frame.depth_m, depth_m)
        np.testing.assert_array_equal(frame.T_world_camera, sequence.poses[index])
        color = sequence.read(index, color=True).color
        assert color is not None
        for instance, rgb in COLORS.items():
            assert (color[instances == instance] == rgb).all(), "channels are RGB"
        np.testing.assert_array_equal(sequence.color(index), color)


def test_segments_of_a_frame_have_ids_of_their_own(tmp_path: Path) -> None:
    sequence = open_sequence(write_tiny_sequence(tmp_path))
    assert sequence.labels == ("none", "chair", "floor")
    assert sequence.is_thing == (False, True, False)
    assert (sequence.segmentation_source, sequence.ground_truth) == ("drawn by the test", False)
    for index in range(3):
        segmentation = sequence.segmentation(index)
        assert segmentation.ids.dtype == np.int32
        _, instances = tiny_images(index)
        for instance, local in local_ids(index).items():
            np.testing.assert_array_equal(segmentation.ids == local, instances == instance)
        assert {(s.id, s.label, s.score, s.is_thing) for s in segmentation.segments} == {
            (local, LABELS[i], 0.9, i != FLOOR_ID) for i, local in local_ids(index).items()
        }


def test_instances_are_world_wide_and_listed_only_where_seen(tmp_path: Path) -> None:
    sequence = open_sequence(write_tiny_sequence(tmp_path, truth="instances"))
    assert sequence.ground_truth
    assert sequence.labels == ("none", "chair", "floor")
    assert sequence.segmentation(1).segments == (
        Segment(1, "chair", 1.0, True),
        Segment(2, "chair", 1.0, True),
        Segment(3, "floor", 1.0, False),
    )
    ids = np.full((HEIGHT, WIDTH), 3, np.uint8)
    ids[0, 0] = 2
    cv2.imwrite(str(tmp_path / "ids" / f"{frame_name(1)}.png"), ids)
    assert [s.id for s in sequence.segmentation(1).segments] == [2, 3]


def test_isthing_of_the_scene_wins_over_the_class_name(tmp_path: Path) -> None:
    path = write_tiny_sequence(tmp_path, truth="instances")
    entries = [
        {"id": 1, "label": "chair", "isthing": False},
        {"id": 2, "label": "chair", "isthing": False},
        {"id": 3, "label": "floor", "isthing": True},
    ]
    (tmp_path / "scene.json").write_text(json.dumps({"instances": entries}))
    assert open_sequence(path).is_thing == (False, False, True)


@pytest.mark.parametrize("far_id", [255, 256, 65535])
def test_sixteen_bit_ids(tmp_path: Path, far_id: int) -> None:
    path = write_tiny_sequence(tmp_path, truth="instances")
    entries = [{"id": i, "label": label} for i, label in (LABELS | {far_id: "table"}).items()]
    (tmp_path / "scene.json").write_text(json.dumps({"instances": entries}))
    ids = np.zeros((HEIGHT, WIDTH), np.uint16)
    ids[5:9, 3:7] = far_id
    cv2.imwrite(str(tmp_path / "ids" / f"{frame_name(2)}.png"), ids)
    segmentation = open_sequence(path).segmentation(2)
    assert [s.id for s in segmentation.segments] == [far_id]
    np.testing.assert_array_equal(segmentation.ids, ids.astype(np.int32))


def test_a_listed_segment_without_pixels_is_kept(tmp_path: Path) -> None:
    path = write_tiny_sequence(tmp_path)
    table = json.loads((tmp_path / "segments.json").read_text())
    table[frame_name(0)].append({"id": 200, "label": "tv"})
    (tmp_path / "segments.json").write_text(json.dumps(table))
    sequence = open_sequence(path)
    assert Segment(200, "tv", 1.0, True) in sequence.segmentation(0).segments
    assert sequence.labels == ("none", "chair", "floor", "tv")


@pytest.mark.parametrize(
    ("changes", "source", "simulated"),
    [
        ({}, "drawn by the test", False),
        ({"simulated": True}, "drawn by the test", True),
        ({"segmentation": {"ids": "ids/{frame}.png", "segments": "segments.json"}}, "unknown", False),
        (
            {"segmentation": {"ids": "ids/{frame}.png", "segments": "segments.json", "source": "Simulated, light"}},
            "Simulated, light",
            True,
        ),
    ],
)
def test_simulated_is_said(tmp_path: Path, changes: dict, source: str, simulated: bool) -> None:
    sequence = open_sequence(write_tiny_sequence(tmp_path, manifest=changes))
    assert (sequence.segmentation_source, sequence.simulated) == (source, simulated)


def test_optional_keys_may_be_left_out(tmp_path: Path) -> None:
    changes = {key: None for key in ("name", "pose", "camera_axes", "up", "floor_height_m", "segmentation")}
    sequence = open_sequence(write_tiny_sequence(tmp_path / "kitchen", manifest=changes))
    assert sequence.name == "kitchen"
    assert (sequence.labels, sequence.is_thing, sequence.segmentation_source) == (("none",), (False,), "none")
    assert not sequence.ground_truth
    assert sequence.gravity_estimated
    with pytest.raises(
        InputError, match=r"sequence\.json: expected a segmentation, found none in this posed-frames/1 recording"
    ):
        sequence.segmentation(0)


def test_patterns_may_lead_out_of_the_folder(tmp_path: Path) -> None:
    path = write_tiny_sequence(tmp_path, manifest={})
    (tmp_path / "inner").mkdir()
    keys = json.loads(path.read_text())
    keys["segmentation"]["ids"] = "../ids/{frame}.png"
    keys["segmentation"]["segments"] = "../segments.json"
    for key in ("color", "depth", "intrinsics", "poses"):
        keys[key] = f"../{keys[key]}"
    (tmp_path / "inner" / "other.json").write_text(json.dumps(keys))
    sequence = open_sequence(tmp_path / "inner" / "other.json")
    np.testing.assert_array_equal(sequence.read(0).depth_m, tiny_images(0)[0])


def test_poses_skip_blank_lines_and_comments_and_keep_the_order(tmp_path: Path) -> None:
    path = write_tiny_sequence(tmp_path)
    lines = (tmp_path / "poses.txt").read_text().splitlines()
    (tmp_path / "poses.txt").write_text("# frame, matrix\n\n" + "\r\n".join(reversed(lines)) + "\n\n")
    sequence = open_sequence(path)
    assert sequence.frame_names == tuple(frame_name(i) for i in (2, 1, 0))
    np.testing.assert_allclose(sequence.poses[0], tiny_pose(2))


def test_a_part_of_the_poses_can_be_used_with_the_whole_table(tmp_path: Path) -> None:
    path = write_tiny_sequence(tmp_path)
    lines = (tmp_path / "poses.txt").read_text().splitlines()
    (tmp_path / "poses.txt").write_text(lines[1] + "\n")
    assert open_sequence(path).frame_names == (frame_name(1),)


def test_depth_unit_scales_and_zero_stays_invalid(tmp_path: Path) -> None:
    raw = np.full((HEIGHT, WIDTH), 10000, np.uint16)
    raw[0, 0] = 0
    path = write_tiny_sequence(tmp_path, manifest={"depth_unit_m": 0.0002})
    for index in range(3):
        cv2.imwrite(str(tmp_path / "depth" / f"{frame_name(index)}.png"), raw)
    depth_m = open_sequence(path).read(0).depth_m
    assert depth_m.dtype == np.float32
    assert depth_m[0, 0] == 0
    np.testing.assert_allclose(depth_m[0, 1:], CAMERA_HEIGHT_M, rtol=1e-6)


def test_jpeg_colors(tmp_path: Path) -> None:
    path = write_tiny_sequence(tmp_path, manifest={"color": "color/{frame}.jpg"})
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[:, :, 2] = 220  # BGR: red
    for index in range(3):
        cv2.imwrite(str(tmp_path / "color" / f"{frame_name(index)}.jpg"), image)
    jpeg = (tmp_path / "color" / f"{frame_name(0)}.jpg").read_bytes()
    (tmp_path / "color" / f"{frame_name(0)}.jpg").write_bytes(jpeg + b"appended by a phone\x00\x00")
    color = open_sequence(path).color(0)
    assert np.abs(color.astype(int) - (220, 0, 0)).max() < 8


def test_threads_read_what_one_reader_reads(tmp_path: Path) -> None:
    sequence = open_sequence(write_tiny_sequence(tmp_path, frames=9))
    order = [i % 9 for i in range(90)]
    with ThreadPoolExecutor(8) as pool:
        frames = list(pool.map(sequence.read, order))
        segmentations = list(pool.map(sequence.segmentation, order))
    for index, frame, segmentation in zip(order, frames, segmentations, strict=True):
        np.testing.assert_array_equal(frame.depth_m, tiny_images(index)[0])
        assert frame.name == frame_name(index)
        assert [s.id for s in segmentation.segments] == list(local_ids(index).values())


@needs_shared
@pytest.mark.parametrize(
    ("folder", "frames", "size", "truth", "classes"),
    [
        ("hololens-breakroom", 373, (540, 360), False, {"chair", "dining table", "potted plant"}),
        ("aws-small-house/rgbd", 297, (512, 384), True, {"chair", "floor", "tv"}),
        ("aws-small-house/rgbd/sequence-pred.json", 297, (512, 384), False, {"chair", "dining table"}),
    ],
)
def test_real_sequences(folder: str, frames: int, size: tuple[int, int], truth: bool, classes: set[str]) -> None:
    sequence = open_sequence(SHARED / folder)
    assert (len(sequence), sequence.ground_truth, sequence.simulated) == (frames, truth, False)
    assert (sequence.intrinsics.width, sequence.intrinsics.height) == size
    assert classes <= set(sequence.labels)
    assert sequence.labels[1:] == tuple(sorted(set(sequence.labels[1:])))
    for index in (0, frames // 2, frames - 1):
        frame, segmentation = sequence.read(index, color=True), sequence.segmentation(index)
        assert 0.3 < np.median(frame.depth_m[frame.depth_m > 0]) < 8
        listed = {s.id for s in segmentation.segments}
        seen = set(np.unique(segmentation.ids).tolist()) - {0}
        assert seen == listed if truth else seen <= listed
        assert {s.label for s in segmentation.segments} <= set(sequence.labels)


@needs_shared
def test_the_house_has_the_instances_its_scene_says() -> None:
    sequence = open_sequence(SHARED / "aws-small-house" / "rgbd")
    scene = json.loads((SHARED / "aws-small-house" / "scene.json").read_text())["instances"]
    seen_in: dict[int, int] = {}
    for index in range(0, len(sequence)):
        for segment in sequence.segmentation(index).segments:
            seen_in[segment.id] = seen_in.get(segment.id, 0) + 1
    assert set(seen_in) <= {entry["id"] for entry in scene}
    for entry in scene:
        assert sequence.is_thing[sequence.labels.index(entry["label"])] == entry["isthing"]
        assert (seen_in.get(entry["id"], 0) > 0) or entry["frames_visible"] == 0
