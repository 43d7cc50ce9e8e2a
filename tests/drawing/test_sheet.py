"""The kit for pictures with words: text in any script, panels, swatches, scale bars, files."""

import numpy as np
import pytest
from PIL import Image

from simaps_viz.drawing import sheet
from simaps_viz.drawing.sheet import INK, PAPER, RULE, Sheet, fitting, save_png, width_of, wrapped, write
from simaps_viz.errors import InputError


@pytest.mark.parametrize("text", ["Café – 2 → 1", "椅子", "a" * 200])
def test_text_is_written_where_it_should_be(text):
    image = np.full((60, 900, 3), 255, np.uint8)
    cut = fitting(text, 20, 400)
    assert width_of(cut, 20) <= 400 and (len(cut) == len(text) or cut.endswith("…"))
    write(image, cut, (450, 30), 20, (0, 0, 0), anchor="centre")
    _, col = np.nonzero(image.min(axis=-1) < 128)
    assert abs((col.min() + col.max()) / 2 - 450) < 8
    assert col.max() - col.min() <= 400


def test_text_without_a_font_of_its_own_is_plain(monkeypatch):
    monkeypatch.setattr(sheet, "_font", lambda: None)
    image = np.full((60, 400, 3), 255, np.uint8)
    write(image, "Café → “x”", (10, 30), 20, (0, 0, 0))
    assert (image.min(axis=-1) < 128).any()
    assert width_of("Café", 20) > 20


def test_long_texts_are_wrapped_at_spaces():
    text = "poses look like world-to-camera; they have to be camera-to-world"
    lines = wrapped(text, 18, 200)
    assert len(lines) > 2 and all(width_of(line, 18) <= 200 for line in lines)
    assert " ".join(line.strip() for line in lines) == text
    assert all(line.startswith("   ") for line in lines[1:]) and not lines[0].startswith(" ")
    assert wrapped("short", 18, 200) == ["short"]
    assert wrapped("a" * 60, 18, 50) == ["a" * 60]  # a word is never broken


def test_lengths_grow_with_the_sheet():
    small, large = Sheet(400, 100), Sheet(800, 200, 2.0)
    widths = [one.text("chair", (10, 50), 20) for one in (small, large)]
    assert widths[1] == pytest.approx(2 * widths[0], rel=0.05)
    assert (small.width, small.height, large.px(7)) == (400, 100, 14)


def test_a_panel_has_its_picture_framed_below_its_title():
    page = Sheet(300, 200)
    image = np.full((50, 80, 3), (10, 200, 30), np.uint8)
    page.panel(image, (20, 10), "title", "subtitle")
    top = 10 + page.panel_head(subtitle=True)
    assert (page.pixels[top : top + 50, 20:100] == image).all()
    assert (page.pixels[top - 1, 20:100] == RULE).all() and (page.pixels[top + 50, 20:100] == RULE).all()
    assert (page.pixels[10 : top - 1].min(axis=-1) < 128).any() and (page.pixels[top + 51 :] == PAPER).all()


def test_what_does_not_fit_on_a_sheet_is_cut():
    page = Sheet(30, 20)
    page.paste(np.zeros((50, 50, 3), np.uint8), (10, 5))
    assert (page.pixels[5:, 10:] == 0).all() and (page.pixels[:5] == PAPER).all()


def test_a_scale_bar_is_as_long_as_it_says():
    page = Sheet(400, 60)
    end = page.scale_bar((20, 30), pixels_per_m=70.0)  # 0.5 m would be shorter than 60 pixels
    assert (page.pixels[30, 20:90] == INK).all() and (page.pixels[30, 93:96] == PAPER).all()
    assert 90 < end < 400 and (page.pixels[:, end + 1 :] == PAPER).all()


@pytest.mark.parametrize("sample", [(10, 20, 200), np.full((4, 4, 3), (10, 20, 200), np.uint8)])
def test_a_swatch_shows_its_colour(sample):
    page = Sheet(200, 40)
    wide = page.swatch(sample, "couch", (10, 20), 14)
    assert (page.pixels[13:27, 10:24] == (10, 20, 200)).all()
    assert 24 < wide < 190 and (page.pixels[:, 11 + wide :] == PAPER).all()


def test_a_png_is_written_or_nothing(tmp_path):
    page = Sheet(20, 10)
    page.fill((2, 3, 5, 6), (1, 2, 3))
    save_png(page.pixels, tmp_path / "page.png")
    with Image.open(tmp_path / "page.png") as image:
        assert np.array_equal(np.asarray(image), page.pixels)
    for bad in (tmp_path / "page.gif", tmp_path / "no" / "page.png"):
        with pytest.raises(InputError):
            save_png(page.pixels, bad)
        assert not bad.exists()
