"""Edits that come faster than they are done, and what the mending panel says of them."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest
import viser
from browser import free_port, toy_services
from fake_page import fake_page
from toy_maps import TOY_POSE, toy_map
from toy_surfaces import PLANT as HIDDEN_PLANT
from toy_surfaces import toy_with_surface

from simaps_viz.app.workbench import mending_panels
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.mending import Mending, open_mending
from simaps_viz.viewer.panels.mend import CLICKS, NEW_CLASS, UNDER, MendPanel
from simaps_viz.viewer.panels.why import WhyPanel
from simaps_viz.viewer.session import Session
from simaps_viz.viewer.workbench import Workbench

CHAIR_3, TABLE_8, PLANT_9 = 3, 8, 9
PATIENCE_S = 60.0


@dataclass(frozen=True, eq=False)
class Person:
    """Somebody who mends the toy map on a page."""

    bench: Workbench
    session: Session
    panel: MendPanel
    mending: Mending

    @property
    def edits(self) -> list[str]:
        return [entry.edit.kind for entry in self.mending.log.entries]

    @property
    def told(self) -> str:
        return self.panel._status.content

    def waits(self) -> None:
        """Wait until what was asked for is done, and the page shows what came of it."""
        assert self.session.wait_idle() and self.bench.wait_idle()

    def selects(self, instance_id: int) -> None:
        self.session.select(instance_id)
        self.waits()

    def clicks(self, x_m: float, y_m: float, *, at_the_sky: bool = False) -> None:
        ray = (x_m, y_m, 5.0), (0.0, 0.0, 1.0 if at_the_sky else -1.0)
        self.session._clicked(viser.SceneClickEvent(self.session.client, 0, *ray, (0.5, 0.5), None))
        self.waits()

    def renames(self, label: str) -> None:
        self.panel._class.value = NEW_CLASS
        self.panel._new.value = label
        self.panel.rename()

    @contextmanager
    def hurries(self) -> Iterator[None]:
        """All that is asked for inside waits until the end."""
        gate, begun = threading.Event(), threading.Event()

        def wait() -> None:
            begun.set()
            assert gate.wait(PATIENCE_S)

        self.session.submit("busy", wait)
        assert begun.wait(PATIENCE_S)
        try:
            yield
        finally:
            gate.set()
        self.waits()


@pytest.fixture
def person(tmp_path):
    save_map(toy_map(), tmp_path / "toy.npz")
    mending = open_mending(tmp_path / "toy.npz")
    services = toy_services(panels=mending_panels(mending))
    with (
        Workbench(mending.simap(), services=services, port=free_port(), start=TOY_POSE) as bench,
        fake_page(bench) as page,
    ):
        panel = page.session.panels[MendPanel]
        yield Person(bench, page.session, panel, mending)


def test_what_lies_under_other_things_is_named_and_cannot_be_mended(tmp_path):
    save_map(toy_with_surface(), tmp_path / "toy.npz")
    mending = open_mending(tmp_path / "toy.npz")
    services = toy_services(panels=mending_panels(mending))
    with (
        Workbench(mending.simap(), services=services, port=free_port(), start=TOY_POSE) as bench,
        fake_page(bench) as page,
    ):
        person = Person(bench, page.session, page.session.panels[MendPanel], mending)
        person.selects(HIDDEN_PLANT)
        assert f"potted plant {HIDDEN_PLANT} is selected. {UNDER}" in person.told and not person.panel._change.visible
        for key in (person.panel.delete, person.panel.cut, person.panel.join, person.panel.rename):
            key()
            person.waits()
            assert person.told.count(UNDER) == 2 and person.panel.waiting is None
        assert person.edits == []
        person.selects(CHAIR_3)
        assert person.panel._change.visible and UNDER not in person.told


@pytest.mark.slow
def test_as_many_edits_are_taken_back_as_were_asked_for(person):
    for label in ("bed", "sofa", "stool"):
        person.selects(CHAIR_3)
        person.renames(label)
        person.waits()
    assert person.edits == ["relabel"] * 3
    with person.hurries():
        person.panel.undo()
        person.panel.undo()
    assert person.edits == ["relabel"] and person.session.simap.counts()["bed"] == 1
    with person.hurries():
        person.panel.redo()
        person.panel.redo()
    assert person.edits == ["relabel"] * 3 and person.session.simap.counts()["stool"] == 1


def test_an_edit_is_not_lost_to_the_next_one(person):
    person.selects(PLANT_9)
    with person.hurries():
        person.panel.delete()
        person.session.select(TABLE_8)
        person.renames("desk")
    assert person.edits == ["delete", "relabel"]
    counts = person.session.simap.counts()
    assert counts["desk"] == 1 and "potted plant" not in counts


def test_what_is_gone_is_not_renamed_and_that_is_said(person):
    person.selects(PLANT_9)
    with person.hurries():
        person.panel.delete()
        person.renames("tree fern")
    counts = person.session.simap.counts()
    assert person.edits == ["delete"] and "tree fern" not in counts and "potted plant" not in counts
    assert person.panel._tone == "bad" and person.panel._words in person.told


def test_good_news_of_one_object_is_not_said_of_another(person):
    person.selects(CHAIR_3)
    person.renames("bed")
    person.waits()
    assert "Renamed." in person.told
    person.session.repaint()
    person.waits()
    assert "Renamed." in person.told
    person.selects(TABLE_8)
    assert "Renamed." not in person.told and "dining table" in person.told


def test_good_news_outlives_the_selection_that_comes_of_the_edit(person):
    person.selects(PLANT_9)
    person.panel.delete()
    person.waits()
    assert person.session.selected is None and "Deleted. Undo brings it back." in person.told
    person.selects(TABLE_8)
    assert "Deleted." not in person.told


def test_a_click_is_the_edits_before_it_is_the_comparisons_and_one_at_the_sky_is_nobodys(person, monkeypatch):
    heard = []
    monkeypatch.setattr(person.session.client, "add_notification", lambda *text, **_: heard.append(text))
    why = person.session.panels[WhyPanel]
    person.selects(CHAIR_3)
    person.panel.cut()
    why._ask(True)
    x, y, _ = person.session.simap.by_id(CHAIR_3).centroid_m
    person.clicks(x, y + 1.0, at_the_sky=True)
    assert person.session.selected == CHAIR_3 and person.panel.waiting == "cut" and why.waits_for_click()
    assert heard == [("Nothing was clicked", "That was beside the floor. Click a point on the map.")]
    person.clicks(x, y + 1.0)
    assert person.panel._how.value == CLICKS and "second point" in person.panel._words and why.waits_for_click()
    person.clicks(x, y - 1.0)
    assert person.edits == ["split"]
    person.clicks(x, y, at_the_sky=True)  # nobody waits: as a click beside the map, it selects nothing
    assert person.session.selected is None and len(heard) == 1


def offered(panel: MendPanel) -> list[str]:
    rows = (panel._change, panel._remove, panel._last)
    return [name for row in rows if row.visible for name in row.options]


def test_only_what_can_be_done_is_offered(person):
    assert offered(person.panel) == [] and person.panel._other.disabled
    person.selects(PLANT_9)
    assert offered(person.panel) == ["Rename", "Join", "Cut in two", "Delete"] and not person.panel._other.disabled
    person.panel.delete()
    person.waits()
    assert offered(person.panel) == ["Undo"]
    person.panel.undo()
    person.waits()
    assert offered(person.panel)[-1] == "Redo" and "Undo" not in offered(person.panel)
    person.selects(CHAIR_3)
    person.panel.delete()
    person.waits()
    assert offered(person.panel) == ["Undo"]
