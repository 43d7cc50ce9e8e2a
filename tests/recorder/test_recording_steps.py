"""Which time of a recording shows a position of the page, also of one made before, or of another cut; clicks in it."""

import numpy as np
import pytest
from toy_maps import toy_map

from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.mapping.timeline import CLASSES, Timeline
from simaps_viz.viewer.page.recording import RecordedSteps, in_a_view


@pytest.fixture(scope="module")
def timeline():
    return Timeline(toy_map())


def test_every_position_of_the_recorded_map_has_its_own_time(timeline):
    steps = RecordedSteps(timeline)
    times = [steps.time_of(timeline, position) for position in range(timeline.last + 1)]
    assert times[: timeline.levels + 1] == [("louvain", level) for level in range(timeline.levels + 1)]
    assert times[timeline.levels + 1 :] == [("merge", n + 1) for n in range(timeline.last - timeline.levels)]
    for position, time in enumerate(times):
        assert time is not None and steps.position_of(timeline, *time) == position
    assert steps.position_of(timeline, "merge", 0) == timeline.levels


def test_an_earlier_recording_has_no_levels_on_the_way_and_shows_no_other_in_their_place(timeline):
    old = RecordedSteps(timeline, levels=1)
    assert old.time_of(timeline, CLASSES) == ("louvain", 0)
    assert [old.time_of(timeline, level) for level in range(1, timeline.levels)] == [None] * (timeline.levels - 1)
    assert old.time_of(timeline, timeline.levels) == ("louvain", 1)
    assert old.time_of(timeline, timeline.levels + 2) == ("merge", 2)
    assert old.position_of(timeline, "louvain", 1) == timeline.levels
    assert old.position_of(timeline, "louvain", 0) == CLASSES
    assert old.position_of(timeline, "merge", 2) == timeline.levels + 2


def test_a_map_cut_otherwise_goes_with_the_recording_as_far_as_their_steps_are_the_same(timeline):
    steps = RecordedSteps(timeline)
    cut = Timeline(repartition(timeline.simap, k_percent=100.0), like=timeline)
    assert cut.taken != timeline.taken
    for position in range(cut.levels + 1, cut.last + 1):
        same = np.array_equal(cut.done_at(position), timeline.done_at(position))
        assert steps.time_of(cut, position) == (("merge", position - cut.levels) if same else None)
        assert steps.position_of(cut, "merge", position - cut.levels) == (position if same else None)
    assert steps.time_of(cut, cut.last) is not None, "in the end all are done"


def test_of_other_communities_only_the_classes_are_the_same(timeline):
    other = Timeline(recommunity(timeline.simap, resolution=4.0, k_percent=5.0))
    steps = RecordedSteps(timeline)
    assert steps.time_of(other, CLASSES) == ("louvain", 0) and steps.position_of(other, "louvain", 0) == CLASSES
    assert {steps.time_of(other, position) for position in range(1, other.last + 1)} == {None}
    assert steps.position_of(other, "merge", 1) is None


@pytest.mark.parametrize(
    ("items", "inside"),
    [
        ([{"type": "entity", "entity_path": "/map/ground", "position": [1.0, 2.0, None]}], True),
        ([{"type": "view", "view_name": "Objects"}], True),
        ([{"type": "view", "view_name": "Objects", "by_name": True}], False),
        ([{"type": "entity", "entity_path": "/map"}], False),
        ([], False),
    ],
)
def test_a_click_in_a_view_is_told_from_one_on_a_name(items, inside):
    assert in_a_view(items) is inside
