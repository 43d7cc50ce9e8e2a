"""The 3-D view of a map with voxels, on a page that nobody draws: its nodes, the cut, clicks, and lists."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from browser import free_port, toy_services
from fake_page import fake_page
from toy_maps import TOY_POSE
from toy_surfaces import PLANT, toy_with_surface

from simaps_viz.drawing.surface import WALL_CUT_M
from simaps_viz.drawing.texture import MapPicture, cell_colors, map_image, pixels_per_cell
from simaps_viz.viewer.page.shared import png
from simaps_viz.viewer.panels.instance import InstancePanel, matches
from simaps_viz.viewer.panels.map import MapPanel
from simaps_viz.viewer.scene.camera import SLANT, TOP
from simaps_viz.viewer.workbench import Workbench

TABLE = 6


@pytest.fixture
def session():
    with Workbench(toy_with_surface(), services=toy_services(), port=free_port(), start=TOY_POSE) as bench:
        assert bench.wait_idle()
        with fake_page(bench) as page:
            yield page.session


def nodes(session):
    names = list(session.client.scene._handle_from_node_name)
    return {name: session.client.scene.get_handle_by_name(name) for name in names if name.startswith("/surface/")}


def click(session, origin, direction):
    """What viser reports of a click is where its ray begins and where it goes."""
    session._clicked(SimpleNamespace(ray_origin=origin, ray_direction=direction))
    assert session.wait_idle()


def test_the_view_in_space_shows_the_surface_as_it_looked_and_each_view_keeps_its_colours(session):
    panel = session.panels[MapPanel]
    assert panel.mode == "instance" and not panel._cut_m.visible and not nodes(session)
    session.look(SLANT)
    assert session.wait_idle() and panel.mode == "photo" and panel._cut_m.visible
    points = session.simap.points()
    assert sum(len(node.points) for node in nodes(session).values()) == len(points.positions)
    panel._mode.value = "height"
    assert session.wait_idle()
    session.look(TOP)
    assert session.wait_idle() and panel.mode == "instance" and not nodes(session) and not panel._cut_m.visible
    session.look(SLANT)
    assert session.wait_idle() and panel.mode == "height"


def test_a_person_sets_how_much_of_the_objects_colours_lies_over_the_photo(session):
    panel, simap = session.panels[MapPanel], session.simap
    assert not panel._tint.visible
    panel._mode.value = "photo"
    assert session.wait_idle() and panel._tint.visible
    for percent in (0, 100):
        panel._tint.value = percent
        assert session.wait_idle()
        expected = map_image(simap, "photo", scale=pixels_per_cell(simap), tint=percent / 100)
        assert session.scene._images["/map"][1]._data == png(expected)
    whole, own = map_image(simap, "photo", tint=1.0), cell_colors(simap, "instance")
    assert (whole == own)[simap.instance > 0].all()
    assert "objects are outlined" in panel._legend.content
    session.look(SLANT)
    assert session.wait_idle() and not panel._tint.visible  # the surface has one colour at a time
    assert "outlined" not in panel._legend.content and "as the cameras saw it" in panel._legend.content


def test_the_cut_hides_nodes_and_sends_none_anew(session):
    session.look(SLANT)
    assert session.wait_idle()
    made = nodes(session)

    def highest(walls):
        wall = session.simap.grid.labels.index("wall")
        shown = session.scene._cloud.shown(session.scene._cut_m, session.scene._whole_walls)
        points = session.simap.points()
        return points.positions[shown][(points.classes[shown] == wall) == walls, 2].max()

    assert highest(True) == pytest.approx(WALL_CUT_M, abs=0.1) and highest(False) > 1.0
    session.scene.cut_at(0.5, whole_walls=False)
    assert highest(True) < 0.5 and highest(False) < 0.5 and not all(node.visible for node in made.values())
    session.scene.cut_at(2.5, whole_walls=True)
    assert highest(True) > 1.9 and all(node.visible for node in made.values()) and nodes(session) == made


def test_another_cut_of_the_instances_recolours_the_same_nodes(session):
    session.look(SLANT)
    assert session.wait_idle()
    made = nodes(session)
    session.cut_map(0.0, 1.0)  # chairs 1 and 3 become one
    assert session.wait_idle() and len(session.simap.of_class("chair")) == 2
    assert nodes(session) == made and session.scene._cloud.points is session.simap.points()


def test_a_click_selects_what_stands_under_a_table(session):
    session.look(SLANT)
    assert session.wait_idle()
    x, y, _ = session.simap.by_id(PLANT).box.center_m
    click(session, (x - 0.6, y, 0.3), (1.0, 0.0, 0.0))
    assert session.selected == PLANT
    click(session, (x, y, 3.0), (0.0, 0.0, -1.0))
    assert session.selected == TABLE
    session.scene.cut_at(0.6, whole_walls=False)  # the table's top is lifted off
    click(session, (x, y, 3.0), (0.0, 0.0, -1.0))
    assert session.selected == PLANT
    session.cut_map(0.0, 1.0)
    assert session.wait_idle() and session.selected == PLANT
    click(session, (0.5, 0.5, 3.0), (0.0, 0.0, -1.0))
    assert session.selected is None


def test_a_click_from_above_lists_what_lies_there(session):
    panel = session.panels[InstancePanel]
    x, y, _ = session.simap.by_id(PLANT).box.center_m
    click(session, (x, y, 3.0), (0.0, 0.0, -1.0))
    assert session.selected == TABLE and panel._here.visible
    assert tuple(panel._here.options) == (f"dining table {TABLE}", f"potted plant {PLANT}")
    panel._go_down(f"potted plant {PLANT}")
    assert session.wait_idle() and session.selected == PLANT
    assert tuple(panel._here.options) == (f"dining table {TABLE}", f"potted plant {PLANT}")  # and up again
    panel._go_down(f"dining table {TABLE}")
    assert session.wait_idle() and session.selected == TABLE
    session.select(1)
    assert session.wait_idle() and not panel._here.visible


def test_a_hidden_object_is_found_as_it_is_called():
    simap = toy_with_surface()
    for typed in (f"potted plant {PLANT}", str(PLANT)):
        assert [one.id for one in matches(simap, typed)] == [PLANT]
    assert PLANT not in [one.id for one in matches(simap, "plants")]  # seen in 3 frames: it does not count
    often = replace(simap, hidden=tuple(replace(one, frames=6) for one in simap.hidden))
    assert [one.id for one in matches(often, "plants")][-1] == PLANT


def test_a_hidden_object_is_selected_by_name_with_its_box_round_it(session):
    session.select(PLANT)
    assert session.wait_idle() and session.selected == PLANT
    assert session.panels[InstancePanel]._list.value == f"potted plant {PLANT}, not counted"
    box = session.scene._boxed
    assert box == session.simap.by_id(PLANT).box
    lines = session.client.scene.get_handle_by_name("/selection")
    assert lines is not None and np.allclose(np.unique(lines.points[..., 2]), [0.075, 0.425], atol=0.01)
    session.select(None)
    assert session.wait_idle() and session.scene._boxed is None


def test_a_picture_covers_the_surface(session):
    session.look(SLANT)
    assert session.wait_idle() and nodes(session)
    session.show_picture(MapPicture(session.simap.spec, np.full((4, 4, 4), 200, np.uint8)))
    assert session.wait_idle() and not nodes(session)
    session.show_picture(None)
    assert session.wait_idle() and nodes(session)
