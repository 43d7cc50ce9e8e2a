"""Faulty sequences: each fault gives one line that names the file, what was expected and what was found."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sequences import FOCAL, HEIGHT, WIDTH, frame_name, write_manifest, write_tiny_sequence

from simaps_viz.datasets.images import read_color, read_depth
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError

FRAMES = 12
UNSAMPLED = 7
"""Not among the frames that are read on opening."""

Change = Callable[[Path], object]


def text(name: str, content: str) -> Change:
    return lambda folder: (folder / name).write_text(content)


def remove(*names: str) -> Change:
    return lambda folder: [(folder / name).unlink() for name in names]


def manifest(**changes: Any) -> Change:
    return lambda folder: write_manifest(folder, truth="segments", changes=changes)


def segmentation(**changes: Any) -> Change:
    keys = {"ids": "ids/{frame}.png", "segments": "segments.json", "source": "x", "ground_truth": False} | changes
    return manifest(segmentation={key: value for key, value in keys.items() if value is not None})


def scene(*instances: Any) -> Change:
    def change(folder: Path) -> None:
        (folder / "scene.json").write_text(json.dumps({"instances": list(instances)}))
        segmentation(segments=None, instances="scene.json")(folder)

    return change


def table(frame: str, entries: Any) -> Change:
    def change(folder: Path) -> None:
        content = json.loads((folder / "segments.json").read_text())
        content[frame] = entries
        (folder / "segments.json").write_text(json.dumps(content))

    return change


def pose(line: int, edit: Callable[[list[str]], list[str]]) -> Change:
    def change(folder: Path) -> None:
        lines = (folder / "poses.txt").read_text().splitlines()
        lines[line - 1] = " ".join(edit(lines[line - 1].split()))
        (folder / "poses.txt").write_text("\n".join(lines))

    return change


def put(index: int, value: str) -> Callable[[list[str]], list[str]]:
    return lambda words: [*words[:index], value, *words[index + 1 :]]


def transpose(words: list[str]) -> list[str]:
    """Move the camera first: the pose of frame 0 has no translation but its height."""
    return [words[0], *np.array(words[1:]).reshape(4, 4).T.ravel()]


def image(name: str, array: np.ndarray) -> Change:
    return lambda folder: cv2.imwrite(str(folder / name), array)


def truncate(name: str, keep: float = 0.5) -> Change:
    def change(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(len(data) * keep)])

    return change


def camera(fx: float = FOCAL, fy: float = FOCAL, cx: float = 15.5, cy: float = 11.5, skew: float = 0) -> Change:
    return text("intrinsics.txt", f"{fx} {skew} {cx}\n0 {fy} {cy}\n0 0 1\n")


FIRST, LATE = frame_name(0), frame_name(UNSAMPLED)
ZEROS = np.zeros((HEIGHT, WIDTH), np.uint16)

ON_OPENING = {
    "no manifest": (remove("sequence.json"), "no_mani", "a recording of a format", "scene.json, segments.json"),
    "not JSON": (text("sequence.json", '{"name": "x",\n oops'), "sequence.json", "JSON", "error in line 2"),
    "not text": (lambda f: (f / "sequence.json").write_bytes(b"\xff\xfe\x00"), "sequence.json", "JSON", "not UTF-8"),
    "a list": (text("sequence.json", "[1, 2]"), "sequence.json", "object", "[1, 2]"),
    "deep": (text("sequence.json", "[" * 100000), "sequence.json", "JSON", "neither"),
    "no format": (manifest(format=None), "sequence.json", "format", "no such key"),
    "format": (manifest(format="posed-frames/2"), "sequence.json", '"posed-frames/1"', '"posed-frames/2"'),
    "unknown key": (
        manifest(depth_units_m=1),
        "sequence.json",
        "known",
        '"depth_units_m"; did you mean "depth_unit_m"?',
    ),
    "odd key": (manifest(zzzz=1), "sequence.json", "known", '"zzzz"; known are format, color'),
    "inner key": (segmentation(sauce="y"), "sequence.json: segmentation", "known", '"sauce"; did you mean "source"?'),
    "no color": (manifest(color=None), "sequence.json", "color: expected a string", "no such key"),
    "color is a number": (manifest(color=3), "sequence.json", "color: expected a string", "3"),
    "no {frame}": (manifest(color="color/0010.png"), "sequence.json", "{frame}", '"color/0010.png"'),
    "no {frame} in ids": (segmentation(ids="ids.png"), "sequence.json: segmentation", "{frame}", '"ids.png"'),
    "absolute": (manifest(depth="/d/{frame}.png"), "sequence.json", "relative", '"/d/{frame}.png"'),
    "two lines": (manifest(depth="a\n{frame}"), "sequence.json", "depth: expected a printable", '"a\\n{frame}"'),
    "pose": (manifest(pose="T_camera_world"), "sequence.json", '"T_world_camera", the only supp', '"T_camera_world"'),
    "axes": (manifest(camera_axes="x right, y up"), "sequence.json", '"x right, y down, z forward"', '"x right, y up"'),
    "up": (manifest(up=[0, 0, 0]), "sequence.json", "up: expected three finite", "[0, 0, 0]"),
    "up of two": (manifest(up=[0, 1]), "sequence.json", "up: expected three finite", "[0, 1]"),
    "up is NaN": (manifest(up=[0, 1, float("nan")]), "sequence.json", "up: expected three finite", "NaN"),
    "floor": (manifest(floor_height_m="low"), "sequence.json", "floor_height_m: expected a number", '"low"'),
    "simulated": (manifest(simulated="yes"), "sequence.json", "simulated: expected true or false", '"yes"'),
    "unit 0": (manifest(depth_unit_m=0), "sequence.json", "more than 0", "0.0"),
    "unit true": (manifest(depth_unit_m=True), "sequence.json", "depth_unit_m: expected a number", "true"),
    "unit m": (manifest(depth_unit_m=1.0), "sequence.json", "0.15 to 30 m", "2000 m with 1; depth_unit_m 0.001"),
    "unit um": (manifest(depth_unit_m=1e-6), "sequence.json", "0.15 to 30 m", "0.002 m with 1e-06; depth_unit_m 0.001"),
    "two tables": (segmentation(instances="scene.json"), "sequence.json", "either", "segments and instances"),
    "no table": (segmentation(segments=None), "sequence.json", 'either "segments" or', "neither"),
    "no ids": (segmentation(ids=None), "sequence.json: segmentation", "ids: expected a string", "no such key"),
    "segmentation": (manifest(segmentation="ids"), "sequence.json: segmentation", "object", '"ids"'),
    "truth": (segmentation(ground_truth=1), "sequence.json: segmentation", "ground_truth: expected true", "1"),
    "color lost": (
        remove(f"color/{LATE}.png", f"color/{FIRST}.png"),
        "sequence.json",
        "all of every frame",
        f"2 of {FRAMES} frames have no colour file ({FIRST}, {LATE}): left out",
    ),
    "depth lost": (remove(f"depth/{LATE}.png"), "sequence.json", "all of every frame", f"no depth file ({LATE})"),
    "ids lost": (remove(f"ids/{LATE}.png"), "sequence.json", "all of every frame", f"no id image ({LATE})"),
    "no intrinsics": (remove("intrinsics.txt"), "intrinsics.txt", "a text file", "No such file"),
    "2x3": (text("intrinsics.txt", "40 0 15\n0 40 11\n"), "intrinsics.txt", "3x3", "2 lines of 3 numbers"),
    "3x4": (text("intrinsics.txt", "40 0 15 0\n" * 3), "intrinsics.txt", "3x3", "3 lines of 4 numbers"),
    "empty K": (text("intrinsics.txt", ""), "intrinsics.txt", "3x3", "0 lines of no numbers"),
    "K in words": (text("intrinsics.txt", "fx 0 15\n"), "intrinsics.txt, line 1", "finite numbers", "'fx'"),
    "K last row": (text("intrinsics.txt", "40 0 15\n0 40 11\n0 0 2\n"), "intrinsics.txt", "0 0 1", "0 0 2"),
    "skew": (camera(skew=1.5), "intrinsics.txt", "without skew", "1.5"),
    "fx": (camera(fx=-40), "intrinsics.txt", "over 0", "-40"),
    "fy": (camera(fy=0), "intrinsics.txt", "over 0", "40 and 0"),
    "cx": (camera(cx=255.5), "intrinsics.txt", "inside the 32x24 image", "(255.5, 11.5)"),
    "cy": (camera(cy=-3), "intrinsics.txt", "inside the 32x24 image", "(15.5, -3)"),
    "narrow": (camera(fx=430, fy=430), "intrinsics.txt", "20 to 150 degrees", "4.26 (focal length 430 for 32"),
    "wide": (camera(fx=2), "intrinsics.txt", "horizontal field of view", "166"),
    "tall": (camera(fy=2), "intrinsics.txt", "vertical field of view", "161"),
    "no poses": (remove("poses.txt"), "poses.txt", "a text file", "No such file"),
    "empty poses": (text("poses.txt", "# none yet\n"), "poses.txt", "a pose per frame", "none"),
    "13 columns": (pose(3, lambda words: words[:13]), "poses.txt, line 3", "16 numbers", "12"),
    "NaN": (pose(3, put(4, "nan")), "poses.txt, line 3", "finite", "NaN"),
    "no number": (pose(3, put(4, "1,5")), "poses.txt, line 3", "numbers", "'1,5'"),
    "twice": (pose(3, put(0, FIRST)), "poses.txt, line 3", "each frame once", f"{FIRST} again (first in line 1)"),
    "mirrored": (pose(3, put(1, "-1")), "poses.txt, line 3", "right-handed", "mirrored"),
    "scaled": (pose(3, put(1, "1.5")), "poses.txt, line 3", "orthonormal", "off by 1.25"),
    "last row": (pose(3, put(16, "2")), "poses.txt, line 3", "0 0 0 1 as the last row", "0 0 0 2"),
    "far": (pose(3, put(4, "1e7")), "poses.txt, line 3, frame 0012", "within 1000 m", "1e+07 m away; are the pos"),
    "columns first": (pose(1, transpose), "poses.txt, line 1", "0 0 0 1", "0 0 2 1; is the matrix written column by"),
    "no depth": (
        lambda f: [image(f"depth/{frame_name(i)}.png", ZEROS)(f) for i in range(FRAMES)],
        "depth/0010.png",
        "depth readings",
        "only 0 in 5 sampled frames",
    ),
    "depth size": (image(f"depth/{FIRST}.png", ZEROS[:20]), f"depth/{FIRST}.png", "32x24 pixels", "32x20"),
    "ids size": (image(f"ids/{FIRST}.png", ZEROS[:, :30]), f"ids/{FIRST}.png", "32x24 pixels", "30x24"),
    "8-bit depth": (
        image(f"depth/{FIRST}.png", ZEROS.astype(np.uint8)),
        f"depth/{FIRST}.png",
        "16-bit depth image with one channel",
        "8 bits and 1 channel",
    ),
    "color as ids": (
        image(f"ids/{FIRST}.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8)),
        f"ids/{FIRST}.png",
        "8- or 16-bit segment ids in one channel",
        "8 bits and 3 channels",
    ),
    "no table file": (remove("segments.json"), "segments.json", "a JSON file", "No such file"),
    "table is a list": (text("segments.json", "[]"), "segments.json", "{frame: [segments]}", "[]"),
    "table lacks all": (
        text("segments.json", '{"0010.png": []}'),
        "segments.json",
        f"an entry for each of {FRAMES}",
        f"none for {FRAMES}: 0010, 0011, 0012, ...",
    ),
    "table lacks id": (table(FIRST, []), f"ids/{FIRST}.png", "only ids that segments.json lists", "3 without an entry"),
    "entry": (table(LATE, {"id": 1}), f"segments.json: frame {LATE}", "a list of segments", '{"id": 1}'),
    "no object": (table(LATE, [3]), f"segments.json: frame {LATE}", "objects with id and label", "3"),
    "id 0": (table(LATE, [{"id": 0, "label": "x"}]), f"segments.json: frame {LATE}", "from 1 to 65535", "0"),
    "id 1.5": (table(LATE, [{"id": 1.5, "label": "x"}]), f"segments.json: frame {LATE}", "whole number", "1.5"),
    "id twice": (
        table(LATE, [{"id": 1, "label": "x"}, {"id": 1, "label": "y"}]),
        f"segments.json: frame {LATE}",
        "each id once",
        "1 again",
    ),
    "no label": (table(LATE, [{"id": 1}]), f"segments.json: frame {LATE}: id 1", "a class name", "null"),
    "none": (table(LATE, [{"id": 1, "label": "none"}]), "segments.json", 'a class name (not "none")', '"none"'),
    "score": (table(LATE, [{"id": 1, "label": "x", "score": 87}]), "segments.json", "score from 0 to 1", "87"),
    "no instances": (segmentation(segments=None, instances="segments.json"), "segments.json", '"instances"', "0010"),
    "scene id": (scene({"id": "1", "label": "x"}), "scene.json: instances", "from 1 to 65535", '"1"'),
    "scene id twice": (
        scene({"id": 1, "label": "x"}, {"id": 1, "label": "y"}),
        "scene.json: instances",
        "each id once",
        "1 again",
    ),
    "isthing": (scene({"id": 1, "label": "x", "isthing": 1}), "scene.json: instances: id 1", "isthing as true", "1"),
    "both": (
        scene({"id": 1, "label": "x", "isthing": True}, {"id": 2, "label": "x", "isthing": False}),
        "scene.json: instances",
        '"x" to be thing or stuff',
        "both ways",
    ),
    "scene lacks": (scene({"id": 1, "label": "x"}), f"ids/{FIRST}.png", "scene.json lists", "2 without an entry: 2, 3"),
}

WHEN_READ = {
    "empty": (truncate(f"depth/{LATE}.png", 0), f"depth/{LATE}.png", "whole image", "an empty file"),
    "stub": (truncate(f"depth/{LATE}.png", 0.03), f"depth/{LATE}.png", "image", "cannot be decoded"),
    "truncated depth": (truncate(f"depth/{LATE}.png"), f"depth/{LATE}.png", "whole image", "a truncated PNG"),
    "truncated ids": (truncate(f"ids/{LATE}.png", 0.95), f"ids/{LATE}.png", "whole image", "a truncated PNG"),
    "truncated color": (truncate(f"color/{LATE}.png"), f"color/{LATE}.png", "whole image", "a truncated PNG"),
    "text": (text(f"depth/{LATE}.png", "not an image at all"), f"depth/{LATE}.png", "image", "cannot be decoded"),
    "gone": (remove(f"depth/{LATE}.png"), f"depth/{LATE}.png", "an image", "No such file"),
    "depth size": (image(f"depth/{LATE}.png", ZEROS[:20]), f"depth/{LATE}.png", "32x24 pixels", "32x20"),
    "ids size": (image(f"ids/{LATE}.png", ZEROS[:20]), f"ids/{LATE}.png", "32x24 pixels", "32x20"),
    "color size": (image(f"color/{LATE}.png", ZEROS[:20]), f"color/{LATE}.png", "32x24 pixels", "32x20"),
    "unknown id": (image(f"ids/{LATE}.png", ZEROS + 9), f"ids/{LATE}.png", f"frame {LATE}", "1 without an entry: 9"),
    "unknown 16-bit id": (image(f"ids/{LATE}.png", ZEROS + 40000), f"ids/{LATE}.png", "lists", "entry: 40000"),
}


def check_message(error: InputError, names: str, expected: str, found: str) -> None:
    message = str(error)
    assert "\n" not in message
    assert len(message) < 500
    assert names in message
    before, word, after = message.partition("found")
    assert word and "expected" in before
    assert expected in before or ("left out" in message and expected in after)
    assert found in after


@pytest.mark.parametrize(("change", "names", "expected", "found"), ON_OPENING.values(), ids=ON_OPENING.keys())
def test_faults_on_opening(tmp_path: Path, change: Change, names: str, expected: str, found: str) -> None:
    write_tiny_sequence(tmp_path, frames=FRAMES)
    open_sequence(tmp_path)
    change(tmp_path)
    with pytest.raises(InputError) as caught:
        open_sequence(tmp_path, strict=True)
    check_message(caught.value, names, expected, found)


@pytest.mark.parametrize(("change", "names", "expected", "found"), WHEN_READ.values(), ids=WHEN_READ.keys())
def test_faults_when_read(
    tmp_path: Path, change: Change, names: str, expected: str, found: str, capfd: pytest.CaptureFixture[str]
) -> None:
    sequence = open_sequence(write_tiny_sequence(tmp_path, frames=FRAMES))
    change(tmp_path)
    with pytest.raises(InputError) as caught:
        sequence.read(UNSAMPLED, color=True)
        sequence.segmentation(UNSAMPLED)
    check_message(caught.value, names, expected, found)
    assert capfd.readouterr() == ("", ""), "the decoder says nothing of its own"


@pytest.mark.parametrize(
    ("name", "expected", "found"),
    [
        ("nowhere", "a recording of a format that is read, or a manifest", "nothing"),
        ("map.npz", "a recording of a format that is read, or a manifest", "a map"),
        ("empty", "a recording of a format that is read", "an empty folder"),
    ],
)
def test_paths_that_are_no_sequence(tmp_path: Path, name: str, expected: str, found: str) -> None:
    (tmp_path / "map.npz").write_bytes(b"PK")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError) as caught:
        open_sequence(tmp_path / name)
    check_message(caught.value, name, expected, found)


@pytest.mark.parametrize("index", [-1, 3])
def test_no_such_frame(tmp_path: Path, index: int) -> None:
    sequence = open_sequence(write_tiny_sequence(tmp_path))
    for read in (sequence.read, sequence.color, sequence.segmentation):
        with pytest.raises(InputError, match=f"a frame index from 0 to 2, found {index}"):
            read(index)


def test_jpeg_ids_are_refused(tmp_path: Path) -> None:
    write_tiny_sequence(tmp_path, frames=1)
    cv2.imwrite(str(tmp_path / "ids" / f"{FIRST}.jpg"), ZEROS.astype(np.uint8))
    segmentation(ids="ids/{frame}.jpg")(tmp_path)
    with pytest.raises(InputError, match=r"\.jpg: expected a whole image, found a JPEG, which does not keep"):
        open_sequence(tmp_path)


def noise(shape: tuple[int, ...], dtype: type) -> np.ndarray:
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape).astype(dtype)


PNG = cv2.imencode(".png", noise((40, 50), np.uint16))[1].tobytes()
JPEG = cv2.imencode(".jpg", noise((40, 50, 3), np.uint8))[1].tobytes()


@given(keep=st.integers(0, len(PNG) - 1))
def test_no_part_of_a_png_is_taken_for_the_whole(tmp_path_factory: pytest.TempPathFactory, keep: int) -> None:
    path = tmp_path_factory.getbasetemp() / "part.png"
    path.write_bytes(PNG[:keep])
    with pytest.raises(InputError, match=r"part\.png: expected"):
        read_depth(path, 0.001)


@given(at=st.integers(0, len(PNG) - 1), flip=st.integers(1, 255))
def test_no_damaged_byte_of_a_png_goes_unnoticed(tmp_path_factory: pytest.TempPathFactory, at: int, flip: int) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.png"
    path.write_bytes(PNG[:at] + bytes([PNG[at] ^ flip]) + PNG[at + 1 :])
    with pytest.raises(InputError, match=r"damaged\.png: expected"):
        read_depth(path, 0.001)


@given(keep=st.integers(0, len(JPEG) - 1))
def test_no_part_of_a_jpeg_is_taken_for_the_whole(tmp_path_factory: pytest.TempPathFactory, keep: int) -> None:
    path = tmp_path_factory.getbasetemp() / "part.jpg"
    path.write_bytes(JPEG[:keep])
    with pytest.raises(InputError, match=r"part\.jpg: expected"):
        read_color(path)
