"""The pictures and words of a comparison, without a browser."""

import numpy as np
import pytest
from judged_maps import drawn, map_of_ids
from toy_maps import toy_map

from simaps_viz.evaluation.differences import Kind
from simaps_viz.evaluation.two_maps import compare_two
from simaps_viz.mapping.simap import repartition
from simaps_viz.viewer.drawing import lettering
from simaps_viz.viewer.drawing.compare_picture import INK, KINDS, TwoPictures
from simaps_viz.viewer.panels.compare_words import item_text, kind_options, of_kind, summary_html

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
    seam = round(pictures.seam_m / merged.spec.cell_size_m) * n
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
    assert item_text(merged.items[0], "left") == "merged · 2 chairs → 1"
    back = compare_two(("<b>", repartition(toy_map(), k_percent=0.0)), ("K", toy_map()))
    assert item_text(back.items[0], "left") == "split · 1 chair → 2"
    html = summary_html(back)
    assert "&lt;b&gt;" in html and "<b>: " not in html
    assert "one object is several" in html and "several objects are one" not in html


@pytest.mark.parametrize("text", ["Café – 2 → 1", "椅子", "a" * 200])
def test_text_is_written_where_it_should_be(text):
    image = np.full((60, 900, 3), 255, np.uint8)
    cut = lettering.fitting(text, 20, 400)
    assert lettering.width_of(cut, 20) <= 400 and (len(cut) == len(text) or cut.endswith("…"))
    lettering.write(image, cut, (450, 30), 20, (0, 0, 0), anchor="centre")
    _, col = np.nonzero(image.min(axis=-1) < 128)
    assert abs((col.min() + col.max()) / 2 - 450) < 8
    assert col.max() - col.min() <= 400


def test_text_without_a_font_of_its_own_is_plain(monkeypatch):
    monkeypatch.setattr(lettering, "_font", lambda: None)
    image = np.full((60, 400, 3), 255, np.uint8)
    lettering.write(image, "Café → “x”", (10, 30), 20, (0, 0, 0))
    assert (image.min(axis=-1) < 128).any()
    assert lettering.width_of("Café", 20) > 20
