"""The panoptic top view, checked by the rules of panopticapi's evaluation and with pycocotools."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from pycocotools import mask as rle
from toy_maps import map_from_drawing, toy_map

from simaps_viz import export_map
from simaps_viz.colors.classes import instance_color


@pytest.fixture
def written(tmp_path):
    simap = toy_map()
    files = export_map(simap, tmp_path / "toy.json", "coco")
    assert [p.name for p in files] == ["toy.json", "toy.png", "toy-top.png"]
    return simap, files


def read_ids(path):
    rgb = np.array(Image.open(path)).astype(np.int64)
    return rgb[..., 0] + 256 * rgb[..., 1] + 256**2 * rgb[..., 2]


def test_every_pixel_is_its_cells_segment(written):
    simap, files = written
    about = json.loads(files[0].read_text())
    (annotation,) = about["annotations"]
    ids = read_ids(files[0].parent / annotation["file_name"])[::-1]
    segments = {s["id"]: s for s in annotation["segments_info"]}
    categories = {c["id"]: c for c in about["categories"]}
    # panopticapi: the ids of PNG and JSON are the same, but for void; every category is known
    assert set(np.unique(ids)) - {0} == set(segments) and len(segments) == len(annotation["segments_info"])
    assert {s["category_id"] for s in segments.values()} <= set(categories)
    things = {i for i, s in segments.items() if categories[s["category_id"]]["isthing"]}
    assert things == {one.id for one in simap.instances}
    for one in simap.instances:
        np.testing.assert_array_equal(ids == one.id, simap.instance == one.id)
        assert segments[one.id]["area"] == one.cells
        assert categories[segments[one.id]["category_id"]]["name"] == one.label
    for number in set(segments) - things:
        name = categories[segments[number]["category_id"]]["name"]
        np.testing.assert_array_equal(ids == number, simap.grid.label == simap.grid.labels.index(name))
    np.testing.assert_array_equal(ids == 0, np.isnan(simap.grid.height_m))


def test_areas_and_boxes_are_those_pycocotools_measures(written):
    _, files = written
    about = json.loads(files[0].read_text())
    (annotation,), (image,) = about["annotations"], about["images"]
    assert annotation["image_id"] == image["id"] and image["file_name"] == files[2].name
    ids = read_ids(files[1])
    assert ids.shape == (image["height"], image["width"]) == (100, 120)
    for segment in annotation["segments_info"]:
        encoded = rle.encode(np.asfortranarray(ids == segment["id"], dtype=np.uint8))
        assert segment["area"] == rle.area(encoded)
        assert segment["bbox"] == rle.toBbox(encoded).tolist()


def test_the_top_view_shows_instances_in_their_colours_north_up(written):
    simap, files = written
    top = np.array(Image.open(files[2]))[::-1]
    for one in simap.instances:
        assert (top[simap.instance == one.id] == instance_color(one.id)).all()
    assert len(np.unique(top[simap.grid.label == simap.grid.labels.index("floor")], axis=0)) == 1


def test_large_ids_use_all_three_channels(tmp_path):
    simap = map_from_drawing("A.", {"A": "couch"})
    for number in (255, 256, 70_000):
        big = np.where(simap.instance > 0, number, 0).astype(np.int32)
        one = simap.instances[0]
        renumbered = type(simap)(**{**simap.__dict__, "instance": big, "instances": (replace(one, id=number),)})
        files = export_map(renumbered, tmp_path / "b", "coco")
        ids = read_ids(files[1])
        np.testing.assert_array_equal(ids[::-1] == number, big > 0)
        segments = json.loads(files[0].read_text())["annotations"][0]["segments_info"]
        assert {s["id"] for s in segments} == set(np.unique(ids)) - {0}
