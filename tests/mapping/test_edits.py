"""Edits by hand: exact on the toy map, for any sequence of them the map stays whole, and K moves the rest."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mended_maps import assert_same, check_map, random_edit, survives_a_file
from toy_maps import TOY_SPEC, Box, map_from_drawing, map_of_boxes, toy_map

from simaps_viz.errors import InputError
from simaps_viz.mapping import edits
from simaps_viz.mapping.edits import Edit, Region, apply, apply_edits, log_without
from simaps_viz.mapping.explain import explain
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.structures import MergeLog

TOY = toy_map()
MID_1 = TOY.by_id(1).centroid_m
QUICK = settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
)


def ids_of(simap):
    return {label: [one.id for one in simap.of_class(label)] for label in simap.counts()}


# --- exact


def test_joined_objects_are_one_of_the_first_ones_class_and_the_smaller_id():
    mended = apply(TOY, edits.merge(TOY, 4, 3))
    check_map(mended)
    assert ids_of(mended)["chair"] == [1, 3]
    assert mended.by_id(3).cells == 128
    assert np.array_equal(mended.instance == 3, np.isin(TOY.instance, (3, 4)))
    keys = list(zip(mended.views.community, mended.views.frame, mended.views.segment, strict=True))
    assert len(keys) == len(set(keys)) and mended.by_id(3).frames == 5
    joined = apply(TOY, edits.merge(TOY, 1, 3))  # segments 11, 12, 13 in turn miss a frame each
    assert joined.views.cells.sum() == TOY.views.cells.sum()


def test_joining_across_classes_takes_the_first_ones_class():
    mended = apply(TOY, edits.merge(TOY, 8, 5))
    check_map(mended)
    assert ids_of(mended) == {"chair": [1, 3, 4], "dining table": [5, 6], "potted plant": [9]}
    assert mended.by_id(5).cells == 10 * 24 + 12 * 16
    assert [TOY.grid.labels[graph.label] for graph in mended.graphs] == ["chair", "dining table", "potted plant"]


def test_a_cut_along_a_known_line_makes_two_objects_of_known_cells():
    mended = apply(TOY, edits.split(TOY, 8, (3.6, -3.0), (3.6, -2.0)))
    check_map(mended)
    east = mended.by_id(8)
    (west,) = [one for one in mended.of_class("dining table") if one.id not in (6, 8)]
    assert (west.cells, east.cells) == (48, 144) and west.id == 10  # the first number nobody had
    assert np.nonzero(mended.instance == west.id)[1].max() == 91 and np.nonzero(mended.instance == 8)[1].min() == 92


def test_the_larger_side_keeps_the_id():
    for x in (3.6, 4.0):
        mended = apply(TOY, edits.split(TOY, 8, (x, 0.0), (x, 1.0)))
        sizes = {one.id: one.cells for one in mended.of_class("dining table")}
        assert sizes.pop(6) == 216
        assert sizes[8] == max(sizes.values()) == 144 and len(sizes) == 2 and max(sizes) == 10


def test_a_cut_between_two_communities_gives_each_side_its_own_number():
    mended = apply(TOY, edits.split(TOY, 1, (MID_1[0], 0.0), (MID_1[0], 5.0)))
    check_map(mended)
    assert ids_of(mended)["chair"] == [1, 2, 3, 4]
    assert mended.by_id(1).cells == mended.by_id(2).cells == 32


def test_islands_on_one_side_stay_one_object():
    u_shape = map_of_boxes(TOY_SPEC, [Box("couch", 20, 20, 4, 20, 0.7)])
    u_shape.community[22:24, 26:34] = 0
    u_shape.instance[22:24, 26:34] = 0
    u_shape.grid.label[22:24, 26:34] = 6
    u_shape = apply(u_shape, edits.relabel(u_shape, 1, "bench"))  # described anew, now of this shape
    one = u_shape.instances[0]
    mended = apply(u_shape, edits.split(u_shape, one.id, (0.0, -2.0 + 22 * 0.05), (1.0, -2.0 + 22 * 0.05)))
    assert sorted(i.cells for i in mended.instances) == [24, 40]
    north = mended.instance[22:24]
    assert len(np.unique(north[north > 0])) == 1 and (north > 0).sum() == 24


def test_a_new_class_is_added_and_its_graph_has_the_objects_edges():
    mended = apply(TOY, edits.relabel(TOY, 3, "  bar   stool "))
    check_map(mended)
    assert mended.grid.labels == (*TOY.grid.labels, "bar stool") and mended.grid.is_thing[-1]
    (graph,) = [g for g in mended.graphs if mended.grid.labels[g.label] == "bar stool"]
    assert len(graph.cells) == 64 and len(graph.edges) == 2 * 8 * 7
    assert set(graph.counts.tolist()) == {10} and np.allclose(graph.weights, 2.0)
    (chairs,) = [g for g in mended.graphs if g.label == 1]
    (before,) = [g for g in TOY.graphs if g.label == 1]
    assert len(before.edges) - len(chairs.edges) == 2 * 8 * 7 + 1  # and the bridge to chair 1
    assert TOY.grid.labels[-1] == "wall"  # the map itself is as it was


def test_a_class_of_any_case_is_the_maps_own():
    assert edits.relabel(TOY, 3, "COUCH").label == "couch"


def test_what_is_called_a_wall_is_no_object():
    mended = apply(TOY, edits.relabel(TOY, 9, "wall"))
    check_map(mended)
    assert "potted plant" not in mended.counts() and mended.grid.label[10, 110] == 7


def test_what_is_taken_away_leaves_an_obstacle_without_a_name():
    mended = apply(TOY, edits.delete(TOY, 9))
    check_map(mended)
    block = np.s_[8:14, 108:114]
    assert not mended.instance[block].any() and not mended.grid.label[block].any()
    assert np.array_equal(mended.grid.lowest_m, TOY.grid.lowest_m, equal_nan=True)
    assert len(mended.instances) == len(TOY.instances) - 1


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: edits.merge(TOY, 1, 1), "expected two objects"),
        (lambda: edits.merge(TOY, 1, 77), "instance 77: not on this map"),
        (lambda: edits.split(TOY, 1, (0.0, 0.0), (1.0, 0.0)), "found all of it on one side"),
        (lambda: edits.split(TOY, 1, (0.0, 0.0), (0.0, 0.0)), "two different points"),
        (lambda: edits.split(TOY, 1, (np.nan, 0.0), (0.0, 0.0)), "points in metres"),
        (lambda: edits.relabel(TOY, 1, "chair"), "called so already"),
        (lambda: edits.relabel(TOY, 1, "  "), "expected a name"),
        (lambda: edits.relabel(TOY, 1, "None"), "expected a name"),
        (lambda: edits.relabel(TOY, 1, "a\x07b"), "expected a name"),
        (lambda: edits.delete(TOY, 2), "instance 2: not on this map"),
    ],
)
def test_nonsense_is_refused_in_one_line(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_sliver_that_would_be_no_object_is_refused():
    few = map_of_boxes(TOY_SPEC, [Box("chair", 10, 10, 8, 8, 0.8)])
    few = type(few)(**{**vars(few), "parameters": {**few.parameters, "min_cells": 9}})
    with pytest.raises(InputError, match=r"at least 9 cells .* found 8"):
        edits.split(few, 1, (-1.0 + 11 * 0.05, 0.0), (-1.0 + 11 * 0.05, 1.0))


def test_regions_give_back_their_cells():
    for cells in ([], [0], [0, 1, 2, 7, 9, 10], [5, 6, 7]):
        given_cells = np.array(cells, np.int64)
        assert np.array_equal(Region.of(given_cells).cells(), given_cells)
    assert Region.of(np.array([3, 4, 9])).runs == ((3, 2), (9, 1))


def test_a_dropped_step_leaves_its_low_score_to_those_after_it():
    score = np.array([0.9, 0.5, 0.7, 0.4, 0.8, 0.6], np.float32)
    log = MergeLog(np.array([1, 1, 1, 1, 2, 2], np.int16), np.arange(2, 8, dtype=np.int32),
                   np.ones(6, np.int32), score)  # fmt: skip
    left = log_without(log, np.array([3]))
    assert left.score.tolist() == pytest.approx([0.9, 0.5, 0.4, 0.8, 0.6])
    for threshold in (0.0, 0.45, 0.55, 0.65, 0.75, 0.85):
        assert np.array_equal(applied_steps(left, threshold), np.delete(applied_steps(log, threshold), 1))
    assert log_without(log, np.array([99])) is log


# --- K, resolution and other partitions


def test_k_moves_the_rest_and_leaves_alone_what_was_mended():
    mended = apply(TOY, edits.merge(TOY, 3, 4))
    high = repartition(mended, k_percent=30.0)
    check_map(high)
    assert ids_of(high)["chair"] == [1, 2, 3] and ids_of(high)["dining table"] == [6, 7, 8]
    assert high.by_id(3).cells == 128
    low = repartition(mended, k_percent=0.0)
    assert ids_of(low)["chair"] == [1, 3]  # at K = 0 chair 3 would have joined chair 1


def test_edits_hold_on_a_coarser_partition():
    """At K = 0 chairs 1 and 3 are one; what was said of 3 holds for its cells alone."""
    delete = edits.delete(TOY, 3)
    mended = apply(toy_map(k_percent=0.0), delete)
    check_map(mended)
    assert ids_of(mended)["chair"] == [1, 4] and mended.by_id(1).cells == 64
    named = apply(toy_map(k_percent=0.0), edits.relabel(TOY, 3, "stool"))
    assert ids_of(named)["stool"] == [3]


def test_edits_hold_after_louvain_with_another_resolution():
    edit = edits.split(TOY, 8, (3.6, 0.0), (3.6, 1.0))
    other = recommunity(TOY, resolution=3.0, k_percent=5.0)
    mended = apply(other, edit)
    check_map(mended)
    there = mended.instance.reshape(-1)[edit.region.cells()]
    assert sorted(np.unique(there, return_counts=True)[1].tolist()) == [48, 144]
    assert not np.isin(np.delete(mended.instance.reshape(-1), edit.region.cells()), np.unique(there)).any()


def test_cells_left_over_from_a_cut_community_become_their_own_object():
    """An edit that speaks of three quarters of a table: the quarter left over is an object too."""
    cells = edits.delete(TOY, 8).region.cells()
    part = Edit("relabel", (8,), ("dining table",), Region.of(cells[cells % 120 >= 92]), "desk")
    mended = apply(TOY, part)
    check_map(mended)
    assert mended.of_class("desk")[0].id == 8 and mended.of_class("desk")[0].cells == 144
    rest = [one for one in mended.of_class("dining table") if one.id != 6]
    assert [one.cells for one in rest] == [48]


def test_an_edit_that_no_longer_makes_sense_is_reported_and_the_others_are_done():
    doubled = [edits.delete(TOY, 3), edits.delete(TOY, 3), edits.relabel(TOY, 9, "stool")]
    done = apply_edits(TOY, doubled)
    check_map(done.simap)
    ((at, why),) = done.refused
    assert at == 1 and "took away chair #3: no longer makes sense: 0 of its 64 cells are chair now" in why
    assert done.simap.by_id(9).label == "stool"
    lost = Edit("split", (1,), ("chair",), Region(()), "chair", ((0.0, 0.0), (1.0, 0.0)))
    assert apply_edits(TOY, [lost]).simap is TOY and len(apply_edits(TOY, [lost]).refused) == 1


def test_no_edits_give_the_map_itself():
    assert apply_edits(TOY, []).simap is TOY


def test_a_map_whose_instances_follow_from_nothing_can_be_mended():
    odd = type(TOY)(**{**vars(TOY), "community": np.zeros_like(TOY.community), "method": "other"})
    mended = apply(odd, edits.delete(odd, 3))
    left = [one.id for one in odd.instances if one.id != 3]
    assert [one.id for one in mended.instances] == sorted(left, key=lambda i: (odd.by_id(i).label, i))


# --- any sequence


@pytest.mark.slow
@QUICK
@given(st.data())
def test_any_sequence_of_edits_keeps_the_map_whole_and_moves_nothing_else(data):
    base = data.draw(st.sampled_from([TOY, toy_map(k_percent=30.0), SMALL]))
    made, simap = [], base
    for _ in range(data.draw(st.integers(1, 6))):
        edit = data.draw(random_edit(simap))
        if edit is None:
            continue
        done = apply_edits(base, [*made, edit])
        assert done.refused == ()
        check_map(done.simap)
        cells = edit.region.cells()
        elsewhere = np.delete(np.arange(simap.instance.size), cells)
        for name in ("instance", "community"):
            before, after = (getattr(m, name).reshape(-1)[elsewhere] for m in (simap, done.simap))
            assert np.array_equal(before, after), name
        mine = set(np.unique(simap.instance.reshape(-1)[cells]).tolist())
        untouched = {one.id: one for one in simap.instances if one.id not in mine}
        now = {one.id: one for one in done.simap.instances}
        assert all(now[i] == one for i, one in untouched.items())
        made.append(edit)
        simap = done.simap


@QUICK
@given(st.data())
def test_mending_and_moving_k_can_be_done_in_either_order(data):
    made, simap = [], TOY
    for _ in range(3):
        edit = data.draw(random_edit(simap))
        if edit is not None:
            made.append(edit)
            simap = apply_edits(TOY, made).simap
    k = data.draw(st.sampled_from([0.0, 1.0, 5.0, 11.2, 26.0, 100.0]))
    first, second = repartition(simap, k_percent=k), apply_edits(repartition(TOY, k_percent=k), made).simap
    check_map(first)
    assert np.array_equal(first.instance, second.instance) and np.array_equal(first.community, second.community)
    assert [(one.id, one.cells, one.label) for one in first.instances] == [
        (one.id, one.cells, one.label) for one in second.instances
    ]


@QUICK
@given(data=st.data())
def test_a_mended_map_survives_its_file(data, tmp_path_factory):
    edit = data.draw(random_edit(SMALL))
    if edit is None:
        return
    mended = apply(SMALL, edit)
    read = survives_a_file(mended, tmp_path_factory.mktemp("mended") / "mended.npz")
    check_map(read)
    assert_same(repartition(read, k_percent=1.0), repartition(mended, k_percent=1.0))


SMALL = map_from_drawing(
    """
    ######
    #AAB.#
    #.CC?#
    ######
    """,
    {"A": "chair", "B": "chair", "C": "couch"},
)


@QUICK
@given(st.data())
def test_a_mended_map_can_still_be_asked_why(data):
    made, simap = [], TOY
    for _ in range(3):
        edit = data.draw(random_edit(simap))
        if edit is not None:
            made.append(edit)
            simap = apply_edits(TOY, made).simap
    for one in simap.instances:
        why = explain(simap, one.id)
        assert len(why.cells) == one.cells and len(why.frames) == one.frames
        for joint in why.joints:
            assert joint.source_cells + joint.target_cells <= one.cells
