"""Queries to panoptic maps: against a plain twin, and against what transformers made of the same logits."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from panoptic_twins import CLASSES, SHAPE, STUFF, bilinear, by_transformers, drawn_logits, plain_panoptic

from simaps_viz.segmentation.class_names import ClassNames
from simaps_viz.segmentation.mask_classification import (
    MASK2FORMER_GRID,
    MaskClassifier,
    MaskPorts,
    PanopticSettings,
    Picture,
    confident_queries,
    panoptic_map,
    sigmoid,
)
from simaps_viz.segmentation.session import resize_masks

MADE = Path(__file__).with_name("panoptic_by_transformers.json")
"""Made by transformers 5.23 on torch 2.13: by_transformers(family, *drawn_logits(seed)) for each family and seed;
a character is a pixel, its id in base 36."""
FAMILIES, SEEDS = ("mask2former", "maskformer", "oneformer", "eomt"), range(8)


def classifier(family: str, settings: PanopticSettings | None = None) -> MaskClassifier:
    eomt = family == "eomt"
    session: Any = SimpleNamespace(path=Path(f"{family}.onnx"), digest="0")
    names = ClassNames(tuple("abcdef"), tuple(i not in STUFF for i in range(CLASSES)), "test")
    grid = MASK2FORMER_GRID if family == "mask2former" else None
    ports = MaskPorts("x", "c", "m", CLASSES, (32, 32), grid=grid)
    default = PanopticSettings("original", 0.8) if eomt else PanopticSettings()
    return MaskClassifier(session, ports, names, Picture("pad" if eomt else "stretch"), settings or default)


def agree(family: str, seed: int, ids: np.ndarray, infos: list[tuple[int, int]]) -> bool:
    """Compare with transformers; where it gave two things one number, ours may only be finer. True where equal."""
    classes, masks = drawn_logits(seed)
    found = classifier(family).decode([classes[None], masks[None]], *SHAPE)
    of_class = {number: {label for n, label in infos if n == number} for number, _ in infos}
    if len({n for n, _ in infos}) == len({(n, label) for n, label in infos}) and all(
        sum(n == number for n, _ in infos) == 1 or of_class[number] <= STUFF for number, _ in infos
    ):
        np.testing.assert_array_equal(found.ids, ids)
        assert {(s.id, "abcdef".index(s.label)) for s in found.segments} == set(infos)
        return True
    pairs = set(zip(found.ids.ravel().tolist(), ids.ravel().tolist(), strict=True))
    assert len({ours for ours, _ in pairs}) == len(pairs)
    for segment in found.segments:
        assert "abcdef".index(segment.label) in {label for number, label in infos if (segment.id, number) in pairs}
    return False


@pytest.mark.parametrize("family", FAMILIES)
def test_maps_are_the_ones_transformers_made(family):
    made = json.loads(MADE.read_text())
    equal = []
    for seed in SEEDS:
        one = made[f"{family}{seed}"]
        ids = np.array([[int(pixel, 36) for pixel in row] for row in one["ids"]], np.int32)
        equal.append(agree(family, seed, ids, [(number, label) for number, label in one["segments"]]))
    assert sum(equal) >= 5  # the rest have two things of one number


@pytest.mark.parametrize("family", FAMILIES)
def test_maps_are_the_ones_transformers_makes_here(family):
    pytest.importorskip("torch", reason="the extra export is not installed: torch")
    pytest.importorskip("transformers", reason="the extra export is not installed: transformers")
    for seed in range(100, 120):
        classes, masks = drawn_logits(seed)
        ids, infos = by_transformers(family, classes, masks)
        first = 1 if family == "eomt" else 0
        agree(family, seed, ids, [(row["id"] + first, row["label_id"]) for row in infos])


@pytest.mark.parametrize("rule", ["transformers", "original"])
@pytest.mark.parametrize("thresholds", [(0.5, 0.5, 0.8), (0.3, 0.3, 0.5), (0.0, 0.7, 0.0), (0.9, 0.5, 0.8)])
def test_both_rules_are_those_of_the_plain_twin(rule, thresholds):
    score, mask, overlap = thresholds
    for seed in range(4):
        classes, masks = drawn_logits(seed)
        probability = sigmoid(masks)
        queries = confident_queries(classes, score)
        settings = PanopticSettings(rule, score, mask, overlap)
        ids, found = panoptic_map(probability[queries.kept], queries, STUFF, settings)
        plain_ids, plain = plain_panoptic(classes, probability, rule=rule, score=score, mask=mask, overlap=overlap)
        np.testing.assert_array_equal(ids, plain_ids)
        assert [(s.id, s.class_index) for s in found] == plain


def test_the_original_rule_gives_no_pixel_whose_mask_is_improbable():
    classes, masks = drawn_logits(3)
    queries = confident_queries(classes, 0.5)
    probability = sigmoid(masks)[queries.kept]
    covered = {}
    for rule in ("transformers", "original"):
        ids, _ = panoptic_map(probability, queries, STUFF, PanopticSettings(rule, overlap=0.0))
        covered[rule] = ids > 0
    assert not (covered["original"] & (probability.max(axis=0) < 0.5)).any()
    assert covered["transformers"].sum() > covered["original"].sum()


def test_every_thing_has_a_number_of_its_own_also_after_joined_stuff():
    """transformers numbers the last of these like the second: two things in one."""
    logits = np.full((4, 5), -9.0, np.float32)
    for query, label in enumerate([3, 0, 3, 1]):
        logits[query, label] = 9.0
    probability = np.zeros((4, 2, 8), np.float32)
    for query in range(4):
        probability[query, :, 2 * query : 2 * query + 2] = 0.9
    ids, segments = panoptic_map(probability, confident_queries(logits, 0.5), {3}, PanopticSettings())
    assert ids[0].tolist() == [1, 1, 2, 2, 1, 1, 3, 3]
    assert [(s.id, s.class_index) for s in segments] == [(1, 3), (2, 0), (3, 1)]


def test_exactly_four_fifths_of_a_mask_are_enough():
    """Found by comparing with transformers, which divides in single precision."""
    logits = np.array([[9.0, 0.0, 0.0], [0.0, 9.0, 0.0]], np.float32)
    probability = np.array([[[0.9, 0.9, 0.9, 0.9, 0.6]], [[0.1, 0.1, 0.1, 0.1, 0.9]]], np.float32)
    for rule in ("transformers", "original"):
        ids, _ = panoptic_map(probability, confident_queries(logits, 0.5), (), PanopticSettings(rule))
        assert ids.tolist() == [[1, 1, 1, 1, 2]]


def test_no_confident_query_is_an_empty_map():
    classes = np.zeros((3, CLASSES + 1), np.float32)
    classes[:, -1] = 9.0
    found = classifier("maskformer").decode([classes[None], np.zeros((1, 3, 4, 4), np.float32)], *SHAPE)
    assert found.segments == () and found.ids.shape == SHAPE and not found.ids.any()


def test_masks_are_resized_as_the_plain_twin_does():
    _, masks = drawn_logits(1)
    for shape in ((24, 32), (7, 9), (16, 20)):
        resized = resize_masks(masks[:3], *shape)
        for mask, small in zip(masks, resized, strict=False):
            np.testing.assert_allclose(small, bilinear(mask, *shape), atol=1e-4)


@pytest.mark.parametrize("field", ["score", "mask", "overlap"])
def test_thresholds_are_probabilities(field):
    with pytest.raises(Exception, match=f"{field} threshold: expected 0 to 1, found 1.5"):
        replace(PanopticSettings(), **{field: 1.5})


def test_pictures_are_normalised_as_transformers_do_and_padded_with_zeros():
    network = classifier("eomt")
    color = np.zeros((24, 32, 3), np.uint8)
    color[..., 0], color[..., 1] = 255, 51
    tensor = network.prepare(color)
    assert tensor.shape == (1, 3, 32, 32) and tensor.dtype == np.float32
    expected = [(1.0 - 0.485) / 0.229, (0.2 - 0.456) / 0.224, (0.0 - 0.406) / 0.225]
    np.testing.assert_allclose(tensor[0, :, 5, 5], expected, rtol=1e-5)
    assert not tensor[0, :, 24:].any()
