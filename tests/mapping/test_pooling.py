"""Joining communities on pooled evidence, against a twin that counts everything anew before every step."""

import numpy as np
import pytest
from evidence_twins import plain_pool
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from simaps_viz.mapping.pooling import PoolSettings, join, join_parts, sum_pairs

pytestmark = pytest.mark.slow

Case = tuple[NDArray, NDArray, NDArray, NDArray, NDArray]
"""Communities of cells, pairs, same, different, touching pairs."""


@st.composite
def evidence(draw, most: int = 4) -> Case:
    """Few different counts, so that ties abound."""
    n = draw(st.integers(1, 22))
    community = draw(st.lists(st.integers(0, 8), min_size=n, max_size=n))
    community = np.unique(community, return_inverse=True)[1].astype(np.int32)
    pair = st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda p: p[0] < p[1])
    edges = sorted(draw(st.sets(pair, max_size=40))) if n > 1 else []
    touching = sorted(draw(st.sets(pair, max_size=12))) if n > 1 else []
    counts = st.lists(st.integers(0, most), min_size=len(edges), max_size=len(edges))
    same, different = np.array(draw(counts), np.int64), np.array(draw(counts), np.int64)
    return community, pairs(edges), same, different, pairs(touching)


def pairs(rows) -> NDArray:
    return np.array(rows, dtype=np.int32).reshape(-1, 2)


def pool(
    community: NDArray, edges: NDArray, same: NDArray, different: NDArray, touching: NDArray, belief: PoolSettings
) -> tuple[NDArray, NDArray, NDArray]:
    """Join the communities of one class."""
    return join([sum_pairs(community, edges, same, different, touching)], belief)


def steps_of(found) -> list[tuple[int, int, float]]:
    source, target, affinity = found
    assert (source.dtype, target.dtype, affinity.dtype) == (np.int32, np.int32, np.float32)
    return list(zip(source.tolist(), target.tolist(), affinity.tolist(), strict=True))


def rounded(steps) -> list[tuple[int, int, float]]:
    return [(s, t, float(np.float32(a))) for s, t, a in steps]


believes = st.sampled_from(
    [PoolSettings(), PoolSettings(1.0, 0.5), PoolSettings(3.0, 0.0), PoolSettings(2.0, 1.0), PoolSettings(0.0, 0.7)]
)


@given(evidence(), believes)
@settings(max_examples=100, deadline=None)
def test_steps_are_the_twins_ties_included(case: Case, belief):
    assert steps_of(pool(*case, belief)) == rounded(plain_pool(*case, belief))


@given(evidence(most=1), believes)
def test_steps_are_the_twins_where_nearly_all_is_tied(case: Case, belief):
    assert steps_of(pool(*case, belief)) == rounded(plain_pool(*case, belief))


@given(evidence(), st.sampled_from([0.2, 0.5, 0.6, 0.9]))
def test_no_step_is_made_once_the_best_affinity_is_too_low(case: Case, above):
    every, sums = steps_of(pool(*case, PoolSettings())), sum_pairs(*case)
    low = next((at for at, step in enumerate(every) if step[2] <= np.float32(above)), len(every))
    parts = sums.communities, sums.low, sums.high, sums.same, sums.different, sums.touching
    assert steps_of(join_parts(*parts, PoolSettings(), above=above)) == every[:low]


@given(st.lists(evidence(), max_size=4), believes)
def test_parts_that_have_nothing_to_do_with_each_other_are_joined_as_if_all_were_one(parts: list[Case], belief):
    found = join([sum_pairs(*case) for case in parts], belief)
    columns, first, cells = [[] for _ in range(5)], 0, 0
    for community, edges, same, different, touching in parts:
        shifted = (community + first, edges + cells, same, different, touching + cells)
        for column, part in zip(columns, shifted, strict=True):
            column.append(part)
        first, cells = first + int(community.max(initial=-1)) + 1, cells + len(community)
    if parts:
        community, edges, same, different, touching = (np.concatenate(column) for column in columns)
        assert steps_of(found) == steps_of(pool(community, edges, same, different, touching, belief))
    else:
        assert steps_of(found) == []


def random_case(seed: int, communities: int, edges: int) -> Case:
    """Every cell a community; many pairs, so that joining overtakes much of the queue."""
    rng = np.random.default_rng(seed)
    all_pairs = np.stack(np.triu_indices(communities, 1), axis=1)
    chosen = all_pairs[np.sort(rng.permutation(len(all_pairs))[:edges])]
    touching = all_pairs[np.sort(rng.permutation(len(all_pairs))[: edges // 4])]
    same, different = rng.integers(0, 30, len(chosen)), rng.integers(0, 30, len(chosen))
    return np.arange(communities, dtype=np.int32), chosen.astype(np.int32), same, different, touching.astype(np.int32)


@pytest.mark.parametrize(("communities", "edges"), [(40, 780), (60, 500), (120, 400)])
def test_many_communities_are_the_twins(communities, edges):
    case = random_case(1, communities, edges)
    found = steps_of(pool(*case, PoolSettings()))
    assert found == rounded(plain_pool(*case, PoolSettings())) and len(found) > communities // 2


def hand_over(hubs: int, leaves: int) -> Case:
    """A hub with many weak pairs joins the next, and they the next: all weak pairs move every time."""
    chain = [(k, k + 1) for k in range(hubs - 1)]
    weak = [(hubs - 1, hubs + leaf) for leaf in range(leaves)]
    rng = np.random.default_rng(0)
    same = np.concatenate([40 + np.arange(hubs - 1), rng.integers(1, 4, leaves)])
    different = np.concatenate([np.zeros(hubs - 1, int), rng.integers(5, 9, leaves)])
    return np.arange(hubs + leaves, dtype=np.int32), pairs(chain + weak), same, different, pairs([])


def test_edges_handed_from_hub_to_hub_are_not_lost():
    case = hand_over(12, 30)
    found = steps_of(pool(*case, PoolSettings()))
    assert found == rounded(plain_pool(*case, PoolSettings())) and len(found) == 41


def test_nothing_to_join():
    none = np.zeros(0, np.int64)
    for community in ([], [0], [0, 0, 0], [0, 1, 2]):
        case = np.array(community, np.int32), pairs([]), none, none, pairs([])
        assert steps_of(pool(*case, PoolSettings())) == []
    inside = np.zeros(3, np.int32), pairs([(0, 1), (1, 2)]), np.array([5, 5]), np.array([0, 0]), pairs([(0, 1)])
    assert steps_of(pool(*inside, PoolSettings())) == []
    against = np.array([0, 1], np.int32), pairs([(0, 1)]), np.array([0]), np.array([9]), pairs([])
    assert steps_of(pool(*against, PoolSettings())) == []


def two(same, different, *, touch, belief=None) -> float:
    """Affinity of two communities of one cell each, 0 if never joined."""
    case = np.array([0, 1], np.int32), pairs([(0, 1)]), np.array([same]), np.array([different])
    found = steps_of(pool(*case, pairs([(0, 1)] if touch else []), belief or PoolSettings()))
    return found[0][2] if found else 0.0


def test_the_affinity_is_the_formula():
    assert two(0, 0, touch=True) == pytest.approx(0.7)
    assert two(0, 0, touch=False) == 0.0
    assert two(6, 1, touch=False) == pytest.approx(6 / 10)
    assert two(6, 1, touch=True) == pytest.approx((6 + 2.1) / 10)
    assert two(0, 4, touch=True) == pytest.approx(2.1 / 7)
    assert two(6, 2, touch=True, belief=PoolSettings(4.0, 0.25)) == pytest.approx(7 / 12)


def test_what_nobody_imagines_and_nobody_saw_is_not_joined():
    assert two(0, 0, touch=True, belief=PoolSettings(0.0, 0.7)) == 0.0
    assert two(2, 1, touch=True, belief=PoolSettings(0.0, 0.7)) == pytest.approx(2 / 3)


def test_evidence_of_joined_communities_is_pooled():
    # 0 and 1 are one for sure. Of 2, cell 0 says 8 same, cell 1 says 8 different: together 8 / 19.
    case = np.array([0, 1, 2], np.int32), pairs([(0, 1), (0, 2), (1, 2)]), np.array([90, 8, 0]), np.array([0, 0, 8])
    found = steps_of(pool(*case, pairs([]), PoolSettings()))
    assert found == [(1, 0, pytest.approx(90 / 93)), (2, 0, pytest.approx(8 / 19))]
    # One more frame for 2 than for 1, and 2 goes first.
    case = np.array([0, 1, 2], np.int32), pairs([(0, 1), (0, 2)]), np.array([8, 9]), np.array([0, 0])
    assert [step[:2] for step in steps_of(pool(*case, pairs([]), PoolSettings()))] == [(2, 0), (1, 0)]


def test_ties_go_to_the_smaller_numbers():
    case = np.array([0, 1, 2, 3], np.int32), pairs([(2, 3), (1, 3), (0, 3), (1, 2)]), np.full(4, 6), np.zeros(4, int)
    found = steps_of(pool(*case, pairs([]), PoolSettings()))
    assert [step[:2] for step in found] == [(3, 0), (1, 0), (2, 0)]
    assert found[2][2] == pytest.approx(12 / 15)


@given(evidence())
@settings(max_examples=100, deadline=None)
def test_every_community_ends_at_most_once_and_in_a_living_smaller_one(case: Case):
    ended = set()
    for source, target, affinity in steps_of(pool(*case, PoolSettings())):
        assert target < source and not {source, target} & ended and 0.0 < affinity <= 1.0
        ended.add(source)
