"""What a moved slider changed: in words beside it, outlined for a moment, and undone and redone by one button."""

import threading
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser import PATIENCE_S, free_port, toy_services
from fake_page import fake_page
from judged_maps import drawn, map_of_ids
from toy_maps import TOY_POSE, toy_map

from simaps_viz.drawing.legend import facts_html, legend_html
from simaps_viz.drawing.texture import FAINT, cell_colors, outline_segments
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.errors import InputError
from simaps_viz.evaluation.two_maps import TRUTH, Source, compare_two
from simaps_viz.mapping.simap import repartition
from simaps_viz.viewer.page.shared import keep_numbers, paint, same_instances
from simaps_viz.viewer.panels import map as map_panel
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.compare import MethodPanel, item_text, method_panel
from simaps_viz.viewer.panels.help import HelpPanel
from simaps_viz.viewer.panels.instance import FindBox
from simaps_viz.viewer.panels.map import (
    MAX_CHANGES,
    MapPanel,
    change_text,
    changes_between,
    doubtful_on,
    show_only,
)
from simaps_viz.viewer.scene.map_scene import CHANGED, Style
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
        changes, edges = changes_between(before, after)
        both = *changes, *edges
        assert tuple(sorted(one for change in both for one in change.after)) == plainly_changed(before, after)
        assert tuple(sorted(one for change in both for one in change.before)) == plainly_changed(after, before)
        same = plainly_same(before, after)
        assert all(same[change.before[0]] == change.after[0] for change in edges)
    assert changes_between(whole, whole) == ((), ())


@pytest.mark.parametrize("k", [0.0, 12.0, 30.0, 100.0])
def test_a_change_is_one_from_either_side_in_the_words_of_a_comparison(k):
    whole, cut = toy_map(), repartition(toy_map(), k_percent=k)
    there, back = changes_between(whole, cut)[0], changes_between(cut, whole)[0]
    assert there and {(one.before, one.after, one.extent_m) for one in there} == {
        (one.after, one.before, one.extent_m) for one in back
    }
    maps = compare_two(("before", whole), ("after", cut))
    assert {one.text for one in there} == {item_text(item, maps) for item in maps.differences}
    maps = compare_two(("before", cut), ("after", whole))
    assert {one.text for one in back} == {item_text(item, maps) for item in maps.differences}


@pytest.mark.parametrize(
    ("now", "classes", "said"),
    [
        ("1111.2222", {1: "chair", 2: "chair"}, []),
        ("111..2222", {1: "chair", 2: "chair"}, []),  # another outline
        ("1111.3333", {1: "chair", 3: "chair"}, []),  # another number
        ("1111.....", {1: "chair"}, ["gone · chair 2"]),
        ("111132222", {1: "chair", 2: "chair", 3: "table"}, ["new · table 3"]),
        ("1111.2222", {1: "chair", 2: "table"}, ["label · chair 2 → table 2 · 100 % alike"]),
        ("1111.2233", {1: "chair", 2: "chair", 3: "table"}, ["split · chair 2 → chair 2 + table 3"]),
        ("111111111", {1: "chair"}, ["merged · chairs 1 + 2 → 1"]),
    ],
)
def test_every_kind_of_change_has_its_words(now, classes, said):
    before = map_of_ids(drawn("1111.2222"), {1: "chair", 2: "chair"})
    changes, edges = changes_between(before, map_of_ids(drawn(now), classes))
    assert [change.text for change in changes] == said and len(edges) == now.startswith("111.")


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
    changes, _ = changes_between(whole, cut)
    lines = [change.text for change in changes]
    assert change_text(whole.counts(), cut.counts(), changes, 0) == "\n".join(
        (f"{said}, {len(changes)} changes", *lines)
    )
    assert change_text(whole.counts(), cut.counts(), changes[:1], 0) == f"{said}, 1 change\n{lines[0]}"
    many = change_text(whole.counts(), cut.counts(), changes * 5, 1).splitlines()
    assert len(changes * 5) > MAX_CHANGES
    assert many[0].endswith("changes, 1 outline is slightly different")
    assert many[1:] == [change.text for change in changes * 5]
    assert change_text(whole.counts(), cut.counts(), (), 1) == f"{said}, 1 outline is slightly different"
    assert change_text(whole.counts(), whole.counts(), (), 0) == "nothing changed"


def test_a_moved_slider_says_what_it_changed_and_one_button_shows_before(monkeypatch):
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        whole, drawn = session.simap, []
        monkeypatch.setattr(
            session.scene, "show_changed", lambda simap, ids, *_, **__: drawn.append((simap, tuple(ids)))
        )
        assert not panel._change.visible and not panel._peek.visible
        session.cut_map(30.0, 1.0)
        assert session.wait_idle() and panel._change.visible
        cut = session.simap
        changes, _ = changes_between(whole, cut)
        said = change_text(whole.counts(), cut.counts(), changes, 0)
        assert f"Now: K 30 %, instead of K 5 % as it came: {said}<" in panel._change.content
        assert drawn[-1] == (cut, tuple(one for change in changes for one in change.after))
        # One after the other, the largest first, and around.
        assert panel._step.visible and panel._step.label == f"Show each of {len(changes)} changes"
        for number in (*range(1, len(changes) + 1), 1):
            panel._show_next()
            change = changes[number - 1]
            assert drawn[-1] == (cut, change.after)
            assert panel._step.label == f"{change.text} ({number} of {len(changes)}): show the next"
        sizes = [sum(cut.by_id(i).cells for i in change.after) for change in changes]
        assert len(sizes) > 1 and sizes == sorted(sizes, reverse=True)
        assert session.selected is None  # which would open another tab
        # What is outlined stays so until something is selected, and is not pale; Escape ends it, too.
        style = Style(lit=frozenset({cut.instances[0].id}))
        assert panel.style(cut, style).lit is None
        session.select(cut.instances[0].id)
        assert panel.style(cut, style).lit == style.lit and drawn[-1] == (cut, ())
        panel._outline_looked()
        show_only(session, None)
        assert panel.style(cut, style).lit == style.lit and drawn[-1] == (cut, ())
        panel.peek()
        assert session.wait_idle() and np.array_equal(session.simap.instance, whole.instance) and panel.percent == 5.0
        # The same change, whichever side of it is shown.
        assert f"Before: K 5 %. After, K 30 %: {said}<" in panel._change.content
        assert panel._step.label == f"{changes[0].text} (1 of {len(changes)}): show the next"
        assert drawn[-1][1] == changes[0].before
        assert panel._reset.visible and not panel._reset.disabled and panel._peek.label.startswith("Showing before")
        panel._show_next()
        assert drawn[-1][1] == changes[1].before and panel._step.label.startswith(changes[1].text)
        panel.peek()
        assert session.wait_idle() and np.array_equal(session.simap.instance, cut.instance) and panel.percent == 30.0
        assert drawn[-1][1] == changes[1].after and panel._reset.visible and not panel._reset.disabled
        assert panel._peek.label == "Before and after"
        session.take_map(toy_map())  # another map: nothing was changed by hand
        assert session.wait_idle() and not panel._change.visible and drawn[-1][1] == ()


def test_the_parts_of_a_change_have_a_colour_each_and_their_names_and_all_changes_can_be_read(monkeypatch):
    monkeypatch.setattr(map_panel, "MAX_CHANGES", 1)
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        whole = session.simap
        session.cut_map(30.0, 1.0)
        assert session.wait_idle()
        cut, (changes, _) = session.simap, changes_between(whole, session.simap)
        split = next(at for at, change in enumerate(changes) if len(change.after) > 1)
        kept, _, folded = panel._change.content.partition("<details")
        for at, change in enumerate(changes):
            assert change.text in (kept if at == 0 else folded)
        assert f"and {len(changes) - 1} more</summary>" in folded
        assert session.scene.texts["change"] == ()  # of so many the names would be everywhere
        for _ in range(split + 1):
            panel._show_next()
        parts = [cut.by_id(one) for one in changes[split].after]
        assert [label.text for label in session.scene.texts["change"]] == [one.name for one in parts]
        for name, one in zip(CHANGED, parts, strict=False):  # each around its own cells, and no others
            drawn: Any = session.client.scene.get_handle_by_name(name)
            assert np.array_equal(drawn.points[..., :2], outline_segments(cut, one.id)[..., :2])
            assert tuple(np.unique(drawn.colors.reshape(-1, 3), axis=0)[0]) == CHANGED[name]
        panel._end_outlines()
        assert session.scene.texts["change"] == ()
        assert all(session.client.scene.get_handle_by_name(name) is None for name in CHANGED)


def test_of_very_many_changes_none_is_outlined_and_the_rest_is_counted(monkeypatch):
    monkeypatch.setattr(map_panel, "MAX_CHANGES", 1)
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        changes, _ = changes_between(session.simap, repartition(session.simap, k_percent=30.0))
        assert len(changes) == 2
        for most, outlined in ((2, True), (0, False)):
            monkeypatch.setattr(map_panel, "MAX_SHOWN", most)
            panel.reset()
            assert session.wait_idle()
            session.cut_map(30.0, 1.0)
            assert session.wait_idle()
            assert any(session.client.scene.get_handle_by_name(name) is not None for name in CHANGED) == outlined
            assert ("and 1 smaller" in panel._change.content) == (not outlined)


def test_reset_while_the_map_before_is_looked_at_lets_go_of_what_was_after():
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        whole = session.simap
        panel.set_sliders(30.0, 1.0)
        panel._cut()
        assert session.wait_idle() and panel._peek.visible
        panel.peek()
        assert session.wait_idle() and not panel._reset.disabled
        panel.reset()
        assert session.wait_idle() and np.array_equal(session.simap.instance, whole.instance)
        assert not panel._peek.visible and not panel._reset.visible and panel._peek.label == "Before and after"


def test_before_and_after_follow_the_slider_also_while_the_map_is_still_being_cut():
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        session.cut_map(12.0, 1.0)
        assert session.wait_idle()
        # Looked at, and let go, before any other map is there: a short press of the key.
        for k, presses in ((12.0, 2), (30.0, 2), (60.0, 1)):
            cutting = threading.Event()
            session.worker.submit("cutting", lambda cutting=cutting: cutting.wait(PATIENCE_S))
            panel.set_sliders(k, 1.0)
            panel._cut()
            for _ in range(presses):
                panel.peek()
            cutting.set()
            assert session.wait_idle()
            if presses == 1:
                assert panel.percent == 5.0 and f"Before: K 5 %. After, K {k:g} %:" in panel._change.content
                panel.peek()
                assert session.wait_idle()
            assert panel.percent == k and panel._shown_cut.percent == k
            assert f"Now: K {k:g} %, instead of K 5 % as it came" in panel._change.content
            assert panel._peek.label == "Before and after"


def test_an_object_of_another_class_ends_one_shown_alone_and_escape_shows_all():
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        chair, couch = (session.simap.of_class(label)[0].id for label in ("chair", "couch"))
        panel.show_only("chair")
        session.select(chair)
        assert panel.shown_class == "chair"
        session.select(couch)
        assert panel.shown_class is None and session.selected == couch
        panel.told({"type": "class", "name": "couch", "do": "fade"})
        assert panel.faded == {"couch"}
        session.panels[HelpPanel]._escape()
        assert session.wait_idle() and not panel.faded and session.selected is None
        assert panel.style(session.simap, Style()).lit is None


def test_moved_again_and_again_it_is_compared_with_the_map_as_it_came():
    with opened() as (_, page):
        session, panel = page.session, page.session.panels[MapPanel]
        whole = session.simap
        for k in (12.0, 30.0, 60.0, 30.0):
            panel.set_sliders(k, 1.0)
            panel._cut()
            assert session.wait_idle()
            assert panel._was is not None and panel._was[0] is whole and panel._was[1].percent == 5.0
        assert "K 30 %, instead of K 5 % as it came: 4 chairs (3 before)" in panel._change.content
        panel.peek()
        assert session.wait_idle()
        panel.set_sliders(60.0, 1.0)  # moved while the map before is looked at
        panel._cut()
        assert session.wait_idle() and panel._was[0] is whole and "Now: K 60 %" in panel._change.content
        panel.set_sliders(5.0, 1.0)  # back where it was: nothing has changed
        panel._cut()
        assert session.wait_idle() and not panel._change.visible and not panel._peek.visible


def test_neighbours_are_outlined_each_for_itself():
    simap = repartition(toy_map(), k_percent=30.0)
    changes, _ = changes_between(toy_map(), simap)
    ids = [one for change in changes for one in change.after]

    def edges(*of: int) -> set[tuple[float, ...]]:
        """Return the middles of the edges of cells that the lines follow."""
        size, found = simap.spec.cell_size_m, set()
        for start, end in outline_segments(simap, *of):
            count = round(float(np.abs(end - start).sum()) / size)
            found |= {tuple(np.round(start + (end - start) * (k + 0.5) / count, 3).tolist()) for k in range(count)}
        return found

    assert edges(*ids) == set().union(*(edges(one) for one in ids))


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


def test_what_is_doubtful_is_faint_and_not_counted_by_thresholds_that_a_person_moves(monkeypatch):
    with opened() as (_, page):
        session, panel, drawn = page.session, page.session.panels[MapPanel], []
        monkeypatch.setattr(session.scene, "show_map", lambda simap, picture, style: drawn.append(style))
        cells = sorted({one.cells for one in session.simap.instances})
        few = {one.id for one in session.simap.instances if one.cells < cells[2]}
        assert panel.doubtful(session.simap) == frozenset() and "7 instances" in panel._counts.content
        panel._least_cells.value = cells[2]
        session.repaint()
        assert session.wait_idle() and panel.doubtful(session.simap) == few
        assert f"{7 - len(few)} instances, {len(few)} more doubtful" in panel._counts.content
        # The same number everywhere.
        chairs = session.simap.of_class("chair")
        assert {one.id for one in chairs} < doubtful_on(session)
        assert "one of 2, 1 more doubtful" in facts_html(session.simap, chairs[0], {chairs[1].id})
        two = {chairs[1].id, chairs[2].id}
        assert "the only one; 2 more doubtful" in facts_html(session.simap, chairs[0], two)
        assert "doubtful: seen too little" in facts_html(session.simap, chairs[0], doubtful_on(session))
        said = session.panels[CommandPanel]._of_them_doubtful([one.id for one in chairs])
        assert said == "Of these 3 chairs, 3 are doubtful."
        session.panels[FindBox]._box.value = "chair"
        session.panels[FindBox]._typed()
        assert "chair: 3 doubtful." in session.panels[FindBox]._status.content
        assert "chair <b>2</b> + 1 doubtful" in legend_html(session.simap, "instance", doubtful={chairs[0].id})
        assert drawn[-1].faint == few and drawn[-1].paint is None
        floor, there = np.array(LIGHT.floor), np.isin(session.simap.instance, list(few))
        bare, picture = (
            paint(session.simap, "instance", None, None, faint=faint) for faint in (frozenset(), frozenset(few))
        )
        scale = len(picture) // len(there)
        assert scale > 2
        whole, faint = (one.reshape(len(there), scale, -1, scale, 3).swapaxes(1, 2) for one in (bare, picture))
        assert np.array_equal(whole[~there], faint[~there]) and not np.array_equal(whole, faint)
        colors = faint[there].reshape(-1, scale**2, 3)  # without rims
        whole = cell_colors(session.simap, "instance")[there].astype(float)[:, None]
        assert np.allclose(colors - floor, FAINT * (whole - floor), atol=1.0)  # a quarter of the way from the floor
        session.select(min(few))  # what is selected is seen
        assert session.wait_idle() and min(few) in drawn[-1].lit and drawn[-1].faint == few - drawn[-1].lit
        state = panel.state()
        panel._least_cells.value = 0
        panel.restore(state)
        assert panel.doubtful(session.simap) == few
