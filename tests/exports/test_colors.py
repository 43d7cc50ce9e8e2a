"""One source of colours: what is exported or drawn beside the page has the page's."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from color_vision import least_apart
from toy_maps import map_from_drawing

from simaps_viz.colors.classes import class_color, instance_color
from simaps_viz.colors.instances import class_colors, instance_colors
from simaps_viz.colors.palette import MIN_APART, PALETTE
from simaps_viz.evaluation.run import WRONG_RED
from simaps_viz.evaluation.two_maps import PALETTE as EVALUATION_PALETTE
from simaps_viz.exports.exporter import ExportOptions
from simaps_viz.exports.graphs import SparkDSG
from simaps_viz.exports.panoptic import top_view
from simaps_viz.exports.records import label_colors, node_name, record
from simaps_viz.exports.scene import parts


def test_exports_and_evaluations_have_the_colours_of_the_page():
    """What `simaps export` writes, also where two neighbours would have the same colour by their ids alone."""
    simap = map_from_drawing("AM\nBL", {"A": "chair", "M": "chair", "B": "couch", "L": "couch"}, cells=3)
    ids = np.where(simap.community == 2, 13, simap.community).astype(np.int32)
    named = tuple(replace(one, id=13 if one.id == 2 else one.id) for one in simap.instances)
    clash = replace(simap, community=ids, instance=ids, instances=named, graphs=())
    page = instance_colors(clash)
    assert tuple(page[1]) != tuple(page[13]) and instance_color(1) == instance_color(13)
    assert {p.instance: p.color for p in parts(clash) if p.instance} == {i.id: tuple(page[i.id]) for i in named}
    assert (top_view(clash)[::-1][ids > 0] == page[ids[ids > 0]]).all()
    for one in named:
        assert record(clash, one)["color"] == "#{:02x}{:02x}{:02x}".format(*page[one.id])
    (graph,) = SparkDSG().files(clash, Path("a.json"), ExportOptions()).values()
    nodes = json.loads(graph)["nodes"]
    shown = {n["attributes"]["name"]: n["attributes"]["color"] for n in nodes}
    assert all(list(shown[node_name(one)].values())[:3] == page[one.id].tolist() for one in named)


def test_classes_have_the_pages_colours_in_exports_too():
    simap = map_from_drawing("AB", {"A": "chair", "B": "couch"}, cells=3)
    labels = tuple({"chair": "vase", "couch": "bottle"}.get(name, name) for name in simap.grid.labels)
    named = tuple(replace(one, label=labels[simap.grid.labels.index(one.label)]) for one in simap.instances)
    simap = replace(simap, grid=replace(simap.grid, labels=labels), instances=named, graphs=())
    page = class_colors(simap)
    assert any(page[name] != class_color(name) for name in page)  # or the test would say nothing
    assert dict(zip(simap.grid.labels, label_colors(simap), strict=True)).items() >= page.items()


def test_pictures_of_evaluations_leave_red_to_marks():
    assert set(EVALUATION_PALETTE) < set(PALETTE) and len(EVALUATION_PALETTE) == 9
    marks, colors = [WRONG_RED] * len(EVALUATION_PALETTE), list(EVALUATION_PALETTE)
    assert least_apart(marks, colors) >= MIN_APART
