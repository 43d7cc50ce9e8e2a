"""MCAP as others write it: ROS 1's messages, Foxglove's in protobuf and JSON, packed or not, and files cut short."""

import os
from pathlib import Path

import numpy as np
import pytest
from scans import FRAMES, Z_UP, camera, write_reference
from scans_bags import ros1_bag
from scans_mcap import foxglove, mcap, of_ros1

from simaps_viz import open_sequence
from simaps_viz.datasets.mcap import McapReader
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> PosedFrames:
    return open_sequence(write_reference(tmp_path_factory.mktemp("reference") / "frames", camera(), Z_UP))


def same(found: PosedFrames, expected: PosedFrames) -> None:
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-9)
    for i in range(len(expected)):
        np.testing.assert_allclose(found.read(i).depth_m, expected.read(i).depth_m, rtol=3e-7)
        np.testing.assert_array_equal(found.color(i), expected.color(i))


@pytest.mark.parametrize("packed", [None, "", "lz4", "zstd"])
def test_ros1(tmp_path: Path, packed: str | None) -> None:
    (tmp_path / "drive.mcap").write_bytes(mcap(of_ros1(), packed))
    same(open_sequence(tmp_path / "drive.mcap"), open_sequence(ros1_bag(tmp_path / "bag").path))


@pytest.mark.parametrize(("kind", "picture"), [("protobuf", "png"), ("json", "png"), ("json", "webp")])
def test_foxglove_s_messages(tmp_path: Path, kind: str, picture: str, reference: PosedFrames) -> None:
    (tmp_path / "drive.mcap").write_bytes(mcap(foxglove(kind, picture), "zstd"))
    sequence = open_sequence(tmp_path / "drive.mcap")
    assert sequence.notes == ()
    same(sequence, reference)


def test_depth_as_png(tmp_path: Path, reference: PosedFrames) -> None:
    only = [m for m in foxglove("protobuf") if m[1] != "/camera/depth/image"]
    (tmp_path / "drive.mcap").write_bytes(mcap(only))
    sequence = open_sequence(tmp_path / "drive.mcap")
    assert len(sequence) == 1
    np.testing.assert_allclose(sequence.read(0).depth_m, reference.read(2).depth_m, rtol=3e-7)


def test_a_file_that_was_cut_is_read_up_to_there(tmp_path: Path, reference: PosedFrames) -> None:
    """A robot whose power goes leaves no end; what was written before is whole."""
    data = mcap(foxglove("protobuf"), "lz4", per_chunk=3)
    (tmp_path / "drive.mcap").write_bytes(data[: int(len(data) * 0.8)])
    sequence = open_sequence(tmp_path / "drive.mcap")
    assert 0 < len(sequence) < FRAMES
    assert "the file has no end: it was cut short, and is read up to there" in sequence.notes
    np.testing.assert_allclose(sequence.poses, reference.poses[: len(sequence)], atol=1e-9)


@pytest.mark.parametrize("data", [b"", b"\x89MCAP0\r\n", b"no bag at all", mcap([])])
def test_files_that_hold_nothing(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "drive.mcap").write_bytes(data)
    with pytest.raises(InputError, match=r"drive\.mcap: expected a ROS bag, found"):
        open_sequence(tmp_path / "drive.mcap")


def test_a_file_of_other_messages_is_called_so(tmp_path: Path) -> None:
    """Messages of ships, as in RISE-Maritime/keelson."""
    (tmp_path / "drive.mcap").write_bytes(mcap([(0.0, "ais", "json", "Position", "jsonschema", b"{}", b"{}")]))
    with pytest.raises(InputError, match="found no messages of ROS or of Foxglove's schemas"):
        open_sequence(tmp_path / "drive.mcap")


def test_a_damaged_file_does_not_stay_open(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    data = bytearray(mcap(of_ros1(), "zstd"))
    data[len(data) // 3 : len(data) // 3 + 30] = bytes(30)
    path.write_bytes(data)
    with pytest.raises(Exception) as told:
        McapReader(path)
    assert told.value.__traceback__ is not None  # which keeps the reader
    assert path not in {Path(f"/proc/self/fd/{n}").resolve() for n in os.listdir("/proc/self/fd")}
