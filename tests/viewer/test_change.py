"""What a moved slider changed: in words beside it, outlined for a moment, and undone and redone by one button."""

from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser import PATIENCE_S, free_port, toy_services
from fake_page import fake_page
from toy_maps import TOY_POSE, toy_map

from simaps_viz.drawing.legend import facts_html, legend_html
from simaps_viz.drawing.texture import cell_colors, outline_segments
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.errors import InputError
from simaps_viz.evaluation.two_maps import TRUTH, Source
from simaps_viz.mapping.simap import repartition
from simaps_viz.viewer.page.shared import keep_numbers, same_instances
from simaps_viz.viewer.panels import map as map_panel
from simaps_viz.viewer.panels.compare import MethodPanel, method_panel
from simaps_viz.viewer.panels.instance import FindBox
from simaps_viz.viewer.panels.map import FAINT, MapPanel, change_text, changed_instances, specks_on
from simaps_viz.viewer.scene.map_scene import Style
from simaps_viz.viewer.workbench import Workbench


@contextmanager
def opened(**services):
    """A page of a workbench on the toy map."""
    made = toy_services(**services)
    with Workbench(toy_map(), services=made, port=free_port(), start=TOY_POSE) as bench, fake_page(bench) as page:
        yield bench, page


def plainly_changed(before, after):
    """The instances of a map of which the other has none with the same cells: sets of cells, compared one by one."""
    cells = {one.id: frozenset(map(tuple, np.argwhere(before.instance == one.id))) for one in before.instances}
    return tuple(
        one.id
        for one in sorted(after.instances, key=lambda one: one.id)
        if frozenset(map(tuple, np.argwhere(after.instance == one.id))) not in cells.values()
    )


@pytest.mark.parametrize("k", [0.0, 3.0, 5.0, 12.0, 30.0, 60.0, 100.0])
def test_what_changed_is_what_has_other_cells(k):
    whole, cut = toy_map(), repartition(toy_map(), k_percent=k)
    for before, after in ((whole, cut), (cut, whole)):
        others, edges = changed_instances(before, after)
        assert tuple(sorted((*others, *edges))) == plainly_changed(before, after)
        assert set(edges) == set(plainly_changed(before, after)) & set(plainly_same(before, after).values())
    assert changed_instances(whole, whole) == ((), ())


def plainly_same(before, after):
    """{then: now} of the instances that overlap by more than half, pair by pair."""
    pairs = {}
    for one in before.instances:
        for other in after.instances:
            then, now = before.instance == one.id, after.instance == other.id
            if (then & now).sum() > (then | now).sum() / 2:
                pairs[one.id] = other.id
    return pairs


@pytest.mark.parametrize("k", [0.0, 12.0, 30.0, 100.0])
@pytest.mark.parametrize("seed", range(6))
def test_an_object_keeps_its_number_however_the_cut_calls_it(k, seed):
    whole, cut = toy_map(), repartition(toy_map(), k_percent=k)
    assert same_instances(whole, cut) == plainly_same(whole, cut)
    of_id = np.zeros(21, int)
    of_id[1:] = 1 + np.random.default_rng(seed).permutation(20)
    ones = tuple(replace(one, id=int(of_id[one.id])) for one in cut.instances)
    other = replace(cut, instance=of_id[cut.instance].astype(np.int32), instances=ones)
    kept = keep_numbers(other, whole)
    for then, now in plainly_same(whole, cut).items():
        assert np.array_equal(kept.instance == then, cut.instance == now)
    ids = [one.id for one in kept.instances]
    assert len(set(ids)) == len(ids) == len(cut.instances) and set(ids) == set(np.unique(kept.instance)) - {0}
    cells = {one.id: (one.label, one.cells) for one in kept.instances}
    assert all(
        (cut.by_id(int(cut.instance[kept.instance == i][0])).label, (kept.instance == i).sum()) == cells[i] for i in ids
    )


def test_the_words_name_the_classes_that_have_other_counts():
    whole, cut = toy_map(), repartition(toy_map(), k_percent=30.0)
    said = "4 chairs (3 before), 3 dining tables (2 before)"
    assert change_text(whole, cut, 4, 0) == f"{said}, 4 objects changed"
    assert change_text(whole, cut, 0, 1) == f"{said}, 1 outline is slightly different"
    assert change_text(whole, whole, 0, 0) == "nothing changed"


def test_a_moved_slider_says_what_it_changed_and_one_button_shows_before(monkeypatch):
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        whole, drawn = session.simap, []
        monkeypatch.setattr(map_panel, "OUTLINED_S", PATIENCE_S)
        monkeypatch.setattr(session.scene, "show_changed", lambda simap, ids: drawn.append((simap, tuple(ids))))
        assert not panel._change.visible and not panel._peek.visible
        session.cut_map(30.0, 1.0)
        assert session.wait_idle() and panel._change.visible
        cut = session.simap
        assert "Now: K 30 %: 4 chairs (3 before), 3 dining tables (2 before), 4 obj" in panel._change.content
        changed = changed_instances(whole, cut)[0]
        assert drawn[-1] == (cut, changed)
        # One after the other, the largest first, and around.
        assert panel._step.visible and panel._step.label == f"Show each of {len(changed)} changed objects"
        seen = []
        for number in (*range(1, len(changed) + 1), 1):
            panel._show_next()
            seen += drawn[-1][1]
            assert panel._step.label == f"{cut.by_id(seen[-1]).name} ({number} of {len(changed)}): show the next"
        sizes = [cut.by_id(i).cells for i in seen[:-1]]
        assert set(seen) == set(changed) and seen[0] == seen[-1] and sizes == sorted(sizes, reverse=True)
        assert session.selected is None  # which would open another tab
        session.select(cut.instances[0].id)
        style = Style(lit=frozenset({cut.instances[0].id}))
        assert panel.style(cut, style).lit is None  # what changed is not pale while it is outlined
        panel._cleared(cut)
        assert panel.style(cut, style).lit == style.lit and drawn[-1] == (cut, ())
        panel.peek()
        assert session.wait_idle() and np.array_equal(session.simap.instance, whole.instance) and panel.percent == 5.0
        assert "Before: K 5 %. After, K 30 %: 4 chairs (3 before)" in panel._change.content
        panel.peek()
        assert session.wait_idle() and np.array_equal(session.simap.instance, cut.instance) and panel.percent == 30.0
        session.take_map(toy_map())  # another map: nothing was changed by hand
        assert session.wait_idle() and not panel._change.visible and drawn[-1][1] == ()


def test_a_drag_that_stops_on_the_way_is_compared_with_the_map_where_it_began(monkeypatch):
    monkeypatch.setattr(map_panel, "DRAG_S", PATIENCE_S)  # however slow the machine is
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        whole = session.simap
        for k in (12.0, 30.0):  # as a slider reports a drag
            panel.set_sliders(k, 1.0)
            panel._cut()
            assert session.wait_idle()
        assert "K 30 %: 4 chairs (3 before)" in panel._change.content and panel._was is not None
        assert panel._was[0] is whole and panel._was[1].percent == 5.0
        panel._moved_s -= 2 * PATIENCE_S  # a pause: what is moved now is compared with what is shown
        panel.set_sliders(60.0, 1.0)
        panel._cut()
        assert session.wait_idle() and panel._was[1].percent == 30.0
        panel.set_sliders(30.0, 1.0)  # back where that drag began: nothing has changed
        panel._cut()
        assert session.wait_idle() and not panel._change.visible and not panel._peek.visible


def test_a_drag_goes_on_while_its_map_is_cut_however_long_that_takes(monkeypatch):
    monkeypatch.setattr(map_panel, "DRAG_S", PATIENCE_S)
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        whole, painted = session.simap, panel.painted

        def late(simap, snapshot):
            panel._moved_s -= 2 * PATIENCE_S  # it was moved so long ago
            painted(simap, snapshot)

        monkeypatch.setattr(panel, "painted", late)
        for k in (12.0, 30.0, 60.0):
            panel.set_sliders(k, 1.0)
            panel._cut()
            assert session.wait_idle()
        assert panel._was is not None and panel._was[0] is whole


def test_neighbours_are_outlined_each_for_itself():
    simap = repartition(toy_map(), k_percent=30.0)
    ids, _ = changed_instances(toy_map(), simap)
    alone = {tuple(map(tuple, np.round(line, 4))) for one in ids for line in outline_segments(simap, one)}
    assert {tuple(map(tuple, np.round(line, 4))) for line in outline_segments(simap, *ids)} == alone


def test_another_method_is_shown_on_this_page_alone_and_goes_again():
    made = replace(toy_map(), method="components")

    def make(key, simap, tell):
        if key == "evidence":
            raise InputError("no masks")
        tell("mapping", 1, 2)
        return made

    sources = tuple(Source(key, key) for key in (TRUTH, "components", "evidence"))
    maker: Any = SimpleNamespace(sources=lambda simap: sources, make=make)
    with opened(panels=(method_panel(maker),)) as (bench, page), fake_page(bench) as other:
        session, panel = page.session, page.session.panels[MethodPanel]
        assert panel._which.options == ("paper", "components", "evidence")
        for key, method in (("components", "components"), ("paper", "paper"), ("evidence", "paper")):
            panel._which.value = key
            panel._chose()
            assert panel._worker.wait_idle() and session.wait_idle()
            assert session.simap.method == panel._which.value == method and other.session.simap.method == "paper"
        assert "Not built" in panel._status.content


def test_specks_are_faint_and_not_counted_by_thresholds_that_a_person_moves(monkeypatch):
    with opened() as (_, page):
        session, panel, drawn = page.session, page.session.panels[MapPanel], []
        monkeypatch.setattr(session.scene, "show_map", lambda simap, picture, style: drawn.append(style))
        cells = sorted({one.cells for one in session.simap.instances})
        few = {one.id for one in session.simap.instances if one.cells < cells[2]}
        assert panel.specks(session.simap) == frozenset() and "7 instances" in panel._counts.content
        panel._least_cells.value = cells[2]
        session.repaint()
        assert session.wait_idle() and panel.specks(session.simap) == few
        assert f"{7 - len(few)} instances · {len(few)} speck" in panel._counts.content
        # The same number everywhere.
        chairs = session.simap.of_class("chair")
        assert {one.id for one in chairs} < specks_on(session)
        assert "one of 2, and 1 speck" in facts_html(session.simap, chairs[0], {chairs[0].id})
        assert "one of 3 specks" in facts_html(session.simap, chairs[0], specks_on(session))
        session.panels[FindBox]._box.value = "chair"
        session.panels[FindBox]._typed()
        assert "chair: 3 specks. Enter" in session.panels[FindBox]._status.content
        assert "chair <b>3</b> + 2 specks" in legend_html(session.simap, "instance", specks={"chair": 2})
        painted, colors = drawn[-1].paint
        assert np.array_equal(painted, np.flatnonzero(np.isin(session.simap.instance, list(few))))
        own = cell_colors(session.simap, "instance").reshape(-1, 3)[painted].astype(float)
        floor = np.array(LIGHT.floor)
        assert np.allclose(colors - floor, FAINT * (own - floor), atol=1.0)  # a quarter of the way from the floor
        session.select(min(few))  # what is selected is seen
        assert session.wait_idle() and not np.isin(drawn[-1].paint[0], np.flatnonzero(
            session.simap.instance == min(few))).any()  # fmt: skip
        state = panel.state()
        panel._least_cells.value = 0
        panel.restore(state)
        assert panel.specks(session.simap) == few
