"""Masks over a frame in the page: Debian's Chromium, thresholds moved by hand."""

import pytest
from browser import field_of, until, watched_page
from playwright.sync_api import expect
from stub_page import stub_page
from toy_maps import toy_map
from toy_segmentations import toy_segmentation

from simaps_viz.viewer.panels.masks import SegmentationPanel


def see(page, text):
    expect(page.get_by_text(text)).to_be_visible()


@pytest.fixture
def bench(browser):
    with stub_page(toy_map()) as desk, watched_page(browser, 1280, 1500) as page:
        desk.server.gui.configure_theme(control_width="large")
        panel = SegmentationPanel(desk, toy_segmentation())
        panel.time_changed(0, None)
        page.goto(f"{desk.url}/?fixedDpr=1")
        see(page, "Frame 0, the last is 2: picture 0010")
        yield desk, panel, page, desk.frames
        panel.close()
        assert desk.errors == []


def test_masks_are_switched_stepped_and_thresholds_tried(bench):
    _, panel, page, chosen = bench
    see(page, "As the map was built: 2 segments, 50.0 % of the picture.")
    page.get_by_text("Next", exact=True).click()
    see(page, "Frame 1, the last is 2: picture 0011")
    until(page, lambda: chosen == [1])
    score = field_of(page, "Score")
    score.fill("0.7")
    score.press("Enter")
    see(page, "Change: −1 floor")
    see(page, "--segmentation toy.onnx --score-threshold 0.7")
    assert len(panel.masks.segments) == 1
    page.get_by_text("As the map was built", exact=True).click()
    until(page, lambda: len(panel.masks.segments) == 2)
    expect(page.get_by_text("Change: −1 floor")).not_to_be_visible()  # what is below it moves up
    page.get_by_text("Classes: 2 of 2 segments shown").click()
    page.get_by_text("None", exact=True).click()
    see(page, "Classes: 0 of 2 segments shown")
    see(page, "No segment is shown on this frame.")
    page.get_by_label("chair (1)").check()
    until(page, lambda: panel.hidden == {"floor"})
    page.get_by_text("Enlarge", exact=True).click()
    see(page, "Frame 1: 2 segments")
    page.get_by_text("Close", exact=True).click()
    expect(page.get_by_text("Frame 1: 2 segments")).not_to_be_visible()
    page.get_by_text("Next", exact=True).click()
    see(page, "0012.png: expected a picture, found 3 bytes")
