"""The list of errors, and of what may be wrong where nobody knows the truth."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import viser
from browser import free_port
from toy_maps import toy_map

from simaps_viz.app.workbench import truth_beside
from simaps_viz.evaluation.two_maps import TRUTH, MapMaker, Source, compare_two
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.simap import repartition
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.panels import errors
from simaps_viz.viewer.panels.errors import (
    DOUBTS,
    ERRORS,
    LEAST_SURE,
    OFFER,
    UNKNOWN,
    ErrorsPanel,
    doubt_entries,
    error_entry,
)


def test_a_truth_that_lies_beside_the_map_is_offered_without_frames(tmp_path):
    simap, path = toy_map(), tmp_path / "toy.npz"
    assert MapMaker(None, tmp_path, truth_beside(path)).sources(simap) == ()
    save_map(repartition(simap, k_percent=30.0), tmp_path / "toy-truth.npz")
    maker = MapMaker(None, tmp_path, truth_beside(path))
    assert [source.key for source in maker.sources(simap)] == [TRUTH]
    truth = maker.make(TRUTH, simap, lambda *what: None)
    assert len(truth.instances) > len(simap.instances)


def test_errors_name_objects_of_the_map_and_what_is_true():
    truth = toy_map()
    true_chair = truth.of_class("chair")[-1]
    instance = np.where(truth.instance == true_chair.id, 0, truth.instance)
    kept = tuple(one for one in truth.instances if one.id != true_chair.id)
    simap = replace(repartition(truth, k_percent=0.0))
    found = compare_two(("This map", simap), ("The truth", truth), truth="right")
    entries = [error_entry(item, found.left, found.right) for item in found.differences]
    assert any("really 2" in one.title and one.selects is not None and len(one.true) == 2 for one in entries)
    fewer = replace(truth, instance=instance, instances=kept)
    found = compare_two(("This map", fewer), ("The truth", truth), truth="right")
    (one,) = [error_entry(item, found.left, found.right) for item in found.differences]
    assert one.title == "chair missing here" and one.selects is None and one.true == (true_chair.id,)
    x, y, _ = true_chair.centroid_m
    assert one.extent_m[0] < x < one.extent_m[2] and one.extent_m[1] < y < one.extent_m[3]


def test_what_is_doubtful_is_not_listed_as_an_error():
    simap = toy_map()
    few = replace(simap, instances=tuple(replace(one, frames=1, score=0.1) for one in simap.instances))
    listed = doubt_entries(few, frozenset())
    assert {one.selects for one in listed} == {one.id for one in few.instances}
    glance = few.instances[0].id
    assert {one.selects for one in doubt_entries(few, frozenset({glance}))} == {
        one.id for one in few.instances if one.id != glance
    }


@pytest.mark.parametrize(("known", "has_truth"), [(False, False), (True, False), (True, True)])
def test_errors_come_first_where_a_truth_is_known_and_what_is_likely_is_offered(monkeypatch, known, has_truth):
    simap, jobs, made = toy_map(), [], []

    def make(key, simap, tell):
        made.append(key)
        tell("truth", 1, 4)
        return simap

    sources = (Source(TRUTH, "Ground truth"),) if known else ()
    maker = SimpleNamespace(has_truth=has_truth, sources=lambda _: sources, make=make)
    monkeypatch.setattr(errors, "doubtful_on", lambda page: frozenset())
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    try:
        page = SimpleNamespace(gui=server.gui, simap=simap, panels=(), submit=lambda _, job: jobs.append(job))
        panel = ErrorsPanel(cast(Page, page), cast(MapMaker, maker))
        panel.map_changed(simap)
        panel.told({"type": "tabs", "open": ["Map"]})
        assert not jobs  # nobody looks at it
        panel.told({"type": "tabs", "open": ["Errors"]})
        jobs.pop()()
        panel.told({"type": "tabs", "open": ["Map"]})
        panel.told({"type": "tabs", "open": ["Errors"]})
        assert not jobs  # it is there
        assert panel._which.value == (ERRORS if known else DOUBTS)
        assert made == ([TRUTH] if known else [])
        said = panel._about.content
        assert (UNKNOWN.strip() in said, LEAST_SURE in said) == (not known, not known) and (OFFER in said) == known
        if known:
            assert "0 errors" in panel._about.content and "known" in panel._about.content
    finally:
        server.stop()


def test_the_list_marks_where_errors_end_and_what_a_slider_has_to_do_with_one(monkeypatch):
    simap, cells = repartition(toy_map(), k_percent=0.0), toy_map().instance.copy()
    cells[tuple(np.argwhere(cells == 5)[0])] = 0  # its outline is not quite right, which is no error
    truth = replace(toy_map(), instance=cells)
    found = compare_two(("This map", simap), ("The truth", truth), truth="right")
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    monkeypatch.setattr(errors, "doubtful_on", lambda page: frozenset())
    change = SimpleNamespace(change_of=lambda ids: ("K 0 %", "merged · chairs 1 + 2 → 1"))
    try:
        panels = {errors.MapPanel: change}
        page = SimpleNamespace(gui=server.gui, simap=simap, panels=panels, submit=lambda _, job: job())
        maker = SimpleNamespace(has_truth=True, sources=lambda _: (Source(TRUTH, "Truth"),), make=lambda *_: truth)
        errors_of = [one for one in found.items if one in found.differences]
        panel = ErrorsPanel(cast(Page, page), cast(MapMaker, maker))
        panel._list_now()
        assert len(errors_of) < len(panel._entries)
        for one in panel._entries:
            assert one.title.endswith(", by K 0 %") == one.wrong and ("merged ·" in one.more) == one.wrong
            # An error counts what is large enough to be one, the slider all that it changed.
            assert (
                one.more.endswith("What K 0 % changed here, small pieces too: merged · chairs 1 + 2 → 1.") == one.wrong
            )
        before = [row for row in panel._rows if row.visible and row.order < panel._end.order]
        assert panel._end.visible and len(before) == len(errors_of)
        every, wrong = len(panel._entries), len(errors_of)
        assert f"1 to {every} of {every} not exact: {wrong} error, the other {every - wrong} right or very small." in (
            panel._place.content
        )
    finally:
        server.stop()


def test_what_is_shown_of_an_entry_goes_with_its_list(monkeypatch):
    simap = replace(toy_map(), instances=tuple(replace(one, frames=1, score=0.1) for one in toy_map().instances))
    server, selected, drawn = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False), [], []
    monkeypatch.setattr(errors, "doubtful_on", lambda page: frozenset())
    try:
        scene = SimpleNamespace(show_changed=lambda simap, ids: drawn.append(tuple(ids)))
        page = SimpleNamespace(
            gui=server.gui, simap=simap, panels={}, select=selected.append, finish=lambda: None, scene=scene,
            submit=lambda name, job: job() if name == "errors" else None,
            viewpoints=SimpleNamespace(look_at=lambda extent: None),
        )  # fmt: skip
        maker = SimpleNamespace(has_truth=False, sources=lambda _: (), make=None)
        panel = ErrorsPanel(cast(Page, page), cast(MapMaker, maker))
        panel._list_now()
        assert len(panel._entries) > errors.LISTED
        rows = panel._rows
        for at in (4, 0, 2):  # the buttons for other pages stay where they are, and what is said of a row is below it
            panel._choose(at)
            assert panel._pages.order < rows[0].order
            assert panel._more.visible and rows[at].order < panel._more.order < rows[at + 1].order
        panel._leave_entry()
        for leave in (lambda: panel._turn(1), lambda: panel._turn(-1), panel._list_other):
            panel._choose(0)
            assert selected[-1] == panel._entries[panel._first].selects
            assert panel._entries[panel._first].more in panel._more.content
            leave()
            assert selected[-1] is None and drawn[-1] == () and panel._chosen == -1
            assert not panel._more.visible and not any("▸" in row.label for row in panel._rows)
        # The map, whose views would be faded for what is selected, is seen as a whole again; other tabs are about it.
        panel.told({"type": "tabs", "open": ["Errors", "Recorded build"]})
        panel._choose(1)
        panel.told({"type": "tabs", "open": ["Mend", "Recorded build"]})
        assert selected[-1] == panel._entries[panel._first + 1].selects and panel._chosen >= 0
        panel.told({"type": "tabs", "open": ["Errors", "Recorded build"]})
        panel.told({"type": "tabs", "open": ["Map", "Recorded build"]})
        assert selected[-1] is None and not panel._more.visible
        panel._choose(0)
        panel._turn(-1)  # the first page is shown
        assert panel._chosen == 0
    finally:
        server.stop()
