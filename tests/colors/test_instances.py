"""Colours of objects: told apart with any kind of colour vision, and kept whatever else on the map changes."""

from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest
from benchmarks.large_maps import large_map
from color_vision import VISIONS, ciede2000, lab, least_apart
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_maps import map_from_drawing, toy_map

from simaps_viz import open_sequence
from simaps_viz.build.methods import build
from simaps_viz.colors.classes import COCO_THINGS, COMMON, STUFF, class_color, instance_color
from simaps_viz.colors.instances import STEPS, TOUCHES, class_colors, instance_colors, near_pairs, take_over
from simaps_viz.colors.palette import ALIKE, ALIKE_BELOW, MIN_APART, PALETTE
from simaps_viz.drawing.theme import DARK, LIGHT
from simaps_viz.mapping.edits import apply as mend
from simaps_viz.mapping.edits import merge
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.scenes.demo import DemoSettings, ensure_demo

MIN_FROM_GROUND = 8.0
SHARMA = (  # Sharma, Wu and Dalal 2005, table 1: pairs 1, 4, 7, 10, 17, 25 and 31
    ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
    ((50, -1.3802, -84.2814), (50, 0, -82.7485), 1.0000),
    ((50, 0, 0), (50, -1, 2), 2.3669),
    ((50, 2.49, -0.001), (50, -2.49, 0.0010), 7.1792),
    ((50, 2.5, 0), (73, 25, -18), 27.1492),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((90.9257, -0.5406, -0.9208), (88.6381, -0.8985, -0.7239), 1.5381),
)


def adjacent(simap):
    """Pairs of instances whose cells touch, [n, 2]."""
    pairs, weight = near_pairs(simap.instance)
    return pairs[weight == TOUCHES]


@given(st.integers(0, 2**32 - 1), st.integers(0, 30), st.integers(0, 30), st.integers(0, 40))
@settings(max_examples=60, deadline=None)
def test_ids_are_near_as_each_pair_of_cells_says(seed, rows, cols, most):
    """Also where a step is longer than the map, where nearly every cell has an id of its own, and where none has."""
    rng = np.random.default_rng(seed)
    ids = np.kron(rng.integers(0, most + 1, (rows, cols)), np.ones((1 + seed % 3, 1 + seed % 4))).astype(np.int32)
    expected = {}
    for (down, right), weight in STEPS.items():
        for row, col in np.argwhere(ids):
            r, c = row + down, col + right
            if 0 <= r < ids.shape[0] and 0 <= c < ids.shape[1] and ids[r, c] not in (0, ids[row, col]):
                pair = tuple(sorted((int(ids[row, col]), int(ids[r, c]))))
                expected[pair] = max(weight, expected.get(pair, 0))
    pairs, weight = near_pairs(ids)
    assert [tuple(pair) for pair in pairs.tolist()] == sorted(expected)
    assert dict(zip(map(tuple, pairs.tolist()), weight.tolist(), strict=True)) == expected


def check_neighbours(simap):
    pairs, colors = adjacent(simap), instance_colors(simap)
    if len(pairs):
        assert least_apart(colors[pairs[:, 0]], colors[pairs[:, 1]]) >= MIN_APART


@pytest.fixture(scope="module")
def cafe(tmp_path_factory):
    small = DemoSettings(frames=40, width=160, height=120)
    return build(open_sequence(ensure_demo(cache_dir=tmp_path_factory.mktemp("cache"), settings=small)), "evidence")


@pytest.mark.parametrize(("first", "second", "expected"), SHARMA)
def test_the_measure_agrees_with_published_values(first, second, expected):
    measured = ciede2000(np.array(first, float), np.array(second, float))
    assert float(measured) == pytest.approx(expected, abs=1e-4)


def test_no_two_colours_of_the_palette_are_confused():
    assert len(set(PALETTE)) == len(PALETTE)
    first, second = zip(*combinations(PALETTE, 2), strict=True)
    assert least_apart(first, second) >= MIN_APART


def test_the_colours_that_are_easily_confused_are_those_that_are_listed():
    places = combinations(range(len(PALETTE)), 2)
    assert tuple(pair for pair in places if least_apart(*([PALETTE[place]] for place in pair)) < ALIKE_BELOW) == ALIKE


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.name)
def test_objects_stand_out_from_what_is_under_them(theme):
    for ground in (theme.unseen, theme.floor, theme.clutter, theme.wall):
        assert least_apart(PALETTE, [ground] * len(PALETTE)) >= MIN_FROM_GROUND


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.name)
def test_grounds_are_told_apart(theme):
    for one, other in combinations((theme.unseen, theme.floor, theme.clutter, theme.wall), 2):
        assert min(float(ciede2000(lab(one, v), lab(other, v))) for v in VISIONS) > 4.0


def test_colours_of_ids_and_names():
    assert [instance_color(i) for i in range(1, 13)] == list(PALETTE)
    assert instance_color(13) == PALETTE[0] and instance_color(0) == (0, 0, 0)
    assert [class_color(name) for name in COMMON] == list(PALETTE)
    assert {class_color(name) for name in COCO_THINGS} <= set(PALETTE)
    assert all(len(set(class_color(name))) == 1 for name in STUFF)  # grey


def test_a_small_map_has_the_colours_of_its_ids():
    simap = toy_map()
    colors = instance_colors(simap)
    assert [tuple(colors[one.id].tolist()) for one in simap.instances] == [
        instance_color(i.id) for i in simap.instances
    ]


@pytest.mark.slow
def test_objects_that_touch_are_told_apart_at_any_threshold(cafe):
    colors = instance_colors(cafe)
    for affinity in (0.0, 0.2, 0.4, 0.6, 0.7, 0.8):
        cut = repartition(cafe, affinity=affinity)
        assert instance_colors(cut) is colors  # nothing is recoloured while the slider moves
        check_neighbours(cut)


def renumbered(simap, seed):
    """The map with its communities numbered in another order, and so its instances."""
    numbers = np.random.default_rng(seed).permutation(int(simap.community.max())) + 1
    numbers = np.r_[0, numbers].astype(np.int32)
    steps = replace(simap.merges, source=numbers[simap.merges.source], target=numbers[simap.merges.target])
    return replace(simap, community=numbers[simap.community], merges=steps)


def alike(simap):
    """How many pairs of instances that touch have colours which some people confuse, and how many touch."""
    pairs, colors = adjacent(simap), instance_colors(simap).astype(int)
    sides = colors[pairs[:, 0]], colors[pairs[:, 1]]
    apart = np.min([ciede2000(lab(sides[0], vision), lab(sides[1], vision)) for vision in VISIONS], axis=0)
    return int((apart < ALIKE_BELOW).sum()), len(pairs)


def within_a_hand(simap):
    """Pairs of instances at most 0.3 m apart, measured from edge to edge in all directions."""
    found = []
    ids = np.unique(simap.instance[simap.instance > 0]).tolist()
    for place, one in enumerate(ids):
        away = cv2.distanceTransform((simap.instance != one).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        others = [
            two for two in ids[place + 1 :] if (away[simap.instance == two].min() - 1.0) * simap.spec.cell_size_m <= 0.3
        ]
        found += [(one, two) for two in others]
    return found


@pytest.mark.slow
def test_objects_a_hand_apart_differ_whatever_their_numbers_are(cafe):
    """Colours repeat only beyond 0.3 m; of pairs that touch, one in twenty at most is confused with some vision."""
    near = within_a_hand(cafe)
    assert len(near) > len(PALETTE)
    for seed in range(4):
        other = renumbered(cafe, seed)
        other = repartition(other, affinity=cafe.parameters["affinity"])
        colors = instance_colors(other)
        numbers = dict(zip(cafe.instance.ravel().tolist(), other.instance.ravel().tolist(), strict=True))
        assert [pair for pair in near if (colors[numbers[pair[0]]] == colors[numbers[pair[1]]]).all()] == []
        confused, touching = alike(other)
        assert confused <= max(1, touching // 20)


def test_classes_keep_their_colours_and_those_that_touch_differ(cafe):
    colors = class_colors(cafe)
    assert all(colors[name] == class_color(name) for name in COMMON[:4] if name in colors)
    assert class_colors(repartition(cafe, affinity=0.2)) == colors
    number = {one.id: one.label for one in cafe.instances}
    pairs = [(colors[number[a]], colors[number[b]]) for a, b in adjacent(cafe).tolist() if number[a] != number[b]]
    assert least_apart(*zip(*pairs, strict=True)) >= MIN_APART


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(4, 120), st.sampled_from([0.0, 5.0, 20.0, 50.0]))
def test_neighbours_differ_on_made_up_maps(seed, objects, k_percent):
    simap = large_map(60, 80, objects, seed=seed, edges=False)
    check_neighbours(repartition(simap, k_percent=k_percent))
    legend = list(class_colors(simap).values())
    assert len(set(legend)) == len(legend)  # ten classes, twelve colours


def test_neighbours_of_one_colour_get_another():
    simap = map_from_drawing("AM\nBL", {"A": "chair", "M": "chair", "B": "couch", "L": "couch"}, cells=3)
    thirteenth = np.where(simap.community == 2, 13, simap.community).astype(np.int32)
    assert instance_color(1) == instance_color(13)
    clash = replace(simap, community=thirteenth, instance=thirteenth, instances=(), graphs=())
    assert len(adjacent(clash)) == 6
    check_neighbours(clash)


def test_an_object_keeps_its_colour_on_a_map_with_other_numbers():
    before = toy_map()
    worn = instance_colors(before)
    shift = lambda ids: np.where(ids > 0, ids + 5, 0).astype(np.int32)  # noqa: E731
    after = replace(
        before,
        community=shift(before.community),
        instance=shift(before.instance),
        instances=tuple(replace(one, id=one.id + 5) for one in before.instances),
        merges=replace(before.merges, source=before.merges.source + 5, target=before.merges.target + 5),
    )
    take_over(after, before)
    for one in before.instances:
        assert (instance_colors(after)[one.id + 5] == worn[one.id]).all()


def test_finding_communities_anew_recolours_hardly_anything(cafe):
    worn = instance_colors(cafe)
    after = recommunity(cafe, resolution=1.6, affinity=0.6)
    take_over(after, cafe)
    colors = instance_colors(after)
    kept = total = 0
    for one in after.instances:
        mine = after.instance == one.id
        ids, shared = np.unique(cafe.instance[mine], return_counts=True)
        twin = int(ids[shared.argmax()])
        if twin and shared.max() > 0.8 * one.cells:
            total += 1
            kept += bool((colors[one.id] == worn[twin]).all())
    assert total > 20 and kept >= 0.9 * total
    check_neighbours(after)


def test_a_part_that_is_split_off_by_hand_gets_a_colour_of_its_own():
    before = toy_map()
    instance = before.instance.copy()
    new = int(before.community.max()) + 1
    row, col = np.nonzero(instance == 5)  # the couch; its right half becomes another object
    half = col > np.median(col)
    instance[row[half], col[half]] = new
    couch = before.by_id(5)
    after = replace(before, instance=instance, instances=(*before.instances, replace(couch, id=new)))
    take_over(after, before)
    assert (instance_colors(after)[5] == instance_colors(before)[5]).all()
    check_neighbours(after)


def test_empty_maps_have_no_colours_to_give():
    simap = map_from_drawing("...\n...")
    assert class_colors(simap) == {}
    assert instance_colors(simap).tolist() == [[0, 0, 0]]


@pytest.mark.parametrize(("first", "second"), [(4, 3), (3, 4), (9, 8), (8, 9)])
def test_what_is_joined_by_hand_has_the_colour_of_the_one_it_is_joined_to(first, second):
    before = toy_map()
    worn = instance_colors(before)
    after = mend(before, merge(before, first, second))
    take_over(after, before, first)
    (x, y, _) = before.by_id(first).centroid_m
    joined = after.at(x, y)
    assert joined is not None and joined.cells == before.by_id(first).cells + before.by_id(second).cells
    assert (instance_colors(after)[joined.id] == worn[first]).all()
