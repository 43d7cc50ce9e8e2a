"""The simulated encoder: known vectors, known errors, blind to instances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_frames import LABELS, random_frames

from simaps_viz.baselines.vlmaps import EXACT, OTHER, LSegNoise, PixelEmbeddings, SimulatedLSeg
from simaps_viz.errors import InputError
from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation

WORDS = ("chair", "couch", "dining table", "desk", "floor", "wall", "piano", "tv")


def halves(width: int = 96, height: int = 48) -> tuple[Frame, Segmentation]:
    """Left half chair, right half floor."""
    frame = Frame(0, "0", np.ones((height, width), np.float32), np.eye(4), Intrinsics(width, height, 50, 50, 0, 0))
    ids = np.ones((height, width), np.int32)
    ids[:, width // 2 :] = 2
    return frame, Segmentation(ids, (Segment(1, "chair"), Segment(2, "floor", is_thing=False)))


def nearest(encoder: SimulatedLSeg, embeddings: PixelEmbeddings) -> np.ndarray:
    texts = encoder.text((OTHER, *encoder.labels[1:]))
    return (embeddings.table @ texts.T).argmax(axis=1)[embeddings.index]


def test_words_have_unit_vectors_that_depend_on_the_word_and_the_seed_alone():
    one = SimulatedLSeg(LABELS, seed=3).text(WORDS)
    other = SimulatedLSeg(WORDS, seed=3).text(WORDS[::-1])[::-1]
    assert one.dtype == np.float32 and one.shape == (len(WORDS), 512)
    np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(np.linalg.norm(one, axis=1), 1.0, atol=1e-6)
    assert not np.allclose(one, SimulatedLSeg(LABELS, seed=4).text(WORDS), atol=0.01)


def test_kin_are_more_alike_than_others():
    vectors = SimulatedLSeg(LABELS).text(WORDS)
    cosine = vectors @ vectors.T
    kin = {(0, 1), (2, 3)}
    for i in range(len(WORDS)):
        for j in range(i):
            assert cosine[i, j] == pytest.approx(0.88 if (j, i) in kin else 0.75, abs=0.06)


def test_without_errors_every_pixel_is_its_class_exactly():
    for frame, segmentation, _ in random_frames(5):
        encoder = SimulatedLSeg(LABELS, noise=EXACT)
        label = {s.id: LABELS.index(s.label) for s in segmentation.segments} | {0: 0}
        wanted = np.vectorize(label.get)(segmentation.ids)
        embeddings = encoder.pixels(frame, segmentation)
        np.testing.assert_array_equal(nearest(encoder, embeddings), wanted)
        texts = encoder.text((OTHER, *LABELS[1:]))
        np.testing.assert_allclose(embeddings.table[embeddings.index], texts[wanted], atol=1e-6)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 11))
def test_it_never_sees_instances(seed, stride):
    """Cutting segments in two, renumbering them and changing their scores changes not one bit."""
    frame, segmentation, _ = random_frames(seed, frames=1)[0]
    rng = np.random.default_rng(seed)
    ids = np.where((segmentation.ids > 0) & (rng.random(segmentation.ids.shape) < 0.5), 20 - segmentation.ids, 0)
    ids = np.where(ids > 0, ids, segmentation.ids).astype(np.int32)
    cut = tuple(Segment(20 - s.id, s.label, 0.01, s.is_thing) for s in segmentation.segments)
    encoder = SimulatedLSeg(LABELS, seed=1, dimension=64, noise=LSegNoise(output_stride_px=stride))
    one = encoder.pixels(frame, segmentation)
    two = encoder.pixels(frame, Segmentation(ids, segmentation.segments + cut))
    np.testing.assert_array_equal(one.table, two.table)
    np.testing.assert_array_equal(one.index, two.index)


def test_the_noise_depends_on_the_seed_and_the_frame_and_has_the_stated_size():
    frame, segmentation = halves()
    noise = LSegNoise(noise=0.2, bleed_px=0.0, confusion=0.0)
    clean = SimulatedLSeg(LABELS, noise=LSegNoise(noise=0.0, bleed_px=0.0, confusion=0.0)).pixels(frame, segmentation)
    first = SimulatedLSeg(LABELS, noise=noise).pixels(frame, segmentation)
    np.testing.assert_array_equal(first.table, SimulatedLSeg(LABELS, noise=noise).pixels(frame, segmentation).table)
    assert np.std(first.table - clean.table) == pytest.approx(0.2, rel=0.02)
    later = Frame(1, "1", frame.depth_m, frame.T_world_camera, frame.intrinsics)
    for other in (
        SimulatedLSeg(LABELS, noise=noise).pixels(later, segmentation),
        SimulatedLSeg(LABELS, seed=1, noise=noise).pixels(frame, segmentation),
    ):
        assert abs(np.corrcoef((other.table - clean.table).ravel(), (first.table - clean.table).ravel())[0, 1]) < 0.9
        assert not np.array_equal(other.table, first.table)


def test_neighbours_bleed_at_the_outline_and_not_far_from_it():
    frame, segmentation = halves()
    encoder = SimulatedLSeg(LABELS, noise=LSegNoise(noise=0.0, confusion=0.0, output_stride_px=4, bleed_px=6.0))
    embeddings = encoder.pixels(frame, segmentation)
    chair, floor = encoder.text(("chair", "floor"))
    share = (embeddings.table - floor) @ (chair - floor) / ((chair - floor) @ (chair - floor))
    row = share[embeddings.index[20]]
    assert row[0] == pytest.approx(1.0, abs=1e-3) and row[-1] == pytest.approx(0.0, abs=1e-3)
    assert 0.5 < row[47] < 0.7 and row[47] + row[48] == pytest.approx(1.0, abs=1e-3)
    assert (np.diff(row) <= 1e-5).all()
    # One vector for 4 x 4 pixels.
    assert embeddings.table.shape == (12 * 24, 512) and len(np.unique(embeddings.index[:4, :4])) == 1


def test_confusion_draws_a_whole_class_towards_kin():
    frame, segmentation = halves()
    labels = ("none", "chair", "couch", "floor", "tv")
    always = LSegNoise(noise=0.0, bleed_px=0.0, confusion=1.0, confusion_kin=1.0, confusion_share=(0.9, 0.9))
    encoder = SimulatedLSeg(labels, noise=always)
    found = nearest(encoder, encoder.pixels(frame, segmentation))
    assert (found[:, :48] == labels.index("couch")).all()
    assert len(np.unique(found[:, 48:])) == 1 and found[0, 50] != labels.index("floor")


def test_bad_input_is_named():
    frame, segmentation = halves()
    with pytest.raises(InputError, match="kin cosine"):
        LSegNoise(any_cosine=0.9, kin_cosine=0.8)
    with pytest.raises(InputError, match="output stride"):
        LSegNoise(output_stride_px=0)
    with pytest.raises(InputError, match="seed from 0"):
        SimulatedLSeg(LABELS, seed=-1)
    with pytest.raises(InputError, match="'floor'"):
        SimulatedLSeg(("none", "chair")).pixels(frame, segmentation)
