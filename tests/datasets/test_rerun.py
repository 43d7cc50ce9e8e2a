"""Depth as rerun's users log it: pictures of every encoding, and units as its documentation has them."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr
from scans import FRAMES, Y_UP, camera, look, map_pose, steps
from scans_bags import rvl
from scans_rerun import rerun_rrd

from simaps_viz import open_sequence
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError


def png(depth: np.ndarray) -> bytes:
    return cv2.imencode(".png", depth)[1].tobytes()


def ros_rvl(depth: np.ndarray) -> bytes:
    return bytes(12) + struct.pack("<ii", depth.shape[1], depth.shape[0]) + rvl(depth)


ENCODED = {
    "png": lambda d: rr.EncodedDepthImage(blob=png(d), media_type="image/png", meter=1000.0),
    "rvl": lambda d: rr.EncodedDepthImage(blob=ros_rvl(d), media_type="application/rvl", meter=1000.0),
    "no unit": lambda d: rr.EncodedDepthImage(blob=png(d), media_type="image/png"),
    "no type": lambda d: rr.EncodedDepthImage(blob=png(d), meter=1000.0),
    "unit as in rerun's example": lambda d: rr.EncodedDepthImage(blob=png(d), media_type="image/png", meter=0.001),
}


def expect_depth(sequence: PosedFrames) -> None:
    assert len(sequence) == FRAMES
    for i in range(FRAMES):
        np.testing.assert_allclose(sequence.read(i).depth_m, steps(look(camera(), map_pose(i))[0]) * 0.001, rtol=1e-6)


@pytest.mark.parametrize("way", ENCODED)
def test_encoded_depth(tmp_path: Path, way: str) -> None:
    expect_depth(open_sequence(rerun_rrd(tmp_path, ENCODED[way]).path))


def test_encoded_depth_that_is_none(tmp_path: Path) -> None:
    sample = rerun_rrd(tmp_path, lambda d: rr.EncodedDepthImage(blob=png((d >> 8).astype(np.uint8)), meter=1000.0))
    with pytest.raises(InputError, match=r"EncodedDepthImage: expected a PNG of one channel of 16 bits, found uint8"):
        open_sequence(sample.path)


def expect_frames(sequence: PosedFrames) -> None:
    expect_depth(sequence)
    assert sequence.notes == ()
    np.testing.assert_allclose(sequence.intrinsics.matrix(), camera().matrix(), rtol=1e-6)
    np.testing.assert_allclose(sequence.poses, [Y_UP.pose(i) for i in range(FRAMES)], atol=1e-6)


@pytest.mark.parametrize(
    ("axes", "R"),
    [
        (rr.ViewCoordinates.RUB, [[1, 0, 0], [0, -1, 0], [0, 0, -1]]),
        (rr.ViewCoordinates.FLU, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    ],
)
def test_camera_axes_are_turned_into_opencv_s(tmp_path: Path, axes: object, R: list[list[int]]) -> None:
    T = np.eye(4)
    T[:3, :3] = R
    expect_frames(open_sequence(rerun_rrd(tmp_path, axes=axes, T_axes=T).path))


def test_left_handed_camera_axes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"depth: Pinhole: expected right-handed .*, found \[3, 1, 5\]"):
        open_sequence(rerun_rrd(tmp_path, axes=rr.ViewCoordinates.RUF).path)


def test_named_frames(tmp_path: Path) -> None:
    """As rerun's importer of MCAP and its ROS example log them; both cameras are of one frame, but not of one size."""
    expect_frames(open_sequence(rerun_rrd(tmp_path, named=True).path))


def test_the_timeline_is_one_over_which_all_moves(tmp_path: Path) -> None:
    expect_frames(open_sequence(rerun_rrd(tmp_path, uptime=True).path))


def test_frames_in_a_circle(tmp_path: Path) -> None:
    path = tmp_path / "circle.rrd"
    stream = rr.RecordingStream("circle", send_properties=False)
    stream.save(path)
    for parent, child in (("a", "b"), ("b", "a")):
        stream.log(f"/{child}", rr.Transform3D(translation=[1, 0, 0], parent_frame=parent, child_frame=child))
    stream.log("/depth", rr.CoordinateFrame("a"), static=True)
    stream.log("/depth", rr.DepthImage(np.ones((4, 4), np.uint16)))
    stream.disconnect()
    with pytest.raises(InputError, match="expected frames as a tree, found a circle at frame 'a'"):
        open_sequence(path)
