"""The list of errors, and of doubtful objects where nobody knows the truth."""

from dataclasses import replace

import numpy as np
from toy_maps import toy_map

from simaps_viz.app.workbench import truth_beside
from simaps_viz.evaluation.two_maps import TRUTH, MapMaker, compare_two
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.simap import repartition
from simaps_viz.viewer.panels.errors import doubt_entries, error_entry


def test_a_truth_that_lies_beside_the_map_is_offered_without_frames(tmp_path):
    simap, path = toy_map(), tmp_path / "toy.npz"
    assert MapMaker(None, tmp_path, truth_beside(path)).sources(simap) == ()
    save_map(repartition(simap, k_percent=30.0), tmp_path / "toy-truth.npz")
    maker = MapMaker(None, tmp_path, truth_beside(path))
    assert [source.key for source in maker.sources(simap)] == [TRUTH]
    truth = maker.make(TRUTH, simap, lambda *what: None)
    assert len(truth.instances) > len(simap.instances)


def test_errors_name_objects_of_the_map_and_what_is_true():
    truth = toy_map()
    true_chair = truth.of_class("chair")[-1]
    instance = np.where(truth.instance == true_chair.id, 0, truth.instance)
    kept = tuple(one for one in truth.instances if one.id != true_chair.id)
    simap = replace(repartition(truth, k_percent=0.0))
    found = compare_two(("This map", simap), ("The truth", truth), truth="right")
    entries = [error_entry(item, found.left, found.right) for item in found.differences]
    assert any("really 2" in one.title and one.selects is not None and len(one.true) == 2 for one in entries)
    fewer = replace(truth, instance=instance, instances=kept)
    found = compare_two(("This map", fewer), ("The truth", truth), truth="right")
    (one,) = [error_entry(item, found.left, found.right) for item in found.differences]
    assert one.title == "chair missing here" and one.selects is None and one.true == (true_chair.id,)
    x, y, _ = true_chair.centroid_m
    assert one.extent_m[0] < x < one.extent_m[2] and one.extent_m[1] < y < one.extent_m[3]


def test_specks_are_not_listed_as_doubtful():
    simap = toy_map()
    few = replace(simap, instances=tuple(replace(one, frames=1, score=0.1) for one in simap.instances))
    listed = doubt_entries(few, frozenset())
    assert {one.selects for one in listed} == {one.id for one in few.instances}
    speck = few.instances[0].id
    assert {one.selects for one in doubt_entries(few, frozenset({speck}))} == {
        one.id for one in few.instances if one.id != speck
    }
