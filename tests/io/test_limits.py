"""What is too large, too deep or leads elsewhere is refused in one line, before memory is asked for."""

import io
import json
import struct
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from scans_apps import record3d_exr, record3d_folder
from sequences import write_tiny_sequence
from tiny_networks import write_yolo
from toy_maps import toy_map

from simaps_viz import open_sequence
from simaps_viz.datasets import rerun_rrd
from simaps_viz.datasets.calibration import pose_rows
from simaps_viz.datasets.clouds import read_pcd
from simaps_viz.datasets.file_frames import read_array
from simaps_viz.datasets.images import read_color
from simaps_viz.datasets.manifest import read_json, read_manifest
from simaps_viz.datasets.record3d import lzfse_size, member, read_exr
from simaps_viz.errors import MAX_MESSAGE, InputError
from simaps_viz.io import limits
from simaps_viz.io.arrays import read_npy
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.config import BuildConfig, config_from_json
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.mending import read_edits
from simaps_viz.segmentation.coco_panoptic import read_coco_panoptic
from simaps_viz.segmentation.session import Session

MUCH = 50_000_000
"""Bytes: no refusal needs as many."""


def refused(what, *arguments, match: str, **keywords) -> None:
    """It is refused in one line that can be printed, with little memory."""
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=match) as caught:
            what(*arguments, **keywords)
        assert tracemalloc.get_traced_memory()[1] < MUCH
    finally:
        tracemalloc.stop()
    text = str(caught.value)
    assert text.isprintable() and len(text) <= MAX_MESSAGE + 10


def png(width: int, height: int) -> bytes:
    """A PNG whose header and checksums are right and whose pixels are not there."""
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(b"")),
        (b"IEND", b""),
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in chunks
    )


@pytest.mark.parametrize("size", [(60_000, 60_000), (16_385, 1), (0, 5), (2**31 - 1, 2**31 - 1)])
def test_pictures_of_no_camera(tmp_path, size):
    path = tmp_path / "a.png"
    path.write_bytes(png(*size))
    refused(read_color, path, match="a picture of at most 16384 pixels a side|cannot be decoded")
    good = cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    at = good.find(b"\xff\xc0")
    path.write_bytes(good[: at + 5] + struct.pack(">HH", 65_535, 65_535) + good[at + 9 :])
    refused(read_color, path, match="found 65535x65535")
    path.write_bytes(good)
    assert read_color(path).shape == (8, 8, 3)


def test_only_pictures_whose_size_is_known_are_decoded(tmp_path):
    path = tmp_path / "a.png"
    path.write_bytes(cv2.imencode(".bmp", np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    refused(read_color, path, match="only PNG, PGM, JPEG and WebP are")


def webp(kind: bytes, body: bytes) -> bytes:
    """A WebP whose header is right and whose pixels are not there."""
    return b"RIFF" + struct.pack("<I", 12 + len(body)) + b"WEBP" + kind + struct.pack("<I", len(body)) + body


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (webp(b"VP8 ", b"\x30\x01\0\x9d\x01\x2a" + struct.pack("<HH", 16_383, 16_383)), "found 16383x16383"),
        (webp(b"VP8L", b"\x2f" + struct.pack("<I", 16_383 | 16_383 << 14) + bytes(8)), "found 16384x16384"),
        (webp(b"VP8X", bytes(4) + b"\xff" * 6), "found 16777216x16777216"),
        (webp(b"VP8X", b"\x02" + bytes(9)), "a WebP that moves or has no size"),
        (webp(b"VP8X", bytes(4)), "a WebP that moves or has no size"),
        (webp(b"VP8X", bytes(10))[:-1], "a truncated WebP"),
        (webp(b"VP8X", bytes(4) + b"\x07\0\0\x07\0\0"), "cannot be decoded"),
    ],
)
def test_webp_of_no_camera(tmp_path, data, match):
    path = tmp_path / "a.webp"
    path.write_bytes(data)
    refused(read_color, path, match=match)


def npy(shape: str, kind: str = "'<f4'", data: bytes = b"") -> bytes:
    head = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + data


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (npy(f"({10**9}, {10**9})"), "at most 16384 pixels"),
        (npy("(8000, 8000)"), "damaged or truncated"),
        (npy("(4, 4)", "'|O'"), "damaged or truncated"),
        (npy("(4, 4)", "[('a', '<f4')]"), "damaged or truncated"),
        (npy("(4, 4", data=bytes(64)), "damaged or truncated"),
        (npy("(" + "-" * 5000 + "4, 4)"), "damaged or truncated"),
        (npy("(4, 4, 9)", data=bytes(576)), "an image"),
        (npy("(4, 4)", data=bytes(65)), "damaged or truncated"),
        (b"", "damaged or truncated"),
    ],
)
def test_arrays(tmp_path, content, match):
    path = tmp_path / "a.npy"
    path.write_bytes(content)
    refused(read_array, path, match=match)


def test_arrays_come_back_as_they_were(tmp_path):
    for array in (np.arange(12.0).reshape(3, 4), np.asfortranarray(np.arange(12).reshape(3, 4)), np.zeros((0, 3))):
        buffer = io.BytesIO()
        np.save(buffer, array)
        size = buffer.tell()
        buffer.seek(0)
        back = read_npy("a", buffer, size, lambda shape, dtype: None)
        assert np.array_equal(back, array) and back.dtype == array.dtype


def test_json(tmp_path):
    path = write_tiny_sequence(tmp_path)
    for text, match in (
        ('{"a": 1, "b": 2, "a": 3}', 'each key once, found the key "a" twice'),
        ("[" * 100_000, "sensible depth"),
        ("9" * 5000, "sensible depth"),
        ('{"\\ud800\\n": 1}', "found no such key|found"),
        ('{"format": ' + "[" * 900 + "]" * 900 + "}", "format"),
    ):
        path.write_text(text)
        refused(read_manifest, path, match=match)
    path.write_bytes(b" " * 20)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("simaps_viz.datasets.manifest.MAX_JSON_BYTES", 10)
        refused(read_json, path, match="at most 10 bytes, found 20")


@pytest.mark.parametrize("name", ["../../x", "/etc/x", "a/../b", "a\\b", "x" * 201, "a\x00b", "a\x1b[31m"])
def test_frame_names_stay_in_their_folder(tmp_path, name):
    path = write_tiny_sequence(tmp_path).with_name("poses.txt")
    path.write_text(path.read_text().replace("0010", name))
    refused(pose_rows, path, match="a frame name")


@pytest.mark.parametrize("port", [-1, 65_536])
def test_a_number_that_is_no_port_is_refused(port):
    refused(limits.check_port, port, match=f"--port: expected 0 to 65535, found {port}")


def test_devices_and_pipes_are_no_files():
    refused(read_json, Path("/dev/zero"), match="something that is no file")


def test_a_pose_far_away_is_refused_and_not_tried(tmp_path):
    sequence = open_sequence(write_tiny_sequence(tmp_path))
    frame, found = sequence.read(0), sequence.segmentation(0)
    near = sequence.T_map_world @ sequence.poses[0]
    far = near.copy()
    far[:2, 3] += 10_000.0
    for size, away_m, match in (
        (0.05, 10_000.0, "at most 134217728 cells"),
        (0.005, 1_000.0, "at most 134217728 cells"),
        (0.05, np.nan, "cameras within"),
        (0.05, 1e12, "cameras within"),
    ):
        gathered = MapAccumulator(sequence.labels, sequence.is_thing, ProjectionSettings(cell_size_m=size), links=False)
        gathered.add_frame(frame, found, near)
        before, there = gathered.snapshot(), near.copy()
        there[:2, 3] += away_m
        refused(gathered.add_frame, frame, found, there, match=match)
        assert np.array_equal(before.height_m, gathered.snapshot().height_m, equal_nan=True)
    linked = MapAccumulator(sequence.labels, sequence.is_thing, ProjectionSettings(), links=True)
    with pytest.raises(InputError, match=r"within 1638\.4 m of its origin to be linked"):
        linked.add_frame(frame, found, far)
    alone = MapAccumulator(sequence.labels, sequence.is_thing, ProjectionSettings(), links=False)
    alone.add_frame(frame, found, far)  # a map far from its origin is none too large
    assert alone.snapshot().spec.rows < 2000


def changed_map(path: Path, **changes: np.ndarray) -> None:
    save_map(toy_map(), path)
    with np.load(path) as archive:
        arrays = dict(archive) | changes
    np.savez(path, **arrays)  # type: ignore[arg-type]


def of_metadata(path: Path, **changes: object) -> np.ndarray:
    save_map(toy_map(), path)
    with np.load(path) as archive:
        return np.array(json.dumps(json.loads(str(archive["metadata"])) | changes))


def test_maps_whose_parts_do_not_fit(tmp_path):
    path = tmp_path / "a.npz"
    simap = toy_map()
    other, far = simap.instance.copy(), simap.T_map_camera.copy()
    other[other == 1] = 3
    far[0, 0, 3] = np.nan
    again = simap.merges.source.copy()
    again[-1] = again[0]
    for changes, match in (
        ({"instance": np.where(simap.instance == 6, 1, simap.instance).astype(np.int32)}, "instances that are not"),
        ({"T_map_camera": simap.T_map_camera[:2]}, "T_map_camera"),
        ({"T_map_camera": far}, "T_map_camera"),
        ({"merge_source": again}, "a merge of a community that was merged before"),
        ({"view_frame": simap.views.frame + 90}, "view_frame"),
        ({"metadata": np.array("[" * 100_000)}, "JSON metadata"),
        ({"metadata": of_metadata(path, is_thing=[True])}, "is_thing"),
        ({"metadata": of_metadata(path, parameters={"k_percent": "5"})}, "parameter k_percent"),
        ({"metadata": of_metadata(path, parameters={})}, "parameters"),
        ({"metadata": of_metadata(path, cell_size_m=float("nan"))}, "cell_size_m"),
        ({"metadata": of_metadata(path, provenance={"edits": 3})}, "edits"),
    ):
        changed_map(path, **changes)
        refused(load_map, path, match=match)


def test_archives_that_claim_too_much(tmp_path):
    path = tmp_path / "a.npz"
    for content, match in (
        (npy("(20000, 20000)", "'<i2'"), "at most 134217728 cells"),
        (npy("(10000, 10000)", "'<i2'"), "damaged or truncated"),
        (npy("(3, 3)", "'<i2'", bytes(17)), "damaged or truncated"),
        (npy("(3, 3", "'<i2'"), "damaged or truncated"),
    ):
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("label.npy", content)
        refused(load_map, path, match=match)
    path.write_bytes(npy("(3,)", data=bytes(12)))
    refused(load_map, path, match="damaged or foreign")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a", "w") as file:
        for _ in range(20):
            file.write(bytes(1 << 20))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("simaps_viz.datasets.record3d.MAX_MEMBER_BYTES", 1 << 20)
        refused(member, path, "a", match="at most 1048576 bytes")


def test_packed_depth_says_how_large_it_is(tmp_path):
    record3d_folder(tmp_path / "r")
    packed = next((tmp_path / "r").rglob("0.depth")).read_bytes()
    assert lzfse_size(packed) == 48 * 64 * 4
    for data in (packed[: len(packed) // 2], b"bvx2" + bytes(40), b"x", b""):
        with pytest.raises(ValueError):
            lzfse_size(data)
    sample = record3d_exr(tmp_path / "e")
    exr = next(sample.path.rglob("*.exr"))
    read_exr(exr)
    at = exr.read_bytes().index(b"dataWindow\0box2i\0") + 17 + 4
    exr.write_bytes(exr.read_bytes()[:at] + struct.pack("<iiii", 0, 0, 10**6, 10**6) + exr.read_bytes()[at + 16 :])
    refused(read_exr, exr, match="found 1000001x1000001")


def test_a_recording_that_ends_its_reader_ends_another_process(tmp_path, monkeypatch):
    path = tmp_path / "a.rrd"
    path.write_bytes(b"x")
    monkeypatch.setattr(rerun_rrd, "_trial", rerun_rrd._Trial())
    with monkeypatch.context() as patch:
        patch.setattr(rerun_rrd, "_PROGRAM", "import os, sys; sys.stdin.readline(); os.abort()")
        refused(rerun_rrd.check_readable, path, match="so damaged that rerun cannot read it")
    rerun_rrd.check_readable(path)  # the next one gets a new process; what is no recording is told elsewhere
    rerun_rrd._trial.close()


def test_small_faults_of_readers(tmp_path):
    cloud = tmp_path / "a.pcd"
    cloud.write_text("FIELDS x y z\nSIZE ² 4 4\nTYPE F F F\nCOUNT 1 1 1\nPOINTS 1\nDATA ascii\n1 2 3\n", "utf-8")
    refused(read_pcd, cloud, match="a number type")
    table = tmp_path / "a.json"
    for text in ('{"images": [{"id": []}], "annotations": [], "categories": []}',
                 '{"images": [], "categories": [], "annotations": [{"file_name": ""}]}'):  # fmt: skip
        table.write_text(text)
        refused(read_coco_panoptic, table, ["a"], match="expected")
    table.write_text('{"format": "simap-edits/1", "map": ' + "[" * 100_000)
    refused(read_edits, table, match="damaged JSON")
    network = write_yolo(tmp_path / "a.onnx", [])
    network.write_bytes(network.read_bytes().replace(b"images", b"\xff\xfeages"))
    refused(Session, network, match="expected an ONNX network")


def test_settings_out_of_files_have_their_kinds():
    good = BuildConfig().to_json()
    assert config_from_json(good) == BuildConfig()
    votes = {**good["votes"], "nothing": "a"}
    for change in (
        {"seed": "1"}, {"seed": -1}, {"min_cells": 1.5}, {"literal": 1}, {"method": "x"}, {"k_percent": None},
        {"votes": votes}, {"affinity": 10**400},
    ):  # fmt: skip
        refused(config_from_json, good | change, match="expected")


def test_messages_are_one_printable_line():
    assert str(InputError("a\nb\x1b[31m\ud800\u2028")) == r"a\nb\x1b[31m\ud800\u2028"
    long = str(InputError("x" * 5000 + "end"))
    assert len(long) < MAX_MESSAGE + 10 and long.endswith("end")


def test_the_documentation_names_every_limit():
    text = (Path(__file__).parents[2] / "docs" / "RELIABILITY.md").read_text(encoding="utf-8")
    named = [name for name in vars(limits) if name.startswith("MAX_")]
    assert [name for name in named if f"`{name}`" not in text] == []
