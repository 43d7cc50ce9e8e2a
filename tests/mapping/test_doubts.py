"""What a map is least sure of, by what it holds itself."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from toy_maps import toy_map

from simaps_viz import load_map
from simaps_viz.mapping.doubts import SLIM, doubts
from simaps_viz.mapping.explain import between
from simaps_viz.mapping.simap import repartition
from simaps_viz.structures import Box, InSpace, SIMap

ROOT = Path(__file__).parents[2]
NEAR = re.compile(r"nearly joined with ([^.]+ \d+)\.")


def with_facts(simap, number, **facts):
    changed = (replace(one, **facts) if one.id == number else one for one in simap.instances)
    return replace(simap, instances=tuple(changed))


@pytest.mark.parametrize(
    ("facts", "said"), [({"score": 0.2}, "confidence of 20 %"), ({"frames": 0}, "seen in 0 frames")]
)
def test_an_object_that_the_frames_hardly_know_is_the_most_doubtful(facts, said):
    simap = toy_map()
    sure = replace(simap, instances=tuple(replace(one, score=0.95, frames=50) for one in simap.instances))
    chair = sure.of_class("chair")[-1]
    assert chair.id not in {one.instance.id for one in doubts(sure)}
    first = doubts(with_facts(sure, chair.id, **facts))[0]
    assert first.instance.id == chair.id and said in first.reasons[0]
    assert chair.id not in {one.instance.id for one in doubts(with_facts(sure, chair.id, **facts), {chair.id})}


def test_an_object_of_few_cells_below_a_large_box_is_doubtful(monkeypatch):
    simap = toy_map()
    sure = replace(simap, instances=tuple(replace(one, score=0.95, frames=50) for one in simap.instances))
    couch = sure.of_class("couch")[0]
    area_m2 = couch.area_m2(sure.spec.cell_size_m)
    for times, doubtful in ((1.0, False), (20.0, True)):
        box = Box((0.0, 0.0, 0.5), (area_m2 * times, 1.0, 1.0), 0.0)
        monkeypatch.setattr("simaps_viz.mapping.doubts.has_voxels", lambda _: True)
        monkeypatch.setattr(SIMap, "in_space", {couch.id: InSpace(box, {}, {}, {}, 100, (0, 0, 0))})
        said = {one.instance.id: one.brief for one in doubts(sure)}
        assert (said.get(couch.id) == "few cells for its size") == doubtful


@pytest.mark.parametrize(("on", "inside", "doubtful"), [({8: 1.0}, {}, False), ({8: 1.0}, {8: 0.7}, True)])
def test_what_lies_inside_a_thing_of_another_class_may_be_a_part_of_it(monkeypatch, on, inside, doubtful):
    simap = toy_map()
    sure = replace(simap, instances=tuple(replace(one, score=0.95, frames=50) for one in simap.instances))
    couch, table = sure.of_class("couch")[0], sure.by_id(8)
    box = Box((0.0, 0.0, 0.5), (0.1, 0.1, 0.1), 0.0)
    monkeypatch.setattr("simaps_viz.mapping.doubts.has_voxels", lambda _: True)
    monkeypatch.setattr(SIMap, "in_space", {couch.id: InSpace(box, on, {}, inside, 100, (0, 0, 0))})
    said = {one.instance.id: one for one in doubts(sure)}
    assert (couch.id in said) == doubtful and table.label != couch.label
    if doubtful:
        assert said[couch.id].brief == f"shares its place with {table.name}" and "70 %" in said[couch.id].reasons[0]


def test_a_map_without_voxels_is_not_asked_where_things_are_in_space(monkeypatch):
    simap = toy_map()
    monkeypatch.setattr(SIMap, "in_space", property(lambda _: pytest.fail("columns were filled")))
    assert all(one.weight > 0.0 for one in doubts(with_facts(simap, simap.instances[0].id, score=0.1)))


@pytest.mark.parametrize("affinity", [0.2, 0.95])
def test_two_that_were_nearly_joined_are_as_near_as_their_own_evidence_says(affinity):
    """A late step of the log is of many objects together, of which two alone may have nothing to do with each other."""
    cut = repartition(load_map(ROOT / "recordings/cafe-evidence.npz"), affinity=affinity)
    names = {one.name: one.id for one in cut.instances}
    said = [(one.instance.id, NEAR.findall(" ".join(one.reasons))) for one in doubts(cut)]
    pairs = [(number, names[other]) for number, others in said for other in others]
    assert len(pairs) > 3
    for number, _ in said:  # one alone is as doubtful as among all
        assert doubts(cut, among=frozenset([number])) == tuple(d for d in doubts(cut) if d.instance.id == number)
    for pair in pairs:
        link = between(cut, *pair).link
        assert link is not None and abs(link.score - affinity) < SLIM


def test_what_a_slim_margin_joins_or_leaves_apart_is_doubtful():
    simap = toy_map()
    sure = replace(simap, instances=tuple(replace(one, score=0.95, frames=50) for one in simap.instances))

    def said(percent):
        cut = repartition(sure, k_percent=percent)
        cut = replace(cut, instances=tuple(replace(one, score=0.95, frames=50) for one in cut.instances))
        return {one.instance.name: " ".join(one.reasons) for one in doubts(cut)}

    joined, apart = said(24.0), said(26.0)  # chairs 1 and 2 are one up to K = 25 %
    assert "joined by a slim margin: 25.0 %" in joined["chair 1"]
    assert sum("nearly joined with chair" in text for text in apart.values()) == 1  # once, not once from each side
