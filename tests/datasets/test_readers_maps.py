"""Every reader gives the map that the same frames give as posed-frames/1, and so does what `simaps convert` writes."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from map_equality import same_maps
from scans import COLORS, Sample, map_pose
from scans_apps import record3d_exr, record3d_folder, record3d_zip
from scans_bags import ros1_bag, ros2_mcap, ros2_sqlite
from scans_clouds import cloud_bag, lidar
from scans_folders import (
    amazon,
    arkit,
    bundle_fusion,
    habitat,
    habitat_classes,
    nerfstudio,
    polycam,
    replica,
    scannet,
    sens,
    sun3d,
    tum,
)
from scans_mcap import foxglove_mcap, ros1_mcap
from scans_rerun import rerun_rrd
from scans_slam import colmap, instant_ngp, matrix_lines, pose_lines, redwood, rtabmap, slam_folder, stray_scanner

from simaps_viz import build_map, open_sequence
from simaps_viz.datasets.convert import write_posed_frames
from simaps_viz.datasets.open import readers, recognise
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.structures import SIMap

pytestmark = pytest.mark.slow

WRITERS = [tum, bundle_fusion, scannet, replica, nerfstudio, habitat, habitat_classes, arkit, polycam, record3d_zip,
           record3d_folder, record3d_exr, ros1_bag, ros2_sqlite, ros2_mcap, rerun_rrd, sens, lidar,
           cloud_bag, instant_ngp, redwood, rtabmap, slam_folder, stray_scanner, foxglove_mcap,
           ros1_mcap, colmap, pose_lines, matrix_lines, amazon, sun3d]  # fmt: skip


class Segmented:
    """A sequence whose segments come from another one, as from a network."""

    def __init__(self, sequence: PosedFrames, other: PosedFrames) -> None:
        self._sequence, self.segmentation = sequence, other.segmentation
        self.labels, self.is_thing = other.labels, other.is_thing
        self.segmentation_source = "drawn by the test"

    def __getattr__(self, name: str):
        return getattr(self._sequence, name)

    def __len__(self) -> int:
        return len(self._sequence)


@pytest.fixture(scope="module", params=WRITERS, ids=lambda writer: writer.__name__)
def opened(request, tmp_path_factory) -> tuple[Sample, PosedFrames, PosedFrames]:
    writer: Callable[[Path], Sample] = request.param
    sample = writer(tmp_path_factory.mktemp(writer.__name__))
    sequence = open_sequence(sample.path)
    assert sequence.recording.facts.title != "posed-frames/1"
    return sample, sequence, open_sequence(sample.reference)


def built(sequence, reference: PosedFrames) -> SIMap:
    has_segments = len(sequence.labels) > 1
    return build_map(sequence if has_segments else Segmented(sequence, reference))  # pyright: ignore


def test_frames_are_those_of_the_reference(opened):
    sample, sequence, reference = opened
    assert len(sequence) == len(reference)
    with ThreadPoolExecutor(4) as pool:  # threads may read at once
        frames = list(pool.map(lambda i: sequence.read(i % len(sequence), color=True), range(16)))
    for frame in frames:
        b = reference.read(frame.index)
        np.testing.assert_allclose(frame.depth_m, b.depth_m, rtol=3e-7)  # a step is not a whole 32-bit float
        np.testing.assert_allclose(frame.T_world_camera, b.T_world_camera, atol=3e-7)
        np.testing.assert_allclose(
            frame.intrinsics.matrix(), b.intrinsics.matrix(), rtol=1e-6, err_msg="camera of the pictures handed over"
        )
    for index in range(len(sequence)):
        T_map_camera = sequence.T_map_world @ sequence.poses[index]
        assert abs(T_map_camera[2, 3] - map_pose(0)[2, 3]) < 0.01, "height over the floor"
        assert T_map_camera[2, 2] == pytest.approx(map_pose(0)[2, 2], abs=0.01), "pitch"
        color, depth = sequence.files(index)
        assert color.exists() and depth.exists()
        assert color == depth == sequence.path or color != depth
        # Colour lies on depth.
        ids = reference.segmentation(index).ids
        off = np.abs(sequence.color(index).astype(int)[..., None, :] - COLORS.astype(int)).sum(axis=-1).argmin(axis=-1)
        agreed = (off == ids)[reference.read(index).depth_m > 0].mean()
        assert agreed == 1 if sample.exact_color and sample.lossless else agreed > 0.97


def test_the_map_is_that_of_the_same_frames_also_of_the_converted_folder(opened, tmp_path):
    _, sequence, reference = opened
    ours = built(sequence, reference)
    same_maps(ours, built(reference, reference))
    steps = []
    manifest = write_posed_frames(sequence, tmp_path / "out", progress=lambda done, total: steps.append((done, total)))
    assert steps == [(i + 1, len(sequence)) for i in range(len(sequence))]
    converted = open_sequence(manifest)
    assert converted.recording.facts.title == "posed-frames/1" and converted.frame_names == sequence.frame_names
    np.testing.assert_array_equal(converted.T_map_world @ [0, 0, 0, 1], sequence.T_map_world @ [0, 0, 0, 1])
    assert converted.simulated == sequence.simulated
    assert converted.ground_truth == sequence.ground_truth
    for index in range(len(sequence)):
        np.testing.assert_array_equal(converted.read(index).depth_m, sequence.read(index).depth_m)
        assert np.abs(converted.color(index).astype(int) - sequence.color(index)).mean() < 8
    same_maps(built(converted, reference), ours)
    assert [p.name for p in tmp_path.iterdir()] == ["out"], "nothing is left over"


def test_one_reader_knows_it_and_without_a_segmentation_there_is_one_clear_line(opened):
    sample, sequence, _ = opened
    knowing = [reader for reader in readers() if reader.recognise(sample.path)]
    assert [reader.facts.title for reader in knowing] == [sequence.recording.facts.title]
    reader = recognise(sample.reference)
    assert reader is not None and reader.facts.title == "posed-frames/1"
    if len(sequence.labels) > 1:
        return
    with pytest.raises(
        InputError, match=r"expected a segmentation, found none in this .* recording.*--segmentation"
    ) as e:
        build_map(sequence)
    assert "\n" not in str(e.value) and str(sequence.path) in str(e.value)
