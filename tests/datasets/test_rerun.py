"""Depth as rerun's users log it: pictures of every encoding, and units as its documentation has them."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr
from scans import FRAMES, camera, look, map_pose, steps
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
