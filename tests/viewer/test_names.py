"""Objects named shortly, "chair 7", whatever their class is called."""

import re
from dataclasses import replace
from html import escape
from types import SimpleNamespace
from typing import cast

import viser
from browser import free_port
from toy_maps import toy_map

from simaps_viz.drawing.legend import object_names
from simaps_viz.mapping.explain import explain
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.panels.help import WORDS
from simaps_viz.viewer.panels.why import ASK, WHY_WORDS, WhyPanel, joint_name, lines_legend, words_html
from simaps_viz.viewer.scene.annotations import Texts
from simaps_viz.viewer.scene.why_marks import Marks, link_label

CHAIR_1 = 1
CLASS = "chest of drawers"


def of_drawers() -> SIMap:
    """The toy map, whose chairs are called otherwise."""
    simap = toy_map()
    labels = tuple(CLASS if label == "chair" else label for label in simap.grid.labels)
    instances = tuple(replace(one, label=CLASS) if one.label == "chair" else one for one in simap.instances)
    return replace(simap, grid=replace(simap.grid, labels=labels), instances=instances)


def test_a_short_name_keeps_all_of_the_class():
    simap = of_drawers()
    names = [one.name for one in simap.of_class(CLASS)]
    assert names == [f"{CLASS} {n}" for n in (1, 3, 4)]
    assert {*names} < {*object_names(simap)} and [*object_names(simap, 2)] == ["couch 5", "dining table 6"]


def test_a_link_names_the_neighbour_whole():
    simap = of_drawers()
    why = explain(simap, CHAIR_1)
    assert link_label(Marks(simap, why), why.neighbours[0]).text == f"{CLASS} 3 · K 1.6 %"


def test_scores_are_bars_against_the_threshold_and_steps_are_told_in_words():
    simap = toy_map()
    why = explain(simap, CHAIR_1)
    html = lines_legend(simap, why)
    # The weakest joint, 25 %, is the longest; K = 5 % is a fifth of it, and chair 3, which is apart, 1.5625 %.
    assert re.findall(r"width:([\d.]+)%", html) == ["100.0", "6.2"]
    assert re.findall(r"auto -.2em ([\d.]+)%", html) == ["20.0", "20.0"]
    assert html.index("One object above K = 5 %") < html.index("weakest joint") < html.index("chair 3")
    assert joint_name(why, 1) == f"Step 1 of {len(why.joints)}: 32 and 32 cells, 25.0 %, weakest"
    less = replace(why.joints[0], source_cells=1, score=0.1)  # a small piece, in the list of steps
    why = replace(why, joints=(less, *why.joints))
    assert "weakest of the larger parts</div>" in lines_legend(simap, why) and "weakest" not in joint_name(why, 1)
    assert joint_name(why, 2).endswith(", weakest of the larger parts")


def test_the_words_of_the_section_are_explained_those_of_the_method_alone():
    known = dict(WORDS)
    for method, word, others in (("paper", "K (%)", "Evidence (%)"), ("evidence", "Evidence (%)", "K (%)")):
        html = words_html(replace(toy_map(), method=method))
        assert all(f"<b>{one}</b>: {escape(known[one])}" in html for one in (*WHY_WORDS, word)) and others not in html
    assert "Joint" not in words_html(replace(toy_map(), method="components"))


def test_every_neighbour_has_a_button():
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    try:
        simap = of_drawers()
        why = explain(simap, CHAIR_1)
        twice = replace(why.neighbours[0], other=simap.of_class(CLASS)[2])  # the same number for another one
        page = SimpleNamespace(gui=server.gui, client=server, scene=SimpleNamespace(texts=Texts(server)))
        panel = WhyPanel(cast(Page, page))
        panel._fill(simap, replace(why, neighbours=(why.neighbours[0], twice)))
        assert [*panel._near.options][:2] == [f"{CLASS} 3 · K 1.6 %", f"{CLASS} 4 · K 1.6 %"]
        assert list(panel._apart_of.values()) == [one.id for one in simap.of_class(CLASS)[1:]]
    finally:
        server.stop()


def test_what_was_said_of_an_object_goes_when_another_is_selected():
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    try:
        simap, asked = of_drawers(), []
        worker = SimpleNamespace(submit=lambda name, work: asked.append(name))
        texts = SimpleNamespace(texts=Texts(server))
        page = SimpleNamespace(gui=server.gui, client=server, scene=texts, worker=worker, simap=simap)
        panel = WhyPanel(cast(Page, page))
        panel.why = explain(simap, CHAIR_1)
        panel._fill(simap, panel.why)
        panel.selection_changed(CHAIR_1)  # the same one, as after a slider moved
        assert panel._lines_legend.content and len(panel._near.options) > 1
        panel.selection_changed(simap.of_class(CLASS)[1].id)
        assert asked == ["why", "why"] and not panel._lines_legend.content and panel._near.options == (ASK,)
        assert not panel._step.visible and not panel._rows.visible and "Explaining" in panel._apart.content
    finally:
        server.stop()
