"""Views are of one community, frame and segment each, however large these numbers are."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from drawn_readings import grid_of
from hypothesis import given
from hypothesis import strategies as st
from toy_maps import toy_map

from simaps_viz.mapping.edits import views_after
from simaps_viz.mapping.observations import Readings
from simaps_viz.mapping.partition import describe_instances, group_views
from simaps_viz.mapping.simap import count_views
from simaps_viz.structures import Views

NUMBERS = st.sampled_from([0, 1, 2, 1 << 8, 1 << 16, (1 << 16) + 1, (1 << 23) + 1, (1 << 24) - 1, (1 << 31) - 1])
SMALL = st.integers(0, 2)
ROWS = st.one_of(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS)), st.lists(st.tuples(SMALL, SMALL, SMALL)))


@given(ROWS)
def test_groups_are_what_a_dictionary_makes_of_them(rows):
    columns = np.array(rows, np.int32).reshape(-1, 3).T
    groups = group_views(*columns)
    counted = Counter(rows)
    assert [rows[i] for i in groups.first.tolist()] == sorted(counted)
    assert groups.first.tolist() == [rows.index(row) for row in sorted(counted)]
    assert groups.size.tolist() == [counted[row] for row in sorted(counted)]
    assert groups.of_row.tolist() == [sorted(counted).index(row) for row in rows]


@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(1, 12), st.integers(0, 20))
def test_an_instance_is_measured_as_its_cells_say_one_by_one(seed, rows, cols, most):
    rng = np.random.default_rng(seed)
    numbers = np.r_[0, rng.choice(np.arange(1, 50), most, replace=False)].astype(np.int32)
    instance = rng.choice(numbers, (rows, cols))
    label = (instance % 2 + 1).astype(np.int16)
    grid = grid_of(label, rng.uniform(-0.5, 3.0, (rows, cols)).astype(np.float32))
    nobody = np.zeros(0, np.int32)
    none = Views(nobody, nobody, nobody, nobody, np.zeros(0, np.float32))
    found = describe_instances(grid, instance, none, np.arange(50, dtype=np.int32))
    assert [(one.label, one.id) for one in found] == sorted(
        (grid.labels[one % 2 + 1], one) for one in set(instance.ravel().tolist()) - {0}
    )
    for one in found:
        row, col = np.nonzero(instance == one.id)
        cells = zip(row.tolist(), col.tolist(), strict=True)
        tops = np.array([(*grid.spec.centre_of(*cell), grid.height_m[cell]) for cell in cells])
        half = np.array([grid.spec.cell_size_m / 2.0] * 2 + [0.0])
        assert one.cells == len(row)
        assert np.allclose(one.centroid_m, tops.mean(axis=0), atol=1e-4)
        assert np.allclose(one.aabb_m, (tops.min(axis=0) - half, tops.max(axis=0) + half), atol=1e-4)


@pytest.mark.parametrize("communities", [(1, 2), (1, 1 << 23), (1, (1 << 24) + 1), ((1 << 31) - 2, (1 << 31) - 1)])
def test_readings_of_different_frames_and_communities_stay_apart(communities):
    """The segments of the two frames differ by 2^16, and by a number of 24 bits."""
    grid = grid_of(np.ones((1, 4), np.int16), np.ones((1, 4), np.float32))
    community = np.repeat(np.array(communities, np.int32), 2)[None]
    segment = np.repeat(np.array([65_537, 1, (1 << 24) - 1], np.int32), 4)
    seen = Readings(
        cell=np.tile(np.arange(4, dtype=np.int32), 3), frame=np.repeat(np.arange(3, dtype=np.int32), 4),
        segment=segment, label=np.ones(12, np.int16), score=np.repeat(np.array([0.25, 0.5, 1.0], np.float32), 4),
        height_m=np.ones(12, np.float32),
    )  # fmt: skip
    views = count_views(grid, community, seen)
    assert views.community.tolist() == np.repeat(communities, 3).tolist() and views.frame.tolist() == [0, 1, 2] * 2
    assert views.segment.tolist() == [65_537, 1, (1 << 24) - 1] * 2
    assert views.cells.tolist() == [2] * 6 and views.score.tolist() == [0.25, 0.5, 1.0] * 2
    assert {column.dtype.name for column in (views.community, views.frame, views.segment, views.cells)} == {"int32"}


def test_views_of_a_mended_community_stay_apart():
    """Frame 0 with segment 65537 and frame 1 with segment 1 are two views, before and after an edit."""
    toy = toy_map()
    of, other = 3, toy.views.community != 3
    cells = int((toy.community == of).sum())
    seen = np.array([cells, cells // 2], np.int32)
    mine = (np.array([of, of], np.int32), np.array([0, 1], np.int32), np.array([65_537, 1], np.int32), seen,
            np.array([0.25, 1.0], np.float32))  # fmt: skip
    kept = (toy.views.community, toy.views.frame, toy.views.segment, toy.views.cells, toy.views.score)
    toy = replace(toy, views=Views(*(np.r_[old[other], new] for old, new in zip(kept, mine, strict=True))))
    new = int(toy.community.max()) + 1
    views = views_after(toy, np.where(toy.community == of, new, toy.community).astype(np.int32))
    there = views.community == new
    assert views.frame[there].tolist() == [0, 1] and views.segment[there].tolist() == [65_537, 1]
    assert views.cells[there].tolist() == seen.tolist() and views.score[there].tolist() == [0.25, 1.0]
    assert not (views.community == of).any() and len(views.community) == len(toy.views.community)
