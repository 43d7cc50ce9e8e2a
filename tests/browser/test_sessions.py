"""Several people at one workbench, in Debian's Chromium: each tab its own, a reload that loses nothing, one killed."""

from dataclasses import replace

import numpy as np
import pytest
import viser
from browser import (
    all_borrowed,
    at_rest,
    borrowed,
    field_of,
    mine,
    on_canvas,
    open_workbench,
    page_is_there,
    toy_workbench,
    until,
    wait_for_color,
    watched_page,
)
from playwright.sync_api import Error, expect
from services import all_services
from toy_maps import toy_map

from simaps_viz.drawing.texture import ColorMode, MapPicture, map_image
from simaps_viz.viewer.page.panel import Panel, PanelSpec
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.map import MapPanel

CHAIR_1, CHAIR_3, TABLE = 1, 3, 6
EAST_HALF_OF_CHAIR_1 = (1.375, 1.925)


def color_of(simap, place, mode: ColorMode = "instance", lit=None):
    """The colour that a place of a map has."""
    row, col = simap.spec.cell_of(*place)
    return map_image(simap, mode, lit=lit)[row, col].tolist()


class ButtonPanel(Panel):
    """A button whose callback fails, and one that lays a picture over the map."""

    def __init__(self, desk):
        desk.gui.add_button("Fail").on_click(lambda _: {}["nothing"])
        picture = MapPicture(desk.simap.spec, np.full((2, 2, 3), (10, 200, 30), np.uint8))
        desk.gui.add_button("Lay").on_click(lambda _: desk.show_picture(picture))
        desk.gui.add_button("Take away").on_click(lambda _: desk.show_picture(None))


@pytest.fixture(scope="module")
def bench():
    services = all_services(panels=(PanelSpec("Mine", viser.Icon.STAR, ButtonPanel),))
    with toy_workbench(services) as workbench:
        yield workbench


@pytest.fixture(scope="module")
def first(browser, bench):
    with watched_page(browser) as page:
        open_workbench(page, bench)
        yield page


@pytest.fixture
def alone(bench, first):
    """The first page, before there is a second one."""
    with borrowed(bench, first):
        yield first


@pytest.fixture(scope="module")
def second(browser, bench, first):
    """The page of another person, in a window of its own, opened after the first one."""
    with watched_page(browser) as page:
        open_workbench(page, bench)
        yield page


@pytest.fixture
def pages(bench, first, second):
    """Return each page and its session."""
    with all_borrowed(bench, first, second):
        yield (first, bench.sessions[0]), (second, bench.sessions[1])


def tab(page, name):
    page.get_by_role("tab", name=name, exact=True).click()


def fill(page, label, value):
    box = field_of(page, label)
    box.fill(value)
    box.press("Enter")
    box.blur()
    page.wait_for_timeout(150)


def loaded_again(page, bench):
    """Load the page again, and return its new session."""
    before = mine(bench)
    page.reload()
    until(page, lambda: len(bench.sessions) == 1 and mine(bench) is not before)
    return mine(bench)


def hurry(page, session):
    """Set the speed and wait until the robot has it: viser's page sends only the last change of any 50 ms."""
    fill(page, "Speed", "8")
    until(page, lambda: session.panels[CommandPanel]._drive.speed == 8.0)


def camera_at_rest(bench, page, session):
    """Where the camera stands when the page has stopped to glide there."""
    at_rest(page)
    until(page, lambda: page_is_there(bench, page, session.simap, session))
    return tuple(session.client.camera.position)


def test_a_reload_loses_nothing(browser, bench, alone):
    page, session = alone, mine(bench)
    fill(page, "K (%)", "30")
    until(page, lambda: len(session.simap.instances) == 9)
    wait_for_color(bench, page, EAST_HALF_OF_CHAIR_1, color_of(session.simap, EAST_HALF_OF_CHAIR_1))
    page.get_by_label("Colours").click()
    page.get_by_role("option", name="class").click()
    until(page, lambda: session.panels[MapPanel].mode == "class")
    tab(page, "Command")
    hurry(page, session)
    field_of(page, "Command").fill("go to the couch")
    field_of(page, "Command").press("Enter")
    expect(page.get_by_text("Done", exact=True)).to_be_visible()
    page.mouse.click(*on_canvas(bench, page, *EAST_HALF_OF_CHAIR_1))  # a command begins with nothing selected
    until(page, lambda: session.selected == 2)
    tab(page, "Build")
    fill(page, "Frame", "2")
    until(page, lambda: session.frame == 2)
    page.mouse.move(*on_canvas(bench, page, 3.0, -0.9))
    page.mouse.wheel(0, -400)
    until(page, lambda: session.viewpoints.state().moved is not None)
    pose, camera = session.pose, camera_at_rest(bench, page, session)
    new = loaded_again(page, bench)
    until(page, lambda: new.selected == 2)
    tab(page, "Instance")
    expect(page.locator(".simaps-selected", has_text="chair 2")).to_be_visible()
    tab(page, "Map")
    expect(field_of(page, "K (%)")).to_have_value("30")
    until(page, lambda: np.allclose(new.client.camera.position, camera, atol=0.05))
    camera_at_rest(bench, page, new)
    assert np.allclose(new.client.camera.position, camera, atol=0.05)
    wait_for_color(bench, page, EAST_HALF_OF_CHAIR_1, color_of(new.simap, EAST_HALF_OF_CHAIR_1, "class", {2}))
    tab(page, "Command")
    expect(page.get_by_text("Done", exact=True)).to_be_visible()
    expect(page.get_by_role("button", name="go to the couch").first).to_be_attached()
    assert new.pose == pose
    tab(page, "Build")
    expect(field_of(page, "Frame")).to_have_value("2")
    with watched_page(browser) as other:  # a new tab of a new window
        open_workbench(other, bench)
        fresh = mine(bench)
        assert fresh.selected is None and fresh.panels[MapPanel].percent == 5.0
        assert fresh.panels[CommandPanel]._past == []


def test_two_people_select_cut_and_command_at_once(bench, pages):
    (page, one), (other, two) = pages
    assert one is not two and len(bench.sessions) == 2
    couch = bench.simap.of_class("couch")[0]
    chair, place = bench.simap.by_id(CHAIR_3).centroid_m[:2], couch.centroid_m[:2]
    page.mouse.click(*on_canvas(bench, page, *chair, session=one))
    expect(page.locator(".simaps-selected", has_text="chair 3")).to_be_visible()
    tab(page, "Map")
    fill(other, "K (%)", "30")
    expect(other.get_by_text("· 9 instances")).to_be_visible()
    wait_for_color(bench, other, EAST_HALF_OF_CHAIR_1, color_of(two.simap, EAST_HALF_OF_CHAIR_1), session=two)
    expect(page.get_by_text("· 7 instances")).to_be_visible()
    expect(other.locator(".simaps-selected", has_text="chair 3")).to_have_count(0)
    wait_for_color(
        bench, page, place, color_of(bench.simap, place, lit={CHAIR_3}), session=one
    )  # dimmed here, in full colour there
    wait_for_color(bench, other, place, color_of(two.simap, place), session=two)
    for one_page, session, command in ((page, one, "go to the couch"), (other, two, "turn left")):
        tab(one_page, "Command")
        hurry(one_page, session)
        field_of(one_page, "Command").fill(command)
        field_of(one_page, "Command").press("Enter")
    for one_page in (page, other):
        expect(one_page.get_by_text("Done", exact=True)).to_be_visible()
    expect(page.get_by_text("To the couch, ")).to_be_visible()
    other.get_by_text("Program", exact=True).click()
    expect(other.get_by_text("robot.turn(-90)")).to_be_visible()
    expect(field_of(page, "Command")).to_have_value("go to the couch")
    expect(field_of(other, "Command")).to_have_value("turn left")
    assert [p.command for p in one.panels[CommandPanel]._past] == ["go to the couch"]
    assert [p.command for p in two.panels[CommandPanel]._past] == ["turn left"]
    assert one.pose.x_m > 1.0 and two.pose.x_m == 0.5
    x, y = on_canvas(bench, other, 3.0, -0.9, session=two)
    other.mouse.move(x, y)
    other.wait_for_timeout(200)
    other.mouse.wheel(0, 600)
    before = tuple(one.client.camera.position)
    until(other, lambda: two.viewpoints.state().moved is not None)
    assert tuple(one.client.camera.position) == before


def test_the_other_page_lives_on_when_one_is_killed(browser, bench, pages):
    (page, one), _ = pages
    context = browser.new_context()
    victim = context.new_page()
    victim.goto(bench.url)
    until(page, lambda: len(bench.sessions) == 3)
    with pytest.raises(Error):
        victim.goto("chrome://crash", timeout=5_000)
    until(page, lambda: len(bench.sessions) == 2)
    page.mouse.click(*on_canvas(bench, page, *bench.simap.by_id(CHAIR_3).centroid_m[:2], session=one))
    until(page, lambda: one.selected == CHAIR_3)
    expect(page.locator(".simaps-selected", has_text="chair 3")).to_be_visible()
    context.close()


def test_an_error_is_told_to_the_one_who_met_it(pages, caplog):
    (page, _), (other, two) = pages
    tab(page, "Mine")
    page.get_by_role("button", name="Fail", exact=True).click()
    expect(page.get_by_text("Unexpected error (KeyError)")).to_be_visible()
    two.say("A word", "to the other one")  # comes to that page after whatever was told before
    expect(other.get_by_text("to the other one")).to_be_visible()
    expect(other.get_by_text("Unexpected error")).to_have_count(0)
    tab(page, "Map")
    fill(page, "K (%)", "30")
    expect(page.get_by_text("· 9 instances")).to_be_visible()


def test_a_picture_takes_the_place_of_the_map_and_a_published_map_comes_to_all(bench, pages):
    (page, one), (other, two) = pages
    table = bench.simap.by_id(TABLE).centroid_m[:2]
    tab(page, "Mine")
    page.get_by_role("button", name="Lay", exact=True).click()
    wait_for_color(bench, page, table, (10, 200, 30), session=one)
    wait_for_color(bench, other, table, color_of(bench.simap, table), session=two)
    page.get_by_role("button", name="Take away").click()
    wait_for_color(bench, page, table, color_of(bench.simap, table), session=one)
    camera = tuple(two.client.camera.position)
    simap = toy_map()
    instance = np.where(simap.instance == TABLE, 0, simap.instance)
    kept = tuple(one for one in simap.instances if one.id != TABLE)
    names = (*simap.frame_names, "added")
    poses = np.concatenate([simap.T_map_camera, simap.T_map_camera[-1:]])
    fewer = replace(simap, instance=instance, instances=kept, frame_names=names, T_map_camera=poses)
    bench.publish(fewer)
    bare = color_of(fewer, table)
    wait_for_color(bench, page, table, bare, session=one)
    wait_for_color(bench, other, table, bare, session=two)
    expect(other.get_by_text("· 6 instances")).to_be_visible()
    assert tuple(two.client.camera.position) == camera
    tab(other, "Build")
    fill(other, "Frame", str(len(simap.frame_names)))
    expect(other.get_by_text("added")).to_be_visible()
