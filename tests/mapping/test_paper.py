"""The K % rule against its plain twin, and the log that answers every K."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mapping_twins import plain_merge_steps

from simaps_viz.mapping.paper import merge_steps
from simaps_viz.mapping.partition import applied_steps, instance_of_community
from simaps_viz.structures import MergeLog


@st.composite
def partitions(draw):
    n = draw(st.integers(1, 24))
    community = np.array(draw(st.lists(st.integers(0, 6), min_size=n, max_size=n)))
    community = np.unique(community, return_inverse=True)[1]
    pair = st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda p: p[0] != p[1])
    edges = draw(st.lists(pair, max_size=40)) if n > 1 else []
    return community, np.array(sorted({tuple(sorted(e)) for e in edges}), dtype=int).reshape(-1, 2)


@pytest.mark.slow
@given(partitions())
@settings(max_examples=80, deadline=None)
def test_steps_are_the_twins(partition):
    assert merge_steps(*partition) == plain_merge_steps(*partition)


def test_largest_share_first_then_stop():
    # 0: four cells, one touches 1.  1: two cells, both touch 0.  2: three cells, one touches 1.
    community = np.array([0, 0, 0, 0, 1, 1, 2, 2, 2])
    edges = np.array([(0, 1), (1, 2), (2, 3), (3, 4), (3, 5), (5, 6), (6, 7), (7, 8)])
    assert merge_steps(community, edges) == [(1, 0, 1.0), (2, 0, pytest.approx(1 / 3))]


def log_of(steps, label=1) -> MergeLog:
    return MergeLog(
        np.full(len(steps), label, np.int16), np.array([s[0] for s in steps], np.int32),
        np.array([s[1] for s in steps], np.int32), np.array([s[2] for s in steps], np.float32),
    )  # fmt: skip


def test_a_threshold_takes_the_prefix_of_each_class_even_where_shares_rise_again():
    log = MergeLog(
        np.array([1, 1, 1, 4, 4], np.int16), np.array([2, 3, 4, 9, 8], np.int32),
        np.array([1, 1, 1, 7, 7], np.int32), np.array([0.5, 0.1, 0.9, 0.3, 0.05], np.float32),
    )  # fmt: skip
    assert applied_steps(log, 0.2).tolist() == [True, False, False, True, False]
    assert applied_steps(log, 0.0).tolist() == [True] * 5
    assert applied_steps(log, 0.9).tolist() == [False] * 5
    assert applied_steps(log, 0.05).tolist() == [True, True, True, True, False]  # "more than": equal stops
    assert applied_steps(log_of([]), 0.5).tolist() == []


@pytest.mark.slow
@given(partitions(), st.sampled_from([0.0, 0.05, 0.2, 0.34, 0.5, 0.99, 1.0]))
@settings(max_examples=60, deadline=None)
def test_the_prefix_is_what_stopping_at_k_gives(partition, k):
    community, edges = partition
    steps = [(s + 1, t + 1, share) for s, t, share in merge_steps(community, edges)]
    instance = instance_of_community(log_of(steps), applied_steps(log_of(steps), k), int(community.max()) + 1)
    direct = community.copy()
    for source, target, share in plain_merge_steps(community, edges):
        if not np.float32(share) > np.float32(k):
            break
        direct[direct == source] = target
    of_cell = instance[community + 1]
    assert np.array_equal(of_cell[:, None] == of_cell, direct[:, None] == direct)
    for one in np.unique(of_cell):  # an instance is called by its smallest community
        assert one == community[of_cell == one].min() + 1
