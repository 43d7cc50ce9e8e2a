"""While a picture lies in the place of the map, nothing of the map's own stands on it; later all is there again."""

import threading

import numpy as np
import pytest
import viser
from browser import free_port, toy_workbench
from fake_page import fake_page
from toy_maps import toy_map

from simaps_viz.drawing.texture import MapPicture
from simaps_viz.drawing.theme import DARK
from simaps_viz.mapping.explain import explain
from simaps_viz.viewer.panels.why import WhyPanel
from simaps_viz.viewer.scene import map_scene as scene_module
from simaps_viz.viewer.scene import why_marks
from simaps_viz.viewer.scene.annotations import Texts
from simaps_viz.viewer.scene.camera import SLANT, TOP
from simaps_viz.viewer.scene.map_scene import MapScene
from simaps_viz.viewer.scene.why_marks import Marks, WhyMarks

CHAIR_1, TABLE = 1, 6
PATIENCE_S = 60.0
LOOKS_S = 0.2
"""So long a thread that may go on is given to do so, where it is not to."""
OWN = ("/robot", "/selection", "/why/cut", "/why/links", "/camera")
"""Marks on a map of any time; those of a command are on the finished map alone."""
OF_A_COMMAND = ("/path", "/target")


def shown(session, name: str) -> bool:
    """Whether a node is there, and neither it nor what it stands below is hidden."""
    parts = name.split("/")
    above = ["/".join(parts[:n]) for n in range(2, len(parts) + 1)]
    handles = [session.client.scene.get_handle_by_name(one) for one in above]
    return all(handle is not None and handle.visible for handle in handles)


def blocks(session) -> int:
    nodes = list(session.client.scene._handle_from_node_name)
    return sum(name.startswith("/blocks/") for name in nodes)


def cover(session, on: bool) -> None:
    spec = session.simap.spec
    session.show_picture(MapPicture(spec, np.full((4, 4, 4), 200, np.uint8)) if on else None)
    assert session.wait_idle()


@pytest.fixture
def session():
    with toy_workbench() as bench, fake_page(bench) as page:
        yield page.session


def test_blocks_give_way_to_a_picture_and_come_back(session):
    session.look(SLANT)
    assert session.wait_idle() and blocks(session) > 0
    cover(session, True)
    assert blocks(session) == 0
    session.repaint()
    session.look(SLANT)
    session.select(CHAIR_1)
    assert session.wait_idle() and blocks(session) == 0
    cover(session, False)
    assert blocks(session) > 0
    cover(session, True)
    session.look(TOP)
    cover(session, False)
    assert blocks(session) == 0


def test_blocks_that_a_picture_overtakes_are_not_built(session, monkeypatch):
    made, gate = threading.Event(), threading.Event()

    def slow(*_):
        made.set()
        assert gate.wait(PATIENCE_S)
        return real(*_)

    real = scene_module.solids
    monkeypatch.setattr(scene_module, "solids", slow)
    standing = threading.Thread(target=session.scene.stand_up, args=(True,))
    standing.start()
    assert made.wait(PATIENCE_S)
    cover(session, True)
    gate.set()
    standing.join(PATIENCE_S)
    assert blocks(session) == 0
    cover(session, False)
    assert blocks(session) > 0


def test_all_marks_are_hidden_whatever_draws_them_anew_and_come_back(session):
    scene = session.scene
    scene.show_path(np.array([[0.0, 0.0], [1.0, 0.5]]))
    scene.show_target(np.array([[[0.0, 0.0, 0.0], [1.0, 0.5, 0.0]]]))
    assert session.wait_idle() and all(shown(session, name) for name in OF_A_COMMAND)
    cover(session, True)
    scene.show_path(np.array([[0.0, 0.0], [2.0, 0.5]]))
    assert not any(shown(session, name) for name in OF_A_COMMAND)
    cover(session, False)
    assert all(shown(session, name) for name in OF_A_COMMAND)
    session.select(CHAIR_1)
    session.show_frame(1)
    assert session.wait_idle() and all(shown(session, name) for name in OWN)
    cover(session, True)
    assert not any(shown(session, name) for name in OWN)
    scene._zoomed()
    session.panels[WhyPanel]._marks._draw_lines()  # as after a zoom
    scene.show_path(np.array([[0.0, 0.0], [2.0, 0.5]]))
    scene.show_target(np.array([[[0.0, 0.0, 0.0], [2.0, 0.5, 0.0]]]))
    session.show_frame(2)
    session.set_theme(DARK)
    session.select(CHAIR_1)
    assert session.wait_idle() and not any(shown(session, name) for name in OWN)
    cover(session, False)
    assert all(shown(session, name) for name in OWN)


def test_the_camera_of_a_frame_comes_back_where_it_is_then(session):
    camera = "/camera"
    session.show_frame(1)
    cover(session, True)
    assert not shown(session, camera)
    cover(session, False)
    assert shown(session, camera)
    place = session.client.scene.get_handle_by_name(camera).position
    assert tuple(place) == pytest.approx(tuple(session.simap.T_map_camera[1][:3, 3]))
    cover(session, True)
    session.show_frame(len(session.simap.frame_names) - 1)
    cover(session, False)
    assert not shown(session, camera)


@pytest.fixture
def server():
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    yield server
    server.stop()


class OneAtATime:
    """In the place of ``draw_lines``: while the first who draws is at it, another thread begins to draw too.

    Pages of earlier tests that are still closing draw in scenes of their own, which are none of its business.
    """

    def __init__(self, scene, other) -> None:
        self._scene = scene
        self.drew: list[int] = []
        self._other = threading.Thread(target=other)
        self._begun = self._over = False

    def __call__(self, scene, *_, **__) -> None:
        if scene is not self._scene:
            return
        self.drew.append(threading.get_ident())
        if not self._begun:
            self._begun = True
            self._other.start()
            self._other.join(LOOKS_S)
            self._over = True
        assert self._over, "two threads draw at once"

    def end(self) -> bool:
        self._other.join(PATIENCE_S)
        return not self._other.is_alive() and len(set(self.drew)) == 2


def test_a_zoom_waits_until_an_explanation_is_drawn(server, monkeypatch):
    simap = toy_map()
    marks = WhyMarks(server, Texts(server))
    marks.draw(Marks(simap, explain(simap, TABLE)))
    draw = OneAtATime(server.scene, marks._draw_lines)
    monkeypatch.setattr(why_marks, "draw_lines", draw)
    marks.draw(Marks(simap, explain(simap, CHAIR_1)))
    assert draw.end()


@pytest.mark.parametrize("change", ["outline", "theme"])
def test_a_zoom_waits_until_an_outline_is_drawn(server, monkeypatch, change):
    scene = MapScene(server, toy_map())
    scene.outline(toy_map(), TABLE)
    draw = OneAtATime(server.scene, scene._zoomed)
    monkeypatch.setattr(scene_module, "draw_lines", draw)
    if change == "outline":
        scene.outline(toy_map(), CHAIR_1)
    else:
        scene.set_theme(DARK)
    assert draw.end()
