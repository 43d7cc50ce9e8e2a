"""Masks over a frame: how they are drawn, what is said of them, and what thresholds make of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sequences import HEIGHT, WIDTH, write_tiny_sequence
from stub_page import stub_page
from tiny_networks import segment_image, write_classifier, write_yolo
from toy_maps import toy_map
from toy_segmentations import GREY, toy_segmentation, two_masks

from simaps_viz import load_map, open_sequence, save_map
from simaps_viz.app.masks import segmentation_services
from simaps_viz.app.workbench import sequence_of
from simaps_viz.cli.main import main
from simaps_viz.colors.classes import class_color
from simaps_viz.colors.instances import class_colors
from simaps_viz.colors.palette import PALETTE
from simaps_viz.drawing.frame_pictures import MaskStyle, confidence_color, paint_masks, segment_name
from simaps_viz.drawing.texture import cell_colors, shown_class_colors
from simaps_viz.errors import InputError
from simaps_viz.segmentation.coco_panoptic import write_coco_panoptic
from simaps_viz.segmentation.recognise import NetworkSettings, open_network
from simaps_viz.segmentation.sequences import KEPT, FrameTuner, above_score
from simaps_viz.structures import Segment, Segmentation, SIMap
from simaps_viz.viewer.panels.masks import (
    OPTIONS,
    SegmentationPanel,
    SegmentationServices,
    class_counts,
    effect_words,
    has_confidence,
    masks_legend,
    segments_html,
)


def test_things_are_filled_and_stuff_is_hatched():
    masks = two_masks()
    picture = paint_masks(GREY, masks, MaskStyle(names=False, opacity=1.0, width=80))
    inside = picture[16:44, 11:29].reshape(-1, 3)
    assert (inside == class_color("chair")).all()
    hatched = picture[16:44, 51:69].reshape(-1, 3)
    share = (hatched == class_color("floor")).all(axis=1).mean()
    assert 0.4 < share < 0.6 and (hatched == 100).all(axis=1).mean() == pytest.approx(1 - share)
    assert (picture[:5] == 100).all() and (picture[:, 38:42] == 100).all()
    light = paint_masks(GREY, masks, MaskStyle(names=False, opacity=0.25, width=80))[30, 20]
    np.testing.assert_allclose(light, 0.75 * 100 + 0.25 * np.array(class_color("chair")), atol=1)


def test_classes_can_be_hidden_and_confidence_be_the_colour():
    masks = two_masks()
    hidden = paint_masks(GREY, masks, MaskStyle(opacity=1.0, width=80, hidden=frozenset({"chair", "floor"})))
    np.testing.assert_array_equal(hidden, GREY)
    sure = paint_masks(GREY, masks, MaskStyle("confidence", opacity=1.0, names=False, width=80))
    assert tuple(sure[30, 20]) == confidence_color(0.8) != class_color("chair")
    levels = [sum(confidence_color(score)) for score in np.linspace(0, 1, 11)]
    assert levels == sorted(levels)  # brighter where surer, so that it can be told without colours


def test_names_say_class_and_confidence_and_stay_in_the_picture():
    assert [segment_name(s) for s in two_masks().segments] == ["chair 0.80", "(floor 0.60)"]
    plain, named = (paint_masks(GREY, two_masks(), MaskStyle(names=names)) for names in (False, True))
    assert plain.shape == named.shape == (420, 560, 3) and (plain != named).any()
    ids = np.ones((3, 4), np.int32)
    tiny = paint_masks(GREY[:3, :4], Segmentation(ids, (Segment(1, "a very long name " * 20),)), MaskStyle())
    assert tiny.shape == (420, 560, 3)


def test_classes_have_the_colours_of_the_map_in_picture_and_legend():
    simap, masks = toy_map(), two_masks()
    colors = shown_class_colors(simap)
    assert colors.items() >= class_colors(simap).items()
    assert set(colors) == set(simap.grid.labels) - {""}
    assert len(set(colors.values())) == len(colors) <= len(PALETTE), "no two alike while the palette lasts"
    ours = {"chair": (1, 2, 3), "floor": (4, 5, 6)}
    picture = paint_masks(GREY, masks, MaskStyle(names=False, opacity=1.0, width=80, colors=ours))
    assert (picture[16:44, 11:29] == (1, 2, 3)).all()
    legend = masks_legend(masks, "class", ours)
    assert "rgb(1, 2, 3)" in legend and "rgb(4, 5, 6)" in legend
    row, col = np.argwhere(simap.instance > 0)[0]
    label = simap.by_id(int(simap.instance[row, col])).label
    assert tuple(cell_colors(simap, "class")[row, col]) == colors[label]


def test_only_the_largest_have_their_names_where_there_is_little_room():
    ids = np.zeros((60, 80), np.int32)
    ids[5:55, 5:60], ids[20:40, 64:78] = 1, 2
    masks = Segmentation(ids, (Segment(2, "cup", 0.9), Segment(1, "counter", 0.9)))
    style = MaskStyle(opacity=0.0)
    none, one, both = (paint_masks(GREY, masks, replace(style, most_names=n)) for n in (0, 1, None))
    east = np.s_[:, 64 * 7 : 78 * 7]
    assert (one != none).any() and (one[east] == none[east]).all()
    assert (both[east] != none[east]).any()


def test_masks_that_are_not_there_or_of_another_size_are_drawn_all_the_same():
    masks = Segmentation(two_masks().ids[::2, ::2].copy(), (*two_masks().segments, Segment(77, "ghost")))
    assert paint_masks(GREY, masks, MaskStyle()).shape == (420, 560, 3)
    empty = Segmentation(np.zeros((60, 80), np.int32), ())
    np.testing.assert_array_equal(paint_masks(GREY, empty, MaskStyle(width=80)), GREY)


def test_words_count_and_escape():
    masks = two_masks()
    assert class_counts(masks) == {"chair": (1, True), "floor": (1, False)}
    ids = masks.ids.copy()
    ids[:, :40] = 0
    fewer = Segmentation(ids, masks.segments[1:])
    assert effect_words(masks, masks) == "As the map was built: 2 segments, 50.0 % of the picture."
    assert effect_words(masks, fewer) == (
        "Now 1 segment, 25.0 % of the picture. As the map was built: 2, 50.0 %. Change: −1 chair; 25.0 % of the pixels "
        "gained or lost their segment."
    )
    evil = Segmentation(masks.ids, (Segment(4, "<img src=x>"),))
    for text in (masks_legend(evil, "class"), segments_html(evil, ())):
        assert "<img" not in text and "&lt;img" in text
    assert "25.0 %" in segments_html(masks, ()) and "chair" not in segments_html(masks, {"chair"})
    assert "0.5" in masks_legend(masks, "confidence")
    assert has_confidence(masks)
    assert not has_confidence(Segmentation(masks.ids, (Segment(4, "chair"), masks.segments[1])))


BOXES = [(2.0, 6.0, 12.0, 18.0, 0, 0.9), (20.0, 10.0, 30.0, 20.0, 2, 0.5), (14.0, 6.0, 20.0, 12.0, 1, 0.3)]


def built(tmp_path: Path, monkeypatch, network: Path, *options: str) -> SIMap:
    """Return the map that the command line builds of a tiny sequence with a network."""
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path / "cache"))
    write_tiny_sequence(tmp_path / "tiny")
    command = ["build", str(tmp_path / "tiny"), "--segmentation", str(network), "-o", str(tmp_path / "m.npz")]
    assert main([*command, "--providers", "cpu", *options]) == 0
    return load_map(tmp_path / "m.npz")


@pytest.mark.parametrize("kind", ["yolo", "classifier"])
def test_reading_an_output_anew_gives_what_a_network_opened_with_these_thresholds_gives(tmp_path, kind):
    path = write_yolo(tmp_path / "n.onnx", BOXES) if kind == "yolo" else write_classifier(tmp_path / "n.onnx")
    sequence = open_sequence(write_tiny_sequence(tmp_path / "tiny", frames=KEPT + 2))
    tuner = FrameTuner(sequence, open_network(path, NetworkSettings(providers=("cpu",)))[0], by_geometry=False)
    counts = []
    for score in (0.2, 0.4, 0.6, 0.95):
        told = NetworkSettings(providers=("cpu",), score=score, mask=0.6)
        expected = segment_image(open_network(path, told)[0], sequence.color(1))
        found = tuner.segmentation(1, {"score": score, "mask": 0.6})
        np.testing.assert_array_equal(found.ids, expected.ids)
        assert found.segments == expected.segments
        counts.append(len(found.segments))
    assert counts == ([3, 2, 1, 0] if kind == "yolo" else [2, 2, 2, 2])
    assert tuner.runs == 1
    for index in (*range(KEPT + 2), 1):
        tuner.segmentation(index, {})
    assert tuner.runs == KEPT + 3  # frame 1 was known, then forgotten
    with pytest.raises(InputError, match=r"expected thresholds score, mask, .*found colour"):
        tuner.segmentation(0, {"colour": 0.5})


@pytest.mark.slow
def test_a_maps_network_is_found_and_run_again(tmp_path, monkeypatch):
    simap = built(tmp_path, monkeypatch, write_yolo(tmp_path / "n.onnx", BOXES), "--score-threshold", "0.4")
    services = segmentation_services(simap, tmp_path / "cache")
    assert services.look is not None and services.retry is not None and services.runs_network
    assert [(k.key, k.value, OPTIONS[k.key]) for k in services.knobs] == [
        ("score", 0.4, "--score-threshold"), ("mask", 0.5, "--mask-threshold"), ("iou", 0.5, "--box-overlap")
    ]  # fmt: skip
    rgb, before = services.look(1)
    assert rgb.shape == (HEIGHT, WIDTH, 3) and [s.label for s in before.segments if s.is_thing] == ["chair", "tv"]
    same = services.retry(1, {"score": 0.4})
    np.testing.assert_array_equal(same.ids, before.ids)
    assert same.segments == before.segments and "floor" in [s.label for s in same.segments]
    more = services.retry(1, {"score": 0.2})
    assert [s.label for s in more.segments if s.is_thing] == ["chair", "tv", "dining table"]
    assert services.network == "n.onnx" and services.notes == ()


def test_a_network_that_is_gone_or_another_is_said_so(tmp_path, monkeypatch):
    path = write_yolo(tmp_path / "n.onnx", BOXES)
    simap = built(tmp_path, monkeypatch, path)
    services = segmentation_services(simap, tmp_path / "cache")
    write_yolo(path, BOXES[:1])
    assert services.retry is not None and services.look is not None
    with pytest.raises(InputError, match="expected the network this map was built with, found another"):
        services.retry(0, {"score": 0.5})
    path.unlink()
    gone = segmentation_services(simap, tmp_path / "cache")
    assert gone.look is not None and gone.retry is not None and not gone.runs_network
    assert "not at hand" in gone.notes[0] and "found nothing" in gone.notes[1]
    assert [k.key for k in gone.knobs] == ["score"] and gone.knobs[0].value == 0.0
    assert [s.label for s in gone.retry(0, {"score": 0.8}).segments] == ["chair", "floor"]
    for file in (tmp_path / "cache" / "masks").rglob("about.json"):
        file.unlink()
    lost = segmentation_services(simap, tmp_path / "cache")
    assert lost.look is None and "no longer kept" in lost.notes[0]
    elsewhere = replace(simap, provenance={"sequence": str(tmp_path / "none"), "segmentation": "x"})
    nowhere = segmentation_services(elsewhere, tmp_path / "cache")
    assert nowhere.look is None and nowhere.notes[0].startswith("The frames of this map are not at hand: ")


def test_a_coco_tables_masks_are_found_again(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path / "cache"))
    sequence = open_sequence(write_tiny_sequence(tmp_path / "tiny"))
    write_coco_panoptic(sequence, tmp_path / "p.json")
    command = ["build", str(tmp_path / "tiny"), "--segmentation", str(tmp_path / "p.json"), "-o"]
    assert main([*command, str(tmp_path / "m.npz")]) == 0
    simap = load_map(tmp_path / "m.npz")
    again = sequence_of(simap)
    assert again is not None and [s.label for s in again.segmentation(0).segments].count("chair") == 2
    services = segmentation_services(simap, tmp_path / "cache")
    assert services.look is not None and not services.runs_network and len(services.look(0)[1].segments) == 3
    (tmp_path / "p.json").write_text("{")
    assert segmentation_services(simap, tmp_path / "cache").look is None
    (tmp_path / "p.json").unlink()
    assert sequence_of(simap) is None and segmentation_services(simap, tmp_path / "cache").look is None


def test_a_sequence_is_viewed_with_a_networks_masks(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path / "cache"))
    tiny, net = write_tiny_sequence(tmp_path / "tiny"), write_yolo(tmp_path / "n.onnx", BOXES)
    shown: list[SIMap] = []
    monkeypatch.setattr("simaps_viz.app.workbench.serve", lambda simap, **_: shown.append(simap))
    assert main(["view", str(tiny), "--segmentation", str(net), "--no-browser", "--providers", "cpu"]) == 0
    assert main(["view", str(tiny), "--no-browser"]) == 0
    sources = [str(simap.provenance["segmentation"]) for simap in shown]
    assert sources[0].startswith("n.onnx, floor and wall") and sources[1] == open_sequence(tiny).segmentation_source
    save_map(shown[0], tmp_path / "m.npz")
    assert main(["view", str(tmp_path / "m.npz"), "--segmentation", str(net), "--no-browser"]) == 2
    assert "m.npz: expected a sequence with --segmentation, found a map" in capsys.readouterr().err.replace("\n", "")


def test_masks_made_elsewhere_are_filtered_by_score():
    masks = two_masks()
    assert above_score(masks, 0.5) is masks
    found = above_score(masks, 0.7)
    assert [s.label for s in found.segments] == ["chair"] and set(np.unique(found.ids)) == {0, 4}
    assert set(np.unique(masks.ids)) == {0, 4, 9}


def test_the_panel_follows_frames_thresholds_and_switches():
    with stub_page(toy_map()) as desk:
        panel = SegmentationPanel(desk, toy_segmentation())
        panel.time_changed(0, None)
        assert desk.wait_idle() and panel.masks is not None and len(panel.masks.segments) == 2
        panel.restore({**panel.state(), "knobs": {"score": 0.7}, "hidden": ["chair"], "frame": 1})
        assert desk.wait_idle() and [s.label for s in panel.masks.segments] == ["chair"]
        assert panel.hidden == {"chair"} and panel.frame == 1
        assert panel.state()["knobs"] == {"score": 0.7} and panel.state()["hidden"] == ["chair"]
        panel.time_changed(2, None)
        panel.time_changed(99, None)
        assert desk.wait_idle() and panel.frame == 2 and desk.errors == []
        panel.close()
        panel.time_changed(0, None)
        assert desk.wait_idle()
        nothing = SegmentationPanel(desk, SegmentationServices(notes=("The frames are not at hand.",)))
        nothing.time_changed(0, None)
        nothing.restore(nothing.state())
        assert nothing.masks is None and desk.wait_idle()
