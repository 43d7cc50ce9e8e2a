"""Names of colours: what everybody would say of plain ones, and both names at an edge."""

import numpy as np
import pytest
from color_vision import lab as twin

from simaps_viz.colors.naming import COLOR_WORDS, color_name, has_color, lab
from simaps_viz.errors import InputError


@pytest.mark.parametrize(
    ("rgb", "name"),
    [
        ((0, 0, 0), "black"), ((255, 255, 255), "white"), ((128, 128, 128), "grey"), ((64, 64, 64), "dark grey"),
        ((255, 0, 0), "red"), ((0, 128, 0), "green"), ((0, 0, 255), "blue"), ((255, 255, 0), "yellow"),
        ((255, 165, 0), "orange"), ((128, 0, 128), "purple"), ((255, 192, 203), "pink"), ((0, 0, 128), "dark blue"),
        ((139, 69, 19), "brown"), ((210, 180, 140), "beige"), ((64, 224, 208), "turquoise"), ((128, 0, 0), "dark red"),
        ((173, 216, 230), "light blue"), ((0, 100, 0), "dark green"), ((144, 238, 144), "light green"),
    ],
)  # fmt: skip
def test_plain_colours_have_their_names(rgb, name):
    """The examples are CSS's colours of that name; none is in the table."""
    assert color_name(rgb) == name and has_color(rgb, name.upper()) and has_color(rgb, name.split()[-1])


def test_every_colour_has_the_name_it_is_given_and_few_others():
    rng = np.random.default_rng(0)
    basic = ("red", "orange", "yellow", "green", "blue", "purple", "pink", "brown", "black", "white", "grey")
    counts = []
    for rgb in rng.integers(0, 256, (300, 3)).tolist():
        assert has_color(tuple(rgb), color_name(tuple(rgb)))
        counts.append(sum(has_color(tuple(rgb), word) for word in basic))
    assert np.mean(counts) < 1.3 and max(counts) <= 4


def test_words_mean_what_they_say():
    assert has_color((25, 25, 90), "navy") and has_color((25, 25, 90), "dark") and not has_color((25, 25, 90), "red")
    assert (
        has_color((150, 90, 50), "wooden")
        and has_color((150, 150, 150), "gray")
        and has_color((150, 150, 150), "silver")
    )
    assert has_color((232, 80, 30), "red") and has_color((232, 80, 30), "orange"), "at the edge of both"
    reddish, greenish_grey = (151, 76, 48), (115, 140, 120)
    assert has_color(reddish, "red", nearly=True) and not has_color(reddish, "red")
    assert not has_color(greenish_grey, "green", nearly=True), "only a vivid colour is nearly another"
    assert has_color((30, 200, 40), "colourful") and not has_color((120, 118, 119), "colourful")
    assert {"light brown", "dark gray", "teal", "bright"} <= COLOR_WORDS
    with pytest.raises(InputError, match=r"colour: expected a word such as red.*found 'chair'"):
        has_color((1, 2, 3), "chair")


def test_cielab_is_that_of_the_independent_formula():
    rgb = np.random.default_rng(1).integers(0, 256, (50, 3))
    np.testing.assert_allclose(lab(rgb), twin(rgb), atol=0.05)
