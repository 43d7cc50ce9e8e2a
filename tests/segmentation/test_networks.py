"""Network files: told apart, opened, read; and one clear line for each that cannot be used."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tiny_networks import NAMES, segment_image, write_classifier, write_yolo, yolo_rows
from tiny_onnx import INT64, write_onnx

from simaps_viz.errors import InputError
from simaps_viz.segmentation.class_names import names_in, read_class_names, things_among
from simaps_viz.segmentation.recognise import NetworkSettings, open_network
from simaps_viz.segmentation.session import choose_providers, letterbox, top_left
from simaps_viz.segmentation.yolo_seg import Detections, detection_masks, raw_detections, suppress

ROOT = Path(__file__).parents[2]
GREY = np.full((24, 32, 3), 90, np.uint8)


def opened(path: Path, **settings):
    return open_network(path, NetworkSettings(providers=("cpu",), threads=1, **settings))[0]


def test_a_yolo_network_gives_its_boxes(tmp_path):
    """The 24 x 32 picture lies 4 pixels below the top of the 32 x 32 input."""
    path = write_yolo(tmp_path / "n.onnx", [(2, 6, 12, 18, 0, 0.9), (20, 10, 30, 20, 2, 0.5), (2, 6, 12, 18, 1, 0.1)])
    network = opened(path)
    assert network.labels == NAMES and network.is_thing == (True, True, True)
    found = segment_image(network, GREY)
    expected = np.zeros((24, 32), np.int32)
    expected[2:14, 2:12] = 1
    expected[6:16, 20:30] = 2
    np.testing.assert_array_equal(found.ids, expected)
    assert [(s.id, s.label, s.score, s.is_thing) for s in found.segments] == [
        (1, "chair", 0.9, True), (2, "tv", 0.5, True)]  # fmt: skip


def test_smaller_masks_lie_on_top_and_hidden_ones_are_left_out(tmp_path):
    boxes = [(4, 8, 12, 16, 1, 0.4), (0, 4, 30, 28, 0, 0.9), (4, 8, 12, 16, 2, 0.8)]
    found = segment_image(opened(write_yolo(tmp_path / "n.onnx", boxes)), GREY)
    assert [(s.label, s.score) for s in found.segments] == [("chair", 0.9), ("tv", 0.8)]  # of two alike, the surer
    chair, tv = (s.id for s in found.segments)
    expected = np.zeros((24, 32), np.int32)
    expected[0:24, 0:30], expected[4:12, 4:12] = chair, tv
    np.testing.assert_array_equal(found.ids, expected)


def test_boxes_of_one_class_suppress_each_other(tmp_path):
    boxes = [(2, 6, 12, 18, 0, 0.6), (3, 6, 13, 18, 0, 0.9), (3, 6, 13, 18, 1, 0.7)]
    found = segment_image(opened(write_yolo(tmp_path / "n.onnx", boxes), score=0.25), GREY)
    assert [(s.label, s.score) for s in found.segments] == [("chair", 0.9)]  # it hides the table of the same mask
    separate = segment_image(opened(tmp_path / "n.onnx", iou=0.95), GREY)
    assert [(s.label, s.score) for s in separate.segments] == [("chair", 0.9), ("chair", 0.6)]


def plain_suppress(found: Detections, iou: float) -> list[int]:
    kept: list[int] = []
    for i in sorted(range(len(found.scores)), key=lambda i: -found.scores[i]):
        a = found.boxes[i].astype(float)
        for j in kept:
            b = found.boxes[j].astype(float)
            w, h = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
            shared = max(w, 0.0) * max(h, 0.0)
            total = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - shared
            if found.classes[i] == found.classes[j] and shared > iou * total:
                break
        else:
            kept.append(i)
    return kept


def test_suppression_and_masks_are_those_of_the_plain_twins():
    rng = np.random.default_rng(0)
    low = rng.uniform(0, 24, (60, 2))
    boxes = np.concatenate([low, low + rng.uniform(3, 14, (60, 2))], axis=1).astype(np.float32)
    scores, classes = rng.permutation(60).astype(np.float32) / 60, rng.integers(0, 2, 60)
    found = Detections(boxes, scores, classes, rng.normal(size=(60, 2)).astype(np.float32))
    for iou in (0.2, 0.5):
        assert suppress(found, iou).tolist() == plain_suppress(found, iou)
    prototypes = rng.normal(size=(2, 8, 8)).astype(np.float32)
    place = letterbox(24, 32, into=(32, 32))
    masks = detection_masks(found, prototypes, place, (32, 32), (24, 32), 0.5)
    for (top, left, mask), box, row in zip(masks, boxes, found.coefficients, strict=True):
        whole = np.zeros((24, 32), bool)
        whole[top : top + mask.shape[0], left : left + mask.shape[1]] = mask
        certain = np.zeros((24, 32), bool)
        for v in range(24):
            for u in range(32):
                x, y = u + 0.5, v + 4.5
                if not (round(box[0]) <= u < round(box[2]) and round(box[1]) <= v + 4 < round(box[3])):
                    certain[v, u] = not whole[v, u] and not (
                        box[0] - 1 < x < box[2] + 1 and box[1] - 1 < y < box[3] + 1
                    )
                    continue
                px, py = min(max(x / 4 - 0.5, 0), 7), min(max(y / 4 - 0.5, 0), 7)
                x0, y0 = min(int(px), 6), min(int(py), 6)
                corner = np.einsum("p,pyx->yx", row, prototypes[:, y0 : y0 + 2, x0 : x0 + 2])
                fx, fy = px - x0, py - y0
                logit = (1 - fy) * ((1 - fx) * corner[0, 0] + fx * corner[0, 1]) + fy * (
                    (1 - fx) * corner[1, 0] + fx * corner[1, 1])  # fmt: skip
                assert abs(logit) < 0.05 or whole[v, u] == (1 / (1 + np.exp(-logit)) > 0.5)


def test_detections_are_taken_by_their_best_class():
    rows = yolo_rows([(2, 6, 12, 18, 0, 0.3), (4, 4, 8, 8, 2, 0.2)])[0]
    rows[5, 0] = 0.6
    found = raw_detections(rows, 3, 0.25)
    assert found.boxes.tolist() == [[2.0, 6.0, 12.0, 18.0]] and found.classes.tolist() == [1]
    assert found.scores.tolist() == [np.float32(0.6)] and found.coefficients.tolist() == [[1.0, 0.0]]


def test_exports_that_suppress_by_themselves_are_read(tmp_path):
    rows = np.zeros((1, 5, 6 + 2), np.float32)
    rows[0, 0] = (2, 6, 12, 18, 0.9, 1, 1.0, 0.0)
    prototypes = np.full((1, 2, 8, 8), 4.0, np.float32)
    path = write_onnx(
        tmp_path / "n.onnx", {"output0": rows, "output1": prototypes}, metadata={"names": repr(list(NAMES))}
    )
    found = segment_image(opened(path), GREY)
    assert [s.label for s in found.segments] == ["dining table"] and (found.ids[2:14, 2:12] == 1).all()
    (tmp_path / "one.txt").write_text("chair\n")
    with pytest.raises(InputError, match=r"one.txt: expected a class name for each class that n.onnx finds, 2 or more"):
        segment_image(opened(path, labels=tmp_path / "one.txt"), GREY)


def test_sizes_that_the_file_leaves_open_are_found_by_running_it(tmp_path):
    boxes = [(2.0, 6.0, 12.0, 18.0, 0, 0.9)]
    shapes = {"output0": (1, 9, "anchors"), "output1": (1, 2, "h", "w")}
    path = write_yolo(tmp_path / "n.onnx", boxes, image=("batch", 3, "height", "width"), shapes=shapes)
    found = segment_image(opened(path, input_size=(32, 32)), GREY)
    assert [s.label for s in found.segments] == ["chair"] and found.ids[2, 2] == 1


def test_fewer_threads_than_none_are_refused(tmp_path):
    path = write_yolo(tmp_path / "n.onnx", [(2, 6, 12, 18, 0, 0.9)])
    with pytest.raises(InputError, match=r"threads: expected 0 .one for each core. or more, found -3"):
        open_network(path, NetworkSettings(providers=("cpu",), threads=-3))


def test_a_mask_classifier_knows_things_and_stuff(tmp_path):
    network = opened(write_classifier(tmp_path / "n.onnx"))
    assert network.labels == ("chair", "floor") and network.is_thing == (True, False)
    found = segment_image(network, GREY)
    assert (found.ids[:, :15] == 1).all() and (found.ids[:, 17:] == 2).all()
    assert [(s.label, s.is_thing) for s in found.segments] == [("chair", True), ("floor", False)]


def test_a_mask_classifier_of_another_exporter_is_recognised_by_shapes_alone(tmp_path):
    classes, masks = np.zeros((1, 5, 3), np.float32), np.zeros((1, 5, 4, 4), np.float32)
    path = write_onnx(tmp_path / "n.onnx", {"a": classes, "b": masks, "other": np.zeros((7,), np.float32)})
    (tmp_path / "config.json").write_text(json.dumps({"id2label": {"0": "bed", "1": "wall"}}))
    assert opened(path).labels == ("bed", "wall")


BOX = [(2.0, 6.0, 12.0, 18.0, 0, 0.9)]
PICTURE = (1, 3, 32, 32)


def wrong_networks(folder: Path):
    """Return (file, settings, what has to be said)."""
    good = write_yolo(folder / "good.onnx", BOX)
    (folder / "two.txt").write_text("chair\ntable\n")
    (folder / "bad.onnx").write_bytes(b"no network")
    (folder / "cut.onnx").write_bytes(good.read_bytes()[:200])
    only = write_onnx(folder / "only.onnx", {"logits": np.zeros((1, 1000), np.float32)})
    unnamed = write_yolo(folder / "unnamed.onnx", BOX, metadata={})
    many = write_yolo(folder / "many.onnx", BOX, inputs={"a": PICTURE, "b": (1, 77)})
    whole = write_yolo(folder / "whole.onnx", BOX, kind=INT64)
    grey = write_yolo(folder / "grey.onnx", BOX, image=(1, 1, 32, 32))
    batch = write_yolo(folder / "batch.onnx", BOX, image=(8, 3, 32, 32))
    strange = write_yolo(folder / "strange.onnx", BOX, metadata={"names": "chairs and tables"})
    return [
        (folder / "none.onnx", {}, "expected a network (.onnx), found nothing"),
        (folder / "bad.onnx", {}, "expected an ONNX network, found a file that is none"),
        (folder / "cut.onnx", {}, "expected an ONNX network, found a file that is none"),
        (only, {}, "found the outputs logits [1, 1000]"),
        (unnamed, {}, "expected class names in its metadata"),
        (
            good,
            {"labels": folder / "two.txt"},
            "two.txt: expected 3 class names, as many as good.onnx tells apart, found 2",
        ),
        (good, {"labels": folder / "none.txt"}, "none.txt: expected class names"),
        (good, {"input_size": (64, 64)}, "expected --input-size 32 32, the only one it takes, found 64 64"),
        (good, {"score": 1.5}, "score threshold: expected more than 0 and less than 1, found 1.5"),
        (many, {}, "expected one input [1, 3, height, width] of floats, found a [1, 3, 32, 32] float32, b [1, 77]"),
        (whole, {}, "expected one input [1, 3, height, width] of floats"),
        (grey, {}, "expected one input [1, 3, height, width], found images [1, 1, 32, 32]"),
        (batch, {}, "expected one input [1, 3, height, width], found images [8, 3, 32, 32]"),
        (strange, {}, "expected a list of class names"),
    ]


def test_what_cannot_be_used_is_refused_in_one_line(tmp_path):
    for path, settings, words in wrong_networks(tmp_path):
        with pytest.raises(InputError) as caught:
            opened(path, **settings)
        message = str(caught.value)
        assert words in message and "\n" not in message and len(message) < 400, message


def test_providers_that_are_not_there_are_named():
    available = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    assert choose_providers((), available) == available
    assert choose_providers((), ["AzureExecutionProvider", "CPUExecutionProvider"]) == ["CPUExecutionProvider"]
    assert choose_providers(("cpu",), available) == ["CPUExecutionProvider"]
    assert choose_providers(("CUDAExecutionProvider",), available) == available
    many = ["TensorrtExecutionProvider", "DmlExecutionProvider", "OpenVINOExecutionProvider", "CPUExecutionProvider"]
    assert choose_providers((), many) == [many[1], many[2], many[3]]  # TensorRT compiles for minutes
    assert choose_providers(("tensorrt", "directml"), many) == [many[0], many[1], many[3]]
    with pytest.raises(InputError, match=r"--providers rocm: expected some of cuda, cpu, .*found 'rocm'"):
        choose_providers(("rocm",), available)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.txt", "chair\ndining table\nwall\n\n"),
        ("a.json", '["chair", "dining table", "wall"]'),
        ("a.json", '{"2": "wall", "0": "chair", "1": "dining table"}'),
        ("a.json", '{"id2label": {"0": "chair", "1": "dining table", "2": "wall"}}'),
        ("a.json", '{"categories": [{"name": "chair"}, {"name": "dining table"}, {"name": "wall", "isthing": 0}]}'),
    ],
)
def test_class_names_come_in_many_files(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    names = read_class_names(tmp_path / name)
    assert names.labels == ("chair", "dining table", "wall") and names.is_thing == (True, True, False)


@pytest.mark.parametrize("table", ["{}", '{"1": "a"}', '{"a": 0}', "3", '["a", ""]', '["none"]', '[{"name": 3}]'])
def test_bad_class_names_are_refused(table):
    with pytest.raises(InputError, match="expected"):
        names_in("side file", json.loads(table))


@pytest.mark.slow
def test_networks_report_to_nobody(tmp_path):
    """onnxruntime's telemetry, where its build has one, begins with a device id in the user's cache folder."""
    write_yolo(tmp_path / "n.onnx", [])
    program = "import sys, simaps_viz.segmentation.session as s; s.Session(sys.argv[1])"
    environment = {name: value for name, value in os.environ.items() if name not in ("CI", "ORT_DISABLE_TELEMETRY")}
    environment |= {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home"), "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-c", program, str(tmp_path / "n.onnx")], env=environment, check=True)
    assert not list((tmp_path / "home").rglob("*"))


def test_a_side_file_can_say_what_is_a_thing():
    names = names_in("x", [{"name": "wall", "isthing": 1}, {"name": "chair", "isthing": 0}])
    assert names.is_thing == (True, False)
    assert things_among(("floor, flooring", "bed")) == (False, True)


def test_placements_map_corners_to_corners():
    place = letterbox(360, 540, into=(640, 640))
    assert (place.width, place.height, place.left, place.top) == (640, 427, 0, 106)
    corners = np.array([[place.left, place.top, place.left + place.width, place.top + place.height]], np.float32)
    np.testing.assert_allclose(place.to_picture(corners), [[0, 0, 540, 360]], atol=1e-3)
    assert (top_left(360, 540, into=(640, 640)).top, top_left(360, 540, into=(640, 640)).height) == (0, 427)
