"""The page as a person meets it: Debian's Chromium on a workbench that shows the toy map."""

import numpy as np
import pytest
from browser import (
    field_of,
    mine,
    on_canvas,
    page_is_there,
    until,
    wait_for_color,
)
from playwright.sync_api import expect

from simaps_viz.colors.classes import instance_color
from simaps_viz.drawing.texture import map_image

CHAIR_1, CHAIR_3, TABLE = 1, 3, 6
EAST_HALF_OF_CHAIR_1 = (1.375, 1.925)
EMPTY = (3.0, -0.9)


def tab(page, name):
    page.get_by_role("tab", name=name, exact=True).click()


def click_map(bench, page, place):
    page.mouse.click(*on_canvas(bench, page, *place))


def object_title(page, name):
    """The heading of the instance panel, not the entry of the list that reads the same."""
    return page.locator(f".simaps-selected span:text-is('{name}')")


def fill(page, label, value):
    """Type a value; a number that is put there at once, viser's box does not notice after the workbench set it."""
    box = field_of(page, label)
    box.press("Control+a")
    box.press_sequentially(value)
    box.press("Enter")
    box.blur()


def test_opens_offline_with_north_up_and_exact_colours(bench, page):
    for instance in mine(bench).simap.instances:
        wait_for_color(bench, page, instance.centroid_m[:2], instance_color(instance.id))
    south, north = (on_canvas(bench, page, 0.0, y) for y in (-1.0, 2.0))
    west, east = (on_canvas(bench, page, x, 0.0) for x in (0.0, 3.0))
    assert south[1] > north[1] and east[0] > west[0]
    expect(page.get_by_text("3 chairs, 2 dining tables, 1 couch, 1 potted plant · 7 instances")).to_be_visible()
    expect(page.get_by_text("simulated", exact=True)).to_be_visible()


def test_k_breaks_a_chair_and_reset_heals_it(bench, page):
    fill(page, "K (%)", "30")
    expect(page.get_by_text("4 chairs, 3 dining tables, 1 couch, 1 potted plant · 9 instances")).to_be_visible()
    wait_for_color(bench, page, EAST_HALF_OF_CHAIR_1, instance_color(2))
    page.get_by_role("button", name="Reset K and resolution").click()
    wait_for_color(bench, page, EAST_HALF_OF_CHAIR_1, instance_color(CHAIR_1))
    expect(page.get_by_text("· 7 instances")).to_be_visible()


def test_a_click_selects_and_a_click_on_the_floor_deselects(bench, page):
    chair = mine(bench).simap.by_id(CHAIR_3)
    click_map(bench, page, chair.centroid_m[:2])
    expect(page.get_by_text("64 cells · 0.16 m² · seen in 4 frames")).to_be_visible()
    expect(object_title(page, "chair 3")).to_be_visible()
    assert mine(bench).selected == CHAIR_3
    dimmed = map_image(mine(bench).simap, lit={CHAIR_3})
    row, col = mine(bench).simap.spec.cell_of(*mine(bench).simap.by_id(TABLE).centroid_m[:2])
    wait_for_color(bench, page, mine(bench).simap.by_id(TABLE).centroid_m[:2], dimmed[row, col].tolist())
    wait_for_color(bench, page, chair.centroid_m[:2], instance_color(CHAIR_3))
    expect(page.get_by_text("the object's mask outlined.")).to_be_visible()
    click_map(bench, page, EMPTY)
    wait_for_color(bench, page, mine(bench).simap.by_id(TABLE).centroid_m[:2], instance_color(TABLE))
    assert mine(bench).selected is None


def test_a_command_drives_the_robot_and_the_next_starts_there(bench, page):
    tab(page, "Command")
    where = "() => { const p = window.__viserMutable.nodeRefFromName['/robot'].position; return [p.x, p.y, p.z]; }"
    page.wait_for_function("() => window.__viserMutable.nodeRefFromName['/robot'] != null")
    before = page.evaluate(where)
    fill(page, "Command", "go to the chair")
    expect(page.get_by_text("Done", exact=True)).to_be_visible()
    program = page.get_by_text('robot.move_to_object("chair", chair)')
    expect(program).to_be_hidden()  # a person wants words
    page.get_by_text("Program", exact=True).click()
    expect(program).to_be_visible()
    expect(page.get_by_text("x 1.50 m, y 0.50 m", exact=True)).to_be_attached()
    assert (mine(bench).pose.x_m, mine(bench).pose.y_m, mine(bench).pose.heading_deg) == pytest.approx(
        (1.5, 0.5, 0.0), abs=1e-6
    )
    until(page, lambda: np.linalg.norm(np.subtract(page.evaluate(where), before)) > 0.99)
    fill(page, "Command", "go to the piano")
    expect(page.get_by_text("There is no piano on this map. It has: chair (3), dining table (2).")).to_be_visible()
    assert mine(bench).pose.x_m == 1.5


def test_two_clicks_set_the_start_pose(bench, page):
    tab(page, "Command")
    page.get_by_role("button", name="Set on map").click()
    expect(page.get_by_text("Click where the robot stands")).to_be_visible()
    click_map(bench, page, (3.0, -0.9))
    expect(page.get_by_text("Now click where the robot looks.")).to_be_visible()
    click_map(bench, page, (4.0, -0.9))
    until(page, lambda: abs(mine(bench).pose.heading_deg - 90.0) < 1.5)
    assert (mine(bench).pose.x_m, mine(bench).pose.y_m) == pytest.approx((3.0, -0.9), abs=0.03)
    assert mine(bench).selected is None


def test_the_slanted_view_shows_blocks_that_can_be_clicked(bench, page):
    page.get_by_role("button", name="3-D view").click()
    page.wait_for_function(
        "() => Object.keys(window.__viserMutable.nodeRefFromName).some(n => n.startsWith('/blocks/'))"
    )
    camera = mine(bench).client.camera
    until(page, lambda: camera.position[1] < -4.0 and page_is_there(bench, page, mine(bench).simap))
    x, y, _ = mine(bench).simap.by_id(CHAIR_3).aabb_m[0]
    origin = np.array(camera.position)
    lid = np.array([x + 0.2, y + 0.2, 0.85])
    shadow = origin + (lid - origin) * origin[2] / (origin[2] - lid[2])  # where the floor behind the lid would be
    click_map(bench, page, shadow[:2])
    until(page, lambda: mine(bench).selected == CHAIR_3)
    expect(object_title(page, "chair 3")).to_be_visible()
    tab(page, "Map")
    page.get_by_role("button", name="Top view").click()
    until(page, lambda: camera.position[2] > 20.0)
