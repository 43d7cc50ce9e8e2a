"""Shared files in Debian's Chromium: the page from disk, without a network; the panel's downloads."""

import io

import numpy as np
import pytest
from browser import PATIENCE_S, PIXELS, place_on, until, watched_page
from PIL import Image
from playwright.sync_api import expect
from shared_rides import COMMAND, couch_of, late_map, toy_drive
from stub_page import open_desk, stub_page
from toy_maps import TOY_POSE

from simaps_viz.drawing.texture import FLOOR
from simaps_viz.navigation.agent import answer
from simaps_viz.viewer.page.share import HOLD_S, page_html
from simaps_viz.viewer.page.shared import Services
from simaps_viz.viewer.panels.share import SharePanel
from simaps_viz.viewer.scene.map_scene import ROBOT, frame_extent, seen_extent


def color_at(page, simap, place):
    return page.evaluate(PIXELS, [place_on(page, simap, *place)])[0]


def near(color, wanted, tolerance=8):
    return np.abs(np.subtract(color, wanted)).max() <= tolerance


def go_to(page, seconds):
    """Scrub: the box beside the play button takes a time, and pauses. While it plays, its own time may come between."""
    box = page.locator("input[value]").first

    def is_there():
        box.fill(f"{seconds:.2f}")
        box.press("Enter")
        page.wait_for_timeout(300)
        return abs(float(box.input_value()) - seconds) < 0.06

    until(page, is_there)


def check_camera(page, simap):
    """The whole map, its scale bar and compass are in view, to the right of the text."""
    xmin, ymin, xmax, ymax = frame_extent(seen_extent(simap))
    text = page.locator("#simaps").bounding_box()
    canvas = page.locator("canvas").first.bounding_box()

    def in_view(x, y):
        u, v = place_on(page, simap, x, y)
        beside = text["x"] + text["width"] < u and canvas["x"] <= u <= canvas["x"] + canvas["width"]
        return beside and canvas["y"] <= v <= canvas["y"] + canvas["height"]

    until(page, lambda: in_view(xmin, ymin) and in_view(xmax, ymax))


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    simap = late_map()
    drive = toy_drive(simap)
    path = tmp_path_factory.mktemp("share") / "toy.html"
    path.write_bytes(page_html(simap, drive=drive))
    return simap, drive, path


def test_the_page_opens_from_disk_and_asks_for_nothing(browser, shared):
    simap, drive, path = shared
    assert path.stat().st_size < 2_000_000
    context = browser.new_context(viewport={"width": 1280, "height": 800}, offline=True)
    page = context.new_page()
    page.set_default_timeout(1000 * PATIENCE_S)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{path.as_uri()}?fixedDpr=1")
    page.wait_for_function("() => window.__viserMutable?.nodeRefFromName?.['/map'] != null")
    expect(page.get_by_role("heading", name="toy")).to_be_visible()
    expect(page.get_by_text("simulated", exact=True)).to_be_visible()
    expect(page.get_by_text("7 instances")).to_be_visible()
    expect(page.get_by_text(f"“{COMMAND}”").first).to_be_visible()
    assert page.title() == "toy · SI Maps"
    check_camera(page, simap)
    couch, color = couch_of(simap)
    place = couch.centroid_m[:2]
    start = (TOY_POSE.x_m - 0.1, TOY_POSE.y_m)

    def shows(place, wanted):
        return lambda: near(color_at(page, simap, place), wanted)

    go_to(page, 0.3)  # the beginning: nobody has seen the couch yet, and there is no robot
    until(page, shows(place, FLOOR))
    until(page, shows(start, FLOOR))
    go_to(page, 7.0 + 0.5 * HOLD_S)  # the middle: all is built
    until(page, shows(place, color))
    until(page, shows(start, FLOOR))
    go_to(page, 7.0 + HOLD_S + drive.trajectory.duration_s + HOLD_S)  # the end: the robot is at the couch
    end = drive.trajectory.at(drive.trajectory.duration_s)
    behind = (end.x_m - 0.12 * np.cos(end.yaw_rad), end.y_m - 0.12 * np.sin(end.yaw_rad))
    until(page, lambda: near(color_at(page, simap, behind), ROBOT, 60))
    page.screenshot(path=str(path.with_suffix(".png")))
    go_to(page, 0.3)  # and back
    until(page, shows(place, FLOOR))
    context.close()
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:"))] == []


def test_the_panel_hands_the_browser_each_file(browser):
    with stub_page(late_map(), Services(ask=answer)) as desk, watched_page(browser) as page:
        panel = SharePanel(desk)
        open_desk(page, desk)
        row = page.locator("label", has_text="Robot's drive").locator(
            "xpath=ancestor::div[contains(@class,'Flex-root')][1]"
        )

        def say(command):
            row.locator("input, textarea").last.fill(command)
            until(page, lambda: panel._command.value == command)

        say(COMMAND)
        for button, ending in (("Save as picture (.png)", ".png"), ("Save as page (.html)", ".html")):
            with page.expect_download() as download:
                page.get_by_role("button", name=button).click()
            assert download.value.suggested_filename == f"toy{ending}"
            expect(page.get_by_text(f"toy{ending} · ")).to_be_visible()
            assert panel.wait_idle()
        picture = Image.open(io.BytesIO(desk.downloads[0][1]))
        assert picture.size[0] > 2500
        assert COMMAND.encode() in desk.downloads[1][1]
        say("go to the piano")
        page.get_by_role("button", name="Save as film (.gif)").click()
        expect(page.get_by_text("No file was made")).to_be_visible()
        assert str(desk.errors[0]).startswith('"go to the piano": There is no piano')
        say("")
        with page.expect_download():
            page.get_by_role("button", name="Save as film (.gif)").click()
        panel.close()
