"""One session for each tab, without a browser: who shares what, what a reload brings back, what is left behind."""

import functools
import gc
import threading
import time
import weakref
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import viser
from browser import toy_services, toy_workbench
from fake_page import FakePage, fake_page, gone
from services import all_services
from toy_maps import TOY_POSE, toy_map
from waiting import until

from simaps_viz.drawing.texture import MapPicture
from simaps_viz.errors import InputError
from simaps_viz.mapping.simap import repartition
from simaps_viz.viewer import session as viewer_session
from simaps_viz.viewer.page.page import AIM_M, aimed_at
from simaps_viz.viewer.page.panel import Panel, PanelSpec
from simaps_viz.viewer.panels.build import BuildPanel
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.map import MapPanel
from simaps_viz.viewer.scene.camera import PANEL_WIDTH_PX, SLANT
from simaps_viz.viewer.server.host import Host

pytestmark = pytest.mark.slow

CHAIR_1, CHAIR_3, TABLE = 1, 3, 6
TOGETHER, APART = 5.0, 30.0
"""Percentages at which chair 1 of the toy map is whole, and in two."""


def cut(session, percent, resolution=1.0):
    """What a person does who moves the slider."""
    session.panels[MapPanel].set_sliders(percent, resolution)
    session.cut_map(percent, resolution)
    assert session.wait_idle()


# --- each page its own


def test_two_pages_have_their_own_selection_cut_view_frame_and_robot():
    with toy_workbench(all_services()) as bench, fake_page(bench) as a, fake_page(bench) as b:
        one, two = a.session, b.session
        one.select(CHAIR_3)
        cut(two, APART)
        two.look(SLANT)
        two.show_frame(1)
        one.panels[CommandPanel]._drive.speed = 8.0
        one.panels[CommandPanel].ask("turn left")
        until(lambda: one.pose.heading_deg % 360 == pytest.approx(0.0))
        assert (one.selected, two.selected) == (CHAIR_3, None)
        assert (len(one.simap.instances), len(two.simap.instances)) == (7, 9)
        assert (one.frame, two.frame) == (len(one.simap.frame_names) - 1, 1)
        assert two.pose == TOY_POSE and two.panels[CommandPanel]._past == []
        assert (one.viewpoints.name, two.viewpoints.name) == ("Top view", SLANT)


def test_what_all_ask_for_is_computed_once():
    calls = []

    def slow(simap, percent):
        calls.append(percent)
        time.sleep(0.1)
        return repartition(simap, k_percent=percent)

    with toy_workbench(replace(toy_services(), repartition=slow)) as bench:
        pages = [FakePage(bench, tells=False) for _ in range(20)]
        painted = bench.shared.pictures.computed
        for page in pages:
            page.session.panels[MapPanel].set_sliders(APART, 1.0)
            page.session.cut_map(APART, 1.0)
        assert bench.wait_idle()
        assert calls == [APART]
        assert len({id(page.session.simap) for page in pages}) == 1 and len(pages[0].session.simap.instances) == 9
        assert bench.shared.pictures.computed == painted + 1
        for page in pages:
            page.close()


def test_back_at_the_maps_own_resolution_the_map_is_as_it_was_built():
    with toy_workbench() as bench, fake_page(bench) as page:
        cut(page.session, TOGETHER, 3.0)
        assert page.session.simap.parameters["resolution"] == 3.0
        cut(page.session, TOGETHER, 1.0)
        assert page.session.simap.community is bench.simap.community
        assert (page.session.simap.instance == bench.simap.instance).all()


def test_rooms_are_outlined_and_named_when_that_is_ticked():
    with toy_workbench() as bench, fake_page(bench) as page:
        panel, scene = page.session.panels[MapPanel], page.session.scene
        panel._rooms.value = True
        panel._show_rooms(page.session.simap)
        assert [label.text for label in scene.texts["rooms"]] == [room.name for room in page.session.simap.rooms]
        assert len(scene.texts["rooms"]) == 2 and scene.nodes.get_handle_by_name("/rooms") is not None
        panel._rooms.value = False
        panel._show_rooms(page.session.simap)
        assert scene.texts["rooms"] == () and scene.nodes.get_handle_by_name("/rooms") is None


# --- loading again


def test_a_reload_brings_back_what_was_done():
    with toy_workbench(all_services()) as bench:
        page = FakePage(bench)
        session, panels = page.session, page.session.panels
        cut(session, APART, 2.0)
        changed = panels[MapPanel]._change.content
        assert "as it came" in changed
        panels[MapPanel].set_look("class", "dining table")
        panels[MapPanel]._rooms.value = True
        chosen = session.simap.of_class("dining table")[1].id
        session.select(chosen)
        session.panels[CommandPanel]._drive.speed = 8.0
        session.panels[CommandPanel].ask("turn left")
        until(lambda: session.panels[CommandPanel]._past[0].status == "ok" and not session.panels[CommandPanel].driving)
        session.show_frame(1)
        panels[BuildPanel].restore(False)
        session.look(SLANT)
        picked, instances, pose = session.picked, session.simap.instances, session.pose
        assert session.wait_idle()
        page.close()
        gone(bench, session)
        with fake_page(bench, tab=page.tab) as again:
            new = again.session
            until(lambda: new.picked == picked)
            assert again.tab == page.tab and new is not session and new.token != session.token
            assert new.simap.instances == instances and new.selected == chosen and new.frame == 1
            assert (new.panels[MapPanel].percent, new.panels[MapPanel].resolution) == (APART, 2.0)
            assert (new.panels[MapPanel].mode, new.panels[MapPanel].shown_class) == ("class", "dining table")
            until(lambda: new.panels[MapPanel]._change.visible and new.panels[MapPanel]._peek.visible)
            assert new.panels[MapPanel]._change.content == changed
            assert new.panels[MapPanel]._rooms.value
            until(lambda: new.panels[MapPanel]._rooms_shown == new.simap.rooms != ())
            assert not new.as_it_was and new.viewpoints.name == SLANT
            assert new.pose == pose and [past.command for past in new.panels[CommandPanel]._past] == ["turn left"]
            assert "Done" in new.panels[CommandPanel]._result.content
        with fake_page(bench) as other:
            assert other.session.selected is None and other.tab != page.tab


def test_a_camera_that_was_moved_comes_back():
    with toy_workbench() as bench:
        page = FakePage(bench)
        camera = page.session.client.camera
        camera.position, camera.look_at = (1.0, -7.0, 9.0), (1.0, 1.0, 0.0)
        page.close()
        gone(bench, page.session)
        with fake_page(bench, tab=page.tab) as again:
            assert tuple(again.session.client.camera.position) == (1.0, -7.0, 9.0)
            assert tuple(again.session.client.camera.look_at) == (1.0, 1.0, 0.0)


def test_a_ride_that_a_reload_ends_leaves_the_robot_where_it_was():
    with toy_workbench(all_services()) as bench:
        page = FakePage(bench)
        drive = page.session.panels[CommandPanel]._drive
        told = drive._on_pose

        def dawdle(pose, share, leg):
            if pose.x_m > 0.6:
                drive.speed = 0.02  # so that the ride is not over before the page is closed
            told(pose, share, leg)

        drive._on_pose = dawdle
        page.session.panels[CommandPanel].ask("go to the couch")
        until(lambda: page.session.pose.x_m > 0.6)
        page.close()
        gone(bench, page.session)
        with fake_page(bench, tab=page.tab) as again:
            assert again.session.pose == page.session.pose and again.session.pose.x_m > 0.6
            robot = again.session.panels[CommandPanel]
            assert "Stopped" in robot._result.content and not robot.driving


def test_a_duplicated_tab_and_an_unknown_one_start_afresh():
    with toy_workbench() as bench, fake_page(bench) as page:
        bench.tabs._leave_s = 0.1
        page.session.select(CHAIR_1)
        with fake_page(bench, tab=page.tab) as twin, fake_page(bench, tab="made up") as other:
            assert len({page.tab, twin.tab, other.tab, "made up"}) == 4
            assert twin.session.selected is None and other.session.selected is None
        assert page.session.selected == CHAIR_1


def test_a_map_published_while_a_tab_was_closed_is_not_replaced_by_an_old_one():
    with toy_workbench() as bench:
        page = FakePage(bench)
        own = repartition(toy_map(), k_percent=APART)
        page.session.take_map(own)
        page.session.select(CHAIR_3)
        page.close()
        gone(bench, page.session)
        newer = replace(toy_map())
        bench.publish(newer)
        with fake_page(bench, tab=page.tab) as again:
            assert again.session.simap is newer and again.session.selected == CHAIR_3


# --- publishing


def test_a_published_map_is_on_all_pages_and_on_later_ones():
    with toy_workbench() as bench, fake_page(bench) as a, fake_page(bench) as b:
        a.session.select(CHAIR_3)
        cut(b.session, APART)
        simap = toy_map()
        grown = replace(
            simap,
            frame_names=(*simap.frame_names, "new"),
            T_map_camera=np.concatenate([simap.T_map_camera, simap.T_map_camera[-1:]]),
        )
        b.session.show_frame(1)
        bench.publish(grown, growing=True)
        assert bench.wait_idle()
        assert a.session.simap is grown and a.session.selected == CHAIR_3
        assert (a.session.frame, b.session.frame) == (len(simap.frame_names), 1)
        assert b.session.panels[MapPanel].percent == APART and len(b.session.simap.instances) == 9
        b.session.show_frame(len(simap.frame_names))
        assert b.session.frame == len(simap.frame_names)
        a.session.publish(simap)  # as a panel does: this map, for all, cut as each has set the sliders
        assert bench.wait_idle() and bench.simap is simap
        assert a.session.simap is simap and b.session.base is simap
        assert b.session.panels[MapPanel].percent == APART and len(b.session.simap.instances) == 9
        b.session.publish(b.session.simap)  # what one cuts does not become everybody's
        assert bench.wait_idle()
        assert a.session.panels[MapPanel].percent == TOGETHER and len(a.session.simap.instances) == 7
        assert b.session.panels[MapPanel].percent == APART and len(b.session.simap.instances) == 9
        simap = bench.simap
        with fake_page(bench) as late:
            assert late.session.simap is simap


def test_a_selection_comes_back_with_its_object():
    with toy_workbench() as bench, fake_page(bench) as page:
        page.session.select(CHAIR_3)
        empty = replace(bench.simap, instance=np.zeros_like(bench.simap.instance), instances=())
        page.session.take_map(empty)
        assert page.session.wait_idle() and page.session.selected is None
        page.session.take_map(bench.simap)
        assert page.session.wait_idle() and page.session.selected == CHAIR_3


def test_what_is_selected_keeps_its_name_when_it_is_cut_and_gets_it_back_when_it_was_joined():
    with toy_workbench() as bench:
        page = FakePage(bench)
        session = page.session
        cut(session, APART)
        (scrap,) = (
            one
            for one in session.simap.instances
            if one.id != CHAIR_1 and session.base.at(*one.centroid_m[:2]) == session.base.by_id(CHAIR_1)
        )
        x, y, _ = scrap.centroid_m
        session.pick((x, y))
        assert session.selected == scrap.id
        cut(session, TOGETHER)
        assert session.selected == CHAIR_1
        cut(session, APART)
        assert session.selected == scrap.id
        cut(session, TOGETHER)
        session.pick((x, y))  # where the smaller part will be
        assert session.selected == CHAIR_1
        cut(session, APART)
        assert session.simap.at(x, y) == session.simap.by_id(scrap.id) and session.selected == CHAIR_1
        page.close()
        gone(bench, session)
        with fake_page(bench, tab=page.tab) as again:  # as it does on a page that is opened anew
            until(lambda: len(again.session.simap.instances) == 9 and again.session.wait_idle())
            assert again.session.picked == (x, y) and again.session.selected == CHAIR_1


def test_maps_that_nobody_shows_are_forgotten():
    with toy_workbench() as bench, fake_page(bench) as page:
        cut(page.session, APART)
        old = [weakref.ref(page.session.simap)]
        for _ in range(5):
            simap = replace(toy_map())
            old.append(weakref.ref(simap))
            bench.publish(simap)
            assert bench.wait_idle()
            del simap
        page.session.select(CHAIR_1)
        assert bench.wait_idle()
        gc.collect()
        assert sum(ref() is not None for ref in old) <= 2


# --- panels


@dataclass
class TalePanel(Panel):
    desk: object
    maps: list = field(default_factory=list)
    clicks: list = field(default_factory=list)
    closed: bool = False
    word: str = ""

    def map_changed(self, simap):
        self.maps.append(simap)

    def take_click(self, x_m, y_m):
        self.clicks.append((x_m, y_m))
        return len(self.clicks) == 1

    def close(self):
        self.closed = True

    def state(self):
        return self.word

    def restore(self, state):
        self.word = state


def failing(desk):
    raise InputError("this panel: expected luck, found none")


def test_panels_are_made_for_each_page_told_asked_restored_and_closed(caplog):
    made = []

    def make(desk):
        made.append(TalePanel(desk))
        return made[-1]

    panels = (
        PanelSpec("Bad", viser.Icon.BUG, failing),
        PanelSpec("Tale", viser.Icon.BOOK, make),
        PanelSpec("Beside", viser.Icon.BOOK, make),
    )
    with toy_workbench(toy_services(panels=panels)) as bench:
        page = FakePage(bench)
        tale, beside = made
        assert tale.desk is page.session and tale.maps[-1] is bench.simap
        x, y, _ = bench.simap.by_id(CHAIR_3).centroid_m
        event = viser.SceneClickEvent(page.session.client, 0, (x, y, 5.0), (0, 0, -1), (0.5, 0.5), None)
        page.session._clicked(event)
        assert page.session.selected is None and tale.clicks == [(x, y)] and beside.clicks == []
        tale.word = "kept"
        page.close()
        gone(bench, page.session)
        until(lambda: tale.closed and beside.closed)
        with fake_page(bench, tab=page.tab):
            until(lambda: made[2].word == "kept")


class DiaryPanel(Panel):
    """Writes down what it hears: all that a new panel needs is a class and a line in the registry."""

    def __init__(self, page):
        self.page, self.heard, self.note = page, [], page.gui.add_text("Note", "")

    def built(self):
        self.heard.append("built")

    def map_changed(self, simap):
        self.heard.append(("map", len(simap.instances)))

    def selection_changed(self, instance_id):
        self.heard.append(("selected", instance_id))

    def time_changed(self, frame, step):
        self.heard.append(("time", frame, step))

    def take_click(self, x_m, y_m):
        self.heard.append(("click", self.page.simap.at(x_m, y_m).id))
        return False

    def state(self):
        return self.note.value

    def restore(self, state):
        self.note.value = state

    def close(self):
        self.heard.append("closed")


def test_a_new_panel_is_one_class_and_one_line_in_the_registry(monkeypatch):
    line = PanelSpec("Diary", viser.Icon.BOOK, DiaryPanel)
    monkeypatch.setattr(viewer_session, "PANELS", (*viewer_session.PANELS, line))
    with toy_workbench() as bench:
        page = FakePage(bench)
        session, diary = page.session, page.session.panels[DiaryPanel]
        assert "Diary" in session.panels.titles and diary.heard[-1] == "built"
        cut(session, APART)
        session.show_frame(1)
        x, y, _ = session.simap.by_id(CHAIR_3).centroid_m
        session._clicked(viser.SceneClickEvent(session.client, 0, (x, y, 5.0), (0, 0, -1), (0.5, 0.5), None))
        found = session.simap.at(x, y)
        assert found is not None and session.wait_idle()
        expected = [("map", 9), ("selected", None), ("time", 1, None), ("click", found.id), ("selected", found.id)]
        assert diary.heard[-5:] == expected
        diary.note.value = "a chair"
        page.close()
        gone(bench, session)
        until(lambda: diary.heard[-1] == "closed")
        with fake_page(bench, tab=page.tab) as again:
            until(lambda: again.session.panels[DiaryPanel].note.value == "a chair")


def test_ctrl_k_lists_the_objects_of_the_map_shown_and_the_settings_of_the_tabs_there_are(monkeypatch):
    def listed(kind):
        handles = session.client.gui._command_handle_from_uuid.values()
        return {one.label: one for one in handles if (one.description or "").startswith(kind)}

    line = PanelSpec("Diary", viser.Icon.BOOK, DiaryPanel)
    monkeypatch.setattr(viewer_session, "PANELS", (*viewer_session.PANELS, line))
    with toy_workbench() as bench, fake_page(bench) as page:
        session = page.session
        assert listed("Object").keys() == {one.name for one in session.simap.instances}
        assert {"Find", "K (%)", "Frames at least", "Speed (×)", "Frame", "Note"} <= listed("Setting").keys()
        kept = listed("Object")["chair 3"]
        cut(session, APART)
        names = {one.name for one in session.simap.instances}
        assert len(names) == 9 and listed("Object").keys() == names and listed("Object")["chair 3"] is kept
        session.panels[MapPanel]._least_score.value = 0.66
        session.repaint()
        doubtful = {f"{one.name}, doubtful" for one in session.simap.instances if one.score < 0.66}
        until(lambda: {name for name in listed("Object") if "," in name} == doubtful)
        assert doubtful and len(listed("Object")) == 9
        session.panels.have([spec for spec in session.panels.specs if spec is not line])
        assert "Note" not in listed("Setting") and "Speed (×)" in listed("Setting")


def test_a_picture_lies_in_the_place_of_the_map_until_it_is_taken_away():
    with toy_workbench() as bench, fake_page(bench) as page:
        scene = page.session.client.scene
        page.session.show_picture(MapPicture(bench.simap.spec, np.full((4, 4, 4), 200, np.uint8)))
        assert page.session.wait_idle() and scene.get_handle_by_name("/picture") is not None
        page.session.show_picture(None)
        assert page.session.wait_idle() and scene.get_handle_by_name("/picture") is None


def test_a_panels_work_holds_up_neither_the_map_nor_other_panels_and_what_it_raises_is_told(monkeypatch):
    with toy_workbench() as bench, fake_page(bench) as a, fake_page(bench) as b:
        told = {session: [] for session in (a.session, b.session)}
        for session, heard in told.items():
            monkeypatch.setattr(session.client, "add_notification", lambda *text, heard=heard, **_: heard.append(text))
        gate = threading.Event()
        a.session.submit("long", functools.partial(waits_for, gate))
        a.session.select(CHAIR_3)
        assert a.session.worker.wait_idle()
        gate.set()
        a.session.submit("bad", failing_job)
        a.session.say("Saved", "as toy.npz")
        assert bench.wait_idle()
        assert ("That did not work", "x: expected y, found z") in told[a.session]
        assert ("Saved", "as toy.npz") in told[a.session] and told[b.session] == []


def waits_for(gate):
    assert gate.wait(120.0)  # longer than anybody waits for the map


def failing_job():
    raise InputError("x: expected y, found z")


# --- what is left behind


def test_nothing_is_left_of_a_dozen_pages():
    with toy_workbench(all_services()) as bench:
        before = threading.active_count()
        left = []
        for n in range(12):
            page = FakePage(bench, tells=n % 3 > 0)
            page.session.select(CHAIR_3)
            if n % 5 == 0:
                page.session.panels[CommandPanel].ask("go to the couch")
            left.append(weakref.ref(page.session))
            page.close()
            gone(bench, page.session)
            del page
        until(lambda: threading.active_count() <= before + 33)  # viser keeps up to 32 threads for all callbacks
        until(lambda: not any(t.name in ("workbench-worker", "workbench-drive") for t in threading.enumerate()))
        until(lambda: not any(isinstance(t, threading.Timer) for t in threading.enumerate()))
        until(lambda: gc.collect() >= 0 and sum(ref() is not None for ref in left) <= 1)
        assert len(bench.sessions) == 0 and len(bench.tabs) == 8
        with fake_page(bench) as page:
            assert page.session.wait_idle()


def test_twenty_pages_cost_no_thread_while_nobody_does_anything():
    with toy_workbench() as bench:
        pages = [FakePage(bench, tells=False) for _ in range(20)]
        assert bench.wait_idle()
        until(lambda: not any(t.name == "workbench-worker" for t in threading.enumerate()))
        for page in pages:
            page.close()


def test_messages_reach_the_recording_of_one_page_only(tmp_path):
    (tmp_path / "toy.rrd").write_bytes(b"")
    services = toy_services(rerun_page=lambda urls: "", recordings=(tmp_path / "toy.rrd",))
    with toy_workbench(services) as bench, fake_page(bench) as a, fake_page(bench) as b:
        host = bench.recording_host
        assert isinstance(host, Host)
        heard = {page.session: host.listen(page.session.token) for page in (a, b)}
        a.session.show_frame(2)
        assert heard[a.session].get(timeout=60.0) == {"set_time": {"timeline": "frame", "time": 2}}
        bench._recording_told({"type": "time_update", "timeline": "frame", "time": 1}, b.session.token)
        assert (a.session.frame, b.session.frame) == (2, 1)
        bench._recording_told({"type": "time_update", "timeline": "frame", "time": 3}, "nobody")
        assert heard[b.session].empty() and heard[a.session].empty()


def test_a_click_beside_an_object_or_in_a_hole_of_it_takes_the_nearest_one_a_hand_away():
    simap = toy_map()
    instance = simap.instance.copy()
    row, col = (int(np.median(part)) for part in np.nonzero(instance == 5))
    instance[row - 1 : row + 2, col - 1 : col + 2] = 0
    simap = replace(simap, instance=instance)
    hole = simap.spec.centre_of(row, col)
    assert simap.at(*hole) is None
    reach, rng = round(AIM_M / simap.spec.cell_size_m), np.random.default_rng(0)
    (xmin, ymin, xmax, ymax), cells, taken = simap.spec.extent_m, np.argwhere(instance > 0), 0
    for place in [hole, (xmin - 9.0, ymin), *rng.uniform((xmin - 0.2, ymin - 0.2), (xmax + 0.2, ymax + 0.2), (300, 2))]:
        aimed, here = aimed_at(simap, place), np.array(simap.spec.cell_of(*place))
        away = ((cells - here) ** 2).sum(axis=1)
        if away.min() == 0 or away.min() > reach**2:
            assert aimed is place
            continue
        found = np.array(simap.spec.cell_of(*aimed))
        assert instance[tuple(found)] > 0 and ((found - here) ** 2).sum() == away.min()
        taken += 1
    assert taken > 10


def test_the_recorded_build_is_as_wide_as_it_needs_where_there_is_room_and_the_map_has_most():
    widths, unfolded = [], []
    layout = object.__new__(viewer_session.Layout)
    layout._recording = cast(Any, SimpleNamespace(set_width=widths.append, expand=lambda: unfolded.append(True)))
    layout._page = cast(Any, SimpleNamespace(viewpoints=SimpleNamespace(settle=lambda width, height: None)))
    for page_px in (1280, 1920, 2140, 3840):
        layout.settle(page_px, 1080)
    assert widths == [viewer_session.RECORDING_WIDTH_PX] * 3 == [400] * 3 and len(unfolded) == 3
    assert 1920 - widths[0] - PANEL_WIDTH_PX > 0.5 * 1920
