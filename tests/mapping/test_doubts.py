"""What a map is least sure of, by what it holds itself."""

from dataclasses import replace

import pytest
from toy_maps import toy_map

from simaps_viz.mapping.doubts import doubts
from simaps_viz.mapping.simap import repartition


def with_facts(simap, number, **facts):
    changed = (replace(one, **facts) if one.id == number else one for one in simap.instances)
    return replace(simap, instances=tuple(changed))


@pytest.mark.parametrize(
    ("facts", "said"), [({"score": 0.2}, "confidence of 20%"), ({"frames": 0}, "seen in 0 frames")]
)
def test_an_object_that_the_frames_hardly_know_is_the_most_doubtful(facts, said):
    simap = toy_map()
    sure = replace(simap, instances=tuple(replace(one, score=0.95, frames=50) for one in simap.instances))
    chair = sure.of_class("chair")[-1]
    assert chair.id not in {one.instance.id for one in doubts(sure)}
    first = doubts(with_facts(sure, chair.id, **facts))[0]
    assert first.instance.id == chair.id and said in first.reasons[0]
    assert chair.id not in {one.instance.id for one in doubts(with_facts(sure, chair.id, **facts), {chair.id})}


def test_what_a_slim_margin_joins_or_leaves_apart_is_doubtful():
    simap = toy_map()
    sure = replace(simap, instances=tuple(replace(one, score=0.95, frames=50) for one in simap.instances))

    def said(percent):
        cut = repartition(sure, k_percent=percent)
        cut = replace(cut, instances=tuple(replace(one, score=0.95, frames=50) for one in cut.instances))
        return {one.instance.name: " ".join(one.reasons) for one in doubts(cut)}

    joined, apart = said(24.0), said(26.0)  # chairs 1 and 2 are one up to K = 25 %
    assert "joined by a slim margin: 25.0 %" in joined["chair 1"]
    assert "nearly joined with chair 2" in apart["chair 1"] and "nearly joined with chair 1" in apart["chair 2"]
