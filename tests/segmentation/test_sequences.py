"""Networks over sequences: kept and resumed, mapped, written as files and read back; floor and walls by geometry."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from checked_sequences import SHARED, drawn_room
from sequences import HEIGHT, WIDTH, lying, write_tiny_sequence
from tiny_networks import CHAIR, OwnNetwork, TopNetwork, write_classifier, write_yolo
from tiny_onnx import write_onnx

from simaps_viz import BuildConfig, build_map, open_sequence
from simaps_viz.app.workbench import sequence_of
from simaps_viz.cli.main import main
from simaps_viz.errors import InputError
from simaps_viz.geometry import turned
from simaps_viz.scenes.demo import DemoSettings, ensure_demo
from simaps_viz.segmentation import geometry_stuff
from simaps_viz.segmentation.coco_panoptic import read_coco_panoptic, read_panoptic_png, write_coco_panoptic
from simaps_viz.segmentation.geometry_stuff import add_stuff
from simaps_viz.segmentation.mask_store import About, MaskStore, find_store, write_masks
from simaps_viz.segmentation.recognise import open_network
from simaps_viz.segmentation.sequences import WithMasks, needs_stuff, segment_sequence, segmented
from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation


@pytest.fixture
def sequence(tmp_path):
    return open_sequence(write_tiny_sequence(tmp_path / "tiny", frames=5))


def test_every_frame_is_looked_at_once_and_results_are_kept(sequence, tmp_path):
    network = OwnNetwork()
    told: list[tuple[str, int, int]] = []
    masks = segment_sequence(sequence, network, tmp_path, stuff=False, progress=lambda *step: told.append(step))
    assert network.runs == 5 and told == [("segmenting, own", i, 5) for i in range(6)]
    for index in range(5):
        np.testing.assert_array_equal(masks.segmentation(index).ids, CHAIR)
        assert masks.segmentation(index).segments == (Segment(1, "chair", 0.75),)
    assert (masks.labels, masks.is_thing, len(masks)) == (("none", "chair"), (False, True), 5)
    assert masks.segmentation_source.startswith("own [") and masks.name == sequence.name
    again = OwnNetwork(stop_after=0)
    np.testing.assert_array_equal(segment_sequence(sequence, again, tmp_path, stuff=False).segmentation(4).ids, CHAIR)
    assert again.runs == 0
    other = OwnNetwork("2")
    segment_sequence(sequence, other, tmp_path, stuff=False)
    assert other.runs == 5
    assert all(len(threads) == 1 for threads in network.threads.values())
    assert len(set.union(*network.threads.values())) == 3


def test_an_interrupted_run_goes_on_where_it_stopped(sequence, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        segment_sequence(sequence, OwnNetwork(stop_after=3), tmp_path, stuff=False)
    store = next((tmp_path / "masks").iterdir())
    done = len((store / "segments.jsonl").read_text().splitlines())
    assert 1 <= done <= 3
    network = OwnNetwork()
    masks = segment_sequence(sequence, network, tmp_path, stuff=False)
    assert network.runs == 5 - done
    assert all(masks.segmentation(i).segments for i in range(5))


def test_a_torn_line_and_a_lost_image_are_made_again(sequence, tmp_path):
    segment_sequence(sequence, OwnNetwork(), tmp_path, stuff=False)
    store = next((tmp_path / "masks").iterdir())
    lines = (store / "segments.jsonl").read_text()
    (store / "segments.jsonl").write_text(lines[:-20])
    (store / "000001.png").unlink()
    network = OwnNetwork()
    segment_sequence(sequence, network, tmp_path, stuff=False)
    assert network.runs == 2
    final = OwnNetwork()
    segment_sequence(sequence, final, tmp_path, stuff=False)
    assert final.runs == 0


def test_a_picture_that_was_replaced_is_looked_at_again(sequence, tmp_path):
    segment_sequence(sequence, OwnNetwork(), tmp_path, stuff=False)
    picture = sequence.color_file(2)
    assert cv2.imwrite(str(picture), np.full((HEIGHT, WIDTH, 3), 7, np.uint8))
    network = OwnNetwork()
    segment_sequence(sequence, network, tmp_path, stuff=False)
    assert network.runs == 1


def test_a_map_is_built_of_a_networks_masks_from_the_command_line(tmp_path, monkeypatch, capsys):
    cache = tmp_path / "cache"
    monkeypatch.setenv("SIMAPS_CACHE", str(cache))
    write_tiny_sequence(tmp_path / "tiny")
    net = write_yolo(tmp_path / "n.onnx", [(2.0, 6.0, 12.0, 18.0, 0, 0.9)])
    output = tmp_path / "map.npz"
    command = ["build", str(tmp_path / "tiny"), "--segmentation", str(net), "-o", str(output), "--providers", "cpu"]
    assert main(command) == 0
    from simaps_viz import load_map  # noqa: PLC0415

    simap = load_map(output)
    assert "chair" in simap.counts() and "floor" in simap.grid.labels
    assert simap.provenance["segmentation"].startswith("n.onnx, floor and wall by geometry [")
    reopened = sequence_of(simap)
    assert isinstance(reopened, WithMasks)
    assert (reopened.segmentation(0).ids[CHAIR] == 1).all()
    for store in (cache / "masks").iterdir():
        (store / "about.json").unlink()
    assert sequence_of(simap) is None
    assert main([*command[:3], str(tmp_path / "none.onnx"), *command[4:]]) == 2
    assert main([*command[:-1], "tpu"]) == 2
    said = capsys.readouterr().err
    assert "none.onnx: expected a network (.onnx), found nothing" in said.replace("\n", "")
    assert "expected some of" in said


def test_a_network_is_timed_on_a_recording(tmp_path, capsys):
    write_tiny_sequence(tmp_path / "tiny", frames=5)
    net = write_yolo(tmp_path / "n.onnx", [(2.0, 6.0, 12.0, 18.0, 0, 0.9)])
    command = ["bench-network", str(net), str(tmp_path / "tiny"), "--providers", "cpu"]
    assert main([*command, "--frames", "3", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["network"], found["device"], found["frames"], found["sequence"]) == ("n.onnx", "cpu", 3, "tiny")
    parts = found["ms_a_frame"]
    assert set(parts) == {"preparing", "running", "reading_its_output", "reading", "mapping"}
    assert min(parts.values()) >= 0.0
    assert 3 / found["frames_per_s"] == pytest.approx(found["seconds"], abs=0.00051)  # seconds have three decimals
    # no part that this thread does takes longer than the whole
    assert (parts["running"] + parts["reading"] + parts["mapping"]) * 3 / 1000 < found["seconds"] + 0.01
    assert main([*command, "--frames", "100"]) == 0
    assert "n.onnx on cpu, 5 frames of tiny: " in " ".join(capsys.readouterr().err.split())
    assert main([*command, "--frames", "0"]) == 2


def test_what_cannot_be_used_is_one_line_on_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path / "cache"))
    write_tiny_sequence(tmp_path / "tiny")
    good = write_yolo(tmp_path / "good.onnx", [(2.0, 6.0, 12.0, 18.0, 0, 0.9)])
    wrong = write_onnx(tmp_path / "wrong.onnx", {"logits": np.zeros((1, 1000), np.float32)})
    (tmp_path / "two.txt").write_text("chair\ntable\n")
    (tmp_path / "cut.onnx").write_bytes(good.read_bytes()[:200])
    for network, options, words in (
        (wrong, [], "found the outputs logits [1, 1000]"),
        (good, ["--labels", str(tmp_path / "two.txt")], "expected 3 class names, as many as good.onnx tells apart"),
        (good, ["--input-size", "64", "64"], "expected --input-size 32 32, the only one it takes, found 64 64"),
        (tmp_path / "cut.onnx", [], "expected an ONNX network, found a file that is none"),
        (good, ["--providers", "tpu"], "--providers tpu: expected some of"),
    ):
        for command in (["build", "-o", str(tmp_path / "m.npz"), "--segmentation"], ["segment"]):
            first, *rest = command
            assert main([first, str(tmp_path / "tiny"), *rest, str(network), *options]) == 2
            said = capsys.readouterr().err.strip()
            assert words in said and "\n" not in said and said.startswith("simaps: "), said
    assert not (tmp_path / "m.npz").exists() and sorted(p.name for p in tmp_path.glob("*.json")) == []


def test_segmented_frames_are_written_as_a_sequence(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path / "cache"))
    write_tiny_sequence(tmp_path / "tiny")
    net = write_classifier(tmp_path / "n.onnx", labels=("chair", "carpet floor"))
    labels = tmp_path / "labels.json"
    labels.write_text('[{"name": "chair", "isthing": 1}, {"name": "carpet floor", "isthing": 0}]')
    assert main(["segment", str(tmp_path / "tiny"), str(net), "--labels", str(labels), "--json"]) == 0
    written = json.loads(capsys.readouterr().out)
    assert written["frames"] == 3 and written["segments"] == 6
    sequence = open_sequence(Path(written["output"]))
    assert dict(zip(sequence.labels, sequence.is_thing, strict=True)) == {
        "none": False, "carpet floor": False, "chair": True}  # fmt: skip
    found = sequence.segmentation(1)
    assert [s.label for s in found.segments] == ["chair", "carpet floor"] and found.ids[5, 5] == 1
    assert build_map(sequence, BuildConfig()).counts()["chair"] >= 1
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    write_masks(sequence, elsewhere / "moved.json")
    moved = open_sequence(elsewhere / "moved.json")
    np.testing.assert_array_equal(moved.color(2), sequence.color(2))
    np.testing.assert_array_equal(moved.segmentation(2).ids, sequence.segmentation(2).ids)
    with pytest.raises(InputError, match="expected another name than the sequence's own manifest"):
        write_masks(sequence, sequence.path)


@pytest.mark.parametrize("plain", [True, False])
def test_coco_panoptic_files_come_back_as_they_went(sequence, tmp_path, plain):
    write_coco_panoptic(sequence, tmp_path / "panoptic.json", plain=plain)
    png = cv2.imread(str(tmp_path / "panoptic" / f"{sequence.frame_names[0]}.png"), cv2.IMREAD_UNCHANGED)
    assert png is not None and png.ndim == (2 if plain else 3)
    masks = read_coco_panoptic(tmp_path / "panoptic.json", sequence.frame_names)
    back = WithMasks(sequence, masks, masks.source)
    assert back.labels == sequence.labels and back.is_thing == sequence.is_thing
    for index in range(len(sequence)):
        ours, theirs = back.segmentation(index), sequence.segmentation(index)
        for segment in theirs.segments:
            places = np.unique(ours.ids[theirs.ids == segment.id])
            assert len(places) == 1
            found = next(s for s in ours.segments if s.id == places[0])
            assert (found.label, found.score, found.is_thing) == (segment.label, segment.score, segment.is_thing)
    table = json.loads((tmp_path / "panoptic.json").read_text())
    first = table["annotations"][0]["segments_info"][0]
    x, y, w, h = first["bbox"]
    mask = read_panoptic_png(tmp_path / "panoptic" / table["annotations"][0]["file_name"]) == first["id"]
    assert mask.sum() == first["area"] and mask[y : y + h, x : x + w].sum() == first["area"]


def test_coloured_ids_are_red_first_and_crowds_are_nothing(tmp_path):
    rgb = np.zeros((2, 3, 3), np.uint8)
    rgb[0, 0], rgb[0, 1], rgb[1, 2] = (5, 1, 2), (9, 0, 0), (7, 0, 0)
    assert cv2.imwrite(str(tmp_path / "a.png"), rgb[..., ::-1])
    number = 5 + 256 + 2 * 65536
    infos = [{"id": number, "category_id": 3}, {"id": 9, "category_id": 8}, {"id": 7, "category_id": 3, "iscrowd": 1}]
    table = {
        "images": [{"id": 1, "file_name": "a.jpg"}],
        "annotations": [{"image_id": 1, "file_name": "a.png", "segments_info": infos}],
        "categories": [{"id": 3, "name": "chair", "isthing": 1}, {"id": 8, "name": "rug", "isthing": 0}],
    }
    path = tmp_path / "p.json"
    path.write_text(json.dumps(table))
    found = read_coco_panoptic(path, ["a"]).get(0)
    assert found.ids.tolist() == [[1, 2, 0], [0, 0, 0]]
    assert found.segments == (Segment(1, "chair"), Segment(2, "rug", is_thing=False))
    for key, value, words in (
        ("categories", [{"id": 3}], "categories: expected id, name and isthing"),
        ("annotations", 3, 'an object with a list "annotations"'),
        (
            "annotations",
            [{"image_id": 1, "file_name": "a.png", "segments_info": [{"id": 1, "category_id": 99}]}],
            "known",
        ),
        ("annotations", [], "expected a picture named after each of 1 frames"),
        ("annotations", [{"image_id": 1, "file_name": "a.png", "segments_info": infos[:1]}], "found 7"),
    ):
        path.write_text(json.dumps({**table, key: value}))
        with pytest.raises(InputError, match=words):
            read_coco_panoptic(path, ["a"]).get(0)


def test_masks_of_another_size_are_refused(sequence):
    class Small:
        def classes(self):
            return {"chair": True}

        def get(self, index):
            return Segmentation(np.zeros((4, 4), np.int32), ())

    with pytest.raises(InputError, match=f"expected masks of {WIDTH}x{HEIGHT} pixels like the picture, found 4x4"):
        WithMasks(sequence, Small(), "small").segmentation(0)


def room(height_m: float = 1.5) -> tuple[Frame, np.ndarray, dict[str, np.ndarray]]:
    """Look along +x, level, at a wall 3 m away and 2.6 m high, with a box of 0.8 m before it; known by construction."""
    k = Intrinsics(160, 120, 110.0, 110.0, 79.5, 59.5)
    v, u = np.mgrid[: k.height, : k.width]
    down = (v - k.cy) / k.fy
    with np.errstate(divide="ignore"):
        floor = np.where(down > 0, height_m / down, np.inf)
    wall = np.where(-down * 3.0 <= 2.6 - height_m, 3.0, 0.0)
    depth = np.minimum(floor, wall)
    box = (np.abs((u - k.cx) / k.fx * 2.0) < 0.4) & (down * 2.0 > height_m - 0.8) & (floor >= 2.0)
    depth = np.where(box, 2.0, depth)
    truth = {"floor": (floor < 3.0) & ~box, "wall": (wall == 3.0) & (floor >= 3.0) & ~box, "box": box}
    T_map_camera = np.eye(4)
    T_map_camera[:3, :3] = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    T_map_camera[2, 3] = height_m
    frame = Frame(0, "0", depth.astype(np.float32), np.eye(4), k)
    return frame, T_map_camera, truth


def test_floor_and_walls_are_found_by_geometry_and_furniture_is_neither():
    frame, T_map_camera, truth = room()
    empty = Segmentation(np.zeros(frame.depth_m.shape, np.int32), ())
    found = add_stuff(frame, empty, T_map_camera)
    named = {s.label: found.ids == s.id for s in found.segments}
    assert set(named) == {"floor", "wall"} and not any(s.is_thing for s in found.segments)
    for label in ("floor", "wall"):
        assert (named[label] & ~truth[label]).sum() < 0.01 * truth[label].sum()  # a fringe at edges of depth
        assert (named[label] & truth[label]).sum() > 0.8 * truth[label].sum()
    assert (named["floor"] | named["wall"])[truth["box"]].mean() < 0.03


def test_segments_keep_their_pixels_and_a_low_wall_is_left_unnamed():
    frame, T_map_camera, _ = room()
    ids = np.zeros(frame.depth_m.shape, np.int32)
    ids[:, :40] = 7
    before = Segmentation(ids, (Segment(7, "tv"),))
    found = add_stuff(frame, before, T_map_camera)
    assert (found.ids[:, :40] == 7).all() and found.segments[0] == Segment(7, "tv")
    lower = T_map_camera.copy()
    lower[2, 3] -= 1.2
    assert "wall" not in [s.label for s in add_stuff(frame, before, lower).segments]


def test_only_detectors_of_things_need_geometry():
    own = OwnNetwork()
    assert needs_stuff(own)
    own.is_thing = (True, False)  # pyright: ignore
    assert not needs_stuff(own)


def test_a_store_is_found_by_what_a_map_says(tmp_path):
    about = About("/scans/a.json", "net [1]", "key")
    MaskStore(tmp_path, about).put(3, [1, 2], Segmentation(CHAIR.astype(np.int32), (Segment(1, "chair"),)))
    found = find_store(tmp_path, sequence="/scans/a.json", source="net [1]")
    assert found is not None
    masks = found.get(3)
    assert masks is not None and masks.segments == (Segment(1, "chair"),)
    assert found.holds(3, [1, 2]) and not found.holds(3, [1, 3]) and not found.holds(2, [1, 2])
    assert find_store(tmp_path, sequence="/scans/b.json", source="net [1]") is None
    with pytest.raises(InputError, match="expected masks of frame 2, found none"):
        found.get(2)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_networks_see_pictures_upright_and_masks_lie_as_pictures_do(turns, tmp_path, monkeypatch):
    monkeypatch.setattr(geometry_stuff, "COLUMNS", 60)  # every third or second pixel, whichever side is the width
    upright = open_sequence(drawn_room(tmp_path / "room", frames=2))
    found = segment_sequence(lying(upright, turns), TopNetwork(), tmp_path, stuff=True).segmentation(1)
    expected = segment_sequence(upright, TopNetwork(), tmp_path, stuff=True).segmentation(1)
    assert {s.label for s in found.segments} >= {"lamp", "wall"}
    np.testing.assert_array_equal(found.ids, turned(expected.ids, turns))
    assert len(list((tmp_path / "masks").iterdir())) == 2  # the lying ones are kept under a key of their own


YOLO = SHARED / "yolo11n-seg-int8" / "yolo11n-seg_int8.onnx"


@pytest.mark.slow
@pytest.mark.skipif(not YOLO.is_file(), reason="the network in ../shared/data is not here")
def test_as_many_things_are_found_in_lying_pictures_as_in_upright_ones(tmp_path):
    whole = open_sequence(ensure_demo(cache_dir=tmp_path, settings=DemoSettings(frames=4)))
    some = range(4)
    network, _ = open_network(YOLO)

    def things(sequence):
        return sum(len(found.segments) for _, found in segmented(sequence, network, some, by_geometry=False))

    upright = things(whole)
    assert upright >= 8
    assert [things(lying(whole, turns)) for turns in (1, 2, 3)] == [upright] * 3
