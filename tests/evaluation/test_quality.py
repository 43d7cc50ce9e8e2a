"""Scores of maps whose every cell is known, against numbers found on paper and against a plain twin."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from judged_maps import LABELS, drawn, map_of_ids, truth_of_ids

from simaps_viz.errors import InputError
from simaps_viz.evaluation.quality import ScoringRules, average_precision, find_overlaps, score

CHAIRS = dict.fromkeys(range(1, 36), "chair")


def scored(truth, found, truth_classes=CHAIRS, found_classes=CHAIRS, scores=None, **rules):
    here = {i: c for i, c in truth_classes.items() if (truth == i).any()}
    there = {i: c for i, c in found_classes.items() if (found == i).any()}
    return score(map_of_ids(found, there, scores), truth_of_ids(truth, here), **rules)


def plain_quality(true, found, true_class, found_class, min_true=20, min_found=8):
    """The twin: (true, found, matched, sum of IoU) with a mask for every instance, in the order of the definition."""
    total = [0, 0, 0, 0.0]
    for name in sorted(set(true_class.values())):
        want = [i for i, c in true_class.items() if c == name and (true == i).sum() >= min_true]
        tiny = [i for i, c in true_class.items() if c == name and 0 < (true == i).sum() < min_true]
        have = [j for j, c in found_class.items() if c == name and (found == j).sum() >= min_found]
        have = [j for j in have if not np.isin(true[found == j], tiny).mean() > 0.5]
        if not want:
            continue
        best = [
            max((((found == j) & (true == i)).sum() / ((found == j) | (true == i)).sum() for j in have), default=0.0)
            for i in want
        ]
        hits = [b for b in best if b > 0.5]
        total = [t + n for t, n in zip(total, (len(want), len(have), len(hits), sum(hits)), strict=True)]
    return total


def test_a_merger_and_a_split_by_hand():
    truth = drawn("""
        112233.
        112233.
        .......
        4444...
        4444...
    """)  # fmt: skip
    found = drawn("""
        111133.
        111133.
        .......
        2255...
        2255...
    """)  # fmt: skip
    result = scored(truth, found).overall
    assert (result.true, result.found, result.matched) == (4, 4, 1)  # of the chairs, only 3 has IoU above 0.5
    assert result.pq == pytest.approx(1 / 4) and result.sq == 1.0 and result.rq == pytest.approx(1 / 4)
    assert (result.over, result.under) == (1, 1)
    assert result.label_accuracy == 1.0
    overlaps = scored(truth, found).overlaps
    assert overlaps.true.ids[overlaps.split].tolist() == [4] and overlaps.found.ids[overlaps.merged].tolist() == [1]


def test_exactly_half_is_no_match_and_a_little_more_is():
    truth = drawn("1111 1111".replace(" ", "\n"), cells=5)
    half = np.where(np.arange(truth.shape[1]) < 10, truth, 0)
    more = np.where(np.arange(truth.shape[1]) < 11, truth, 0)
    assert scored(truth, half).overall.matched == 0
    assert scored(truth, more).overall.matched == 1
    assert scored(truth, more).overall.sq == pytest.approx(11 / 20)


def test_another_class_is_no_match_and_counts_as_found_there():
    truth = drawn("11.22")
    result = scored(truth, truth, {1: "chair", 2: "table"}, {1: "table", 2: "table"})
    assert (result.by_class["chair"].true, result.by_class["chair"].found) == (1, 0)
    assert (result.by_class["table"].true, result.by_class["table"].found, result.by_class["table"].matched) == (
        1,
        2,
        1,
    )
    assert result.by_class["chair"].pq == 0.0 and result.by_class["chair"].sq is None
    assert result.overall.pq == pytest.approx(1 / 2)
    assert result.overall.label_accuracy == pytest.approx(1 / 2)
    assert result.by_class["table"].label_accuracy == pytest.approx(1 / 2)


def test_small_ones_are_neither_asked_for_nor_held_against_the_map():
    truth = np.zeros((30, 30), np.int32)
    truth[0:4, 0:4], truth[10:20, 10:20], truth[25:27, 25:27] = 1, 2, 3
    result = scored(truth, truth)
    assert (result.overall.true, result.overall.found, result.overall.pq) == (1, 1, 1.0)
    asked = scored(truth, truth, min_true_cells=16)
    assert (asked.overall.true, asked.overall.found) == (2, 2)
    elsewhere = truth.copy()
    elsewhere[0:4, 0:4], elsewhere[0:4, 20:24] = 0, 1  # the same 16 cells where nothing is: wrong now
    assert scored(truth, elsewhere).overall.found == 2


def test_a_class_that_is_not_there_is_named_apart():
    truth = drawn("11...")
    result = scored(truth, drawn("11.22"), {1: "chair"}, {1: "chair", 2: "table"})
    assert result.invented == {"table": 1} and list(result.by_class) == ["chair"]
    assert result.overall.pq == 1.0 and result.overall.label_accuracy == pytest.approx(1 / 2)


def test_nothing_there_gives_none_not_a_number():
    nothing = np.zeros((8, 8), np.int32)
    result = scored(nothing, nothing)
    overall = result.overall
    assert (overall.pq, overall.sq, overall.rq, overall.ap50, overall.label_accuracy) == (None,) * 5
    assert result.by_class == {} and result.to_json()["overall"]["pq"] is None
    missed = scored(drawn("11"), np.zeros((4, 8), np.int32)).overall
    assert (missed.pq, missed.sq, missed.rq, missed.ap50, missed.true, missed.found) == (0.0, None, 0.0, 0.0, 1, 0)


@pytest.mark.parametrize(
    ("hits", "true", "expected"),
    [
        ([True, True], 2, 1.0),
        ([False, True], 1, 1 / 2),
        ([True, False, True], 2, (1 + 2 / 3) / 2),
        ([False, True, True], 2, (2 / 3 + 2 / 3) / 2),  # precision at a recall is the best from there on
        ([True], 4, 1 / 4),
        ([False, False], 3, 0.0),
        ([], 3, 0.0),
    ],
)
def test_average_precision(hits, true, expected):
    assert average_precision(np.array(hits, bool), true) == pytest.approx(expected)


def test_the_ranking_by_score_decides_average_precision():
    truth, found = drawn("11....."), drawn("11...22")
    assert scored(truth, found, scores={1: 0.9, 2: 0.1}).overall.ap50 == 1.0
    assert scored(truth, found, scores={1: 0.1, 2: 0.9}).overall.ap50 == pytest.approx(1 / 2)


blobs = st.lists(st.tuples(*[st.integers(0, 19)] * 2, *[st.integers(1, 9)] * 2), min_size=0, max_size=9)


def painted(boxes):
    ids = np.zeros((28, 28), np.int32)
    for number, (row, col, high, wide) in enumerate(boxes, start=1):
        ids[row : row + high, col : col + wide] = number
    return ids


@settings(max_examples=30, deadline=None)
@given(blobs, blobs, st.randoms(use_true_random=False))
def test_the_fast_scores_are_those_of_the_plain_twin(true_boxes, found_boxes, random):
    truth, found = painted(true_boxes), painted(found_boxes)
    if random.random() < 0.5:
        found = np.roll(truth, random.randint(0, 2), axis=1)
    names = {i: random.choice(("chair", "table")) for i in range(1, 10)}
    true_class = {i: names[i] for i in np.unique(truth[truth > 0]).tolist()}
    found_class = {i: names[i] for i in np.unique(found[found > 0]).tolist()}
    result = scored(truth, found, true_class, found_class).overall
    expected = plain_quality(truth, found, true_class, found_class)
    assert (result.true, result.found, result.matched) == tuple(expected[:3])
    assert result.iou_sum == pytest.approx(expected[3])


@settings(max_examples=25, deadline=None)
@given(blobs, st.randoms(use_true_random=False))
def test_truth_against_itself_is_exactly_one_whatever_the_ids(boxes, random):
    truth = painted(boxes)
    names = {i: random.choice(("chair", "table")) for i in range(1, 10)}
    true_class = {i: names[i] for i in np.unique(truth[truth > 0]).tolist()}
    fresh = random.sample(range(1, 5000), 10)
    shuffled = np.array([0, *fresh[:9]], np.int32)[truth]
    result = scored(truth, shuffled, true_class, {fresh[i - 1]: c for i, c in true_class.items()}).overall
    if result.true:
        assert (result.pq, result.sq, result.rq, result.ap50, result.label_accuracy) == (1.0,) * 5
        assert (result.true, result.over, result.under) == (result.found, 0, 0)


def test_windows_may_differ_by_whole_cells_and_nothing_is_lost():
    two, one, corner_m = drawn("11.22"), drawn("11"), (0.6, 0.2)
    chairs = {1: "chair", 2: "chair"}
    wide = np.pad(two, ((4, 2), (12, 3)))  # its cell (4, 12) lies at that corner
    small_map = map_of_ids(one, {1: "chair"}, origin_m=corner_m)
    result = score(small_map, truth_of_ids(wide, chairs)).overall
    assert (result.true, result.found, result.matched, result.sq) == (2, 1, 1, 1.0)
    result = score(map_of_ids(wide, chairs), truth_of_ids(one, {1: "chair"}, origin_m=corner_m)).overall
    assert (result.true, result.found, result.matched, result.sq) == (1, 2, 1, 1.0)


@pytest.mark.parametrize(
    ("place", "message"),
    [({"origin_m": (0.02, 0.0)}, "coincide"), ({"size_m": 0.1}, "cells of one size")],
)
def test_grids_that_do_not_fit_are_refused(place, message):
    with pytest.raises(InputError, match=message):
        score(map_of_ids(drawn("11"), {1: "chair"}, **place), truth_of_ids(drawn("11"), {1: "chair"}))


def test_another_map_frame_is_refused():
    truth = truth_of_ids(drawn("11"), {1: "chair"})
    with pytest.raises(InputError, match="same map frame"):
        score(map_of_ids(drawn("11"), {1: "chair"}), replace(truth, T_map_world=np.diag([-1.0, -1.0, 1.0, 1.0])))


def test_classes_are_compared_by_name_not_by_number():
    truth = truth_of_ids(drawn("11.22"), {1: "chair", 2: "table"})
    simap = map_of_ids(drawn("11.22"), {1: "chair", 2: "table"})
    order = (0, 3, 1, 2)
    grid = replace(
        simap.grid, labels=tuple(LABELS[i] for i in order), is_thing=tuple(simap.grid.is_thing[i] for i in order),
        label=np.argsort(order)[simap.grid.label].astype(np.int16),
    )  # fmt: skip
    assert score(replace(simap, grid=grid), truth).overall.pq == 1.0


@pytest.mark.parametrize("rules", [(0, 8, 0.25), (20, 0, 0.25), (20, 8, 0.0), (20, 8, 0.6)])
def test_rules_that_make_no_sense_are_refused(rules):
    with pytest.raises(InputError):
        ScoringRules(*rules)


def test_a_quarter_is_notable_and_what_is_notable_can_be_said():
    truth, classes = drawn("1111.2222", cells=5), {1: "chair", 2: "chair"}
    found = truth.copy()
    found[:, 30:] = 1  # takes three quarters of 2 and leaves a quarter
    maps = map_of_ids(found, classes), truth_of_ids(truth, classes)
    assert find_overlaps(*maps).merged.tolist() == [True, False] and find_overlaps(*maps).split.tolist() == [
        False,
        True,
    ]
    strict = find_overlaps(*maps, ScoringRules(notable_share=0.26))
    assert strict.merged.any() and not strict.split.any()
