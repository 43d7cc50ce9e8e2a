"""Comparing two maps in the page: Debian's Chromium on the toy map."""

import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser import toy_services, until, watched_page
from playwright.sync_api import expect
from stub_page import color_at, colors_around, open_desk, settle, stub_page
from toy_maps import toy_map

from simaps_viz.drawing.compare_picture import KINDS
from simaps_viz.errors import InputError
from simaps_viz.evaluation.two_maps import Source
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.simap import repartition
from simaps_viz.viewer.panels.compare import ComparePanel, load_bytes

CHAIR_1, CHAIR_3, COUCH = (1.25, 1.85), (-0.2, -0.8), (3.6, 2.45)
SLOW = "a source that takes its time"
GATE = threading.Event()


def make(key, simap, tell):
    if key == "broken":
        raise InputError("toy: expected frames, found none")
    if key == "slow":
        for step in range(6000):  # five minutes: it does not end before it is given up
            tell("mapping frames", step, 6000)
            if GATE.wait(0.05):
                break
    return repartition(simap, k_percent=0.0)


SOURCES = (
    Source("components", "Method components"),
    Source("slow", SLOW),
    Source("broken", "Broken"),
)


@pytest.fixture(scope="module")
def opened(browser):
    with stub_page(toy_map(), toy_services()) as desk, watched_page(browser, 1280, 1150) as page:
        maker: Any = SimpleNamespace(sources=lambda simap: SOURCES, make=make)
        panel = ComparePanel(desk, maker)
        open_desk(page, desk)
        yield desk, panel, page
        panel.close()


@pytest.fixture
def bench(opened):
    desk, panel, _ = opened
    yield opened
    panel.stop()
    assert desk.wait_idle()
    errors = list(desk.errors)
    desk.errors.clear()
    assert errors == []


def row_of(page, label):
    found = page.locator("label", has_text=label).locator("xpath=ancestor::div[contains(@class,'Flex-root')][1]")
    return found.locator("input:not([type=hidden])")


def choose(panel, page, label, option):
    """Choose, and wait until the panel knows: viser's page sends only the last change of any 50 ms."""
    row_of(page, label).first.click()
    page.get_by_role("option", name=option, exact=True).click()
    left, right = (side._which for side in panel._sides)
    chosen = {"Left": left, "Right": right, "Show as": panel._how}[label]
    until(page, lambda: chosen.value == option)


def near(color, wanted, tolerance=6):
    return bool(np.abs(np.subtract(color, wanted)).max() <= tolerance)


def line_near(desk, page, place, color, reach_m=0.15):
    return any(near(c, color, 24) for c in colors_around(desk, page, place, reach_m, 41))


def begin(desk, panel, page, right="Method components"):
    choose(panel, page, "Right", right)
    page.get_by_role("button", name="Compare", exact=True).click()
    until(page, lambda: panel.active)
    until(page, lambda: desk.pictures[-1] is not None)
    settle(desk, page)


def test_a_merger_is_listed_drawn_and_clicked(bench):
    desk, panel, page = bench
    begin(desk, panel, page)
    expect(page.get_by_text("1 difference", exact=True)).to_be_visible()
    expect(page.get_by_text("several objects are one").first).to_be_visible()
    expect(page.get_by_text("5 objects agree")).to_be_visible()
    west = (-0.4, CHAIR_3[1])
    until(page, lambda: line_near(desk, page, west, KINDS["merged"][0]))
    page.get_by_role("button", name="merged · chairs 1 + 3 → 1").click()
    expect(page.get_by_text("chairs 1 + 3 ·")).to_be_visible()
    expect(row_of(page, "Divide").last).to_have_value("43")  # beside the two, which stay whole
    named = ["chair 1 · This map (paper)", "chair 3 · This map (paper)", "chair 1 · Method components"]
    until(page, lambda: [label.text for label in desk.scene.texts["compare"]] == named)
    around = pytest.approx((-0.4 - 2.48, -1.0 - 2.48, 1.45 + 2.48, 2.1 + 2.48))
    until(page, lambda: desk.looked[-1] == around)
    page.get_by_role("button", name="End comparison").click()
    until(page, lambda: desk.pictures[-1] is None)
    expect(page.get_by_text("several objects are one")).to_have_count(0)


def test_the_line_shows_one_map_west_and_the_other_east_of_it(bench):
    desk, panel, page = bench
    begin(desk, panel, page)
    maps = panel.maps
    row, col = maps.spec.cell_of(*CHAIR_1)  # joined to chair 3 on the right one: so it has that one's colour
    left, right = (tuple(side.colors[row, col].tolist()) for side in (maps.left, maps.right))
    couch = maps.spec.cell_of(*COUCH)
    assert tuple(maps.left.colors[couch]) == tuple(maps.right.colors[couch])
    page.get_by_text("Mark all listed").click()
    until(page, lambda: not panel._mark_all.value)
    line = row_of(page, "Divide").last
    for percent, color in ((0, right), (100, left)):
        line.fill(str(percent))
        until(page, lambda color=color: near(color_at(desk, page, *CHAIR_1), color))
    line.fill("50")
    middle = (maps.spec.x0_m + 0.5 * maps.spec.cols * maps.spec.cell_size_m, -0.5)
    until(page, lambda: line_near(desk, page, middle, (26, 30, 38)))
    page.get_by_text("Mark all listed").click()
    until(page, lambda: panel._mark_all.value)


def test_other_settings_of_the_same_map_follow_the_slider(bench):
    _, panel, page = bench
    choose(panel, page, "Right", "This map, other settings")
    page.get_by_role("button", name="Compare", exact=True).click()
    split = page.get_by_role("button", name="split · chair 1 → 1 + 2").first
    expect(split).to_be_visible()  # the right side begins 20 % away
    row_of(page, "Right K (%)").last.fill("5")
    expect(page.get_by_text("No differences")).to_be_visible()
    row_of(page, "Right K (%)").last.fill("30")
    expect(split).to_be_visible()
    assert panel.maps.right.title == "K 30 %, resolution 1"


def test_a_slow_map_shows_progress_and_can_be_given_up(bench):
    desk, panel, page = bench
    GATE.clear()
    try:
        choose(panel, page, "Right", SLOW)
        page.get_by_role("button", name="Compare", exact=True).click()
        expect(page.get_by_text("Mapping frames: ")).to_be_visible()
        page.get_by_role("button", name="End comparison").click()
        expect(page.get_by_text("Mapping frames: ")).to_have_count(0)
        assert not panel.active and desk.pictures[-1] is None
    finally:
        GATE.set()
    page.get_by_role("button", name="Compare", exact=True).click()
    until(page, lambda: panel.active)


def test_what_goes_wrong_is_said_and_the_page_goes_on(bench):
    desk, panel, page = bench
    for right, words in (("Broken", "expected frames, found none"), ("This map", "expected two different maps")):
        choose(panel, page, "Right", right)
        page.get_by_role("button", name="Compare", exact=True).click()
        until(page, lambda: desk.errors)
        expect(page.get_by_text("Not compared")).to_be_visible()
        assert words in str(desk.errors.pop())
    begin(desk, panel, page)


def test_a_file_is_read_and_compared(bench, tmp_path):
    desk, panel, page = bench
    save_map(repartition(toy_map(), k_percent=0.0), tmp_path / "other.npz")
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Add a map file (.npz) …").click()
    chooser.value.set_files(tmp_path / "other.npz")
    until(page, lambda: desk.said)
    page.get_by_role("button", name="Compare", exact=True).click()
    until(page, lambda: panel.active)
    assert panel.maps.right.title == "other.npz"


def test_no_map_is_refused_by_its_name():
    with pytest.raises(InputError, match=r"^x\.npz: "):
        load_bytes("x.npz", b"no map")
