"""Light and dark, what empty maps say, the help, and that the fast painting gives what plain loops give. No browser."""

import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import viser
from benchmarks.large_maps import large_map
from color_vision import contrast
from toy_maps import map_from_drawing, toy_map

from simaps_viz.colors.instances import class_colors, instance_colors
from simaps_viz.drawing import legend, texture
from simaps_viz.drawing.surface import MAX_CELLS, block_heights, solids
from simaps_viz.drawing.theme import (
    BAD_PAPER_STYLE,
    BAD_STYLE,
    BADGE_STYLE,
    BRAND,
    DARK,
    DIM_STYLE,
    GOOD_PAPER_STYLE,
    LIGHT,
    PAPER_STYLE,
    SENT_PAPER_STYLE,
    TEXT_STYLE,
    Theme,
    css,
)
from simaps_viz.structures import Grid, GridSpec
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, PanelSpec
from simaps_viz.viewer.panels import help
from simaps_viz.viewer.panels.build import BuildPanel
from simaps_viz.viewer.panels.help import HelpPanel
from simaps_viz.viewer.server.viser_page import PAGE_SCRIPT

READABLE = 4.5
"""WCAG 2 AA for texts."""


@pytest.fixture(scope="module")
def simap():
    return toy_map()


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.name)
def test_texts_and_lines_can_be_read_on_either_page(theme):
    assert contrast(theme.text, theme.panel) >= READABLE and contrast(theme.dim, theme.panel) >= READABLE
    assert contrast(theme.ink, theme.page) >= READABLE
    for ground in (theme.page, theme.unseen, theme.floor):
        assert contrast(theme.selected, ground) >= READABLE
    for style in (BADGE_STYLE, PAPER_STYLE, GOOD_PAPER_STYLE, BAD_PAPER_STYLE, SENT_PAPER_STYLE):
        assert contrast(painted(style, "color", theme), painted(style, "background", theme)) >= READABLE, style
    for style in (TEXT_STYLE, DIM_STYLE, BAD_STYLE):
        assert contrast(painted(style, "color", theme), theme.panel) >= READABLE, style
    assert contrast(BRAND, LIGHT.panel) >= READABLE
    assert css((1, 2, 255)) == "#0102ff"


def painted(style: str, what: str, theme: Theme) -> list[int]:
    """The colour of a property of an inline style on a page, 0-255."""
    (value,) = re.findall(rf"(?:^|;){what}:(.*?)(?:;|$)", style)
    found = re.findall("#([0-9a-f]{6})", value)
    assert len(found) == (2 if value.startswith("light-dark(") else 1)
    return list(bytes.fromhex(found[-1 if theme.dark else 0]))


def plain_colors(simap, mode, theme, lit=None, hidden=()):
    """Colour cell by cell."""
    picture = np.zeros((*simap.spec.shape, 3), np.uint8)
    of_instance, of_class = instance_colors(simap), class_colors(simap)
    for cell in np.ndindex(simap.spec.shape):
        label, height = simap.grid.labels[simap.grid.label[cell]], simap.grid.height_m[cell]
        number = int(simap.instance[cell])
        if number and int(simap.community[cell]) in hidden:
            color, number = theme.floor, 0
        elif number:
            color = of_instance[number] if mode == "instance" else of_class[label]
        elif label == "wall":
            color = theme.wall
        elif np.isnan(height):
            color = theme.unseen
        else:
            color = theme.clutter if height >= 0.1 and label != "floor" else theme.floor
        if lit is not None and number not in lit:
            color = np.array(color, np.float32) * texture.FADED + np.array(theme.unseen, np.float32) * (
                1 - texture.FADED
            )
        picture[cell] = np.asarray(color).astype(np.uint8)
    return picture


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.name)
@pytest.mark.parametrize("mode", ["instance", "class"])
@pytest.mark.parametrize(("lit", "hidden"), [(None, ()), ({1, 9}, ()), (None, (7, 99)), ({6}, (7,)), (set(), ())])
def test_painting_agrees_with_a_plain_loop(simap, mode, theme, lit, hidden):
    fast = texture.cell_colors(simap, mode, lit=lit, hidden=hidden, theme=theme)
    np.testing.assert_allclose(fast.astype(int), plain_colors(simap, mode, theme, lit, hidden), atol=1)


@pytest.mark.parametrize("mode", ["height", "observations"])
def test_ramps_fade_and_go_dark_too(simap, mode):
    dark = texture.map_image(simap, mode, theme=DARK)
    assert tuple(dark[5, 5]) == DARK.unseen
    lit, plain = texture.map_image(simap, mode, lit={1}), texture.map_image(simap, mode)
    assert (lit[simap.instance == 1] == plain[simap.instance == 1]).all()
    assert (lit[50, 50] != plain[50, 50]).any()


def test_the_ground_is_kept_for_one_grid_only(simap):
    texture.map_image(simap)
    bare = replace(simap, grid=replace(simap.grid, height_m=np.full(simap.spec.shape, np.nan, np.float32)))
    assert tuple(texture.map_image(bare)[50, 50]) == LIGHT.unseen
    assert tuple(texture.map_image(simap)[50, 50]) == LIGHT.floor


def test_blocks_of_a_large_map_are_coarser_but_as_high():
    simap = large_map(1200, 1000, 40, edges=False)
    assert simap.spec.rows * simap.spec.cols > MAX_CELLS
    found = solids(simap, texture.cell_colors(simap, "instance"))
    points = np.concatenate([solid.vertices for solid in found])
    xmin, ymin, xmax, ymax = simap.spec.extent_m
    assert points[:, 2].max() == pytest.approx(float(block_heights(simap).max()))
    assert points[:, :2].min(axis=0) == pytest.approx((xmin, ymin), abs=0.06)
    assert points[:, :2].max(axis=0) == pytest.approx((xmax, ymax), abs=0.11)
    assert sum(len(solid.faces) for solid in found) < 50_000


def test_blocks_of_nothing_are_none():
    simap = map_from_drawing("...\n...")
    assert solids(simap, texture.cell_colors(simap, "instance")) == []


def test_made_up_maps_are_made_the_same_way_each_time():
    first, again, other = (large_map(80, 90, 30, seed=seed) for seed in (1, 1, 2))
    assert (first.instance == again.instance).all() and (first.community != other.community).any()
    assert first.provenance["simulated"] and 20 <= len(first.instances) <= 42
    for graph in first.graphs:
        assert (graph.edges[:, 0] < graph.edges[:, 1]).all() and (np.diff(graph.cells) > 0).all()
        assert all(a <= b for a, b in pairwise(graph.edges.tolist()))


def one_cell(label, *, thing, observations=1):
    """A map of one cell."""
    names, is_thing = ("none", label), (False, thing)
    seen = np.full((1, 1), observations, np.int32)
    height = np.full((1, 1), 0.5 if observations else np.nan, np.float32)
    grid = Grid(GridSpec(1, 1, 0.05, 0, 0), names, is_thing, np.full((1, 1), 1, np.int16), height, height, seen)
    empty = map_from_drawing(".", cells=1)
    return replace(empty, grid=grid)


def test_a_map_without_objects_says_why():
    no_things = one_cell("wall", thing=False)
    assert legend.counts_text(no_things) == ("No instances: none of the classes of its masks is countable (is_thing).")
    assert "no frame saw the floor" in legend.counts_text(one_cell("chair", thing=True, observations=0))
    small = replace(one_cell("chair", thing=True), parameters={"min_cells": 4})
    assert "none reaches the least size (4 cells)" in legend.counts_text(small)
    assert "no mask named a countable thing" in legend.counts_text(map_from_drawing("...\n..."))


@pytest.mark.parametrize("mode", texture.COLOR_MODES)
def test_a_map_of_one_cell_is_painted_and_explained(mode):
    simap = one_cell("chair", thing=True)
    assert texture.map_image(simap, mode, scale=6).shape == (6, 6, 3)
    assert legend.legend_html(simap, mode, DARK)
    assert len(texture.outline_segments(simap, 1)) == 0


def test_a_map_with_one_object():
    simap = map_from_drawing("...\n.A.\n...", {"A": "couch"})
    assert legend.counts_text(simap) == "1 couch · 1 instance" and legend.plural(3, "shelf") == "3 shelves"
    assert "the only one" in legend.facts_html(simap, simap.instances[0])


def test_the_legend_has_the_colours_of_the_map(simap):
    colors = instance_colors(simap)
    for theme in (LIGHT, DARK):
        html = legend.legend_html(simap, "instance", theme)
        for one in simap.instances:
            assert f"rgb{tuple(colors[one.id].tolist())}" in html
        assert all(f"rgb{ground}" in html for ground in (theme.wall, theme.clutter, theme.floor, theme.unseen))
    many = large_map(200, 200, 60, edges=False)
    assert "colours repeat" in legend.legend_html(many, "instance")
    assert "repeat" not in legend.legend_html(many, "class")  # ten classes


class _Gui:
    """Takes down what the help asks of a page."""

    def __init__(self):
        self.commands, self.htmls, self.themes, self.open = {}, [], [], 0

    def add_html(self, content):
        self.htmls.append(content)

    def add_button_group(self, label, options, hint=None):
        return self

    def add_button(self, label, **others):
        return self

    def on_click(self, callback):
        return callback

    def on_trigger(self, callback):
        self.commands[self.last] = callback

    def add_command(self, label, *, hotkey):
        self.last = hotkey
        return self

    def configure_theme(self, **options):
        self.themes.append(options["dark_mode"])

    def add_modal(self, title):
        self.open += 1
        return self

    def close(self):
        self.open -= 1

    def __enter__(self):
        return self

    def __exit__(self, *error):
        return None


class _Panels(dict):
    specs = (
        PanelSpec("Masks", viser.Icon.PHOTO, lambda page: Panel(), about="try a <network>"),
        PanelSpec("Mend", viser.Icon.TOOL, lambda page: Panel(), about="could not be made"),
    )
    titles = ("Map", "Command", "Build", "Instance", "Masks")


def test_keys_do_what_the_help_says():
    gui, done = _Gui(), []
    page = SimpleNamespace(
        gui=gui,
        frame=5,
        panels=_Panels({BuildPanel: SimpleNamespace(toggle=lambda: done.append("play"))}),
        may=lambda right: False,
        show_frame=done.append,
        select=done.append,
        look=done.append,
        set_theme=lambda theme: done.append(theme.name),
    )
    panel = HelpPanel(cast(Page, page))
    for key in ("space", "[", "]", "T", "3", "escape", "L", "L"):
        gui.commands[key](None)
    assert done == ["play", 4, 6, "Top view", "3-D view", None, "dark", "light"] and gui.themes == [True, False]
    gui.commands["H"](None)
    assert gui.open == 1
    html = gui.htmls[-1]
    assert "You are visiting" in gui.htmls[-2]
    assert all(f">{key}<" in html and text in html for key, text in panel.keys)
    assert "try a &lt;network&gt;" in html and all(word in html for word, _ in help.WORDS)
    assert [tab for tab, _ in panel.tabs] == [*_Panels.titles] and all(text in html for _, text in panel.tabs[:-1])
    assert "judge recorded runs" not in html and "could not be made" not in html and "undo the last edit" not in html
    gui.commands["escape"](None)
    assert gui.open == 0 and done[-1] == "light"  # the help was closed, nothing else
    assert PAGE_SCRIPT in gui.htmls and '"' not in PAGE_SCRIPT.partition('onload="')[2].rstrip('">')
