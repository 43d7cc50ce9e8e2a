"""Shared files in Debian's Chromium: the page from disk, without a network; the panel's downloads."""

import io

import numpy as np
import pytest
from browser import PIXEL, until, watched_page
from PIL import Image
from playwright.sync_api import expect
from stub_desk import open_desk, stub_desk
from test_viewer_share import COMMAND, couch_of, late_map, toy_ride
from toy_maps import TOY_POSE

from simaps_viz.navigation.agent import answer
from simaps_viz.structures import GridSpec
from simaps_viz.viewer.drawing.scene import ROBOT, frame_extent, seen_extent
from simaps_viz.viewer.drawing.texture import FLOOR
from simaps_viz.viewer.panels.share import SharePanel, ShareServices
from simaps_viz.viewer.share.page import HOLD_S, page_html

CAMERA = """() => {
  const camera = window.__viserMutable.camera;
  return [...camera.matrixWorldInverse.elements, ...camera.projectionMatrix.elements, ...window.__viserMutable
    .nodeRefFromName['/map'].matrixWorld.elements];
}"""


def place_on(page, simap, x_m, y_m):
    """Where a point of the floor appears: by the camera's own matrices; the map's node lies at the map's middle."""
    numbers = np.array(page.evaluate(CAMERA)).reshape(3, 4, 4).transpose(0, 2, 1)
    view, projection, node = numbers
    spec: GridSpec = simap.spec
    xmin, ymin, xmax, ymax = spec.extent_m
    local = np.array([x_m - (xmin + xmax) / 2.0, y_m - (ymin + ymax) / 2.0, 0.0, 1.0])
    clip = projection @ view @ node @ local
    u, v = (clip[:2] / clip[3] * (1, -1) + 1.0) / 2.0
    box = page.locator("canvas").first.bounding_box()
    return box["x"] + u * box["width"], box["y"] + v * box["height"]


def color_at(page, simap, place):
    return page.evaluate(PIXEL, list(place_on(page, simap, *place)))


def near(color, wanted, tolerance=8):
    return np.abs(np.subtract(color, wanted)).max() <= tolerance


def go_to(page, seconds):
    """Scrub: the box beside the play button takes a time."""
    box = page.locator("input[value]").first
    box.fill(f"{seconds:.2f}")
    box.press("Enter")
    page.wait_for_timeout(300)


def check_camera(page, simap):
    """The whole map, its scale bar and compass are in view, to the right of the text."""
    xmin, ymin, xmax, ymax = frame_extent(seen_extent(simap))
    text = page.locator("#simaps").bounding_box()
    canvas = page.locator("canvas").first.bounding_box()
    for x, y in ((xmin, ymin), (xmax, ymax)):
        until(page, lambda x=x, y=y: place_on(page, simap, x, y)[0] > text["x"] + text["width"], 30.0)
        u, v = place_on(page, simap, x, y)
        assert canvas["x"] <= u <= canvas["x"] + canvas["width"]
        assert canvas["y"] <= v <= canvas["y"] + canvas["height"]


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    simap = late_map()
    ride = toy_ride(simap)
    path = tmp_path_factory.mktemp("share") / "toy.html"
    path.write_bytes(page_html(simap, ride=ride))
    return simap, ride, path


def test_the_page_opens_from_disk_and_asks_for_nothing(browser, shared):
    simap, ride, path = shared
    assert path.stat().st_size < 2_000_000
    context = browser.new_context(viewport={"width": 1280, "height": 800}, offline=True)
    page = context.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{path.as_uri()}?fixedDpr=1")
    page.wait_for_function("() => window.__viserMutable?.nodeRefFromName?.['/map'] != null", timeout=60_000)
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
    until(page, shows(place, FLOOR), 30.0)
    until(page, shows(start, FLOOR), 30.0)
    go_to(page, 7.0 + 0.5 * HOLD_S)  # the middle: all is built
    until(page, shows(place, color), 30.0)
    until(page, shows(start, FLOOR), 30.0)
    go_to(page, 7.0 + HOLD_S + ride.trajectory.duration_s + HOLD_S)  # the end: the robot is at the couch
    end = ride.trajectory.at(ride.trajectory.duration_s)
    behind = (end.x_m - 0.12 * np.cos(end.yaw_rad), end.y_m - 0.12 * np.sin(end.yaw_rad))
    until(page, lambda: near(color_at(page, simap, behind), ROBOT, 60), 30.0)
    page.screenshot(path=str(path.with_suffix(".png")))
    go_to(page, 0.3)  # and back
    until(page, shows(place, FLOOR), 30.0)
    context.close()
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:"))] == []


def test_the_panel_hands_the_browser_each_file(browser):
    with stub_desk(late_map()) as desk, watched_page(browser) as page:
        panel = SharePanel(desk, ShareServices(ask=answer))
        open_desk(page, desk)
        row = page.locator("label", has_text="Ends with").locator(
            "xpath=ancestor::div[contains(@class,'Flex-root')][1]"
        )
        row.locator("input, textarea").last.fill(COMMAND)
        page.wait_for_timeout(200)
        for button, ending in (("Save as picture (.png)", ".png"), ("Save as page (.html)", ".html")):
            with page.expect_download(timeout=60_000) as download:
                page.get_by_role("button", name=button).click()
            assert download.value.suggested_filename == f"toy{ending}"
            expect(page.get_by_text(f"toy{ending} · ")).to_be_visible()
            assert panel.wait_idle()
        picture = Image.open(io.BytesIO(desk.downloads[0][1]))
        assert picture.size[0] > 2500
        assert COMMAND.encode() in desk.downloads[1][1]
        row.locator("input, textarea").last.fill("go to the piano")
        page.wait_for_timeout(200)
        page.get_by_role("button", name="Save as film (.gif)").click()
        expect(page.get_by_text("No file was made")).to_be_visible()
        assert str(desk.errors[0]).startswith('"go to the piano": There is no piano')
        row.locator("input, textarea").last.fill("")
        page.wait_for_timeout(200)
        with page.expect_download(timeout=60_000):
            page.get_by_role("button", name="Save as film (.gif)").click()
        panel.close()
