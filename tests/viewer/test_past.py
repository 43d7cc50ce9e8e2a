"""A page that shows the past emphasises what lay where the selected object lies now, whatever number it had then."""

from dataclasses import replace

import numpy as np
import pytest
from browser import free_port, toy_services
from fake_page import fake_page
from toy_maps import TOY_POSE, toy_map

from simaps_viz.drawing.texture import outline_segments
from simaps_viz.viewer.page.shared import NO_HISTORY, ids_then
from simaps_viz.viewer.panels.build import NOTE, BuildPanel
from simaps_viz.viewer.panels.map import MapPanel
from simaps_viz.viewer.panels.share import SHARE
from simaps_viz.viewer.workbench import Workbench

CHAIR_1, CHAIR_3, TABLE = 1, 3, 6


def earlier():
    """The toy map with other numbers, its first chair still in two parts and its third not seen yet."""
    now = toy_map()
    ids = np.where(now.instance > 0, now.instance + 100, 0)
    west, _, _ = now.by_id(CHAIR_1).centroid_m
    cols = np.arange(now.spec.cols) * now.spec.cell_size_m + now.spec.x0_m
    ids[(now.instance == CHAIR_1) & (cols > west)[None, :]] = 7
    ids[now.instance == CHAIR_3] = 0
    ones = tuple(replace(one, id=one.id + 100) for one in now.instances if one.id != CHAIR_3)
    return replace(now, instance=ids.astype(np.int32), instances=ones)


@pytest.mark.parametrize(
    ("now", "then"),
    [({CHAIR_1}, {101, 7}), ({TABLE}, {106}), ({CHAIR_3}, set()), ({CHAIR_3, TABLE}, {106}), (set(), set())],
)
def test_what_lay_there_then_is_found_whatever_its_number(now, then):
    assert ids_then(earlier(), toy_map(), frozenset(now)) == then
    assert ids_then(toy_map(), toy_map(), frozenset(now)) == now


def test_the_map_of_then_is_lit_and_outlined_where_the_object_was(monkeypatch):
    past = earlier()
    services = toy_services(look_back=lambda simap, frame: past)
    with Workbench(toy_map(), services=services, port=free_port(), start=TOY_POSE) as bench, fake_page(bench) as page:
        session, drawn = page.session, []
        monkeypatch.setattr(session.scene, "show_map", lambda simap, picture, style: drawn.append((simap, style.lit)))

        def outlined():
            return session.scene._outlined

        session.select(CHAIR_1)
        assert session.wait_idle() and drawn[-1] == (session.simap, {CHAIR_1})
        whole = outline_segments(session.simap, CHAIR_1, z_m=0.012)
        session.show_frame(1)
        assert (
            session.wait_idle()
            and drawn[-1] == (past, {101, 7})
            and np.array_equal(outlined(), outline_segments(past, 7, 101, z_m=0.012))
        )
        session.select(CHAIR_3)
        assert session.wait_idle() and drawn[-1] == (past, None) and not len(outlined())
        session.select(CHAIR_1)
        session.finish()
        assert session.wait_idle() and drawn[-1] == (session.simap, {CHAIR_1})
        assert np.array_equal(outlined(), whole)


def test_a_history_that_comes_with_the_frames_is_found():
    found = []
    services = toy_services(look_back=lambda simap, frame: found[0] if found else None)
    with Workbench(toy_map(), services=services, port=free_port(), start=TOY_POSE) as bench, fake_page(bench) as page:
        panel = page.session.panels[BuildPanel]
        assert page.session.wait_idle() and NO_HISTORY in panel._note.content
        found.append(earlier())
        bench.finish(bench.simap, (SHARE,))
        assert bench.wait_idle() and NOTE in panel._note.content


@pytest.mark.parametrize("known", [True, False])
def test_whether_a_history_is_at_hand_is_said_before_anybody_goes_back(known):
    services = toy_services(look_back=lambda simap, frame: earlier() if known else None)
    with Workbench(toy_map(), services=services, port=free_port(), start=TOY_POSE) as bench, fake_page(bench) as page:
        session = page.session
        assert session.wait_idle()
        note = session.panels[BuildPanel]._note.content
        assert (NO_HISTORY in note, NOTE in note) == (not known, known)
        session.panels[MapPanel]._least_frames.value = 20  # most objects are doubtful
        session.repaint()
        assert session.wait_idle()
        counts = session.panels[MapPanel]._counts.content
        session.show_frame(1)
        assert session.wait_idle() and session.panels[BuildPanel]._note.content == note
        assert known or session.panels[MapPanel]._counts.content == counts
