"""How often a build that is watched is shown: by what it costs, on a clock of the test's own."""

import threading
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import viser
from browser import free_port
from toy_maps import toy_map

from simaps_viz.app import live as live_pace
from simaps_viz.app.live import Pace
from simaps_viz.drawing.texture import CAMERA, sketch_png
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.viewer.panels import live
from simaps_viz.viewer.panels.live import LivePanel, LiveState


def shown_at(*, frame_s: float, making_s: float, slowed_s: float, whole_s: float, left: bool = False) -> list[float]:
    """Run a build: a frame every so often; after something is shown, drawing it takes ``slowed_s`` from the build."""
    pace, now, debt, shown = Pace(), 100.0, 0.0, []
    pace.begin(now)
    while now < 100.0 + whole_s:
        paid = min(debt, frame_s)  # at half its rate until the drawing is done
        debt -= paid
        now += frame_s + paid
        pace.arrive(now)
        if pace.has_time(now, 100.0 + whole_s - now if left else None):
            began, now = now, now + making_s
            pace.shown(began, now)
            debt = slowed_s
            shown.append(began - 100.0)
    return shown


def test_a_build_that_is_soon_over_is_not_held_up():
    assert shown_at(frame_s=0.005, making_s=0.05, slowed_s=0.3, whole_s=0.95) == []
    assert shown_at(frame_s=0.005, making_s=0.05, slowed_s=0.3, whole_s=1.6, left=True) == []


def test_what_costs_nothing_is_shown_as_often_as_it_is_watched():
    shown = shown_at(frame_s=0.005, making_s=0.0, slowed_s=0.0, whole_s=20.0)
    steps = np.diff(shown)
    assert shown[0] == pytest.approx(live_pace.FIRST_S, abs=0.02)
    assert steps.max() < live_pace.WATCHED_S + 0.05 and steps.min() >= live_pace.WATCHED_S


@pytest.mark.parametrize(("making_s", "slowed_s"), [(0.05, 0.1), (0.1, 0.3), (0.3, 0.0), (0.02, 0.4)])
@pytest.mark.parametrize("frame_s", [0.004, 0.03])
def test_the_build_loses_the_share_that_was_meant_and_no_more(making_s, slowed_s, frame_s):
    shown = shown_at(frame_s=frame_s, making_s=making_s, slowed_s=slowed_s, whole_s=60.0)
    lost = len(shown) * (making_s + slowed_s) / 60.0
    assert 0.6 * live_pace.SHARE < lost < 1.25 * live_pace.SHARE


def test_a_machine_that_is_slow_for_another_reason_still_shows_something():
    pace = Pace()
    pace.begin(0.0)
    now, shown = 0.0, []
    for index in range(4000):
        now += 0.005 if index < 300 else 0.05  # from here on others have the machine
        pace.arrive(now)
        if pace.has_time(now):
            pace.shown(now, now)
            shown.append(now)
    assert len(shown) > 10 and np.diff(shown).max() < live_pace.MAX_WAIT_S + live_pace.WATCHED_S + 0.2


def test_slow_frames_are_shown_nearly_all_where_showing_them_costs_little():
    assert len(shown_at(frame_s=5.0, making_s=0.05, slowed_s=0.1, whole_s=100.0)) >= 9


def test_a_sketch_has_north_up_the_classes_the_camera_and_nothing_where_nobody_looked():
    simap = toy_map()
    grid, spec = simap.grid, simap.spec
    data = sketch_png(grid, np.array(spec.centre_of(0, 0)))
    picture = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))
    assert picture.shape[:2] == spec.shape
    rgba = cv2.cvtColor(picture, cv2.COLOR_BGRA2RGBA)[::-1]
    assert tuple(rgba[0, 0]) == (*CAMERA, 255)
    far = np.ones(spec.shape, bool)
    far[:8, :8] = False  # the dot
    assert np.array_equal(rgba[..., 3][far] == 0, np.isnan(grid.height_m)[far])
    one = simap.instances[0]
    colors = np.unique(rgba[(simap.instance == one.id) & far], axis=0)
    assert len(colors) == 1 and tuple(colors[0][:3]) not in (LIGHT.floor, LIGHT.clutter)


def test_the_tab_of_a_build_may_go_while_its_numbers_are_brought_up_to_date(monkeypatch):
    monkeypatch.setattr(live, "EVERY_S", 0.01)
    server = viser.ViserServer(port=free_port(), verbose=False)
    tab = server.gui.add_tab_group().add_tab("Progress")
    asked, ready, others = [], threading.Event(), set(threading.enumerate())

    def state() -> LiveState:
        assert not asked or ready.wait(60.0)
        asked.append(1)
        if len(asked) == 3:  # as when the build is done: the panel is closed, then its tab goes
            panel.close()
            tab.remove()
        return LiveState(total=9, done=len(asked))

    desk: Any = SimpleNamespace(gui=server.gui, may=lambda right: True)
    with tab:
        panel = LivePanel(desk, state, lambda: None, lambda: None)
    (mine,) = (one for one in set(threading.enumerate()) - others if one.name == "workbench-live")
    ready.set()
    mine.join(60.0)
    server.stop()
    assert not mine.is_alive() and len(asked) == 3
