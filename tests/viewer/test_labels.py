"""Texts and marks on the map, and lines that follow the zoom; where texts go, the browser decides."""

import json
import re
import threading
from dataclasses import replace
from html import unescape
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import viser
from browser import free_port
from toy_maps import toy_map

from simaps_viz.mapping.explain import between, explain
from simaps_viz.structures import Room
from simaps_viz.viewer.scene.annotations import (
    FINE_FROM_PX,
    FULL_FROM_PX,
    MIN_LINE_SHARE,
    Label,
    Texts,
    Zoom,
    label_of,
    line_share,
    seen_metres_per_px,
)
from simaps_viz.viewer.scene.map_scene import OUTLINE_PX, MapScene
from simaps_viz.viewer.scene.why_marks import MAX_NUMBERS, NODES, Marks, WhyMarks, link_label

CHAIR_1, CHAIR_3, TABLE = 1, 3, 6


def test_small_things_get_thin_lines():
    square = np.array([[[0, 0, 0], [1, 0, 0]], [[1, 0, 0], [1, 1, 0]]], float)
    assert line_share(square, 1.0 / FULL_FROM_PX) == 1.0 and line_share(square, 0.001) == 1.0
    assert line_share(square, 2.0 / FULL_FROM_PX) == pytest.approx(0.5)
    assert line_share(square, 1.0) == MIN_LINE_SHARE and line_share(square[:0], 1.0) == 1.0


def camera(height_m=10.0, rows=800, told=1.0):
    return SimpleNamespace(update_timestamp=told, image_height=rows, fov=2 * np.arctan(0.5), position=(0, 0, height_m),
                           look_at=(0, 0, 0))  # fmt: skip


def test_the_size_of_a_metre():
    assert seen_metres_per_px(camera()) == pytest.approx(10.0 / 800)
    assert seen_metres_per_px(camera(rows=2 * FINE_FROM_PX)) == pytest.approx(10.0 / FINE_FROM_PX)
    assert seen_metres_per_px(camera(told=0.0)) is None and seen_metres_per_px(camera(rows=0)) is None


class Client(viser.ClientHandle):
    """A page's camera, and nothing else."""

    def __init__(self, seen: Any) -> None:
        self.camera = seen


def test_a_zoom_tells_once_the_camera_rests_and_not_for_a_shift(monkeypatch):
    told, seen, rests, waits = threading.Semaphore(0), camera(), threading.Event(), []

    class Waits(threading.Timer):
        """Nobody has rested before the test says so, however slow the machine."""

        def __init__(self, interval: float, function: Any) -> None:
            super().__init__(interval, function)
            waits.append(self)

        def run(self) -> None:
            rests.wait(60.0)
            super().run()

    monkeypatch.setattr(threading, "Timer", Waits)
    moved: list[Any] = []
    seen.on_update = moved.append
    zoom = Zoom(Client(seen), told.release, rest_s=0.05)
    assert zoom.metres_per_px() == pytest.approx(10.0 / 800)
    seen.position, seen.look_at = (3.0, 0, 10.0), (3.0, 0, 0)
    moved[0](None)
    assert waits == [] and not told.acquire(blocking=False)
    for height_m in (9.0, 7.0, 5.0):
        seen.position = (3.0, 0, height_m)
        moved[0](None)
    early = told.acquire(blocking=False)
    rests.set()
    assert not early and len(waits) > 1 and {wait.interval for wait in waits} == {0.05}
    for wait in waits:
        wait.join(60.0)
    assert told.acquire(timeout=60.0) and not told.acquire(blocking=False)
    assert zoom.metres_per_px() == pytest.approx(5.0 / 800)


@pytest.fixture
def server():
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    yield server
    server.stop()


def node(server, name) -> Any:
    return server.scene.get_handle_by_name(name)


def test_texts_are_told_the_most_important_first_and_as_text(server):
    scene, simap = MapScene(server, toy_map()), toy_map()

    def told():
        found = re.search(r'data-texts="([^"]*)"', scene.texts._html.content)
        return [] if found is None else [row[:4] for row in json.loads(unescape(found[1]))]

    scene.show_rooms([Room(1, "<b>", "", (), 4.0, ((0, 0), (2, 0), (2, 2), (0, 2)), (1.0, 1.0), (), ())])
    scene.show_candidates([Label("1", 1.0, 2.0)])
    scene.outline(simap, CHAIR_1)
    x, y, _ = np.mean(simap.by_id(CHAIR_1).aabb_m, axis=0)
    rows = [["selection", "chair 1", pytest.approx(x), pytest.approx(y)], ["command", "1", 1.0, 2.0]]
    assert told() == [*rows, ["command", "", 0.0, 0.0], ["rooms", "<b>", 1.0, 1.0]]  # nothing stands on the robot
    scene.outline(simap, None)
    scene.show_candidates(())
    scene.show_rooms(())
    assert told() == []


def test_the_camera_of_a_frame_is_one_node_that_moves(server):
    scene = MapScene(server, toy_map())
    pose = np.eye(4)
    pose[:3, 3] = 1.0, 2.0, 1.5
    scene.show_camera(None)
    scene.show_camera(pose)
    frustum, drop = node(server, "/camera"), node(server, "/camera_dot")
    assert frustum.visible and drop.visible and tuple(frustum.position) == (1.0, 2.0, 1.5)
    assert tuple(drop.position) == (1.0, 2.0, 0.0) and tuple(drop.scale) == (1.0, 1.0, 1.5)
    pose = pose.copy()
    pose[:3, 3] = 3.0, 2.0, 1.5
    scene.show_camera(pose)
    assert node(server, "/camera") is frustum and tuple(frustum.position) == (3.0, 2.0, 1.5)
    scene.show_camera(None)
    assert not frustum.visible and not drop.visible


def test_a_badge_says_what_the_map_is_not(server):
    scene = MapScene(server, toy_map())
    scene.show_badge("")
    assert node(server, "/badge") is None
    scene.show_badge("as of frame 2 of 5")
    assert node(server, "/badge").text == "as of frame 2 of 5" and node(server, "/badge").visible
    scene.show_badge("")
    assert not node(server, "/badge").visible


def test_the_outline_is_thin_where_the_object_is_small(server, monkeypatch):
    scene = MapScene(server, toy_map())
    scene.outline(toy_map(), TABLE)
    thick = node(server, "/selection").thickness
    monkeypatch.setattr(Zoom, "metres_per_px", lambda _: 1.0)
    scene.outline(toy_map(), TABLE)
    assert node(server, "/selection").thickness == pytest.approx(OUTLINE_PX * MIN_LINE_SHARE)
    assert thick > 2 * OUTLINE_PX * MIN_LINE_SHARE


def test_the_strongest_links_are_named_beside_the_neighbour_which_stays_in_sight(server):
    simap = toy_map()
    why = explain(simap, CHAIR_1)
    marks = Marks(simap, why)
    named = link_label(marks, why.neighbours[0])
    other = why.neighbours[0].other
    assert named.text == "chair 3 · K 1.6 %"
    assert named._replace(away_x=0.0, away_y=0.0) == label_of(named.text, other) and named.reach_x > 0.0
    (x0, y0), (x1, y1) = why.neighbours[0].ends_m
    assert (named.away_x, named.away_y) == (x1 - x0, y1 - y0)  # not where the link is
    large = replace(other, aabb_m=((1.0, 0.0, 0.0), (9.0, 1.0, 1.0)))
    long = SimpleNamespace(other=large, ends_m=((0.0, 0.5), (1.0, 0.5)), score=0.1)
    at_end = link_label(marks, cast(Any, long))
    assert (at_end.x, at_end.y, at_end.reach_x, at_end.away_x > 0) == (1.0, 0.5, 0.0, True)
    texts = Texts(server)
    drawn = WhyMarks(server, texts)
    drawn.draw(marks)
    assert 0 < len(texts["why"]) <= MAX_NUMBERS and texts["why"][0].text == named.text
    drawn.draw(None)
    assert texts["why"] == () and node(server, "/why/links") is None


def test_a_step_is_drawn_alone(server):
    simap = toy_map()
    why = explain(simap, CHAIR_1)
    found = between(simap, CHAIR_1, CHAIR_3)
    drawn = WhyMarks(server, texts := Texts(server))
    drawn.draw(Marks(simap, why, True, None, found.second.id, found.link))
    assert node(server, "/why/other") is not None
    drawn.draw(Marks(simap, why, True, why.joints[0], found.second.id, found.link))
    assert {name for name in NODES if node(server, f"/why/{name}") is not None} == {"cut", "source", "target"}
    assert texts["why"] == ()
