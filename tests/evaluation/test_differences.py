"""What two maps differ in, on maps whose every cell is known, and on random ones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from judged_maps import drawn, map_of_ids
from toy_maps import toy_map

from simaps_viz.errors import InputError
from simaps_viz.evaluation.quality import ScoringRules, find_overlaps
from simaps_viz.evaluation.two_maps import NO_DIFFERENCE, NO_PARTNER, Kind, as_reference, compare_two, find_differences
from simaps_viz.mapping.simap import repartition

PEERS = ScoringRules(min_true_cells=8, min_found_cells=8)


def classes(ids, **special):
    return {i: special.get(f"o{i}", "chair") for i in np.unique(ids[ids > 0]).tolist()}


def maps(left, right, left_special=None, right_special=None):
    left, right = drawn(left), drawn(right)
    return map_of_ids(left, classes(left, **(left_special or {}))), map_of_ids(
        right, classes(right, **(right_special or {}))
    )


def found_between(left, right):
    return find_differences(find_overlaps(right, as_reference(left), PEERS))


def listed(differences):
    return [(d.kind, d.reference, d.other) for d in differences.items]


def test_every_kind_by_hand():
    left, right = maps(
        """
        112233.
        112233.
        .......
        4444.55
        4444.55
        .......
        66.7777
        66.7777
        """,
        """
        111133.
        111133.
        .......
        2288.55
        2288.55
        9......
        ...7...
        ...7...
        """,
        right_special={"o5": "table"},
    )
    # 7 -> one quarter of it is found: it is there, but no match. 6 -> nothing. 9 lies on nothing.
    found = found_between(left, right)
    assert listed(found) == [
        (Kind.MERGED, (1, 2), (1,)),
        (Kind.SPLIT, (4,), (2, 8)),
        (Kind.MISSED, (6,), ()),
        (Kind.EXTRA, (), (9,)),
        (Kind.LABEL, (5,), (5,)),
        (Kind.OUTLINE, (7,), (7,)),
    ]
    assert found.same == 1  # chair 3
    label = next(d for d in found.items if d.kind is Kind.LABEL)
    assert (label.label, label.other_label) == ("chair", "table")
    assert found.counts() == {kind: int(kind not in NO_DIFFERENCE) for kind in Kind}
    assert list(found.counts()) == list(Kind)


def test_less_than_a_quarter_is_missed_and_its_crumb_a_piece():
    left, right = maps("11111", "1....")
    assert listed(found_between(left, right)) == [
        (Kind.MISSED, (1,), ()),
        (Kind.OUTLINE, (1,), (1,)),
    ]


def test_a_match_that_swallows_a_neighbour_is_merged_and_not_the_same():
    left, right = maps("111122", "111111")
    found = found_between(left, right)
    assert listed(found) == [(Kind.MERGED, (1, 2), (1,))]
    assert found.same == 0


def test_small_objects_are_ignored_on_both():
    left, right = drawn("11.22", cells=2), drawn("11.33", cells=2)
    tiny = replace(PEERS, min_true_cells=30, min_found_cells=30)
    overlaps = find_overlaps(map_of_ids(right, classes(right)), as_reference(map_of_ids(left, classes(left))), tiny)
    found = find_differences(overlaps)
    assert (found.items, found.same, found.ignored) == ((), 0, (2, 2))


def test_what_agrees_is_ranked_by_its_outline_and_small_things_are_listed():
    left, right = maps(
        """
        1111.2222.3333.4..
        1111.2222.3333....
        """,
        """
        1111.222..33.....5
        1111.2222.3333...5
        """,
    )
    tiny = replace(PEERS, min_true_cells=20, min_found_cells=20)  # a letter has sixteen cells
    found = find_differences(find_overlaps(right, as_reference(left), tiny))
    assert listed(found) == [
        (Kind.EXTRA, (), (5,)),
        (Kind.EDGE, (3,), (3,)),
        (Kind.EDGE, (2,), (2,)),
        (Kind.SMALL, (4,), ()),
    ]
    assert [d.iou for d in found.items[1:3]] == [6 / 8, 7 / 8]
    assert found.same == 3 and found.same_iou == pytest.approx((1 + 6 / 8 + 7 / 8) / 3)


@st.composite
def random_ids(draw):
    rows, cols = draw(st.integers(2, 5)), draw(st.integers(2, 6))
    values = draw(st.lists(st.integers(0, 4), min_size=rows * cols, max_size=rows * cols))
    return np.kron(np.array(values, np.int32).reshape(rows, cols), np.ones((3, 3), np.int32))


@settings(max_examples=30, deadline=None)
@given(random_ids(), st.data())
def test_every_object_agrees_or_takes_part_in_a_difference(left, data):
    values = data.draw(st.lists(st.integers(0, 4), min_size=left.size // 9, max_size=left.size // 9))
    right = np.kron(np.array(values, np.int32).reshape(left.shape[0] // 3, -1), np.ones((3, 3), np.int32))
    names = st.sampled_from(["chair", "table"])
    one = map_of_ids(left, {i: data.draw(names) for i in classes(left)})
    other = map_of_ids(right, {i: data.draw(names) for i in classes(right)})
    overlaps = find_overlaps(other, as_reference(one), PEERS)
    found = find_differences(overlaps)
    matched = overlaps.pairs[overlaps.matched]
    for side, position, key in ((overlaps.true, 0, "reference"), (overlaps.found, 1, "other")):
        in_items = {i for d in found.items for i in getattr(d, key)}
        agreeing = set(side.ids[matched[:, position]].tolist())
        assert set(side.ids[side.counts].tolist()) <= in_items | agreeing
        small = {i for d in found.items if d.kind is Kind.SMALL for i in getattr(d, key)}
        assert in_items - small <= set(side.ids[side.counts].tolist())
        assert small <= set(side.ids[~side.counts].tolist())
    # What is listed agrees with what is scored: every match that is no part of another difference, and how well.
    edges = {(d.reference[0], d.other[0]): d.iou for d in found.items if d.kind is Kind.EDGE}
    ids = zip(overlaps.true.ids[matched[:, 0]].tolist(), overlaps.found.ids[matched[:, 1]].tolist(), strict=True)
    scored = dict(zip(ids, overlaps.iou[overlaps.matched].tolist(), strict=True))
    assert all(scored[pair] == iou < 1.0 for pair, iou in edges.items())
    assert len(edges) + sum(iou == 1.0 for iou in scored.values()) >= found.same >= len(edges)
    ranked = [d.iou for d in found.items if d.kind is Kind.EDGE]
    assert ranked == sorted(ranked)
    assert len([d for d in found.items if d.kind is Kind.MERGED]) == overlaps.merged.sum()
    assert len([d for d in found.items if d.kind is Kind.SPLIT]) == overlaps.split.sum()
    assert len(set(listed(found))) == len(found.items)


@settings(max_examples=30, deadline=None)
@given(random_ids(), st.permutations(range(1, 5)))
def test_a_map_agrees_with_itself_under_other_numbers(ids, order):
    new = np.array([0, *order], np.int32)[ids]
    compared = compare_two(("a", map_of_ids(ids, classes(ids))), ("b", map_of_ids(new, classes(new))))
    assert compared.items == () and compared.same == len(classes(ids))
    assert np.array_equal(compared.left.colors, compared.right.colors)


def test_affinity_and_k_merge_what_they_should():
    fine, coarse = toy_map(), repartition(toy_map(), k_percent=0.0)
    compared = compare_two(("K = 5 %", fine), ("K = 0 %", coarse))
    assert [(i.kind, i.left, i.right, i.label) for i in compared.items] == [("merged", (1, 3), (1,), "chair")]
    assert compared.items[0].extent_m == pytest.approx((-0.4, -1.0, 1.45, 2.1))
    assert compared.same == 5 and compared.score is None and compared.reference == "left"
    back = compare_two(("K = 0 %", coarse), ("K = 5 %", fine))
    assert [(i.kind, i.left, i.right) for i in back.items] == [("split", (1,), (1, 3))]


def test_the_truth_judges_from_either_side():
    true, found = toy_map(), repartition(toy_map(), k_percent=0.0)
    one = compare_two(("Truth", true), ("Map", found), truth="left")
    other = compare_two(("Map", found), ("Truth", true), truth="right")
    assert [(i.kind, i.left, i.right) for i in one.items] == [("merged", (1, 3), (1,))]
    assert [(i.kind, i.left, i.right) for i in other.items] == [("merged", (1,), (1, 3))]
    assert one.score is not None and other.score is not None
    assert one.score == other.score and one.score.under == 1
    assert (one.reference, other.reference) == ("left", "right")


def test_colours_follow_the_left_map():
    left, right = toy_map(), repartition(toy_map(), k_percent=0.0)
    compared = compare_two(("a", left), ("b", right))
    couch, plant = left.at(3.5, 2.4), left.at(4.5, -1.45)
    assert couch is not None and plant is not None
    for thing in (couch, plant):
        row, col = np.argwhere(left.instance == thing.id)[0]
        assert (compared.left.colors[row, col] == compared.right.colors[row, col]).all()
    alone = replace(left, instance=np.where(left.instance == couch.id, 0, left.instance).astype(np.int32))
    compared = compare_two(("a", alone), ("b", left))
    row, col = np.argwhere(left.instance == couch.id)[0]
    assert tuple(compared.right.colors[row, col]) == NO_PARTNER
    assert [(i.kind, i.left, i.right) for i in compared.items] == [("extra", (), (couch.id,))]


def test_maps_of_other_places_are_refused():
    moved = replace(toy_map(), T_map_world=np.diag([1.0, 1.0, 1.0, 1.0]) + np.eye(4, k=3))
    with pytest.raises(InputError, match="same map frame"):
        compare_two(("a", toy_map()), ("b", moved))
