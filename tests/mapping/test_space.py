"""Things under things are found, kept apart and tied to what the map shows; the map from above stays as it is."""

import json
import math
import resource
import zipfile
from collections import Counter, defaultdict
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_frames import IS_THING, LABELS, random_frames
from seen_columns import Column, block, frame, map_of_columns, table_over_chairs, turned

from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.errors import InputError
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.edits import apply, delete, relabel
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.finalize import SequenceFacts, map_so_far
from simaps_viz.mapping.pooling import PoolSettings
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.mapping.space import SpaceSettings, _count_across, _counted, _join, _meetings, _pairs, _summed
from simaps_viz.mapping.steps import pack_step, unpack_step
from simaps_viz.mapping.surface import coded_colors, decoded_colors


def steps_of(seed: int, frames: int = 3):
    accumulator = MapAccumulator(LABELS, IS_THING, ProjectionSettings(), steps=True)
    for part in random_frames(seed, frames):
        accumulator.add_frame(*part)
        assert accumulator.step is not None
        yield accumulator.step


def plain_voxels(frame, segmentation, T_map_camera) -> set[tuple[int, int, int, int]]:
    """Row, column, step and segment of every pixel, one after the other."""
    k, found = frame.intrinsics, set()
    for v, u in np.ndindex(*frame.depth_m.shape):
        z = float(frame.depth_m[v, u])
        if 0.1 < z < 6.0:
            x, y, h = (T_map_camera @ [(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z, 1.0])[:3]
            if -0.3 < h < 2.0:
                step = math.floor(np.float32(h) * 20.0 + 0.01)
                found.add((math.floor(y / 0.05), math.floor(x / 0.05), step, int(segmentation.ids[v, u])))
    return found


def voxels_of_runs(seen) -> list[tuple[int, int, int, int]]:
    rows, cols = seen.readings.rows, seen.readings.cols
    runs = zip(seen.runs.reading, seen.runs.segments, seen.runs.low, seen.runs.high, strict=True)
    return [
        (int(rows[i]), int(cols[i]), step, int(segment))
        for i, segment, low, high in runs for step in range(low, high + 1)
    ]  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
def test_the_runs_of_a_frame_are_its_pixels(seed):
    for part, step in zip(random_frames(seed), steps_of(seed), strict=True):
        found = voxels_of_runs(step.seen)
        assert len(found) == len(set(found)) and set(found) == plain_voxels(*part)
        runs = step.seen.runs
        same = (np.diff(runs.reading) == 0) & (np.diff(runs.segments) == 0)
        assert (runs.low[1:][same] > runs.high[:-1][same] + 1).all(), "a run ends at a gap"
        back = unpack_step(pack_step(step)).seen.runs
        for name in ("reading", "segments", "low", "high"):
            assert np.array_equal(getattr(back, name), getattr(runs, name))
            assert getattr(back, name).dtype == getattr(runs, name).dtype


def test_damaged_runs_are_refused():
    step = next(steps_of(0))
    runs = step.seen.runs
    for name, value in (("reading", 9999), ("segments", -1), ("low", 100)):
        wrong = getattr(runs, name).copy()
        wrong[-1] = value
        packed = pack_step(replace(step, seen=replace(step.seen, runs=replace(runs, **{name: wrong}))))
        with pytest.raises(ValueError):
            unpack_step(packed)
    accumulator = MapAccumulator(LABELS, IS_THING, ProjectionSettings())
    segments = runs.segments.copy()
    segments[0] = 77
    with pytest.raises(ValueError, match="unknown segment"):
        accumulator.replay(replace(step, seen=replace(step.seen, runs=replace(runs, segments=segments))))


@pytest.mark.parametrize("seed", range(3))
def test_a_voxel_has_the_class_that_most_frames_saw(seed):
    accumulator = MapAccumulator(LABELS, IS_THING, ProjectionSettings())
    for step in steps_of(seed, 12):
        accumulator.replay(step)
    facts = SequenceFacts("random", "", LABELS, IS_THING, "drawn", True, np.eye(4))
    config = replace(BuildConfig(), votes=replace(BuildConfig().votes, exact_below=1.0))  # all votes count the same
    simap = map_so_far(accumulator, facts, config)
    votes: dict[tuple[int, int, int], Counter] = defaultdict(Counter)
    for seen in accumulator.frames:
        name_of = {0: 0} | {s.id: LABELS.index(s.label) for s in seen.segments}
        for voxel in {(*one[:3], name_of[one[3]], one[3]) for one in voxels_of_runs(seen)}:
            votes[voxel[:3]][voxel[3]] += 1
    row0, col0 = accumulator.origin_cell
    found = {}
    surface = simap.surface
    assert surface is not None
    points = simap.points()
    at = np.floor(points.positions / 0.05 + 1e-3).astype(int)
    for (col, row, step), kind in zip(at.tolist(), points.classes.tolist(), strict=True):
        found[row, col, step] = max(kind, 0)
    assert len(found) == len(points) == surface.voxels and set(found) == set(votes)
    assert (row0, col0) == (round(simap.spec.y0_m / 0.05), round(simap.spec.x0_m / 0.05))
    shown = Counter()
    for voxel, count in votes.items():
        best = max(count.values())
        row, col = voxel[0] - row0, voxel[1] - col0
        if count[found[voxel]] != best:  # the map may name the top of a cell otherwise
            assert found[voxel] == simap.grid.label[row, col]
            shown["map"] += 1
        shown["all"] += 1
    assert shown["map"] < 0.02 * shown["all"]


def boxes(simap, label: str) -> list[tuple[int, int, int, int, int, int]]:
    """First and last row, column and step of each object of a class, as frames were drawn."""
    points, found = simap.points(), []
    for one in (*simap.instances, *simap.hidden):
        if one.label == label:
            at = np.floor(points.positions[points.instances == one.id] / 0.05 + 1e-3).astype(int)[:, [1, 0, 2]]
            found.append(
                tuple(n for low, high in zip(at.min(0), at.max(0), strict=True) for n in (int(low), int(high)))
            )
    return sorted(found)


@pytest.mark.parametrize("joined", [0, 8])
def test_a_chair_under_a_table_is_an_object_and_half_a_chair_is_none(joined):
    simap = map_of_columns(table_over_chairs(joined=joined))
    assert simap.counts() == {"chair": 1, "table": 1}
    assert [one.label for one in simap.hidden] == ["chair"] and simap.hidden[0].cells == 16
    assert boxes(simap, "chair") == [(2, 5, 2, 5, 8, 9), (2, 5, 9, 20, 8, 17)]
    assert boxes(simap, "table") == [(0, 15, 0, 15, 14, 14)]
    hidden, points = simap.hidden[0], simap.points()
    assert hidden.id > simap.community.max() and simap.by_id(hidden.id) == hidden
    assert np.allclose(hidden.aabb_m, ((0.1, 0.1, 0.4), (0.3, 0.3, 0.5)))
    assert hidden.centroid_m == pytest.approx((0.2, 0.2, 0.45))
    assert hidden.frames == 16 and hidden.score == pytest.approx(0.9)
    # The map from above knows nothing of it.
    assert hidden.id not in simap.instance and hidden not in simap.instances
    there = simap.at(0.2, 0.2)
    assert there is not None and there.label == "table"
    assert (points.classes[points.instances == 0] == 4).all() and (points.classes[points.instances > 0] < 3).all()


@pytest.mark.parametrize(("rows", "found"), [(2, [144]), (5, [10, 144])])
def test_what_is_far_smaller_than_its_class_is_no_object(rows, found):
    """Under a table, a chair of 288 voxels, and 4 or 10 voxels of class chair apart from it."""
    columns = block(range(20), range(20), 1, 14, 14) + block(range(12), range(12), 2, 4, 5)
    columns += block(range(15, 15 + rows), range(16, 18), 3, 4, 4)
    simap = map_of_columns([frame(i, columns, {1: "table", 2: "chair", 3: "chair"}) for i in range(4)])
    assert sorted(one.cells for one in simap.hidden) == found
    points = simap.points()
    chairs = points.instances[points.classes == simap.grid.labels.index("chair")]
    assert len(chairs) == 288 + 2 * rows and (chairs == 0).sum() == 2 * rows * (len(found) == 1)


def test_masks_that_err_make_no_objects_of_one_glance_or_of_the_floor():
    """A book under the table in one frame only, and a sliver of class chair on the floor in thirty."""
    steps = table_over_chairs()
    book = block(range(10, 13), range(10, 13), 5, 6, 7)
    sliver = block(range(-3, -1), range(22, 26), 6, 0, 0)
    columns = [[c for c in block(range(-4, 20), range(-4, 26), 4, 0, 0) if c[:2] not in {d[:2] for d in sliver}]]
    steps.append(frame(24, book + columns[0], {4: "floor", 5: "book"}))
    higher = block(range(-3, -1), range(22, 26), 1, 14, 14)
    steps += [frame(25 + i, sliver + higher, {1: "table", 6: "chair"}) for i in range(30)]
    exact, errs = (
        map_of_columns(steps, replace(BuildConfig(), votes=replace(BuildConfig().votes, exact_below=share)))
        for share in (1.0, 0.0)
    )
    assert Counter(one.label for one in exact.hidden) == {"chair": 2, "book": 1}
    assert [(one.label, one.cells) for one in errs.hidden] == [("chair", 16)]
    points = errs.points()
    on_floor = points.positions[:, 2] < 0.05
    assert not (points.classes[on_floor] == 1).any() and (points.classes[~on_floor] == 3).any()


def test_numbering_segments_otherwise_changes_nothing():
    one, other = (map_of_columns(steps) for steps in (table_over_chairs(), turned(table_over_chairs())))
    assert one.surface is not None
    assert other.surface is not None
    assert np.array_equal(one.surface.owner, other.surface.owner) and one.hidden == other.hidden


def test_what_lies_below_keeps_two_objects_of_the_map_apart():
    # Under a table, a rod of class chair ties two chairs together that stick out: three frames of four see it as part
    # of the one, three of four as part of the other, and half of them see all of it as one.
    table = block(range(6), range(8, 18), 1, 14, 14)
    steps = [frame(0, table, {1: "table"})]
    for index in range(1, 21):
        rod, right = ((2, 3), (3, 3), (2, 2), (2, 2))[index % 4]
        columns = block(range(6), range(8), 2, 8, 17) + block(range(6), range(18, 26), right, 8, 17)
        columns += block(range(6), range(8, 18), rod, 8, 8)
        steps.append(frame(index, columns, dict.fromkeys({2, rod, right}, "chair")))
    simap = map_of_columns(steps)
    assert simap.counts() == {"chair": 2, "table": 1} and not simap.hidden
    points = simap.points()
    below = points.instances[points.positions[:, 2] < 0.45]
    assert set(below.tolist()) == {one.id for one in simap.of_class("chair")}


def test_what_lies_below_belongs_to_the_object_of_the_map_that_most_evidence_ties_it_to():
    """A table under books. Four cells that broke off are seen with it without an error, its edge with two."""
    edge, books = block(range(10), range(4), 1, 30, 30), block(range(10), range(4, 10), 2, 34, 34)
    below, broken_off = block(range(10), range(4, 10), 1, 10, 28), block(range(2), range(14, 16), 1, 26, 26)
    apart = [(row, col, 3, low, high) for row, col, _, low, high in below]
    labels = {1: "table", 2: "book", 3: "table"}
    steps = [
        frame(k, broken_off + below if k % 2 else edge + books + (apart if k in (4, 8) else below), labels)
        for k in range(40)
    ]
    simap = map_of_columns(steps)
    assert boxes(simap, "book") == [(0, 9, 4, 9, 34, 34)] and not simap.hidden
    assert boxes(simap, "table") == [(0, 1, 14, 15, 26, 26), (0, 9, 0, 9, 10, 30)]


@pytest.mark.parametrize("upper", [12, 10])
def test_two_books_of_a_shelf_are_two(upper):
    # Boards at steps 4 and 12 (or so close that a single step is between the books), a book on each, one above the
    # other, seen from the front; a table's top over all.
    steps = []
    for index in range(8):
        columns = block(range(6), range(6), 1, 20, 20)
        columns += block(range(2, 5), range(1, 5), 2, 4, 8) + block(range(2, 5), range(1, 5), 3, upper, upper + 4)
        steps.append(frame(index, columns, {1: "table", 2: "book", 3: "book"}))
    simap = map_of_columns(steps)
    assert [one.label for one in simap.hidden] == ["book", "book"]
    assert boxes(simap, "book") == [(2, 4, 1, 4, 4, 8), (2, 4, 1, 4, upper, upper + 4)]


def boards(columns) -> list[Column]:
    """Return columns of a frame with a table's top above them."""
    return block(range(8), range(12), 1, 20, 20) + columns


def test_two_books_that_touch_and_are_seen_apart_stay_two():
    """A shelf between two aisles: no frame shows both books, and in two a mask slips over the edge by a voxel."""
    lower, upper = block(range(2, 6), range(2, 8), 2, 4, 8), block(range(2, 6), range(2, 8), 3, 10, 14)
    labels = {1: "table", 2: "book", 3: "book"}
    steps = [frame(k, boards(lower if k % 2 else upper), labels) for k in range(16)]
    steps += [frame(16 + k, boards([*upper, (3, 4 + k, 3, 8, 8)]), labels) for k in range(2)]
    assert boxes(map_of_columns(steps), "book") == [(2, 5, 2, 7, 4, 8), (2, 5, 2, 7, 10, 14)]


@pytest.mark.parametrize("shared", [0, 1])
def test_a_book_on_a_book_is_two(shared):
    """Seen from two sides, so that each cell holds both; they meet in one step, or in two that follow each other."""
    sides = [(row, col) for row in range(2, 8) for col in range(2, 8) if row in (2, 7) or col in (2, 7)]
    steps = []
    for index in range(8):
        books = [(row, col, 2, 4, 8) for row, col in sides] + [(row, col, 3, 9 - shared, 13) for row, col in sides]
        steps.append(frame(index, books + block(range(3, 7), range(3, 7), 3, 13, 13), {2: "book", 3: "book"}))
    simap = map_of_columns(steps)
    assert simap.counts() == {"book": 1} and [one.label for one in simap.hidden] == ["book"]
    assert boxes(simap, "book") == [(2, 7, 2, 7, 4, 8), (2, 7, 2, 7, 9, 13)]


def test_a_book_in_two_pieces_at_another_height_in_every_frame_is_one():
    """As where two things stand side by side in a cell, or a mask is cut at random: they do not meet at one height."""
    steps = []
    for index in range(24):
        cut = 5 + index % 8
        pieces = boards(block(range(2, 6), range(2, 8), 2, 4, cut) + block(range(2, 6), range(2, 8), 3, cut + 1, 14))
        steps.append(frame(index, pieces, {1: "table", 2: "book", 3: "book"}))
    assert boxes(map_of_columns(steps), "book") == [(2, 5, 2, 7, 4, 14)]


def test_what_never_has_a_segment_of_its_own_is_no_object():
    """Under a table, a book's cover that masks give to one of two chairs by turns, each as often as the other."""
    table, cover = block(range(8), range(8, 16), 1, 20, 20), block(range(2, 6), range(10, 14), 2, 4, 8)
    labels = {1: "table", 2: "chair", 3: "chair"}
    steps, alone = [frame(0, table, labels)], [frame(0, table, labels)]
    for index in range(1, 25):
        chairs = block(range(8), range(7), 2, 8, 17) + block(range(8), range(17, 24), 3, 8, 17)
        mine = 2 + index % 2
        steps.append(frame(index, chairs + [(r, c, mine, low, high) for r, c, _, low, high in cover], labels))
        alone.append(
            frame(index, chairs + [(r, c, 4, low, high) for r, c, _, low, high in cover], {**labels, 4: "chair"})
        )
    assert [one.label for one in map_of_columns(alone).hidden] == ["chair"]
    simap = map_of_columns(steps)
    assert not simap.hidden and simap.counts() == {"chair": 2, "table": 1}


@given(
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2), st.integers(0, 3), st.integers(-4, 8), st.integers(0, 5)))
)
def test_where_segments_meet_and_one_reaches_across_is_the_twins(runs):
    """Cell, class (0 is no thing), segment, first step and length of each run; -3 is the lowest step that is kept."""
    runs = sorted((cell, kind, 4 * kind + segment, low, low + more) for cell, kind, segment, low, more in runs)
    cell, label, segment, low, high = (np.array(part) for part in (zip(*runs, strict=True) if runs else [[]] * 5))
    cell, label, segment = cell.astype(np.int32), label.astype(np.int16), segment.astype(np.int32)
    low, high = low.astype(np.int8), high.astype(np.int8)
    expected = Counter()
    for c, kind, one, bottom, top in runs:
        above = [
            first for d, other, two, first, last in runs
            if kind and (d, other) == (c, kind) and two != one and first > bottom and first >= top and last > top
        ]  # fmt: skip
        expected.update((c, kind, step) for step in range(max(top, -3), min(above, default=-9) + 1))
    found = _meetings(cell, label, segment, low, high, -3, np.array([False, True, True]))
    place, met = _counted(np.zeros(0, np.int64), np.zeros(0, np.int64), [found])
    names = [(int(n) >> 21, int(n) >> 6 & 32767, (int(n) & 63) - 3) for n in place]
    assert dict(zip(names, met.tolist(), strict=True)) == expected
    across = np.zeros(len(place), np.int32)
    _count_across(cell, label, low, high, -3, np.ones(3, np.bool_), place, across)
    assert across.tolist() == [
        sum((c, kind) == (d, other) and bottom < step < top for d, other, _, bottom, top in runs)
        for c, kind, step in names
    ]


def test_what_is_kept_of_many_frames_takes_no_more_memory_than_it_shows():
    """A building has 200,000 frames: 3,000 runs each, of which a view would keep the memory."""

    def resident_mb() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6

    cell, ones = np.arange(1_000_000, dtype=np.int32), np.ones(1_000_000, np.int8)
    label, segment = ones.astype(np.int16), ones.astype(np.int32)
    before, thing = resident_mb(), np.ones(2, np.bool_)
    kept = [_meetings(cell, label, segment, ones, ones, -3, thing) for _ in range(40)]
    assert resident_mb() - before < 100  # 320 with their frames
    assert [len(one) for one in kept] == [0] * 40


def test_a_remnant_belongs_to_what_it_touches():
    """Four cells of a book's top that no frame shows with the rest of it."""
    book, remnant = block(range(2, 6), range(2, 8), 2, 4, 8), block(range(2, 4), range(2, 4), 3, 10, 11)
    labels = {1: "table", 2: "book", 3: "book"}
    simap = map_of_columns([frame(k, boards(book if k % 2 else remnant), labels) for k in range(16)])
    assert boxes(simap, "book") == [(2, 5, 2, 7, 4, 11)]


def test_a_thing_of_which_no_frame_shows_all_stays_one():
    """Something that stands before it hides a third of a book row, now the left, now the right."""
    steps = [
        frame(k, boards(block(range(2, 6), range(first, first + 8), 2, 4, 8)), {1: "table", 2: "book"})
        for k, first in enumerate([0, 2, 4] * 4)
    ]
    assert boxes(map_of_columns(steps), "book") == [(2, 5, 0, 11, 4, 8)]


@pytest.mark.parametrize(("across", "rows"), [(0.5, 2), (10.0, 1)])
def test_two_rows_that_touch_are_joined_by_much_evidence_not_by_many_bits(across, rows):
    """Two rows of six parts each; all that is said says *same*, much within a row."""
    pairs = {(i, i + 1): 20.0 for i in range(11) if i != 5} | {(i, i + 6): across for i in range(6)}
    ends = np.array(sorted(pairs), np.int32)
    evidence = np.array([[pairs[a, b], 0.0] for a, b in ends.tolist()])
    settings = SpaceSettings(0.3, np.ones(2), 1.0, 0, PoolSettings(), 0.6, 4, exact=False)
    found = _join(12, 0, (ends, evidence), np.ones(len(ends), np.bool_), np.full(12, 40), settings)
    assert len(set(found.tolist())) == rows and len(set(found[:6].tolist())) == len(set(found[6:].tolist())) == 1


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 3)), min_size=1, max_size=30), st.integers(0, 7))
def test_what_a_frame_says_of_two_parts_is_the_twins(seen, tops):
    """Parts 0, 1, 2 ... are of two classes by turns, and have 40 nodes each; the first ``tops`` are of the map."""
    part, segment = (np.array(column, np.int32) for column in zip(*seen, strict=True))
    nodes_of = np.full(7, 40)
    place = np.full(7, -1, np.int32)
    parts, segments, nodes, ends, evidence = _pairs(part, segment, (part % 2).astype(np.int16), nodes_of, tops, place)
    expected = []
    for a, b in combinations(sorted(set(part.tolist())), 2):
        if a % 2 != b % 2 or b < tops:
            continue
        mine, other = segment[part == a], segment[part == b]
        agree = np.mean(mine[:, None] == other)
        weight = min(len(mine), len(other)) * (min(len(mine), len(other)) / 40 if a >= tops else 1.0)
        expected.append([a, b, agree * weight, (1 - agree) * weight])
    seen_in = {(a, s): n for a, s, n in zip(parts.tolist(), segments.tolist(), nodes.tolist(), strict=True)}
    assert len(seen_in) == len(parts) and seen_in == Counter(zip(part.tolist(), segment.tolist(), strict=True))
    assert np.hstack([ends, evidence]) == pytest.approx(np.array(expected).reshape(-1, 4))
    assert (place == -1).all()


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4), st.floats(0, 1), st.floats(0, 1)), max_size=40))
def test_evidence_is_summed_up_in_the_order_of_frames(rows):
    expected: dict[tuple[int, int], list[float]] = {}
    for a, b, same, different in rows:
        sums = expected.setdefault((a, b), [0.0, 0.0])
        sums[0], sums[1] = sums[0] + same, sums[1] + different
    ends = np.array([row[:2] for row in rows], np.int32).reshape(-1, 2)
    found, sums = _summed(ends, np.array([row[2:] for row in rows]).reshape(-1, 2), 5)
    assert list(map(tuple, found.tolist())) == sorted(expected)
    assert sums.tolist() == [expected[one] for one in sorted(expected)]


def test_a_map_keeps_its_surface_in_its_file(tmp_path):
    simap = map_of_columns(table_over_chairs())
    assert simap.surface is not None
    color = np.random.default_rng(0).integers(0, 256, (simap.surface.voxels, 3)).astype(np.uint8)
    simap = replace(simap, surface=replace(simap.surface, color=coded_colors(color)))
    save_map(simap, tmp_path / "a.npz")
    back = load_map(tmp_path / "a.npz")
    assert back.hidden == simap.hidden
    for name in ("positions", "colors", "classes", "instances"):
        ours, theirs = getattr(back.points(), name), getattr(simap.points(), name)
        assert ours.dtype == theirs.dtype and np.array_equal(ours, theirs), name
    assert back.points() is back.points()
    # Without the added members, as an earlier version writes it, it is the same map with its columns.
    with zipfile.ZipFile(tmp_path / "a.npz") as archive, zipfile.ZipFile(tmp_path / "old.npz", "w") as old:
        for name in archive.namelist():
            if not name.startswith(("surface", "hidden")):
                old.writestr(name, archive.read(name))
    older = load_map(tmp_path / "old.npz")
    assert older.surface is None and older.hidden == () and older.instances == simap.instances
    points = older.points()
    assert (points.instances > 0).sum() > (older.instance > 0).sum() and not set(points.instances) & {back.hidden[0].id}
    cells = {(round(y / 0.05 - 0.5), round(x / 0.05 - 0.5)) for x, y, _ in points.positions.tolist()}
    assert len(cells) == np.count_nonzero(older.grid.observations)


@pytest.mark.parametrize(
    ("member", "value"),
    [
        ("surface_cell", np.array([-1], np.int32)), ("surface_owner", np.array([-99], np.int32)),
        ("surface_color", np.zeros((3, 7), np.int8)), ("surface_low", np.array([9], np.int16)),
        ("surface_more", np.array([-1], np.int8)),
        ("hidden", np.array(json.dumps([{"id": 1}]))), ("hidden", np.array("{}")), ("hidden", None),
    ],
)  # fmt: skip
def test_a_damaged_surface_is_refused(tmp_path, member, value):
    simap = map_of_columns(table_over_chairs())
    save_map(simap, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as archive:
        arrays = dict(archive)
    if value is None:
        del arrays[member]
    elif value.dtype.kind == "i" and value.ndim == 1:
        arrays[member] = np.concatenate([value, arrays[member][1:]])
    else:
        arrays[member] = value
    np.savez_compressed(tmp_path / "b.npz", **arrays)
    with pytest.raises(InputError, match=r"b\.npz"):
        load_map(tmp_path / "b.npz")


def test_the_surface_follows_edits():
    simap = map_of_columns(table_over_chairs())
    chair, table = (simap.of_class(label)[0] for label in ("chair", "table"))
    after = apply(simap, relabel(simap, chair.id, "stool"))
    assert boxes(after, "stool") == [(2, 5, 9, 20, 8, 17)] and after.hidden == simap.hidden
    gone = apply(simap, delete(simap, table.id))
    points = gone.points()
    assert table.id not in points.instances and len(points) == len(simap.points())
    assert boxes(gone, "chair") == boxes(simap, "chair")
    assert not {one.id for one in after.instances} & {one.id for one in after.hidden}
    with pytest.raises(InputError, match="under or in"):
        delete(simap, simap.hidden[0].id)


def test_the_surface_follows_other_thresholds_and_communities():
    simap = map_of_columns(table_over_chairs())
    for other in (repartition(simap, affinity=0.9), recommunity(simap, resolution=20.0)):
        assert len(other.points()) == len(simap.points()) and len(other.hidden) == 1
        assert not {one.id for one in other.instances} & {one.id for one in other.hidden}
        assert boxes(other, "chair")[0] == (2, 5, 2, 5, 8, 9)
        below = other.points().instances[other.points().classes == 1]
        assert (below > 0).all()


def test_grey_stays_grey_and_colours_are_right_to_a_few_steps():
    rgb = np.random.default_rng(1).integers(0, 256, (4000, 3)).astype(np.uint8)
    assert np.abs(decoded_colors(coded_colors(rgb)).astype(int) - rgb).max() <= 24
    grey = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    found = decoded_colors(coded_colors(grey)).astype(int)
    assert (found == found[:, :1]).all() and np.abs(found - grey).max() <= 6
