"""Asking the page why: Debian's Chromium on the toy map, and on a recorded one."""

import numpy as np
import pytest
from browser import (
    field_of,
    mine,
    on_canvas,
    open_workbench,
    pixels_around,
    rerun_frame,
    toy_services,
    toy_workbench,
    until,
    wait_for_color,
    watched_page,
)
from playwright.sync_api import expect
from toy_maps import toy_map

from simaps_viz.colors.classes import instance_color
from simaps_viz.viewer.panels.why import WhyPanel
from simaps_viz.viewer.scene.why_marks import CUT, OTHER, RAMP, SOURCE, TARGET

CHAIR_1, CHAIR_3, CHAIR_4, TABLE = 1, 3, 4, 6
WEST_HALF, EAST_HALF = (1.125, 1.925), (1.325, 1.925)
BORDER = (1.25, 1.925)
"""Between the two communities of chair 1, which reaches from x = 1.05 to 1.45."""
FLOOR_PLACE = (3.0, -0.9)


@pytest.fixture(scope="module")
def opened(browser):
    with toy_workbench() as bench, watched_page(browser, 1280, 1200) as page:
        open_workbench(page, bench)
        yield bench, page


def click_map(bench, page, place):
    page.mouse.click(*on_canvas(bench, page, *place))


def choose_chair_1(bench, page):
    click_map(bench, page, EAST_HALF)
    expect(page.get_by_text("One object although only 2 of the 5 frames that saw it")).to_be_visible()


def shows(bench, page, place, color, reach_m=0.05) -> bool:
    return any(np.abs(np.subtract(c, color)).max() <= 36 for c in pixels_around(bench, page, place, reach_m, 21))


def test_a_click_tells_why_and_draws_the_weakest_joint(bench, page):
    wait_for_color(bench, page, BORDER, instance_color(CHAIR_1))  # the map is there
    assert not shows(bench, page, BORDER, CUT)
    choose_chair_1(bench, page)
    expect(page.get_by_text("has 25.0 %, above the K = 5 % needed")).to_be_visible()
    expect(page.get_by_text("One object above K = 5 %").get_by_text("weakest joint")).to_be_attached()
    until(page, lambda: shows(bench, page, BORDER, CUT))
    page.get_by_text("Draw joints").click()  # its label belongs to the box
    until(page, lambda: not shows(bench, page, BORDER, CUT))
    page.get_by_text("Draw joints").click()
    until(page, lambda: shows(bench, page, BORDER, CUT))
    click_map(bench, page, FLOOR_PLACE)
    expect(page.get_by_text("One object although")).not_to_be_visible()


def test_the_evidence_colours_the_cells(bench, page):
    choose_chair_1(bench, page)
    wait_for_color(bench, page, WEST_HALF, instance_color(CHAIR_1))
    page.get_by_text("Colour by evidence", exact=True).click()
    wait_for_color(bench, page, WEST_HALF, RAMP[-1])  # all of its edges weigh the same
    expect(page.get_by_text("mean weight of a cell's edges inside")).to_be_attached()
    click_map(bench, page, mine(bench).simap.by_id(CHAIR_3).centroid_m[:2])
    wait_for_color(bench, page, mine(bench).simap.by_id(CHAIR_3).centroid_m[:2], RAMP[-1])
    page.get_by_text("Colour by evidence", exact=True).click()
    wait_for_color(bench, page, mine(bench).simap.by_id(CHAIR_3).centroid_m[:2], instance_color(CHAIR_3))


def test_a_merge_step_outlines_both_sides(bench, page):
    choose_chair_1(bench, page)
    step = page.get_by_role("button", name="Step 1 of 1: 32 and 32 cells, 25.0 %, weakest")
    step.hover()
    until(page, lambda: shows(bench, page, (1.05, 1.925), TARGET) and shows(bench, page, (1.45, 1.925), SOURCE))
    page.mouse.move(5, 5)
    until(page, lambda: not shows(bench, page, (1.45, 1.925), SOURCE))
    step.click()
    expect(page.get_by_text("Step 1 of 1", exact=True)).to_be_visible()
    expect(page.get_by_text("25.0 % of the part that joined neighbours the other.")).to_be_attached()
    until(page, lambda: shows(bench, page, (1.05, 1.925), TARGET))
    until(page, lambda: shows(bench, page, (1.45, 1.925), SOURCE))


def test_a_frame_button_moves_the_frame(bench, page):
    choose_chair_1(bench, page)
    expect(page.get_by_text("Its best views, the object's mask outlined.")).to_be_attached()
    page.get_by_role("button", name="3", exact=True).click()
    session = mine(bench)
    until(page, lambda: session.frame == 3)
    page.get_by_role("tab", name="Build", exact=True).click()
    expect(field_of(page, "Frame")).to_have_value("3")
    session.select(TABLE)  # that frame was one of the chair
    until(page, lambda: session.at_end)
    expect(field_of(page, "Frame")).to_have_value("4")
    session.show_frame(3)  # one that was gone to otherwise stays
    session.select(CHAIR_1)
    assert session.wait_idle() and session.frame == 3


def test_two_clicks_compare_two_objects(bench, page):
    choose_chair_1(bench, page)
    page.get_by_role("button", name="Click another object …").click()
    expect(page.get_by_text("Now click the other object on the map.")).to_be_visible()
    table = mine(bench).simap.by_id(TABLE)
    click_map(bench, page, table.centroid_m[:2])
    expect(page.get_by_text("are of different classes, and the map joins cells of one class only")).to_be_visible()
    assert mine(bench).selected == CHAIR_1  # it is still what the panel is about
    west = (table.aabb_m[0][0], table.centroid_m[1])
    until(page, lambda: shows(bench, page, west, OTHER))
    wait_for_color(bench, page, table.centroid_m[:2], instance_color(TABLE))
    # A neighbour needs no second click on the map.
    page.get_by_role("button", name="Click another object …").evaluate("(one) => one.scrollIntoView({ block: 'end' })")
    page.get_by_role("button", name="chair 3 · K 1.6 %").click()
    expect(page.locator(".simaps-apart")).to_be_in_viewport(ratio=1)  # the reason is seen where it was asked for
    expect(page.get_by_text("1.6 % of the cells of one neighbour the other, below the K = 5 % needed.")).to_be_visible()
    # Asked again, a click on the floor gives up.
    page.get_by_role("button", name="Click another object …").click()
    expect(page.get_by_role("button", name="Cancel")).to_be_visible()
    click_map(bench, page, FLOOR_PLACE)
    expect(page.get_by_text("Nothing compared.")).to_be_visible()
    assert mine(bench).selected == CHAIR_1


def test_a_merge_step_shows_the_finished_map_and_no_other_comparison(bench, page):
    session = mine(bench)
    session.show_frame(1)
    session.select(1)
    until(page, lambda: session.panels[WhyPanel].why is not None and session.wait_idle())
    session.panels[WhyPanel].compare(TABLE)
    until(page, lambda: session.panels[WhyPanel].lit == {TABLE})
    assert session.snapshot().badge == "as of frame 1, the last is 4 · back with slider Frame in tab Build"
    session.panels[WhyPanel]._choose_step(1)
    until(page, lambda: not session.panels[WhyPanel].lit and not session.snapshot().badge)
    assert session.frame == 4
    expect(page.get_by_text("are of different classes")).not_to_be_visible()
    until(page, lambda: session.scene._scene.get_handle_by_name("/why/other") is None)


def test_the_recording_is_sent_to_the_step_and_a_click_in_it_selects(browser, tmp_path):
    recording = tmp_path / "toy.rrd"
    recording.write_bytes(b"")
    services = toy_services(rerun_page=lambda urls: "<p>no viewer</p>", recordings=(recording,))
    with toy_workbench(services) as bench, watched_page(browser, 2040, 1200) as page:
        open_workbench(page, bench)
        assert bench.recording_host is not None
        pushed = bench.recording_host.listen(mine(bench).token)
        choose_chair_1(bench, page)
        page.get_by_role("button", name="Step 1 of 1: 32 and 32 cells, 25.0 %, weakest").click()
        assert pushed.get(timeout=60.0) == {"set_time": {"timeline": "merge", "time": 1}}
        frame = rerun_frame(page)
        chair = toy_map().by_id(CHAIR_4)
        items = [{"type": "entity", "entity_path": "/map/objects", "position": [*chair.centroid_m[:2], None]}]
        items[0]["position"][1] *= -1.0
        post = "event => fetch('/rerun/event' + location.search, {method: 'POST', body: JSON.stringify(event)})"
        frame.evaluate(post, {"type": "selection_change", "items": items})
        until(page, lambda: mine(bench).selected == CHAIR_4)
        expect(page.get_by_text("One object because all 4 frames that saw it")).to_be_visible()
        # A recording that a person put on another timeline is not called back to the frames.
        frame.evaluate(post, {"type": "timeline_change", "timeline": "merge"})  # comes back once it was heard
        assert pushed.empty()
        frame.evaluate(post, {"type": "timeline_change", "timeline": "frame"})
        last = len(mine(bench).simap.frame_names) - 1
        assert pushed.get(timeout=60.0) == {"set_time": {"timeline": "frame", "time": last}}
