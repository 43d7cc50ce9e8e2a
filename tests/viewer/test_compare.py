"""The pictures and words of a comparison, without a browser."""

import numpy as np
import pytest
from judged_maps import drawn, map_of_ids
from toy_maps import toy_map

from simaps_viz.drawing.compare_picture import HEAT, KINDS, LIGHT_MISSED, TwoPictures, errors_of, mark_color
from simaps_viz.drawing.sheet import INK
from simaps_viz.drawing.theme import DARK, LIGHT
from simaps_viz.evaluation.two_maps import Kind, compare_two
from simaps_viz.mapping.simap import repartition
from simaps_viz.viewer.panels.compare import (
    PQ_MEANS,
    headline_html,
    ignored_lines,
    item_text,
    kind_options,
    of_kind,
    summary_html,
)

BLINDNESS = {  # Machado, Oliveira and Fernandes 2009, severity 1, on linear RGB
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(rgb, blindness):
    share = np.asarray(rgb) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    xyz = TO_XYZ @ np.clip(np.asarray(BLINDNESS[blindness]) @ linear, 0, 1) / (0.9505, 1.0, 1.089)
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.fixture(scope="module")
def merged():
    return compare_two(("K = 5 %", toy_map()), ("K = 0 %", repartition(toy_map(), k_percent=0.0)))


@pytest.mark.parametrize("blindness", BLINDNESS)
def test_the_kinds_are_told_apart_with_any_colour_vision(blindness):
    assert set(KINDS) == {kind.value for kind in Kind}
    colors = [lab(color, blindness) for color, _ in KINDS.values()]
    apart = [np.linalg.norm(a - b) for i, a in enumerate(colors) for b in colors[:i]]
    assert min(apart) > 15.0


def test_no_differences_are_said_only_where_nothing_differs():
    left, right = drawn("1111.2222"), drawn("1111.222.")
    chairs = {1: "chair", 2: "chair"}
    one, other = (map_of_ids(ids, chairs) for ids in (left, right))
    maps = compare_two(("a", one), ("b", other))
    said = headline_html(maps)
    assert "The same objects, other outlines" in said and "No differences" not in said and "2 objects agree" in said
    assert "1 of them with another outline; 88 % alike on average (IoU)" in said  # 1 and 3/4
    assert kind_options(maps) == ("edge (1)",) and [item_text(item, maps) for item in of_kind(maps, "edge (1)")] == [
        "edge · chair 2 → 2 · 75 % alike"
    ]
    assert "No differences" in headline_html(compare_two(("a", one), ("b", one)))


def test_swiping_shows_left_then_line_then_right(merged):
    pictures = TwoPictures(merged)
    whole_left, whole_right = (pictures.picture("swipe", share).pixels for share in (1.0, 0.0))
    half = pictures.picture("swipe", 0.5)
    assert half.spec.cols == merged.spec.cols and half.pixels.shape == whole_left.shape
    wide = half.pixels.shape[1]
    n = wide // half.spec.cols
    body = slice(0, merged.spec.rows * n)  # row 0 is the south; the titles lie in the north
    assert np.array_equal(half.pixels[body, : wide // 2 - 2 * n], whole_left[body, : wide // 2 - 2 * n])
    assert np.array_equal(half.pixels[body, wide // 2 + 2 * n :], whole_right[body, wide // 2 + 2 * n :])
    assert (half.pixels[body, wide // 2] == INK).all()
    assert not np.array_equal(whole_left[body], whole_right[body])
    head = half.pixels[body.stop :]
    assert (head[:, : wide // 3].min(axis=-1) < 60).any() and (head[:, -wide // 3 :].min(axis=-1) < 60).any()


def test_side_by_side_is_both_at_one_scale(merged):
    pictures = TwoPictures(merged)
    both = pictures.picture("side by side")
    n = both.pixels.shape[1] // both.spec.cols
    wide, high = merged.spec.cols * n, merged.spec.rows * n
    left, right = (pictures.picture("swipe", share).pixels[:high] for share in (1.0, 0.0))
    assert np.array_equal(both.pixels[:high, : wide - 2 * n], left[:, : wide - 2 * n])
    seam = round(pictures.shift_m("side by side")[0] / merged.spec.cell_size_m) * n
    assert np.array_equal(both.pixels[:high, seam + 2 * n :], right[:, 2 * n :])


def test_marks_are_drawn_on_both_and_where_one_has_nothing(merged):
    pictures = TwoPictures(merged)
    plain = pictures.picture("side by side").pixels.copy()
    (item,) = merged.items
    pictures.mark([], item)
    marked = pictures.picture("side by side").pixels
    color = np.array(KINDS["merged"][0])
    middle = marked.shape[1] // 2
    for part in (marked[:, :middle], marked[:, middle:]):
        assert (part == color).all(axis=-1).sum() > 500
    assert not (plain == color).all(axis=-1).any()
    left, right = drawn("11.22"), drawn("11...")
    missed = compare_two(("a", map_of_ids(left, {1: "chair", 2: "chair"})), ("b", map_of_ids(right, {1: "chair"})))
    pictures = TwoPictures(missed)
    pictures.mark([], missed.items[0])
    shown = pictures.picture("side by side").pixels
    found = (shown == KINDS["missed"][0]).all(axis=-1).any(axis=0)
    assert found[: shown.shape[1] // 2].any() and found[shown.shape[1] // 2 :].any()


def test_the_errors_say_how_little_of_each_object_agrees():
    left, right = drawn("11.2222.33.44"), drawn("11.222..33...")
    labels = {1: "chair", 2: "chair", 3: "chair", 4: "chair"}
    maps = compare_two(("a", map_of_ids(left, labels)), ("b", map_of_ids(right, {**labels, 3: "table"})))
    errors = errors_of(maps)
    on = lambda number: errors[maps.left.instance == number]  # noqa: E731
    assert (on(1) == 0.0).all() and on(2) == pytest.approx(0.25) and (on(3) == 1.0).all() and (on(4) == 1.0).all()
    assert np.isnan(errors[(maps.left.instance == 0) & (maps.right.instance == 0)]).all()
    pictures = TwoPictures(maps)
    shown = pictures.picture("errors")
    n = shown.pixels.shape[1] // shown.spec.cols
    cells = shown.pixels[n // 2 : maps.spec.rows * n : n, n // 2 :: n]
    assert (cells[maps.left.instance == 1] == HEAT[0]).all() and (cells[maps.left.instance == 4] == HEAT[2]).all()
    (missed,) = (item for item in maps.items if item.kind == "missed")
    pictures.mark([], missed)
    assert (pictures.picture("errors").pixels == mark_color("label")).all(axis=-1).sum() > 50


@pytest.mark.parametrize("blindness", BLINDNESS)
def test_a_larger_error_is_darker_with_any_colour_vision(blindness):
    light = [lab(color, blindness)[0] for color in HEAT]
    assert (np.diff(light) < -15.0).all()


def test_a_very_large_map_is_shown_coarser():
    ids = np.zeros((40, 3300), np.int32)
    ids[10:20, 100:200] = 1
    large = map_of_ids(ids, {1: "chair"})
    pictures = TwoPictures(compare_two(("a", large), ("b", large)))
    shown = pictures.picture("swipe")
    assert shown.pixels.shape[1] == shown.spec.cols == 3300 // 3
    assert shown.spec.cell_size_m == pytest.approx(3 * large.spec.cell_size_m)


def test_words(merged):
    assert kind_options(merged) == ("all (1)", "merged (1)")
    assert of_kind(merged, "merged (1)") == list(merged.items) and of_kind(merged, "split (0)") == []
    assert item_text(merged.items[0], merged) == "merged · chairs 1 + 3 → 1"
    back = compare_two(("<b>", repartition(toy_map(), k_percent=0.0)), ("K", toy_map()))
    assert item_text(back.items[0], back) == "split · chair 1 → 1 + 3"
    html = summary_html(back)
    assert "&lt;b&gt;" in html and "<b>: " not in html
    assert "one object is several" in html and "several objects are one" not in html


def test_objects_are_named_by_their_numbers_on_their_own_maps():
    left, right = drawn("11.22.33.44.55.66"), drawn("11.22.33.44......")
    chairs = dict.fromkeys(range(1, 6), "chair")
    one = ("a", map_of_ids(left, {**chairs, 6: "table"}))
    maps = compare_two(one, ("b", map_of_ids(right, {1: "chair", 2: "chair", 3: "table", 4: "chair"})))
    texts = [item_text(item, maps) for item in maps.items]
    assert texts == ["missed · chair 5", "missed · table 6", "label · chair 3 → table 3 · 100 % alike"]
    truth = compare_two(one, ("b", map_of_ids(drawn("11.22.33.44.55..."), chairs)), truth="right")
    assert [item_text(item, truth) for item in truth.items] == ["extra · table 6"]
    many = compare_two(("a", map_of_ids(drawn("1234567"), dict.fromkeys(range(1, 8), "chair"))),
                       ("b", map_of_ids(drawn("1111111"), {1: "chair"})))  # fmt: skip
    assert item_text(many.items[0], many) == "merged · chairs 1 + 2 + 3 + 4 + 5 + 2 more → 1"


def test_what_is_not_compared_and_what_a_score_means_is_said(merged):
    assert ignored_lines(merged) == [] and "of those that" not in headline_html(merged)
    tiny = map_of_ids(np.repeat(np.array([[1, 1, 0, 2, 2, 2, 2, 2]], np.int32), 2, axis=0), {1: "table", 2: "chair"})
    maps = compare_two(("a", tiny), ("b", tiny))
    assert ignored_lines(maps) == ["Too small to compare (under 8 cells, or lying on one that is): 1 left, 1 right"]
    assert "1 object of those that are large enough agrees" in headline_html(maps)
    none = map_of_ids(np.zeros((2, 8), np.int32), {})
    assert "Neither map has an object" in headline_html(compare_two(("a", none), ("b", none)))
    half = headline_html(compare_two(("a", tiny), ("nought", none)))
    assert "nought has no object." in half and "Neither" not in half
    assert PQ_MEANS not in half and PQ_MEANS in headline_html(compare_two(("a", tiny), ("b", tiny), truth="right"))


def test_on_a_dark_page_the_picture_is_dark_and_what_is_missed_light(merged):
    light, dark = (TwoPictures(merged, theme).picture("side by side").pixels for theme in (LIGHT, DARK))
    on = merged.left.instance > 0
    n = light.shape[1] // TwoPictures(merged).picture("side by side").spec.cols
    cells = np.zeros(light.shape[:2], bool)
    cells[: on.shape[0] * n, : on.shape[1] * n] = on.repeat(n, axis=0).repeat(n, axis=1)
    assert np.array_equal(light[cells], dark[cells])  # objects keep their colours
    floor = merged.left.ground == 1
    row, col = np.argwhere(floor & ~on)[50]
    assert tuple(light[row * n, col * n]) == LIGHT.floor and tuple(dark[row * n, col * n]) == DARK.floor
    assert np.median(dark[-3]) < 60 < 200 < np.median(light[-3])  # the strip with the titles
    assert mark_color("missed", DARK) == LIGHT_MISSED and mark_color("missed") == KINDS["missed"][0]
    assert all(mark_color(kind, DARK) == KINDS[kind][0] for kind in KINDS if kind != "missed")
    left, right = drawn("11.22"), drawn("11...")
    missed = compare_two(("a", map_of_ids(left, {1: "chair", 2: "chair"})), ("b", map_of_ids(right, {1: "chair"})))
    pictures = TwoPictures(missed, DARK)
    pictures.mark(missed.items, None)
    shown = pictures.picture("stacked").pixels
    assert (shown == LIGHT_MISSED).all(axis=-1).any() and not (shown == KINDS["missed"][0]).all(axis=-1).any()


def test_two_maps_are_stacked_at_one_scale(merged):
    pictures = TwoPictures(merged)
    both, spec = pictures.picture("stacked"), merged.spec
    n = both.pixels.shape[1] // both.spec.cols
    east, north = pictures.shift_m("stacked")
    assert east == 0.0 and both.spec.cols == spec.cols and both.spec.x0_m == spec.x0_m
    down = round(-north / spec.cell_size_m)
    assert both.spec.y0_m == pytest.approx(spec.y0_m + north)
    left, right = (pictures.picture("swipe", share).pixels[: spec.rows * n] for share in (1.0, 0.0))
    edge = 3 * n  # where the line of the swipe is drawn
    assert np.array_equal(both.pixels[: spec.rows * n, edge:], right[:, edge:])
    assert np.array_equal(both.pixels[down * n : (down + spec.rows) * n, :-edge], left[:, :-edge])
    assert pictures.shift_m("swipe") == (0.0, 0.0)
