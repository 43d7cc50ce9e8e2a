"""Sparse tiles are the dense window bit for bit, and memory follows what was seen."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from dense_twin import DenseTwin
from hypothesis import given, settings
from hypothesis import strategies as st
from random_frames import IS_THING, LABELS, random_frames
from sequences import write_tiny_sequence
from stopped_builds import Stop, same, saved

from simaps_viz import open_sequence
from simaps_viz.build.pipeline import BuildConfig, build_map, facts_of, gather_frames
from simaps_viz.errors import InputError
from simaps_viz.mapping import observations, steps
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.evidence import EvidenceSettings, pair_graphs
from simaps_viz.mapping.finalize import map_so_far
from simaps_viz.mapping.observations import StreamedReadings
from simaps_viz.mapping.simap import count_views
from simaps_viz.mapping.steps import pack_step, unpack_step
from simaps_viz.mapping.tiles import AREA, CELL_BYTES, SIDE, TileStore
from simaps_viz.mapping.votes import VoteSettings, vote_labels
from simaps_viz.structures import Segmentation

METHODS = ("evidence", "paper", "components")
FRAMES = 6


def accumulator(**options):
    return MapAccumulator(LABELS, IS_THING, ProjectionSettings(), **options)


def moved(parts, offsets):
    """The same frames, taken elsewhere."""
    for (frame, segmentation, T_map_camera), offset in zip(parts, offsets, strict=True):
        T = T_map_camera.copy()
        T[:2, 3] += offset
        yield frame, segmentation, T


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("tiny"), frames=FRAMES))


@pytest.fixture
def nothing_held(monkeypatch):
    """Every frame goes to disk at once, and comes back a few hundred readings at a time."""
    monkeypatch.setattr(steps, "HELD_BYTES", 0)
    monkeypatch.setattr(observations, "BATCH", 300)


metres = st.floats(-14.0, 14.0).map(lambda x: round(x / 3.2) * 3.2 if abs(x) < 7 else x)  # often on tiles' edges


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 9), offsets=st.lists(st.tuples(metres, metres), min_size=4, max_size=4))
def test_tiles_are_the_dense_window_bit_for_bit(seed, offsets):
    sparse, dense = accumulator(), DenseTwin(LABELS, ProjectionSettings(), -460, 460)
    for part in moved(random_frames(seed, frames=4), offsets):
        sparse.add_frame(*part)
        dense.add_frame(*part)
    grid, (layers, origin) = sparse.snapshot(), dense.cut()
    assert sparse.origin_cell == origin
    for ours, theirs in zip((grid.label, grid.height_m, grid.lowest_m, grid.observations), layers, strict=True):
        assert ours.dtype == theirs.dtype and ours.tobytes() == theirs.tobytes()
    for ours, theirs in zip(sparse.readings, dense.seen, strict=True):
        columns = (ours.rows.tolist(), ours.cols.tolist(), ours.segments.tolist(), ours.height_m.tolist())
        assert list(zip(*columns, strict=True)) == theirs


def test_a_cell_of_negative_and_positive_tiles_is_found_again():
    store, rng = TileStore(), np.random.default_rng(0)
    cells = rng.choice(400 * 400, 5000, replace=False)
    rows, cols = (cells // 400 - 200).astype(np.int32), (cells % 400 - 200).astype(np.int32)
    at = store.locate(rows, cols)
    assert len(set(at.tolist())) == 5000 and (store.find(rows, cols) == at).all()
    store.observations[at] = cells + 1
    there = store.cut("observations", -200, -200, (400, 400), 0)
    assert there.reshape(-1)[cells].tolist() == (cells + 1).tolist() and np.count_nonzero(there) == 5000
    assert len(store) == len({(r // SIDE, c // SIDE) for r, c in zip(rows.tolist(), cols.tolist(), strict=True)})
    missing = store.find(np.array([5000, -200], np.int32), np.array([5000, int(cols[rows == -200][0])], np.int32))
    assert missing[0] == -1 and missing[1] >= 0
    part = store.cut("observations", -70, 3, (100, 50), -7)
    assert np.array_equal(np.where(part == -7, 0, part), there[130:230, 203:253])


def test_memory_follows_what_was_seen_not_how_far_apart_it_lies():
    parts = random_frames(2, frames=2)
    near, far = accumulator(), accumulator()
    for frames, offsets in ((near, [(0, 0), (16.0, 0)]), (far, [(0, 0), (-160.0, 128.0)])):
        for part in moved(parts, offsets):
            frames.add_frame(*part)
    rows, cols = far.snapshot().spec.shape
    assert rows * cols > 8_000_000 and len(far.tiles) <= len(near.tiles) + 6  # as they fall on tiles' edges
    assert far.tiles.nbytes == len(far.tiles) * AREA * CELL_BYTES < 2_000_000
    seen = sum(len(one.rows) for one in far.readings)
    assert seen == sum(len(one.rows) for one in near.readings)


def test_a_map_that_would_be_too_large_is_refused_and_stays_as_it_was():
    parts = random_frames(3, frames=2)
    whole, alone = accumulator(links=False), accumulator(links=False)
    near, far = moved(parts, [(0, 0), (3000.0, 3000.0)])
    whole.add_frame(*near)
    alone.add_frame(*near)
    tiles = len(whole.tiles)
    with pytest.raises(InputError, match="map: expected a map of at most"):
        whole.add_frame(*far)
    assert len(whole.tiles) == tiles
    same(whole, alone)
    other = accumulator(links=False)
    other.add_frame(*far)
    with pytest.raises(InputError, match="map: expected a map of at most"):
        whole.merge(other)
    same(whole, alone)


def test_frames_nobody_looked_at_raise_cells_of_their_own_in_any_order():
    parts = [
        (frame, replace(masks, segmented=frame.index % 3 == 0), T_map_camera)
        for frame, masks, T_map_camera in random_frames(5, frames=6)
    ]
    whole, halves = accumulator(steps=True), (accumulator(), accumulator())
    replayed = accumulator()
    for number, part in enumerate(parts):
        whole.add_frame(*part)
        halves[number % 2].add_frame(*part)
        assert whole.step is not None
        replayed.replay(unpack_step(pack_step(whole.step)))
    halves[1].merge(halves[0])
    unsegmented = whole.unsegmented_cells()
    assert unsegmented is not None and 0 < unsegmented.sum() < unsegmented.size
    grid = whole.snapshot()
    for other in (halves[1], replayed, whole.copy(), pickle.loads(pickle.dumps(whole))):
        for layer in ("label", "height_m", "lowest_m", "observations"):
            np.testing.assert_array_equal(getattr(other.snapshot(), layer), getattr(grid, layer))
        np.testing.assert_array_equal(other.unsegmented_cells(), unsegmented)
        assert [len(one.rows) > 0 for one in other.readings] == [frame.index % 3 == 0 for frame, _, _ in parts]
    # As high as all frames together saw, wherever somebody looked and the others saw nothing much higher.
    everything, looked = accumulator(), accumulator()
    for frame, masks, T_map_camera in parts:
        everything.add_frame(frame, replace(masks, segmented=True), T_map_camera)
        if masks.segmented:
            looked.add_frame(frame, masks, T_map_camera)
    np.testing.assert_array_equal(np.isnan(grid.height_m), np.isnan(everything.snapshot().height_m))
    np.testing.assert_array_equal(grid.height_m[unsegmented], everything.snapshot().height_m[unsegmented])
    np.testing.assert_array_equal(grid.lowest_m, everything.snapshot().lowest_m)
    assert not grid.label[unsegmented].any()
    row, col = np.subtract(looked.origin_cell, whole.origin_cell)
    part = looked.snapshot()
    here = np.s_[row : row + part.spec.rows, col : col + part.spec.cols]
    np.testing.assert_array_equal(grid.label[here][~unsegmented[here]], part.label[~unsegmented[here]])


@pytest.mark.parametrize("method", METHODS)
def test_a_build_whose_frames_lie_on_disk_is_the_build_in_memory(tiny, method, tmp_path, monkeypatch):
    config = BuildConfig(method=method)
    wanted = saved(build_map(tiny, config), tmp_path)
    monkeypatch.setattr(observations, "BATCH", 300)
    for held in (0, 40_000):
        monkeypatch.setattr(steps, "HELD_BYTES", held)
        assert saved(build_map(tiny, config), tmp_path) == wanted
        assert saved(build_map(tiny, config, log=tmp_path / "log"), tmp_path) == wanted
        assert saved(build_map(tiny, config, log=tmp_path / "log", resume=True), tmp_path) == wanted
    odd, even = (gather_frames(tiny, config, range(first, FRAMES, 2)) for first in (1, 0))
    apart = pickle.loads(pickle.dumps(odd))
    apart.merge(even)
    assert saved(map_so_far(apart.copy(), facts_of(tiny), config), tmp_path) == wanted


@pytest.mark.parametrize("held", [0, 20_000, 1 << 30])
def test_dropped_frames_are_gone_and_their_place_on_disk_is_given_back(held, monkeypatch):
    monkeypatch.setattr(steps, "HELD_BYTES", held)
    whole, parts = accumulator(), list(random_frames(5, frames=12))
    for part in parts:
        whole.add_frame(*part)
    before, copied = [pack_step(steps._alone(one)) for one in whole.frames], whole.frames.copy()
    for index in (0, 11, 4, 5, 6, 7):
        whole.frames.drop(index)
    left = [1, 2, 3, 8, 9, 10]
    assert list(whole.frames.indices) == left == [one.index for one in whole.frames]
    assert whole.frames.names == [parts[i][0].name for i in left] and len(whole.frames.poses) == 6
    assert [pack_step(steps._alone(one)) for one in whole.frames] == [before[i] for i in left]
    assert [pack_step(steps._alone(one)) for one in copied] == before  # copies keep theirs
    if not held:
        assert whole.frames._files[whole.frames._scratch].size < copied._files[0].size


@pytest.mark.parametrize("seed", range(3))
def test_votes_pairs_and_views_do_not_depend_on_the_batches(seed, monkeypatch):
    whole = accumulator()
    for part in random_frames(seed, frames=8):
        whole.add_frame(*part)
    grid = whole.snapshot()
    at_once = whole.readings_on(grid)
    label, disagreement = vote_labels(grid, at_once, VoteSettings())
    assert disagreement > 0.1 and not np.array_equal(label, grid.label)  # the votes are asked
    named = replace(grid, label=label)
    community = np.where(np.array(IS_THING)[label], label, 0).astype(np.int32)
    for batch in (1, 500, 10_000):
        monkeypatch.setattr(observations, "BATCH", batch)
        streamed = StreamedReadings(whole.frames, whole.origin_cell, grid.labels, grid.spec.cols)
        assert len(list(streamed.batches())) == {1: 8, 10_000: 1}.get(batch, len(list(streamed.batches())))
        found, share = vote_labels(grid, streamed, VoteSettings())
        assert found.tobytes() == label.tobytes() and share == disagreement
        for a, b in zip(
            pair_graphs(named, at_once, EvidenceSettings()),
            pair_graphs(named, streamed, EvidenceSettings()), strict=True,
        ):  # fmt: skip
            for name in ("cells", "edges", "counts", "weights", "different"):
                assert getattr(a, name).tobytes() == getattr(b, name).tobytes()
        a, b = (count_views(named, community, seen) for seen in (at_once, streamed))
        for name in ("community", "frame", "segment", "cells", "score"):
            assert getattr(a, name).tobytes() == getattr(b, name).tobytes()


@pytest.mark.usefixtures("nothing_held")
def test_frames_on_disk_come_back_exactly_in_any_order(monkeypatch):
    one, two = accumulator(), accumulator()
    parts = random_frames(4, frames=6)
    for i in (0, 3, 4):
        one.add_frame(*parts[i])
    for i in (1, 2):
        two.add_frame(*parts[i])
    two.skip_frame(5, "5", np.eye(4), "torn")
    one.merge(two)
    assert not one.frames.all_held and one.frames.skipped == {5: "torn"}
    monkeypatch.setattr(steps, "HELD_BYTES", 1 << 30)
    whole = accumulator()
    for part in parts[:5]:
        whole.add_frame(*part)
    whole.skip_frame(5, "5", np.eye(4), "torn")
    assert whole.frames.all_held
    same(one, whole)
    same(pickle.loads(pickle.dumps(one)), whole)
    assert [frame.index for frame in one.frames[::2]] == [0, 2, 4] and one.frames[-1].name == "5"
    assert one.frames.poses.tobytes() == whole.frames.poses.tobytes() and one.frames.names == whole.frames.names


@pytest.mark.usefixtures("nothing_held")
def test_a_log_that_was_changed_behind_our_back_is_named(tiny, tmp_path):
    told = Stop()
    wanted = saved(build_map(tiny, log=tmp_path / "log", observers=[told]), tmp_path)
    assert saved(told.maps[-1](), tmp_path) == wanted
    (tmp_path / "log").write_bytes(b"other")
    with pytest.raises(InputError, match="could not be read back, its log was changed"):
        told.maps[-1]()


def test_ten_times_the_frames_of_one_place_take_a_few_bytes_each(monkeypatch):
    held = 200_000
    monkeypatch.setattr(steps, "HELD_BYTES", held)
    parts = random_frames(5, frames=6)
    state, sizes = accumulator(), {}
    for index in range(600):
        frame, segmentation, T = parts[index % 6]
        state.add_frame(replace(frame, index=index, name=f"{index:06d}"), segmentation, T)
        if index + 1 in (60, 600):
            sizes[index + 1] = (len(state.tiles), state.links.size, state.links.nbytes, state.nbytes)
            assert state.frames.held_bytes <= held
    assert sizes[60][:3] == sizes[600][:3]
    assert 0 < sizes[600][3] - sizes[60][3] < 540 * 300
    assert sum(state.frames[i].readings.rows.nbytes * 4 for i in (0, 300, 599)) > 3 * 4000  # on disk they are whole
    assert state.snapshot().observations.max() >= 100


def test_views_keep_segment_ids_of_24_bits():
    parts = random_frames(6, frames=3)
    parts = [
        (frame, Segmentation(np.where(masks.ids > 0, masks.ids * 70_001, 0).astype(np.int32),
                             tuple(replace(s, id=s.id * 70_001) for s in masks.segments)), T)
        for frame, masks, T in parts
    ]  # fmt: skip
    state = accumulator()
    for part in parts:
        state.add_frame(*part)
    grid = state.snapshot()
    seen = state.readings_on(grid)
    views = count_views(grid, grid.label.astype(np.int32), seen)
    known = [{s.id: s.score for s in masks.segments} for _, masks, _ in parts]
    rows = zip(views.frame.tolist(), views.segment.tolist(), views.score.tolist(), strict=True)
    assert all(np.float32(known[frame][segment]) == np.float32(score) for frame, segment, score in rows)
    assert len(views.frame) > 5
