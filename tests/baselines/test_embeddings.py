"""Mean embeddings: the kernel against VLMaps' loop, one point after another; and what it all weighs."""

import numpy as np
import pytest
from benchmarks.point_loop import vlmaps_point_loop
from hypothesis import given, settings
from hypothesis import strategies as st
from random_frames import LABELS, random_frames

from simaps_viz.baselines.vlmaps import (
    CellPoints,
    EmbeddingStore,
    LSegNoise,
    PixelEmbeddings,
    SimulatedLSeg,
    cell_points,
    dense_bytes,
)
from simaps_viz.errors import InputError
from simaps_viz.mapping.accumulator import ProjectionSettings

SETTINGS = ProjectionSettings()


def points_of(cells: list[tuple[int, int]], embedding: list[int]) -> CellPoints:
    at = np.array(cells, np.int32).reshape(-1, 2)
    return CellPoints(at[:, 0], at[:, 1], np.array(embedding, np.int32), np.ones(len(at)))


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 4), st.sampled_from(["uniform", "distance"]))
def test_the_store_agrees_with_the_loop(seed, stride, weighting):
    encoder = SimulatedLSeg(LABELS, seed=2, dimension=48, noise=LSegNoise(output_stride_px=3, confusion=0.5))
    frames = [(frame, encoder.pixels(frame, segmentation), T) for frame, segmentation, T in random_frames(seed)]
    holes = np.random.default_rng(seed).random(frames[0][1].index.shape) < 0.1
    frames[0] = (frames[0][0], PixelEmbeddings(frames[0][1].table, np.where(holes, np.int32(-1), frames[0][1].index)),
                 frames[0][2])  # fmt: skip
    store, points = EmbeddingStore(48), 0
    for frame, embeddings, T in frames:
        found = cell_points(frame, embeddings, T, SETTINGS, stride=stride, weighting=weighting)
        store.add(found, embeddings.table)
        points += len(found.rows)
    plain = vlmaps_point_loop(frames, SETTINGS, stride=stride, weighting=weighting)
    assert points == plain.points > 0
    assert {tuple(cell) for cell in store.cells.tolist()} == set(plain.means)
    assert len(store.cells) == len(plain.means)
    for (row, col), mean, total in zip(store.cells.tolist(), store.means, store.totals, strict=True):
        np.testing.assert_allclose(mean, plain.means[row, col], atol=1e-5)
        assert total == pytest.approx(plain.totals[row, col], rel=1e-6)


def test_means_by_hand_while_the_window_grows_in_all_directions():
    table = np.array([[1, 0], [0, 1], [3, 3]], np.float32)
    store = EmbeddingStore(2)
    store.add(points_of([(0, 0), (0, 0), (0, 1)], [0, 1, 2]), table)
    store.add(points_of([(-5, 7), (9, -4), (0, 0), (0, 0)], [0, 2, 0, 0]), table)
    store.add(points_of([], []), table)
    rounded = np.round(store.means, 6).tolist()
    means = {tuple(cell): mean for cell, mean in zip(store.cells.tolist(), rounded, strict=True)}
    assert means == {(0, 0): [0.75, 0.25], (0, 1): [3, 3], (-5, 7): [1, 0], (9, -4): [3, 3]}
    assert store.totals.tolist() == [4, 1, 1, 1]
    cosine = store.nearest(np.array([[1, 0], [0, 1]], np.float32))
    assert cosine.argmax(axis=1)[0] == 0 and cosine[1] == pytest.approx([np.sqrt(0.5)] * 2)


def test_far_points_count_less_by_distance():
    frame, segmentation, T = random_frames(1)[0]
    encoder = SimulatedLSeg(LABELS, dimension=8)
    embeddings = encoder.pixels(frame, segmentation)
    points = cell_points(frame, embeddings, T, SETTINGS, stride=1, weighting="distance")
    assert len(np.unique(points.weights)) > 100
    # The nearest depth is above 0.9 m, and a ray is never shorter than its depth.
    assert 0 < points.weights.min() < points.weights.max() < np.exp(-(0.9**2) / 1.2)


def test_what_it_weighs():
    assert dense_bytes(1000, 1000) == 2_048_000_000
    assert dense_bytes(10, 20, 4) == 10 * 20 * 4 * 4
    store = EmbeddingStore(512)
    store.add(points_of([(i, 5000) for i in range(3000)], [0] * 3000), np.ones((1, 512), np.float32))
    vectors = 3000 * 512 * 4
    assert vectors <= store.held_bytes < 1.01 * vectors
    assert store.means.nbytes == vectors


def test_sizes_that_do_not_fit_are_named():
    frame, _, T = random_frames(1)[0]
    small = PixelEmbeddings(np.zeros((1, 8), np.float32), np.zeros((2, 2), np.int32))
    with pytest.raises(InputError, match=r"frame 0: expected embeddings of \[30, 40\] pixels, found \[2, 2\]"):
        cell_points(frame, small, T, SETTINGS, stride=1, weighting="uniform")
    with pytest.raises(InputError, match="8 numbers, found vectors of 4"):
        EmbeddingStore(8).add(points_of([(0, 0)], [0]), np.zeros((1, 4), np.float32))
